"""Two-line element sets: each field of both lines is checked by its columns.

Source of the format: Hoots & Roehrich 1980 and Vallado et al. 2006 (AIAA 2006-6753); alpha-5
numbers as Space-Track writes them.
"""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import date

from rsoconsole.base import OrbitError
from rsoconsole.words import NS_PER_DAY, catalogued_name

_LINE_LENGTH = 69
ALPHA_5 = "ABCDEFGHJKLMNPQRSTUVWXYZ"
"""First characters of catalogue numbers from 100,000 on: A stands for 10; no I and no O."""
MAX_REVOLUTIONS_A_DAY = 18.0
"""Mean motion, revolutions a day, that no orbit above the ground reaches."""
MAX_BSTAR = 100.0
"""Drag term, 1/Earth radius, above that of any object."""
OTHER_THEORIES = {4, 5}
"""Ephemeris types of other theories than SGP4: SGP4-XP (SGP8 in old sets) and SDP8."""
_WORTH = bytes(
    "0123456789".find(chr(c)) if c in b"0123456789" else c == ord("-") for c in range(256)
)
"""Value of each character in a checksum; a table, because catalogues are long."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ElementSet:
    """One two-line element set, as SGP4 reads it.

    The lines are as published, but for blanks where others write zeros and a checksum that lacks.
    """

    name: str
    """Name from the line above the two; empty where there is none."""
    norad_id: int
    epoch_utc_ns: int
    line_1: str
    line_2: str


@dataclass(frozen=True, slots=True, kw_only=True)
class UnusedSet:
    """Element set, or what stands in the place of one, that cannot be used."""

    source: str = ""
    """File or other source that it is from."""
    place: str = ""
    """Where in the source: ``line 5``, ``object 2``; empty for a set that was read whole."""
    norad_id: int | None = None
    name: str = ""
    reason: str

    @property
    def words(self) -> str:
        """Place, object and reason in one sentence."""
        number = self.norad_id
        named = self.name if number is None else catalogued_name(self.name, number)
        where = ", ".join(filter(None, (self.source, self.place)))
        of = f" [{named}]" if named else ""
        return f"{where}: {self.reason}{of}" if where else f"{named}: {self.reason}"


def parse_elements(text: str, source: str = "element sets") -> tuple[ElementSet, ...]:
    """Parse two-line sets, with or without name lines, of which every one must be good.

    Raises OrbitError naming ``source`` and the line of the first that cannot be used.
    """
    found: list[ElementSet] = []
    for each in two_line_sets(text):
        if isinstance(each, UnusedSet):
            raise OrbitError(f"{source}, {each.place}: {each.reason}")
        found.append(each)
    return tuple(found)


def two_line_sets(text: str) -> Iterator[ElementSet | UnusedSet]:
    """Yield every set of a text with or without name lines, in order; nothing without any.

    Blank lines, lines that start with '#', and blanks around a line do not count. A set that
    cannot be used costs no other: a lone line never pairs with a line of the next set.
    """
    lines = [(number, line, _kind(line)) for number, line in _numbered(text)]
    if not any(kind in {"1", "2"} for _, _, kind in lines):
        return
    name, at = "", 0
    while at < len(lines):
        number, line, kind = lines[at]
        _, following, next_kind = lines[at + 1] if at + 1 < len(lines) else (0, "", "")
        at += 1
        if not kind:
            name = line.removeprefix("0 ").strip()[:_LONGEST_NAME]
            continue
        if kind == "1" and next_kind == "2":
            at += 1
            yield _element_set(name, number, lines[at - 1][0], line, following)
        else:
            if kind == "1":
                reason = "no line 2 follows this line 1"
                at += next_kind == "?"
            elif kind == "2":
                reason = "a line 2 without its line 1"
            else:
                reason = f"neither a name nor a line of elements: {line[:24]!r}..."
                at += next_kind in {"2", "?"}
            # A line that is no line of elements may have the columns of one.
            yield UnusedSet(
                place=f"line {number}", norad_id=_number_of(line), name=name, reason=reason
            )
        name = ""


def checksum(line: str) -> int:
    """Checksum of a line: last digit of the sum over its first 68 columns.

    Digits count as they are, '-' counts 1, anything else 0.
    """
    body = line[: _LINE_LENGTH - 1].encode("ascii", errors="replace")
    return sum(body.translate(_WORTH)) % 10


def parse_norad_id(text: str) -> int | None:
    """Parse a catalogue number, alpha-5 too; None where it is none."""
    text = text.strip()
    if len(text) == 5 and text[0] in ALPHA_5 and text[1:].isascii() and text[1:].isdigit():
        return (ALPHA_5.index(text[0]) + 10) * 10_000 + int(text[1:])
    return int(text) if text.isascii() and text.isdigit() and len(text) <= 9 else None


def _numbered(text: str) -> Iterator[tuple[int, str]]:
    for number, raw in enumerate(text.split("\n"), start=1):
        for part in raw.split("\f") if "\f" in raw else (raw,):
            line = _QUOTED.sub("", part.strip())
            if line and not line.startswith("#"):
                yield number, line


_QUOTED = re.compile(r"^>[> ]*")
"""Marks of a quoted mail."""
_SHORT_LINE = re.compile(r"[12] (?: *\d{1,5}|[A-HJ-NP-Z]\d{4})(?:[A-Z]? |$)", re.ASCII)
_LONGEST_NAME = 60


def _kind(line: str) -> str:
    """Return "1" or "2" for a line of elements, "" for a name, "?" for a line too long for one.

    A name may start with a digit, and a long one is a name where few of its letters are digits.
    """
    is_long = len(line) > 40 and 4 * sum(map(str.isdigit, line)) > len(line) - line.count(" ")
    if line[0] in "12" and line[1:2].isspace() and (is_long or _SHORT_LINE.match(line)):
        return line[0]
    return "?" if is_long and len(line) > _LONGEST_NAME else ""


def _number_of(line: str) -> int | None:
    return parse_norad_id(line[2:7])


def _sign(text: str) -> str:
    return "-" if text.startswith("-") else " "


def _filled_power(text: str) -> str:
    if not text.strip():
        return " 00000+0"
    return f"{_sign(text)}{text[1:6].strip().zfill(5)}{text[6:].replace(' ', '+')}"


def _filled_rate(text: str) -> str:
    return f"{_sign(text)}.{text[2:].strip().ljust(8, '0')}"


@dataclass(frozen=True, slots=True)
class _Field:
    """Field of a line: columns from 1, its form, and how a rarer form of it is written plainly."""

    first: int
    last: int
    what: str
    plain: re.Pattern[str]
    rare: re.Pattern[str] | None = None
    filled: Callable[[str], str] = str
    max_value: float = 0.0

    @property
    def columns(self) -> str:
        return (
            f"columns {self.first}-{self.last}"
            if self.last > self.first
            else f"column {self.first}"
        )


def _field(  # noqa: PLR0917 - a row of a table
    first: int,
    last: int,
    what: str,
    plain: str,
    rare: str = "",
    filled: Callable[[str], str] = str,
    max_value: float = 0.0,
) -> _Field:
    seldom = re.compile(rare, re.ASCII) if rare else None
    return _Field(first, last, what, re.compile(plain, re.ASCII), seldom, filled, max_value)


_NUMBER = _field(3, 7, "a catalogue number", r"\d{5}|[A-HJ-NP-Z]\d{4}", r" *\d+")
_POWER, _RARE_POWER = r"[ +-]\d{5}[+-]\d", r"[ +-] *\d+[ +-]\d| {8}"
_ANGLE = r"(?:\d{3}| \d\d|  \d|   )\.\d{4}", r"(?:\d{3}| \d\d|  \d|   )\.\d{1,4} *"


def _angle(first: int, last: int, what: str, max_deg: float) -> _Field:
    def filled(text: str) -> str:
        return f"{float(text):8.4f}"

    return _field(first, last, f"a number ({what}, deg)", *_ANGLE, filled, max_deg)


_FIELDS_1 = (
    _NUMBER,
    _field(8, 8, "a class (U, C, S)", "[A-Z ]"),
    _field(10, 17, "an international designator (yynnnAAA)", r"[ \d]{5}[A-Z ]{3}"),
    _field(
        19,
        32,
        "an epoch (yyddd.dddddddd)",
        r"[ \d]\d(?:\d{3}| \d\d|  \d)\.\d{8}",
        r"[ \d]\d(?:\d{3}| \d\d|  \d)\.\d{1,8} *",
        lambda text: text.rstrip().ljust(14, "0"),
    ),
    _field(
        34,
        43,
        "a number (change of the mean motion, like ' .00016717')",
        r"[ +-]\.\d{8}",
        r"[ +\-0]\.\d{1,8} *| {10}",
        _filled_rate,
    ),
    _field(
        45,
        52,
        "a number (second change of the mean motion, like ' 00000-0')",
        _POWER,
        _RARE_POWER,
        _filled_power,
    ),
    _field(54, 61, "a number (drag term B*, like ' 10270-3')", _POWER, _RARE_POWER, _filled_power),
    _field(63, 63, "an ephemeris type", r"[\d ]"),
    _field(65, 68, "a number (of the set)", r"\d{4}| \d{3}|  \d\d|   \d", r" *\d*"),
)
_FIELDS_2 = (
    _NUMBER,
    _angle(9, 16, "inclination", 180.0),
    _angle(18, 25, "right ascension of the node", 360.0),
    _field(27, 33, "a number (eccentricity, seven digits)", r"\d{7}", r" *\d+"),
    _angle(35, 42, "argument of perigee", 360.0),
    _angle(44, 51, "mean anomaly", 360.0),
    _field(
        53,
        63,
        "a number (mean motion, revolutions a day)",
        r"(?:\d\d| \d|  )\.\d{8}",
        r"(?:\d\d| \d|  )\.\d{1,8} *",
        lambda text: f"{float(text):11.8f}",
        MAX_REVOLUTIONS_A_DAY,
    ),
    _field(64, 68, "a number (of the revolution)", r"\d{5}| \d{4}|  \d{3}", r" *\d*"),
)
_BLANK_1, _BLANK_2 = (2, 9, 18, 33, 44, 53, 62, 64), (2, 8, 17, 26, 34, 43, 52)
"""Columns that are blank."""


def _whole(kind: str, fields: tuple[_Field, ...]) -> re.Pattern[str]:
    """Return the form of a line of which each field is written plainly: most are."""
    form, column = kind, 2
    for field in fields:
        form += " " * (field.first - column) + f"(?:{field.plain.pattern})"
        column = field.last + 1
    return re.compile(form, re.ASCII)


_LINES = tuple(
    (fields, blank, _whole(kind, fields), tuple(each for each in fields if each.max_value))
    for kind, fields, blank in (("1", _FIELDS_1, _BLANK_1), ("2", _FIELDS_2, _BLANK_2))
)
_MEAN_MOTION, _BSTAR, _TYPE = slice(52, 63), slice(53, 61), slice(62, 63)


class _FaultError(Exception):
    """Reason why a line cannot be used."""


def _element_set(
    name: str, number_1: int, number_2: int, first: str, second: str
) -> ElementSet | UnusedSet:
    number = number_1
    try:
        line_1 = _checked(first, 0)
        epoch_utc_ns = _epoch_utc_ns(line_1)
        _check_use(line_1)
        number = number_2
        line_2 = _checked(second, 1)
        if not float(line_2[_MEAN_MOTION]) > 0.0:
            raise _FaultError("columns 53-63: the mean motion is 0")
        norad_id = _number_of(line_1)
        is_one = line_1[2:7] == line_2[2:7] or norad_id == _number_of(line_2)
        if norad_id is None or not is_one:
            number = number_1
            raise _FaultError(
                f"its two lines name different satellites ({first[2:7]}, {second[2:7]})"
            )
    except _FaultError as error:
        return UnusedSet(
            place=f"line {number}", norad_id=_number_of(first), name=name, reason=str(error)
        )
    return ElementSet(
        name=name, norad_id=norad_id, epoch_utc_ns=epoch_utc_ns, line_1=line_1, line_2=line_2
    )


def _checked(line: str, row: int) -> str:
    """Return a line of 69 columns as SGP4 reads it. Raises _FaultError."""
    if len(line) < _LINE_LENGTH - 1:
        raise _FaultError(f"{_LINE_LENGTH} columns needed, {len(line)} found")
    if not line.isascii():
        raise _FaultError("it has letters that no line of elements has")
    fields, blank, whole, limited = _LINES[row]
    seldom = () if whole.match(line) else tuple(_seldom(line, fields, blank))
    for field in limited:
        if float(text := line[field.first - 1 : field.last]) > field.max_value:
            raise _FaultError(
                f"{field.columns}: {text!r} is not {field.what}: {field.max_value:g} at most"
            )
    last = line[_LINE_LENGTH - 1 : _LINE_LENGTH].strip()
    if last and last != str(expected := checksum(line)):
        raise _FaultError(f"checksum {last!r} should be {expected}")
    if last and not seldom:
        return line[:_LINE_LENGTH]
    body = line[: _LINE_LENGTH - 1]
    for field, plain in seldom:
        body = f"{body[: field.first - 1]}{plain}{body[field.last :]}"
    return f"{body}{checksum(body)}"


def _seldom(
    line: str, fields: tuple[_Field, ...], blank: tuple[int, ...]
) -> Iterator[tuple[_Field, str]]:
    """Yield each field that is not written plainly, and how it is. Raises _FaultError."""
    for field in fields:
        text = line[field.first - 1 : field.last]
        if field.plain.fullmatch(text) is None:
            if field.rare is None or field.rare.fullmatch(text) is None:
                raise _FaultError(f"{field.columns}: {text!r} is not {field.what}")
            yield field, field.filled(text)
    for column in blank:
        if line[column - 1] != " ":
            around = line[max(column - 9, 0) : column + 8]
            raise _FaultError(f"column {column} must be blank: {around!r} around it")


def _check_use(line_1: str) -> None:
    """Raise _FaultError for a drag term that no object has, and for elements of other theories."""
    text = line_1[_BSTAR]
    if abs(float(f"{text[0]}.{text[1:6]}e{text[6:]}".strip())) > MAX_BSTAR:
        raise _FaultError(f"columns 54-61: {text!r} is not a drag term: {MAX_BSTAR:g} at most")
    if line_1[_TYPE].strip() and int(line_1[_TYPE]) in OTHER_THEORIES:
        raise _FaultError(f"column 63: ephemeris type {line_1[_TYPE]} is not of SGP4")


_DAYS_1970 = date(1970, 1, 1).toordinal()
_YEARS = {
    year % 100: (date(year, 1, 1).toordinal(), date(year + 1, 1, 1).toordinal())
    for year in range(1957, 2057)
}
"""First day of each year and of the next, by the year's last two digits."""


def _epoch_utc_ns(line_1: str) -> int:
    start, end = _YEARS[int(line_1[18:20])]
    day = int(line_1[20:23])
    if not 1 <= day <= end - start:
        raise _FaultError(
            f"columns 19-32: {line_1[18:32]!r} is not an epoch: its year has no day {day}"
        )
    in_day = int(line_1[24:32]) * (NS_PER_DAY // 100_000_000)
    return (start - _DAYS_1970 + day - 1) * NS_PER_DAY + in_day
