"""The log of a review, and its tuning pane, each as of the shown moment."""

from typing import ClassVar

from rich.segment import Segment
from rich.style import Style
from textual import events
from textual.binding import Binding, BindingType
from textual.strip import Strip

from rsoconsole.console.actions.tune_actions import TuneActions
from rsoconsole.console.commands.keymap import first_key
from rsoconsole.console.panes.log_pane import LogPane
from rsoconsole.console.screens._review_moves import ReviewNavigation
from rsoconsole.console.tuning.lines import TuneWords
from rsoconsole.night import LogLine

HERE = "▸"


class ReviewLogPane(LogPane):
    """Log pane of a review: lines after the shown moment are dim; while it is open, one has the
    cursor.
    """

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("up", "choose(-1)", "Line above", show=False),
        Binding("down", "choose(1)", "Line below", show=False),
        Binding("pageup", "choose_page(-1)", "Page above", show=False),
        Binding("pagedown", "choose_page(1)", "Page below", show=False),
        Binding("home", "choose_end(True)", "Newest", show=False),
        Binding("end", "choose_end(False)", "Oldest", show=False),
        Binding("enter", "screen.go_to_line", "Go there", show=False),
    ]
    COMPONENT_CLASSES: ClassVar[set[str]] = {"log--later", "log--chosen"}
    DEFAULT_CSS = """
    ReviewLogPane > .log--later { color: $text-muted; }
    ReviewLogPane > .log--chosen { text-style: bold reverse; }
    """

    always_shown = False
    """False: a search shows its matches alone."""

    seq = 0
    """Place of the shown moment in the log; later lines are dim."""
    chosen: LogLine | None = None
    """The chosen line, which has the cursor; None while the pane is closed."""

    def open_at(self, lines: tuple[LogLine, ...], seq: int) -> None:
        """Show all lines of the log, and choose the last one up to the moment ``seq``."""
        self.seq = seq
        self.show(lines)
        self.choose_line_near(seq)

    def choose_line_near(self, seq: int) -> None:
        """Choose the last line recorded up to the place ``seq``, else the oldest line."""
        found = self.found
        before = [line for line in found if line.seq <= seq]
        self.chosen = before[0] if before else found[-1] if found else None
        self._reveal()

    def close(self) -> None:
        """Clear the choice and the filter, so that every line is shown again."""
        self.chosen = None
        self.filter("")

    def action_choose(self, by: int) -> None:
        """Choose the line ``by`` lines further down; a negative number moves up."""
        found = self.found
        if self.chosen is None or self.chosen not in found:
            return
        self.chosen = found[min(max(found.index(self.chosen) + by, 0), len(found) - 1)]
        self._reveal()

    def action_choose_page(self, by: int) -> None:
        """Choose the line ``by`` pages further down; a negative number moves up."""
        self.action_choose(by * max(self.size.height - 2, 1))

    def action_choose_end(self, is_newest: bool) -> None:
        """Choose the newest line, or with ``is_newest`` False the oldest one."""
        found = self.found
        if found:
            self.chosen = found[0 if is_newest else -1]
            self._reveal()

    async def on_click(self, event: events.Click) -> None:
        """Choose the clicked line; if it is chosen already, go to its moment."""
        index = event.y - self._title_rows + self.scroll_offset.y
        if self.chosen is None or not 0 <= index < len(self._rows):
            return
        line = self._rows[index][0]
        if line == self.chosen:
            await self.run_action("screen.go_to_line")
        self.chosen = line
        self.refresh()

    def _reveal(self) -> None:
        """Scroll the chosen line into view."""
        rows = [index for index, (line, _, _) in enumerate(self._rows) if line == self.chosen]
        if rows:
            height = max(self.size.height - self._title_rows, 1)
            top = self.scroll_offset.y
            if rows[0] < top or rows[-1] >= top + height:
                self.scroll_to(y=max(rows[0] - height // 2, 0), animate=False)
        self.refresh()

    def render_line(self, y: int) -> Strip:
        """Return row ``y`` of the pane; the chosen line has a sign and a style."""
        strip = super().render_line(y)
        index = y - self._title_rows + self.scroll_offset.y
        has_line = 0 <= index < len(self._rows) and y >= self._title_rows
        if self.chosen is None or not has_line or self._rows[index][0] != self.chosen:
            return strip
        is_first = index == 0 or self._rows[index - 1][0] != self.chosen
        style = self.get_component_rich_style("log--chosen")
        text = strip.text
        return Strip([Segment((HERE if is_first else " ") + text[1:], self.rich_style + style)])

    def _style_of(self, line: LogLine) -> Style:
        if self.chosen is not None and line.seq > self.seq:
            return self.rich_style + self.get_component_rich_style("log--later")
        return super()._style_of(line)


class ReviewTuneActions(TuneActions):
    """The tuning pane of a review: figures up to the shown moment; no setting is sent."""

    _seat: ReviewNavigation
    _is_of_all = False

    @property
    def words(self) -> TuneWords:
        """The pane's texts: which frames the figures cover, and the keys that it offers."""
        frames = "all frames so far" if self._is_of_all else "{count} frames to here"
        scope = first_key("tune_scope", self._seat.keymap)
        which = "the last frames" if self._is_of_all else "all frames"
        return super().words._replace(
            frames=frames,
            keys=f"{scope} {which}  u undo  w save  o load",
        )

    def figures_scope(self) -> tuple[int | None, int | None]:
        """Return what the figures cover: the moment's ``seq``, and how many last frames.

        The second is None for all frames.
        """
        return self._seat.seq, None if self._is_of_all else self.last_frame_count()

    def change_figures_scope(self) -> None:
        """Switch the figures between all frames up to the moment and the last of them."""
        self._is_of_all = not self._is_of_all
        self.show()
        self.request_figures()
        self._seat.say(f"tune: {self.words.frames}")
