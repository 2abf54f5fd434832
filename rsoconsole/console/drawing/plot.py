"""Plots in cells, drawn by plotext: values in a shaded band, the newest exposure at the right.

A line is a list of (text, ink). An ink names a colour, which only repeats what the signs say. What
lies beyond the axis has an arrow in the outermost row: a filled one for a value, an open one for a
bound.
"""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Literal, TypeVar, get_args

TrackInk = Literal["track_0", "track_1", "track_2", "track_3", "track_4", "track_5"]
Ink = Literal["", "dim", "band", "good", "warn", "alarm", "title", "here", TrackInk]
Line = list[tuple[str, Ink]]
Key = TypeVar("Key")

AXIS_COLUMNS = 6
NIS_HEADROOM = 1.6
"""Top of the NIS axis as a factor on the upper bound of its band."""
VALUE, REFUSED, SHADE, GHOST, CHANGED = "●", "×", "░", "╌", "│"
VALUE_BEYOND, BOUND_BEYOND = "▼▲", "▽△"
"""Arrows of a value and of a bound beyond the axis, below and above."""
_FINE = "braille"
"""Marker of plotext for values in low plots: four dots high in a cell."""
_LOW_ROWS = 4
"""Most rows of a plot whose values have their place within a cell."""
MIN_FOR_STRAYS, USUAL_SHARE, STRAY_TIMES = 5, 0.8, 5.0
"""Least number of values, share that sets the axis, factor on it beyond which one is a stray."""
_NEWEST = 5
"""Number of the newest bounds that the axis of the residuals always holds, by their median."""
MAX_SPREAD = 3
"""Most cells that one exposure takes, while there are few exposures."""
_INKS: tuple[Ink, ...] = get_args(Ink)
_FIRST_CODE = 16
"""Colour code of plotext for the first ink; the others follow."""
_CODED = re.compile(r"(?:\x1b\[(?:38;5;(\d+)|\d*)m)?([^\x1b]*)")


def join_cells_by_key(cells: Iterable[tuple[str, Key]]) -> list[tuple[str, Key]]:
    """Join neighbouring (text, key) cells of the same key, such as an ink."""
    groups = groupby(cells, key=lambda cell: cell[1])
    return [("".join(text for text, _ in group), key) for key, group in groups]


@dataclass(frozen=True, slots=True, kw_only=True)
class PlotColumn:
    """One exposure's content of a plot."""

    value: float | None = None
    bound: float | None = None
    """Half width of the band about 0 in which the value is expected."""
    ghost: float | None = None
    """Half width of that band by the settings on trial."""
    mark: str = ""
    """Sign shown instead of a value, as for a miss or a coasted frame."""
    refused: float | None = None
    """Confidence of a streak that was not accepted; None: there is none."""
    limit: float | None = None
    """Confidence from which on a detection counts."""
    change: str = ""
    """Words for parameters that were changed before this exposure."""


class Canvas:
    """Content of a plot by sign and ink, on an axis from ``low`` at the bottom to ``high``."""

    def __init__(self, columns: int, rows: int, low: float, high: float) -> None:
        self.columns, self.rows = max(columns, 0), rows
        self.low, self.high = low, high
        self._points: dict[tuple[str, Ink, bool], tuple[list[float], list[float]]] = {}
        self._texts: list[tuple[str, int, float, Ink]] = []

    def put(self, column: int, value: float, sign: str, ink: Ink) -> None:
        """Write a sign into the cell of a value; one beyond the axis into the outermost row."""
        self._add(column, self._clipped(value), (sign, ink, False))

    def fill(self, column: int, value: float, sign: str, ink: Ink) -> None:
        """Fill a column's cells from 0 to a value with a sign, as far as the axis goes."""
        self._add(column, self._clipped(value), (sign, ink, True))

    def put_value(self, column: int, value: float, ink: Ink) -> None:
        """Draw a value; beyond the axis as an arrow."""
        arrow = self._arrow(value, VALUE_BEYOND)
        if self.rows > _LOW_ROWS or arrow:
            self.put(column, value, arrow or VALUE, ink)
            return
        for half in (2 * column, 2 * column + 1):
            place = half * (self.columns - 1) / (2 * self.columns - 1)
            self._add(place, value, (_FINE, ink, False))

    def put_band(self, column: int, bound: float) -> None:
        """Shade a column between minus and plus a bound; arrows where it leaves the axis."""
        for value in (bound, -bound):
            self.fill(column, value, SHADE, "band")
        for value in (bound, -bound):
            if arrow := self._arrow(value, BOUND_BEYOND):
                self.put(column, value, arrow, "dim")

    def write(self, column: int, value: float, text: str, ink: Ink) -> None:
        """Write a text that begins in the cell of a value."""
        self._texts.append((text, column, self._clipped(value), ink))

    def row_of(self, value: float) -> int:
        """Return the row of cells in which a value lies, 0 at the top."""
        share = (self._clipped(value) - self.low) / (self.high - self.low)
        return self.rows - 1 - math.floor(round(0.5 + (self.rows - 1) * share, 8))

    def lines(self, labels: Mapping[float, str] | None = None) -> list[Line]:
        """Draw the plot; with ``labels`` (text by value) its axis stands on the left."""
        axis = 0 if labels is None else AXIS_COLUMNS
        if not self.columns or self.rows < 1 or not self._points:
            return _blank(self.columns + axis, self.rows)  # plotext draws no ticks without points
        from textual_plotext.plot import Plot

        figure = Plot()
        # plotext cuts a plot to the terminal that it finds: none in tests, another one by now
        # where the console's is being resized. It has no public way out.
        figure._limit_size(False, False)
        figure.plotsize(self.columns + axis, self.rows)
        figure.xaxes(False, False)
        figure.yaxes(labels is not None, False)
        figure.xticks([])
        figure.canvas_color("default")
        figure.axes_color("default")
        figure.ticks_color(_code("dim"))
        ticks = labels or {}
        figure.yticks(list(ticks), [f"{text:>{AXIS_COLUMNS - 1}}" for text in ticks.values()])
        figure.xlim(0, max(self.columns - 1, 1))
        figure.ylim(self.low, self.high)
        for (sign, ink, is_filled), (columns, values) in self._points.items():
            figure.scatter(columns, values, marker=sign, color=_code(ink), fillx=is_filled)
        for text, column, value, ink in self._texts:
            figure.text(text, column, value, color=_code(ink))
        built = [_line(text) for text in figure.build().splitlines()]
        return [_fitted(line, self.columns + axis) for line in built[: self.rows]]

    def _add(self, column: float, value: float, key: tuple[str, Ink, bool]) -> None:
        columns, values = self._points.setdefault(key, ([], []))
        columns.append(column)
        values.append(value)

    def _clipped(self, value: float) -> float:
        return min(max(value, self.low), self.high)

    def _arrow(self, value: float, arrows: str) -> str:
        if self.low <= value <= self.high:
            return ""
        return arrows[1] if value > self.high else arrows[0]


def _code(ink: Ink) -> int:
    return _FIRST_CODE + _INKS.index(ink)


def _line(coded: str) -> Line:
    """Return a line of plotext's with the inks of its colour codes."""
    pieces = [(text, code) for code, text in _CODED.findall(coded) if text]
    return join_cells_by_key(
        (text, _INKS[int(code) - _FIRST_CODE] if code else "") for text, code in pieces
    )


def _fitted(line: Line, width: int) -> Line:
    missing = width - sum(len(text) for text, _ in line)
    return [*line, (" " * missing, "")] if missing > 0 else line


def residual_plot(
    columns: Sequence[PlotColumn], width: int, rows: int, ink: Ink = "good"
) -> list[Line]:
    """Plot residuals in the shaded band of their bounds, on an axis symmetric about 0.

    Exposures without a value show their sign at 0; a change of parameters is an upright line with
    its words. ``width``: cells, the axis included. ``ink``: of values within their bounds.
    """
    shown = list(columns)[-max(width - AXIS_COLUMNS, 0) :]
    if not shown:
        return _blank(width, rows)
    limit = residual_axis_limit(shown)
    canvas = Canvas(width - AXIS_COLUMNS, rows, -limit, limit)
    _draw_residuals(canvas, shown, ink)
    labels = {limit: _angle(limit), -limit: f"-{_angle(limit)}"}
    if rows % 2 and rows > 1:
        labels[0.0] = "0"
    return canvas.lines(labels)


def confidence_plot(columns: Sequence[PlotColumn], tau: float, width: int, rows: int) -> list[Line]:
    """Plot confidences between 0 and 1, tau of each frame as a line, misses as signs at 0.

    ``tau``: in force now. ``width``: cells, the axis included.
    """
    shown = list(columns)[-max(width - AXIS_COLUMNS, 0) :]
    if not shown:
        return _blank(width, rows)
    canvas = Canvas(width - AXIS_COLUMNS, rows, 0.0, 1.0)
    placed = _placed(canvas, shown)
    limits = [tau if what.limit is None else what.limit for _, _, what in placed]
    before = placed[0][0] if placed else canvas.columns
    spans = [(0, before, limits[0] if limits else tau)]
    spans += [(at, cells, limit) for (at, cells, _), limit in zip(placed, limits, strict=True)]
    for at, cells, limit in spans:
        for column in range(at, at + cells):
            canvas.put(column, limit, GHOST, "dim")
    _draw_confidences(canvas, shown, tau)
    labels = {1.0: "1", 0.0: "0"}
    if rows > 2 and canvas.row_of(tau) not in {0, rows - 1}:
        labels[tau] = "τ"
    return canvas.lines(labels)


def nis_plot(
    columns: Sequence[PlotColumn], band: tuple[float, float], width: int, rows: int
) -> list[Line]:
    """Plot NIS on an axis from 0 over its shaded band.

    The axis ends at ``NIS_HEADROOM`` times the upper bound. ``width``: cells, the axis included.
    """
    shown = list(columns)[-max(width - AXIS_COLUMNS, 0) :]
    if not shown:
        return _blank(width, rows)
    canvas = Canvas(width - AXIS_COLUMNS, rows, 0.0, NIS_HEADROOM * band[1])
    for column in range(canvas.columns):
        canvas.fill(column, band[1], SHADE, "band")
    for at, _, what in _placed(canvas, shown):
        if what.value is not None:
            is_inside = band[0] <= what.value <= band[1]
            canvas.put_value(at, what.value, "good" if is_inside else "alarm")
        elif what.mark:
            canvas.put(at, 0.0, what.mark, "warn")
    labels = {canvas.high: _figure(round(canvas.high)), 0.0: "0"}
    if rows > 3 and canvas.row_of(band[1]) not in {0, rows - 1}:
        labels[band[1]] = _figure(band[1])
    return canvas.lines(labels)


def _blank(width: int, rows: int) -> list[Line]:
    """Return a plot without any content: the first paint need not wait for plotext."""
    return [[(" " * width, "")]] * rows


def value_plot(values: Sequence[float | None], width: int, rows: int) -> list[Line]:
    """Plot values on an axis between their extremes; None leaves a gap.

    The axis leaves out the outermost fortieth on each side: an arrow stands for a value beyond it.
    ``width``: cells, the axis included.
    """
    shown = list(values)[-max(width - AXIS_COLUMNS, 0) :]
    known = sorted(value for value in shown if value is not None)
    low, high = 0.0, 1.0
    if known:
        beyond = len(known) // 40
        low, high = known[beyond], known[-1 - beyond]
    least = max(0.02 * abs(high), 1e-9)
    if high - low < least:
        low, high = low - 0.5 * least, high + 0.5 * least
    canvas = Canvas(width - AXIS_COLUMNS, rows, low, high)
    for at, _, what in _placed(canvas, [PlotColumn(value=value) for value in shown]):
        if what.value is not None:
            canvas.put_value(at, what.value, "good")
    return canvas.lines({high: _figure(high), low: _figure(low)} if rows > 1 and known else {})


def residual_strip(columns: Sequence[PlotColumn], width: int) -> Line:
    """Plot residuals in one row, without bounds and axis."""
    shown = list(columns)[-max(width, 0) :]
    limit = residual_axis_limit(shown)
    canvas = Canvas(width, 1, -limit, limit)
    for at, _, what in _placed(canvas, shown):
        _draw_residual(canvas, at, what)
    return canvas.lines()[0]


def confidence_strip(columns: Sequence[PlotColumn], tau: float, width: int) -> Line:
    """Plot confidences in one row, without an axis."""
    shown = list(columns)[-max(width, 0) :]
    canvas = Canvas(width, 1, 0.0, 1.0)
    _draw_confidences(canvas, shown, tau)
    return canvas.lines()[0]


def residual_axis_limit(columns: Sequence[PlotColumn]) -> float:
    """Return half the height of the residuals' axis, a round number that most values fit into.

    Bounds just after a miss are many times as wide as the usual ones, and an axis for them would
    put all residuals on zero: the axis holds the median bound, and that of the newest frames, with
    a fifth to spare. A residual far beyond nearly all others does not count either: what does not
    fit has an arrow. Bounds of coasted frames count only where there is nothing else.
    """
    measured = [c for c in columns if c.value is not None]
    values = [abs(c.value) for c in measured if c.value is not None]
    bounds = [c.bound for c in measured if c.bound is not None]
    others = [c.bound for c in columns if c.bound is not None]
    usual = [1.2 * max(_median(bounds), _median(bounds[-_NEWEST:]))] if bounds else []
    shown = _without_strays(values, usual)
    return _round_up(max([*shown, *usual] or others or [1.0]) * 1.05)


def _median(values: Sequence[float]) -> float:
    return sorted(values)[len(values) // 2]


def _without_strays(values: list[float], usual: list[float]) -> list[float]:
    """Return the values without the few far beyond all others and beyond the bounds."""
    if len(values) < MIN_FOR_STRAYS:
        return values
    ordered = sorted(values)
    most = ordered[round(USUAL_SHARE * (len(ordered) - 1))]
    limit = STRAY_TIMES * max([most, *usual])
    return [value for value in values if value <= limit]


def sparkline(values: Sequence[float | None], high: float, width: int) -> str:
    """Return an eighth block for each value, its height by value over ``high``; None: a blank."""
    blocks = "▁▂▃▄▅▆▇█"
    shown = list(values)[-max(width, 0) :]
    return "".join(" " if v is None else blocks[min(max(int(v / high * 8), 0), 7)] for v in shown)


def _draw_residuals(canvas: Canvas, shown: Sequence[PlotColumn], ink: Ink) -> None:
    placed = _placed(canvas, shown)
    for at, cells, what in placed:
        if what.bound is not None:
            for column in range(at, at + cells):
                canvas.put_band(column, what.bound)
    for at, cells, what in placed:
        if what.ghost is not None:
            for column in range(at, at + cells):
                for value in (what.ghost, -what.ghost):
                    if canvas.low <= value <= canvas.high:
                        canvas.put(column, value, GHOST, "title")
    _draw_changes(canvas, placed)
    for at, _, what in placed:
        _draw_residual(canvas, at, what, ink)


def _draw_residual(canvas: Canvas, at: int, what: PlotColumn, ink: Ink = "good") -> None:
    if what.value is not None:
        is_outside = what.bound is not None and abs(what.value) > what.bound
        canvas.put_value(at, what.value, "alarm" if is_outside else ink)
    elif what.mark:
        canvas.put(at, 0.0, what.mark, "warn")


def _draw_changes(canvas: Canvas, placed: Sequence[tuple[int, int, PlotColumn]]) -> None:
    """Draw an upright line before each exposure that came after a change, with its words."""
    free = 0
    for at, _, what in placed:
        if not what.change:
            continue
        for row in range(canvas.rows):
            value = canvas.low + (canvas.high - canvas.low) * row / max(canvas.rows - 1, 1)
            canvas.put(at, value, CHANGED, "title")
        left = at + 1
        if left + len(what.change) > canvas.columns:
            left = at - len(what.change)
        if left >= free:
            canvas.write(left, canvas.high, what.change, "title")
            free = left + len(what.change) + 1


def _draw_confidences(canvas: Canvas, shown: Sequence[PlotColumn], tau: float) -> None:
    placed = _placed(canvas, shown)
    _draw_changes(canvas, placed)
    for at, _, what in placed:
        if what.value is not None:
            limit = tau if what.limit is None else what.limit
            ink: Ink = "good" if what.value >= limit else "warn"
            canvas.put_value(at, min(what.value, 1.0), ink)
        if what.mark:
            canvas.put(at, 0.0, what.mark, "warn")
        if what.refused is not None and (
            canvas.row_of(what.refused) < canvas.rows - 1 or not what.mark
        ):
            canvas.put(at, what.refused, REFUSED, "warn")


def _placed(canvas: Canvas, shown: Sequence[PlotColumn]) -> list[tuple[int, int, PlotColumn]]:
    """Return (column, cells to the next, exposure) of each; few exposures are spread out."""
    cells = cells_per_frame(canvas.columns, len(shown))
    start = canvas.columns - len(shown) * cells
    return [(start + n * cells, cells, what) for n, what in enumerate(shown)]


def cells_per_frame(columns: int, frames: int) -> int:
    """Return how many cells each frame takes in a plot of that many columns and frames."""
    return max(1, min(MAX_SPREAD, columns // max(frames, 1)))


def _round_up(value: float) -> float:
    """Return the next of 1, 1.5, 2, 3, 5, 7 times a power of ten, in the unit of `_angle`."""
    if value <= 0.0 or not math.isfinite(value):
        return 1.0
    unit = next((size for size in (3600.0, 60.0) if value > 2.5 * size), 1.0)
    power = 10.0 ** math.floor(math.log10(value / unit)) * unit
    steps = (1.0, 1.5, 2.0, 3.0, 5.0, 7.0, 10.0)
    return next(step * power for step in steps if value <= step * power * (1 + 1e-9))


def _angle(value_arcsec: float) -> str:
    """Return an angle in at most four cells; without a unit: arcsec."""
    for size, unit in ((3600.0, "°"), (60.0, "′")):
        if value_arcsec >= 3.0 * size:
            return f"{value_arcsec / size:.3g}{unit}"
    return f"{value_arcsec:.3g}".removeprefix("0")


def _figure(value: float) -> str:
    """Return a figure in at most the cells before the axis, with up to three digits."""
    text = f"{value:.0f}" if 1000 <= abs(value) < 10_000 else f"{value:.3g}"
    return text if len(text) < AXIS_COLUMNS else f"{value:.2g}".replace("e+0", "e")
