"""Orbit fit to all directions: least squares with a stated prior. Pure.

The unknowns describe the orbit as seen from the site at the epoch: the direction (two numbers), its
rates (two), the logarithm of the range, and the range rate divided by the range. A short arc
determines the first four well and the last two poorly; with these unknowns the problem is well
scaled for any arc, and the range stays positive. Source of the method: Tapley, Schutz & Born 2004,
Statistical Orbit Determination, 4; Levenberg's damping; Huber's weights against outliers.

Forces other than the Earth's point mass enter as a deviation from the two-body orbit (Encke). It is
computed once, reused while the unknowns change little, and computed again after a large change. The
partial derivatives are always those of two-body motion.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rsoconsole.orbits.first.directions import LineOfSight, MeasuredDirections, State
from rsoconsole.orbits.motion.forces import Propagator
from rsoconsole.orbits.motion.two_body import (
    eccentricity_vector,
    propagate,
    propagate_with_slopes,
    semi_major_axis,
)
from rsoconsole.records import FloatArray
from rsoconsole.sky import ARCSEC_RAD

BoolArray = npt.NDArray[np.bool_]

_MAX_STEPS = 40
_MAX_DAMPINGS = 8
_HUBER = 2.0
_OUTLIER = 16.0
"""Squared residual, in units of its variance, from which on a direction is left out."""
_MEDIAN_SQUARE = 1.386
"""Median of the sum of squares of two standard normal residuals."""
_MAX_DEVIATIONS = 8
_STALE = 0.01
"""Largest error of a kept deviation, seen from the site, as a share of a direction's sigma."""
_NO_NUMBERS = np.linalg.LinAlgError


@dataclass(frozen=True, slots=True, kw_only=True)
class Prior:
    """Prior on the semi-major axis and eccentricity of an orbit; None in a field: no prior."""

    sigma_e: float | None = None
    """RMS eccentricity of a prior about 0, over root 2 in each component; None: no prior."""
    a_km: float | None = None
    """Mean of the semi-major axis; None: no prior."""
    sigma_a_km: float = 1.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OrbitFit:
    """Result of an orbit fit: state at the epoch of the directions, covariance, residuals."""

    r_km: FloatArray
    """Position (3,), GCRS."""
    v_km_s: FloatArray
    covariance: FloatArray
    """Covariance (6, 6), km and km/s."""
    residuals_arcsec: FloatArray
    """Residuals (N, 2), measured minus predicted, east and north; of outliers too."""
    is_used: BoolArray
    """Mask (N,), False for directions left out as outliers."""
    cost: float
    """Chi-square of all directions, each outlier counted at its bound, plus ``prior_chi2``."""
    chi2: float
    """Chi-square of the used directions alone."""
    prior_chi2: float
    """Chi-square of the prior alone: large where the orbit contradicts the prior."""
    degrees_of_freedom: int
    is_converged: bool


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Rows:
    """Residuals and their slopes for one set of unknowns."""

    unknowns: FloatArray
    deviation: tuple[FloatArray, FloatArray] | None
    residuals_arcsec: FloatArray
    value: FloatArray
    slopes: FloatArray


@dataclass(slots=True, kw_only=True, eq=False)
class _Problem:
    """Directions, prior and line of sight of one fit, and its latest rows."""

    seen: MeasuredDirections
    prior: Prior
    view: LineOfSight
    deviation: tuple[FloatArray, FloatArray] | None = None
    """Difference (N, 3) from the point mass's orbit, and its rate: km, km/s."""
    _last: "_Rows | None" = None

    def rows(self, unknowns: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Whitened residuals (2N + prior rows,) and their slopes (rows, 6)."""
        rows = self._rows(unknowns)
        return rows.value, rows.slopes

    def residuals_arcsec(self, unknowns: FloatArray) -> FloatArray:
        """Residuals (N, 2), measured minus predicted on the sky, arcsec."""
        return self._rows(unknowns).residuals_arcsec

    def _rows(self, unknowns: FloatArray) -> "_Rows":
        """Compute the rows, or return the last ones: a step begins where the one before it
        ended.
        """
        last = self._last
        is_known = last is not None and last.deviation is self.deviation
        if last is not None and is_known and np.array_equal(last.unknowns, unknowns):
            return last
        places, slopes = self.places(unknowns)
        residuals = self.seen.residuals_arcsec(places)
        value = self.seen.whitened(residuals).reshape(-1)
        to_state = self.view.slopes(unknowns)
        by_place = self.seen.whitening @ self.seen.residual_slopes(places)
        by_unknown = (by_place @ slopes).reshape(-1, 6) @ to_state
        for more, more_slopes in self._beliefs(*self.view.state(unknowns)):
            value = np.concatenate([value, more])
            by_unknown = np.concatenate([by_unknown, more_slopes @ to_state])
        self._last = _Rows(
            unknowns=unknowns,
            deviation=self.deviation,
            residuals_arcsec=residuals,
            value=value,
            slopes=by_unknown,
        )
        return self._last

    def _beliefs(self, r: FloatArray, v: FloatArray) -> Iterator[tuple[FloatArray, FloatArray]]:
        """Yield the prior's rows (n,) and their slopes (n, 6) by the state."""
        if self.prior.sigma_e is not None:
            e, slopes = eccentricity_vector(r, v)
            sigma = self.prior.sigma_e / np.sqrt(2.0)
            yield e / sigma, slopes / sigma
        if self.prior.a_km is not None:
            a_km, slope = semi_major_axis(r, v)
            off = (a_km - self.prior.a_km) / self.prior.sigma_a_km
            yield np.array([off]), slope[None] / self.prior.sigma_a_km

    def places(self, unknowns: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Places (N, 3) when the light left, and their slopes (N, 3, 6) by the state."""
        r, v = self.view.state(unknowns)
        places, velocities, slopes = propagate_with_slopes(r, v, self.seen.t_s)
        if self.deviation is not None:
            places, velocities = places + self.deviation[0], velocities + self.deviation[1]
        # Back along the way by the light's time: the bend of the orbit in it is a millimetre.
        tau_s = self.seen.light_times_s(places)
        tau_s = self.seen.light_times_s(places - velocities * tau_s[:, None])
        return places - velocities * tau_s[:, None], slopes

    def deviate(self, motion: Propagator, unknowns: FloatArray) -> float:
        """Compute the deviation at these unknowns; return by how many arcsec it was wrong."""
        r, v = self.view.state(unknowns)
        true = motion.states(r, v, self.seen.t_s)
        plain = propagate(r, v, self.seen.t_s)
        before = self.deviation
        self.deviation = (true[0] - plain[0], true[1] - plain[1])
        if before is None:
            return float("inf")
        off = np.linalg.norm(self.deviation[0] - before[0], axis=-1)
        away = np.linalg.norm(true[0] - self.seen.sites_km, axis=-1)
        return float(np.max(off / away)) / ARCSEC_RAD

    def staleness_arcsec(self, step: FloatArray, log_range: float) -> float:
        """Error of a deviation that is kept over a step, in order of magnitude, arcsec."""
        if self.deviation is None:
            return 0.0
        span_s = float(np.max(np.abs(self.seen.t_s)))
        moved = float(np.max(np.abs(step) * np.array([1, 1, span_s, span_s, 1, span_s])))
        size = float(np.max(np.abs(self.deviation[0])))
        return moved * size / float(np.exp(log_range)) / ARCSEC_RAD


def fit_orbit(
    seen: MeasuredDirections,
    start: State,
    *,
    prior: Prior | None = None,
    motion: Propagator | None = None,
) -> OrbitFit:
    """Fit an orbit to all directions, starting from ``start``, a state at their epoch.

    ``motion`` propagates the object; None: two-body motion. Directions that fit no orbit are left
    out as outliers, at most a third of them.
    """
    problem = _problem(seen, start, prior or Prior())
    unknowns = problem.view.unknowns(start)
    with np.errstate(all="ignore"):
        if motion is None:
            unknowns, is_converged = _descend(problem, unknowns)
        else:
            unknowns, is_converged = _descend_with(problem, motion, unknowns)
        return _finished(problem, unknowns, is_converged)


def formal_covariances(
    seen: MeasuredDirections, state: State, prior: Prior
) -> tuple[FloatArray, FloatArray]:
    """Return the covariances (6, 6) of a fit at ``state``, with and without the prior.

    Nothing is fitted: the problem is linearised at ``state``.
    """
    problem = _problem(seen, state, prior)
    unknowns = problem.view.unknowns(state)
    with np.errstate(all="ignore"):
        _, slopes = problem.rows(unknowns)
        to_state = problem.view.slopes(unknowns)
        alone = slopes[: 2 * len(seen)]
        both = (
            to_state @ inverse_normal_matrix(each.T @ each) @ to_state.T for each in (slopes, alone)
        )
        constrained, free = both
    return constrained, free


def _problem(seen: MeasuredDirections, start: State, prior: Prior) -> _Problem:
    nearest = int(np.argmin(np.abs(seen.t_s)))
    site_km = seen.sites_km[nearest] - seen.sites_km_s[nearest] * seen.t_s[nearest]
    view = LineOfSight.through(start, site_km, seen.sites_km_s[nearest])
    return _Problem(seen=seen, prior=prior, view=view)


def _descend_with(
    problem: _Problem, motion: Propagator, unknowns: FloatArray
) -> tuple[FloatArray, bool]:
    """Descend, computing the forces' deviation again until it no longer changes."""
    stale_arcsec = _STALE * float(np.median(1.0 / np.abs(problem.seen.whitening[:, 0, 0])))
    is_converged = False
    for _ in range(_MAX_DEVIATIONS):
        was_off = problem.deviate(motion, unknowns)
        if is_converged and was_off < stale_arcsec:
            return unknowns, True
        before = unknowns
        unknowns, is_converged = _descend(problem, unknowns)
        may_be_off = problem.staleness_arcsec(unknowns - before, float(unknowns[4]))
        if is_converged and may_be_off < stale_arcsec:
            return unknowns, True
        if not np.isfinite(may_be_off):
            break
    return unknowns, False


def _descend(problem: _Problem, unknowns: FloatArray) -> tuple[FloatArray, bool]:
    """Descend by Levenberg and Marquardt, with Huber's weights."""
    damping = 1e-3
    value, slopes = problem.rows(unknowns)
    cost = _cost(problem, value)
    for _ in range(_MAX_STEPS):
        weights = _weights(problem, value)
        normal = slopes.T @ (weights[:, None] * slopes)
        gradient = slopes.T @ (weights * value)
        scale = np.maximum(np.diag(normal), 1e-300)
        for _ in range(_MAX_DAMPINGS):
            try:
                step = -np.linalg.solve(normal + damping * np.diag(scale), gradient)
            except _NO_NUMBERS:
                return unknowns, False
            # Never more than a factor of e in range at once.
            step = step * min(1.0, 1.0 / max(abs(float(step[4])), 1e-300))
            trial_value, trial_slopes = problem.rows(unknowns + step)
            trial_cost = _cost(problem, trial_value)
            if trial_cost <= cost:
                break
            damping = max(damping * 10.0, 1e-9)
        else:
            return unknowns, bool(np.isfinite(cost))
        gain = cost - trial_cost
        unknowns, value, slopes, cost = unknowns + step, trial_value, trial_slopes, trial_cost
        damping = damping / 10.0 if damping > 1e-14 else 0.0
        if gain < 1e-7 * (1.0 + cost):
            return unknowns, True
    return unknowns, False


def _squares(problem: _Problem, value: FloatArray) -> FloatArray:
    """Squared residuals (N,) in units of variance."""
    return np.asarray(np.sum(value[: 2 * len(problem.seen)].reshape(-1, 2) ** 2, axis=-1))


def _cost(problem: _Problem, value: FloatArray) -> float:
    """Huber's cost: quadratic near, linear far; a prior always quadratic."""
    size = np.sqrt(_squares(problem, value))
    far = size > _HUBER
    loss = np.where(far, 2.0 * _HUBER * size - _HUBER**2, size**2)
    total = float(np.sum(loss) + np.sum(value[2 * len(problem.seen) :] ** 2))
    return total if np.isfinite(total) else float("inf")


def _weights(problem: _Problem, value: FloatArray) -> FloatArray:
    size = np.sqrt(_squares(problem, value))
    each = np.minimum(1.0, _HUBER / np.maximum(size, 1e-12))
    return np.concatenate([np.repeat(each, 2), np.ones(len(value) - 2 * len(size))])


def _finished(problem: _Problem, unknowns: FloatArray, is_converged: bool) -> OrbitFit:
    """Final fit: outliers left out, last steps without them, and the covariance that belongs to
    it.
    """
    value, slopes = problem.rows(unknowns)
    is_used = _used(_squares(problem, value))
    for _ in range(5):
        keep = _kept(value, is_used)
        step = _step(slopes[keep], value[keep])
        if step is None or abs(step[4]) > 0.5:
            break
        new_value, new_slopes = problem.rows(unknowns + step)
        old_cost = float(np.sum(value[keep] ** 2))
        gain = old_cost - float(np.sum(new_value[keep] ** 2))
        if not gain >= -1e-9 * old_cost:
            break
        unknowns, value, slopes = unknowns + step, new_value, new_slopes
        used_before, is_used = is_used, _used(_squares(problem, value))
        if gain < 1e-6 * (1.0 + old_cost) and np.array_equal(used_before, is_used):
            break
    keep = _kept(value, is_used)
    to_state = problem.view.slopes(unknowns)
    squares = _squares(problem, value)
    r, v = problem.view.state(unknowns)
    prior_chi2 = float(np.sum(value[2 * len(is_used) :] ** 2))
    covariance = to_state @ inverse_normal_matrix(slopes[keep].T @ slopes[keep]) @ to_state.T
    return OrbitFit(
        r_km=r,
        v_km_s=v,
        covariance=covariance,
        residuals_arcsec=problem.residuals_arcsec(unknowns),
        is_used=is_used,
        cost=float(np.sum(np.minimum(squares, _OUTLIER))) + prior_chi2,
        chi2=float(np.sum(squares[is_used])),
        prior_chi2=prior_chi2,
        degrees_of_freedom=2 * int(np.sum(is_used)) - 6,
        is_converged=is_converged
        and bool(np.all(np.isfinite(unknowns)) and np.all(np.isfinite(covariance))),
    )


def _kept(value: FloatArray, is_used: BoolArray) -> BoolArray:
    """True for the rows that count: both of a used direction, and the prior's."""
    return np.concatenate([np.repeat(is_used, 2), np.ones(len(value) - 2 * len(is_used), bool)])


def _step(slopes: FloatArray, value: FloatArray) -> FloatArray | None:
    try:
        step = -np.linalg.solve(slopes.T @ slopes, slopes.T @ value)
    except _NO_NUMBERS:
        return None
    return np.asarray(step, float) if np.all(np.isfinite(step)) else None


def _used(squares: FloatArray) -> BoolArray:
    """True for directions that are no outliers; the worst third at most is left out. Where most
    scatter more than their sigmas allow, the sigmas are wrong.
    """
    scatter = max(1.0, float(np.median(squares)) / _MEDIAN_SQUARE)
    bound = max(_OUTLIER * scatter, float(np.quantile(squares, 2.0 / 3.0)))
    return np.asarray(squares <= bound)


def inverse_normal_matrix(normal: FloatArray) -> FloatArray:
    """Inverse of a normal matrix, scaled first.

    Undetermined unknowns get huge variances instead of an error.
    """
    if not np.all(np.isfinite(normal)):
        return np.full_like(normal, np.nan)
    scale = 1.0 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
    values, vectors = np.linalg.eigh(normal * np.outer(scale, scale))
    values = np.maximum(values, 1e-15)
    return np.asarray(scale[:, None] * (vectors / values) @ vectors.T * scale)
