"""The field as a finder chart: the brightest stars as points, the streaks as lines."""

import math
from collections.abc import Sequence

from rsoconsole.console.picture.marks import Cells, Mark, Window, mark_characters
from rsoconsole.records import ChartStar

SIZES = "·•●✶"
"""Signs of stars, the faintest first."""
LEAST_STEP_MAG = 0.5
"""Least difference between two sizes: stars about equally bright look alike."""
CELLS_A_STAR = 12
"""Cells of the chart for each star: more stars would hide the streaks."""


def chart_characters(stars: Sequence[ChartStar], marks: tuple[Mark, ...], window: Window) -> Cells:
    """Return the characters of a chart; signs and lines stand over the stars."""
    signs = star_marks(stars, window.columns * window.rows // CELLS_A_STAR)
    return mark_characters((*signs, *marks), window, has_lines=True)


def star_marks(stars: Sequence[ChartStar], most: int) -> tuple[Mark, ...]:
    """Return a mark for each of the ``most`` brightest stars, the faintest first.

    The range of their magnitudes is divided into the sizes.
    """
    shown = sorted(stars, key=lambda star: star.flux_adu)[-most:] if most > 0 else []
    if not shown:
        return ()
    fainter_by_mag = [2.5 * math.log10(star.flux_adu / shown[0].flux_adu) for star in shown]
    step = max(fainter_by_mag[-1] / len(SIZES), LEAST_STEP_MAG)
    sizes = (min(int(each / step), len(SIZES) - 1) for each in fainter_by_mag)
    return tuple(
        Mark(x_px=star.x_px, y_px=star.y_px, kind="star", label=SIZES[size])
        for star, size in zip(shown, sizes, strict=True)
    )
