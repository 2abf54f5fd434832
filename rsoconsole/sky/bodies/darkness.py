"""When it is dark."""

from collections.abc import Callable

from rsoconsole.records import Site
from rsoconsole.sky import NS_PER_DAY, NS_PER_S, sun_altitude_deg

SCAN_STEP_NS = 600 * NS_PER_S
"""Fine enough for nights of a quarter of an hour, as they are at the edge of a polar summer."""
CROSSING_NS = NS_PER_S // 10


def night_span(site: Site, now_utc_ns: int, twilight_deg: float) -> tuple[int, int] | None:
    """The present dark time, or the next that begins within a day: (dusk, dawn) in UTC ns.

    Dark is a Sun at ``twilight_deg`` or lower, refraction left out. None when it does not get
    dark within a day. Where the Sun stays down longer, the span is cut a day before and after
    now: in a polar night it is two days long.
    """

    def is_dark(t_utc_ns: int) -> bool:
        return sun_altitude_deg(site, t_utc_ns) <= twilight_deg

    end_ns = now_utc_ns + NS_PER_DAY
    if is_dark(now_utc_ns):
        dusk_ns = _first(is_dark, False, now_utc_ns, now_utc_ns - NS_PER_DAY)
        dawn_ns = _first(is_dark, False, now_utc_ns, end_ns)
        return dusk_ns or now_utc_ns - NS_PER_DAY, dawn_ns or end_ns
    dusk_ns = _first(is_dark, True, now_utc_ns, end_ns)
    if dusk_ns is None:
        return None
    return dusk_ns, _first(is_dark, False, dusk_ns, dusk_ns + NS_PER_DAY) or dusk_ns + NS_PER_DAY


def _first(is_dark: Callable[[int], bool], wanted: bool, from_ns: int, to_ns: int) -> int | None:
    """The instant nearest to ``from_ns``, on the way to ``to_ns``, at which darkness is ``wanted``.

    Darkness at ``from_ns`` may be taken for the other way round. None when it never comes.
    """
    step_ns = SCAN_STEP_NS if to_ns > from_ns else -SCAN_STEP_NS
    before_ns = from_ns
    for at_ns in range(from_ns + step_ns, to_ns + step_ns, step_ns):
        if is_dark(at_ns) is wanted:
            return _crossing(is_dark, wanted, before_ns, at_ns)
        before_ns = at_ns
    return None


def _crossing(is_dark: Callable[[int], bool], wanted: bool, before_ns: int, at_ns: int) -> int:
    """Bisect to a tenth of a second: not wanted at ``before_ns``, wanted at ``at_ns``."""
    while abs(at_ns - before_ns) > CROSSING_NS:
        middle_ns = (before_ns + at_ns) // 2
        if is_dark(middle_ns) is wanted:
            at_ns = middle_ns
        else:
            before_ns = middle_ns
    return at_ns
