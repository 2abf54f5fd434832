"""A streak's light against the star catalogue: does it lie at known stars?

A catalogue lists few of the stars that a frame shows, but all that are brighter than its limit: so
light as bright as such a star, away from all listed stars, is not of a star.
"""

import math
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from rsoconsole.records import FloatArray, PixelArray
from rsoconsole.vision.lines.line_columns import (
    offsets_across_px,
    pixels_of_line_places,
    running_mean,
    sum_line_columns,
)
from rsoconsole.vision.lines.segments import Ends, length_of

CatalogueFinding: TypeAlias = Literal["stars", "no stars", "unclear"]

_LONGEST_PX = 1500.0
_ON_LINE, _REACH = 0.75, 1.5
"""Reach of a star's light off the line and along it, in star widths."""
_FEWEST, _MAX_TIMES = 2, 2.5
"""Least number of stars in a chain, and largest ratio of a star's light to catalogue light."""
_CHAIN, _MAX_REST, _REST_SNR, _NO_REST = 0.7, 0.25, 4.0, 0.05
_MIN_MISSING, _MIN_SNR = 0.5, 10.0


@dataclass(frozen=True, slots=True, kw_only=True)
class CatalogueLight:
    """Shares of a streak's light that lie at catalogue stars and away from them."""

    stars: int
    star_share: float
    rest_share: float
    """Share of the streak's light that lies away from catalogue stars."""
    rest_snr: float
    missing_share: float
    """Share of the streak's light away from them, bright enough to be in the catalogue."""

    @property
    def finding(self) -> CatalogueFinding:
        """Outcome: the streak is of catalogue stars ("stars"), is not ("no stars"), or "unclear".

        Usually it is unclear.
        """
        has_rest = self.rest_snr > _REST_SNR and self.rest_share > _NO_REST
        is_theirs = self.star_share > _CHAIN and self.rest_share < _MAX_REST
        if self.stars >= _FEWEST and is_theirs and not has_rest:
            return "stars"
        is_missing = self.missing_share > _MIN_MISSING and self.rest_snr > _MIN_SNR
        return "no stars" if is_missing else "unclear"


def compare_with_catalogue_stars(
    pixels: PixelArray,
    stars_px: FloatArray,
    stars_adu: FloatArray,
    *,
    ends: Ends,
    width_px: float,
    complete_adu: float,
) -> CatalogueLight | None:
    """Compare the light between ``ends`` (x_a, y_a, x_b, y_b) with catalogue stars.

    - stars_px: (n, 2) places of the catalogue stars in the frame
    - stars_adu: (n,) their expected light, by the catalogue's magnitudes
    - complete_adu: light of a star above which the catalogue is complete

    None where the line is too long or leaves the frame, or where no light stands out.
    """
    length, fwhm = length_of(ends), max(width_px, 1.5)
    if not 1.0 < length < _LONGEST_PX:
        return None
    u = np.arange(-math.ceil(fwhm), math.ceil(length + fwhm) + 1, dtype=np.float64)
    v = offsets_across_px(fwhm)
    columns = sum_line_columns(pixels, *pixels_of_line_places(ends, u, v[:, None]), v, fwhm)
    light = columns.light_adu
    total = float(light.sum())
    if not columns.is_inside.all() or total <= 0.0:
        return None
    places, predicted = _on_it(stars_px, stars_adu, ends, fwhm)
    owner = np.abs(u - places[:, None]) < _REACH * fwhm
    is_theirs = owner.any(axis=0)
    # A column that two stars may own counts once.
    theirs = float(light[is_theirs].sum())
    theirs = min(theirs, _MAX_TIMES * float(predicted.sum()))
    is_rest = ~is_theirs
    rest = float(light[is_rest].sum())
    window = 2 * round(fwhm) + 1
    is_bright = running_mean(light, window) * window > complete_adu
    return CatalogueLight(
        stars=len(places),
        star_share=max(theirs, 0.0) / total,
        rest_share=rest / total,
        rest_snr=rest / (columns.sigma_adu * math.sqrt(max(int(np.count_nonzero(is_rest)), 1))),
        missing_share=float(light[is_rest & is_bright].sum()) / total,
    )


def _on_it(
    stars_px: FloatArray, stars_adu: FloatArray, ends: Ends, fwhm: float
) -> tuple[FloatArray, FloatArray]:
    """Distances from end a of the stars on the line, and the expected light of each."""
    length = length_of(ends)
    dx, dy = (ends[2] - ends[0]) / length, (ends[3] - ends[1]) / length
    off_x, off_y = stars_px[:, 0] - ends[0], stars_px[:, 1] - ends[1]
    along, across = off_x * dx + off_y * dy, off_y * dx - off_x * dy
    is_on = (np.abs(across) < _ON_LINE * fwhm) & (along > -fwhm) & (along < length + fwhm)
    return along[is_on], stars_adu[is_on]
