"""The time line as a pane, which says where the mouse points; a field to type a moment in."""

from textual.events import Blur, MouseDown, MouseEvent, MouseMove, MouseUp
from textual.message import Message
from textual.widgets import Input

from rsoconsole.console.panes.panes import LinesPane
from rsoconsole.console.timeline import EXAMPLES, strip_place


class TimelinePane(LinesPane):
    """A click goes there, and so does the mouse while it is drawn along."""

    class Pointed(Message):
        """A cell of the strip, and the number of its cells."""

        def __init__(self, column: int, columns: int) -> None:
            super().__init__()
            self.column, self.columns = column, columns

    _is_drawn = False

    def on_mouse_down(self, event: MouseDown) -> None:
        """There."""
        self._is_drawn = True
        self.capture_mouse()
        self._point(event)

    def on_mouse_move(self, event: MouseMove) -> None:
        """And on."""
        if self._is_drawn:
            self._point(event)

    def on_mouse_up(self, _event: MouseUp) -> None:
        """Let go."""
        self._is_drawn = False
        self.release_mouse()

    def _point(self, event: MouseEvent) -> None:
        event.stop()
        x, columns = strip_place(self.size.width)
        if self.size.height > 1:
            self.post_message(self.Pointed(event.x - x, columns))


class MomentField(Input, can_focus=False):
    """A frame or a time is typed in the last line, and the sky stays in view."""

    DEFAULT_CSS = """
    MomentField { display: none; layer: over; position: absolute; width: 100%; height: 1; }
    """

    def __init__(self) -> None:
        super().__init__(placeholder=f"go to a moment: {EXAMPLES}", id="moment", compact=True)

    def open(self) -> None:
        """Type now."""
        self.value = ""
        self.display = self.can_focus = True
        self.focus()

    def close(self) -> None:
        """Typed, or not wanted."""
        self.display = self.can_focus = False

    def on_blur(self, _event: Blur) -> None:
        """Something else is looked at."""
        self.close()
