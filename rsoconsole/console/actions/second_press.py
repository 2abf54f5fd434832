"""Keys that act only on a second press: they end a track or take the mount from autonomy."""

from collections.abc import Callable
from typing import Literal

from rsoconsole.console.actions.seat import OperatorScreen
from rsoconsole.console.commands.keymap import first_key
from rsoconsole.console.night.engine_view import EngineView
from rsoconsole.console.words.words import frame_clock_utc_ns
from rsoconsole.words import NS_PER_S, duration_words

WITHIN_S = 2.0
REPEAT_S = 0.08
"""Least time between two deliberate presses, s: a key held down repeats faster than that."""
SETTLES_S = 0.2
"""Wait after a second press, s: it acts unless a third press follows within that time."""
RELEASED_S = 0.7
"""Time without a press, s, after which a key that was held down counts as released."""
PressOutcome = Literal["asked", "acts", "held"]
TRACKED = frozenset(("TRACK", "COAST"))


def has_track(engine: EngineView) -> bool:
    """Return True where the engine has a track, which a stray key could end."""
    return engine.is_attached and engine.state in TRACKED


class SecondPress:
    """Tells a deliberate second press of a key from a first press, another key and a held key."""

    def __init__(self) -> None:
        self._name = ""
        self._asked_s = 0.0
        self._last_s = 0.0
        self._acted_s = 0.0
        self._is_held = False
        self.number = 0
        """Number of the last press; a higher number than at the second press cancels its action."""

    def receive(self, name: str, now_s: float) -> PressOutcome:
        """Return what a press does: "asked" (press again), "acts", or "held" (held down).

        ``name``: the name of the key's command; ``now_s``: monotonic time, s.
        """
        self.number += 1
        since_s, self._last_s = now_s - self._last_s, now_s
        if name == self._name:
            is_third = now_s - self._acted_s < SETTLES_S
            shortest_s = RELEASED_S if self._is_held else REPEAT_S
            if is_third or since_s < shortest_s:
                self._is_held, self._asked_s = True, 0.0
                return "held"
            if now_s - self._asked_s <= WITHIN_S:
                self._asked_s, self._acted_s = 0.0, now_s
                return "acts"
        self._name, self._asked_s, self._is_held = name, now_s, False
        return "asked"

    def note_repeat(self, now_s: float) -> None:
        """Note that the key of the next press came as a key held down repeats, however late it is
        handled.
        """
        self._last_s = now_s

    def forget(self) -> None:
        """Forget the first press and cancel a waiting action, because another key was pressed."""
        self.number += 1
        self._name, self._is_held = "", False


class TwoPressKeys:
    """Runs actions that end a track or take the mount on the second press of their key."""

    def __init__(self, seat: OperatorScreen) -> None:
        self._seat = seat
        self.press = SecondPress()

    def handle_press(self, name: str, what: str, act: Callable[[], None], key: str = "") -> None:
        """Handle a press: the first announces the effect, the second runs ``act``.

        A click does not count as a press: it shows which key to press.
        ``name``: the command's name.
        ``what``: the effect, as the notice "a again within 2 s ..." continues.
        ``key``: the key's name, where the key belongs to no command.
        """
        seat, press = self._seat, self.press
        if seat.is_click:
            self.show_key_to_press(name, what)
            return
        stage = press.receive(name, seat.now_s())
        key = key or first_key(name, seat.keymap)
        if stage == "asked":
            seat.say(f"{key} again within {WITHIN_S:.0f} s {what}", "warn", WITHIN_S)
        elif stage == "held":
            seat.say(f"{key} is held down: nothing is done", "warn")
        else:
            number = press.number

            def unless_held() -> None:
                if press.number == number:
                    act()

            seat.set_timer(SETTLES_S, unless_held)

    def show_key_to_press(self, name: str, what: str) -> None:
        """Say which key, pressed twice, does what was clicked; ``what``: its effect in words."""
        self.press.forget()
        key = first_key(name, self._seat.keymap)
        self._seat.say(f"{key} twice within {WITHIN_S:.0f} s {what}: not by the mouse", "warn")

    def track_words(self) -> str:
        """Return the name and age of the followed track, as in "INTELSAT 14 (31 min)"."""
        seat = self._seat
        name = seat.target_name() or "an unidentified object"
        since, now = seat.night.track_since_utc_ns, frame_clock_utc_ns(seat.night, seat.engine)
        if since is None or now is None:
            return name
        return f"{name} ({duration_words((now - since) / NS_PER_S)})"
