"""Base of all dialogs, and those for messages, arming, confirming, leaving. STOP works in each."""

import math
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any, ClassVar, Generic, Literal, TypeVar

from textual.app import ComposeResult
from textual.await_complete import AwaitComplete
from textual.binding import Binding, BindingType
from textual.containers import Vertical, VerticalScroll
from textual.events import Event, Key, Mount
from textual.screen import ModalScreen
from textual.widgets import Button, Static

UNASKED_DEAF_S = 0.5
"""Seconds for which a dialog that opened by itself drops keys, and again after each such key."""
STATE_EVERY_S = 0.5
LeaveChoice = Literal["leave", "stop engine", "stay"]
Result = TypeVar("Result")


def dialog_box(title: str, keys: str = "") -> VerticalScroll:
    """Return a dialog's box with ``title`` in its upper and ``keys`` in its lower border."""
    box = VerticalScroll()
    box.border_title, box.border_subtitle = title, keys
    return box


class Dialog(ModalScreen[Result], Generic[Result]):
    """Base of dialogs: a box in the middle of the screen, closed by Esc."""

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
    """Time at which a dialog was closed last, monotonic seconds."""
    opens_unasked = False
    """True where the engine's answer opened the dialog, not a key."""
    ANSWERS: ClassVar[frozenset[str] | None] = frozenset()
    """Keys that answer a question which must have been read; None: every key but Esc."""
    _opened_s = math.inf
    """Time of the first paint, or that of the last question, monotonic seconds."""
    _dropped_s = -math.inf
    """Time at which a key was dropped last, monotonic seconds."""

    async def on_event(self, event: Event) -> None:
        """Handle an event; drop keys while ``ignores_keys`` is True, and answers typed too early.

        Each dropped key prolongs that time, so that a word typed blindly is dropped as a whole. An
        answer is too early where it was typed before the question was drawn. STOP never comes here:
        the application handles it first. A dialog closed before it was drawn is not mounted.
        """
        if isinstance(event, Mount) and self not in self.app.screen_stack:
            return
        if isinstance(event, Key) and event.key != "escape":
            is_early = self._is_answer(event.key) and event.time < self._opened_s
            if self.ignores_keys or is_early:
                self._dropped_s = time.monotonic()
                if is_early:
                    self.say_too_early(event.key)
                event.stop()
                event.prevent_default()
                return
        await super().on_event(event)

    def on_mount(self) -> None:
        """Note the time of the first paint."""
        self.note_question()

    def note_question(self) -> None:
        """Note the time at which what has just been written is painted: it can be read then."""
        self._opened_s = math.inf
        self.call_after_refresh(self._note_opened)

    def _note_opened(self) -> None:
        self._opened_s = time.monotonic()

    def say_too_early(self, key: str) -> None:
        """Say in the lower border that an answer came before its question could be read."""
        box = self.query(VerticalScroll).first()
        box.border_subtitle = f"{key} came before this could be read: again · esc back"

    def _is_answer(self, key: str) -> bool:
        return self.ANSWERS is None or key in self.ANSWERS

    @property
    def ignores_keys(self) -> bool:
        """True while keys other than Esc are dropped: they were meant for the screen below."""
        since_s = max(self._opened_s, self._dropped_s)
        return self.opens_unasked and time.monotonic() < since_s + UNASKED_DEAF_S

    def dismiss(self, result: Result | None = None) -> AwaitComplete:
        """Close with a result; note the time, since keys typed right after may be meant for it."""
        Dialog.closed_s = time.monotonic()
        return super().dismiss(result)

    def action_put_away(self) -> None:
        """Close without a choice."""
        self.dismiss(None)


class PagedDialog(Dialog[Result], Generic[Result]):
    """Base of dialogs with pages of text, one shown at a time."""

    def compose(self) -> ComposeResult:
        """Make the widget that shows a page."""
        with VerticalScroll():
            yield Static("", id="page", markup=False)

    def on_mount(self) -> None:
        """Draw the first page."""
        self.show()

    def page(self) -> tuple[str, str, str]:
        """Return the title, the keys and the text of the present page."""
        raise NotImplementedError

    def show(self) -> None:
        """Draw the page that ``page`` returns."""
        box = self.query_one(VerticalScroll)
        box.border_title, box.border_subtitle, text = self.page()
        self.query_one("#page", Static).update(text)


class Tick(Static, can_focus=True):
    """Check box with a line of text; its state is shown by a sign and not by colour alone."""

    BINDINGS: ClassVar[list[BindingType]] = [Binding("space,enter", "tick", "Tick")]

    def __init__(self, words: str, *, id: str, is_on: bool = False) -> None:  # noqa: A002 -- as all widgets have it
        super().__init__(f"[{'x' if is_on else ' '}] {words}", markup=False, id=id)
        self._words = words
        self.is_on = is_on

    def action_tick(self) -> None:
        """Tick or untick the box."""
        if isinstance(self.screen, Dialog) and self.screen.ignores_keys:
            return
        self.is_on = not self.is_on
        self.update(f"[{'x' if self.is_on else ' '}] {self._words}")

    def on_click(self) -> None:
        """Tick or untick the box by the mouse."""
        self.action_tick()


class MessageDialog(Dialog[None]):
    """Dialog that shows a message in full."""

    def __init__(self, title: str, text: str) -> None:
        super().__init__()
        self._title, self._text = title, text

    def compose(self) -> ComposeResult:
        """Make the message, with the keys that close it in the border."""
        with dialog_box(self._title, "esc or enter back" if self.opens_unasked else "any key back"):
            yield Static(self._text, markup=False)

    def on_key(self, event: Key) -> None:
        """Close the dialog by any key; by esc or enter alone if no key had opened the dialog.

        Without that exception the first letter of a word typed blindly would close it, and the
        letters after it would act on the screen below. STOP's keys never come here.
        """
        event.stop()
        event.prevent_default()
        if event.key in {"escape", "enter"} or not self.opens_unasked:
            self.dismiss(None)

    def on_click(self) -> None:
        """Close the dialog by the mouse."""
        self.dismiss(None)


class ArmDialog(Dialog[tuple[str, ...] | None]):
    """Dialog of the failed arming checks, to override by ticking them.

    Result: the names of the checks to override; None: stay disarmed.
    """

    def __init__(
        self, message: str, checks: Sequence[Mapping[str, Any]], ticked: Collection[str] = ()
    ) -> None:
        """Make the dialog.

        ``message``: shown where no check is known to have failed.
        ``checks``: the engine's arming checks, each with name, ok, detail and remedy.
        ``ticked``: names of checks overridden before, which are ticked at first.
        """
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
        """Put the cursor on the first box to tick, where enter arms nothing."""
        first = self.query(Tick).first() if self._failed else self.query_one("#stay", Button)
        first.focus()

    def on_button_pressed(self, event: Button.Pressed) -> None:
        """Close with the ticked names, or with None."""
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
    """Dialog with a question to confirm. Result: True if confirmed, else False or None."""

    ANSWERS = None

    def __init__(
        self, title: str, text: str, *, yes: str, letter: str, is_yes: bool = False
    ) -> None:
        """Make the dialog.

        ``yes``: words on the confirming button.
        ``letter``: key that confirms.
        ``is_yes``: True where enter confirms, since nothing moves by it.
        """
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
        """Put the cursor on the button that enter presses: the safe one."""
        self.query_one(self._proposed, Button).focus()

    def on_button_pressed(self, event: Button.Pressed) -> None:
        """Close with True for the confirming button, else with False."""
        event.stop()
        if not self.ignores_keys:
            self.dismiss(event.button.id == "yes")

    def on_key(self, event: Key) -> None:
        """Close with True at the confirming letter."""
        if event.key == self._letter:
            event.stop()
            if not self.ignores_keys:
                self.dismiss(True)


class LeaveDialog(Dialog[LeaveChoice | None]):
    """Dialog that asks an operator who leaves whether to keep the engine running."""

    ANSWERS = None

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

    def __init__(self, state_words: Callable[[], str], *, proposes_staying: bool) -> None:
        """Make the dialog.

        ``state_words``: returns what the engine does now; called again while the dialog is open.
        ``proposes_staying``: True where the focus is on staying, since the telescope moves by hand.
        """
        super().__init__()
        self._state_words = state_words
        self._proposes_staying = proposes_staying

    def compose(self) -> ComposeResult:
        """Make a button for each of the three choices."""
        with dialog_box("leave the console"):
            yield Static(self._state_words(), id="state", markup=False)
            with Vertical(classes="choices"):
                for choice, words in self.CHOICES.items():
                    yield Button(words, name=choice, id=choice.replace(" ", "-"), compact=True)

    def on_mount(self) -> None:
        """Put the cursor on a choice that does not end the engine: leaving, or staying."""
        state = self.query_one("#state", Static)
        self.set_interval(STATE_EVERY_S, lambda: state.update(self._state_words()))
        self.query_one("#stay" if self._proposes_staying else "#leave", Button).focus()

    def on_button_pressed(self, event: Button.Pressed) -> None:
        """Close with the pressed choice."""
        event.stop()
        self.dismiss(next(each for each in self.CHOICES if each == event.button.name))

    def action_choose(self, choice: LeaveChoice) -> None:
        """Close with the choice whose letter was typed."""
        self.dismiss(choice)
