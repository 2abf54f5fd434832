"""How the path of something may bend, before an orbit is known: the admissible region. Pure.

A direction and its rate leave range and range rate open; only some of them are orbits about the
Earth that stay above its air (Milani et al. 2004). Each of those says how speed and direction on
the sky will change. No orbit is believed to be a circle: eccentric ones only weigh a little less,
because there are fewer of them. Kilometres, seconds, radians.
"""

from dataclasses import dataclass

import numpy as np

from rsoconsole.orbits.motion import MU_EARTH_KM3_S2
from rsoconsole.records import FloatArray, Site
from rsoconsole.sky import ARCSEC_RAD, direction_to_unit, site_gcrs

LOWEST_PERIGEE_KM = 6_378.0 + 120.0
_RANGES_KM = np.geomspace(150.0, 150_000.0, 120)
_RATES_KM_S = np.linspace(-10.0, 10.0, 101)
_ROUND, _ECCENTRIC_WEIGHT = 0.2, 0.2
"""Scale of eccentricities, and the weight that even the largest keep."""
_EARTH_RAD_S = 7.292115e-5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Bending:
    """How a path changes: change of speed (arcsec/s^2) and turn for each length of path."""

    mean: FloatArray
    """(2,)"""
    covariance: FloatArray
    """(2, 2)"""


def bending(
    site: Site,
    t_utc_ns: int,
    direction_icrs_deg: tuple[float, float],
    rate_arcsec_s: tuple[float, float],
) -> Bending | None:
    """What all orbits through a direction with a rate (east, north) say; None: there is none."""
    ra = np.radians(direction_icrs_deg[0])
    towards = direction_to_unit(*direction_icrs_deg)
    east = np.array([-np.sin(ra), np.cos(ra), 0.0])
    north = np.cross(towards, east)
    u_rate = (rate_arcsec_s[0] * east + rate_arcsec_s[1] * north) * ARCSEC_RAD
    speed = float(np.linalg.norm(u_rate))
    if speed == 0.0:
        return None
    ahead, left = u_rate / speed, np.cross(towards, u_rate / speed)
    places, velocities = site_gcrs(site, np.array([t_utc_ns]))
    site_km, site_km_s = places[0], velocities[0]
    site_km_s2 = -(_EARTH_RAD_S**2) * np.array([site_km[0], site_km[1], 0.0])
    ranges, rates = (each.ravel() for each in np.meshgrid(_RANGES_KM, _RATES_KM_S))
    r = site_km + ranges[:, None] * towards
    v = site_km_s + rates[:, None] * towards + ranges[:, None] * u_rate
    weight = _weight(r, v)
    if not np.any(weight > 0.0):
        return None
    distance = np.linalg.norm(r, axis=1)
    pull = -MU_EARTH_KM3_S2 / distance[:, None] ** 3 * r - site_km_s2
    bent = (pull - 2.0 * rates[:, None] * u_rate) / ranges[:, None]
    bending = np.stack([bent @ ahead / ARCSEC_RAD, bent @ left / speed**2], axis=1)
    weight = weight / weight.sum()
    mean = weight @ bending
    off = bending - mean
    return Bending(mean=mean, covariance=(off * weight[:, None]).T @ off)


def _weight(r_km: FloatArray, v_km_s: FloatArray) -> FloatArray:
    """Of states (N, 3) km, km/s: 0 for what is no orbit above the air."""
    distance = np.linalg.norm(r_km, axis=1)
    energy = 0.5 * np.sum(v_km_s**2, axis=1) - MU_EARTH_KM3_S2 / distance
    momentum = np.sum(np.cross(r_km, v_km_s) ** 2, axis=1)
    is_bound = energy < 0.0
    a = np.where(is_bound, -0.5 * MU_EARTH_KM3_S2 / np.where(is_bound, energy, -1.0), 0.0)
    e = np.sqrt(np.maximum(1.0 - momentum / (MU_EARTH_KM3_S2 * np.maximum(a, 1.0)), 0.0))
    is_above = a * (1.0 - e) > LOWEST_PERIGEE_KM
    round_ones = _ECCENTRIC_WEIGHT + (1.0 - _ECCENTRIC_WEIGHT) * np.exp(-e / _ROUND)
    return np.where(is_bound & is_above, round_ones, 0.0)
