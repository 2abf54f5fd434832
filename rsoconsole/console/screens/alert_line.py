"""The alert over the panes, which takes as many rows as it has words, and none without."""

from rsoconsole.console.actions import Seat
from rsoconsole.console.commands import first_key
from rsoconsole.console.drawing import MOST_ALERT_ROWS
from rsoconsole.console.words import words


class AlertLine:
    """Draws it in a pane; the panes below are laid out for its rows."""

    def __init__(self, seat: Seat) -> None:
        self._seat = seat
        self._placed_rows = 0
        """For which the panes have been laid out."""

    def place(self) -> int:
        """How many rows the alert, or what stands in its place, takes."""
        self._placed_rows = self._rows()
        return self._placed_rows

    def _rows(self) -> int:
        said = self._seat.alert or self._seat.intro
        width = self._seat.size.width
        return len(words.wrapped(f" {said}", width, MOST_ALERT_ROWS)) if said else 0

    def show(self) -> bool:
        """Say it; whether it takes another number of rows than the panes are laid out for."""
        seat, pane = self._seat, self._seat.pane("alert")
        alert = seat.alert
        said = alert or seat.intro
        pane.set_class(not alert, "-calm")
        cut = f"… ({first_key('read', seat.keymap)} shows all) …"
        pane.show(lambda width, height: words.wrapped(f" {said}", width, height, cut))
        return self._rows() != self._placed_rows
