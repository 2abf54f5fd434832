"""Low orbits through one streak and where they lead: the admissible region. Pure.

A streak gives a direction and its rate; range and range rate remain unknown. Low orbits are nearly
circular, and a circular orbit through a direction with a rate has one range: few combinations of
range and range rate are likely. The distributions of eccentricity and height are rough priors, with
tails for eccentric orbits. Motion against the Earth's rotation is unlikely, except for polar
orbits. Source: Milani et al. 2004; DeMars & Jah 2013 for a prior in elements. Kilometres, seconds,
radians.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from rsoconsole.orbits.low.low_fit import StreakEnds
from rsoconsole.orbits.motion.ahead import PredictedPosition
from rsoconsole.orbits.motion.prediction import KnownOrbit
from rsoconsole.orbits.motion.two_body import (
    MU_EARTH_KM3_S2,
    cross,
    dot,
    propagate,
    propagate_with_slopes,
    semi_major_axis,
)
from rsoconsole.records import FloatArray, Site
from rsoconsole.sky import (
    ARCSEC_RAD,
    EARTH_RADIUS_KM,
    LIGHT_KM_S,
    IntArray,
    direction_to_unit,
    earth_velocity_km_s,
    line_of_sight_gcrs,
    site_gcrs,
    unit_to_direction,
    zenith_gcrs,
)
from rsoconsole.words import NS_PER_S

LOWEST_KM, HIGHEST_KM = 150.0, 6_000.0
LOWEST_PERIGEE_KM = 120.0
_RANGES, _FALLS = 400, 81
_STEEPEST = 0.25
"""Largest radial speed over the speed of a circular orbit."""
_ROUNDNESS = ((0.70, 0.008), (0.25, 0.04), (0.05, 0.15))
"""Prior of the eccentricity: (share, sigma of each component of the eccentricity vector)"""
_HEIGHTS_KM = (300.0, 1_500.0)
"""Heights, km, between which objects are about as many in each kilometre."""
_RETROGRADE_DEG, _RETROGRADE = 101.0, 0.02
"""Inclination from which on orbits are rare, and how rare."""
_MIN_WEIGHT = 1e-4
_MOST = 600


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OrbitCloud:
    """Low orbits through a streak, as N weighted states; the weights add up to 1."""

    epoch_utc_ns: int
    r_km: FloatArray
    """Positions (N, 3), GCRS, at the epoch."""
    v_km_s: FloatArray
    weight: FloatArray
    """Weights (N,) of the states."""
    log_evidence: float
    """Logarithm of the evidence for this sense of the streak, to compare with the other sense's."""
    streak: StreakEnds


def cloud_through_streak(site: Site, streak: StreakEnds) -> OrbitCloud | None:
    """Find the low orbits through a streak with both ends; None where there is none."""
    t = streak.ends_utc_ns
    lines = line_of_sight_gcrs(streak.ra_icrs_deg, streak.dec_icrs_deg, t)
    middle = lines.sum(axis=0)
    towards = middle / np.linalg.norm(middle)
    # The chord is shorter than the arc by less than a part in 1e5 of a field's width.
    turn = (lines[1] - lines[0]) / (float(t[1] - t[0]) / NS_PER_S)
    turn = turn - (turn @ towards) * towards
    t_mid_ns = int(t[0] + (t[1] - t[0]) // 2)
    places, velocities = site_gcrs(site, np.array([t_mid_ns]))
    region = _region(places[0], velocities[0], towards, turn)
    if region is None:
        return None
    r, v, weight = region
    total = float(weight.sum())
    keep = np.argsort(weight)[::-1][:_MOST]
    keep = keep[weight[keep] > _MIN_WEIGHT * weight[keep[0]]]
    tau_s = np.linalg.norm(r[keep] - places[0], axis=-1, keepdims=True) / LIGHT_KM_S
    return OrbitCloud(
        epoch_utc_ns=t_mid_ns,
        r_km=r[keep] + v[keep] * tau_s,
        v_km_s=v[keep],
        weight=weight[keep] / weight[keep].sum(),
        log_evidence=float(np.log(total)),
        streak=streak,
    )


def predict_from_cloud(
    cloud: OrbitCloud, site: Site, t_utc_ns: int, timing_sigma_s: float
) -> PredictedPosition | None:
    """Predict the mean place of the cloud's orbits at an instant; None where they scatter too far.

    The covariance holds the spread of the orbits, the errors of the streak's ends, and the timing
    error ``timing_sigma_s`` along the motion.
    """
    since_s = (t_utc_ns - cloud.epoch_utc_ns) / NS_PER_S
    r, v = propagate(cloud.r_km, cloud.v_km_s, np.full(len(cloud.weight), since_s))
    lines, rates = _seen(site, t_utc_ns, r, v)
    mean = cloud.weight @ lines
    size = float(np.linalg.norm(mean))
    if not np.isfinite(size) or size < 0.5:
        return None
    ra_deg, dec_deg = (float(each) for each in unit_to_direction(mean / size))
    ra = np.radians(ra_deg)
    east = np.array([-np.sin(ra), np.cos(ra), 0.0])
    axes = np.stack([east, np.cross(mean / size, east)])
    off = lines @ axes.T / ARCSEC_RAD
    rate = cloud.weight @ (rates @ axes.T) / ARCSEC_RAD
    spread = (off * cloud.weight[:, None]).T @ off
    ends = cloud.streak.covariances_arcsec2
    reach = since_s / cloud.streak.exposure_s
    noise = (0.5 - reach) ** 2 * ends[0] + (0.5 + reach) ** 2 * ends[1]
    return PredictedPosition(
        t_utc_ns=t_utc_ns,
        ra_icrs_deg=ra_deg,
        dec_icrs_deg=dec_deg,
        rate_arcsec_s=rate,
        covariance_arcsec2=spread + noise + timing_sigma_s**2 * np.outer(rate, rate),
    )


def nearest_state(
    cloud: OrbitCloud, site: Site, streak: StreakEnds
) -> tuple[FloatArray, FloatArray]:
    """Return the state, at the cloud's epoch, of the orbit nearest to another streak.

    Position (3,) and velocity (3,).
    """
    t = streak.ends_utc_ns
    t_mid_ns = int(t[0] + (t[1] - t[0]) // 2)
    since_s = (t_mid_ns - cloud.epoch_utc_ns) / NS_PER_S
    r, v = propagate(cloud.r_km, cloud.v_km_s, np.full(len(cloud.weight), since_s))
    lines, _ = _seen(site, t_mid_ns, r, v)
    there = direction_to_unit(streak.ra_icrs_deg, streak.dec_icrs_deg).sum(axis=0)
    off = np.linalg.norm(lines - there / np.linalg.norm(there), axis=-1)
    # A tie goes to the likelier orbit.
    best = int(np.argmin(off - 1e-4 * np.log(cloud.weight) * np.min(off)))
    return cloud.r_km[best], cloud.v_km_s[best]


def _seen(
    site: Site, t_utc_ns: int, r_km: FloatArray, v_km_s: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Unit vectors (N, 3) as plates measure them, and their rates in rad/s."""
    at = np.array([t_utc_ns])
    places, velocities = site_gcrs(site, at)
    line = r_km - places[0]
    tau_s = np.linalg.norm(line, axis=-1, keepdims=True) / LIGHT_KM_S
    line = line - (v_km_s + earth_velocity_km_s(at)[0]) * tau_s
    size = np.linalg.norm(line, axis=-1, keepdims=True)
    u, speed = line / size, (v_km_s - velocities[0]) / size
    return u, speed - dot(speed, u)[:, None] * u


def _region(
    site_km: FloatArray, site_km_s: FloatArray, towards: FloatArray, turn: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """States (N, 3), (N, 3) and their weights (N,), on a grid of ranges and radial speeds."""
    up, distance = float(site_km @ towards), float(np.linalg.norm(site_km))

    def range_to(radius_km: float) -> float:
        return -up + float(np.sqrt(max(up * up - distance**2 + radius_km**2, 0.0)))

    nearest_km = range_to(EARTH_RADIUS_KM + LOWEST_KM)
    ranges = np.geomspace(max(nearest_km, 10.0), range_to(EARTH_RADIUS_KM + HIGHEST_KM), _RANGES)
    # Fine about the circle, coarse towards what falls or climbs steeply.
    at = np.linspace(-1.0, 1.0, _FALLS)
    falls = _STEEPEST * at * (0.04 + 0.96 * at * at)
    falls_step = _STEEPEST * (0.04 + 2.88 * at * at)
    rho, fall = (each.ravel() for each in np.meshgrid(ranges, falls, indexing="ij"))
    step = np.broadcast_to(falls_step, (_RANGES, _FALLS)).ravel() * rho
    r = site_km + rho[:, None] * towards
    radius = np.linalg.norm(r, axis=-1)
    circular = np.sqrt(MU_EARTH_KM3_S2 / radius)
    drift = site_km_s + rho[:, None] * turn
    outward = r @ towards / radius
    rate = (fall * circular - dot(r, drift) / radius) / outward
    v = drift + rate[:, None] * towards
    weight = _weight(r, v, circular, fall)
    # From a prior of states to one of range, range rate and what was measured; the grid's steps.
    weight = weight * rho**4 / radius**2 / circular**3 * step * circular / np.abs(outward)
    return (r, v, weight) if np.any(weight > 0.0) else None


def _weight(r: FloatArray, v: FloatArray, circular: FloatArray, fall: FloatArray) -> FloatArray:
    """Density (N,) of orbits: by eccentricity, height and direction of motion."""
    radius = np.linalg.norm(r, axis=-1)
    momentum = cross(r, v)
    across = np.linalg.norm(momentum, axis=-1) / radius / circular
    x, y = across * across - 1.0, fall * across
    shape = sum(
        share / sigma**2 * np.exp(-0.5 * (x * x + y * y) / sigma**2) for share, sigma in _ROUNDNESS
    )
    height = radius - EARTH_RADIUS_KM
    low, high = _HEIGHTS_KM
    many = np.where(height < low, np.exp((height - low) / 60.0), 1.0)
    many = many * np.where(height > high, np.exp((high - height) / 1_000.0), 1.0)
    e = np.hypot(x, y)
    semi_latus = radius * across * across
    is_above = semi_latus / (1.0 + e) > EARTH_RADIUS_KM + LOWEST_PERIGEE_KM
    is_bound = np.sum(v * v, axis=-1) < 1.9 * circular**2
    tilt_deg = np.degrees(np.arccos(momentum[:, 2] / np.linalg.norm(momentum, axis=-1)))
    way = np.where(tilt_deg < _RETROGRADE_DEG, 1.0, _RETROGRADE)
    return np.where(is_above & is_bound, shape * many * way, 0.0)


STEP_S = 15.0
_LOOKED_AT = 400
"""Number of instants computed at a time."""
_LONGEST_S = 7_200.0
"""Longest pass; a longer one is cut there."""
_LEFT_OUT_KM = (0.3, 0.1)
"""Errors by the Earth's unevenness for each revolution, along and across the orbit."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExpectedPass:
    """One expected pass above the limit of altitude."""

    rise_utc_ns: int
    set_utc_ns: int
    top_altitude_deg: float
    sigma_s: float
    """One sigma of the pass's instants."""
    sigma_across_deg: float
    """One sigma across the path at the highest point, as seen from the site."""


def passes_above(
    orbit: KnownOrbit, site: Site, from_utc_ns: int, until_utc_ns: int, least_altitude_deg: float
) -> Iterator[ExpectedPass]:
    """Yield the passes above an altitude that begin within a span, one after another.

    A pass already under way at the start of the span is left out.
    """
    last_ns = from_utc_ns
    while last_ns < until_utc_ns:
        t = last_ns + (np.arange(_LOOKED_AT) * STEP_S * NS_PER_S).astype(np.int64)
        is_up = _altitudes(orbit, site, t) > least_altitude_deg
        last_ns = int(t[-1])
        for n in np.flatnonzero(~is_up[:-1] & is_up[1:]):
            if t[n] >= until_utc_ns:
                return
            found = _pass(orbit, site, int(t[n]), least_altitude_deg)
            if found is not None:
                yield found


def sigma_along_s_and_across_deg(
    orbit: KnownOrbit, site: Site, t_utc_ns: int
) -> tuple[float, float]:
    """Return one sigma along the orbit in seconds, and across the path in degrees.

    The error across the path is as seen from the site.
    """
    since_s = (t_utc_ns - orbit.epoch_utc_ns) / NS_PER_S
    _, _, slopes = propagate_with_slopes(orbit.r_km, orbit.v_km_s, np.array([since_s]))
    r, v = (each[0] for each in orbit.states(np.array([t_utc_ns])))
    spread = slopes[0] @ orbit.covariance @ slopes[0].T
    ahead = v / np.linalg.norm(v)
    a_km, _ = semi_major_axis(orbit.r_km, orbit.v_km_s)
    turns = abs(since_s) / (2.0 * np.pi * np.sqrt(max(a_km, 1.0) ** 3 / MU_EARTH_KM3_S2))
    line = r - site_gcrs(site, np.array([t_utc_ns]))[0][0]
    range_km = float(np.linalg.norm(line))
    # Across as it is seen: neither ahead nor towards the eye.
    aside = np.cross(line / range_km, ahead)
    aside = aside / np.linalg.norm(aside)
    left_out = turns * np.array(_LEFT_OUT_KM)
    along_km = float(np.hypot(np.sqrt(ahead @ spread @ ahead), left_out[0]))
    across_km = float(np.hypot(np.sqrt(aside @ spread @ aside), left_out[1]))
    return along_km / float(np.linalg.norm(v)), float(np.degrees(across_km / range_km))


def _altitudes(orbit: KnownOrbit, site: Site, t: IntArray) -> FloatArray:
    """Altitudes (N,) above the ellipsoid's horizon, degrees."""
    r, _ = orbit.states(t)
    places, _ = site_gcrs(site, t)
    line = r - places
    up = zenith_gcrs(site, t)
    sine = np.sum(line * up, axis=-1) / np.linalg.norm(line, axis=-1)
    return np.asarray(np.degrees(np.arcsin(sine)))


def _pass(
    orbit: KnownOrbit, site: Site, t_below_ns: int, least_altitude_deg: float
) -> ExpectedPass | None:
    """The pass that begins within a step of an instant."""
    coarse = t_below_ns + (np.arange(0.0, _LONGEST_S, STEP_S) * NS_PER_S).astype(np.int64)
    is_down = _altitudes(orbit, site, coarse) <= least_altitude_deg
    ends = np.flatnonzero(is_down[2:])
    last_ns = int(coarse[2 + ends[0]] if len(ends) else coarse[-1])
    fine = np.arange(t_below_ns, last_ns, NS_PER_S // 2)
    altitude = _altitudes(orbit, site, fine)
    up = np.flatnonzero(altitude > least_altitude_deg)
    if not len(up):
        return None
    top = int(np.argmax(altitude))
    sigma_s, across_deg = sigma_along_s_and_across_deg(orbit, site, int(fine[top]))
    return ExpectedPass(
        rise_utc_ns=int(fine[up[0]]),
        set_utc_ns=int(fine[up[-1]]),
        top_altitude_deg=float(altitude[top]),
        sigma_s=sigma_s,
        sigma_across_deg=across_deg,
    )
