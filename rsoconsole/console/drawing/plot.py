"""Plots in cells: braille dots for the values, the newest exposure at the right.

A line is a list of (text, ink). An ink names a colour, which only repeats what the marks say.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from typing import Literal, TypeVar

Ink = Literal["", "dim", "good", "warn", "alarm", "title", "here"]
Line = list[tuple[str, Ink]]
Key = TypeVar("Key")

AXIS_COLUMNS = 6
NIS_HEADROOM = 1.6
"""Top of the NIS axis as a factor on the upper bound of its band."""
REFUSED = "×"
MIN_FOR_STRAYS, USUAL_SHARE, STRAY_TIMES = 5, 0.8, 5.0
"""Least number of residuals, share that sets the axis, factor on it beyond which one is a stray."""
MAX_SPREAD = 3
"""Most cells that one exposure takes, while there are few exposures."""
_BRAILLE = 0x2800
_LEFT = (0x01, 0x02, 0x04, 0x40)
_RIGHT = (0x08, 0x10, 0x20, 0x80)
_RANK: dict[Ink, int] = {"": 0, "dim": 1, "good": 2, "warn": 3, "alarm": 4, "title": 0, "here": 0}


def join_cells_by_key(cells: Iterable[tuple[str, Key]]) -> list[tuple[str, Key]]:
    """Join neighbouring (text, key) cells that have the same key, such as the same ink."""
    groups = groupby(cells, key=lambda cell: cell[1])
    return [("".join(text for text, _ in group), key) for key, group in groups]


@dataclass(frozen=True, slots=True, kw_only=True)
class PlotColumn:
    """Values of one exposure in a plot."""

    value: float | None = None
    bound: float | None = None
    """Half width of the band about 0 in which the value is expected."""
    mark: str = ""
    """Sign shown instead of a value, as for a miss or a coasted frame."""
    refused: float | None = None
    """Confidence of a streak that was not accepted; None: there is none."""


@dataclass(slots=True)
class Canvas:
    """Cells of 2 x 4 braille dots each, with an axis from ``low`` at the bottom to ``high``."""

    columns: int
    rows: int
    low: float
    high: float
    _dots: dict[tuple[int, int], int] = field(default_factory=dict)
    _inks: dict[tuple[int, int], Ink] = field(default_factory=dict)
    _glyphs: dict[tuple[int, int], str] = field(default_factory=dict)

    def draw_point(self, column: int, value: float, ink: Ink) -> None:
        """Draw a value as a fat dot; beyond the axis as an arrow in the outermost row."""
        if not self.low <= value <= self.high:
            row = 0 if value > self.high else self.rows - 1
            self.draw_sign(column, row, "▲" if value > self.high else "▼", ink)
            return
        top = min(max(round(self._level(value) - 0.5), 0), 4 * self.rows - 2)
        for level in (top, top + 1):
            self._dot(column, level, _LEFT[level % 4] | _RIGHT[level % 4], ink)

    def draw_line_dot(self, column: int, value: float) -> None:
        """Draw one small dot of a line; a value beyond the axis lies on its end."""
        clipped = min(max(value, self.low), self.high)
        level = min(max(round(self._level(clipped)), 0), 4 * self.rows - 1)
        self._dot(column, level, _LEFT[level % 4], "dim")

    def draw_sign(self, column: int, row: int, text: str, ink: Ink) -> None:
        """Write a sign into a cell."""
        self._glyphs[column, row] = text
        self._inks[column, row] = ink

    def row_of(self, value: float) -> int:
        """Return the row of cells in which a value lies."""
        return min(max(round(self._level(value)) // 4, 0), self.rows - 1)

    def line(self, row: int) -> Line:
        """Return one row of cells as runs of one ink."""
        return join_cells_by_key(self._cell((column, row)) for column in range(self.columns))

    def _cell(self, at: tuple[int, int]) -> tuple[str, Ink]:
        dots = self._dots.get(at)
        text = self._glyphs.get(at) or (chr(_BRAILLE | dots) if dots else " ")
        return text, self._inks.get(at, "")

    def _level(self, value: float) -> float:
        return (self.high - value) / (self.high - self.low) * (4 * self.rows - 1)

    def _dot(self, column: int, level: int, dots: int, ink: Ink) -> None:
        at = column, level // 4
        self._dots[at] = self._dots.get(at, 0) | dots
        if _RANK[ink] >= _RANK[self._inks.get(at, "")]:
            self._inks[at] = ink


def residual_plot(columns: Sequence[PlotColumn], width: int, rows: int) -> list[Line]:
    """Plot residuals as fat dots within their bounds, on an axis symmetric about 0.

    Exposures without a value show their sign at 0. ``width``: columns, the axis included.
    """
    shown = list(columns)[-max(width - AXIS_COLUMNS, 0) :]
    limit = residual_axis_limit(shown)
    canvas = Canvas(max(width - AXIS_COLUMNS, 0), rows, -limit, limit)
    _draw_residuals(canvas, shown, has_bounds=True)
    labels = {0: _figure(limit), rows - 1: _figure(-limit)}
    if rows % 2:
        labels[rows // 2] = "0"
    return [_with_axis(labels.get(row, ""), canvas.line(row)) for row in range(rows)]


def confidence_plot(columns: Sequence[PlotColumn], tau: float, width: int, rows: int) -> list[Line]:
    """Plot confidences between 0 and 1 as fat dots, tau as a line, misses as signs at 0.

    ``width``: columns, the axis included.
    """
    shown = list(columns)[-max(width - AXIS_COLUMNS, 0) :]
    canvas = Canvas(max(width - AXIS_COLUMNS, 0), rows, 0.0, 1.0)
    for column in range(canvas.columns):
        canvas.draw_line_dot(column, tau)
    _draw_confidences(canvas, shown, tau)
    labels = {0: "1", rows - 1: "0"}
    if rows > 2 and canvas.row_of(tau) not in labels:
        labels[canvas.row_of(tau)] = "τ"
    return [_with_axis(labels.get(row, ""), canvas.line(row)) for row in range(rows)]


def nis_plot(
    columns: Sequence[PlotColumn], band: tuple[float, float], width: int, rows: int
) -> list[Line]:
    """Plot NIS as fat dots on an axis from 0, the bounds of ``band`` as lines.

    The axis ends at ``NIS_HEADROOM`` times the upper bound. ``width``: columns, the axis included.
    """
    shown = list(columns)[-max(width - AXIS_COLUMNS, 0) :]
    canvas = Canvas(max(width - AXIS_COLUMNS, 0), rows, 0.0, NIS_HEADROOM * band[1])
    for column in range(canvas.columns):
        for bound in band:
            canvas.draw_line_dot(column, bound)
    for at, _, what in _placed(canvas, shown):
        if what.value is not None:
            is_inside = band[0] <= what.value <= band[1]
            canvas.draw_point(at, what.value, "good" if is_inside else "alarm")
        elif what.mark:
            canvas.draw_sign(at, rows - 1, what.mark, "warn")
    labels = {0: _figure(round(canvas.high)), rows - 1: "0"}
    if rows > 3:
        labels.setdefault(canvas.row_of(band[1]), _figure(band[1]))
    return [_with_axis(labels.get(row, ""), canvas.line(row)) for row in range(rows)]


def value_plot(values: Sequence[float | None], width: int, rows: int) -> list[Line]:
    """Plot values as fat dots on an axis between their extremes; None leaves a gap.

    With 40 values or more, the highest and the lowest fortieth do not set the axis; a value beyond
    it is drawn as an arrow. ``width``: columns, including those of the axis.
    """
    shown = list(values)[-max(width - AXIS_COLUMNS, 0) :]
    known = sorted(value for value in shown if value is not None)
    if not known or rows < 1:
        return [_with_axis("", [(" " * max(width - AXIS_COLUMNS, 0), "")]) for _ in range(rows)]
    beyond = len(known) // 40
    low, high = known[beyond], known[-1 - beyond]
    least = max(0.02 * abs(high), 1e-9)
    if high - low < least:
        low, high = low - 0.5 * least, high + 0.5 * least
    canvas = Canvas(max(width - AXIS_COLUMNS, 0), rows, low, high)
    columns = [PlotColumn(value=value) for value in shown]
    for at, _, what in _placed(canvas, columns):
        if what.value is not None:
            canvas.draw_point(at, what.value, "good")
    labels = {0: _figure(high), rows - 1: _figure(low)} if rows > 1 else {}
    return [_with_axis(labels.get(row, ""), canvas.line(row)) for row in range(rows)]


def residual_strip(columns: Sequence[PlotColumn], width: int) -> Line:
    """Plot residuals in one row, without bounds and axis."""
    shown = list(columns)[-max(width, 0) :]
    limit = residual_axis_limit(shown)
    canvas = Canvas(max(width, 0), 1, -limit, limit)
    _draw_residuals(canvas, shown, has_bounds=False)
    return canvas.line(0)


def confidence_strip(columns: Sequence[PlotColumn], tau: float, width: int) -> Line:
    """Plot confidences in one row, without an axis."""
    shown = list(columns)[-max(width, 0) :]
    canvas = Canvas(max(width, 0), 1, 0.0, 1.0)
    _draw_confidences(canvas, shown, tau)
    return canvas.line(0)


def residual_axis_limit(columns: Sequence[PlotColumn]) -> float:
    """Return the upper end of the residuals' symmetric axis, a round number.

    The axis holds the residuals, except those far beyond nearly all others, which are drawn as
    arrows, and the median bound: bounds just after a miss are many times as wide and would flatten
    all residuals. Bounds of coasted frames are used only where there are no measured values.
    """
    measured = [c for c in columns if c.value is not None]
    values = [abs(c.value) for c in measured if c.value is not None]
    bounds = sorted(c.bound for c in measured if c.bound is not None)
    others = [c.bound for c in columns if c.bound is not None]
    usual = [1.2 * bounds[len(bounds) // 2]] if bounds else []
    shown = _without_strays(values, usual)
    return _round_up(max([*shown, *usual] or others or [1.0]) * 1.05)


def _without_strays(values: list[float], usual: list[float]) -> list[float]:
    """Return the values without the few far beyond all others and beyond the bounds."""
    if len(values) < MIN_FOR_STRAYS:
        return values
    ordered = sorted(values)
    most = ordered[round(USUAL_SHARE * (len(ordered) - 1))]
    limit = STRAY_TIMES * max([most, *usual])
    return [value for value in values if value <= limit]


def sparkline(values: Sequence[float | None], high: float, width: int) -> str:
    """Return a bar for each value in eighths of a row, full at ``high``; a blank for None."""
    blocks = "▁▂▃▄▅▆▇█"
    shown = list(values)[-max(width, 0) :]
    return "".join(" " if v is None else blocks[min(max(int(v / high * 8), 0), 7)] for v in shown)


def _draw_residuals(canvas: Canvas, shown: Sequence[PlotColumn], *, has_bounds: bool) -> None:
    for at, cells, what in _placed(canvas, shown):
        if what.bound is not None and has_bounds:
            for column in range(at, at + cells):
                canvas.draw_line_dot(column, what.bound)
                canvas.draw_line_dot(column, -what.bound)
        if what.value is not None:
            is_outside = what.bound is not None and abs(what.value) > what.bound
            canvas.draw_point(at, what.value, "alarm" if is_outside else "good")
        elif what.mark:
            canvas.draw_sign(at, canvas.rows // 2, what.mark, "warn")


def _draw_confidences(canvas: Canvas, shown: Sequence[PlotColumn], tau: float) -> None:
    for at, _, what in _placed(canvas, shown):
        if what.value is not None:
            canvas.draw_point(at, min(what.value, 1.0), "good" if what.value >= tau else "warn")
        if what.mark:
            canvas.draw_sign(at, canvas.rows - 1, what.mark, "warn")
        if what.refused is not None:
            row = canvas.row_of(what.refused)
            if row < canvas.rows - 1 or not what.mark:
                canvas.draw_sign(at, row, REFUSED, "warn")


def _placed(canvas: Canvas, shown: Sequence[PlotColumn]) -> list[tuple[int, int, PlotColumn]]:
    """Return (column, cells to the next, exposure) of each; few exposures are spread out."""
    cells = cells_per_frame(canvas.columns, len(shown))
    start = canvas.columns - len(shown) * cells
    return [(start + n * cells, cells, what) for n, what in enumerate(shown)]


def cells_per_frame(columns: int, frames: int) -> int:
    """Return the number of cells for each of ``frames`` frames in ``columns`` cells."""
    return max(1, min(MAX_SPREAD, columns // max(frames, 1)))


def _with_axis(label: str, line: Line) -> Line:
    return [
        (f"{label:>{AXIS_COLUMNS - 1}}┤" if label else " " * (AXIS_COLUMNS - 1) + "│", "dim"),
        *line,
    ]


def _round_up(value: float) -> float:
    """Return the next of 1, 1.5, 2, 3, 5, 7 times a power of ten."""
    if value <= 0.0 or not math.isfinite(value):
        return 1.0
    power = 10.0 ** math.floor(math.log10(value))
    steps = (1.0, 1.5, 2.0, 3.0, 5.0, 7.0, 10.0)
    return next(step * power for step in steps if value <= step * power * (1 + 1e-9))


def _figure(value: float) -> str:
    return f"{value:.0f}" if 1000 <= abs(value) < 100_000 else f"{value:.3g}"
