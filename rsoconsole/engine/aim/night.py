"""The dark hours, and what ends a night: dawn, weather or a closed dome.

After a night has ended, only the operator arms again.
"""

from collections.abc import Collection
from dataclasses import dataclass
from typing import Literal

from rsoconsole.config import Config
from rsoconsole.instruments import SkyReport
from rsoconsole.sky import night_span, sun_altitude_deg
from rsoconsole.words import no_night_text, utc_ns_to_iso


@dataclass(frozen=True, slots=True, kw_only=True)
class NightEnd:
    """Why the night ends: dawn, weather or a closed dome."""

    cause: Literal["dawn", "weather", "dome"]
    detail: str
    """The figure that was too high, or the driver's words."""


def night_end(
    config: Config, now_utc_ns: int, sky: SkyReport | None, overridden: Collection[str] = ()
) -> NightEnd | None:
    """Return the reason to stop and park the telescope now; None while the night goes on.

    ``overridden``: names of arming checks ("sun", "weather", "dome") that the operator overrides. A
    weather station's "warning" does not end the night; a station that is silent does.
    """
    if "dome" not in overridden and (fault := dome_fault(config, sky)):
        return NightEnd(cause="dome", detail=fault)
    if "weather" not in overridden and (fault := weather_fault(config, sky)):
        return NightEnd(cause="weather", detail=fault)
    if "sun" not in overridden and (fault := sun_fault(config, now_utc_ns)):
        return NightEnd(cause="dawn", detail=fault)
    return None


def overrides_still_needed(
    config: Config, now_utc_ns: int, sky: SkyReport | None, overridden: Collection[str]
) -> frozenset[str]:
    """Return those overrides whose reason still holds; to be called once a cycle.

    An override applies to the condition at the time it was given: a Sun overridden at dusk still
    ends the night at dawn, and bad weather that comes back after it has cleared ends the night.
    """
    faults = {
        "sun": sun_fault(config, now_utc_ns),
        "weather": weather_fault(config, sky),
        "dome": dome_fault(config, sky),
    }
    return frozenset(name for name in overridden if name not in faults or faults[name])


def sun_fault(config: Config, now_utc_ns: int) -> str:
    """Return in words that the Sun is too high; empty when it is dark."""
    altitude_deg = sun_altitude_deg(config.site.to_site(), now_utc_ns)
    limit_deg = config.limits.twilight_deg
    if altitude_deg <= limit_deg:
        return ""
    return f"the Sun stands at {altitude_deg:+.1f} deg, above the limit of {limit_deg:+.1f}"


def weather_fault(config: Config, sky: SkyReport | None) -> str:
    """Return in words why the weather forbids observing; empty when it allows observing."""
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
    """Return in words why the dome forbids observing; empty when it is open."""
    dome = config.indi.dome
    if dome is None:
        return ""
    word = None if sky is None else sky.dome
    if word == "open":
        return ""
    return _with_detail(f"{dome} is {word or 'silent'}", sky)


def darkness_words(config: Config, now_utc_ns: int) -> str:
    """Return words on when it will be dark, or until when it is."""
    limit_deg = config.limits.twilight_deg
    span = night_span(config.site.to_site(), now_utc_ns, limit_deg)
    if span is None:
        return no_night_text(limit_deg)
    if span[0] <= now_utc_ns:
        return f"it is dark until {utc_ns_to_iso(span[1], 0)}"
    return f"wait until {utc_ns_to_iso(span[0], 0)}"


def _with_detail(words: str, sky: SkyReport | None) -> str:
    return f"{words} ({sky.detail})" if sky is not None and sky.detail else words
