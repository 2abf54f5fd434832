"""Where a frame was taken, by its header.

Longitudes are east positive (FITS standard 4.0, OBSGEO-L; IAU) unless the value has a W; 180 to 360
is east. OBJCTALT, ALTITUDE, ELEVATIO and their like are not read: they are the telescope's.
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from rsoconsole.instruments.frames.header_cards import DEGREES, METRES, Cards, written_number
from rsoconsole.records import Site
from rsoconsole.sky import ground_distance_km, parse_sexagesimal, site_of_itrs_m, wrap_180

SAME_PLACE_KM = 1.0
"""Distance up to which two places count as the same: rounded to the arcminute they differ by it."""
_ELEVATION_M = (-430.0, 9000.0)
_PLACES: tuple[tuple[str, tuple[str, ...], tuple[str, ...]], ...] = (
    ("SITELAT", ("SITELONG", "SITELON", "SITELNG"), ("SITEELEV", "SITEALT")),
    ("SITE-LAT", ("SITE-LON",), ("SITE-ALT", "SITE-ELV")),
    ("OBSGEO-B", ("OBSGEO-L",), ("OBSGEO-H",)),
    ("LAT-OBS", ("LONG-OBS", "LON-OBS"), ("ALT-OBS", "ELEV-OBS")),
    ("OBSLAT", ("OBSLONG", "OBSLON"), ("OBSELEV",)),
    ("OBS-LAT", ("OBS-LONG", "OBS-LON"), ("OBS-ELEV",)),
    ("OBS_LAT", ("OBS_LONG", "OBS_LON"), ("OBS_ELEV",)),
    ("GEOLAT", ("GEOLON", "GEOLONG"), ("GEOELEV",)),
    ("LATITUDE", ("LONGITUD", "LONGITUDE", "LONGITDE"), ("HEIGHT",)),
    ("ESO TEL GEOLAT", ("ESO TEL GEOLON",), ("ESO TEL GEOELEV",)),
    ("GPS_LAT", ("GPS_LON", "GPS_LONG"), ("GPS_ALT",)),
)
"""Keys of latitude, longitude and elevation, the most trusted first."""
_EITHER_WAY = ("OBS-LONG", "OBS-LON", "OBS_LONG", "OBS_LON")
"""Longitudes that observatories write east or west positive: DECam's was 70.8 for 70.8 W."""
_GEOCENTRIC = ("OBSGEO-X", "OBSGEO-Y", "OBSGEO-Z")
_LETTER = r"north|south|east|west|[NSEW]"
_HEMISPHERE = re.compile(rf"({_LETTER})?[\s,]*(.*?)[\s,]*({_LETTER})?", re.IGNORECASE)
_SECONDS_MARK = re.compile(r".*m\s*[0-9.]+s", re.IGNORECASE)
_DEGREE_WORD = re.compile(r"\s*deg(?:ree)?s?\b\.?", re.IGNORECASE)
_LOST_MARK = re.compile(r"(?<=[0-9])\?{1,3}(?![.,])")
"""What is left of a degree sign, or of a sign for minutes or seconds: FITS has only ASCII."""
_MIRRORED_DEG = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class HeaderSite:
    """The place that a header states."""

    site: Site | None
    """None where it states none, or none that can be."""
    words: str
    """Its cards, and what they lack."""
    notes: tuple[str, ...]
    """Sentences on values that are not used."""


def header_site(header: Mapping[str, Any]) -> HeaderSite:
    """Return the place where a frame was taken, by its header."""
    cards = Cards(header)
    found = list(_sites(cards))
    if not found:
        return HeaderSite(site=None, words="", notes=tuple(cards.notes))
    # Of two with opposite longitudes the standard's own is east positive without doubt.
    keys, lack, site = next(
        (one for one in found if _is_of_standard(one) and _is_mirrored(one, found[0])), found[0]
    )
    for other_keys, _, other in found:
        apart_km = ground_distance_km(site, other)
        if apart_km <= SAME_PLACE_KM:
            continue
        why = ""
        if _is_mirrored((keys, "", site), (other_keys, "", other)):
            why = ", as one longitude has the opposite sign of the other (east is positive)"
        cards.note(f"{other_keys} are {apart_km:.0f} km from {keys}{why}: {keys} are used")
    return HeaderSite(site=site, words=f"{keys}{lack}", notes=tuple(cards.notes))


_Place = tuple[str, str, Site]
"""Keys, what they lack, and the place."""


def _is_of_standard(place: _Place) -> bool:
    return place[0].startswith("OBSGEO")


def _is_mirrored(one: _Place, other: _Place) -> bool:
    """Whether two places differ by the sign of their longitudes."""
    sum_deg = wrap_180(one[2].longitude_deg + other[2].longitude_deg)
    off_deg = one[2].latitude_deg - other[2].latitude_deg
    is_apart = ground_distance_km(one[2], other[2]) > SAME_PLACE_KM
    return is_apart and max(abs(sum_deg), abs(off_deg)) <= _MIRRORED_DEG


def _sites(cards: Cards) -> Iterator[_Place]:
    for lat_key, lon_keys, elevation_keys in _PLACES:
        lon_key = next((key for key in lon_keys if cards.value(key) is not None), lon_keys[0])
        stated = [key for key in (lat_key, lon_key) if cards.value(key) is not None]
        if len(stated) == 1:
            cards.not_used(stated[0], f"there is no {lon_key if stated[0] == lat_key else lat_key}")
        if len(stated) < 2:
            continue
        latitude_deg = _angle_deg(cards, lat_key, "a latitude of -90 to 90 deg", "NS", 90.0)
        longitude_deg = _angle_deg(cards, lon_key, "a longitude of -180 to 360 deg", "EW", 360.0)
        if latitude_deg is None or longitude_deg is None:
            continue
        if latitude_deg == 0.0 and longitude_deg == 0.0:
            cards.note(f"{lat_key} and {lon_key} are both 0 and not used: no site is set there")
            continue
        elevation_m = next(
            (each for key in elevation_keys if (each := _elevation_m(cards, key)) is not None), None
        )
        yield (
            f"{lat_key} and {lon_key}",
            " (no elevation: 0 m)" * (elevation_m is None),
            Site(
                latitude_deg=latitude_deg,
                longitude_deg=wrap_180(longitude_deg),
                elevation_m=elevation_m or 0.0,
            ),
        )
    yield from _geocentric(cards)


def _elevation_m(cards: Cards, key: str) -> float | None:
    return cards.number(key, "an elevation of -430 to 9000 m", *_ELEVATION_M, units=METRES)


def _geocentric(cards: Cards) -> Iterator[_Place]:
    """Place by its coordinates in the frame of the Earth (ITRS)."""
    missing = [key for key in _GEOCENTRIC if cards.value(key) is None]
    if missing:
        stated = [key for key in _GEOCENTRIC if key not in missing]
        if stated:
            cards.note(f"{' and '.join(stated)} not used: there is no {' and no '.join(missing)}")
        return
    place_m = [cards.number(key, "a coordinate in m", units=METRES) for key in _GEOCENTRIC]
    x_m, y_m, z_m = (0.0 if each is None else each for each in place_m)
    site = site_of_itrs_m(x_m, y_m, z_m)
    if None in place_m or not _ELEVATION_M[0] <= site.elevation_m <= _ELEVATION_M[1]:
        cards.note("OBSGEO-X, OBSGEO-Y and OBSGEO-Z are no place on the ground and not used")
        return
    yield "OBSGEO-X, OBSGEO-Y and OBSGEO-Z", "", site


def _angle_deg(
    cards: Cards, key: str, what: str, hemispheres: str, limit_deg: float
) -> float | None:
    """Degrees of a latitude or longitude: a number, sexagesimal text, with N, S, E or W."""
    value, unit = cards.value(key), cards.unit(key)
    letter = ""
    number = written_number(value, DEGREES)
    if unit.upper() in tuple(hemispheres) and number is not None:
        value, unit, number = f"{number.value:f} {unit}", "", None
    if unit and number is not None:
        if unit not in DEGREES:
            cards.not_used(key, f"its comment has the unit [{unit}], which is not read")
            return None
        number = written_number(value, DEGREES, DEGREES[unit])
    angle_deg = None if number is None else float(number.value)
    if isinstance(value, str) and number is None:
        angle_deg, letter = _spelt_angle_deg(value.strip(), hemispheres)
    if key in _EITHER_WAY and not letter:
        cards.not_used(key, "observatories write it east or west positive; E or W would say which")
        return None
    lowest_deg = -180.0 if limit_deg > 180.0 else -limit_deg
    if angle_deg is None or not lowest_deg <= angle_deg <= limit_deg:
        cards.not_used(key, f"it is not {what}")
        return None
    return angle_deg


def _spelt_angle_deg(text: str, hemispheres: str) -> tuple[float | None, str]:
    """Degrees of a text, None where it is no angle, and the letter of its hemisphere."""
    letter = ""
    text = _LOST_MARK.sub("d", _DEGREE_WORD.sub("d", text), count=1)
    text = _LOST_MARK.sub(" ", text)
    if not _SECONDS_MARK.fullmatch(text):
        parts = _HEMISPHERE.fullmatch(text)
        if parts is not None and (parts[1] is None or parts[3] is None):
            letter, text = (parts[1] or parts[3] or "")[:1].upper(), parts[2]
    if (letter and letter not in hemispheres) or "h" in text.lower():
        return None, letter
    try:
        angle_deg = parse_sexagesimal(text.replace(",", "."))
    except ValueError:
        return None, letter
    if letter in ("S", "W"):
        return -abs(angle_deg), letter
    return (None if letter and angle_deg < 0.0 else angle_deg), letter


def site_words(site: Site) -> str:
    """Return a place in words: latitude, longitude, elevation."""
    return f"{site.latitude_deg:.4f} {site.longitude_deg:+.4f} deg, {site.elevation_m:.0f} m"
