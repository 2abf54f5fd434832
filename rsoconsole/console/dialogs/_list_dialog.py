"""Base of dialogs with a search field over a list of rows, of which one is chosen."""

import threading
from typing import ClassVar, Generic, TypeVar

from textual import events
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical
from textual.widgets import Input

from rsoconsole.console.dialogs.dialogs import Dialog, Result
from rsoconsole.console.drawing.plot import Ink, Line
from rsoconsole.console.panes.panes import LinesPane
from rsoconsole.console.words.words import cut_to_width, first_visible_index

Row = TypeVar("Row")


class ListDialog(Dialog[Result], Generic[Result, Row]):
    """Dialog with a list of rows, found on a thread, and a search field over it."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("up", "choose(-1)", show=False),
        Binding("down", "choose(1)", show=False),
        Binding("pageup", "choose(-10)", show=False),
        Binding("pagedown", "choose(10)", show=False),
    ]
    DEFAULT_CSS = """
    ListDialog > Vertical {
        width: 100; max-width: 100%; height: 80%; min-height: 10; max-height: 100%;
        background: $surface; border: solid $primary; padding: 0 1;
    }
    ListDialog LinesPane { height: 1fr; }
    """
    LISTED: ClassVar[str]
    KEYS: ClassVar[str]
    TO_TYPE: ClassVar[str]

    def __init__(self) -> None:
        super().__init__()
        self._at = 0

    def compose(self) -> ComposeResult:
        """Make the search field and the list."""
        with Vertical() as box:
            box.border_title = self.LISTED
            box.border_subtitle = self.KEYS
            yield Input(placeholder=self.TO_TYPE, id="wanted", compact=True)
            yield LinesPane(id="rows")

    def on_mount(self) -> None:
        """Start the thread that finds the rows."""
        self.query_one(Input).focus()
        self.show()
        name = f"console {self.LISTED}"
        threading.Thread(target=self.load_rows, name=name, daemon=True).start()

    def load_rows(self) -> None:
        """Find the rows and hand them to the dialog; runs on a thread of its own."""
        raise NotImplementedError

    @property
    def matching_rows(self) -> list[Row]:
        """The rows that match the text in the search field."""
        raise NotImplementedError

    def row_result(self, row: Row) -> Result:
        """Return the dialog's result for a chosen row."""
        raise NotImplementedError

    def header_line(self, width: int) -> str:
        """Return the line above the rows: column headings, or why there are no rows."""
        raise NotImplementedError

    def row_words(self, row: Row, width: int) -> tuple[str, Ink]:
        """Return a row's text, and the ink in which it is drawn unless it is chosen."""
        raise NotImplementedError

    def lines(self, width: int, height: int) -> list[Line]:
        """Return the head and as many rows as there is room for, the chosen one among them."""
        rows, room = self.matching_rows, max(height - 1, 1)
        lines = [cut_to_width([(self.header_line(width), "dim")], width)]
        first = first_visible_index(self._at, len(rows), room)
        for number, row in enumerate(rows[first : first + room], first):
            is_chosen = number == self._at
            text, ink = self.row_words(row, width)
            text = f"{'▸' if is_chosen else ' '} {text}".ljust(width)
            lines.append(cut_to_width([(text, "here" if is_chosen else ink)], width))
        return lines[: max(height, 1)]

    def show(self) -> None:
        """Draw the head and the rows."""
        self.query_one("#rows", LinesPane).show(self.lines)

    def handle_typed_text(self, typed: str) -> None:
        """Handle enter where no row matches the typed text: ring the bell."""
        _ = typed
        self.app.bell()

    def handle_row_click(self, number: int) -> None:
        """Handle a click on the row of index ``number``: choose it."""
        self.choose(number)

    def on_input_changed(self, event: Input.Changed) -> None:
        """Show the rows that match the changed text."""
        event.stop()
        self._at = 0
        self.show()

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Close with the chosen row; without one, handle the typed text."""
        event.stop()
        shown = self.matching_rows
        if shown:
            self.dismiss(self.row_result(shown[min(self._at, len(shown) - 1)]))
        else:
            self.handle_typed_text(event.value)

    def on_click(self, event: events.Click) -> None:
        """Find the clicked row and handle the click."""
        rows = self.query_one("#rows", LinesPane)
        if event.widget is rows and event.y:
            room = max(rows.size.height - 1, 1)
            self.handle_row_click(
                first_visible_index(self._at, len(self.matching_rows), room) + event.y - 1
            )

    def action_choose(self, by: int) -> None:
        """Move the choice by ``by`` rows; a negative number moves it up."""
        self.choose(self._at + by)

    def choose(self, number: int) -> None:
        """Choose the row of that index, or the nearest one that exists."""
        self._at = min(max(number, 0), max(len(self.matching_rows) - 1, 0))
        self.show()
