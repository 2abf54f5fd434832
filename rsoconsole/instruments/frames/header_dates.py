"""Dates and times of day as headers write them, where there is no doubt what they mean.

Source: FITS standard 4.0, section 9.1.1 (ISO 8601) and, for 'dd/mm/yy', the form that it had before
2000. What may mean two things raises ValueError with the reason.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import date

from rsoconsole.instruments.frames.header_cards import written_number
from rsoconsole.sky import TIME_SCALES
from rsoconsole.words import NS_PER_S

NS_PER_MINUTE = 60 * NS_PER_S
FIRST_YEAR, LAST_YEAR = 1957, 2200
"""Years in which a frame may show a satellite, by its header."""
_EPOCH = date(1970, 1, 1).toordinal()
_MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
_YEAR_FIRST = re.compile(r"([0-9]{4})([-/.])([0-9]{1,2})\2([0-9]{1,2})(?![0-9])")
_BASIC = re.compile(r"((?:19|20)[0-9]{2})([0-9]{2})([0-9]{2})(?![0-9])")
_OLD_FITS = re.compile(r"([0-9]{2})/([0-9]{2})/(1?[0-9]{2})(?![0-9])")
_YEAR_LAST = re.compile(r"([0-9]{1,2})([-/.])([0-9]{1,2})\2([0-9]{4})(?![0-9])")
_NAMED = re.compile(r"([0-9]{1,2})[-/. ]([A-Za-z]{3})[a-z]{0,6}[-/., ] ?([0-9]{4})(?![0-9])")
_TIME = re.compile(
    r"([0-9]{1,2})[:h ]([0-9]{1,2})(?:[:m ]([0-9]{1,2})(?:[.,]([0-9]{0,30}))?s?)?m?", re.IGNORECASE
)
_BASIC_TIME = re.compile(r"([0-9]{2})([0-9]{2})([0-9]{2})(?:[.,]([0-9]{0,30}))?")
_ZONE = re.compile(r"\s*(?:(Z|UTC|UT|GMT)|([+-])([0-9]{2})(?::?([0-9]{2}))?)", re.IGNORECASE)
_MAX_OFFSET_H = 14
_MAX_HHMMSS = 240_000


_SCALES: Mapping[str, str] = {
    **{name: name for name in TIME_SCALES},
    **dict.fromkeys(("UT", "GMT", "Z", "ZULU"), "UTC"),
    **dict.fromkeys(("TDT", "ET"), "TT"),
    "IAT": "TAI",
}
_SCALE = re.compile(r"([A-Z0-9]+)\s*(?:\([^()]*\))?")


@dataclass(frozen=True, slots=True, kw_only=True)
class TimeOfDay:
    """A time of day, and how finely it is written."""

    since_midnight_ns: int
    step_ns: int
    """One unit of the last digit."""
    offset_s: int | None
    """Offset from UTC that is written with it, 0 for Z; None where none is."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WrittenDate:
    """A date, with a time of day or without."""

    day: int
    """Days since 1970-01-01."""
    time: TimeOfDay | None


def parse_date(text: str) -> WrittenDate:
    """Parse a date, alone or before a time of day. Raises ValueError with the reason."""
    text = text.strip()
    day, end = _leading_day(text)
    rest = text[end:]
    if not rest.strip():
        return WrittenDate(day=day, time=None)
    separator = re.match(r"\s*[Tt]\s*|\s+", rest)
    if separator is None:
        raise ValueError("it is no date")
    return WrittenDate(day=day, time=parse_time_of_day(rest[separator.end() :]))


def parse_time_of_day(text: str) -> TimeOfDay:
    """Parse a time of day such as 05:31:30.3Z. Raises ValueError with the reason."""
    text = text.strip()
    found = _BASIC_TIME.match(text) or _TIME.match(text)
    if found is None:
        raise ValueError("it has no time of day like 05:31:30.3")
    rest, offset_s = text[found.end() :], None
    zone = _ZONE.fullmatch(rest)
    if zone is not None:
        offset_s = _offset_s(zone)
    elif rest.strip():
        raise ValueError("it has no time of day like 05:31:30.3")
    hour, minute, second = int(found[1]), int(found[2]), int(found[3] or 0)
    if hour > 23 or minute > 59 or second > 59:
        raise ValueError("its time of day is not between 00:00:00 and 23:59:59")
    decimals = found[4] or ""
    seconds = (hour * 60 + minute) * 60 + second
    step_ns = 10 ** max(9 - len(decimals), 0) if found[3] else NS_PER_MINUTE
    return TimeOfDay(
        since_midnight_ns=seconds * NS_PER_S + int(decimals[:9].ljust(9, "0")),
        step_ns=step_ns,
        offset_s=offset_s,
    )


def _offset_s(zone: re.Match[str]) -> int:
    if zone[1]:
        return 0
    hours, minutes = int(zone[3]), int(zone[4] or 0)
    if hours > _MAX_OFFSET_H or minutes > 59:
        raise ValueError("its offset from UTC is none")
    return (hours * 60 + minutes) * (60 if zone[2] == "+" else -60)


def _leading_day(text: str) -> tuple[int, int]:
    """Days since 1970 of the date at the beginning, and where it ends."""
    found = _YEAR_FIRST.match(text)
    if found is not None:
        return _days(int(found[1]), int(found[3]), int(found[4])), found.end()
    found = _BASIC.match(text)
    if found is not None:
        return _days(int(found[1]), int(found[2]), int(found[3])), found.end()
    found = _OLD_FITS.match(text)
    if found is not None:
        # By the standard until 1999: the day first, and the years since 1900. Programs that
        # were not ready for 2000 went on to 100, 101...
        return _days(1900 + int(found[3]), int(found[2]), int(found[1])), found.end()
    found = _NAMED.match(text)
    if found is not None and found[2].lower() in _MONTHS:
        return _days(int(found[3]), _MONTHS.index(found[2].lower()) + 1, int(found[1])), found.end()
    found = _YEAR_LAST.match(text)
    if found is not None:
        one, other, year = int(found[1]), int(found[3]), int(found[4])
        if one <= 12 and other <= 12 and one != other:
            raise ValueError("day and month cannot be told apart; write it like 2023-06-22")
        day, month = (one, other) if one > 12 else (other, one)
        return _days(year, month, day), found.end()
    raise ValueError("it is no date like 2023-06-22T03:04:05.678")


def _days(year: int, month: int, day: int) -> int:
    if not FIRST_YEAR <= year < LAST_YEAR:
        raise ValueError(f"it would be in the year {year}; write it like 2023-06-22")
    try:
        return date(year, month, day).toordinal() - _EPOCH
    except ValueError:
        raise ValueError("there is no such day") from None


def numeric_times(value: object) -> list[TimeOfDay]:
    """Times of day that a plain number may be: hours, seconds since midnight, or hhmmss."""
    is_packed_text = isinstance(value, str) and re.match(r"\s*[0-9]{6}", value) is not None
    written = None if is_packed_text else written_number(value)
    if written is None or not 0 <= written.value < _MAX_HHMMSS:
        return []
    number = written.value
    hhmm, seconds = divmod(number, 100)
    hours, minutes = divmod(int(hhmm), 100)
    packed_s = (hours * 60 + minutes) * 60 + seconds
    is_packed = minutes < 60 and seconds < 60 and hours < 24
    possible_s = {
        *([number * 3600] if number < 24 else []),
        *([number] if number < 86_400 else []),
        *([packed_s] if is_packed else []),
    }
    step_ns = round(10.0 ** min(int(number.as_tuple().exponent), 0) * NS_PER_S)
    return [
        TimeOfDay(since_midnight_ns=int(each * NS_PER_S), step_ns=step_ns, offset_s=None)
        for each in sorted(possible_s)
    ]


def time_scale(name: str) -> str | None:
    """Return the time scale that TIMESYS names, of ``TIME_SCALES``; None for another.

    A realisation may stand behind it, as in UTC(NIST). Source: FITS standard 4.0, table 30.
    """
    found = _SCALE.fullmatch(name.strip().upper())
    return None if found is None else _SCALES.get(found[1])
