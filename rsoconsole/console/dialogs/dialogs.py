"""What the operator is asked, and the help. STOP works in each of them: the app binds it first."""

import math
import textwrap
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

from rsoconsole.console.commands.command import GROUPS, Place
from rsoconsole.console.commands.commands import commands_in
from rsoconsole.console.commands.glossary import glossary_text
from rsoconsole.console.commands.keymap import key_words
from rsoconsole.console.panes.last_line import MODE_KEYS, MODE_WORDS, Mode

HELP_COLUMNS = 70
UNASKED_DEAF_S = 0.5
"""So long a dialog that opened by itself, and after each key that it has dropped, it takes no
answer: keys were meant for what is below it."""
LeaveChoice = Literal["leave", "stop engine", "stay"]
Result = TypeVar("Result")

SIGNS = """\
State      IDLE waits to be armed, SEARCH looks, ACQUIRE has one frame,
           TRACK measures, COAST predicts, MANUAL is yours, LOST, FAULT
Picture    [━] followed   (━) other detections   ‹ › rejected, from near
           < > by your hand   + where it was expected, · 3 sigma about it
           1 2* several tracks, * the lead   ○3 not seen in this frame
           in an opened frame { } detected now   « » rejected now
Plots      fat dots measured, small dots 3 sigma, ○ nothing measured,
           ▲ ▼ beyond the axis; the newest frame at the right
Times are UTC; under simulation they are the observatory's own."""
REVIEW_SIGNS = """\
Time line  the night from its first record to its last; its words are states,
           ┃ is here, A the moment kept to compare with, ░ not read yet
           ○ miss   × refused   ▼ lost   ▲ operator   ✎ note   ! alarm   / found
           ▫ the frame's pixels are kept: enter opens it at full resolution
           a cell of many frames shows what a quarter of them have; the mouse
           goes where it is clicked or drawn"""


def help_text(
    keymap: Mapping[str, str] | None = None, mode: Mode = "live", place: Place = "live"
) -> str:
    """What the keys are for at this moment, every command by group, then the signs."""
    lines: list[str] = []
    if MODE_WORDS[mode]:
        lines.append(MODE_WORDS[mode])
        for key in MODE_KEYS[mode]:
            lines += textwrap.wrap(
                key.words or key.name,
                HELP_COLUMNS,
                initial_indent=f"  {key.key:<9}",
                subsequent_indent=" " * 11,
            )
        lines.append("")
    for group, title in GROUPS.items():
        here = [command for command in commands_in(place) if command.group == group]
        if not here:
            continue
        lines.append(title)
        for command in here:
            if command.name != "stop_by_letter":
                keys = (keymap or {}).get(command.name, command.keys)
                shown = f"x {key_words(keys)}" if command.name == "stop" else key_words(keys)
                words = f"{command.title}: {command.help}"
                lines += textwrap.wrap(
                    words, HELP_COLUMNS, initial_indent=f"  {shown:<9}", subsequent_indent=" " * 11
                )
        lines.append("")
    signs = SIGNS if place == "live" else f"{SIGNS}\n{REVIEW_SIGNS}"
    return "\n".join([*lines, f"  {'^p':<9}every command by name", "", signs])


def framed(title: str, keys: str = "") -> VerticalScroll:
    """The box of a dialog: what it is about above, its keys below."""
    box = VerticalScroll()
    box.border_title, box.border_subtitle = title, keys
    return box


class Dialog(ModalScreen[Result], Generic[Result]):
    """A box in the middle, put away by Esc."""

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
    """When the last one was closed, by a clock that nobody sets."""
    opens_unasked = False
    """Under the operator's hands, by what the engine said."""
    _opened_s = math.inf
    _dropped_s = -math.inf
    """When a key was dropped last."""

    async def on_event(self, event: Event) -> None:
        """One that STOP or esc has put away before it was drawn has nothing to mount.

        Words typed blindly are dropped as a whole: of what is behind a dropped key nothing acts.
        STOP never comes here: the application takes it first.
        """
        if isinstance(event, Mount) and self not in self.app.screen_stack:
            return
        if isinstance(event, Key) and event.key != "escape" and self.is_deaf:
            self._dropped_s = time.monotonic()
            event.stop()
            event.prevent_default()
            return
        await super().on_event(event)

    def on_mount(self) -> None:
        """It can be read from the first paint on."""
        self.call_after_refresh(self._see_opened)

    def _see_opened(self) -> None:
        self._opened_s = time.monotonic()

    @property
    def is_deaf(self) -> bool:
        """Whether what is typed now was meant for what it lies over; esc puts it away at once."""
        since_s = max(self._opened_s, self._dropped_s)
        return self.opens_unasked and time.monotonic() < since_s + UNASKED_DEAF_S

    def dismiss(self, result: Result | None = None) -> AwaitComplete:
        """Close; what is typed right after it may still be meant for it."""
        Dialog.closed_s = time.monotonic()
        return super().dismiss(result)

    def action_put_away(self) -> None:
        """Close without a choice."""
        self.dismiss(None)


class PagedDialog(Dialog[Result], Generic[Result]):
    """Pages of text, one at a time."""

    def compose(self) -> ComposeResult:
        """One page."""
        with VerticalScroll():
            yield Static("", id="page", markup=False)

    def on_mount(self) -> None:
        """The first one."""
        self.show()

    def page(self) -> tuple[str, str, str]:
        """Title, keys and text of the shown one."""
        raise NotImplementedError

    def show(self) -> None:
        """Draw it."""
        box = self.query_one(VerticalScroll)
        box.border_title, box.border_subtitle, text = self.page()
        self.query_one("#page", Static).update(text)


class HelpDialog(PagedDialog[str | None]):
    """The keys and the signs; on a second page what the terms mean. Gives "tour" or None."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("question_mark,f1,q", "put_away", "Back", show=False),
        Binding("tab,g,left,right", "other_page", "Terms"),
        Binding("t", "tour", "Tour"),
        Binding("up", "scroll(-1)", show=False),
        Binding("down", "scroll(1)", show=False),
        Binding("pageup", "page(-1)", show=False),
        Binding("pagedown,space", "page(1)", show=False),
        Binding("home", "end(False)", show=False),
        Binding("end", "end(True)", show=False),
    ]

    def __init__(
        self,
        keymap: Mapping[str, str] | None = None,
        mode: Mode = "live",
        place: Place = "live",
    ) -> None:
        super().__init__()
        self._pages = {
            "keys and signs": help_text(keymap, mode, place),
            "terms": glossary_text(HELP_COLUMNS),
        }
        self._shown = "keys and signs"

    @property
    def _other(self) -> str:
        return next(name for name in self._pages if name != self._shown)

    def action_other_page(self) -> None:
        """From the keys to the terms, and back."""
        self._shown = self._other
        self.show()
        # At once: what is scrolled behind the new text would be the place of the old one.
        self.query_one(VerticalScroll).scroll_home(animate=False, immediate=True)

    def action_scroll(self, by: int) -> None:
        """By a line."""
        self.query_one(VerticalScroll).scroll_relative(y=by, animate=False)

    def action_page(self, by: int) -> None:
        """By what is seen at once."""
        box = self.query_one(VerticalScroll)
        box.scroll_relative(y=by * max(box.size.height - 1, 1), animate=False)

    def action_end(self, is_last: bool) -> None:
        """To the first line, or to the last."""
        box = self.query_one(VerticalScroll)
        (box.scroll_end if is_last else box.scroll_home)(animate=False)

    def action_tour(self) -> None:
        """The tour of the screen."""
        self.dismiss("tour")

    def page(self) -> tuple[str, str, str]:
        """The keys first."""
        keys = f"tab {self._other} · t tour · esc back"
        return f"help: {self._shown}", keys, self._pages[self._shown]


class Tick(Static, can_focus=True):
    """A line with a box to tick; the tick is a sign, not a colour."""

    BINDINGS: ClassVar[list[BindingType]] = [Binding("space,enter", "tick", "Tick")]

    def __init__(self, words: str, *, id: str, is_on: bool = False) -> None:  # noqa: A002 -- as all widgets have it
        super().__init__(f"[{'x' if is_on else ' '}] {words}", markup=False, id=id)
        self._words = words
        self.is_on = is_on

    def action_tick(self) -> None:
        """Tick, or not."""
        if isinstance(self.screen, Dialog) and self.screen.is_deaf:
            return
        self.is_on = not self.is_on
        self.update(f"[{'x' if self.is_on else ' '}] {self._words}")

    def on_click(self) -> None:
        """The same by the mouse."""
        self.action_tick()


class MessageDialog(Dialog[None]):
    """Words that need to be read."""

    def __init__(self, title: str, text: str) -> None:
        super().__init__()
        self._title, self._text = title, text

    def compose(self) -> ComposeResult:
        """The words; any key puts them away, where they were asked for."""
        with framed(self._title, "esc or enter back" if self.opens_unasked else "any key back"):
            yield Static(self._text, markup=False)

    def on_key(self, event: Key) -> None:
        """Read: back to the sky. What STOP is bound to never comes here.

        Where it opened by itself the first letter of a word must not put it away: the letters
        behind it would act.
        """
        event.stop()
        event.prevent_default()
        if event.key in {"escape", "enter"} or not self.opens_unasked:
            self.dismiss(None)

    def on_click(self) -> None:
        """The same by the mouse."""
        self.dismiss(None)


class ArmDialog(Dialog[tuple[str, ...] | None]):
    """The checks that stand against arming; those ticked are overridden by name.

    Gives the names to override, or None.
    """

    def __init__(
        self, message: str, checks: Sequence[Mapping[str, Any]], ticked: Collection[str] = ()
    ) -> None:
        """``ticked``: names that were overridden before, and are again unless taken back."""
        super().__init__()
        self._message = message
        self._failed = [check for check in checks if not check.get("ok")]
        self._passed = [check for check in checks if check.get("ok")]
        self._ticked = ticked

    def compose(self) -> ComposeResult:
        """The message, a box to tick for each failed check, and the two ways on."""
        with framed("not armed", "space ticks · ↑↓ move · esc back"):
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
        """The first box has the cursor; enter there arms nothing."""
        first = self.query(Tick).first() if self._failed else self.query_one("#stay", Button)
        first.focus()

    def on_button_pressed(self, event: Button.Pressed) -> None:
        """Arm anyway, or not."""
        event.stop()
        if self.is_deaf:
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
    """Asks once; nothing happens but by the second button or its letter. Gives True or not."""

    def __init__(
        self, title: str, text: str, *, yes: str, letter: str, is_yes: bool = False
    ) -> None:
        """``is_yes``: enter does it, where nothing moves by it."""
        super().__init__()
        self._proposed = "#yes" if is_yes else "#back"
        self._title, self._text, self._yes, self._letter = title, text, yes, letter

    def compose(self) -> ComposeResult:
        """What would be done, and the two ways on."""
        with framed(self._title):
            yield Static(self._text, markup=False)
            with Vertical(classes="choices"):
                yield Button("esc  Back", id="back", compact=True)
                yield Button(f"{self._letter}  {self._yes}", id="yes", compact=True)

    def on_mount(self) -> None:
        """Enter does nothing that moves."""
        self.query_one(self._proposed, Button).focus()

    def on_button_pressed(self, event: Button.Pressed) -> None:
        """Done, or not."""
        event.stop()
        if not self.is_deaf:
            self.dismiss(event.button.id == "yes")

    def on_key(self, event: Key) -> None:
        """By letter."""
        if event.key == self._letter:
            event.stop()
            if not self.is_deaf:
                self.dismiss(True)


class LeaveDialog(Dialog[LeaveChoice | None]):
    """What becomes of the engine when the console is left."""

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
        """``proposes_staying``: the telescope moves by hand, and nobody else would look at it."""
        super().__init__()
        self._state_words = state_words
        self._proposes_staying = proposes_staying

    def compose(self) -> ComposeResult:
        """Three plain choices; the proposed one has the focus."""
        with framed("leave the console"):
            yield Static(self._state_words, markup=False)
            with Vertical(classes="choices"):
                for choice, words in self.CHOICES.items():
                    yield Button(words, name=choice, id=choice.replace(" ", "-"), compact=True)

    def on_mount(self) -> None:
        """Enter does what is safe: it never ends the engine."""
        self.query_one("#stay" if self._proposes_staying else "#leave", Button).focus()

    def on_button_pressed(self, event: Button.Pressed) -> None:
        """One of the three."""
        event.stop()
        self.dismiss(next(each for each in self.CHOICES if each == event.button.name))

    def action_choose(self, choice: LeaveChoice) -> None:
        """By letter."""
        self.dismiss(choice)
