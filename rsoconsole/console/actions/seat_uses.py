"""What the keys of the seat may use of the screen that holds them."""

from collections.abc import Callable
from typing import Protocol, TypeVar

from textual.screen import Screen

from rsoconsole.console.commands import Orders
from rsoconsole.console.dialogs import Dialog, Result
from rsoconsole.console.drawing import Ink
from rsoconsole.console.night import EngineView
from rsoconsole.control import Command
from rsoconsole.night import LogLine, NightView

Answer = TypeVar("Answer")
NEW_LINES = 20
"""Last lines of the log in which the result of a command is looked for."""


class LookingSeat(Protocol):
    """What is known, a word over the last line, and a dialog."""

    night: NightView
    engine: EngineView
    keymap: dict[str, str]

    def say(self, text: str, ink: Ink = "title", seconds: float = 4.0) -> None:
        """A word over the last line, for a while."""

    def ask(
        self, dialog: Screen[Answer], decided: Callable[[Answer | None], None] | None = None
    ) -> None:
        """Open a dialog over this screen; ``decided`` is called with its answer."""


class ActingSeat(LookingSeat, Protocol):
    """A seat that may command the engine."""

    orders: Orders

    @property
    def can_act(self) -> bool:
        """Whether there is an engine for this seat to command."""

    def may_act(self) -> bool:
        """The same; says why not."""

    def send(self, command: Command, then: Command | None = None) -> None:
        """Hand a command to the engine; what comes of it is said."""

    def now_s(self) -> float:
        """Seconds of a clock that nobody sets."""

    def set_timer(self, delay: float, callback: Callable[[], None]) -> object:
        """Have it called once, ``delay`` seconds from now."""


def open_unasked(
    seat: LookingSeat,
    dialog: Dialog[Result],
    decided: Callable[[Result | None], None] | None = None,
) -> None:
    """A dialog that the engine's answer opens: a key that bounces does not answer it."""
    dialog.opens_unasked = True
    seat.ask(dialog, decided)


def log_lines_after(night: NightView, seq: int) -> list[LogLine]:
    """What has been recorded since, of the last lines."""
    return [line for line in night.log[-NEW_LINES:] if line.seq > seq]
