"""Widgets of the screens: they show lines and pictures made elsewhere."""

import logging
from collections.abc import Callable
from typing import get_args

from textual.content import Content
from textual.events import Blur, MouseDown, MouseEvent, MouseMove, MouseUp, Resize
from textual.message import Message
from textual.widget import Widget
from textual.widgets import Input

from rsoconsole.console.drawing.plot import Line, TrackInk
from rsoconsole.console.timeline.lines import strip_columns
from rsoconsole.console.timeline.timeline import EXAMPLES
from rsoconsole.console.words.words import wrap_to_rows

log = logging.getLogger(__name__)

Build = Callable[[int, int], list[Line]]
"""Function that builds a pane's lines: (width, height) -> lines."""

NOT_DRAWN = "cannot be drawn: see the log"

INKS = {
    "": "",
    "dim": "$text-muted",
    "band": "$primary 60%",
    "good": "$text-success",
    "warn": "$text-warning",
    "alarm": "bold $text-error",
    "title": "bold",
    "here": "bold reverse",
    **{ink: f"bold ${ink.replace('_', '-')}" for ink in get_args(TrackInk)},
}


class LinesPane(Widget):
    """Pane of lines of text; drawn again only where the lines have changed."""

    DEFAULT_CSS = "LinesPane { text-wrap: nowrap; text-overflow: clip; }"

    def __init__(self, *, id: str | None = None) -> None:  # noqa: A002 -- as all widgets have it
        super().__init__(id=id)
        self._build: Build | None = None
        self._lines: list[Line] = []

    def show(self, build: Build) -> None:
        """Show the lines that ``build`` returns for the pane's size, after resizing too."""
        self._build = build
        self._rebuild()

    @property
    def text(self) -> str:
        """The shown lines as plain text."""
        return "\n".join("".join(text for text, _ in line) for line in self._lines)

    def on_resize(self, _event: Resize) -> None:
        """Build the lines for another size."""
        self._rebuild()

    def _rebuild(self) -> None:
        if self._build is None or not self.size.width or not self.size.height:
            return
        try:
            lines = self._build(self.size.width, self.size.height)
        except Exception:  # whatever it is, STOP and the other panes must not go with it
            log.exception("the pane %s cannot be drawn", self.id)
            lines = [[(NOT_DRAWN, "alarm")]]
        if lines != self._lines:
            self._lines = lines
            self.refresh()

    def render(self) -> Content:
        """Return the lines in the colours of their inks."""
        rows = [
            Content.assemble(*((text, INKS[ink]) for text, ink in line)) for line in self._lines
        ]
        return Content("\n").join(rows)


class StopBanner(LinesPane):
    """Banner over everything else with the state of a STOP, until it is closed."""

    DEFAULT_CSS = """
    StopBanner {
        display: none; layer: over; position: absolute; width: 100%; height: 3;
        background: $error; color: $text; text-style: bold; text-align: center;
        content-align: center middle; text-wrap: wrap;
    }
    StopBanner.-stopped { background: $success; }
    """

    def say(self, text: str, phase: str) -> None:
        """Show the state of a STOP; the banner is green for the ``phase`` "stopped", else red."""
        self.set_class(phase == "stopped", "-stopped")
        ending = "  (esc)" if phase in {"stopped", "failed"} else ""
        self.show(lambda width, height: wrap_to_rows(f"{text}{ending}", width, height))


class TimelinePane(LinesPane):
    """Pane of the time line; posts the cells that are clicked or dragged over."""

    class Pointed(Message):
        """Posted for a click or drag: the column in the strip, and the strip's columns."""

        def __init__(self, column: int, columns: int) -> None:
            super().__init__()
            self.column, self.columns = column, columns

    _is_drawn = False

    def on_mouse_down(self, event: MouseDown) -> None:
        """Post the clicked cell of the strip."""
        self._is_drawn = True
        self.capture_mouse()
        self._point(event)

    def on_mouse_move(self, event: MouseMove) -> None:
        """Post the cell at the mouse while the mouse is pressed."""
        if self._is_drawn:
            self._point(event)

    def on_mouse_up(self, _event: MouseUp) -> None:
        """End the drag: later movements of the mouse are not posted."""
        self._is_drawn = False
        self.release_mouse()

    def _point(self, event: MouseEvent) -> None:
        event.stop()
        x, columns = strip_columns(self.size.width)
        if self.size.height > 1:
            self.post_message(self.Pointed(event.x - x, columns))


class MomentField(Input, can_focus=False):
    """Text field in the last line for a frame or a time to go to; the panes stay visible."""

    DEFAULT_CSS = """
    MomentField { display: none; layer: over; position: absolute; width: 100%; height: 1; }
    """

    def __init__(self) -> None:
        super().__init__(placeholder=f"go to a moment: {EXAMPLES}", id="moment", compact=True)

    def open(self) -> None:
        """Show the field and give it the focus."""
        self.value = ""
        self.display = self.can_focus = True
        self.focus()

    def close(self) -> None:
        """Hide the field."""
        self.display = self.can_focus = False

    def on_blur(self, _event: Blur) -> None:
        """Close the field when the focus leaves it."""
        self.close()
