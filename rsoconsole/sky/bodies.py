"""Sun, Moon and planets: their places, dark time, and sunlight on a satellite."""

from collections.abc import Callable
from types import MappingProxyType

import erfa
import numpy as np

from rsoconsole.records import FloatArray, Site
from rsoconsole.sky.angles import unit_to_direction
from rsoconsole.sky.frames import icrs_to_altaz
from rsoconsole.sky.places import AU_KM, EARTH_RADIUS_KM, LIGHT_KM_S, site_gcrs, sun_gcrs_km
from rsoconsole.sky.times import TimeLike, jd_tt
from rsoconsole.words import NS_PER_DAY, NS_PER_S

SUN_RADIUS_KM = 695_700.0
LIT_SHARE = 0.5
"""Share of the Sun's disc from which a satellite counts as lit."""


def sun_icrs(t_utc_ns: int) -> tuple[float, float]:
    """Astrometric RA and Dec, degrees, of the Sun's centre seen from the Earth's centre."""
    ra_deg, dec_deg = unit_to_direction(sun_gcrs_km(t_utc_ns))
    return float(ra_deg), float(dec_deg)


def sun_altitude_deg(site: Site, t_utc_ns: int) -> float:
    """Altitude of the Sun's centre without refraction; parallax (9 arcsec) left out."""
    altitude_deg, _ = icrs_to_altaz(site, *sun_icrs(t_utc_ns), t_utc_ns)
    return altitude_deg


def lit_fraction(position_gcrs_km: FloatArray, t_utc_ns: TimeLike) -> FloatArray:
    """Share of the solar disc that a satellite sees: 1 in full sunlight, 0 in the umbra.

    ``position_gcrs_km``: (..., 3); one share for each position.
    """
    return lit_fraction_for_sun(sun_gcrs_km(t_utc_ns), position_gcrs_km)


def lit_fraction_for_sun(sun_km: FloatArray, position_gcrs_km: FloatArray) -> FloatArray:
    """Fraction of the solar disc that a satellite sees, for a given position of the Sun.

    Both positions (..., 3), km from the Earth's centre. Overlap of two discs; the Earth is a sphere
    without air. Source: Montenbruck & Gill 2000, 3.4.2.
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
    """Angle at the satellite between the Sun and the site, degrees.

    0 where the site sees the fully lit side, 180 where it sees the dark one.
    """
    to_sun = sun_gcrs_km(t_utc_ns) - position_gcrs_km
    to_site = site_gcrs_km - position_gcrs_km
    cosine = np.sum(to_sun * to_site, axis=-1)
    cosine = cosine / (np.linalg.norm(to_sun, axis=-1) * np.linalg.norm(to_site, axis=-1))
    return np.asarray(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))


def moon_gcrs_km(t_utc_ns: TimeLike) -> FloatArray:
    """Vector (..., 3), km, from the Earth's centre to the Moon's, to some 10 arcsec.

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


PLANETS = MappingProxyType(
    {"Mercury": 1, "Venus": 2, "Mars": 4, "Jupiter": 5, "Saturn": 6, "Uranus": 7, "Neptune": 8}
)
"""Number of each planet in the theory of ``planet_icrs``, by name; 3, the Earth, is left out."""


def planet_icrs(name: str, t_utc_ns: int) -> tuple[float, float]:
    """Astrometric RA and Dec of a planet in degrees, from the Earth's centre, to some 2 arcmin.

    ``name``: a key of ``PLANETS``; KeyError for another. The parallax of a site is below an
    arcminute. Source: Simon et al. 1994, A&A 282, 663, by IAU SOFA (erfa.plan94).
    """
    number = PLANETS[name]
    sun_km = sun_gcrs_km(t_utc_ns)
    light_s = 0.0
    for _ in range(2):
        t = t_utc_ns - round(light_s * NS_PER_S)
        to_planet_km = sun_km + np.asarray(erfa.plan94(*jd_tt(t), number)["p"]) * AU_KM
        light_s = float(np.linalg.norm(to_planet_km)) / LIGHT_KM_S
    ra_deg, dec_deg = unit_to_direction(to_planet_km)
    return float(ra_deg), float(dec_deg)


SCAN_STEP_NS = 600 * NS_PER_S
"""Step of the search, ns: fine enough for nights of a quarter of an hour."""
CROSSING_NS = NS_PER_S // 10


def night_span(site: Site, now_utc_ns: int, twilight_deg: float) -> tuple[int, int] | None:
    """Find the present dark time, or the next that begins within a day: (dusk, dawn) in UTC ns.

    It is dark while the Sun is at ``twilight_deg`` or lower, without refraction. None when it does
    not get dark within a day. The span reaches at most from a day before now to a day after: in a
    polar night it is two days long.
    """

    def is_dark(t_utc_ns: int) -> bool:
        return sun_altitude_deg(site, t_utc_ns) <= twilight_deg

    end_ns = now_utc_ns + NS_PER_DAY
    if is_dark(now_utc_ns):
        dusk_ns = _first(is_dark, False, now_utc_ns, now_utc_ns - NS_PER_DAY)
        dawn_ns = _first(is_dark, False, now_utc_ns, end_ns)
        return dusk_ns or now_utc_ns - NS_PER_DAY, dawn_ns or end_ns
    dusk_ns = _first(is_dark, True, now_utc_ns, end_ns)
    if dusk_ns is None:
        return None
    return dusk_ns, _first(is_dark, False, dusk_ns, dusk_ns + NS_PER_DAY) or dusk_ns + NS_PER_DAY


def _first(is_dark: Callable[[int], bool], wanted: bool, from_ns: int, to_ns: int) -> int | None:
    """Find the instant nearest to ``from_ns``, towards ``to_ns``, at which darkness is ``wanted``.

    Darkness at ``from_ns`` is not checked. None when it never comes.
    """
    step_ns = SCAN_STEP_NS if to_ns > from_ns else -SCAN_STEP_NS
    before_ns = from_ns
    for at_ns in range(from_ns + step_ns, to_ns + step_ns, step_ns):
        if is_dark(at_ns) is wanted:
            break
        before_ns = at_ns
    else:
        return None
    while abs(at_ns - before_ns) > CROSSING_NS:
        middle_ns = (before_ns + at_ns) // 2
        if is_dark(middle_ns) is wanted:
            at_ns = middle_ns
        else:
            before_ns = middle_ns
    return at_ns
