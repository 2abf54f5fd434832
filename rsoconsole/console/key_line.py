"""The last line: the keys that matter now, and a word about what was just done."""

from collections.abc import Callable

from rsoconsole.console.engine_view import EngineView
from rsoconsole.console.plot import Ink, Line
from rsoconsole.console.words import clipped

Key = tuple[str, str]

_GAP = "  "
_ALWAYS = ("x", "a", "q", "F1")
"""These stay while there is any room; the first of them to the last."""
_LEAST_NOTICE_COLUMNS = 24


def keys_for(engine: EngineView, *, can_act: bool, is_marking: bool = False) -> list[Key]:
    """The keys in their order on the line; which of them act depends on who has the mount."""
    keys: list[Key] = [("x", "STOP")]
    if is_marking:
        return [*keys, ("↑↓←→", "Move"), ("enter", "Set"), ("esc", "Leave off"), ("F1", "Help")]
    if can_act:
        keys.append(("a", "Disarm" if engine.holder == "autonomy" else "Arm"))
        if engine.holder in {"autonomy", "operator"}:
            keys.append(("h", "Resume" if engine.wants_resuming else "Hold"))
        keys += [("g", "Go to"), ("m", "Mark"), ("t", "Tune"), ("n", "Note"), ("p", "Park")]
    return [*keys, ("q", "Leave"), ("l", "Log"), ("z", "Zoom"), ("F1", "Help"), ("^p", "More")]


def key_line(
    keys: list[Key], notice: tuple[str, Ink] = ("", "")
) -> Callable[[int, int], list[Line]]:
    """What builds the line for a width: the keys that fit, most important first.

    A notice stands behind those that leave it room: whole, or shortened behind those that always
    stay, or where that is too narrow, behind STOP alone.
    """

    def build(width: int, _height: int) -> list[Line]:
        if not notice[0]:
            return [_line(_fitting(keys, width), width)]
        weighty = [key for key in keys if key[0] in _ALWAYS]
        kept = _fitting(keys, max(width - len(_GAP) - len(notice[0]), 0))
        if not set(weighty) <= set(kept):
            kept = _fitting(weighty, max(width - _LEAST_NOTICE_COLUMNS, 0))
        if not set(weighty) <= set(kept):
            kept = keys[:1]
        line = _line(kept, width)
        columns = sum(len(text) for text, _ in line)
        return [[*line, *clipped([notice], max(width - columns, 0))]]

    return build


def _fitting(keys: list[Key], width: int) -> list[Key]:
    """The first and the most important ones that fit, in their order on the line."""
    by_weight = sorted(keys, key=lambda key: key[0] not in _ALWAYS)
    room, fitting = width - 1 + len(_GAP), keys[:1]
    for key in by_weight:
        columns = len(" ".join(key)) + len(_GAP)
        if columns > room:
            break
        room -= columns
        fitting.append(key)
    return [key for key in keys if key in fitting]


def _line(keys: list[Key], width: int) -> Line:
    line: Line = [(" ", "")]
    for key, name in keys:
        ink: Ink = "alarm" if name == "STOP" else "title"
        line += [(key, ink), (f" {name}{_GAP}", ink if name == "STOP" else "")]
    spare = sum(len(text) for text, _ in line) - width
    if 0 < spare <= len(_GAP):
        line[-1] = (line[-1][0][:-spare], line[-1][1])
    return clipped(line, width)
