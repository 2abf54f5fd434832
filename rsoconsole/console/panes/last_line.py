"""The last line: the keys that matter now, and a notice about the last action."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Literal, NamedTuple

from textual.events import Click
from textual.widget import Widget

from rsoconsole.console.commands.commands import BY_NAME
from rsoconsole.console.commands.keymap import first_key
from rsoconsole.console.drawing.plot import Ink, Line
from rsoconsole.console.night.engine_view import EngineView
from rsoconsole.console.words.words import cut_to_width, wrap_to_rows
from rsoconsole.pipeline import HELD

Mode = Literal[
    "live",
    "mark",
    "tune",
    "tracks",
    "log",
    "review",
    "review tune",
    "review tracks",
    "review log",
    "sheet",
    "sheet mark",
]
"""What the keys mean at a moment."""


class Key(NamedTuple):
    """Key as shown in the last line, with a short name of its action.

    ``is_important``: True for keys that are kept longest where there is no room for all.
    """

    key: str
    name: str
    is_important: bool = False
    command: str = ""
    """Action that a click on the key runs; empty: none."""
    words: str = ""
    """Explanation of the key in the help; empty: its name suffices."""


_GAP = "  "
MIN_LINES = 8
"""Least rows of a terminal in which a notice has rows of its own."""
MAX_NOTICE_ROWS = 3
MARKABLE = 12
"""Last frames in which a mark can be begun: ``KEPT`` of ``pipeline/cycle/decisions.py``."""
MARK_HELP = (
    f"a streak's two ends. A mark can be begun in the last {MARKABLE} frames; its frame can be"
    f" marked from then on, while {HELD} more frames come"
)
STEP_HELP = (
    "how many squares an arrow goes: 1, 4, 16, 64 (on the main screen these keys set the step by"
    " which arrows move the mount)"
)
_CHANGE = (Key("↑↓", "Choose"), Key("←→", "Change"))
_PUT_AWAY = (
    *(Key("u", "Undo"), Key("w", "Save"), Key("o", "Load")),
    Key("esc", "Close", is_important=True),
)
MODE_KEYS: dict[Mode, tuple[Key, ...]] = {
    "live": (),
    "review": (),
    "review tune": (*_CHANGE, Key("A", "All frames"), *_PUT_AWAY),
    "review tracks": (
        Key("↑↓", "Choose", is_important=True),
        Key("1", "Its plots", command="track_plots"),
        Key(", .", "Frame"),
        Key("esc", "Close", is_important=True),
    ),
    "review log": (
        Key("↑↓", "Choose", is_important=True),
        Key("enter", "Go there", is_important=True),
        Key("/", "Search"),
        Key("esc", "Back", is_important=True),
    ),
    "mark": (
        Key("↑↓←→", "Move"),
        Key("enter", "Set", is_important=True),
        Key("shift", "Far", words="with an arrow: five squares"),
        Key("O", "Signs", words="the signs of the streaks, hidden meanwhile"),
        Key("esc", "Leave off", is_important=True),
    ),
    "tune": (*_CHANGE, Key("enter", "Apply"), Key("f", "For frames"), *_PUT_AWAY),
    "tracks": (
        Key("↑↓", "Choose", is_important=True),
        Key("enter", "Make it the lead", is_important=True),
        Key("-", "Drop", is_important=True),
        Key("+", "Keep"),
        Key("1", "Its plots", command="track_plots"),
        Key("esc", "Close", is_important=True),
    ),
    "log": (
        Key("↑↓", "Scroll", is_important=True),
        Key("/", "Filter", is_important=True),
        Key("esc", "Back", is_important=True),
    ),
    "sheet": (
        Key("esc", "Back", is_important=True, command="back"),
        Key(", .", "τ", is_important=True, words="τ smaller, larger: the frame is processed again"),
        Key("+ -", "Zoom", is_important=True, words="nearer, farther, by two"),
        Key("m", "Mark", is_important=True, command="mark", words=MARK_HELP),
        Key("PgUp PgDn", "Frame", words="the frame before, after, of those whose pixels are kept"),
        Key("d", "Next candidate", command="next_candidate", words="to the next candidate"),
        Key("↑↓←→", "Move", words="move the cross ╋; with shift five steps"),
        Key("[ ]", "Step", words=STEP_HELP),
        Key("M", "Map", command="map_mode", words="fast or paper map for the network, and again"),
        Key(
            "V",
            "Network's view",
            command="network_view",
            words="the map that the network looks at, instead of the frame; and back",
        ),
        Key("f", "Stretch", command="stretch", words="how light becomes grey: the next way"),
        Key("O", "Marks", command="marks", words="signs over the picture off, to see beneath; on"),
        Key("P", "Solve again", command="plate", words="a plate from this frame's stars alone"),
        Key("R", "As recorded", command="as_recorded", words="nothing tried any more"),
        Key("L", "List", command="list", words="all candidates on the whole screen, and back"),
    ),
    "sheet mark": (
        Key("enter", "Set", is_important=True, command="set_end", words="the cross ╋ is an end"),
        Key("↑↓←→", "Move", is_important=True, words="the cross ╋"),
        Key("shift", "Far", words="with an arrow: five steps"),
        Key("[ ]", "Step", is_important=True, words=STEP_HELP),
        Key("+ -", "Zoom", words="nearer, farther: the closer, the surer the mark"),
        Key("O", "Signs", command="marks", words="the signs of the streaks, hidden meanwhile"),
        Key("esc", "Leave off", is_important=True, command="back", words="no mark is sent"),
    ),
}
MODE_WORDS: dict[Mode, str] = {
    "live": "",
    "mark": "Now: a streak's two ends are marked by hand",
    "tune": "Now: the tuning pane",
    "tracks": "Now: the list of tracks",
    "log": "Now: the whole log",
    "review": "",
    "review tune": "Now: the tuning pane, over what has been recorded",
    "review tracks": "Now: the list of tracks at this moment",
    "review log": "Now: the log of the whole night; what came later is dim",
    "sheet": "Now: one frame at full resolution",
    "sheet mark": "Now: a streak's two ends are marked in one frame at full resolution",
}


def _command_key(
    keymap: Mapping[str, str] | None, command: str, name: str, *, is_important: bool = False
) -> Key:
    return Key(first_key(command, keymap), name, is_important, command)


def live_keys(
    engine: EngineView,
    *,
    can_act: bool,
    mode: Mode = "live",
    keymap: Mapping[str, str] | None = None,
    is_in_cloud: bool = False,
    has_several: bool = False,
) -> list[Key]:
    """Return the keys of the live screen in order, by who has the mount and what the mode is.

    ``can_act``: whether this console may send commands.
    ``keymap``: other keys for commands, by the command's name.
    ``is_in_cloud``: True where cloud is the cause of the lead's last miss.
    ``has_several``: two or more tracks are followed.
    """
    key = partial(_command_key, keymap)
    keys = [key("stop_by_letter", "STOP", is_important=True)]
    if mode != "live":
        return [*keys, *MODE_KEYS[mode], key("help", "Help")]
    if can_act:
        arm = "Disarm" if engine.holder == "autonomy" else "Arm"
        keys.append(key("arm_or_disarm", arm, is_important=True))
        if engine.kept:
            keys.append(key("undo", "Follow again", is_important=True))
            if engine.holder == "operator":
                keys.append(key("hold_or_resume", "Give back", is_important=True))
        if engine.is_held or (engine.is_autonomy_waiting and not engine.kept):
            keys.append(key("hold_or_resume", "Resume"))
        elif engine.holder == "autonomy":
            keys.append(key("hold_or_resume", "Hold"))
            if is_in_cloud:
                keys.append(key("wait_for_sky", "Hold until it clears", is_important=True))
        named = {"goto": "Go to", "tune": "Tune", "orbit": "Orbit", "note": "Note", "park": "Park"}
        if engine.holder in {"autonomy", "operator"}:
            named = {"goto": "Go to", "mark": "Mark", **named}
        keys += [key(command, name) for command, name in named.items()]
    return [
        *keys,
        *([key("track_list", "Satellites", is_important=True)] if has_several else []),
        key("leave", "Leave", is_important=True),
        key("log", "Log"),
        key("zoom", "Zoom"),
        *([] if can_act else [key("orbit", "Orbit")]),
        key("help", "Help", is_important=True),
        Key("^p", "More"),
    ]


def review_keys(
    *,
    is_playing: bool,
    has_live: bool,
    has_mark: bool,
    mode: Mode,
    keymap: Mapping[str, str],
    has_several: bool = False,
) -> list[Key]:
    """Return the keys of a review in order.

    ``has_live``: a live screen lies behind the review.
    ``has_mark``: moment A is kept, to compare with.
    ``keymap``: other keys for commands, by the command's name.
    ``has_several``: two or more tracks are followed.
    """
    key = partial(_command_key, keymap)

    def keys(first: str, second: str, name: str) -> Key:
        return Key(f"{first_key(first, keymap)} {first_key(second, keymap)}", name, False, second)

    # The mount of the present, which the engine or the configuration names; never the recorded one.
    stop = key("stop_by_letter", "STOP", is_important=True)
    if mode != "review":
        return [stop, *MODE_KEYS[mode], key("help", "Help")]
    return [
        stop,
        key("play", "Pause" if is_playing else "Play", is_important=True),
        keys("frame_back", "frame_on", "Frame"),
        keys("event_back", "event_on", "Event"),
        key("event_kind", "Kind"),
        key("goto_moment", "Go to"),
        keys("slower", "faster", "Speed"),
        key("compare", "Compare" if has_mark else "Keep A"),
        *([key("blink", "Blink")] if has_mark else []),
        *([key("track_list", "Satellites", is_important=True)] if has_several else []),
        key("leave", "Live" if has_live else "Leave", is_important=True),
        key("sessions", "Sessions"),
        key("log", "Log"),
        key("filter_log", "Search"),
        key("tune", "Tune"),
        key("orbit", "Orbit"),
        key("help", "Help", is_important=True),
        Key("^p", "More"),
    ]


def key_line(
    keys: list[Key], notice: tuple[str, Ink] = ("", "")
) -> Callable[[int, int], list[Line]]:
    """Return the function that builds the last line: the keys that fit, important ones first.

    ``notice``: (text, ink), written above the keys where there are rows for it, else behind STOP.
    """

    def build(width: int, height: int) -> list[Line]:
        words, ink = notice
        if words and height > 1:
            said: list[Line] = [
                [(" ", ""), *((text, ink) for text, _ in row)]
                for row in wrap_to_rows(words, width - 1, height - 1)
            ]
            said += [[("", "")] for _ in range(height - 1 - len(said))]
            return [*said, _line(_fitting(keys, width), width)]
        line = _line(keys[:1] if words else _fitting(keys, width), width)
        columns = sum(len(text) for text, _ in line)
        return [[*line, *cut_to_width([notice], max(width - columns, 0))] if words else line]

    return build


def notice_rows(notice: str, width: int, height: int) -> int:
    """Return how many rows above the keys a notice takes in a terminal of that size."""
    if not notice or height < MIN_LINES:
        return 0
    return len(wrap_to_rows(notice, width - 1, MAX_NOTICE_ROWS))


def clicked_action(event: Click, pane: Widget, keys: list[Key], notice: str) -> str:
    """Return the action of the clicked key, as Textual writes it; empty: no key was clicked.

    ``pane``: the pane that shows the keys; ``notice``: the notice in the same pane.
    """
    if event.widget is not pane or event.y != pane.size.height - 1:
        return ""
    has_notice_behind = bool(notice) and pane.size.height == 1
    at = 1
    for key in keys[:1] if has_notice_behind else _fitting(keys, pane.size.width):
        columns = len(f"{key.key} {key.name}")
        if at <= event.x < at + columns:
            command = BY_NAME.get(key.command)
            is_everywhere = command is not None and command.is_everywhere
            return f"app.{key.command}" if is_everywhere else key.command
        at += columns + len(_GAP)
    return ""


def _fitting(keys: list[Key], width: int) -> list[Key]:
    """Return the first key and the most important others that fit, in their order."""
    by_weight = sorted(keys, key=lambda key: not key.is_important)
    room, fitting = width - 1 + len(_GAP), keys[:1]
    for key in by_weight:
        columns = len(f"{key.key} {key.name}{_GAP}")
        if columns > room:
            break
        room -= columns
        fitting.append(key)
    return [key for key in keys if key in fitting]


def _line(keys: list[Key], width: int) -> Line:
    line: Line = [(" ", "")]
    for key, name, *_ in keys:
        is_stop = name.startswith("STOP")
        ink: Ink = "alarm" if is_stop else "title"
        line += [(key, ink), (f" {name}{_GAP}", ink if is_stop else "")]
    spare = sum(len(text) for text, _ in line) - width
    if 0 < spare <= len(_GAP):
        line[-1] = (line[-1][0][:-spare], line[-1][1])
    return cut_to_width(line, width)
