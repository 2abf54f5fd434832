"""An operator's intention in the operator's words."""

import math
import re
from collections.abc import Callable, Mapping
from typing import Any

from rsoconsole.sky.angles import format_dec, format_ra

_CONSOLE = re.compile(r"\bconsole (?=\S+@)")
_COMPASS = (
    *("north", "north-east", "east", "south-east"),
    *("south", "south-west", "west", "north-west"),
)
_EMPTY: tuple[Any, ...] = (None, "", [], (), {})


def without_console(text: str) -> str:
    """The same, with a seat's name for the seat: everybody knows that it is a console."""
    return _CONSOLE.sub("", text)


def wish_words(verb: str, arguments: Mapping[str, Any]) -> str:
    """What was wanted; arguments that say nothing are left out."""
    maker = _WORDS.get(verb)
    words = None if maker is None else maker(arguments)
    used = set() if words is None else _USED[verb]
    rest = {key: value for key, value in arguments.items() if key not in used}
    override = rest.pop("override", None)
    parts = [f"{key} {_plain(value)}" for key, value in rest.items() if value not in _EMPTY]
    if override:
        parts.append(f"overriding {_plain(override)}")
    return ", ".join([words or verb, *parts])


def _goto(arguments: Mapping[str, Any]) -> str | None:
    ra, dec = _number(arguments, "ra_icrs_deg"), _number(arguments, "dec_icrs_deg")
    if ra is None or dec is None:
        return None
    return f"go to α {format_ra(ra, 1)} δ {format_dec(dec, 0)}"


def _nudge(arguments: Mapping[str, Any]) -> str | None:
    east, north = _number(arguments, "east_arcmin"), _number(arguments, "north_arcmin")
    if east is None or north is None:
        return None
    arcmin = math.hypot(east, north)
    size = f"{arcmin:.3g}′" if arcmin >= 0.995 else f"{arcmin * 60:.3g}″"
    return f"nudge {size} {_COMPASS[round(math.degrees(math.atan2(east, north)) / 45.0) % 8]}"


def _set(arguments: Mapping[str, Any]) -> str | None:
    frames = arguments.get("frames")
    lent = "" if frames is None else f" for {frames} frame{'s' if frames != 1 else ''}"
    return f"{arguments.get('name')} {_plain(arguments.get('value'))}{lent}"


def _track(arguments: Mapping[str, Any]) -> str | None:
    return "stand still" if arguments.get("on") is False else "track"


def _hold(arguments: Mapping[str, Any]) -> str | None:
    return "hold until it clears" if arguments.get("until") == "clear" else "hold"


def _choose(arguments: Mapping[str, Any]) -> str | None:
    x, y = _number(arguments, "x"), _number(arguments, "y")
    return None if x is None or y is None else f"follow the streak at {x:.0f}, {y:.0f}"


def _on_frame(verb: str) -> Callable[[Mapping[str, Any]], str | None]:
    def words(arguments: Mapping[str, Any]) -> str:
        frame = arguments.get("frame")
        return verb if frame is None else f"{verb} frame {frame}"

    return words


_WORDS: dict[str, Callable[[Mapping[str, Any]], str | None]] = {
    "goto": _goto,
    "nudge": _nudge,
    "set": _set,
    "track": _track,
    "hold": _hold,
    "choose": _choose,
    "mark": _on_frame("mark by hand in"),
    "accept": _on_frame("accept"),
    "reject": _on_frame("reject"),
}
_USED: dict[str, set[str]] = {
    "goto": {"ra_icrs_deg", "dec_icrs_deg"},
    "nudge": {"east_arcmin", "north_arcmin"},
    "set": {"name", "value", "frames"},
    "track": {"on"},
    "hold": {"until"},
    "choose": {"frame", "x", "y"},
    "accept": {"frame"},
    "reject": {"frame"},
    "mark": {"frame", "x_a", "y_a", "x_b", "y_b", "sigma_px"},
}


def _number(arguments: Mapping[str, Any], name: str) -> float | None:
    value = arguments.get(name)
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return float(value) if is_number and math.isfinite(value) else None  # type: ignore[arg-type]


def _plain(value: Any) -> str:
    return ", ".join(map(str, value)) if isinstance(value, list | tuple) else str(value)
