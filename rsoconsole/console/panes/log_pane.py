"""The log's pane, newest line first; a line longer than the pane continues below, indented."""

import textwrap
from functools import lru_cache
from typing import ClassVar

from rich.segment import Segment
from rich.style import Style
from textual.events import Resize
from textual.geometry import Size
from textual.scroll_view import ScrollView
from textual.strip import Strip

from rsoconsole.night import LogLine
from rsoconsole.words import utc_text

WITH_FRAME_COLUMNS = 60
"""Least columns of a log whose lines show the frame's number."""
MAX_ROWS = 3
HOW_TO_CHANGE = "/ changes, esc clears"


class LogPane(ScrollView):
    """Pane of the log; scrolls while it has the focus; names a filter in its first row."""

    always_shown: ClassVar[bool] = True
    """True where changes of state and alarms are shown whatever the filter."""
    COMPONENT_CLASSES: ClassVar[set[str]] = {
        "log--good",
        "log--warning",
        "log--alarm",
        "log--title",
    }
    DEFAULT_CSS = """
    LogPane { background: $background; scrollbar-size: 0 0; }
    LogPane:focus { scrollbar-size: 1 1; }
    LogPane > .log--good { color: $text-success; }
    LogPane > .log--warning { color: $text-warning; }
    LogPane > .log--alarm { color: $text-error; text-style: bold; }
    LogPane > .log--title { text-style: bold reverse; }
    """

    def __init__(self, *, id: str | None = None) -> None:  # noqa: A002 -- as all widgets have it
        super().__init__(id=id)
        self.can_focus = False
        self.lines: tuple[LogLine, ...] = ()
        """The lines of the log, oldest first, before filtering."""
        self.wanted = ""
        """Text that shown lines must have; empty: no filter."""
        self._is_reading = False
        self._rows: list[tuple[LogLine, str, bool]] = []
        """For each row, newest first: its log line, its text, whether the next row continues it."""

    def show(self, lines: tuple[LogLine, ...], *, is_reading: bool = False) -> None:
        """Show the lines of a log; if the pane is scrolled back, its visible rows stay in place.

        ``is_reading``: True while older records are still being read and lines may be missing.
        """
        if lines == self.lines and is_reading == self._is_reading:
            return
        self._is_reading = is_reading
        self.lines = lines
        before = len(self._rows)
        self._lay_out()
        grown = len(self._rows) - before
        if self.scroll_offset.y > 0 and grown > 0:
            self.scroll_to(y=self.scroll_offset.y + grown, animate=False)

    @property
    def top_line(self) -> LogLine | None:
        """The line in the first row; None where no line is shown."""
        at = self.scroll_offset.y
        return self._rows[at][0] if at < len(self._rows) else None

    @property
    def found(self) -> tuple[LogLine, ...]:
        """The lines that pass the filter, newest first."""
        return tuple(dict.fromkeys(line for line, _, _ in self._rows))

    @property
    def _title_rows(self) -> int:
        return 1 if self.wanted else 0

    def _is_shown(self, line: LogLine) -> bool:
        if self.wanted.lower() in line.text.lower():
            return True
        return self.always_shown and (line.kind == "StateChange" or line.level == "alarm")

    def filter(self, wanted: str) -> None:
        """Show only lines that contain ``wanted``, whatever its case; empty: every line."""
        self.wanted = wanted
        self._lay_out()
        self.scroll_home(animate=False)

    def on_resize(self, _event: Resize) -> None:
        """Break the lines for another width."""
        self._lay_out()

    def _lay_out(self) -> None:
        # The scroll bar's column is left free, so that opening the log breaks no line again.
        width = self.outer_size.width - 1
        self._rows = [
            (line, row, number < len(rows))
            for line in reversed(self.lines)
            if self._is_shown(line)
            for rows in (log_rows(line, width),)
            for number, row in enumerate(rows, 1)
        ]
        self.virtual_size = Size(0, len(self._rows) + self._title_rows)
        self.refresh()

    def render_line(self, y: int) -> Strip:
        """Return row ``y`` of the pane, the newest line first, as scrolled."""
        width = self.scrollable_content_region.width
        if y < self._title_rows:
            title = f" log: {self.wanted!r} · {HOW_TO_CHANGE} "
            style = self.rich_style + self.get_component_rich_style("log--title")
            return Strip([Segment(title.ljust(width)[:width], style)])
        y -= self._title_rows
        index = y + self.scroll_offset.y
        if index >= len(self._rows):
            words = ""
            if not self._rows and y == 0:
                wanted = f" no line has {self.wanted!r}"
                empty = " reading …" if self._is_reading else " nothing has happened yet"
                words = wanted if self.wanted else empty
            return Strip([Segment(words.ljust(width)[:width], self.rich_style)])
        line, text, goes_on = self._rows[index]
        if goes_on and y == self.size.height - 1 - self._title_rows:
            text = f"{text[: width - 2]} …"
        return Strip([Segment(text.ljust(width)[:width], self._style_of(line))])

    def _style_of(self, line: LogLine) -> Style:
        style = self.rich_style
        if line.level != "info":
            style += self.get_component_rich_style(f"log--{line.level}")
        return style


@lru_cache(maxsize=8192)
def log_rows(line: LogLine, width: int) -> tuple[str, ...]:
    """Return a line of the log broken into rows, at most ``MAX_ROWS``."""
    head = f" {utc_text(line.t_utc_ns, zone='')} "
    if width >= WITH_FRAME_COLUMNS:
        head += f"{line.frame_id:04d} " if line.frame_id is not None else "     "
    rows = textwrap.wrap(
        line.text_with_count,
        max(width, len(head) + 8),
        initial_indent=head,
        subsequent_indent=" " * len(head),
        max_lines=MAX_ROWS,
        placeholder=" …",
    )
    return tuple(rows) or (head,)
