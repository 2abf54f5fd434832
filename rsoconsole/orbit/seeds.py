"""Where a fit may begin: orbits through three of many directions, and circles through two. Pure."""

from collections.abc import Iterator

import numpy as np

from rsoconsole.orbit.gooding import Lines, gooding
from rsoconsole.orbit.sightings import Sightings
from rsoconsole.orbit.two_body import MU_EARTH_KM3_S2, propagate
from rsoconsole.records import FloatArray
from rsoconsole.sky.places import LIGHT_KM_S

State = tuple[FloatArray, FloatArray]
"""Position (3,) km and velocity (3,) km/s at the epoch, along ICRS axes."""
LOWEST_KM = 6_478.0
"""No orbit that lasts comes nearer to the Earth's centre."""
_RADII_KM = np.geomspace(6_500.0, 400_000.0, 160)


def seeds(seen: Sightings, mu: float = MU_EARTH_KM3_S2) -> tuple[State, ...]:
    """Every plausible start at the epoch: Gooding's orbits first, then circles."""
    return (*_by_gooding(seen, mu), *_circles(seen, mu))


def three_lines(seen: Sightings) -> Lines:
    """The first, the middlemost in time and the last line of sight, at the time of the light."""
    middle = int(np.argmin(np.abs(seen.t_s - (seen.t_s[0] + seen.t_s[-1]) / 2.0)))
    middle = min(max(middle, 1), len(seen) - 2)
    chosen = [0, middle, len(seen) - 1]
    return Lines(
        t_s=seen.t_s[chosen], sites_km=seen.sites_km[chosen], directions=seen.lines[chosen]
    )


def _by_gooding(seen: Sightings, mu: float) -> Iterator[State]:
    if len(seen) < 3:
        return
    lines = three_lines(seen)
    for orbit in gooding(lines, mu=mu):
        # The light of the middle line left so much earlier.
        since = -lines.t_s[1] + orbit.ranges_km[1] / LIGHT_KM_S
        r, v = propagate(orbit.r_km, orbit.v_km_s, since, mu)
        if _is_plausible(r, v, mu):
            yield r, v


def _circles(seen: Sightings, mu: float) -> Iterator[State]:
    """Circular orbits through the first and the last line."""
    ends = [0, len(seen) - 1]
    dt_s = float(seen.t_s[-1] - seen.t_s[0])
    if dt_s <= 0.0:
        return
    places = [_on_sphere(seen.sites_km[n], seen.lines[n], _RADII_KM) for n in ends]
    across = np.linalg.norm(np.cross(places[0], places[1]), axis=-1)
    angle = np.arctan2(across, np.sum(places[0] * places[1], axis=-1))
    excess = angle - np.sqrt(mu / _RADII_KM**3) * dt_s
    for n in np.flatnonzero(np.signbit(excess[:-1]) != np.signbit(excess[1:])):
        share = excess[n] / (excess[n] - excess[n + 1])
        radius = np.array([_RADII_KM[n] + share * (_RADII_KM[n + 1] - _RADII_KM[n])])
        first, last = (_on_sphere(seen.sites_km[m], seen.lines[m], radius)[0] for m in ends)
        pole = np.cross(first, last)
        forward = np.cross(pole, first)
        speed = np.sqrt(mu / radius[0])
        yield propagate(first, speed * forward / np.linalg.norm(forward), -seen.t_s[0], mu)


def _on_sphere(site: FloatArray, line: FloatArray, radii_km: FloatArray) -> FloatArray:
    """Where a line leaves spheres about the centre: (M, 3)."""
    along = site @ line
    reach = -along + np.sqrt(np.maximum(along * along - site @ site + radii_km**2, 0.0))
    return np.asarray(site + reach[:, None] * line)


def _is_plausible(r: FloatArray, v: FloatArray, mu: float) -> bool:
    """Bound, and above the air all the way round."""
    radius = float(np.linalg.norm(r))
    energy = float(v @ v) / 2.0 - mu / radius
    if energy >= 0.0:
        return False
    a = -mu / (2.0 * energy)
    h = np.cross(r, v)
    e = float(np.sqrt(max(1.0 - float(h @ h) / (mu * a), 0.0)))
    return a * (1.0 - e) > LOWEST_KM
