"""Reader of lists of stations: their numbers and places.

A line is ``2701 ME 43.6876 -79.3924 230 Name``: number, letters (or none), latitude and longitude
(degrees, east positive, or with N, S, E, W), height in metres, name. Fields are separated by
blanks, tabs, commas or semicolons. A row without a digit is a heading; where it names columns of
latitude and longitude, it says which is which.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rsoconsole.records import Site

_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)", re.ASCII)
_ANGLE = re.compile(r"([NSEW]?)([+-]?(?:\d+\.?\d*|\.\d+))°?([NSEW]?)", re.ASCII | re.IGNORECASE)
_STATION = re.compile(r"\w{1,16}", re.ASCII)
_COLUMNS = {
    "station": {"no", "number", "station", "code", "cospar", "site"},
    "latitude": {"latitude", "lat", "lat_deg", "latitude_deg"},
    "longitude": {"longitude", "lon", "long", "lon_deg", "longitude_deg"},
    "height": {"elev", "elevation", "height", "alt", "altitude", "alt_m", "elev_m", "height_m"},
}
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


def read_stations(path: Path, text: str) -> Stations:
    """Read a list of stations. Lines that begin with #, ! or // are comments."""
    sites: dict[str, Site] = {}
    faults: list[str] = []
    columns: dict[str, int] = {}
    for number, line in enumerate(text.splitlines(), start=1):
        stripped = line.strip()
        if not stripped or stripped.startswith(("#", "!", "//")):
            continue
        fields = _fields(stripped)
        if not any(character.isdigit() for character in stripped):
            columns = _named_columns(fields) or columns
            continue
        try:
            station, site = _station(fields, columns)
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
            return [_pointed(each) for each in parts] if separator != "," else parts
    return [_pointed(each) for each in line.split()]


def _pointed(field: str) -> str:
    return re.sub(r"^([NSEWnsew+-]*\d+),(\d+)", r"\1.\2", field)


def _named_columns(names: Sequence[str]) -> dict[str, int]:
    """Columns that a heading names; empty where it lacks latitude or longitude."""
    plain = [re.sub(r"[^a-z]+", "_", each.lower()).strip("_") for each in names]
    found: dict[str, int] = {}
    for what, known in _COLUMNS.items():
        of_it = [n for n, name in enumerate(plain) if name in known]
        if of_it:
            found[what] = of_it[0]
    return {"station": 0, **found} if {"latitude", "longitude"} <= found.keys() else {}


def _station(fields: Sequence[str], columns: dict[str, int]) -> tuple[str, Site]:
    """Number and site. Raises ValueError."""
    if columns and max(columns.values()) < len(fields):
        ordered = [fields[columns[each]] for each in ("station", "latitude", "longitude")]
        height = fields[columns["height"]] if "height" in columns else "0"
        fields = [*ordered, height]
    elif len(fields) > 1 and _ANGLE.fullmatch(fields[1]) is None:
        fields = [fields[0], *fields[2:]]
    fields = _with_hemispheres(fields)
    if len(fields) < 4 or _STATION.fullmatch(fields[0]) is None:
        raise ValueError(_USAGE)
    latitude, longitude = _angle(fields[1], "NS"), _angle(fields[2], "EW")
    height_m = re.fullmatch(rf"({_NUMBER.pattern})m?", fields[3])
    if height_m is None:
        raise ValueError(_USAGE)
    if abs(latitude) > 90.0 or abs(longitude) > 360.0:
        raise ValueError(f"no place on Earth has {latitude:g}, {longitude:g}")
    metres = float(height_m[1])
    if not (math.isfinite(metres) and abs(metres) < 10_000.0):
        raise ValueError(f"no station stands {metres:g} m high")
    return fields[0], Site(latitude_deg=latitude, longitude_deg=longitude, elevation_m=metres)


def _with_hemispheres(fields: Sequence[str]) -> list[str]:
    """The fields, with letters of a hemisphere that stand by themselves joined to their angles."""
    joined: list[str] = []
    for field in fields:
        before = joined[-1] if joined else ""
        is_letter = len(joined) in {2, 3} and field.upper() in {"N", "S", "E", "W"}
        if is_letter and _NUMBER.fullmatch(before):
            joined[-1] = before + field
        else:
            joined.append(field)
    return joined


def _angle(field: str, letters: str) -> float:
    """Degrees, positive north or east. Raises ValueError."""
    match = _ANGLE.fullmatch(field)
    letter = "" if match is None else (match[1] or match[3]).upper()
    if match is None or (match[1] and match[3]) or (letter and letter not in letters):
        raise ValueError(_USAGE)
    value = float(match[2])
    return -abs(value) if letter == letters[1] else value
