"""The alert over the panes, which takes as many rows as it has words, and none without."""

from collections.abc import Callable
from typing import Protocol

from textual.geometry import Size

from rsoconsole.console.commands import first_key
from rsoconsole.console.drawing import MOST_ALERT_ROWS
from rsoconsole.console.panes import LinesPane
from rsoconsole.console.words import words


class AlertedScreen(Protocol):
    """What the line says of the screen."""

    keymap: dict[str, str]

    @property
    def size(self) -> Size:
        """Columns and rows of the terminal."""

    @property
    def alert(self) -> str:
        """What must not be missed."""

    @property
    def intro(self) -> str:
        """What stands in the alert's place while there is none; empty as a rule."""


class AlertLine:
    """Draws it in a pane; the panes below are laid out for its rows."""

    def __init__(self, screen: AlertedScreen, pane: Callable[[], LinesPane]) -> None:
        self._screen, self._pane = screen, pane
        self._placed_rows = 0
        """For which the panes have been laid out."""

    def place(self) -> int:
        """How many rows the alert, or what stands in its place, takes."""
        self._placed_rows = self._rows()
        return self._placed_rows

    def _rows(self) -> int:
        said = self._screen.alert or self._screen.intro
        width = self._screen.size.width
        return len(words.wrapped(f" {said}", width, MOST_ALERT_ROWS)) if said else 0

    def show(self) -> bool:
        """Say it; whether it takes another number of rows than the panes are laid out for."""
        screen, pane = self._screen, self._pane()
        alert = screen.alert
        said = alert or screen.intro
        pane.set_class(not alert, "-calm")
        cut = f"… ({first_key('read', screen.keymap)} shows all) …"
        pane.show(lambda width, height: words.wrapped(f" {said}", width, height, cut))
        return self._rows() != self._placed_rows
