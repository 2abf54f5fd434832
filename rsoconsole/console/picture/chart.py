"""The field as a finder chart: the brightest stars as points, the streaks as lines."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from rsoconsole.console.drawing.track_marks import track_ink
from rsoconsole.console.picture.marks import Cells, Mark, Window, mark_characters
from rsoconsole.console.picture.picture import Picture
from rsoconsole.records import ChartStar

SIZES = "·•◉✶"
"""Signs of stars, the faintest first."""
LEAST_STEP_MAG = 0.5
"""Least difference between two sizes: stars about equally bright look alike."""
CELLS_A_STAR = 12
"""Cells of the chart for each star: more stars would hide the streaks."""
LEGEND_COLUMNS = 14
"""Least columns beside a chart for its legend."""


class StarSizes(NamedTuple):
    """Sizes by which a chart's stars are drawn: from the faintest shown star on, in equal steps."""

    faintest_adu: float
    step_mag: float

    @classmethod
    def of(cls, stars: Sequence[ChartStar]) -> "StarSizes":
        """Return the sizes for a chart's stars, the faintest first."""
        faintest, brightest = stars[0].flux_adu, stars[-1].flux_adu
        range_mag = 2.5 * math.log10(brightest / faintest)
        return cls(faintest, max(range_mag / len(SIZES), LEAST_STEP_MAG))

    def sign(self, star: ChartStar) -> str:
        """Return the sign of a star."""
        brighter_mag = 2.5 * math.log10(star.flux_adu / self.faintest_adu)
        return SIZES[min(int(brighter_mag / self.step_mag), len(SIZES) - 1)]


def charted_stars(picture: Picture, window: Window) -> list[ChartStar]:
    """Return the brightest stars, as many as the chart has room for, the faintest first."""
    most = window.columns * window.rows // CELLS_A_STAR
    return sorted(picture.stars or (), key=lambda star: star.flux_adu)[-most:] if most else []


def chart_characters(picture: Picture, marks: tuple[Mark, ...], window: Window) -> Cells:
    """Return the characters of a chart; signs and lines stand over the stars.

    ``marks``: those over the picture; a followed streak gets its track's number as its label.
    """
    stars = charted_stars(picture, window)
    signs: tuple[Mark, ...] = ()
    if stars:
        sizes = StarSizes.of(stars)
        signs = tuple(
            Mark(x_px=star.x_px, y_px=star.y_px, kind="star", label=sizes.sign(star))
            for star in stars
        )
    lead = next((track for track in picture.detail.tracks if track.is_lead), None)
    if lead is not None:
        marks = tuple(
            replace(mark, label=lead.number_text, number_kind=track_ink(lead.track_id))
            if mark.kind == "followed"
            else mark
            for mark in marks
        )
    return mark_characters((*signs, *marks), window, has_lines=True)


def chart_legend(picture: Picture, window: Window, columns: int) -> list[str]:
    """Return the legend in lines: the magnitude from which on a star has each size, and signs.

    Empty where there are fewer than ``LEGEND_COLUMNS`` columns or the zero point is not known.
    """
    stars = charted_stars(picture, window)
    light, taken = picture.detail.photometry, picture.detail.taken
    zero_point = None if light is None else light.zero_point_mag
    exposure_s = None if taken is None else taken.exposure_s
    if columns < LEGEND_COLUMNS or not stars or zero_point is None or not exposure_s:
        return []
    sizes = StarSizes.of(stars)
    faintest_mag = zero_point - 2.5 * math.log10(sizes.faintest_adu / exposure_s)
    limits = [
        f"  {sign} {faintest_mag - size * sizes.step_mag:4.1f}" for size, sign in enumerate(SIZES)
    ]
    return ["", "  to mag", *reversed(limits), "", " [─] streak", "  +  predicted"]
