"""An orbit fitted to all directions: least squares with a stated prior. Pure.

The unknowns are what a telescope sees: direction, its rates, the logarithm of the range and the
range's relative rate at the epoch. Short arcs give the first four sharply and the last two hardly, so
the problem is well scaled whatever the arc, and the range stays positive. Source of the method:
Tapley, Schutz & Born 2004, Statistical Orbit Determination, 4; Levenberg's damping; Huber's weights
against outliers; partial derivatives by differences of the two-body motion.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rsoconsole.orbit.seeds import State
from rsoconsole.orbit.sightings import Sightings
from rsoconsole.orbit.two_body import MU_EARTH_KM3_S2, propagate
from rsoconsole.records import FloatArray

_MOST_STEPS = 40
_DIFFERENCE = np.array([1e-7, 1e-7, 1e-10, 1e-10, 1e-5, 1e-8])
"""For the slopes: rad, rad/s, of the range's logarithm, 1/s."""
_HUBER = 2.0
_OUTLIER = 16.0
"""A squared residual in units of its variance from which on a direction is left out."""

Motion = Callable[[FloatArray, FloatArray, FloatArray], FloatArray]
"""Positions (N, 3) at times (N,) since the epoch of a state (3,), (3,) at the epoch."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Prior:
    """What is believed of the orbit before it is seen."""

    sigma_e: float | None = None
    """Of each component of the eccentricity vector about 0; None: nothing is believed."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fit:
    """The orbit that fits best, at the epoch of its sightings."""

    r_km: FloatArray
    """(3,) GCRS"""
    v_km_s: FloatArray
    covariance: FloatArray
    """(6, 6) km and km/s"""
    residuals_arcsec: FloatArray
    """(N, 2) measured minus predicted on the sky, also of those left out."""
    is_used: FloatArray
    """(N,) bool: False for outliers."""
    cost: float
    """Sum of squares in units of variance, prior included, each outlier counted at its bound."""
    chi2: float
    """Of the used directions alone."""
    degrees_of_freedom: int
    is_converged: bool


@dataclass(slots=True, kw_only=True, eq=False)
class _Problem:
    """What stays the same from step to step."""

    seen: Sightings
    prior: Prior
    mu: float
    motion: Motion | None
    towards: FloatArray
    east: FloatArray
    north: FloatArray
    site_km: FloatArray
    site_km_s: FloatArray

    def states(self, unknowns: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Positions and velocities (..., 3) of unknowns (..., 6)."""
        e, n, e_rate, n_rate, log_range, range_rate = (unknowns[..., i, None] for i in range(6))
        line = self.towards + e * self.east + n * self.north
        line = line / np.sqrt(np.sum(line * line, axis=-1, keepdims=True))
        distance = np.exp(log_range)
        r = self.site_km + distance * line
        turn = e_rate * self.east + n_rate * self.north
        v = self.site_km_s + distance * (range_rate * line + turn)
        return r, v

    def rows(self, unknowns: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Whitened residuals (2N + prior rows,) and their slopes (rows, 6)."""
        around = unknowns + np.concatenate(
            [np.zeros((1, 6)), np.diag(_DIFFERENCE), -np.diag(_DIFFERENCE)]
        )
        r, v = self.states(around)
        t = self.seen.t_s
        first = propagate(r[0], v[0], t, self.mu)[0]
        at = t - self.seen.light_times_s(first)
        places = propagate(r[:, None], v[:, None], at, self.mu)[0]
        true = places[0] if self.motion is None else self.motion(r[0], v[0], at)
        white = self.seen.whitened(self.seen.residuals_arcsec(places)).reshape(13, -1)
        value = self.seen.whitened(self.seen.residuals_arcsec(true)).reshape(-1)
        slopes = (white[1:7] - white[7:]).T / (2.0 * _DIFFERENCE)
        if self.prior.sigma_e is not None:
            e_vector = _eccentricity_vector(r, v, self.mu) / self.prior.sigma_e
            value = np.concatenate([value, e_vector[0]])
            slopes = np.concatenate(
                [slopes, (e_vector[1:7] - e_vector[7:]).T / (2.0 * _DIFFERENCE)]
            )
        return value, slopes


def fit(
    seen: Sightings,
    start: State,
    *,
    prior: Prior | None = None,
    mu: float = MU_EARTH_KM3_S2,
    motion: Motion | None = None,
) -> Fit:
    """The orbit near ``start`` (a state at the epoch) that fits all directions best.

    ``motion`` other than about a point mass moves the object; slopes are those of the point mass
    all the same. Directions that fit with no orbit are left out, never more than a third.
    """
    problem = _problem(seen, start, prior or Prior(), mu, motion)
    unknowns = _unknowns(problem, start)
    with np.errstate(all="ignore"):
        unknowns, is_converged = _descend(problem, unknowns)
        return _finished(problem, unknowns, is_converged)


def _problem(
    seen: Sightings, start: State, prior: Prior, mu: float, motion: Motion | None
) -> _Problem:
    nearest = int(np.argmin(np.abs(seen.t_s)))
    site_km = seen.sites_km[nearest] - seen.sites_km_s[nearest] * seen.t_s[nearest]
    towards = start[0] - site_km
    towards = towards / np.linalg.norm(towards)
    east = np.cross([0.0, 0.0, 1.0], towards)
    east = east / np.linalg.norm(east)
    return _Problem(
        seen=seen,
        prior=prior,
        mu=mu,
        motion=motion,
        towards=towards,
        east=east,
        north=np.cross(towards, east),
        site_km=site_km,
        site_km_s=seen.sites_km_s[nearest],
    )


def _unknowns(problem: _Problem, state: State) -> FloatArray:
    """The same state as unknowns."""
    u = state[0] - problem.site_km
    distance = float(np.linalg.norm(u))
    relative = (state[1] - problem.site_km_s) / distance
    return np.array(
        [
            *(0.0, 0.0, relative @ problem.east, relative @ problem.north),
            *(np.log(distance), relative @ problem.towards),
        ]
    )


def _descend(problem: _Problem, unknowns: FloatArray) -> tuple[FloatArray, bool]:
    """Levenberg and Marquardt with Huber's weights."""
    damping = 1e-3
    value, slopes = problem.rows(unknowns)
    cost = _cost(problem, value)
    for _ in range(_MOST_STEPS):
        weights = _weights(problem, value)
        normal = slopes.T @ (weights[:, None] * slopes)
        gradient = slopes.T @ (weights * value)
        scale = np.maximum(np.diag(normal), 1e-300)
        for _ in range(8):
            try:
                step = -np.linalg.solve(normal + damping * np.diag(scale), gradient)
            except np.linalg.LinAlgError:
                return unknowns, False
            # Never more than a factor of e in range at once.
            step = step * min(1.0, 1.0 / max(abs(float(step[4])), 1e-300))
            tried_value, tried_slopes = problem.rows(unknowns + step)
            tried_cost = _cost(problem, tried_value)
            if tried_cost <= cost:
                break
            damping = max(damping * 10.0, 1e-9)
        else:
            return unknowns, True
        gain = cost - tried_cost
        unknowns, value, slopes, cost = unknowns + step, tried_value, tried_slopes, tried_cost
        damping = damping / 10.0 if damping > 1e-14 else 0.0
        if gain < 1e-7 * (1.0 + cost):
            return unknowns, True
    return unknowns, False


def _squares(problem: _Problem, value: FloatArray) -> FloatArray:
    """(N,) squared residuals in units of variance."""
    return np.asarray(np.sum(value[: 2 * len(problem.seen)].reshape(-1, 2) ** 2, axis=-1))


def _cost(problem: _Problem, value: FloatArray) -> float:
    """Huber's: quadratic near, linear far; a prior always quadratic."""
    size = np.sqrt(_squares(problem, value))
    far = size > _HUBER
    loss = np.where(far, 2.0 * _HUBER * size - _HUBER**2, size**2)
    total = float(np.sum(loss) + np.sum(value[2 * len(problem.seen) :] ** 2))
    return total if np.isfinite(total) else float("inf")


def _weights(problem: _Problem, value: FloatArray) -> FloatArray:
    size = np.sqrt(_squares(problem, value))
    each = np.minimum(1.0, _HUBER / np.maximum(size, 1e-12))
    return np.concatenate([np.repeat(each, 2), np.ones(len(value) - 2 * len(size))])


def _finished(problem: _Problem, unknowns: FloatArray, is_converged: bool) -> Fit:
    """Outliers out, a last step without them, and the covariance that belongs to it."""
    value, slopes = problem.rows(unknowns)
    is_used = _used(_squares(problem, value))
    for _ in range(3):
        keep = np.concatenate([np.repeat(is_used, 2), np.ones(len(value) - 2 * len(is_used), bool)])
        normal = slopes[keep].T @ slopes[keep]
        try:
            step = -np.linalg.solve(normal, slopes[keep].T @ value[keep])
        except np.linalg.LinAlgError:
            break
        if not np.all(np.isfinite(step)) or abs(step[4]) > 0.5:
            break
        new_value, new_slopes = problem.rows(unknowns + step)
        if not float(np.sum(new_value[keep] ** 2)) <= float(np.sum(value[keep] ** 2)) * (1 + 1e-9):
            break
        unknowns, value, slopes = unknowns + step, new_value, new_slopes
        is_used = _used(_squares(problem, value))
    keep = np.concatenate([np.repeat(is_used, 2), np.ones(len(value) - 2 * len(is_used), bool)])
    covariance = _inverse(slopes[keep].T @ slopes[keep])
    to_state = _state_slopes(problem, unknowns)
    squares = _squares(problem, value)
    r, v = problem.states(unknowns)
    at = problem.seen.t_s - problem.seen.light_times_s(
        propagate(r, v, problem.seen.t_s, problem.mu)[0]
    )
    places = (
        propagate(r, v, at, problem.mu)[0] if problem.motion is None else problem.motion(r, v, at)
    )
    return Fit(
        r_km=r,
        v_km_s=v,
        covariance=to_state @ covariance @ to_state.T,
        residuals_arcsec=problem.seen.residuals_arcsec(places),
        is_used=is_used,
        cost=float(np.sum(np.minimum(squares, _OUTLIER)) + np.sum(value[2 * len(is_used) :] ** 2)),
        chi2=float(np.sum(squares[is_used])),
        degrees_of_freedom=2 * int(np.sum(is_used)) - 6,
        is_converged=is_converged and bool(np.all(np.isfinite(unknowns))),
    )


def _used(squares: FloatArray) -> FloatArray:
    """Which directions are no outliers; the worst third at most is."""
    bound = max(_OUTLIER, float(np.quantile(squares, 2.0 / 3.0)))
    return np.asarray(squares <= bound)


def _inverse(normal: FloatArray) -> FloatArray:
    """Of a normal matrix, scaled first; what is not determined comes out huge, not negative."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
    values, vectors = np.linalg.eigh(normal * np.outer(scale, scale))
    values = np.maximum(values, 1e-15)
    return np.asarray(scale[:, None] * (vectors / values) @ vectors.T * scale)


def _state_slopes(problem: _Problem, unknowns: FloatArray) -> FloatArray:
    """(6, 6): position and velocity by the unknowns."""
    around = unknowns + np.concatenate([np.diag(_DIFFERENCE), -np.diag(_DIFFERENCE)])
    states = np.concatenate(problem.states(around), axis=-1)
    return np.asarray((states[:6] - states[6:]).T / (2.0 * _DIFFERENCE))


def _eccentricity_vector(r: FloatArray, v: FloatArray, mu: float) -> FloatArray:
    radius = np.sqrt(np.sum(r * r, axis=-1, keepdims=True))
    speed_2 = np.sum(v * v, axis=-1, keepdims=True)
    along = np.sum(r * v, axis=-1, keepdims=True)
    return np.asarray(((speed_2 - mu / radius) * r - along * v) / mu)
