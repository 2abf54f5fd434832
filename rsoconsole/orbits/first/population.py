"""Prior densities of orbits: how likely an orbit is before any measurement. Pure.

They are rough figures from the public catalogue of 2023, by regime. Only their logarithms are used,
and a factor of two in any of them changes a probability of 0.9 to 0.95.
"""

from dataclasses import dataclass

import numpy as np

from rsoconsole.orbits.motion.two_body import MU_EARTH_KM3_S2
from rsoconsole.records import FloatArray, Site
from rsoconsole.sky import ARCSEC_RAD, direction_to_unit, site_gcrs, wrap_180

_STEP = np.array([1e-2, 1e-2, 1e-2, 1e-6, 1e-6, 1e-6])


@dataclass(frozen=True, slots=True, kw_only=True)
class Population:
    """Distribution of the orbits of one regime, as mixtures of normal distributions."""

    a_km: tuple[tuple[float, float, float], ...]
    """Semi-major axis: (share of the objects, mean, sigma) of each part, km."""
    sigma_e: float
    """One sigma of each component of the eccentricity vector."""
    inclination_deg: tuple[tuple[float, float], ...]
    """Inclination: (share, sigma of each component of the inclination vector)"""
    objects: float
    """Number of the regime's objects above the horizon of one site."""
    visible_rad: float = 2.2
    """Span of mean longitude visible from one site, rad."""


POPULATIONS: dict[str, Population] = {
    "geo": Population(
        a_km=((0.25, 42_165.9, 1.5), (0.4, 42_165.5, 10.0), (0.35, 42_165.0, 150.0)),
        sigma_e=2e-3,
        inclination_deg=((0.35, 0.1), (0.65, 6.0)),
        objects=500.0,
    ),
    "meo": Population(
        a_km=((0.7, 26_560.0, 60.0), (0.3, 26_500.0, 2_000.0)),
        sigma_e=2e-2,
        inclination_deg=((1.0, 40.0),),
        objects=60.0,
    ),
    "leo": Population(
        a_km=((0.7, 7_100.0, 250.0), (0.3, 7_500.0, 500.0)),
        sigma_e=1.4e-2,
        inclination_deg=((1.0, 60.0),),
        objects=1_000.0,
    ),
    "any": Population(
        a_km=((0.7, 7_200.0, 500.0), (0.3, 20_000.0, 10_000.0)),
        sigma_e=0.2,
        inclination_deg=((1.0, 60.0),),
        objects=1_000.0,
    ),
}
_GEO_KM = (40_164.0, 44_164.0)
_MEO_KM = (18_000.0, 34_000.0)


def population_of(r_km: FloatArray, v_km_s: FloatArray, prior: str) -> Population:
    """Population to which an orbit belongs: by the prior of its fit, or by its size and shape."""
    if prior in POPULATIONS:
        return POPULATIONS[prior]
    a, k, h, *_ = equinoctial_elements(np.concatenate([r_km, v_km_s]))
    e = float(np.hypot(k, h))
    if _GEO_KM[0] < a < _GEO_KM[1] and e < 0.02:
        return POPULATIONS["geo"]
    return POPULATIONS["meo" if _MEO_KM[0] < a < _MEO_KM[1] and e < 0.1 else "any"]


def log_prior_density(population: Population, state: FloatArray, covariance: FloatArray) -> float:
    """Return the logarithm of a population's density at a state (6,), per km^3 and (km/s)^3.

    Of the prior on the eccentricity it has only the normalisation: the fit adds the rest. The
    density of the semi-major axis is averaged over the axis's uncertainty by ``covariance`` (6, 6),
    which may exceed the width of the population.
    """
    slopes = _slopes(state)
    a, _, _, q, p, _ = equinoctial_elements(state)
    sigma_a_2 = float(slopes[0] @ covariance @ slopes[0])
    log_a = np.log(
        sum(
            share
            * np.exp(-((a - mean) ** 2) / (2.0 * (sigma**2 + sigma_a_2)))
            / np.sqrt(2.0 * np.pi * (sigma**2 + sigma_a_2))
            for share, mean, sigma in population.a_km
        )
        + 1e-300
    )
    half_2 = np.hypot(p, q) ** 2
    log_tilt = np.log(
        sum(
            share * np.exp(-half_2 / (2.0 * half**2)) / (2.0 * np.pi * half**2)
            for share, sigma in population.inclination_deg
            for half in (np.radians(sigma) / 2.0,)
        )
        + 1e-300
    )
    log_e = -np.log(2.0 * np.pi * population.sigma_e**2)
    _, log_scale = np.linalg.slogdet(slopes)
    return float(log_a + log_tilt + log_e - np.log(population.visible_rad) + log_scale)


def equinoctial_elements(state: FloatArray) -> FloatArray:
    """Return equinoctial elements (..., 6) of states (..., 6).

    Regular for circular and equatorial orbits: a in km; e times cosine and sine of the perigee's
    longitude; tan i/2 times cosine and sine of the node's; mean longitude in rad. Source: Broucke &
    Cefola 1972, Celestial Mechanics 5, 303.
    """
    r, v = state[..., :3], state[..., 3:]
    mu = MU_EARTH_KM3_S2
    radius = np.linalg.norm(r, axis=-1)
    a = 1.0 / (2.0 / radius - np.sum(v * v, axis=-1) / mu)
    turn = np.cross(r, v)
    pole = turn / np.linalg.norm(turn, axis=-1, keepdims=True)
    p, q = pole[..., 0] / (1.0 + pole[..., 2]), -pole[..., 1] / (1.0 + pole[..., 2])
    size = 1.0 + p * p + q * q
    f = np.stack([1.0 - p * p + q * q, 2.0 * p * q, -2.0 * p], axis=-1) / size[..., None]
    g = np.cross(pole, f)
    towards = np.cross(v, turn) / mu - r / radius[..., None]
    k, h = np.sum(towards * f, axis=-1), np.sum(towards * g, axis=-1)
    x, y = np.sum(r * f, axis=-1), np.sum(r * g, axis=-1)
    root = np.sqrt(1.0 - h * h - k * k)
    beta = 1.0 / (1.0 + root)
    cos_f = k + ((1.0 - k * k * beta) * x - h * k * beta * y) / (a * root)
    sin_f = h + ((1.0 - h * h * beta) * y - h * k * beta * x) / (a * root)
    longitude = np.arctan2(sin_f, cos_f) + h * cos_f - k * sin_f
    return np.asarray(np.stack([a, k, h, q, p, longitude], axis=-1))


def _slopes(state: FloatArray) -> FloatArray:
    """Slopes (6, 6) of the elements by the state."""
    around = equinoctial_elements(state + np.concatenate([np.diag(_STEP), -np.diag(_STEP)]))
    change = around[:6] - around[6:]
    change[:, 5] = np.radians([wrap_180(float(np.degrees(each))) for each in change[:, 5]])
    return np.asarray(change.T / (2.0 * _STEP))


LOWEST_PERIGEE_KM = 6_378.0 + 120.0
_RANGES_KM = np.geomspace(150.0, 150_000.0, 120)
_RATES_KM_S = np.linspace(-10.0, 10.0, 101)
_ROUND, _ECCENTRIC_WEIGHT = 0.2, 0.2
"""Scale of eccentricities, and the weight that even the largest keep."""
_EARTH_RAD_S = 7.292115e-5


def expected_sky_acceleration(
    site: Site,
    t_utc_ns: int,
    direction_icrs_deg: tuple[float, float],
    rate_arcsec_s: tuple[float, float],
) -> tuple[FloatArray, FloatArray] | None:
    """Return mean (2,) and covariance (2, 2) of an object's acceleration and curvature.

    They are over the orbits possible for an object in this direction at this rate; None if there is
    none. Acceleration along the path in arcsec/s^2; curvature to the left in rad per rad of path.
    ``rate_arcsec_s``: east and north.
    """
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
    orbit_path_bend = np.stack([bent @ ahead / ARCSEC_RAD, bent @ left / speed**2], axis=1)
    weight = weight / weight.sum()
    mean = weight @ orbit_path_bend
    off = orbit_path_bend - mean
    return mean, (off * weight[:, None]).T @ off


def _weight(r_km: FloatArray, v_km_s: FloatArray) -> FloatArray:
    """Weights of states (N, 3) km, km/s: 0 for one that is no orbit above the air."""
    distance = np.linalg.norm(r_km, axis=1)
    energy = 0.5 * np.sum(v_km_s**2, axis=1) - MU_EARTH_KM3_S2 / distance
    momentum = np.sum(np.cross(r_km, v_km_s) ** 2, axis=1)
    is_bound = energy < 0.0
    a = np.where(is_bound, -0.5 * MU_EARTH_KM3_S2 / np.where(is_bound, energy, -1.0), 0.0)
    e = np.sqrt(np.maximum(1.0 - momentum / (MU_EARTH_KM3_S2 * np.maximum(a, 1.0)), 0.0))
    is_above = a * (1.0 - e) > LOWEST_PERIGEE_KM
    round_ones = _ECCENTRIC_WEIGHT + (1.0 - _ECCENTRIC_WEIGHT) * np.exp(-e / _ROUND)
    return np.where(is_bound & is_above, round_ones, 0.0)
