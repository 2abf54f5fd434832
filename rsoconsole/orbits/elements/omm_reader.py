"""Orbit Mean-Elements Messages, read as JSON, XML, CSV or KVN. Pure.

Source: CCSDS 502.0-B-3 and 505.0-B-3, and what CelesTrak and Space-Track make of them. A message
may carry catalogue numbers that two lines have no room for. A damaged message costs itself alone.
"""

import csv
import json
import math
import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any
from xml.parsers import expat

from sgp4.api import WGS72, Satrec

from rsoconsole.base import TOO_DEEP, OrbitError
from rsoconsole.orbits.elements.catalogue import CatalogueEntry
from rsoconsole.orbits.elements.elements import (
    MAX_BSTAR,
    MAX_REVOLUTIONS_A_DAY,
    OTHER_THEORIES,
    UnusedSet,
    parse_norad_id,
)
from rsoconsole.sky import iso_to_utc_ns
from rsoconsole.words import NS_PER_DAY

Fields = Mapping[str, Any]
Message = tuple[str, Fields | str]
"""Place in the text, and a message's fields, or the reason why they cannot be read."""

_SGP4_THEORIES = {"SGP4", "SGP/SGP4", "SGP"}
_MAX_ALPHA_5 = 339_999
_MAX_COUNT = 10**9
_MIN_EPOCH_NS, _MAX_EPOCH_NS = (iso_to_utc_ns(f"{year}-01-01T00:00") for year in (1957, 2100))
_SGP4_EPOCH_NS = iso_to_utc_ns("1949-12-31T00:00")
_MINUTES = 1440.0
_KEYS = {"EPOCH", "MEAN_MOTION", "ECCENTRICITY", "NORAD_CAT_ID"}
"""Some keys that every message has."""


def entry_of_message(place: str, fields: Fields | str) -> CatalogueEntry | UnusedSet:
    """Return the object of a message, or why it cannot be used."""
    if isinstance(fields, str):
        return UnusedSet(place=place, reason=fields)
    known = {
        key.strip().upper(): value.strip() if isinstance(value, str) else value
        for key, value in fields.items()
        if isinstance(key, str) and value is not None
    }
    known = {key: value for key, value in known.items() if value != ""}
    try:
        return _entry(known)
    except KeyError as error:
        reason = f"{error.args[0]} is missing"
    except (ValueError, OverflowError) as error:
        reason = str(error)
    number, name = parse_norad_id(str(known.get("NORAD_CAT_ID", ""))), known.get("OBJECT_NAME", "")
    return UnusedSet(place=place, norad_id=number, name=str(name)[:60], reason=reason)


def _entry(fields: Fields) -> CatalogueEntry:
    """Raises KeyError for a missing field, ValueError for one that is none."""
    for key, allowed in (("MEAN_ELEMENT_THEORY", _SGP4_THEORIES), ("TIME_SYSTEM", {"UTC"})):
        if str(fields.get(key, min(allowed))).upper() not in allowed:
            raise ValueError(f"{key} is {fields[key]}; only {min(allowed)} can be used")
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


# ---- the forms -----------------------------------------------------------------------------


def has_keys_of_omm(keys: Iterable[object], least: int = 1) -> bool:
    """True where ``least`` of the keys that every message has are among these, in any case."""
    return len(_KEYS & {str(key).strip().strip('"').upper() for key in keys}) >= least


_BETWEEN_OBJECTS = " \t\n\f,[]"


def json_messages(text: str) -> Iterator[Message]:
    """Yield the messages of JSON: a list, one object, or such within others.

    Objects before and after a damaged one are read. Raises OrbitError for brackets that are nested
    too deeply.
    """
    decode = json.JSONDecoder().raw_decode
    number, at = 1, 0
    while True:
        start = text.find("{", at)
        between = (text[at:start] if start >= 0 else text[at:]).strip(_BETWEEN_OBJECTS)
        if between:
            yield f"object {number}", f"no OMM in JSON: {between[:40]!r}"
            number += 1
        if start < 0:
            return
        try:
            value, at = decode(text, start)
        except RecursionError as error:
            raise OrbitError(f"no OMM in JSON: {TOO_DEEP}") from error
        except ValueError as error:
            yield f"object {number}", f"no OMM in JSON: {error}"
            number += 1
            following = text.find("{", start + 1)
            at = following if following >= 0 else len(text)
            continue
        for each in _flat_objects(value):
            yield f"object {number}", each
            number += 1


def _flat_objects(value: Any) -> Iterator[Fields | str]:
    waiting = [value]
    while waiting:
        each = waiting.pop()
        inner = each if isinstance(each, list) else []
        if isinstance(each, dict):
            if has_keys_of_omm(each):
                yield each
                continue
            inner = [one for one in each.values() if isinstance(one, dict | list)]
        if not inner:
            yield f"no elements, but: {text_of_values(each)[:200]}"
        waiting += reversed(inner)


def text_of_values(value: Any) -> str:
    """Return the texts within a JSON value, in order, as one."""
    if isinstance(value, dict | list):
        inner = value.values() if isinstance(value, dict) else value
        return ": ".join(filter(None, map(text_of_values, inner)))
    return value if isinstance(value, str) else ""


_PREFIX = r"(?:[\w.-]+:)?"
_XML_UNITS = tuple(
    (re.compile(rf"<{_PREFIX}{tag}(?=[\s>])"), re.compile(rf"</{_PREFIX}{tag}\s*>"))
    for tag in ("segment", "omm")
)
_XML_KEY = re.compile(rf"<{_PREFIX}(?:EPOCH|MEAN_MOTION|NORAD_CAT_ID)[\s>]")


def xml_messages(text: str) -> Iterator[Message]:
    """Yield the messages of XML, with any namespace or prefix, alone or in an NDM."""
    number, after = 1, 0
    first, last = next((each for each in _XML_UNITS if each[0].search(text)), _XML_UNITS[0])
    starts = [each.start() for each in first.finditer(text)]
    for start, end in zip([*starts, len(text)], [*starts[1:], len(text), len(text)], strict=True):
        if _XML_KEY.search(text, after, start):
            yield f"object {number}", "no OMM in XML: its first tag cannot be read"
            number += 1
        if start < len(text):
            close = last.search(text, start, end)
            after = close.end() if close else end
            yield f"object {number}", _xml_fields(text[start:after])
            number += 1


def _xml_fields(text: str) -> Fields | str:
    """Return the fields of one message, or why they cannot be read.

    Without its declarations a prefix means nothing to a parser that knows namespaces; this one
    does not.
    """
    fields: dict[str, str] = {}
    texts: list[str] = []
    twice: list[str] = []

    def end(tag: str) -> None:
        key, value = tag.rpartition(":")[2], "".join(texts).strip()
        if fields.setdefault(key, value) != value and key in _READ:
            twice.append(key)
        texts.clear()

    parser = expat.ParserCreate()
    parser.CharacterDataHandler = texts.append
    parser.EndElementHandler = end
    try:
        parser.Parse(text, True)
    except (expat.ExpatError, ValueError) as error:
        return f"no OMM in XML: {error}"
    return f"{twice[0]} stands twice" if twice else fields


def csv_messages(text: str) -> Iterator[Message]:
    """Yield the messages of a table whose first line names its columns."""
    names: list[str] = []
    separator = ","
    for number, line in enumerate(text.split("\n"), start=1):
        if not line.strip():
            continue
        if not names:
            separator = max(",;\t", key=line.count)
            names = _cells(line, separator)
            continue
        cells = _cells(line, separator)
        if len(cells) < len(names) or any(cells[len(names) :]):
            yield f"line {number}", f"{len(cells)} columns found, {len(names)} needed"
        elif cells != names:  # the head of a file that was put behind another
            yield f"line {number}", dict(zip(names, cells, strict=False))


def _cells(line: str, separator: str) -> list[str]:
    if '"' in line:
        try:
            line_cells = next(csv.reader([line], delimiter=separator))
        except csv.Error:
            line_cells = []
    else:
        line_cells = line.split(separator)
    return [each.strip() for each in line_cells]


_KVN_LINE = re.compile(r"([A-Za-z]\w*)\s*=\s*(.*)")
_KVN_UNIT = re.compile(r"([-+.\d]\S*)\s*\[[^\]]*\]")
_KVN_FIRST = ("CCSDS_OMM_VERS", "CREATION_DATE", "ORIGINATOR", "OBJECT_NAME")
_READ = _KEYS | {"INCLINATION", "RA_OF_ASC_NODE", "ARG_OF_PERICENTER", "MEAN_ANOMALY", "BSTAR"}


def kvn_messages(text: str) -> Iterator[Message]:
    """Yield the messages of lines KEY = value, one after another."""
    fields: dict[str, str] = {}
    place, fault, before = "", "", ""
    torn: tuple[str, str] | None = None
    """Damaged line, and what is wrong with it, of which the message is not known yet."""
    for number, raw in enumerate(text.split("\n"), start=1):
        line = raw.strip()
        if not line and torn and fields:
            fault, torn = fault or torn[1], None
        if not line or line == before or line.upper().startswith("COMMENT"):
            continue
        before = line
        found = _KVN_LINE.fullmatch(line)
        if found is None:
            words = f"{line[:40]!r} in line {number} is not KEY = value"
            torn = torn or (f"line {number}", words)
            continue
        key = found[1].upper()
        if key in _KVN_FIRST and key in fields:
            if torn and key == _KVN_FIRST[0]:
                fault, torn = fault or torn[1], None
            yield place, fault or fields
            fields, place, fault = {}, "", ""
        if torn:  # before another than the first key it was the first line
            fault, torn = fault or torn[1], None
        place = place or f"line {number}"
        unit = _KVN_UNIT.fullmatch(found[2])
        value = unit[1] if unit else found[2]
        if fields.setdefault(key, value) != value and key in _READ:
            fault = fault or f"{key} stands twice"
    if fields:
        yield place, fault or fields
    if torn:
        yield torn
