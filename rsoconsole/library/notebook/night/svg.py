"""Small plots as SVG text, for cards and the live panel, made without a plotting library.

Colours are of a middle lightness, legible on white and on black; text takes the colour of the page
(``currentColor``). Colour never carries meaning alone: shapes and titles say it too.
"""

import html
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

WIDTH, HEIGHT = 340.0, 96.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 38.0, 6.0, 6.0, 16.0
RED, BLUE, AMBER, GREY, GREEN = "#d64545", "#4a80d9", "#b8860b", "#8a8a8a", "#3f9142"


@dataclass(frozen=True, slots=True, kw_only=True)
class PlotAxes:
    """Ranges of the values on both axes of a drawing."""

    x: tuple[float, float]
    y: tuple[float, float]

    def to_svg_xy(self, x: float, y: float) -> tuple[float, float]:
        """Return the SVG coordinates of a point of the plot; y is limited to its range."""
        across = (x - self.x[0]) / ((self.x[1] - self.x[0]) or 1.0)
        up = (min(max(y, self.y[0]), self.y[1]) - self.y[0]) / ((self.y[1] - self.y[0]) or 1.0)
        return (
            _LEFT + across * (WIDTH - _LEFT - _RIGHT),
            HEIGHT - _BOTTOM - up * (HEIGHT - _TOP - _BOTTOM),
        )


def escape_markup(words: str) -> str:
    """Escape text for HTML and SVG; the result may also stand inside an attribute."""
    return html.escape(words, quote=True)


def plot_svg(axis: PlotAxes, parts: Iterable[str], *, label: str, ends: tuple[str, str]) -> str:
    """Return a small plot as SVG: frame, three ticks at the left, words below both ends.

    ``parts``: SVG of the marks; ``label``: description for screen readers; ``ends``: the words
    below both ends of the time axis.
    """
    low, high = axis.y
    ticks = []
    for value in (low, (low + high) / 2.0, high):
        _, y = axis.to_svg_xy(axis.x[0], value)
        ticks.append(
            f'<text x="{_LEFT - 4:.0f}" y="{y + 3:.1f}" text-anchor="end">{_short(value)}</text>'
        )
    x_0, y_0 = axis.to_svg_xy(axis.x[0], low)
    x_1, y_1 = axis.to_svg_xy(axis.x[1], high)
    frame = (
        f'<path d="M{x_0:.1f} {y_1:.1f}V{y_0:.1f}H{x_1:.1f}" fill="none" stroke="{GREY}"/>'
        f'<text x="{x_0:.1f}" y="{HEIGHT - 4:.0f}">{escape_markup(ends[0])}</text>'
        f'<text x="{x_1:.1f}" y="{HEIGHT - 4:.0f}" text-anchor="end">'
        f"{escape_markup(ends[1])}</text>"
    )
    return (
        f'<svg viewBox="0 0 {WIDTH:.0f} {HEIGHT:.0f}" role="img" '
        f'aria-label="{escape_markup(label)}" '
        'font-size="9" fill="currentColor" style="width:100%;height:auto;font-family:sans-serif">'
        f"{frame}{''.join(ticks)}{''.join(parts)}</svg>"
    )


def dots_svg(
    axis: PlotAxes, points: Iterable[tuple[float, float, str]], *, colour: str, hollow: bool = False
) -> str:
    """Return points (x, y, title) as SVG dots; ``hollow``: draw only the outlines."""
    fill = "none" if hollow else colour
    return "".join(
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="2.6" fill="{fill}" stroke="{colour}">'
        f"<title>{escape_markup(title)}</title></circle>"
        for x, y, title in ((*axis.to_svg_xy(a, b), title) for a, b, title in points)
    )


def line_svg(
    axis: PlotAxes, points: Sequence[tuple[float, float]], *, colour: str, dashed: bool
) -> str:
    """Return a line through points (x, y) as SVG; broken where y is not finite."""
    path, is_open = [], False
    for x, y in points:
        if not math.isfinite(y):
            is_open = False
            continue
        px, py = axis.to_svg_xy(x, y)
        path.append(f"{'L' if is_open else 'M'}{px:.1f} {py:.1f}")
        is_open = True
    dash = ' stroke-dasharray="4 3"' if dashed else ""
    return f'<path d="{"".join(path)}" fill="none" stroke="{colour}"{dash}/>'


def band_svg(axis: PlotAxes, low: float, high: float) -> str:
    """Return a pale band between two values of y as SVG, as wide as the plot."""
    x_0, y_0 = axis.to_svg_xy(axis.x[0], low)
    x_1, y_1 = axis.to_svg_xy(axis.x[1], high)
    size = f'width="{x_1 - x_0:.1f}" height="{y_0 - y_1:.1f}"'
    return f'<rect x="{x_0:.1f}" y="{y_1:.1f}" {size} fill="{BLUE}" fill-opacity="0.16"/>'


def _short(value: float) -> str:
    return f"{value:.3g}".replace("-", "−")
