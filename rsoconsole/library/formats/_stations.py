"""Reader of lists of stations: their numbers and places.

A line is ``2701 ME 43.6876 -79.3924 230 Name``: number, letters (or none), latitude and longitude
(degrees, east positive, or with N, S, E, W), height in metres, name. Fields are separated by
blanks, tabs, commas or semicolons; minutes and seconds follow their degrees in fields of their own
(with a letter) or after a colon. A row without a digit, or with names of columns, is a heading:
where it names a place, it says which column is what, in which unit, and whether west is positive.
A place may be a longitude with parallax constants, as the Minor Planet Center lists them.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from rsoconsole.records import Site
from rsoconsole.sky import site_of_itrs_m

_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)", re.ASCII)
_VALUE = r"(?:\d+\.?\d*|\.\d+)"
_ANGLE = re.compile(
    rf"([NSEW]?)([+-]?)({_VALUE})(?:[:°d]({_VALUE})?(?:[:'′m]({_VALUE})?[\"″s]?)?)?([NSEW]?)",
    re.ASCII | re.IGNORECASE,
)
_HEIGHT = re.compile(rf"({_NUMBER.pattern}) ?(m|km|ft)?", re.ASCII | re.IGNORECASE)
_STATION = re.compile(r"\w{1,16}", re.ASCII)
_COLUMNS = {
    "latitude": {"latitude", "lat"},
    "longitude": {"longitude", "lon", "long", "lng"},
    "cos": {"cos"},
    "sin": {"sin"},
    "height": {"elev", "elevation", "height", "alt", "altitude"},
    "station": {"no", "number", "station", "code", "cospar", "site"},
}
"""Words of a heading by what they name; a column is what the first of these says."""
_METRES = {"m": 1.0, "km": 1000.0, "ft": 0.3048, "feet": 0.3048}
_ANGLES = ("latitude", "longitude")
_EQUATOR_M = 6_378_140.0
"""Unit of parallax constants, as the Minor Planet Center states it."""
_USAGE = (
    "a station is '2701 ME 43.6876 -79.3924 230 Name': number, letters, latitude, longitude (east"
    " positive), metres"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Stations:
    """Sites by station number, and the lines that could not be read."""

    sites: dict[str, Site]
    not_used: tuple[str, ...]
    """Each unreadable line with its number and what is wrong."""

    def site(self, station: str) -> Site | None:
        """Site of a station; a number of fewer than four digits is also known with zeros before."""
        return self.sites.get(station) or self.sites.get(_padded(station))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Heading:
    """Columns that a heading names; none where there is no heading of a place."""

    columns: dict[str, int] = field(default_factory=dict)
    negative: frozenset[str] = frozenset()
    """Angles that are positive west or south."""
    metres: float = 1.0
    """Unit of the height, m."""
    fault: str = ""
    """What keeps the rows below it from use."""


def read_stations(path: Path, text: str) -> Stations:
    """Read a list of stations. Lines that begin with #, ! or // are comments."""
    sites: dict[str, Site] = {}
    faults: list[str] = []
    heading = _Heading()
    for number, line in enumerate(text.splitlines(), start=1):
        stripped = line.strip()
        if not stripped or stripped.startswith(("#", "!", "//")):
            continue
        fields = _fields(stripped)
        if (named := _heading(fields)) is not None:
            heading = named if named.columns else heading
            if named.fault and any(character.isdigit() for character in stripped):
                faults.append(f"{path}, line {number}: {named.fault}")
            continue
        try:
            station, site = _station(fields, heading)
        except ValueError as error:
            faults.append(f"{path}, line {number}: {error}")
            continue
        if sites.setdefault(_padded(station), site) != site:
            faults.append(f"{path}, line {number}: station {station} stands elsewhere before")
    return Stations(sites=sites, not_used=tuple(faults))


def _padded(station: str) -> str:
    return station.zfill(4) if station.isdigit() else station


def _fields(line: str) -> list[str]:
    """Fields of a line; with semicolons, tabs or blanks between them a comma may be a decimal's."""
    for separator in (";", "\t", ","):
        if line.count(separator) >= 3:
            parts = [each.strip().strip('"').strip() for each in line.split(separator)]
            parts = [re.sub(r"(?<=\d) +(?=[NSEW]$)", "", each, flags=re.I) for each in parts]
            return [_pointed(each) for each in parts] if separator != "," else parts
    # Parallax constants stand in columns, which a sign may fill.
    return [_pointed(each) for each in re.sub(r"(\.\d+)([+-]\d?\.)", r"\1 \2", line).split()]


def _pointed(text: str) -> str:
    return re.sub(r"^([NSEWnsew+-]*\d+),(\d+)", r"\1.\2", text)


# ---- headings ------------------------------------------------------------------------------


def _heading(fields: Sequence[str]) -> _Heading | None:
    """Columns that a row names; None for a row that is no heading."""
    numbers = sum(_ANGLE.fullmatch(each) is not None for each in fields)
    parts: list[str] = []
    for n, each in enumerate(fields):
        # A unit, or the sense of an angle before or after its name, is part of the name.
        before, after = (_meaning(" ".join(some)) for some in (parts[-1:], fields[n + 1 : n + 2]))
        is_sense = each.lower() in _SENSES
        follows = (
            before in _ANGLES and after not in _ANGLES
            if is_sense
            else each.startswith(("(", "[")) and before
        )
        if parts and (parts[-1].lower() in _SENSES or follows):
            parts[-1] += f" {each}"
        else:
            parts.append(each)
    found: dict[str, list[int]] = {}
    for n, each in enumerate(parts):
        if meaning := _meaning(each):
            found.setdefault(meaning, []).append(n)
    is_place = {"latitude", "longitude"} & found.keys()
    if any(c.isdigit() for each in fields for c in each) and (numbers > 1 or not is_place):
        return None
    if any(c.isdigit() for c in fields[0]) and len(is_place) < 2:
        return None
    return _place_heading(parts, found) if is_place else _Heading()


def _place_heading(parts: Sequence[str], found: dict[str, list[int]]) -> _Heading:
    columns = {"station": 0} | {key: where[0] for key, where in found.items()}
    fault = ""
    is_parallax = "latitude" not in found and {"cos", "sin"} <= found.keys()
    for key in ("longitude", "cos", "sin") if is_parallax else _ANGLES:
        count = len(found.get(key, ()))
        if count != 1:
            fault = f"the heading has {count or 'no'} column{'s' * (count > 1)} of {key}"
    negative = set()
    for key in [key for key in _ANGLES if key in columns]:
        words = _words(parts[columns[key]])
        if {"rad", "radians", "geocentric"} & set(words):
            fault = f"the heading says {parts[columns[key]]!r}: geodetic degrees are read"
        if _is_negative(words, key):
            negative.add(key)
    of_height = _words(parts[columns["height"]]) if "height" in columns else []
    metres = next((_METRES[each] for each in of_height if each in _METRES), 1.0)
    return _Heading(columns=columns, negative=frozenset(negative), metres=metres, fault=fault)


def _words(name: str) -> list[str]:
    """Words and signs of a column's name, small: ``WestLongitude``, ``Lon(W)``, ``lon_w``."""
    return re.findall(r"[a-z]+|[+-]", re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name).lower())


def _meaning(name: str) -> str:
    """What a column of this name holds; empty for what is not read."""
    words = set(_words(name))
    if "name" in words and not words & {"latitude", "longitude"}:
        return ""
    return next((key for key, known in _COLUMNS.items() if words & known), "")


def _is_negative(words: Sequence[str], key: str) -> bool:
    """True where a longitude is positive west, or a latitude south."""
    east, west = ({"e", "east"}, {"w", "west"}) if key == "longitude" else _NORTH_SOUTH
    says_east, says_west = bool(east & set(words)), bool(west & set(words))
    turned = bool({"negative", "neg", "-"} & set(words))
    return says_east != says_west and says_west is not turned


_SENSES = {"north", "south", "east", "west"}
_NORTH_SOUTH = ({"n", "north"}, {"s", "south"})

# ---- rows ----------------------------------------------------------------------------------


def _station(fields: Sequence[str], heading: _Heading) -> tuple[str, Site]:
    """Number and site. Raises ValueError."""
    if heading.fault:
        raise ValueError(heading.fault)
    columns = heading.columns
    fields = _joined_angles(fields)
    if columns:
        if max(n for key, n in columns.items() if key != "height") >= len(fields):
            raise ValueError(f"{len(fields)} fields, fewer than the heading names: {_USAGE}")
        if "latitude" not in columns:
            return _of_parallax([fields[columns[key]] for key in _PARALLAX], heading)
        _refuse_loose_minutes(fields[min(columns[key] for key in _ANGLES) :])
        ordered = [fields[columns[each]] for each in ("station", "latitude", "longitude")]
        height = columns.get("height", len(fields))
        fields = [*ordered, fields[height] if height < len(fields) else "0"]
    else:
        if len(fields) > 1 and _ANGLE.fullmatch(fields[1]) is None:
            fields = [fields[0], *fields[2:]]
        _refuse_loose_minutes(fields[1:])
    if len(fields) < 4 or _STATION.fullmatch(fields[0]) is None:
        raise ValueError(_USAGE)
    latitude, longitude = (
        _angle(text, letters, -1.0 if key in heading.negative else 1.0)
        for text, letters, key in zip(fields[1:3], ("NS", "EW"), _ANGLES, strict=True)
    )
    height_m = _HEIGHT.fullmatch(fields[3])
    if height_m is None:
        raise ValueError(_USAGE)
    if not columns and _is_parallax(fields[2], fields[3]):
        raise ValueError("it has parallax constants: 'Code Long. cos sin Name' is needed above it")
    if abs(latitude) > 90.0 or abs(longitude) > 360.0:
        raise ValueError(f"no place on Earth has {latitude:g}, {longitude:g}")
    unit = (height_m[2] or "").lower()
    metres = float(height_m[1]) * (_METRES[unit] if unit else heading.metres)
    if not (math.isfinite(metres) and abs(metres) < 10_000.0):
        raise ValueError(f"no station stands {metres:g} m high")
    return fields[0], Site(latitude_deg=latitude, longitude_deg=longitude, elevation_m=metres)


_PARALLAX = ("station", "longitude", "cos", "sin")


def _of_parallax(fields: Sequence[str], heading: _Heading) -> tuple[str, Site]:
    """Number and site by a longitude and the parallax constants rho cos phi', rho sin phi'.

    Source: Minor Planet Center, list of observatory codes. Raises ValueError.
    """
    station, longitude, cos, sin = fields
    if _STATION.fullmatch(station) is None or not all(map(_NUMBER.fullmatch, (cos, sin))):
        raise ValueError("a station with parallax constants is '000 0.0000 0.62411 +0.77873 Name'")
    axis, pole = float(cos), float(sin)
    if not 0.98 < math.hypot(axis, pole) < 1.02:
        raise ValueError(f"no place on Earth has parallax constants {cos} and {sin}")
    longitude_deg = _angle(longitude, "EW", -1.0 if "longitude" in heading.negative else 1.0)
    east, north = math.cos(math.radians(longitude_deg)), math.sin(math.radians(longitude_deg))
    return station, site_of_itrs_m(
        _EQUATOR_M * axis * east, _EQUATOR_M * axis * north, _EQUATOR_M * pole
    )


def _is_parallax(cos: str, sin: str) -> bool:
    """True for two numbers of four or more decimals that are of a place near the Earth's radius."""
    return all(re.fullmatch(r"[+-]?[01]?\.\d{4,}", each) for each in (cos, sin)) and (
        0.98 < math.hypot(float(cos), float(sin)) < 1.02
    )


def _refuse_loose_minutes(fields: Sequence[str]) -> None:
    """Raise ValueError where degrees have minutes in fields of their own, without a letter."""
    if len(fields) > 3 and "." not in fields[0] and all(map(_NUMBER.fullmatch, fields[:4])):
        raise ValueError(
            "minutes in fields of their own need N or S, E or W: '52 48 00 N 6 24 00 E'; or write"
            " decimal degrees"
        )


def _joined_angles(fields: Sequence[str]) -> list[str]:
    """The fields, with the parts of an angle and its letter, if they stand apart, in one field."""
    joined: list[str] = []
    at, parts = 0, 0
    while at < len(fields):
        end = _end_of_numbers(fields, at)
        if 1 <= len(joined) <= 3 and _is_letter(fields, end) and _is_run(fields[at:end]):
            joined.append(":".join(fields[at:end]) + fields[end])
            at = end + 1
            continue
        if 1 <= len(joined) <= 3 and _is_letter(fields, at):
            # A letter before its angle: both angles have as many parts.
            end = _end_of_numbers(fields, at + 1)
            parts = end - at - 1 if _is_letter(fields, end) else parts
            if _is_run(fields[at + 1 : at + 1 + parts]):
                joined.append(fields[at] + ":".join(fields[at + 1 : at + 1 + parts]))
                at += 1 + parts
                continue
        joined.append(fields[at])
        at += 1
    return joined


def _end_of_numbers(fields: Sequence[str], at: int) -> int:
    while at < len(fields) and _NUMBER.fullmatch(fields[at]):
        at += 1
    return at


def _is_letter(fields: Sequence[str], at: int) -> bool:
    return at < len(fields) and fields[at].upper() in {"N", "S", "E", "W"}


def _is_run(parts: Sequence[str]) -> bool:
    """True for degrees alone, or with minutes, or with those and seconds."""
    return 1 <= len(parts) <= 3 and not any("." in each for each in parts[:-1])


def _angle(text: str, letters: str, sense: float) -> float:
    """Degrees, positive north or east; ``sense``: of a number without a letter.

    Raises ValueError.
    """
    match = _ANGLE.fullmatch(text)
    letter = "" if match is None else (match[1] or match[6]).upper()
    if match is None or (match[1] and match[6]) or (letter and letter not in letters):
        raise ValueError(_USAGE)
    wholes, minutes, seconds = (float(each or 0.0) for each in match.group(3, 4, 5))
    if minutes >= 60.0 or seconds >= 60.0 or (match[4] and wholes % 1.0):
        raise ValueError(f"{text!r} is no angle of degrees, minutes and seconds")
    value = wholes + minutes / 60.0 + seconds / 3600.0
    if letter == letters[1]:
        return -value
    return (1.0 if letter else sense) * (-value if match[2] == "-" else value)
