"""Conversions between catalogue directions, places of date, hour angle and altitude.

Directions are floats or arrays; array instants need arrays of directions. "JNow" is the apparent
place: true equator and equinox of date with annual aberration, which is what INDI's
EQUATORIAL_EOD_COORD means. All degrees. Diurnal aberration (0.3 arcsec) and polar motion (0.3
arcsec) are left out: too small to matter for pointing a mount. Source: IAU SOFA by erfa.
"""

from typing import Literal

import erfa
import numpy as np

from rsoconsole.records import FloatArray, Site
from rsoconsole.sky.angles import Angle
from rsoconsole.sky.times import IntArray, TimeLike, jd_tt, lst_deg
from rsoconsole.words import NS_PER_S

PierSide = Literal["east", "west"]


def icrs_to_jnow(
    ra_icrs_deg: Angle, dec_icrs_deg: Angle, t_utc_ns: TimeLike
) -> tuple[Angle, Angle]:
    """Convert a catalogue direction to its apparent place of date; floats in, floats out."""
    ra, dec, eo = erfa.atci13(
        np.radians(ra_icrs_deg), np.radians(dec_icrs_deg), 0.0, 0.0, 0.0, 0.0, *jd_tt(t_utc_ns)
    )
    return _like(ra_icrs_deg, np.degrees(ra - eo) % 360.0), _like(ra_icrs_deg, np.degrees(dec))


def jnow_to_icrs(
    ra_jnow_deg: Angle, dec_jnow_deg: Angle, t_utc_ns: TimeLike
) -> tuple[Angle, Angle]:
    """Convert an apparent place of date to its catalogue direction; undoes ``icrs_to_jnow``."""
    tt = jd_tt(t_utc_ns)
    ra_cirs = np.radians(ra_jnow_deg) + erfa.eo06a(*tt)
    ra, dec, _ = erfa.atic13(ra_cirs, np.radians(dec_jnow_deg), *tt)
    return _like(ra_jnow_deg, np.degrees(ra) % 360.0), _like(ra_jnow_deg, np.degrees(dec))


def hour_angle_jnow_deg(site: Site, ra_jnow_deg: Angle, t_utc_ns: TimeLike) -> Angle:
    """Hour angle of a right ascension of date, -180 to 180, west positive."""
    ha = lst_deg(site.longitude_deg, t_utc_ns) - np.asarray(ra_jnow_deg)
    return _like(ra_jnow_deg, (ha + 180.0) % 360.0 - 180.0)


def hour_angle_icrs_deg(
    site: Site, ra_icrs_deg: Angle, dec_icrs_deg: Angle, t_utc_ns: TimeLike
) -> Angle:
    """Hour angle of a catalogue direction, -180 to 180, west positive."""
    ra_jnow_deg, _ = icrs_to_jnow(ra_icrs_deg, dec_icrs_deg, t_utc_ns)
    return hour_angle_jnow_deg(site, ra_jnow_deg, t_utc_ns)


def icrs_of_hour_angle(
    site: Site, hour_angle_deg: Angle, dec_jnow_deg: Angle, t_utc_ns: TimeLike
) -> tuple[Angle, Angle]:
    """Convert an hour angle and declination of date to the catalogue direction."""
    ra = (lst_deg(site.longitude_deg, t_utc_ns) - np.asarray(hour_angle_deg)) % 360.0
    return jnow_to_icrs(_like(hour_angle_deg, ra), dec_jnow_deg, t_utc_ns)


def altaz_of_hour_angle(
    site: Site, hour_angle_deg: Angle, dec_jnow_deg: Angle
) -> tuple[Angle, Angle]:
    """Convert an hour angle and declination of date to altitude and azimuth, without refraction.

    Azimuth: north 0, east 90.
    """
    azimuth, altitude = erfa.hd2ae(
        np.radians(hour_angle_deg), np.radians(dec_jnow_deg), np.radians(site.latitude_deg)
    )
    altitude_deg = _like(hour_angle_deg, np.degrees(altitude))
    return altitude_deg, _like(hour_angle_deg, np.degrees(azimuth) % 360.0)


def icrs_to_altaz(
    site: Site,
    ra_icrs_deg: Angle,
    dec_icrs_deg: Angle,
    t_utc_ns: TimeLike,
    *,
    is_refracted: bool = False,
) -> tuple[Angle, Angle]:
    """Convert a catalogue direction to altitude and azimuth.

    ``is_refracted``: True adds refraction to the altitude.
    """
    ra_jnow_deg, dec_jnow_deg = icrs_to_jnow(ra_icrs_deg, dec_icrs_deg, t_utc_ns)
    ha = hour_angle_jnow_deg(site, ra_jnow_deg, t_utc_ns)
    altitude_deg, azimuth_deg = altaz_of_hour_angle(site, ha, dec_jnow_deg)
    if is_refracted:
        altitude_deg = altitude_deg + refraction_deg(altitude_deg)
    return altitude_deg, azimuth_deg


def altaz_to_icrs(
    site: Site, altitude_deg: Angle, azimuth_deg: Angle, t_utc_ns: TimeLike
) -> tuple[Angle, Angle]:
    """Convert an altitude and azimuth without refraction to a catalogue direction."""
    ha, dec = erfa.ae2hd(
        np.radians(azimuth_deg), np.radians(altitude_deg), np.radians(site.latitude_deg)
    )
    ha_deg, dec_deg = _like(altitude_deg, np.degrees(ha)), _like(altitude_deg, np.degrees(dec))
    return icrs_of_hour_angle(site, ha_deg, dec_deg, t_utc_ns)


def refraction_deg(altitude_deg: Angle) -> Angle:
    """Refraction, deg, at an altitude without refraction, for air at 10 C; constant below -1 deg.

    Source: Saemundsson 1986.
    """
    h = np.maximum(np.asarray(altitude_deg, float), -1.0)
    lift_arcmin = 1.02 / np.tan(np.radians(h + 10.3 / (h + 5.11)))
    return _like(altitude_deg, lift_arcmin / 60.0)


def pier_side(hour_angle_deg: float) -> PierSide:
    """Side of the pier on which a German mount carries its tube by default.

    West of the meridian (hour angle >= 0) the tube stands east, INDI's PIER_EAST.
    """
    return "east" if (hour_angle_deg + 180.0) % 360.0 - 180.0 >= 0.0 else "west"


def _like(model: Angle, value: FloatArray) -> Angle:
    """Return a float where the model value is a float."""
    if isinstance(model, np.ndarray):
        return np.asarray(value)
    return float(value)


def equinox_to_icrs(
    ra_deg: FloatArray, dec_deg: FloatArray, equinox_year: int | None, t_utc_ns: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Convert directions (N,) given for an equinox to ICRS RA and Dec, degrees, (N,) each.

    ``equinox_year``: FK4 before 1984, FK5 from 1984; None: FK5 with the equinox of date.
    ``t_utc_ns``: (N,) times of the observations.
    """
    if equinox_year == 2000:
        return ra_deg, dec_deg  # FK5 differs from ICRS by 0.02 arcsec
    from astropy.coordinates import FK4, FK5, SkyCoord
    from astropy.time import Time

    date = Time(t_utc_ns / NS_PER_S, format="unix")
    if equinox_year is None:
        frame = FK5(equinox=date)
    elif equinox_year < 1984:
        frame = FK4(equinox=Time(equinox_year, format="byear"), obstime=date)
    else:
        frame = FK5(equinox=Time(equinox_year, format="jyear"))
    found = SkyCoord(ra_deg, dec_deg, unit="deg", frame=frame).icrs
    return np.asarray(found.ra.deg), np.asarray(found.dec.deg)
