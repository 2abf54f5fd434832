"""A tour of the screen in a few short pages: shown on the first F1, later from the help."""

import contextlib
from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

from textual.binding import Binding, BindingType

from rsoconsole.console.commands.keymap import first_key
from rsoconsole.console.dialogs.dialogs import PagedDialog
from rsoconsole.console.night.engine_view import EngineView
from rsoconsole.night import NightView

SEEN = "tour-seen"
OTHER_NIGHTS = "Other nights: rsoconsole demo --list"


class TourMemory:
    """Remembers by a file in the user's state folder that the tour has been shown."""

    def __init__(self, folder: Path) -> None:
        """``folder``: the user's state folder; made when needed."""
        self._path = folder / SEEN

    @property
    def is_due(self) -> bool:
        """True until the tour has been shown."""
        return not self._path.exists()

    def record_tour_shown(self) -> None:
        """Note that the tour was shown; if the file cannot be written, it is shown once more."""
        with contextlib.suppress(OSError):
            self._path.parent.mkdir(parents=True, exist_ok=True)
            self._path.touch()


def intro_text(night: NightView, engine: EngineView, keymap: Mapping[str, str]) -> str:
    """Return an introduction to a simulated night; empty for others, and once a track has begun."""
    is_young = night.track_frame_id == 0 and night.track is None
    if not (night.is_simulated and engine.is_attached and is_young):
        return ""
    if engine.state not in {"SEARCH", "ACQUIRE", "IDLE"}:
        return ""
    if engine.state == "IDLE":
        help_key = first_key("help", keymap)
        return f"Simulated night; {help_key} explains the screen. {OTHER_NIGHTS}"
    return (
        "Simulated night: the telescope searches for a satellite that nobody told it about, and"
        f" follows it; the first streak comes soon. {first_key('help', keymap)} explains the"
        f" screen. {OTHER_NIGHTS}"
    )


def tour_pages(keymap: Mapping[str, str]) -> tuple[tuple[str, str], ...]:
    """Return the tour's pages as (title, text); a page fits a terminal of 80 x 24."""

    def key(name: str) -> str:
        return first_key(name, keymap)

    return (
        (
            "what you see",
            "First line  state, who has the mount, the target, date and time (UTC).\n\n"
            "Picture     the newest frame. Stars are points, a satellite is a streak:\n"
            "            [━━] with its confidence. The close-up shows its pixels.\n\n"
            "Plots       the newest frame at the right. Confidence: is there a streak?\n"
            "            Residuals: how far it lay from where it was predicted; the\n"
            "            shaded band is the 3σ bounds it should stay in.\n"
            "            NIS: do the filter's settings fit? 'in band' is good.\n\n"
            "Below       where the telescope points, how near its limits are, what\n"
            "            comes next; the log; the keys that matter now.",
        ),
        (
            "what happens by itself",
            "SEARCH   the telescope steps along the sky, two exposures to a field\n"
            "ACQUIRE  one streak: it waits for a second frame\n"
            "TRACK    two frames agree: it predicts, slews ahead, exposes, measures\n"
            "COAST    a frame without it (cloud, shadow): the prediction goes on\n"
            "LOST     coasted too long: back to SEARCH\n"
            "MANUAL   you have the mount\n\n"
            "After some frames the orbit is known well enough for a name from the\n"
            "element files; the first line shows it.",
        ),
        (
            "the keys that matter",
            f"  {key('goto'):<6} go to: coordinates, a satellite, a star; shows the way first\n"
            f"  {key('up_now'):<6} what is up now: satellites by name; enter plans the way\n"
            f"  {key('hold_or_resume'):<6} hold: no slews; once more: give the mount back\n"
            f"  {key('wait_for_sky'):<6} under cloud: hold until it clears, then by itself\n"
            f"  {key('undo'):<6} follow again what was ended, also after a STOP\n"
            f"  {key('mark'):<6} mark a streak by hand\n"
            f"  {key('tune'):<6} tune the filter; its effect is shown before you apply it\n"
            f"  {key('orbit'):<6} the orbit and the name\n"
            f"  {key('night_curves'):<6} the night's curves: sharpness, sky, stars;"
            f" {key('focus_help')} focus; {key('alignment')} drift\n"
            f"  {key('log'):<6} the log      {key('note'):<4} a note\n"
            f"  {key('sessions'):<6} recorded nights, and this one from its beginning\n"
            f"  {key('help'):<6} every key, and what the terms mean",
        ),
        (
            "how to stop",
            f"  {key('stop_by_letter'):<6} STOP. At once, without a question: motion and exposure"
            " end,\n         the engine is disarmed.\n"
            f"  {key('stop'):<6} the same while you type, and in every dialog.\n\n"
            "From any other terminal: rsoconsole stop. It works without an engine too.\n\n"
            f"  {key('leave'):<6} asks: l leaves and the engine goes on ('rsoconsole console'\n"
            "         brings the whole night back), s stops the engine, esc stays.",
        ),
    )


class TourDialog(PagedDialog[bool | None]):
    """Dialog of the tour, a page at a time. Result: True where the help is wanted next."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("space,enter", "go_on", "Next", priority=True),
        Binding("right,down,pagedown", "turn(1)", "Next", show=False, priority=True),
        Binding("left,up,backspace,pageup", "turn(-1)", "Back", priority=True),
        Binding("f1,question_mark", "help", "Help", show=False),
        Binding("q", "put_away", show=False),
    ]

    def __init__(self, keymap: Mapping[str, str]) -> None:
        super().__init__()
        self._pages = tour_pages(keymap)
        self._at = 0

    def action_turn(self, by: int) -> None:
        """Turn by ``by`` pages; an arrow more at the end must not move the telescope."""
        self._at = min(max(self._at + by, 0), len(self._pages) - 1)
        self.show()

    def action_go_on(self) -> None:
        """Turn to the next page; on the last page end the tour."""
        if self._at == len(self._pages) - 1:
            self.dismiss(None)
            return
        self.action_turn(1)

    def action_help(self) -> None:
        """Close with True, which shows the help."""
        self.dismiss(True)

    def page(self) -> tuple[str, str, str]:
        """Return the title, the keys and the text of the present page."""
        title, text = self._pages[self._at]
        is_last = self._at == len(self._pages) - 1
        keys = f"enter {'done' if is_last else 'next'} · ←→ pages · F1 all keys · esc ends"
        return f"tour {self._at + 1} of {len(self._pages)}: {title}", keys, text
