"""Forms in which Orbit Mean-Elements Messages come: JSON, XML, CSV and KVN. Pure.

Each is taken apart into messages, of which a damaged one costs itself alone.
"""

import csv
import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any
from xml.parsers import expat

from rsoconsole.base import TOO_DEEP, OrbitError
from rsoconsole.orbits.elements.elements import UnusedSet, parse_norad_id

Fields = Mapping[str, Any]
Message = tuple[str, Fields | UnusedSet]
"""Place in the text, and a message's fields, or why they cannot be read."""

_KEYS = {"EPOCH", "MEAN_MOTION", "ECCENTRICITY", "NORAD_CAT_ID"}
"""Some keys that every message has."""
_READ = _KEYS | {"INCLINATION", "RA_OF_ASC_NODE", "ARG_OF_PERICENTER", "MEAN_ANOMALY", "BSTAR"}
TWO_LINES = (("TLE1", "TLE2"), ("LINE1", "LINE2"), ("TLE_LINE1", "TLE_LINE2"))
"""Keys of two lines that stand in JSON or a table."""
TWICE = " stands twice"
"""Key, of no message, of the name of one that stands twice."""


_NUMBER_IN = re.compile(r"NORAD_CAT_ID\W{0,3}[:=>]\s*\W?(\w+)", re.IGNORECASE)
_NAME_IN = re.compile(r"OBJECT_NAME\W{0,3}[:=>]\s*\"?([^\"<>=\n]+)", re.IGNORECASE)


def _damaged(reason: str, text: str) -> UnusedSet:
    """Return a message that cannot be read, with the number and name that its text has."""
    number, name = _NUMBER_IN.search(text), _NAME_IN.search(text)
    return UnusedSet(
        norad_id=None if number is None else parse_norad_id(number[1]),
        name="" if name is None else name[1].strip()[:60],
        reason=reason,
    )


def has_two_lines(keys: Iterable[object]) -> bool:
    """True where these keys hold two lines of elements, in any case."""
    plain = {str(key).strip().strip('"').upper() for key in keys}
    return any(plain.issuperset(both) for both in TWO_LINES)


def has_keys_of_omm(keys: Iterable[object], least: int = 1) -> bool:
    """True where ``least`` of the keys that every message has are among these, in any case."""
    return len(_KEYS & {str(key).strip().strip('"').upper() for key in keys}) >= least


_BETWEEN_OBJECTS = " \t\n\f,[]}"
_OPENING = re.compile(r"[\s\[{]*\{")
_SHORT_NUMBER = re.compile(r"([+-]?)(\.?\d)")
_WINDOW, _MAX_MENDED = 1 << 14, 16
_CUT_OFF = 16
"""Characters before the end of a window within which a fault may be the window's."""


def _json_object(pairs: Sequence[tuple[str, Any]]) -> Fields:
    fields = dict(pairs)
    if len(fields) < len(pairs):
        first: dict[str, Any] = {}
        for key, value in pairs:
            if first.setdefault(key, value) != value and key.strip().upper() in _READ:
                fields[TWICE] = key
    return fields


_decode = json.JSONDecoder(object_pairs_hook=_json_object).raw_decode


def json_messages(text: str) -> Iterator[Message]:
    """Yield the messages of JSON: a list, one object, or such within others.

    Objects before and after a damaged one are read. Raises OrbitError for brackets that are nested
    too deeply.
    """
    number, at, is_sound = 1, 0, True
    while True:
        start = text.find("{", at)
        between = (text[at:start] if start >= 0 else text[at:]).strip(_BETWEEN_OBJECTS)
        if between:
            yield f"object {number}", _damaged(f"no OMM in JSON: {between[:40]!r}", between)
            number += 1
        if start < 0:
            return
        try:
            value, at = _decode(text, start) if is_sound else _decoded(text, start)
        except RecursionError as error:
            raise OrbitError(f"no OMM in JSON: {TOO_DEEP}") from error
        except json.JSONDecodeError as error:
            if is_sound:  # a fault costs the time of all text before it, but in a window
                is_sound, at = False, start
                continue
            opened = _OPENING.match(text, start)
            following = text.find("{", start + 1 if opened is None else opened.end())
            at = following if following >= 0 else len(text)
            if following < 0 or start + error.pos <= following:  # else that object has the fault
                shown = error.doc[error.pos : error.pos + 20]
                reason = f"no OMM in JSON: {error.msg.removesuffix(' at')} at {shown!r}"
                yield f"object {number}", _damaged(reason, text[start:at][:_WINDOW])
                number += 1
            continue
        for each in _flat_objects(value):
            yield f"object {number}", each
            number += 1


def _decoded(text: str, start: int) -> tuple[Any, int]:
    """Return the value that starts there, and its end; numbers like .5 and +5 are read too.

    Raises RecursionError, and JSONDecodeError with a place from ``start`` on.
    """
    size = _WINDOW
    while True:
        window, added, mended = text[start : start + size], 0, 0
        while True:
            try:
                value, end = _decode(window, 0)
                return value, start + end - added
            except json.JSONDecodeError as error:
                is_cut = error.pos > len(window) - _CUT_OFF or error.msg.startswith("Unterminated")
                if is_cut and start + size < len(text):
                    break
                short = _SHORT_NUMBER.match(window, error.pos)
                if short is None or mended == _MAX_MENDED or error.msg != "Expecting value":
                    raise
                sign, digit = short[1].replace("+", ""), short[2].replace(".", "0.")
                window = f"{window[: error.pos]}{sign}{digit}{window[short.end() :]}"
                added += len(sign + digit) - len(short[0])
                mended += 1
        size *= 4


def _flat_objects(value: Any) -> Iterator[Fields | UnusedSet]:
    waiting = [value]
    while waiting:
        each = waiting.pop()
        inner = each if isinstance(each, list) else []
        if isinstance(each, dict):
            if has_keys_of_omm(each) or has_two_lines(each):
                yield each
                continue
            inner = [one for one in each.values() if isinstance(one, dict | list)]
        if not inner:
            yield UnusedSet(reason=f"no elements, but: {text_of_values(each)[:200]}")
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
    text = _without_comments(text)
    number, after = 1, 0
    first, last = next((each for each in _XML_UNITS if each[0].search(text)), _XML_UNITS[0])
    starts = [each.start() for each in first.finditer(text)]
    for start, end in zip([*starts, len(text)], [*starts[1:], len(text), len(text)], strict=True):
        if _XML_KEY.search(text, after, start):
            reason = "no OMM in XML: its first tag cannot be read"
            yield f"object {number}", _damaged(reason, text[after:start])
            number += 1
        if start < len(text):
            close = last.search(text, start, end)
            after = close.end() if close else end
            yield f"object {number}", _xml_fields(text[start:after])
            number += 1


def _without_comments(text: str) -> str:
    kept, at = [], 0
    while (start := text.find("<!--", at)) >= 0 and (end := text.find("-->", start + 4)) >= 0:
        kept.append(text[at:start])
        at = end + 3
    return "".join([*kept, text[at:]])


def _xml_fields(text: str) -> Fields | UnusedSet:
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
        return _damaged(f"no OMM in XML: {error}", text)
    return fields | {TWICE: twice[0]} if twice else fields


def csv_messages(text: str) -> Iterator[Message]:
    """Yield the messages of a table whose first line names its columns."""
    names: list[str] = []
    twice: list[str] = []
    separator = ","
    for number, line in enumerate(text.split("\n"), start=1):
        if not line.strip() or (not names and is_before_table(line)):
            continue
        if not names:
            separator = max(",;\t", key=line.count)
            names = _cells(line, separator)
            twice = [each for each in names if names.count(each) > 1 and each.upper() in _READ]
            continue
        cells = _cells(line, separator)
        if len(cells) < len(names) or any(cells[len(names) :]):
            of_it = "\n".join(f"{n.upper()}={c}" for n, c in zip(names, cells, strict=False))
            reason = f"{len(cells)} columns found, {len(names)} needed"
            yield f"line {number}", _damaged(reason, of_it)
        elif cells != names:  # the head of a file that was put behind another
            fields = dict(zip(names, cells, strict=False))
            yield f"line {number}", fields | {TWICE: twice[0]} if twice else fields


def is_before_table(line: str) -> bool:
    """True for a comment, and for the line with which Excel is told the separator."""
    return line.lstrip().startswith("#") or re.match(r'"?sep=', line, re.IGNORECASE) is not None


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


def kvn_messages(text: str) -> Iterator[Message]:
    """Yield the messages of lines KEY = value, one after another."""
    fields: dict[str, str] = {}
    place, fault, before = "", "", ""
    torn: tuple[str, str] | None = None
    """Damaged line, and what is wrong with it, of which the message is not known yet."""

    def message() -> Message:
        if not fault:
            return place, fields
        return place, _damaged(fault, "\n".join(f"{key}={value}" for key, value in fields.items()))

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
            yield message()
            fields, place, fault = {}, "", ""
        if torn:  # before another than the first key it was the first line
            fault, torn = fault or torn[1], None
        place = place or f"line {number}"
        unit = _KVN_UNIT.fullmatch(found[2])
        value = unit[1] if unit else found[2]
        if fields.setdefault(key, value) != value and key in _READ:
            fault = fault or f"{key} stands twice"
    if torn and fields and not fields.keys() >= _READ:  # the text is cut off
        fault, torn = fault or torn[1], None
    if fields:
        yield message()
    if torn:
        yield torn[0], UnusedSet(reason=torn[1])
