"""When it is dark, and what ends a night: dawn, weather, a closed dome.

Nothing here brings a night back: once ended, only the operator arms again.
"""

from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Literal

from rsoconsole.config import Config
from rsoconsole.instruments.ports import SkyReport
from rsoconsole.records import Site
from rsoconsole.sky.sun import sun_altitude_deg
from rsoconsole.sky.times import NS_PER_DAY, NS_PER_S, utc_ns_to_iso

SCAN_STEP_NS = 600 * NS_PER_S
"""Fine enough for nights of a quarter of an hour, as they are at the edge of a polar summer."""
CROSSING_NS = NS_PER_S // 10


@dataclass(frozen=True, slots=True, kw_only=True)
class NightEnd:
    """Why the night is over."""

    cause: Literal["dawn", "weather", "dome"]
    detail: str
    """With the figure, or in the driver's words."""


def night_end(
    config: Config, now_utc_ns: int, sky: SkyReport | None, overridden: Collection[str] = ()
) -> NightEnd | None:
    """Why the telescope must stop and park now; None while the night goes on.

    ``overridden`` holds names of arming checks ("sun", "weather", "dome") that the operator
    answers for. A weather station's "warning" ends nothing, a silent station does.
    """
    if "dome" not in overridden and (fault := dome_fault(config, sky)):
        return NightEnd(cause="dome", detail=fault)
    if "weather" not in overridden and (fault := weather_fault(config, sky)):
        return NightEnd(cause="weather", detail=fault)
    if "sun" not in overridden and (fault := sun_fault(config, now_utc_ns)):
        return NightEnd(cause="dawn", detail=fault)
    return None


def lasting_overrides(
    config: Config, now_utc_ns: int, sky: SkyReport | None, overridden: Collection[str]
) -> frozenset[str]:
    """Those overrides whose reason still stands; call it once a cycle.

    An override holds against what was there when it was given. The Sun that was let pass at dusk
    ends the night at dawn, and weather that has cleared may end it when it comes back.
    """
    faults = {
        "sun": sun_fault(config, now_utc_ns),
        "weather": weather_fault(config, sky),
        "dome": dome_fault(config, sky),
    }
    return frozenset(name for name in overridden if name not in faults or faults[name])


def sun_fault(config: Config, now_utc_ns: int) -> str:
    """What is wrong with the Sun's altitude, in words; empty when it is dark."""
    altitude_deg = sun_altitude_deg(config.site.to_site(), now_utc_ns)
    limit_deg = config.limits.twilight_deg
    if altitude_deg <= limit_deg:
        return ""
    return f"the Sun stands at {altitude_deg:+.1f} deg, above the limit of {limit_deg:+.1f}"


def weather_fault(config: Config, sky: SkyReport | None) -> str:
    """What is wrong with the weather, in words; empty when it may be observed."""
    station = config.indi.weather
    if station is None:
        return ""
    word = None if sky is None else sky.weather
    if word in ("ok", "warning"):
        return ""
    if word == "alert":
        return _with_detail(f"{station} raises a weather alert", sky)
    return _with_detail(f"{station} is silent", sky)


def dome_fault(config: Config, sky: SkyReport | None) -> str:
    """What is wrong with the dome, in words; empty when it is open."""
    dome = config.indi.dome
    if dome is None:
        return ""
    word = None if sky is None else sky.dome
    if word == "open":
        return ""
    return _with_detail(f"{dome} is {word or 'silent'}", sky)


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


def darkness_words(config: Config, now_utc_ns: int) -> str:
    """When it will be dark, for an operator who has to wait."""
    limit_deg = config.limits.twilight_deg
    span = night_span(config.site.to_site(), now_utc_ns, limit_deg)
    if span is None:
        return f"the Sun does not sink to {limit_deg:+.1f} deg here within a day"
    if span[0] <= now_utc_ns:
        return f"it is dark until {utc_ns_to_iso(span[1], 0)}"
    return f"wait until {utc_ns_to_iso(span[0], 0)}"


def _with_detail(words: str, sky: SkyReport | None) -> str:
    return f"{words} ({sky.detail})" if sky is not None and sky.detail else words


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
