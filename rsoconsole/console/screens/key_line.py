"""The last line of a night's screen: its keys, what is said over them, and a click on a key."""

from textual.events import Click

from rsoconsole.console.actions import Seat
from rsoconsole.console.panes import Key, action_at, key_line, notice_rows


class KeyLine:
    """Draws it in a pane, which grows by the rows that a notice takes."""

    def __init__(self, seat: Seat) -> None:
        self._seat = seat
        self._drawn: tuple[list[Key], str] = ([], "")
        """The keys and the notice that it shows."""

    def show(self) -> None:
        """The keys that matter now, and a word about what was just done."""
        keys, notice = self._seat.keys, self._seat.notice
        self._drawn = keys, notice[0]
        self.place()
        self._seat.pane("keys").show(key_line(keys, notice))

    def place(self) -> None:
        """In the last row, and over it what is said."""
        pane, (width, height) = self._seat.pane("keys"), self._seat.size
        rows = 1 + notice_rows(self._seat.notice[0], width, height)
        if pane.styles.height is None or pane.styles.height.value != rows:
            pane.styles.height = rows
            pane.styles.offset = (0, height - rows)

    def action_at(self, event: Click) -> str:
        """What the key that was clicked does, as Textual writes an action; empty: none was."""
        return action_at(event, self._seat.pane("keys"), *self._drawn)
