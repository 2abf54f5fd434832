"""An orbit's size, and what comes within a day, in words."""

from rsoconsole.words.angles import plus_minus
from rsoconsole.words.times import NS_PER_S, Clock, clock, span


def size_words(a_km: float, sigma_a_km: float) -> str:
    """a 42165±9 km."""
    return f"a {plus_minus(a_km, sigma_a_km)} km"


def due(what: str, t_utc_ns: int, now_utc_ns: int, form: Clock = "minute") -> str:
    """Sets 04:23Z (2h00)."""
    return f"{what} {clock(t_utc_ns, form)} ({span((t_utc_ns - now_utc_ns) / NS_PER_S)})"


def turn_words(
    t_utc_ns: int | None, now_utc_ns: int, form: Clock = "minute", *, is_up: bool
) -> str:
    """When what is up sets, or what is down rises."""
    if t_utc_ns is None:
        return f"does not {'set' if is_up else 'rise'} within a day"
    return due("sets" if is_up else "rises", t_utc_ns, now_utc_ns, form)


def eclipse_words(
    eclipse_utc_ns: tuple[int, int | None] | None,
    from_utc_ns: int,
    now_utc_ns: int,
    form: Clock = "minute",
) -> str:
    """When it begins and ends, or that it has begun."""
    if eclipse_utc_ns is None:
        return "no eclipse within a day"
    begins, ends = eclipse_utc_ns
    until = f" to {clock(ends, 'minute')}" if ends else ""
    is_in = begins <= from_utc_ns
    return ("in eclipse" if is_in else due("eclipse", begins, now_utc_ns, form)) + until
