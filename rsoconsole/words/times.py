"""Instants and durations in words."""

from datetime import date
from typing import Literal

NS_PER_S = 1_000_000_000
NS_PER_DAY = 86_400 * NS_PER_S

Clock = Literal["second", "minute", "dated", "dated minute", "day"]
_CUTS: dict[Clock, slice] = {
    "second": slice(11, 19),
    "minute": slice(11, 16),
    "dated": slice(0, 19),
    "dated minute": slice(0, 16),
    "day": slice(0, 10),
}


def utc_ns_to_iso(t_utc_ns: int, decimals: int = 3) -> str:
    """Format an instant as ISO 8601 with Z, '2023-06-22T03:04:05.678Z'; ``decimals``: 0 to 9."""
    step = 10 ** (9 - decimals)
    rounded = (int(t_utc_ns) + step // 2) // step * step
    days, in_day = divmod(rounded, NS_PER_DAY)
    seconds, nanoseconds = divmod(in_day, NS_PER_S)
    day = date.fromordinal(date(1970, 1, 1).toordinal() + days)
    tail = f".{nanoseconds:09d}"[: decimals + 1] if decimals else ""
    hms = f"{seconds // 3600:02d}:{seconds // 60 % 60:02d}:{seconds % 60:02d}"
    return f"{day.isoformat()}T{hms}{tail}Z"


def utc_text(t_utc_ns: int | None, form: Clock = "second", zone: str = "Z") -> str:
    """Format an instant: 05:39:40Z, 05:39Z, 2026-07-14 05:39:40Z; dashes where it is None.

    ``form``: which of these forms; ``zone``: suffix of the text.
    """
    if not t_utc_ns:
        return ("--:--" if form == "minute" else "--:--:--") + zone
    return utc_ns_to_iso(t_utc_ns, 0)[_CUTS[form]].replace("T", " ") + zone


def date_span_words(first_utc_ns: int | None, last_utc_ns: int | None) -> str:
    """Format a span of time; the date is written once where both ends have the same."""
    if first_utc_ns is None or last_utc_ns is None:
        return "nothing on record yet"
    days = [utc_text(each, "day", "") for each in (first_utc_ns, last_utc_ns)]
    until = utc_text(last_utc_ns, "second" if days[0] == days[1] else "dated", "")
    return f"{utc_text(first_utc_ns, 'dated', '')} to {until} UTC"


def duration_words(seconds: float, form: Literal["cell", "line"] = "cell") -> str:
    """Format a duration: 8s, 12m04, 3h05; ``form`` "line": 8 s, 12 min 4 s, 3 h 5 min."""
    whole = max(int(seconds), 0)
    hours, minutes, rest = whole // 3600, whole // 60 % 60, whole % 60
    if form == "cell" and hours:
        return f"{hours}h{minutes:02d}"
    if form == "cell":
        return f"{minutes}m{rest:02d}" if minutes else f"{rest}s"
    parts = ((hours, "h"), (minutes, "min"), (0 if hours else rest, "s"))
    return " ".join(f"{number} {unit}" for number, unit in parts if number) or "0 s"


def time_left_words(seconds: float) -> str:
    """Format the time left: in minutes, below two minutes in seconds."""
    return f"{seconds / 60:.0f} min" if seconds >= 120.0 else f"{max(seconds, 0.0):.0f} s"


def element_age_words(days: float) -> str:
    """Format the age of elements: 0.4 d old; 0.2 d younger where the age is negative."""
    return f"{abs(days):.1f} d {'old' if days >= 0.0 else 'younger'}"
