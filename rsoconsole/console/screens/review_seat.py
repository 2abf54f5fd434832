"""What the parts of a review may use of it: which moment is shown, and which one is wanted."""

from pathlib import Path
from typing import Any

from rsoconsole.console.screens.night_screen import NightScreen
from rsoconsole.console.timeline import Moment, Player, Timeline
from rsoconsole.night import LogLine

ANY, FOUND = "any", "found"


class ReviewSeat(NightScreen):
    """Holds where a review is; the screen above it brings the moments and draws the time line."""

    def __init__(self, *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        self.folder: Path | None = None
        self.timeline = Timeline()
        self.lines: tuple[LogLine, ...] = ()
        """Of the whole log, as far as it has been read."""
        self.moment: Moment | None = None
        """The moment that is shown; None before the first."""
        self.kept: Moment | None = None
        """The one to compare with, A; None while none is kept."""
        self.seq = 0
        """The moment that is wanted."""
        self.is_at_head = False
        """Whether a night that goes on is followed."""
        self.kind: str = ANY
        """Of the events that are jumped to."""
        self.searched = ""
        """Words that the log has been searched for."""
        self.player = Player()

    def want(self, seq: int) -> None:
        """Have that moment shown."""

    def show_place(self) -> None:
        """The time line."""
