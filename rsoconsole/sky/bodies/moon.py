"""The Moon: where it stands, how much of it is lit."""

import erfa
import numpy as np

from rsoconsole.records import FloatArray, Site
from rsoconsole.sky import AU_KM, TimeLike, jd_tt, site_gcrs, sun_gcrs_km, unit_to_direction


def moon_gcrs_km(t_utc_ns: TimeLike) -> FloatArray:
    """Vector (..., 3) from the Earth's centre to the Moon's, to some 10 arcsec.

    Source: Meeus 1998, chapter 47, by IAU SOFA (erfa.moon98).
    """
    return np.asarray(erfa.moon98(*jd_tt(t_utc_ns))["p"]) * AU_KM


def moon_icrs(site: Site, t_utc_ns: int) -> tuple[float, float]:
    """RA and Dec in degrees of the Moon's centre as seen from the site, without refraction."""
    site_km = site_gcrs(site, np.array([t_utc_ns]))[0][0]
    ra_deg, dec_deg = unit_to_direction(moon_gcrs_km(t_utc_ns) - site_km)
    return float(ra_deg), float(dec_deg)


def moon_lit_fraction(t_utc_ns: int) -> float:
    """Share of the Moon's disc that is lit, as seen from the Earth's centre."""
    moon_km, sun_km = moon_gcrs_km(t_utc_ns), sun_gcrs_km(t_utc_ns)
    to_sun = sun_km - moon_km
    cosine = float(to_sun @ -moon_km / (np.linalg.norm(to_sun) * np.linalg.norm(moon_km)))
    return (1.0 + cosine) / 2.0
