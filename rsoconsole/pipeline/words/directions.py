"""Parser of directions that people type for a telescope.

It reads:
- two coordinates in any usual notation (equatorial, ICRS or of date; altitude and azimuth; hour
  angle and declination),
- a satellite of a loaded element file, by name or number,
- a bright star, an object of Messier's list, the Moon, a planet.

Nothing is guessed: an angle that may be in hours or degrees is refused, with both readings.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rsoconsole.orbits import (
    CatalogueEntry,
    ElementSets,
    nearest_epoch_entries,
    object_places,
)
from rsoconsole.pipeline.orbits.elements_used import read_catalogue
from rsoconsole.records import Site
from rsoconsole.sky import (
    MESSIER,
    NAMED_STARS,
    PLANETS,
    altaz_to_icrs,
    icrs_of_hour_angle,
    jnow_to_icrs,
    moon_icrs,
    parse_dec_deg,
    parse_ra_deg,
    parse_sexagesimal,
    planet_icrs,
    wrap_180,
)
from rsoconsole.words import NS_PER_DAY, catalogued_name, element_age_words, format_ra

_DASHES = str.maketrans("−–—‐", "----")
_POINT_FIRST = re.compile(r"(?<![\d.])\.(?=\d)")
_LABEL = re.compile(r"\b(ra|dec|alt|az|ha|el)\b\s*[:=]?\s*|([αδ])\s*[:=]?\s*", re.IGNORECASE)
_KINDS = {"el": "alt", "α": "ra", "δ": "dec"}
_FIELD = re.compile(r"([+-]?)\d+(?:\.\d+)?\s*([hʰd°]?)", re.IGNORECASE)
_DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+")


@dataclass(frozen=True, slots=True, kw_only=True)
class WrittenAngle:
    """Angle as text, not yet parsed."""

    text: str
    kind: str
    """Kind of the angle: ra, dec, alt, az or ha; empty where the text does not state it."""


def split_angles(text: str) -> tuple[WrittenAngle, WrittenAngle]:
    """Split a text into its two angles. Raises ValueError where they are not two.

    The second one begins at its label; else after a comma; else at its sign, or at its number with
    h, d or °; else in the middle of the numbers.
    """
    labels = list(_LABEL.finditer(text))
    kinds = [_kind(match) for match in labels]
    if len(labels) > 2 or len(set(kinds)) != len(kinds):
        raise ValueError(f"{text.strip()!r} names more than two coordinates")
    if len(labels) == 2:
        before = text[: labels[0].start()].strip(" ,")
        first, second = text[labels[0].end() : labels[1].start()], text[labels[1].end() :]
        if before:
            raise ValueError(f"{before!r} stands before the first coordinate's name")
        return _angle(first, kinds[0]), _angle(second, kinds[1])
    if labels and text[: labels[0].start()].strip(" ,"):
        # The second one's name alone.
        return _angle(text[: labels[0].start()], ""), _angle(text[labels[0].end() :], kinds[0])
    values = text[labels[0].end() :] if labels else text
    first, second = _parted(values)
    return _angle(first, kinds[0] if kinds else ""), _angle(second, "")


def has_any_mark(angle: str, *marks: str) -> bool:
    """True where the text of an angle contains one of these letters or signs."""
    return any(mark in angle.lower() for mark in marks)


def number_of_fields(angle: str) -> int:
    """Return how many numbers an angle is written with, such as 3 for 05 32 11."""
    return len(_FIELD.findall(angle))


def _kind(match: re.Match[str]) -> str:
    word = (match.group(1) or match.group(2)).lower()
    return _KINDS.get(word, word)


def _angle(text: str, kind: str) -> WrittenAngle:
    plain = text.strip(" ,")
    if not plain:
        raise ValueError(f"{kind or 'the second angle'} has no value")
    return WrittenAngle(text=plain, kind=kind)


def _parted(values: str) -> tuple[str, str]:
    if _DECIMAL_COMMA.fullmatch(values.strip()):
        raise ValueError(f"{values.strip()!r}: write a point for decimals, and both angles")
    if values.count(",") == 1:
        first, _, second = values.partition(",")
        return first, second
    fields = list(_FIELD.finditer(values))
    begins = [n for n, match in enumerate(fields) if n and (match.group(1) or match.group(2))]
    if len(begins) == 1:
        at = begins[0]
    elif not begins and len(fields) in {2, 4, 6}:
        at = len(fields) // 2
    else:
        raise ValueError(f"{values.strip()!r} is not two angles")
    cut = fields[at].start()
    return values[:cut], values[cut:]


USAGE = (
    "write it like 05 32 11 -4 52 10, 83.05 -4.87, 05:32:11 -04:52:10 of date, alt 47 az 201, "
    "ha -2:30 dec -5, or a name (a satellite, a star, M31, Moon, Jupiter)"
)
_OF_DATE = re.compile(r"\b(of date|jnow|apparent)\b", re.IGNORECASE)
_ICRS = re.compile(r"\b(j2000(\.0)?|icrs|fk5)\b", re.IGNORECASE)
_MESSIER = re.compile(r"(?:m|messier)0*(\d{1,3})")
_LETTERS = re.compile(r"[^\W\d_]")
_UNITS = "hdms°'\"′″: ,\t°ᵈʰᵐˢ+-−."
MANY_NAMES = 4
OLD_DAYS = 14.0
"""Age of elements, days, beyond which a satellite is usually outside a field of one degree."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ParsedDirection:
    """Direction, with a phrase that says how the text was read."""

    words: str
    ra_icrs_deg: float
    dec_icrs_deg: float
    caution: str = ""
    """Reason not to trust the direction; mostly empty."""


class TargetNames:
    """Finds objects by name: satellites of element files, stars, Messier objects, Moon, planets."""

    def __init__(self, sets: ElementSets | None = None) -> None:
        self._sets = sets or ElementSets(entries=())

    @classmethod
    def load(cls, files: Sequence[Path]) -> "TargetNames":
        """Load the satellites of element files. Raises OrbitError naming an unreadable file."""
        return cls(read_catalogue(files))

    def find(self, text: str, site: Site, t_utc_ns: int) -> ParsedDirection:
        """Find the object with that name. Raises ValueError where there is none, or several."""
        wanted = _plain(text)
        fixed = _of_the_sky(wanted, site, t_utc_ns)
        if fixed is not None:
            words, (ra, dec) = fixed
            return ParsedDirection(words=words, ra_icrs_deg=ra, dec_icrs_deg=dec)
        nearest = nearest_epoch_entries(self._sets.entries, t_utc_ns)
        exact = [e for e in nearest if wanted in {_plain(e.name), str(e.norad_id)}]
        like = exact or [e for e in nearest if wanted and _plain(e.name).startswith(wanted)]
        if len(like) == 1:
            return _satellite(like[0], site, t_utc_ns)
        if like:
            names = ", ".join(e.name or str(e.norad_id) for e in like[:MANY_NAMES])
            more = ", …" if len(like) > MANY_NAMES else ""
            raise ValueError(f"{text.strip()!r} may be {names}{more}: write more of it")
        for each in self._sets.not_used:
            if wanted in {_plain(each.name), str(each.norad_id)}:
                raise ValueError(f"the elements of {text.strip()!r} cannot be used: {each.words}")
        loaded = f"{len(nearest)} satellites" if nearest else "any file of catalogue.tle_files"
        raise ValueError(f"{text.strip()!r} is no star known here, nor in {loaded}; {USAGE}")


def _of_the_sky(wanted: str, site: Site, t_utc_ns: int) -> tuple[str, tuple[float, float]] | None:
    """Words and place of a star, an object of Messier's list, the Moon or a planet; else None.

    Raises ValueError for the Sun.
    """
    if wanted in {"sun", "thesun"}:
        raise ValueError("no telescope is sent to the Sun from here")
    for name, place in NAMED_STARS.items():
        if _plain(name) == wanted:
            return f"{name}, a star", place
    listed = _MESSIER.fullmatch(wanted)
    if listed is not None and (number := int(listed[1])) in MESSIER:
        return f"M{number} of Messier's list", MESSIER[number]
    if wanted in {"moon", "themoon"}:
        return "the Moon, as it stands now", moon_icrs(site, t_utc_ns)
    for name in PLANETS:
        if _plain(name) == wanted:
            return f"{name}, a planet", planet_icrs(name, t_utc_ns)
    return None


def parse_direction(
    text: str, site: Site, t_utc_ns: int, names: TargetNames | None = None
) -> ParsedDirection:
    """Parse a typed direction, ICRS. Raises ValueError that says what may be typed.

    ``names``: satellites that may be named; None: none.
    """
    plain = " ".join(text.split())
    if not plain:
        raise ValueError(USAGE)
    is_of_date = _OF_DATE.search(plain) is not None
    bare = _ICRS.sub(" ", _OF_DATE.sub(" ", plain)).translate(_DASHES)
    bare = _POINT_FIRST.sub("0.", bare).strip()
    values = _LABEL.sub(" ", bare)
    has_words = bool(_LETTERS.search("".join(c for c in values if c.lower() not in _UNITS)))
    is_word_first = _LETTERS.match(bare) is not None and _LABEL.match(bare) is None
    is_number = values == bare and bare.isdecimal()
    if has_words or is_word_first or is_number:
        return (names or TargetNames()).find(plain, site, t_utc_ns)
    try:
        first, second = split_angles(bare)
    except ValueError as error:
        raise ValueError(f"{error}: {USAGE}") from error
    words, (ra, dec) = _place_of(first, second, site, t_utc_ns, is_of_date=is_of_date)
    return ParsedDirection(words=words, ra_icrs_deg=ra, dec_icrs_deg=dec)


def _place_of(
    first: WrittenAngle, second: WrittenAngle, site: Site, t_utc_ns: int, *, is_of_date: bool
) -> tuple[str, tuple[float, float]]:
    """Return the reading of two angles, and the direction that they give, ICRS."""
    kinds = {first.kind, second.kind} - {""}
    if kinds <= {"alt", "az"} and kinds:
        return _horizontal(first, second, site, t_utc_ns)
    if "ha" in kinds and kinds <= {"ha", "dec"}:
        if second.kind == "ha" or first.kind == "dec":
            first, second = second, first
        hour_angle_deg, dec_deg = _hour_angle_deg(first.text), parse_dec_deg(second.text)
        place = icrs_of_hour_angle(site, hour_angle_deg, dec_deg, t_utc_ns)
        return "hour angle and declination of date", place
    if not kinds <= {"ra", "dec"}:
        raise ValueError(f"{' and '.join(sorted(kinds))} do not go together: {USAGE}")
    if first.kind == "dec" or second.kind == "ra":
        first, second = second, first
    is_degrees = has_any_mark(first.text, "°", "d")
    _refuse_ambiguous(first.text)
    ra = _ra_of_degrees(first.text) if is_degrees else parse_ra_deg(first.text)
    dec = parse_dec_deg(second.text)
    if is_of_date:
        return "RA and Dec of date", jnow_to_icrs(ra, dec, t_utc_ns)
    is_degrees |= number_of_fields(first.text) == 1 and not has_any_mark(first.text, "h", "ʰ")
    return "RA and Dec, ICRS, in degrees" if is_degrees else "RA and Dec, ICRS", (ra, dec)


def _horizontal(
    first: WrittenAngle, second: WrittenAngle, site: Site, t_utc_ns: int
) -> tuple[str, tuple[float, float]]:
    is_turned = first.kind == "az" or second.kind == "alt"
    alt_text, az_text = (second, first) if is_turned else (first, second)
    alt, az = parse_dec_deg(alt_text.text), parse_sexagesimal(az_text.text)
    if alt < 0.0:
        raise ValueError(f"altitude {alt:g} is below the horizon")
    if not -360.0 <= az <= 360.0:
        raise ValueError(f"azimuth {az:g} is beyond a full turn")
    place = altaz_to_icrs(site, alt, az % 360.0, t_utc_ns)
    return "altitude and azimuth, as it stands now", place


def _refuse_ambiguous(text: str) -> None:
    """Raise ValueError for one bare number that may be hours or degrees, with both readings."""
    if number_of_fields(text) != 1 or has_any_mark(text, "°", "d", "h", "ʰ"):
        return
    value = parse_sexagesimal(text)
    if not 0.0 < value < 24.0:
        return
    number = text.strip()
    raise ValueError(
        f"{number} may be hours (α {format_ra(15.0 * value, 0)}) or degrees"
        f" (α {format_ra(value, 0)}): write {number}h or {number}d"
    )


def _ra_of_degrees(text: str) -> float:
    ra_deg = parse_sexagesimal(text)
    if not 0.0 <= ra_deg < 360.0:
        raise ValueError(f"{text!r}: right ascension lies between 0 and 360 degrees")
    return ra_deg


def _hour_angle_deg(text: str) -> float:
    """Parse an hour angle: in hours, unless it is marked as degrees."""
    value = parse_sexagesimal(text)
    degrees = value if has_any_mark(text, "°", "d") else 15.0 * value
    if abs(degrees) > 180.0:
        raise ValueError(f"{text!r}: an hour angle lies within 12 h; write ° behind degrees")
    return wrap_180(degrees)


def _satellite(elements: CatalogueEntry, site: Site, t_utc_ns: int) -> ParsedDirection:
    places = object_places(elements, site, np.array([t_utc_ns]))
    age_days = (t_utc_ns - elements.epoch_utc_ns) / NS_PER_DAY
    ra, dec = float(places.ra_icrs_deg[0]), float(places.dec_icrs_deg[0])
    if not np.isfinite(ra):
        raise ValueError(f"{elements.name} has no place: its elements are no good at this instant")
    name = catalogued_name(elements.name, elements.norad_id)
    return ParsedDirection(
        words=f"{name}, elements {element_age_words(age_days)}",
        ra_icrs_deg=ra,
        dec_icrs_deg=dec,
        caution=f"elements {element_age_words(age_days)}" if abs(age_days) > OLD_DAYS else "",
    )


def _plain(name: str) -> str:
    """Return the letters and digits alone, by which names are compared."""
    return "".join(c for c in name.lower() if c.isalnum())
