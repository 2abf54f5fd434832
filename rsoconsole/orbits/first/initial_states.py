"""Where a fit may begin: orbits through three of many directions, and circles through two. Pure."""

from collections.abc import Iterator

import numpy as np

from rsoconsole.orbits.first.directions import Sightings
from rsoconsole.orbits.first.gooding_iteration import GoodingOrbit, Lines, gooding
from rsoconsole.orbits.motion import MU_EARTH_KM3_S2, propagate
from rsoconsole.records import FloatArray
from rsoconsole.sky import LIGHT_KM_S

State = tuple[FloatArray, FloatArray]
"""Position (3,) km and velocity (3,) km/s at the epoch, along ICRS axes."""
LOWEST_KM = 6_478.0
"""No orbit that lasts comes nearer to the Earth's centre."""
_RADII_KM = np.geomspace(6_500.0, 400_000.0, 160)


INWARD = (0.0, 0.1, 0.2)
"""Shares of the directions to leave out at either end: a wild one spoils what it takes part in."""


def seeds(seen: Sightings, inward: float = 0.0) -> tuple[State, ...]:
    """Plausible starts at the epoch: Gooding's orbits first, then circles.

    ``inward``: the share of the directions that is passed over at either end (`INWARD`).
    """
    return (*_by_gooding(seen, inward), *_circles(seen, inward))


def three_lines(seen: Sightings, inward: float = 0.0) -> Lines:
    """Lines of sight far apart, at the time of the light; of the middle ones another each time."""
    first, last = _ends(seen, inward)
    span_s = seen.t_s[last] - seen.t_s[first]
    middle = int(np.argmin(np.abs(seen.t_s - seen.t_s[first] - (0.5 + inward / 2.0) * span_s)))
    chosen = [first, min(max(middle, first + 1), last - 1), last]
    return Lines(
        t_s=seen.t_s[chosen], sites_km=seen.sites_km[chosen], directions=seen.lines[chosen]
    )


def _ends(seen: Sightings, inward: float) -> tuple[int, int]:
    """The first and the last that count, with one at least between them if there is any."""
    left_out = min(int(inward * len(seen)), max(len(seen) - 3, 0) // 2)
    return left_out, len(seen) - 1 - left_out


def at_epoch(orbit: GoodingOrbit, lines: Lines) -> State:
    """Of an orbit through three lines its state at the epoch of their times."""
    # The light of the middle line left so much earlier.
    since = -lines.t_s[1] + orbit.ranges_km[1] / LIGHT_KM_S
    return propagate(orbit.r_km, orbit.v_km_s, since)


def _by_gooding(seen: Sightings, inward: float) -> Iterator[State]:
    if len(seen) < 3:
        return
    lines = three_lines(seen, inward)
    if len(np.unique(lines.t_s)) < 3:
        return
    for orbit in gooding(lines):
        r, v = at_epoch(orbit, lines)
        if is_plausible(r, v):
            yield r, v


def _circles(seen: Sightings, inward: float) -> Iterator[State]:
    """Circular orbits through two lines."""
    ends = _ends(seen, inward)
    dt_s = float(seen.t_s[ends[1]] - seen.t_s[ends[0]])
    if dt_s <= 0.0:
        return
    places = [_on_sphere(seen.sites_km[n], seen.lines[n], _RADII_KM) for n in ends]
    across = np.linalg.norm(np.cross(places[0], places[1]), axis=-1)
    angle = np.arctan2(across, np.sum(places[0] * places[1], axis=-1))
    excess = angle - np.sqrt(MU_EARTH_KM3_S2 / _RADII_KM**3) * dt_s
    for n in np.flatnonzero(np.signbit(excess[:-1]) != np.signbit(excess[1:])):
        share = excess[n] / (excess[n] - excess[n + 1])
        radius = np.array([_RADII_KM[n] + share * (_RADII_KM[n + 1] - _RADII_KM[n])])
        first, last = (_on_sphere(seen.sites_km[m], seen.lines[m], radius)[0] for m in ends)
        pole = np.cross(first, last)
        forward = np.cross(pole, first)
        speed = np.sqrt(MU_EARTH_KM3_S2 / radius[0])
        yield propagate(first, speed * forward / np.linalg.norm(forward), -seen.t_s[ends[0]])


def _on_sphere(site: FloatArray, line: FloatArray, radii_km: FloatArray) -> FloatArray:
    """Where a line leaves spheres about the centre: (M, 3)."""
    along = site @ line
    reach = -along + np.sqrt(np.maximum(along * along - site @ site + radii_km**2, 0.0))
    return np.asarray(site + reach[:, None] * line)


def is_plausible(r: FloatArray, v: FloatArray) -> bool:
    """Bound, and above the air all the way round."""
    radius = float(np.linalg.norm(r))
    energy = float(v @ v) / 2.0 - MU_EARTH_KM3_S2 / radius
    if energy >= 0.0:
        return False
    a = -MU_EARTH_KM3_S2 / (2.0 * energy)
    h = np.cross(r, v)
    e = float(np.sqrt(max(1.0 - float(h @ h) / (MU_EARTH_KM3_S2 * a), 0.0)))
    return a * (1.0 - e) > LOWEST_KM
