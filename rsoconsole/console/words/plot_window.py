"""Which frames the plots show: how far back, how many to a mark, and the times under them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from rsoconsole.console.drawing import AXIS_COLUMNS, Line, cells_a_frame
from rsoconsole.console.words.words import clipped
from rsoconsole.night import FrameRow
from rsoconsole.words import clock

MOST_FRAMES_A_MARK = 64
LABEL_COLUMNS = 12
"""From one time to the next, at least."""
LIVE_STEP = 12
"""Marks that one key goes back or on."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlotWindow:
    """A piece of the night; the newest frames, one to a mark, to begin with."""

    back: int = 0
    """Frames after it that are not shown."""
    frames_a_mark: int = 1

    def moved(self, marks: int, count: int, room: int = 1) -> "PlotWindow":
        """Moved on by a number of marks (negative: back), in a night of ``count`` frames.

        ``room``: marks that the plot has room for: it goes back until the oldest ones fill it.
        """
        n = self.frames_a_mark
        back = self.back - marks * n
        # In whole marks: they are counted from the night's beginning.
        most = max(count - max(room, 1) * n, 0)
        return replace(self, back=min(max(back, 0), most))

    def zoomed(self, factor: float) -> "PlotWindow":
        """With a factor on the frames to a mark: 2 or 0.5."""
        frames = min(max(round(self.frames_a_mark * factor), 1), MOST_FRAMES_A_MARK)
        return replace(self, frames_a_mark=frames)

    def seen(self, rows: Sequence[FrameRow]) -> Sequence[FrameRow]:
        """The frames up to the right edge."""
        return rows[: len(rows) - self.back] if self.back else rows

    def visible(self, rows: Sequence[FrameRow], width: int) -> Sequence[FrameRow]:
        """The frames that a plot of ``width`` columns, axis and all, has marks of."""
        seen, n = self.seen(rows), self.frames_a_mark
        marks = -(-len(seen) // n)
        return seen[max(marks - max(width - AXIS_COLUMNS, 0), 0) * n :]

    def frames_words(self, rows: Sequence[FrameRow], width: int) -> str:
        """Which frames of the night such a plot shows."""
        visible = self.visible(rows, width)
        if self.back and visible:
            return f"{visible[0].frame_id:04d}-{visible[-1].frame_id:04d} of {len(rows)}"
        is_all = len(visible) == len(rows)
        return f"{len(rows)} frames" if is_all else f"last {len(visible)} of {len(rows)}"

    def rows(self, rows: Sequence[FrameRow], width: int | None = None) -> tuple[FrameRow, ...]:
        """One row a mark, oldest first; of several frames that with the worst fit.

        ``width``: only those that a plot of that width has room for.
        """
        seen = self.seen(rows) if width is None else self.visible(rows, width)
        n = self.frames_a_mark
        if n == 1:
            return tuple(seen)
        # Counted from the night's beginning, so that a mark keeps its frames as the night goes on.
        return tuple(max(seen[at : at + n], key=_misfit) for at in range(0, len(seen), n))

    def words(self, rows: Sequence[FrameRow]) -> str:
        """What is shown, where that is not the newest frame by frame; else empty."""
        parts = []
        if self.frames_a_mark > 1:
            parts.append(f"a mark is {self.frames_a_mark} frames, the worst shown")
        if self.back:
            last = rows[len(rows) - 1 - self.back] if len(rows) > self.back else None
            if last is not None:
                parts.append(f"to frame {last.frame_id:04d}, {clock(last.t_utc_ns, 'minute')}")
        return " · ".join(parts)


def axis_lines(shown: Sequence[FrameRow], width: int, height: int, words: str = "") -> list[Line]:
    """The times of the frames under their marks; ``words`` stand first where there are any."""
    if height < 1:
        return []
    room = max(width - AXIS_COLUMNS, 0)
    visible = list(shown)[-room:] if room else []
    cells = cells_a_frame(room, len(visible))
    start = room - len(visible) * cells
    line = [" "] * room
    free = 0
    for number, row in enumerate(visible):
        at = start + number * cells
        label = f"╵{clock(row.t_utc_ns, 'minute', '')}"
        if row.t_utc_ns and at >= free and at + len(label) <= room:
            line[at : at + len(label)] = label
            free = at + LABEL_COLUMNS
    text = " " * AXIS_COLUMNS + "".join(line)
    if words:
        text = f"{words}  {text[len(words) + 2 :]}" if len(words) + 2 < width else words
    return [clipped([(text, "dim")], width)]


def _misfit(row: FrameRow) -> tuple[int, float]:
    """What was measured before what was missed, and of that the largest residual over its sigma."""
    if row.residual_arcsec is None or row.sigma_arcsec is None:
        return (1 if row.miss is not None else 0), 0.0
    pairs = zip(row.residual_arcsec, row.sigma_arcsec, strict=True)
    return 2, max(abs(value) / sigma if sigma > 0.0 else math.inf for value, sigma in pairs)
