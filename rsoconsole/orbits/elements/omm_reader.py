"""The objects of Orbit Mean-Elements Messages, by their fields. Pure.

Source: CCSDS 502.0-B-3 and 505.0-B-3, and what CelesTrak and Space-Track make of them. A message
may carry catalogue numbers that two lines have no room for.
"""

import math
import re
from dataclasses import replace
from typing import Any

from sgp4.api import WGS72, Satrec

from rsoconsole.base import OrbitError
from rsoconsole.orbits.elements.catalogue import CatalogueEntry, entry_of_lines
from rsoconsole.orbits.elements.elements import (
    MAX_BSTAR,
    MAX_REVOLUTIONS_A_DAY,
    OTHER_THEORIES,
    UnusedSet,
    parse_norad_id,
    two_line_sets,
)
from rsoconsole.orbits.elements.omm_forms import TWICE, TWO_LINES, Fields
from rsoconsole.sky import iso_to_utc_ns
from rsoconsole.words import NS_PER_DAY

_ALLOWED = {
    "MEAN_ELEMENT_THEORY": ("SGP4", "SGP/SGP4", "SGP"),
    "TIME_SYSTEM": ("UTC",),
    "REF_FRAME": ("TEME", "TEMEOFDATE"),
    "CENTER_NAME": ("EARTH",),
}
"""Values that SGP4 can be used with, the usual one first; capitals and blanks do not count."""
_NAMES = ("OBJECT_NAME", "NAME", "TLE0", "LINE0", "TLE_LINE0")
_MAX_ALPHA_5 = 339_999
_MAX_COUNT = 10**9
_MIN_EPOCH_NS, _MAX_EPOCH_NS = (iso_to_utc_ns(f"{year}-01-01T00:00") for year in (1957, 2100))
_SGP4_EPOCH_NS = iso_to_utc_ns("1949-12-31T00:00")
_MINUTES = 1440.0


def entry_of_message(place: str, fields: Fields | UnusedSet) -> CatalogueEntry | UnusedSet:
    """Return the object of a message, or why it cannot be used."""
    if isinstance(fields, UnusedSet):
        return replace(fields, place=place)
    known = {
        key.strip().upper(): value.strip() if isinstance(value, str) else value
        for key, value in fields.items()
        if isinstance(key, str) and value is not None
    }
    known = {key: value for key, value in known.items() if value != ""}
    try:
        if TWICE in fields:
            raise ValueError(f"{fields[TWICE]} stands twice")
        found = _of_two_lines(known)
        return _entry(known) if found is None else found
    except KeyError as error:
        reason = f"{error.args[0]} is missing"
    except (ValueError, OverflowError, OrbitError) as error:
        reason = str(error)
    number, name = parse_norad_id(str(known.get("NORAD_CAT_ID", ""))), _name(known)
    return UnusedSet(place=place, norad_id=number, name=name, reason=reason)


def _name(fields: Fields) -> str:
    name = next((str(fields[key]) for key in _NAMES if key in fields), "")
    return name.removeprefix("0 ")[:60]


def _of_two_lines(fields: Fields) -> CatalogueEntry | None:
    """Return the object of two lines that stand among the fields. Raises ValueError, OrbitError."""
    if "MEAN_MOTION" in fields:
        return None
    for first, second in TWO_LINES:
        if first in fields and second in fields:
            found = list(two_line_sets(f"{fields[first]}\n{fields[second]}"))
            if len(found) != 1:
                raise ValueError(f"{first} and {second} are no lines of elements")
            if isinstance(found[0], UnusedSet):
                raise ValueError(f"{found[0].place} of its two: {found[0].reason}")
            return entry_of_lines(replace(found[0], name=_name(fields)))
    return None


def _entry(fields: Fields) -> CatalogueEntry:
    """Raises KeyError for a missing field, ValueError for one that is none."""
    for key, allowed in _ALLOWED.items():
        if re.sub(r"[\s_-]", "", str(fields.get(key, allowed[0]))).upper() not in allowed:
            raise ValueError(f"{key} is {fields[key]}; only {allowed[0]} can be used")
    if _count(fields, "EPHEMERIS_TYPE") in OTHER_THEORIES:
        raise ValueError(f"EPHEMERIS_TYPE is {fields['EPHEMERIS_TYPE']}, not of SGP4")
    norad_id, epoch_utc_ns = _norad_id(fields["NORAD_CAT_ID"]), _epoch_utc_ns(fields)
    revolutions_a_day = _number(fields, "MEAN_MOTION", 0.0, MAX_REVOLUTIONS_A_DAY)
    eccentricity = _number(fields, "ECCENTRICITY", 0.0, 1.0)
    if revolutions_a_day <= 0.0 or eccentricity >= 1.0:
        raise ValueError("no orbit has MEAN_MOTION 0 or ECCENTRICITY 1")
    node_deg, perigee_deg, anomaly_deg = (
        _number(fields, key, -360.0, 360.0)
        for key in ("RA_OF_ASC_NODE", "ARG_OF_PERICENTER", "MEAN_ANOMALY")
    )
    rate, rate_change = (
        _number(fields, key, -1e6, 1e6) if key in fields else 0.0
        for key in ("MEAN_MOTION_DOT", "MEAN_MOTION_DDOT")
    )
    radians_a_minute = 2.0 * math.pi / _MINUTES
    record = Satrec()
    record.sgp4init(
        WGS72,
        "i",
        norad_id if norad_id <= _MAX_ALPHA_5 else 0,
        (epoch_utc_ns - _SGP4_EPOCH_NS) / NS_PER_DAY,
        _number(fields, "BSTAR", -MAX_BSTAR, MAX_BSTAR),
        rate * radians_a_minute / _MINUTES,
        rate_change * radians_a_minute / _MINUTES**2,
        eccentricity,
        math.radians(perigee_deg),
        math.radians(_number(fields, "INCLINATION", 0.0, 180.0)),
        math.radians(anomaly_deg),
        revolutions_a_day * radians_a_minute,
        math.radians(node_deg),
    )
    kind, designator = str(fields.get("CLASSIFICATION_TYPE", "U")), str(fields.get("OBJECT_ID", ""))
    record.classification = kind[0] if kind.isascii() and kind.isalpha() else "U"
    record.intldesg = designator[2:].replace("-", "")[:8] if designator.isascii() else ""
    record.elnum, record.revnum = (
        _count(fields, key) for key in ("ELEMENT_SET_NO", "REV_AT_EPOCH")
    )
    return CatalogueEntry(
        name=str(fields.get("OBJECT_NAME", "")),
        norad_id=norad_id,
        epoch_utc_ns=epoch_utc_ns,
        record=record,
    )


def _float(key: str, value: Any) -> float:
    """Raises ValueError for what is no finite number."""
    try:
        if isinstance(value, bool) or (isinstance(value, str) and "_" in value):
            raise ValueError(value)
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not math.isfinite(number):
        raise ValueError(f"{key} is {str(value)[:40]!r}, not a number")
    return number


def _number(fields: Fields, key: str, least: float, most: float) -> float:
    value = _float(key, fields[key])
    if not least <= value <= most:
        raise ValueError(f"{key} is {value:g}: {least:g} to {most:g} needed")
    return value


def _count(fields: Fields, key: str) -> int:
    """Return a whole number, also one written as 123.0; 0 where it is missing."""
    value = _float(key, fields.get(key, 0))
    if value != int(value) or not 0 <= value <= _MAX_COUNT:
        raise ValueError(f"{key} is {value:g}, not a whole number")
    return int(value)


def _norad_id(value: Any) -> int:
    plain = str(value).removesuffix(".0") if not isinstance(value, bool) else ""
    number = parse_norad_id(plain)
    if number is None:
        raise ValueError(f"NORAD_CAT_ID is {str(value)[:40]!r}, not a catalogue number")
    return number


def _epoch_utc_ns(fields: Fields) -> int:
    """Epoch; Space-Track's older messages have the microseconds apart."""
    text = str(fields["EPOCH"])
    if "EPOCH_MICROSECONDS" in fields and "." not in text:
        text = f"{text.removesuffix('Z')}.{_count(fields, 'EPOCH_MICROSECONDS'):06d}"
    epoch_utc_ns = iso_to_utc_ns(text)
    if not _MIN_EPOCH_NS <= epoch_utc_ns < _MAX_EPOCH_NS:
        raise ValueError(f"EPOCH is {text}: 1957 to 2099 needed")
    return epoch_utc_ns
