"""Dates and times of day as headers write them, where there is no doubt what they mean.

Source: FITS standard 4.0, section 9.1.1 (ISO 8601) and, for 'dd/mm/yy', the form that it had before
2000. What may mean two things raises ValueError with the reason.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import date
from decimal import Decimal

from rsoconsole.instruments.frames.header_cards import written_number
from rsoconsole.sky import TIME_SCALES
from rsoconsole.words import NS_PER_S

NS_PER_MINUTE = 60 * NS_PER_S
FIRST_YEAR, LAST_YEAR = 1957, 2200
"""Years in which a frame may show a satellite, by its header."""
_EPOCH = date(1970, 1, 1).toordinal()
_MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
_NAME = r"(?P<name>[A-Za-z]{3})[a-z]{0,6}"
_FORMS = tuple(
    re.compile(form)
    for form in (
        r"(?P<year>[0-9]{4})([-/.:])(?P<month>[0-9]{1,2})\2(?P<day>[0-9]{1,2})(?![0-9])",
        r"(?P<year>[0-9]{4})[-/.:](?P<of_year>[0-9]{3})(?![0-9])",
        r"(?P<year>(?:19|20)[0-9]{2})(?P<month>[0-9]{2})(?P<day>[0-9]{2})"
        r"(?:(?![0-9])|(?=[0-9]{6}(?![0-9])))",
        rf"(?P<year>[0-9]{{4}})[-/. ]{_NAME}[-/. ](?P<day>[0-9]{{1,2}})(?![0-9])",
        # By the standard until 1999: the day first, and the years since 1900. Programs that
        # were not ready for 2000 went on to 100, 101...
        r"(?P<day>[0-9]{2})/(?P<month>[0-9]{2})/(?P<since_1900>1?[0-9]{2})(?![0-9])",
        rf"(?P<day>[0-9]{{1,2}})[-/. ]{_NAME}[-/., ] ?(?P<year>[0-9]{{4}})(?![0-9])",
        r"(?P<one>[0-9]{1,2})([-/.])(?P<other>[0-9]{1,2})\2(?P<year>[0-9]{4})(?![0-9])",
        r"(?P<short>[0-9]{1,2}[-/. ][A-Za-z]{3}[a-z]{0,6}[-/. ][0-9]{1,2})(?![0-9])",
    )
)
"""Dates at the beginning of a text, by their parts."""
_SEPARATOR = re.compile(r"\s*[Tt_:]\s*|\s+|(?=[0-9])")
_TIME = re.compile(
    r"([0-9]{1,2})(?: ?[:h] ?| )([0-9]{1,2})"
    r"(?:(?: ?[:m] ?| )([0-9]{1,2})(?:[.,]([0-9]{0,30}))?(?: ?s)?)?m?",
    re.IGNORECASE,
)
_BASIC_TIME = re.compile(r"([0-9]{2})([0-9]{2})([0-9]{2})(?:[.,]([0-9]{0,30}))?")
_ZONE = re.compile(
    r"[\s_]*(?:\(?(Z|UTC|UT|GMT|TAI|TT|TDB|GPS)\)?|([+-])([0-9]{2})(?::?([0-9]{2}))?)",
    re.IGNORECASE,
)
_UNSET_CLOCK = 0
"""Day since 1970 on which a clock begins that was never set."""
_MAX_OFFSET_H = 14
_MAX_HHMMSS = 240_000


_SCALES: Mapping[str, str] = {
    **{name: name for name in TIME_SCALES},
    **dict.fromkeys(("UT", "GMT", "Z", "ZULU", "UTC+0", "UTC+00:00", "UTC TIME"), "UTC"),
    **dict.fromkeys(("COORDINATED UNIVERSAL TIME", "UNIVERSAL TIME"), "UTC"),
    **dict.fromkeys(("TDT", "ET", "TERRESTRIAL TIME"), "TT"),
    **dict.fromkeys(("IAT", "INTERNATIONAL ATOMIC TIME"), "TAI"),
    **dict.fromkeys(("GPST", "GPS TIME"), "GPS"),
}
_REALISATION = re.compile(r"\s*\([^()]*\)$")


@dataclass(frozen=True, slots=True, kw_only=True)
class TimeOfDay:
    """A time of day, and how finely it is written."""

    since_midnight_ns: int
    step_ns: int
    """One unit of the last digit."""
    offset_s: int = 0
    """Offset from UTC that is written with it, s."""
    scale: str | None = None
    """Time scale that is written with it, UTC where it has an offset or a Z; None without one."""


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
    separator = _SEPARATOR.match(rest)
    if separator is None:
        raise ValueError("it is no date")
    return WrittenDate(day=day, time=parse_time_of_day(rest[separator.end() :]))


def parse_time_of_day(text: str) -> TimeOfDay:
    """Parse a time of day such as 05:31:30.3Z. Raises ValueError with the reason."""
    text = text.strip().removeprefix("T")
    found = _BASIC_TIME.match(text) or _TIME.match(text)
    rest = "" if found is None else text[found.end() :]
    zone = _ZONE.fullmatch(rest)
    if found is None or (zone is None and rest.strip()):
        raise ValueError("it has no time of day like 05:31:30.3")
    hour, minute, second = int(found[1]), int(found[2]), int(found[3] or 0)
    decimals = found[4] or ""
    # Programs that round the seconds up write 60.0.
    is_rounded = second == 60 and not decimals.strip("0")
    if hour == 23 and minute == 59 and second == 60:
        raise ValueError("it is in a leap second or rounded up, and which of them is not certain")
    if hour > 23 or minute > 59 or (second > 59 and not is_rounded):
        raise ValueError("its time of day is not between 00:00:00 and 23:59:59")
    seconds = (hour * 60 + minute) * 60 + second
    return TimeOfDay(
        since_midnight_ns=seconds * NS_PER_S + int(decimals[:9].ljust(9, "0")),
        step_ns=10 ** max(9 - len(decimals), 0) if found[3] else NS_PER_MINUTE,
        offset_s=0 if zone is None else _offset_s(zone),
        scale=None if zone is None else _SCALES[(zone[1] or "UTC").upper()],
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
    found = next((found for form in _FORMS if (found := form.match(text))), None)
    if found is None:
        raise ValueError("it is no date like 2023-06-22T03:04:05.678")
    return _day_of(found.groupdict()), found.end()


def _day_of(parts: Mapping[str, str]) -> int:
    if "short" in parts:
        raise ValueError("day and year cannot be told apart; write it like 2023-06-22")
    year = int(parts["year"]) if "year" in parts else 1900 + int(parts["since_1900"])
    if "of_year" in parts:
        return _days(year, 1, 1, int(parts["of_year"]))
    if "one" in parts:
        one, other = int(parts["one"]), int(parts["other"])
        if one <= 12 and other <= 12 and one != other:
            raise ValueError("day and month cannot be told apart; write it like 2023-06-22")
        day, month = (one, other) if one > 12 else (other, one)
        return _days(year, month, day)
    if "name" in parts:
        if parts["name"].lower() not in _MONTHS:
            raise ValueError("it is no date like 2023-06-22T03:04:05.678")
        return _days(year, _MONTHS.index(parts["name"].lower()) + 1, int(parts["day"]))
    return _days(year, int(parts["month"]), int(parts["day"]))


def _days(year: int, month: int, day: int, of_year: int = 1) -> int:
    if not FIRST_YEAR <= year < LAST_YEAR:
        raise ValueError(f"it would be in the year {year}; write it like 2023-06-22")
    try:
        found = date(year, month, day).toordinal() + of_year - 1
        if of_year < 1 or date.fromordinal(found).year != year:
            raise ValueError(of_year)
    except ValueError:
        raise ValueError("there is no such day") from None
    if found - _EPOCH == _UNSET_CLOCK:
        raise ValueError("on 1970-01-01 a clock begins that was never set")
    return found - _EPOCH


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
    possible: dict[Decimal, int] = {}
    """Seconds since midnight, and seconds in a unit of the number."""
    if number < 86_400:
        possible[number] = 1
    if is_packed:
        possible[packed_s] = 1
    if number < 24:
        possible[number * 3600] = 3600
    digit = 10.0 ** min(int(number.as_tuple().exponent), 0)
    return [
        TimeOfDay(since_midnight_ns=int(each * NS_PER_S), step_ns=round(digit * unit_s * NS_PER_S))
        for each, unit_s in sorted(possible.items())
    ]


def time_scale(name: str) -> str | None:
    """Return the time scale that TIMESYS names, of ``TIME_SCALES``; None for another.

    A realisation may stand behind it, as in UTC(NIST). Source: FITS standard 4.0, table 30.
    """
    return _SCALES.get(" ".join(_REALISATION.sub("", name.strip().upper()).split()))
