"""Places of site, Earth and satellite in GCRS, and the direction that a plate solution measures.

Kilometres and km/s along ICRS axes. Source of the Earth's motion and rotation: IAU SOFA by erfa
(IAU 2006/2000A, with UT1 and polar motion from the IERS table).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import erfa
import numpy as np

from rsoconsole.records import FloatArray, Site
from rsoconsole.sky.angles import direction_to_unit, separation_deg, unit_to_direction
from rsoconsole.sky.times import ARCSEC_RAD, IntArray, TimeLike, earth_orientation, jd_tt, jd_ut1
from rsoconsole.words import NS_PER_S

LIGHT_KM_S = 299_792.458
AU_KM = 149_597_870.7
GEO_RADIUS_KM = 42164.17
EARTH_RADIUS_KM = 6378.137
EARTH_E2 = 0.00669437999014
S_PER_DAY = 86_400.0
_KNOT_NS = 3600 * NS_PER_S

PositionOf = Callable[[IntArray], tuple[FloatArray, FloatArray]]
"""Function of instants (N,), UTC ns, to GCRS position (N, 3) km and velocity (N, 3) km/s."""


def site_of_itrs_m(x_m: float, y_m: float, z_m: float) -> Site:
    """Return the place (WGS84) at geocentric coordinates in the Earth's frame, ITRS, m."""
    longitude, latitude, elevation_m = erfa.gc2gd(1, np.array([x_m, y_m, z_m]))
    return Site(
        latitude_deg=math.degrees(latitude),
        longitude_deg=math.degrees(longitude),
        elevation_m=float(elevation_m),
    )


def ground_distance_km(one: Site, other: Site) -> float:
    """Return the distance of two places along the ground, km, good to 0.5 %."""
    apart_deg = separation_deg(
        one.longitude_deg, one.latitude_deg, other.longitude_deg, other.latitude_deg
    )
    return math.radians(apart_deg) * EARTH_RADIUS_KM


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SkyPlaces:
    """Astrometric places of one object at N instants; N is the first axis of every array."""

    t_utc_ns: IntArray
    ra_icrs_deg: FloatArray
    dec_icrs_deg: FloatArray
    range_km: FloatArray
    ra_rate_deg_s: FloatArray
    """Rate of the right ascension: multiply by cos dec for the rate on the sky."""
    dec_rate_deg_s: FloatArray
    position_gcrs_km: FloatArray
    """(N, 3) position of the object when the light left, km."""
    site_gcrs_km: FloatArray
    """(N, 3) position of the site when the light arrived, km."""


@lru_cache(maxsize=512)
def _pole_knot(hour: int) -> tuple[float, float, float]:
    """Coordinates X, Y of the celestial pole and the locator s at a whole hour, radians."""
    x, y, s = erfa.xys06a(*jd_tt(hour * _KNOT_NS))
    return float(x), float(y), float(s)


def cirs_to_gcrs(t_utc_ns: TimeLike) -> FloatArray:
    """Rotation matrices (..., 3, 3) from the celestial intermediate frame of date (CIRS) to GCRS.

    The pole is interpolated linearly between whole hours, which costs less than 1e-5 arcsec.
    """
    t = np.asarray(t_utc_ns, np.int64)
    hours = t // _KNOT_NS
    fraction = ((t - hours * _KNOT_NS) / _KNOT_NS)[..., None]
    unique, inverse = np.unique(hours, return_inverse=True)
    knots = {int(h): _pole_knot(int(h)) for h in unique}
    before = np.array([knots[int(h)] for h in unique]).reshape(-1, 3)
    after = np.array([_pole_knot(int(h) + 1) for h in unique]).reshape(-1, 3)
    at = inverse.reshape(t.shape)
    xys = before[at] * (1.0 - fraction) + after[at] * fraction
    return np.asarray(np.swapaxes(erfa.c2ixys(xys[..., 0], xys[..., 1], xys[..., 2]), -1, -2))


def site_gcrs(site: Site, t_utc_ns: TimeLike) -> tuple[FloatArray, FloatArray]:
    """GCRS position (..., 3) km and velocity (..., 3) km/s of a site that turns with the Earth."""
    orientation = earth_orientation(t_utc_ns)
    pv = erfa.pvtob(
        np.radians(site.longitude_deg),
        np.radians(site.latitude_deg),
        site.elevation_m,
        orientation.pole_x_arcsec * ARCSEC_RAD,
        orientation.pole_y_arcsec * ARCSEC_RAD,
        erfa.sp00(*jd_tt(t_utc_ns)),
        erfa.era00(*jd_ut1(t_utc_ns)),
    )
    rotation = cirs_to_gcrs(t_utc_ns)
    return _rotate(rotation, pv["p"]) / 1000.0, _rotate(rotation, pv["v"]) / 1000.0


def zenith_gcrs(site: Site, t_utc_ns: TimeLike) -> FloatArray:
    """Unit vectors (..., 3), GCRS, to the zenith of a site: normal to the WGS84 ellipsoid."""
    high, _ = site_gcrs(replace(site, elevation_m=site.elevation_m + 1e4), t_utc_ns)
    up = high - site_gcrs(site, t_utc_ns)[0]
    return np.asarray(up / np.linalg.norm(up, axis=-1, keepdims=True))


def teme_to_gcrs_rotation(t_utc_ns: TimeLike) -> FloatArray:
    """Rotation matrices (..., 3, 3) from SGP4's TEME (equinox by GMST 1982) to GCRS."""
    ut1 = jd_ut1(t_utc_ns)
    about_pole = _about_pole(erfa.era00(*ut1) - erfa.gmst82(*ut1))
    return np.asarray(cirs_to_gcrs(t_utc_ns) @ about_pole)


def itrf_to_gcrs_rotation(t_utc_ns: TimeLike) -> FloatArray:
    """Rotation matrices (..., 3, 3) from the Earth-fixed frame (ITRF, WGS84) to GCRS."""
    orientation, tt = earth_orientation(t_utc_ns), jd_tt(t_utc_ns)
    about_pole = _about_pole(erfa.era00(*jd_ut1(t_utc_ns)))
    polar_motion = erfa.pom00(
        orientation.pole_x_arcsec * ARCSEC_RAD,
        orientation.pole_y_arcsec * ARCSEC_RAD,
        erfa.sp00(*tt),
    )
    from_itrf = np.swapaxes(polar_motion, -1, -2)
    return np.asarray(cirs_to_gcrs(t_utc_ns) @ about_pole @ from_itrf)


def _about_pole(angle: FloatArray) -> FloatArray:
    """Rotation matrices (..., 3, 3) by an angle, from x to y."""
    cos_a, sin_a = np.cos(angle), np.sin(angle)
    zero, one = np.zeros_like(cos_a), np.ones_like(cos_a)
    rows = [[cos_a, -sin_a, zero], [sin_a, cos_a, zero], [zero, zero, one]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


_FEW, _MAX_REMEMBERED = 256, 4096
"""Largest number of instants of one call that are cached, and largest number cached in all."""
_remembered: dict[int, FloatArray] = {}
"""Velocity of the Earth by instant, km/s."""


def earth_velocity_km_s(t_utc_ns: TimeLike) -> FloatArray:
    """Velocity (..., 3), km/s, of the Earth's centre about the solar system's barycentre.

    Results of calls with up to 256 instants are cached by instant.
    """
    t = np.asarray(t_utc_ns, np.int64)
    if t.size > _FEW:
        return _velocity_km_s(t)
    instants = t.ravel().tolist()
    found = {each: _remembered.get(each) for each in instants}
    fresh = [each for each, velocity in found.items() if velocity is None]
    if fresh:
        new = dict(zip(fresh, _velocity_km_s(np.array(fresh, np.int64)), strict=True))
        if len(_remembered) > _MAX_REMEMBERED:
            _remembered.clear()
        _remembered.update(new)
        found.update(new)
    return np.array([found[each] for each in instants]).reshape(*t.shape, 3)


def _velocity_km_s(t_utc_ns: TimeLike) -> FloatArray:
    _, barycentric = erfa.epv00(*jd_tt(t_utc_ns))
    return np.asarray(barycentric["v"]) * (AU_KM / S_PER_DAY)


def sun_gcrs_km(t_utc_ns: TimeLike) -> FloatArray:
    """Vector (..., 3), km, from the Earth's centre to the Sun's."""
    heliocentric, _ = erfa.epv00(*jd_tt(t_utc_ns))
    return -np.asarray(heliocentric["p"]) * AU_KM


def astrometric_places(position_of: PositionOf, site: Site, t_utc_ns: IntArray) -> SkyPlaces:
    """Return an object's places at instants (N,), as a plate solution measures them.

    Direction u = r_object(t - tau) - r_site(t) - v_earth * tau, the light time tau by iteration.
    v_earth * tau is the Earth's own motion in the light time, since ``position_of`` counts from the
    Earth's centre. Annual aberration is left out: the stars of the same plate share it.
    """
    t = np.atleast_1d(np.asarray(t_utc_ns, np.int64))
    site_km, site_km_s = site_gcrs(site, t)
    v_earth = earth_velocity_km_s(t)
    position, velocity = position_of(t)
    tau_s = np.linalg.norm(position - site_km, axis=-1) / LIGHT_KM_S
    for _ in range(2):
        position, velocity = position_of(t - np.rint(np.nan_to_num(tau_s) * NS_PER_S).astype(int))
        u = position - site_km - v_earth * tau_s[:, None]
        tau_s = np.linalg.norm(u, axis=-1) / LIGHT_KM_S
    range_km = np.linalg.norm(u, axis=-1)
    along = u / range_km[:, None]
    tau_rate = np.sum(along * (velocity - site_km_s), axis=-1, keepdims=True) / LIGHT_KM_S
    u_rate = velocity * (1.0 - tau_rate) - site_km_s - v_earth * tau_rate
    ra_deg, dec_deg = unit_to_direction(u)
    ra_rate, dec_rate = _angular_rates_deg_s(u, u_rate)
    return SkyPlaces(
        t_utc_ns=t,
        ra_icrs_deg=ra_deg,
        dec_icrs_deg=dec_deg,
        range_km=np.asarray(range_km),
        ra_rate_deg_s=ra_rate,
        dec_rate_deg_s=dec_rate,
        position_gcrs_km=position,
        site_gcrs_km=site_km,
    )


def line_of_sight_gcrs(
    ra_icrs_deg: FloatArray, dec_icrs_deg: FloatArray, t_utc_ns: IntArray
) -> FloatArray:
    """Return unit vectors (N, 3) from the site to the object for measured directions.

    Inverse of ``astrometric_places``: the direction of u + v_earth / c, at any range. The vector
    points to where the object was at t - tau, when the light left.
    """
    u = direction_to_unit(ra_icrs_deg, dec_icrs_deg)
    line = u + earth_velocity_km_s(t_utc_ns) / LIGHT_KM_S
    return np.asarray(line / np.linalg.norm(line, axis=-1, keepdims=True))


def _angular_rates_deg_s(u: FloatArray, u_rate: FloatArray) -> tuple[FloatArray, FloatArray]:
    x, y, z = u.T
    dx, dy, dz = u_rate.T
    flat_2 = x * x + y * y
    flat = np.sqrt(flat_2)
    ra_rate = (x * dy - y * dx) / flat_2
    dec_rate = (dz * flat - z * (x * dx + y * dy) / flat) / (flat_2 + z * z)
    return np.degrees(ra_rate), np.degrees(dec_rate)


def _rotate(rotation: FloatArray, vector: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("...ij,...j->...i", rotation, vector))


def geo_belt_declination_deg(site: Site, hour_angle_deg: float) -> float:
    """Topocentric declination, deg, of the geostationary belt at a topocentric hour angle.

    Hour angle west positive. Geometry on the WGS84 ellipsoid; good to a few arcminutes, far less
    than a field.
    """
    axis_km, height_km = _site_km(site)
    # In the equatorial plane, x along the site's meridian: |(axis, 0) + d (cos h, -sin h)| = GEO.
    h = math.radians(hour_angle_deg)
    along = axis_km * math.cos(h)
    distance_km = -along + math.sqrt(along**2 + GEO_RADIUS_KM**2 - axis_km**2)
    return math.degrees(math.atan2(-height_km, distance_km))


def geo_slot_direction_deg(site: Site, slot_longitude_deg: float) -> tuple[float, float]:
    """Topocentric hour angle and declination, deg, of a longitude on the geostationary belt.

    Hour angle: -180 to 180, west positive; ``slot_longitude_deg``: east positive. A slot hidden by
    the Earth gives a direction below the horizon, which the limits refuse.
    """
    axis_km, height_km = _site_km(site)
    west = math.radians(site.longitude_deg - slot_longitude_deg)
    # In the equatorial plane, x along the site's meridian, y towards west.
    x_km = GEO_RADIUS_KM * math.cos(west) - axis_km
    y_km = GEO_RADIUS_KM * math.sin(west)
    hour_angle_deg = math.degrees(math.atan2(y_km, x_km))
    return hour_angle_deg, math.degrees(math.atan2(-height_km, math.hypot(x_km, y_km)))


def _site_km(site: Site) -> tuple[float, float]:
    """Distance from the Earth's axis and height over the equator's plane, WGS84."""
    latitude = math.radians(site.latitude_deg)
    normal_km = EARTH_RADIUS_KM / math.sqrt(1 - EARTH_E2 * math.sin(latitude) ** 2)
    axis_km = (normal_km + site.elevation_m / 1e3) * math.cos(latitude)
    return axis_km, (normal_km * (1 - EARTH_E2) + site.elevation_m / 1e3) * math.sin(latitude)
