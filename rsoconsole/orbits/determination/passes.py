"""Directions taken in several passes: which are one, and ways from one to another. Pure."""

import numpy as np

from rsoconsole.orbits.first import Sightings, State, is_plausible
from rsoconsole.orbits.motion import propagate_with_slopes
from rsoconsole.records import FloatArray
from rsoconsole.sky import IntArray

GAP_S = 1800.0
"""A pause so long ends a pass."""
_SURE = 0.02
"""Sigma of a place over its distance from the Earth's centre: so sure, no turn is miscounted."""
_STEP = 0.3
"""Between two starts, of the distance from the Earth's centre, where they lead."""
_MOST_STEPS = 20
_SIGMAS = 3.0


def passes(seen: Sightings) -> tuple[IntArray, ...]:
    """Indices of each pass: the longest first, then by nearness to it in time."""
    ends = np.flatnonzero(np.diff(seen.t_s) > GAP_S) + 1
    groups = [np.asarray(each, np.int64) for each in np.split(np.arange(len(seen)), ends)]
    first = max(groups, key=lambda each: (len(each) >= 3, _span_s(seen, each), len(each)))
    middle = float(np.mean(seen.t_s[first]))
    return tuple(
        sorted(groups, key=lambda each: (each is not first, abs(seen.t_s[each[0]] - middle)))
    )


def is_as_predicted(state: State, covariance: FloatArray, later: Sightings) -> bool:
    """Whether an orbit puts the object near its way through another pass."""
    distance, _, sigma_km = _weakest(state, covariance, later)
    return sigma_km < _SURE * distance


def starts_towards(state: State, covariance: FloatArray, later: Sightings) -> tuple[State, ...]:
    """States at the epoch along the line on which an orbit is least known, three sigma either way.

    Enough that one of them is near the truth whatever the number of revolutions up to the other
    pass. Source: line of variations, Milani et al. 2005, Astronomy & Astrophysics 431, 729.
    """
    distance, step, sigma_km = _weakest(state, covariance, later)
    if not np.isfinite(sigma_km):
        return (state,)
    count = int(min(np.ceil(_SIGMAS * sigma_km / (_STEP * distance)), _MOST_STEPS))
    shares = np.linspace(-_SIGMAS, _SIGMAS, 2 * count + 1)
    states = [(state[0] + share * step[:3], state[1] + share * step[3:]) for share in shares]
    return tuple(each for each in states if is_plausible(*each))


def _weakest(
    state: State, covariance: FloatArray, later: Sightings
) -> tuple[float, FloatArray, float]:
    """Distance (km) at the other pass, the state's step (6,) to one sigma there, and that (km)."""
    with np.errstate(all="ignore"):
        r, _, slopes = propagate_with_slopes(*state, later.t_s[:1])
        spread = slopes[0] @ covariance @ slopes[0].T
    if not np.all(np.isfinite(spread)):
        return float("nan"), np.zeros(6), float("inf")
    values, vectors = np.linalg.eigh(spread)
    sigma_km = float(np.sqrt(max(values[-1], 1e-12)))
    step = covariance @ slopes[0].T @ vectors[:, -1] / sigma_km
    return float(np.linalg.norm(r)), step, sigma_km


def _span_s(seen: Sightings, chosen: IntArray) -> float:
    return float(seen.t_s[chosen[-1]] - seen.t_s[chosen[0]])
