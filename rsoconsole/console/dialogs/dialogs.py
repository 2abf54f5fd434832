"""Dialogs: their base, messages, arming, confirming, leaving. STOP works in each of them."""

import math
import time
from collections.abc import Collection, Mapping, Sequence
from typing import Any, ClassVar, Generic, Literal, TypeVar

from textual.app import ComposeResult
from textual.await_complete import AwaitComplete
from textual.binding import Binding, BindingType
from textual.containers import Vertical, VerticalScroll
from textual.events import Event, Key, Mount
from textual.screen import ModalScreen
from textual.widgets import Button, Static

UNASKED_DEAF_S = 0.5
"""Seconds that a dialog that opened by itself takes no answer, and again after each key it drops:
such keys were meant for the screen below."""
LeaveChoice = Literal["leave", "stop engine", "stay"]
Result = TypeVar("Result")


def dialog_box(title: str, keys: str = "") -> VerticalScroll:
    """Return the box of a dialog: its title above, its keys below."""
    box = VerticalScroll()
    box.border_title, box.border_subtitle = title, keys
    return box


class Dialog(ModalScreen[Result], Generic[Result]):
    """Box in the middle of the screen, closed by Esc."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape", "put_away", "Back"),
        Binding("up,left", "app.focus_previous", show=False),
        Binding("down,right", "app.focus_next", show=False),
    ]
    DEFAULT_CSS = """
    Dialog { align: center middle; }
    Dialog > VerticalScroll {
        width: 78; max-width: 100%; height: auto; max-height: 100%;
        background: $surface; border: solid $primary; padding: 0 1;
    }
    Dialog Static { height: auto; }
    Dialog Button { margin: 0 1 0 0; }
    Dialog Button:focus { text-style: bold reverse; }
    Dialog .choices { height: auto; margin: 1 0 0 0; }
    Dialog Tick:focus { text-style: bold reverse; }
    Dialog .remedy { padding: 0 0 0 4; color: $text-muted; }
    """

    closed_s: ClassVar[float] = 0.0
    """Time at which the last dialog was closed, in monotonic seconds."""
    opens_unasked = False
    """True where the engine's answer opened it, not a key."""
    _opened_s = math.inf
    _dropped_s = -math.inf
    """Time at which a key was dropped last, in monotonic seconds."""

    async def on_event(self, event: Event) -> None:
        """Drop keys while ``is_deaf``, and the mount event of a dialog closed before it was drawn.

        Words typed blindly are dropped as a whole: no key right after a dropped one acts. STOP
        never comes here: the application takes it first.
        """
        if isinstance(event, Mount) and self not in self.app.screen_stack:
            return
        if isinstance(event, Key) and event.key != "escape" and self.ignores_keys:
            self._dropped_s = time.monotonic()
            event.stop()
            event.prevent_default()
            return
        await super().on_event(event)

    def on_mount(self) -> None:
        """Note the first paint: from then on it can be read."""
        self.call_after_refresh(self._note_opened)

    def _note_opened(self) -> None:
        self._opened_s = time.monotonic()

    @property
    def ignores_keys(self) -> bool:
        """True while keys are dropped: they were meant for the screen below. Esc always works."""
        since_s = max(self._opened_s, self._dropped_s)
        return self.opens_unasked and time.monotonic() < since_s + UNASKED_DEAF_S

    def dismiss(self, result: Result | None = None) -> AwaitComplete:
        """Close; note the time, since keys typed right after it may still be meant for it."""
        Dialog.closed_s = time.monotonic()
        return super().dismiss(result)

    def action_put_away(self) -> None:
        """Close without a choice."""
        self.dismiss(None)


class PagedDialog(Dialog[Result], Generic[Result]):
    """Dialog with pages of text, one at a time."""

    def compose(self) -> ComposeResult:
        """Make one page."""
        with VerticalScroll():
            yield Static("", id="page", markup=False)

    def on_mount(self) -> None:
        """Show the first page."""
        self.show()

    def page(self) -> tuple[str, str, str]:
        """Title, keys and text of the page."""
        raise NotImplementedError

    def show(self) -> None:
        """Draw the page."""
        box = self.query_one(VerticalScroll)
        box.border_title, box.border_subtitle, text = self.page()
        self.query_one("#page", Static).update(text)


class Tick(Static, can_focus=True):
    """Line with a box to tick; the tick is a sign, not a colour."""

    BINDINGS: ClassVar[list[BindingType]] = [Binding("space,enter", "tick", "Tick")]

    def __init__(self, words: str, *, id: str, is_on: bool = False) -> None:  # noqa: A002 -- as all widgets have it
        super().__init__(f"[{'x' if is_on else ' '}] {words}", markup=False, id=id)
        self._words = words
        self.is_on = is_on

    def action_tick(self) -> None:
        """Toggle the tick."""
        if isinstance(self.screen, Dialog) and self.screen.ignores_keys:
            return
        self.is_on = not self.is_on
        self.update(f"[{'x' if self.is_on else ' '}] {self._words}")

    def on_click(self) -> None:
        """Toggle the tick by the mouse."""
        self.action_tick()


class MessageDialog(Dialog[None]):
    """Dialog with a message in full."""

    def __init__(self, title: str, text: str) -> None:
        super().__init__()
        self._title, self._text = title, text

    def compose(self) -> ComposeResult:
        """Make the message; any key closes it, unless it opened by itself."""
        with dialog_box(self._title, "esc or enter back" if self.opens_unasked else "any key back"):
            yield Static(self._text, markup=False)

    def on_key(self, event: Key) -> None:
        """Close the message. Keys of STOP never come here.

        Where it opened by itself, the first letter of a word must not close it: the letters behind
        it would act.
        """
        event.stop()
        event.prevent_default()
        if event.key in {"escape", "enter"} or not self.opens_unasked:
            self.dismiss(None)

    def on_click(self) -> None:
        """Close by the mouse."""
        self.dismiss(None)


class ArmDialog(Dialog[tuple[str, ...] | None]):
    """Dialog of the failed arming checks; those that are ticked are overridden by name.

    Gives the names to override, or None.
    """

    def __init__(
        self, message: str, checks: Sequence[Mapping[str, Any]], ticked: Collection[str] = ()
    ) -> None:
        """``ticked``: names overridden before, ticked at first."""
        super().__init__()
        self._message = message
        self._failed = [check for check in checks if not check.get("ok")]
        self._passed = [check for check in checks if check.get("ok")]
        self._ticked = ticked

    def compose(self) -> ComposeResult:
        """Make the message, a box to tick for each failed check, and two buttons."""
        with dialog_box("not armed", "space ticks · ↑↓ move · esc back"):
            intro = "These stand against it; tick what you answer for, by name and on record."
            yield Static(intro if self._failed else self._message, markup=False)
            for number, check in enumerate(self._failed):
                words = f"{check.get('name')}: {check.get('detail') or 'failed'}"
                is_on = check.get("name") in self._ticked
                yield Tick(words, id=f"check-{number}", is_on=is_on)
                if check.get("remedy"):
                    yield Static(str(check["remedy"]), markup=False, classes="remedy")
            if self._passed:
                passed = ", ".join(str(check.get("name")) for check in self._passed)
                yield Static(f"well: {passed}", markup=False, classes="remedy")
            with Vertical(classes="choices"):
                yield Button("Stay disarmed", id="stay", compact=True)
                if self._failed:
                    yield Button("Arm, overriding the ticked", id="arm", compact=True)

    def on_mount(self) -> None:
        """Put the cursor on the first box; enter there arms nothing."""
        first = self.query(Tick).first() if self._failed else self.query_one("#stay", Button)
        first.focus()

    def on_button_pressed(self, event: Button.Pressed) -> None:
        """Arm anyway, or cancel."""
        event.stop()
        if self.ignores_keys:
            return
        if event.button.id != "arm":
            self.dismiss(None)
            return
        ticked = [
            str(check.get("name"))
            for number, check in enumerate(self._failed)
            if self.query_one(f"#check-{number}", Tick).is_on
        ]
        self.dismiss(tuple(ticked))


class ConfirmDialog(Dialog[bool | None]):
    """Dialog with a question; only the second button or its letter confirms. Gives True or not."""

    def __init__(
        self, title: str, text: str, *, yes: str, letter: str, is_yes: bool = False
    ) -> None:
        """``is_yes``: enter confirms, where nothing moves by it."""
        super().__init__()
        self._proposed = "#yes" if is_yes else "#back"
        self._title, self._text, self._yes, self._letter = title, text, yes, letter

    def compose(self) -> ComposeResult:
        """Make the question and two buttons."""
        with dialog_box(self._title):
            yield Static(self._text, markup=False)
            with Vertical(classes="choices"):
                yield Button("esc  Back", id="back", compact=True)
                yield Button(f"{self._letter}  {self._yes}", id="yes", compact=True)

    def on_mount(self) -> None:
        """Put the cursor where enter moves nothing."""
        self.query_one(self._proposed, Button).focus()

    def on_button_pressed(self, event: Button.Pressed) -> None:
        """Confirm or cancel."""
        event.stop()
        if not self.ignores_keys:
            self.dismiss(event.button.id == "yes")

    def on_key(self, event: Key) -> None:
        """Confirm or cancel by letter."""
        if event.key == self._letter:
            event.stop()
            if not self.ignores_keys:
                self.dismiss(True)


class LeaveDialog(Dialog[LeaveChoice | None]):
    """Dialog that asks about the future of the engine when the console is left."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("l", "choose('leave')", "Leave it running"),
        Binding("s", "choose('stop engine')", "Stop the engine"),
        Binding("q", "put_away", "Stay", show=False),
    ]

    CHOICES: ClassVar[dict[LeaveChoice, str]] = {
        "leave": "l  Leave: the engine keeps running and recording",
        "stop engine": "s  Stop the engine: the mount stops, the session is closed",
        "stay": "esc  Stay here",
    }

    def __init__(self, state_words: str, *, proposes_staying: bool) -> None:
        """``proposes_staying``: the telescope moves by hand, and no other console looks at it."""
        super().__init__()
        self._state_words = state_words
        self._proposes_staying = proposes_staying

    def compose(self) -> ComposeResult:
        """Make three choices; the proposed one has the focus."""
        with dialog_box("leave the console"):
            yield Static(self._state_words, markup=False)
            with Vertical(classes="choices"):
                for choice, words in self.CHOICES.items():
                    yield Button(words, name=choice, id=choice.replace(" ", "-"), compact=True)

    def on_mount(self) -> None:
        """Put the cursor on the safe choice: it never ends the engine."""
        self.query_one("#stay" if self._proposes_staying else "#leave", Button).focus()

    def on_button_pressed(self, event: Button.Pressed) -> None:
        """Take one of the three."""
        event.stop()
        self.dismiss(next(each for each in self.CHOICES if each == event.button.name))

    def action_choose(self, choice: LeaveChoice) -> None:
        """Take a choice by letter."""
        self.dismiss(choice)
