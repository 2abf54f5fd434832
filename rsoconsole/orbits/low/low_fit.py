"""Orbit fit of a low satellite through streaks: least squares on their ends. Pure.

A timing error of the shutter shifts both ends of a streak along the path by the same amount: it
changes the place, not the rate, so each streak's four numbers have one covariance. The common error
of the clock is an unknown of its own; the others are those of `directions`. Forces enter by Encke's
deviation from the motion about a point mass, as in `fit`. Where the streaks do not determine the
eccentricity, a wide prior does (stated in the result). Source: Tapley, Schutz & Born 2004, 4.6, for
errors that several measurements share.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rsoconsole.orbits.determination.fit import inverse_normal_matrix
from rsoconsole.orbits.first.directions import (
    LineOfSight,
    MeasuredDirections,
    State,
    reduce_directions,
)
from rsoconsole.orbits.motion.forces import ZonalPropagator
from rsoconsole.orbits.motion.prediction import KnownOrbit
from rsoconsole.orbits.motion.two_body import (
    MU_EARTH_KM3_S2,
    eccentricity_vector,
    propagate,
    propagate_with_slopes,
)
from rsoconsole.records import FloatArray, Site
from rsoconsole.sky import ARCSEC_RAD, IntArray, position_angle_deg, separation_deg
from rsoconsole.words import NS_PER_S

UNSEEN_ARCSEC = 7200.0
"""Sigma along the streak of an end outside the frame: only the streak's line is known there."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StreakEnds:
    """Places of an object when the shutter opened and closed, for one sense of its motion."""

    t_open_utc_ns: int
    t_close_utc_ns: int
    ra_icrs_deg: FloatArray
    """Right ascensions (2,) at opening and closing."""
    dec_icrs_deg: FloatArray
    sigma_along_arcsec: FloatArray
    """One sigma (2,) of each end along the streak; ``UNSEEN_ARCSEC`` outside the frame."""
    sigma_across_arcsec: FloatArray
    delay_s: FloatArray = field(default_factory=lambda: np.zeros(2))
    """Delays (2,) of the exposure at each place's row after that at the frame's first row."""

    @property
    def exposure_s(self) -> float:
        """Time from opening to closing."""
        return (self.t_close_utc_ns - self.t_open_utc_ns) / NS_PER_S

    @property
    def t_mid_utc_ns(self) -> int:
        """Midpoint of opening and closing, without the delays of rows."""
        return (self.t_open_utc_ns + self.t_close_utc_ns) // 2

    @property
    def ends_utc_ns(self) -> IntArray:
        """Instants (2,) of the object at the two ends, including the delays of their rows."""
        late_ns = np.rint(self.delay_s * NS_PER_S).astype(np.int64)
        return np.array([self.t_open_utc_ns, self.t_close_utc_ns]) + late_ns

    @property
    def is_whole(self) -> bool:
        """True where both ends are in the frame."""
        return bool(np.all(self.sigma_along_arcsec < UNSEEN_ARCSEC))

    @property
    def length_arcsec(self) -> float:
        """Angular distance from end to end."""
        return 3600.0 * separation_deg(*self._first, *self._last)

    @property
    def speed_arcsec_s(self) -> float:
        """Angular speed; valid where both ends are in the frame."""
        return self.length_arcsec / (float(np.diff(self.ends_utc_ns)[0]) / NS_PER_S)

    @property
    def rate_arcsec_s(self) -> FloatArray:
        """Rates (2,), east and north; valid where both ends are in the frame."""
        towards = np.radians(position_angle_deg(*self._first, *self._last))
        return self.speed_arcsec_s * np.array([np.sin(towards), np.cos(towards)])

    @property
    def covariances_arcsec2(self) -> FloatArray:
        """Covariances (2, 2, 2), one (2, 2) matrix east and north for each end."""
        towards = np.radians(position_angle_deg(*self._first, *self._last))
        s, c = np.sin(towards), np.cos(towards)
        along, across = self.sigma_along_arcsec**2, self.sigma_across_arcsec**2
        both = (along - across) * s * c
        parts = [along * s * s + across * c * c, both, both, along * c * c + across * s * s]
        return np.stack(parts, axis=-1).reshape(2, 2, 2)

    def with_end_error(self, arcsec: float) -> "StreakEnds":
        """Return the streak with an independent, isotropic error added to each end."""
        return replace(
            self,
            sigma_along_arcsec=np.hypot(self.sigma_along_arcsec, arcsec),
            sigma_across_arcsec=np.hypot(self.sigma_across_arcsec, arcsec),
        )

    def with_length_error(self, arcsec: float) -> "StreakEnds":
        """Return the streak with an error added to each end, along the streak."""
        return replace(self, sigma_along_arcsec=np.hypot(self.sigma_along_arcsec, arcsec))

    @property
    def reversed(self) -> "StreakEnds":
        """Streak with its ends exchanged, for the other sense of the motion."""
        names = ("ra_icrs_deg", "dec_icrs_deg", "sigma_along_arcsec", "sigma_across_arcsec")
        turned = {name: getattr(self, name)[::-1] for name in (*names, "delay_s")}
        return replace(self, **turned)

    @property
    def _first(self) -> tuple[float, float]:
        return float(self.ra_icrs_deg[0]), float(self.dec_icrs_deg[0])

    @property
    def _last(self) -> tuple[float, float]:
        return float(self.ra_icrs_deg[1]), float(self.dec_icrs_deg[1])


SIGMA_E = 0.03
"""Prior root mean square eccentricity, used until the streaks determine it themselves."""
_WELL_KNOWN = 0.3
"""Sigma of the eccentricity, as a share of ``SIGMA_E``, below which the prior is left out."""
LEFT_OUT_KM_S2 = 5e-8
"""One sigma of each component of the acceleration left out by `ZonalPropagator`, km/s2."""
_NO_BIAS_S = 1e-9
_MAX_STEPS = 25
_STEADY = 1e-3
"""Largest gain of a step in the sum of squares at which the search ends."""
_NO_NUMBERS = np.linalg.LinAlgError


@dataclass(frozen=True, slots=True, kw_only=True)
class TimingErrors:
    """Errors of the times of frames, in seconds."""

    scatter_s: float
    """Timing scatter from frame to frame, one sigma."""
    bias_sigma_s: float = 0.0
    """Bias common to all frames, one sigma."""
    scatter_frames: float = np.inf
    """Number of frames that ``scatter_s`` was found from; where few, the streaks correct it."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LowOrbit(KnownOrbit):
    """Orbit of a low satellite through streaks; its epoch is near the middle of their time span."""

    residuals_arcsec: FloatArray
    """Residuals (K, 2, 2) of each end, along and across the path: measured minus computed."""
    believes_round: bool
    """True where the fit needed the prior on the eccentricity."""
    is_converged: bool


@dataclass(slots=True, kw_only=True, eq=False)
class _Problem:
    seen: MeasuredDirections
    view: LineOfSight
    motion: ZonalPropagator
    whitening: FloatArray
    """Whitening matrix (4K, 4K) of the residuals."""
    sigma_e: float | None
    bias_sigma_s: float
    deviation: tuple[FloatArray, FloatArray]

    def rows(self, unknowns: FloatArray) -> tuple[FloatArray, FloatArray, int]:
        """Compute whitened residuals, their slopes (rows, 7), and how many rows are measured.

        The last unknown: seconds after the frame's time at which the light was there.
        """
        r, v = self.view.state(unknowns[:6])
        places, velocities, slopes = self.places(r, v, unknowns[6])
        seen = self.later(unknowns[6])
        value = self.whitening @ seen.residuals_arcsec(places).reshape(-1)
        by_place = seen.residual_slopes(places)
        by_state = (by_place @ slopes).reshape(-1, 6)
        to_state = self.view.slopes(unknowns[:6])
        by_time = (by_place @ (velocities - seen.sites_km_s)[..., None]).reshape(-1, 1)
        by_unknown = self.whitening @ np.hstack([by_state @ to_state, by_time])
        measured = len(value)
        sigma_s = max(self.bias_sigma_s, _NO_BIAS_S)
        value = np.append(value, unknowns[6] / sigma_s)
        by_unknown = np.vstack([by_unknown, np.eye(7)[6] / sigma_s])
        if self.sigma_e is not None:
            e, e_slopes = eccentricity_vector(r, v, MU_EARTH_KM3_S2)
            sigma = self.sigma_e / np.sqrt(2.0)
            value = np.concatenate([value, e / sigma])
            by_shape = np.hstack([e_slopes @ to_state / sigma, np.zeros((3, 1))])
            by_unknown = np.vstack([by_unknown, by_shape])
        return value, by_unknown, measured

    def later(self, bias_s: float) -> MeasuredDirections:
        """Directions as of ``bias_s`` later: the site has moved on."""
        sites_km = self.seen.sites_km + self.seen.sites_km_s * bias_s
        return replace(self.seen, t_s=self.seen.t_s + bias_s, sites_km=sites_km)

    def places(
        self, r: FloatArray, v: FloatArray, bias_s: float
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Places (N, 3) when the light left, velocities, and slopes (N, 3, 6) by the state."""
        seen = self.later(bias_s)
        places, velocities, slopes = propagate_with_slopes(r, v, seen.t_s)
        places, velocities = places + self.deviation[0], velocities + self.deviation[1]
        tau_s = seen.light_times_s(places)
        tau_s = seen.light_times_s(places - velocities * tau_s[:, None])
        return places - velocities * tau_s[:, None], velocities, slopes

    def deviate(self, unknowns: FloatArray) -> None:
        """Compute the deviation by the flattened Earth near these unknowns."""
        r, v = self.view.state(unknowns[:6])
        t_s = self.seen.t_s + unknowns[6]
        true, plain = self.motion.states(r, v, t_s), propagate(r, v, t_s)
        self.deviation = (true[0] - plain[0], true[1] - plain[1])


def fit_streaks(
    site: Site,
    streaks: Sequence[StreakEnds],
    start: State,
    t_start_utc_ns: int,
    timing: TimingErrors,
) -> LowOrbit | None:
    """Fit an orbit to streaks with their ends in order of time; None where none is found.

    ``streaks``: at least two, in order of time. ``start``: a state near the orbit, at
    ``t_start_utc_ns``.
    """
    seen = reduce_directions(
        site,
        np.concatenate([each.ends_utc_ns for each in streaks]),
        np.concatenate([each.ra_icrs_deg for each in streaks]),
        np.concatenate([each.dec_icrs_deg for each in streaks]),
        np.concatenate([each.covariances_arcsec2 for each in streaks])[:, [0, 0, 1], [0, 1, 1]],
    )
    motion = ZonalPropagator(epoch_utc_ns=seen.epoch_utc_ns)
    moved = ZonalPropagator(epoch_utc_ns=t_start_utc_ns).states(
        *start, np.array([(seen.epoch_utc_ns - t_start_utc_ns) / NS_PER_S])
    )
    state = (moved[0][0], moved[1][0])
    if not np.all(np.isfinite(state)):
        return None
    nearest = int(np.argmin(np.abs(seen.t_s)))
    view = LineOfSight.through(state, seen.sites_km[nearest], seen.sites_km_s[nearest])
    zero = np.zeros((len(seen), 3))
    problem = _Problem(
        seen=seen,
        view=view,
        motion=motion,
        whitening=np.eye(2 * len(seen)),
        sigma_e=SIGMA_E,
        bias_sigma_s=timing.bias_sigma_s,
        deviation=(zero, zero),
    )
    unknowns = np.append(view.unknowns(state), 0.0)
    problem.deviate(unknowns)
    problem.whitening = _whitening(problem, unknowns, streaks, timing)
    with np.errstate(all="ignore"):
        unknowns, is_converged = _descend(problem, unknowns)
        if _is_eccentricity_known(problem, unknowns):
            problem.sigma_e = None
            unknowns, is_converged = _descend(problem, unknowns)
        return _finished(problem, unknowns, len(streaks), is_converged=is_converged)


def _rates(problem: _Problem, unknowns: FloatArray) -> FloatArray:
    """Rates (N, 2) in arcsec/s east and north at each end."""
    r, v = problem.view.state(unknowns[:6])
    seen = problem.seen
    places, velocities = problem.motion.states(r, v, seen.t_s)
    line = places - seen.sites_km
    size = np.linalg.norm(line, axis=-1)
    speed = (velocities - seen.sites_km_s) / size[:, None] / ARCSEC_RAD
    parts = [np.sum(speed * axis, axis=-1) for axis in (seen.east, seen.north)]
    return np.stack(parts, axis=-1)


def _whitening(
    problem: _Problem, unknowns: FloatArray, streaks: Sequence[StreakEnds], timing: TimingErrors
) -> FloatArray:
    """Whitening matrix (4K, 4K): all residuals to unit variances without correlation."""
    size = 4 * len(streaks)
    covariance = np.zeros((size, size))
    shared = _rates(problem, unknowns).reshape(-1, 4)
    own = np.concatenate([each.covariances_arcsec2 for each in streaks])
    for n, each in enumerate(own):
        covariance[2 * n : 2 * n + 2, 2 * n : 2 * n + 2] = each
    for k, each in enumerate(shared):
        at = slice(4 * k, 4 * k + 4)
        covariance[at, at] += timing.scatter_s**2 * np.outer(each, each)
    for each in _pulled(problem, unknowns):
        covariance += np.outer(each, each)
    return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)))


def _pulled(problem: _Problem, unknowns: FloatArray) -> FloatArray:
    """Displacements (3, 4K) in arcsec by one sigma of a steady pull: outward, ahead and aside.

    The pull acts since the epoch.
    """
    r, v = problem.view.state(unknowns[:6])
    seen = problem.seen
    outward = r / np.linalg.norm(r)
    pole = np.cross(r, v)
    pole = pole / np.linalg.norm(pole)
    axes = np.stack([outward, np.cross(pole, outward), pole])
    places, _, _ = problem.places(r, v, unknowns[6])
    slopes = seen.residual_slopes(places)
    way = 0.5 * LEFT_OUT_KM_S2 * seen.t_s**2
    return np.stack([((slopes @ axis) * way[:, None]).ravel() for axis in axes])


def _descend(problem: _Problem, unknowns: FloatArray) -> tuple[FloatArray, bool]:
    """Descend by Levenberg and Marquardt.

    The deviation by the flattened Earth is computed again after each step.
    """
    damping = 1e-9
    value, slopes, _ = problem.rows(unknowns)
    for _ in range(_MAX_STEPS):
        cost = float(value @ value)
        normal, gradient = slopes.T @ slopes, slopes.T @ value
        scale = np.diag(np.maximum(np.diag(normal), 1e-300))
        for _ in range(10):
            try:
                step = -np.linalg.solve(normal + damping * scale, gradient)
            except _NO_NUMBERS:
                return unknowns, False
            if not -float(step @ gradient) > _STEADY:
                return unknowns, bool(np.isfinite(cost))
            step = step * min(1.0, 0.7 / max(abs(float(step[4])), 1e-300))
            value, slopes, _ = problem.rows(unknowns + step)
            if float(value @ value) <= cost:
                break
            damping = max(damping * 100.0, 1e-6)
        else:
            return unknowns, False
        unknowns = unknowns + step
        damping /= 100.0
        problem.deviate(unknowns)
        value, slopes, _ = problem.rows(unknowns)
    return unknowns, False


def _is_eccentricity_known(problem: _Problem, unknowns: FloatArray) -> bool:
    """True where the streaks alone determine the eccentricity."""
    _, slopes, measured = problem.rows(unknowns)
    if measured < 8:
        return False
    to_state = problem.view.slopes(unknowns[:6])
    alone = slopes[: measured + 1]
    covariance = to_state @ inverse_normal_matrix(alone.T @ alone)[:6, :6] @ to_state.T
    _, by_state = eccentricity_vector(*problem.view.state(unknowns[:6]))
    spread = by_state @ covariance @ by_state.T
    return bool(np.sqrt(np.trace(spread)) < _WELL_KNOWN * SIGMA_E)


def _finished(
    problem: _Problem, unknowns: FloatArray, streaks: int, *, is_converged: bool
) -> LowOrbit | None:
    r, v = problem.view.state(unknowns[:6])
    value, slopes, _ = problem.rows(unknowns)
    to_state = problem.view.slopes(unknowns[:6])
    covariance = to_state @ inverse_normal_matrix(slopes.T @ slopes)[:6, :6] @ to_state.T
    if not (np.all(np.isfinite(covariance)) and np.all(np.isfinite(value))):
        return None
    places, _, _ = problem.places(r, v, unknowns[6])
    off = problem.later(unknowns[6]).residuals_arcsec(places)
    ahead = _rates(problem, unknowns)
    ahead = ahead / np.linalg.norm(ahead, axis=-1, keepdims=True)
    along = np.sum(off * ahead, axis=-1)
    across = off[:, 1] * ahead[:, 0] - off[:, 0] * ahead[:, 1]
    return LowOrbit(
        epoch_utc_ns=problem.seen.epoch_utc_ns,
        r_km=r,
        v_km_s=v,
        covariance=covariance,
        forces=problem.motion,
        residuals_arcsec=np.stack([along, across], axis=-1).reshape(streaks, 2, 2),
        believes_round=problem.sigma_e is not None,
        is_converged=is_converged,
    )
