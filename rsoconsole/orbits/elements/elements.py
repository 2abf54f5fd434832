"""Two-line element sets: read, checked, chosen by epoch.

Source of the format: Hoots & Roehrich 1980; alpha-5 numbers as Space-Track writes them.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import date
from decimal import Decimal

from rsoconsole.base import OrbitError
from rsoconsole.words import NS_PER_DAY

_LINE_LENGTH = 69
ALPHA_5 = "ABCDEFGHJKLMNPQRSTUVWXYZ"
"""First characters of catalogue numbers from 100,000 on: A stands for 10; no I and no O."""
_WORTH = bytes(
    "0123456789".find(chr(c)) if c in b"0123456789" else c == ord("-") for c in range(256)
)
"""Value of each character in a checksum; a table, because catalogues are long."""
_EPOCH = re.compile(r"([ \d]\d)([ \d]{3}\.[ \d]{8})")


@dataclass(frozen=True, slots=True, kw_only=True)
class ElementSet:
    """One two-line element set as published; SGP4 reads the two lines themselves."""

    name: str
    """Name from the line above the two; empty where there is none."""
    norad_id: int
    epoch_utc_ns: int
    line_1: str
    line_2: str


def parse_elements(text: str, source: str = "element sets") -> tuple[ElementSet, ...]:
    """Parse every element set of a text with or without name lines, in order.

    Blank lines and lines that start with '#' are skipped. Raises OrbitError naming ``source`` and
    the line for a wrong checksum, a lone line or an unreadable field.
    """
    found: list[ElementSet] = []
    name = ""
    lines = _numbered(text)
    for number, line in lines:
        if not _is_line(line, "1"):
            if _is_line(line, "2"):
                raise OrbitError(f"{source}, line {number}: a line 2 without its line 1")
            name = line.removeprefix("0 ").strip()
            continue
        number_2, line_2 = next(lines, (number, ""))
        if not _is_line(line_2, "2"):
            raise OrbitError(f"{source}, line {number}: no line 2 follows this line 1")
        found.append(_element_set(name, (number, line), (number_2, line_2), source))
        name = ""
    return tuple(found)


def checksum(line: str) -> int:
    """Checksum of a line: last digit of the sum over its first 68 columns.

    Digits count as they are, '-' counts 1, anything else 0.
    """
    body = line[: _LINE_LENGTH - 1].encode("ascii", errors="replace")
    return sum(body.translate(_WORTH)) % 10


def _numbered(text: str) -> Iterator[tuple[int, str]]:
    for number, raw in enumerate(text.splitlines(), start=1):
        line = raw.rstrip()
        if line and not line.startswith("#"):
            yield number, line


def _is_line(line: str, kind: str) -> bool:
    """True for a whole line of elements, by its columns.

    A name may start with a digit too.
    """
    return line.startswith(kind + " ") and len(line) > 40


def _element_set(
    name: str, first: tuple[int, str], second: tuple[int, str], source: str
) -> ElementSet:
    for number, line in (first, second):
        _check_line(line, f"{source}, line {number}")
    line_1, line_2 = first[1][:_LINE_LENGTH], second[1][:_LINE_LENGTH]
    where = f"{source}, line {first[0]}"
    norad_id = _norad_id(line_1[2:7], where)
    if _norad_id(line_2[2:7], f"{source}, line {second[0]}") != norad_id:
        raise OrbitError(f"{where}: its two lines name different satellites")
    for columns in (slice(8, 16), slice(17, 25), slice(34, 42), slice(43, 51), slice(52, 63)):
        _number(line_2[columns], f"{source}, line {second[0]}")
    _number("." + line_2[26:33].replace(" ", "0"), f"{source}, line {second[0]}")
    return ElementSet(
        name=name,
        norad_id=norad_id,
        epoch_utc_ns=_epoch_utc_ns(line_1, where),
        line_1=line_1,
        line_2=line_2,
    )


def _check_line(line: str, where: str) -> None:
    if len(line) < _LINE_LENGTH or not line.isascii():
        raise OrbitError(
            f"{where}: {_LINE_LENGTH} columns needed, {len(line)} found; fetch it again"
        )
    last, expected = line[_LINE_LENGTH - 1], checksum(line)
    if last != str(expected):
        raise OrbitError(f"{where}: checksum {last!r} should be {expected}: fetch it again")


def _norad_id(field: str, where: str) -> int:
    text = field.strip()
    if text and text[0] in ALPHA_5 and text[1:].isdigit() and len(text) == 5:
        return (ALPHA_5.index(text[0]) + 10) * 10_000 + int(text[1:])
    if not text.isdigit():
        raise OrbitError(f"{where}: {field!r} is not a catalogue number")
    return int(text)


def _number(field: str, where: str) -> float:
    try:
        return float(field)
    except ValueError as error:
        raise OrbitError(f"{where}: {field!r} is not a number") from error


def _epoch_utc_ns(line_1: str, where: str) -> int:
    match = _EPOCH.fullmatch(line_1[18:32])
    if match is None:
        raise OrbitError(f"{where}: {line_1[18:32]!r} is not an epoch (yyddd.dddddddd)")
    short_year = int(match[1])
    year = short_year + (1900 if short_year >= 57 else 2000)
    day_of_year = Decimal(match[2].replace(" ", "0"))
    start = date(year, 1, 1).toordinal() - date(1970, 1, 1).toordinal()
    return start * NS_PER_DAY + int((day_of_year - 1) * NS_PER_DAY)
