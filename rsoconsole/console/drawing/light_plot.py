"""Plot of magnitudes in cells: bright is up, with the error of each shaded about it."""

from collections.abc import Sequence
from dataclasses import dataclass

from rsoconsole.console.drawing.plot import (
    AXIS_COLUMNS,
    SHADE,
    VALUE_BEYOND,
    Canvas,
    Line,
    cells_per_frame,
)

MIN_SPAN_MAG = 0.2
"""Least span of the axis: a steady light looks steady."""
SPAN_SIGMAS = 6.0
"""Least span of the axis in typical errors."""
MIN_ROWS_FOR_ERRORS = 5
"""Rows from which on errors are drawn: below, a value has its place within a cell."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LightMark:
    """One exposure's magnitude."""

    mag: float
    sigma: float | None = None
    is_saturated: bool = False
    """True where it is brighter than measured: shown as an arrow up."""


def light_plot(marks: Sequence[LightMark | None], width: int, rows: int) -> list[Line]:
    """Plot magnitudes on an axis between their extremes, the brightest at the top.

    None leaves a gap. The axis leaves out the outermost fortieth on each side: an arrow stands for
    a value beyond it. ``width``: cells, the axis included.
    """
    shown = list(marks)[-max(width - AXIS_COLUMNS, 0) :]
    bright, faint = _axis([mark for mark in shown if mark is not None])
    canvas = Canvas(width - AXIS_COLUMNS, rows, -faint, -bright)
    cells = cells_per_frame(canvas.columns, len(shown))
    start = canvas.columns - len(shown) * cells
    placed = [(start + n * cells, mark) for n, mark in enumerate(shown) if mark is not None]
    if rows >= MIN_ROWS_FOR_ERRORS:
        for column, mark in placed:
            _draw_error(canvas, column, mark)
    for column, mark in placed:
        if mark.is_saturated:
            canvas.put(column, -mark.mag, VALUE_BEYOND[1], "warn")
        else:
            canvas.put_value(column, -mark.mag, "good")
    if rows < 2 or not placed:
        return canvas.lines({})
    return canvas.lines({-bright: _figure(bright), -faint: _figure(faint)})


def _axis(marks: Sequence[LightMark]) -> tuple[float, float]:
    """Return the magnitudes at the top and at the bottom of the axis."""
    if not marks:
        return 0.0, 1.0
    known = sorted(mark.mag for mark in marks)
    beyond = len(known) // 40
    bright, faint = known[beyond], known[-1 - beyond]
    errors = sorted(mark.sigma for mark in marks if mark.sigma is not None)
    typical = errors[len(errors) // 2] if errors else 0.0
    bright, faint = bright - typical, faint + typical
    missing = max(max(MIN_SPAN_MAG, SPAN_SIGMAS * typical) - (faint - bright), 0.0)
    return bright - 0.5 * missing, faint + 0.5 * missing


def _draw_error(canvas: Canvas, column: int, mark: LightMark) -> None:
    """Shade the cells within one sigma of a magnitude."""
    if mark.sigma is None or mark.is_saturated:
        return
    first, last = (canvas.row_of(-mark.mag + each) for each in (mark.sigma, -mark.sigma))
    step = (canvas.high - canvas.low) / max(canvas.rows - 1, 1)
    for row in range(first, last + 1):
        canvas.put(column, canvas.high - row * step, SHADE, "band")


def _figure(mag: float) -> str:
    """Return a magnitude in the cells before the axis."""
    text = f"{mag:.2f}"
    return text if len(text) < AXIS_COLUMNS else f"{mag:.1f}"
