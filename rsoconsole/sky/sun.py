"""The Sun: where it is, how high, and how much of it a satellite sees past the Earth."""

import numpy as np

from rsoconsole.records import FloatArray, Site
from rsoconsole.sky.angles import unit_to_direction
from rsoconsole.sky.frames import icrs_to_altaz
from rsoconsole.sky.places import sun_gcrs_km
from rsoconsole.sky.times import TimeLike

SUN_RADIUS_KM = 695_700.0
EARTH_RADIUS_KM = 6378.137
LIT_SHARE = 0.5
"""Of the Sun's disc, from which a satellite counts as lit."""


def sun_icrs(t_utc_ns: int) -> tuple[float, float]:
    """RA and Dec in degrees of the Sun's centre as seen from the Earth's, astrometric."""
    ra_deg, dec_deg = unit_to_direction(sun_gcrs_km(t_utc_ns))
    return float(ra_deg), float(dec_deg)


def sun_altitude_deg(site: Site, t_utc_ns: int) -> float:
    """Altitude of the Sun's centre without refraction; parallax (9 arcsec) left out."""
    altitude_deg, _ = icrs_to_altaz(site, *sun_icrs(t_utc_ns), t_utc_ns)
    return altitude_deg


def lit_fraction(position_gcrs_km: FloatArray, t_utc_ns: TimeLike) -> FloatArray:
    """Share of the solar disc that a satellite at (..., 3) sees: 1 in the light, 0 in the umbra."""
    return lit_fraction_by(sun_gcrs_km(t_utc_ns), position_gcrs_km)


def lit_fraction_by(sun_km: FloatArray, position_gcrs_km: FloatArray) -> FloatArray:
    """The same by where the Sun is, (..., 3) km from the Earth's centre.

    Overlap of two discs, the Earth a sphere without air. Source: Montenbruck & Gill 2000, 3.4.2.
    """
    to_sun = sun_km - position_gcrs_km
    distance_km = np.linalg.norm(to_sun, axis=-1)
    earth_km = np.linalg.norm(position_gcrs_km, axis=-1)
    a = np.arcsin(SUN_RADIUS_KM / distance_km)
    b = np.arcsin(np.minimum(EARTH_RADIUS_KM / earth_km, 1.0))
    cosine = -np.sum(position_gcrs_km * to_sun, axis=-1) / (earth_km * distance_km)
    c = np.arccos(np.clip(cosine, -1.0, 1.0))
    with np.errstate(invalid="ignore", divide="ignore"):
        x = (c * c + a * a - b * b) / (2.0 * c)
        y = np.sqrt(np.maximum(a * a - x * x, 0.0))
        covered = (
            a * a * np.arccos(np.clip(x / a, -1.0, 1.0))
            + b * b * np.arccos(np.clip((c - x) / b, -1.0, 1.0))
            - c * y
        )
    partial = 1.0 - covered / (np.pi * a * a)
    lit = np.where(c >= a + b, 1.0, np.where(c <= b - a, 0.0, partial))
    return np.asarray(np.where(np.isnan(earth_km), np.nan, np.clip(lit, 0.0, 1.0)))


def phase_angle_deg(
    position_gcrs_km: FloatArray, site_gcrs_km: FloatArray, t_utc_ns: TimeLike
) -> FloatArray:
    """Angle Sun - satellite - site: 0 when fully lit as seen from the site."""
    to_sun = sun_gcrs_km(t_utc_ns) - position_gcrs_km
    to_site = site_gcrs_km - position_gcrs_km
    cosine = np.sum(to_sun * to_site, axis=-1)
    cosine = cosine / (np.linalg.norm(to_sun, axis=-1) * np.linalg.norm(to_site, axis=-1))
    return np.asarray(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))
