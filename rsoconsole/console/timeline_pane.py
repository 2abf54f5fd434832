"""The time line as a pane: it shows lines, and says where the mouse points in the night."""

from textual.events import MouseDown, MouseEvent, MouseMove, MouseUp
from textual.message import Message

from rsoconsole.console.panes import LinesPane
from rsoconsole.console.timeline_lines import strip_place


class TimelinePane(LinesPane):
    """A click goes there, and so does the mouse while it is drawn along."""

    class Pointed(Message):
        """A cell of the strip, of so many."""

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
