"""The last line of a night's screen: its keys, what is said over them, and a click on a key."""

from collections.abc import Callable
from typing import Protocol

from textual.events import Click
from textual.geometry import Size

from rsoconsole.console.commands import BY_NAME
from rsoconsole.console.drawing import Ink
from rsoconsole.console.panes import Key, LinesPane, key_at, key_line, notice_rows


class KeyedScreen(Protocol):
    """What the last line shows of the screen."""

    @property
    def size(self) -> Size:
        """Columns and rows of the terminal."""

    @property
    def keys(self) -> list[Key]:
        """The keys that matter now."""

    @property
    def notice(self) -> tuple[str, Ink]:
        """What is to be said at this moment."""


class KeyLine:
    """Draws it in a pane, which grows by the rows that a notice takes."""

    def __init__(self, screen: KeyedScreen, pane: Callable[[], LinesPane]) -> None:
        self._screen, self._pane = screen, pane
        self._drawn: tuple[list[Key], str] = ([], "")
        """The keys and the notice that it shows."""

    def show(self) -> None:
        """The keys that matter now, and a word about what was just done."""
        keys, notice = self._screen.keys, self._screen.notice
        self._drawn = keys, notice[0]
        self.place()
        self._pane().show(key_line(keys, notice))

    def place(self) -> None:
        """In the last row, and over it what is said."""
        pane, (width, height) = self._pane(), self._screen.size
        rows = 1 + notice_rows(self._screen.notice[0], width, height)
        if pane.styles.height is None or pane.styles.height.value != rows:
            pane.styles.height = rows
            pane.styles.offset = (0, height - rows)

    def action_at(self, event: Click) -> str:
        """What the key that was clicked does, as Textual writes an action; empty: none was."""
        pane, (keys, notice) = self._pane(), self._drawn
        if event.widget is not pane or event.y != pane.size.height - 1:
            return ""
        key = key_at(keys, notice if pane.size.height == 1 else "", pane.size.width, event.x)
        if key is None or not key.command:
            return ""
        return f"app.{key.command}" if BY_NAME[key.command].is_everywhere else key.command
