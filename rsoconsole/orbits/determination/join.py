"""Joining of tracklets: one orbit for all of them, compared with one orbit for each. Pure.

The result is a ratio of evidences (MacKay 2003, Information Theory, Inference, and Learning
Algorithms, 28): that of one orbit for the directions of both tracklets, over that of two orbits
drawn from the population (``population``). An evidence weighs how well an orbit explains the
directions against how uncertain they leave it. Unmodelled forces and errors of star positions shift
whole tracklets: each has an unknown offset, which is solved for and integrated out.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from rsoconsole.orbits.determination.from_directions import determine_orbit
from rsoconsole.orbits.determination.regimes import PriorName
from rsoconsole.orbits.first.directions import MeasuredDirections, State
from rsoconsole.orbits.first.population import Population, log_prior_density, population_of
from rsoconsole.orbits.motion.forces import PerturbedPropagator
from rsoconsole.orbits.motion.two_body import MU_EARTH_KM3_S2, propagate
from rsoconsole.records import FloatArray
from rsoconsole.words import NS_PER_S

STARS_ARCSEC = 0.3
"""One sigma of the error that plate solutions give to all directions of a tracklet alike."""
FORCES_ARCSEC_A_DAY = 4.0
"""Error of unmodelled forces, arcsec a day: 2.4 from a geostationary satellite's area to mass."""
_STEPS = 8
_SETTLED = 1e-3
_STEP = np.array([1e-1, 1e-1, 1e-1, 1e-5, 1e-5, 1e-5])
"""Steps of the state for numerical slopes: km and km/s."""
_HOPELESS = 2000.0
"""Excess of the sum of squares from which on no further step is worth its time."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrackletOrbit:
    """Orbit fitted to one tracklet by itself, with its evidence."""

    seen: MeasuredDirections
    state: State
    """State at the epoch of ``seen``, the directions of the tracklet."""
    population: Population
    log_evidence: float
    chi2: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JointOrbit:
    """One orbit fitted to several tracklets, with its evidence."""

    state: State
    covariance: FloatArray
    """Covariance (6, 6), km and km/s; it includes the common errors of whole tracklets."""
    epoch_utc_ns: int
    log_evidence: float
    chi2: float


def tracklet_orbit(seen: MeasuredDirections, prior: PriorName = "auto") -> TrackletOrbit | None:
    """Fit an orbit to one tracklet by itself; None where no orbit passes through it."""
    orbit = determine_orbit(seen, prior=prior)
    if orbit is None:
        return None
    population = population_of(orbit.r_km, orbit.v_km_s, orbit.prior)
    found = joint_orbit((seen,), (orbit.r_km, orbit.v_km_s), seen.epoch_utc_ns, population)
    return (
        None
        if found is None
        else TrackletOrbit(
            seen=seen,
            state=found.state,
            population=population,
            log_evidence=found.log_evidence,
            chi2=found.chi2,
        )
    )


def log_odds_same_object(first: TrackletOrbit, second: TrackletOrbit) -> float:
    """Logarithm of the odds that two tracklets are of one object.

    Minus infinity where no orbit fits both. The search for such an orbit starts from that of the
    longer tracklet.
    """
    longer, shorter = sorted((first, second), key=lambda each: _span_s(each.seen), reverse=True)
    both = joint_orbit(
        (longer.seen, shorter.seen),
        longer.state,
        longer.seen.epoch_utc_ns,
        longer.population,
        worst_chi2=first.chi2 + second.chi2 + _HOPELESS,
    )
    return _log_odds(first.population, both, first.log_evidence, second)


def log_odds_of_joining(
    start: TrackletOrbit, used: Sequence[MeasuredDirections], more: TrackletOrbit
) -> float:
    """Return the log odds that the tracklet ``more`` is of the same object as others.

    ``start``, ``used``: the others, a first tracklet and those joined to it. Minus infinity where
    no orbit fits.
    """
    if not used:
        return log_odds_same_object(start, more)
    parts = (start.seen, *used)
    epoch = start.seen.epoch_utc_ns
    before = joint_orbit(parts, start.state, epoch, start.population)
    if before is None:
        return -float("inf")
    both = joint_orbit(
        (*parts, more.seen),
        before.state,
        before.epoch_utc_ns,
        start.population,
        worst_chi2=before.chi2 + more.chi2 + _HOPELESS,
    )
    return _log_odds(start.population, both, before.log_evidence, more)


def _log_odds(
    population: Population, both: JointOrbit | None, log_evidence: float, more: TrackletOrbit
) -> float:
    if both is None:
        return -float("inf")
    ratio = both.log_evidence - log_evidence - more.log_evidence
    return ratio - float(np.log(population.objects))


def probability_from_log_odds(log_odds: float) -> float:
    """Convert the log odds that tracklets are of one object to a probability; 0 for NaN."""
    from scipy.special import expit

    return float(np.nan_to_num(expit(log_odds)))


def merged_tracklets(parts: Sequence[MeasuredDirections]) -> tuple[MeasuredDirections, FloatArray]:
    """Return all directions in order of time, and the index (N,) of each one's tracklet."""
    which = np.concatenate([np.full(len(each), n) for n, each in enumerate(parts)])
    t = np.concatenate([each.t_utc_ns for each in parts])
    order = np.argsort(t, kind="stable")
    t = t[order]
    epoch = int(t[np.argmin(np.abs(t - t[0] - (t[-1] - t[0]) // 2))])
    arrays = {
        each.name: np.concatenate([getattr(part, each.name) for part in parts])[order]
        for each in fields(MeasuredDirections)
        if each.name not in {"epoch_utc_ns", "t_utc_ns", "t_s"}
    }
    whole = replace(parts[0], t_utc_ns=t, t_s=(t - epoch) / NS_PER_S, epoch_utc_ns=epoch, **arrays)
    return whole, which[order]


def common_error_arcsec(seen: MeasuredDirections) -> float:
    """One sigma of the error common to all directions of a tracklet.

    It grows with the tracklet's time span.
    """
    return float(np.hypot(STARS_ARCSEC, FORCES_ARCSEC_A_DAY * _span_s(seen) / 86_400.0))


def _span_s(seen: MeasuredDirections) -> float:
    return float(seen.t_s[-1] - seen.t_s[0])


def joint_orbit(
    parts: Sequence[MeasuredDirections],
    start: State,
    epoch_utc_ns: int,
    population: Population,
    worst_chi2: float = float("inf"),
) -> JointOrbit | None:
    """Fit one orbit to all tracklets by least squares, and compute its evidence.

    ``start``: initial state, at ``epoch_utc_ns``. ``population``: prior distribution of orbits, for
    the evidence; the fit uses its eccentricity. None where the fit fails or leaves a chi-square
    above
    ``worst_chi2``.
    """
    seen, which = merged_tracklets(parts)
    forces = PerturbedPropagator(epoch_utc_ns=seen.epoch_utc_ns)
    state = np.concatenate(propagated_state(start, epoch_utc_ns, seen.epoch_utc_ns))
    offset_arcsec = common_error_arcsec(seen)
    last = float("inf")
    for step in range(_STEPS):
        values, rows = _rows(seen, which, forces, state, population.sigma_e)
        if not np.all(np.isfinite(values)):
            return None
        values = np.concatenate([values, np.zeros(2 * len(parts))])
        rows = np.concatenate([rows, np.eye(rows.shape[1])[6:] / offset_arcsec])
        scale = 1.0 / np.linalg.norm(rows, axis=0)
        scaled = rows * scale
        solved, *_ = np.linalg.lstsq(scaled, -values, rcond=None)
        chi2 = float(np.sum((values + scaled @ solved) ** 2))
        if step and chi2 > worst_chi2:
            return None
        state = state + (scale * solved)[:6]
        if abs(chi2 - last) < _SETTLED * (1.0 + chi2):
            break
        last = chi2
    normal = scaled.T @ scaled
    sign, log_size = np.linalg.slogdet(normal)
    if sign <= 0.0:
        return None
    covariance = np.linalg.inv(normal)[:6, :6] * np.outer(scale[:6], scale[:6])
    # The offsets' own 2 pi go with those of their prior.
    log_volume = 3.0 * np.log(2.0 * np.pi) - log_size / 2.0 + np.sum(np.log(scale))
    log_volume -= 2.0 * len(parts) * np.log(offset_arcsec)
    log_prior = log_prior_density(population, state, covariance)
    return JointOrbit(
        state=(state[:3], state[3:]),
        covariance=covariance,
        epoch_utc_ns=seen.epoch_utc_ns,
        log_evidence=float(-chi2 / 2.0 + log_volume + log_prior),
        chi2=chi2,
    )


def propagated_state(start: State, from_utc_ns: int, to_utc_ns: int) -> State:
    """Propagate a state from one instant to another, with all modelled forces."""
    since_s = np.array([(to_utc_ns - from_utc_ns) / NS_PER_S])
    r, v = PerturbedPropagator(epoch_utc_ns=from_utc_ns).states(*start, since_s)
    return r[0], v[0]


def _rows(
    seen: MeasuredDirections,
    which: FloatArray,
    forces: PerturbedPropagator,
    state: FloatArray,
    sigma_e: float,
) -> tuple[FloatArray, FloatArray]:
    """Whitened residuals with the belief in a small eccentricity, and their slopes.

    By the state at the epoch and by an offset of each part, east and north in arcsec.
    """
    parts = int(which.max()) + 1
    around = state + np.concatenate([np.diag(_STEP), -np.diag(_STEP)])
    r, v = around[:, None, :3], around[:, None, 3:]
    at = seen.t_s - seen.light_times_s(propagate(state[:3], state[3:], seen.t_s)[0])
    true, _ = forces.states(state[:3], state[3:], at)
    places = propagate(r, v, at)[0]
    value = seen.whitened(seen.residuals_arcsec(true)).reshape(-1)
    white = seen.whitened(seen.residuals_arcsec(places)).reshape(12, -1)
    slopes = (white[:6] - white[6:]).T / (2.0 * _STEP)
    shifts = np.zeros((len(seen), 2, 2 * parts))
    for part in range(parts):
        shifts[which == part, :, 2 * part : 2 * part + 2] = -seen.whitening[which == part]
    slopes = np.concatenate([slopes, shifts.reshape(-1, 2 * parts)], axis=1)
    belief = _eccentricity(np.concatenate([state[None], around])) / sigma_e
    by_state = (belief[1:7] - belief[7:]).T / (2.0 * _STEP)
    by_state = np.concatenate([by_state, np.zeros((3, 2 * parts))], axis=1)
    return np.concatenate([value, belief[0]]), np.concatenate([slopes, by_state])


def _eccentricity(states: FloatArray) -> FloatArray:
    """Eccentricity vectors (K, 3), towards perigee."""
    r, v = states[:, :3], states[:, 3:]
    radius = np.linalg.norm(r, axis=-1, keepdims=True)
    speed_2 = np.sum(v * v, axis=-1, keepdims=True)
    along = np.sum(r * v, axis=-1, keepdims=True)
    mu = MU_EARTH_KM3_S2
    return np.asarray(((speed_2 - mu / radius) * r - along * v) / mu)
