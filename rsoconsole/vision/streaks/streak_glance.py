"""A glance along a proposal: is there light all along some line near it?

A glance costs a small part of a fit's time and so decides what is worth one. Most of what the
network faintly believes in are a few stars in a row: bright here and there, dark between. Light is
limited to a few sigmas before it is summed: stars count little, an unbroken line in full.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from rsoconsole.records import PixelArray
from rsoconsole.vision.frame import Background, median_of
from rsoconsole.vision.lines import (
    INTERPOLATED_VARIANCE,
    LONGEST_PX,
    OFF_PX,
    Box,
    length_of,
    smoothed_strip,
)
from rsoconsole.vision.stars import FWHM_PER_SIGMA

_LIMITS = (-1.5, 4.0)
"""Of the smoothed signal to noise of a place on the line."""
_OFFSET_PX = 10
_TURN_PX = 7
"""How far off a proposal's line may be in its middle, and by its direction at its ends."""
_RIM_PX = 4
_REACH_PX = _OFFSET_PX + _TURN_PX + _RIM_PX
_STEP_PX = 2
_SHORTEST_PX = 12
_COUNTS = 4
"""Step of the places along a line: fewer tables of lines to keep."""
_NEEDED, _FREE_LOGIT, _NEEDED_PER_LOGIT = 9.0, -4.0, 1.0
"""A fit is worth its time from here on; more for each unit of the network's log-odds below -4.
Measured on 92 frames of the calibration split: of 106 streaks that came above tau one was darker,
and of ten proposals a frame that have hope, 2.1 that are no streak are bright enough."""
_NEEDED_OF_MOST = 0.9
"""Of what a line so short can give at most."""
_SMALLEST = 1e-7
_GLANCE_PX = 300.0
_NARROW, _RAY_PX = 0.45, 0.55
"""Of the stars' width, and sigma at most: what fits light better that is narrower than theirs. What
widens stars alone, wind and drift, leaves a satellite's streak narrower; a ray is a pixel wide."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LineSignal:
    """What a glance saw."""

    value: float
    """Signal to noise of light along the best line, limited; the noise is that of plain sky."""
    most: float
    """What a line as long, bright all along, would have given."""

    def is_worth_a_fit(self, network_confidence: float) -> bool:
        """Whether there is light enough; the less the network believes, the more is asked for."""
        p = min(max(network_confidence, _SMALLEST), 1.0 - _SMALLEST)
        doubt = max(0.0, _FREE_LOGIT - math.log(p / (1.0 - p)))
        needed = min(_NEEDED + _NEEDED_PER_LOGIT * doubt, _NEEDED_OF_MOST * self.most)
        return self.value >= needed > 0.0


def line_signal(pixels: PixelArray, sky: Background, ends: Box, psf_sigma: float) -> LineSignal:
    """Light along the best line near ``ends`` (x_a, y_a, x_b, y_b); nothing outside the frame."""
    length = float(np.clip(length_of(ends), _SHORTEST_PX, LONGEST_PX))
    count = max(int(length) // _STEP_PX // _COUNTS, 1) * _COUNTS + 1
    smooth, is_inside = smoothed_strip(
        pixels, sky, ends, psf_sigma, columns=_STEP_PX * (count - 1) + 1, reach=_REACH_PX
    )
    limited = np.clip(smooth[:, ::_STEP_PX], *_LIMITS)
    lines = _lines(count)
    total = limited.ravel().take(lines).sum(axis=-1)
    seen = np.full(total.shape, count)
    if not is_inside.all():
        seen = is_inside[:, ::_STEP_PX].ravel().take(lines).sum(axis=-1)
        total[seen * _STEP_PX < _SHORTEST_PX] = 0.0
    if not total.any():
        return LineSignal(value=0.0, most=0.0)
    # Neighbours along share the light that the smoothing spread.
    alike = math.fsum(math.exp(-((k * _STEP_PX / psf_sigma) ** 2) / 4.0) for k in range(1, 6))
    places = np.maximum(seen, 1)
    each = total / np.sqrt(places * (1.0 + 2.0 * alike))
    best = int(np.argmax(each))
    most = _LIMITS[1] * math.sqrt(float(places[best]) / (1.0 + 2.0 * alike))
    return LineSignal(value=float(each[best]), most=most)


@lru_cache(maxsize=16)
def _lines(count: int) -> npt.NDArray[np.intp]:
    """Index in a strip of every place of every line that is tried: (lines, places)."""
    places = np.arange(count)
    along = np.linspace(-1.0, 1.0, count)
    turns = np.arange(-_TURN_PX, _TURN_PX + 1)[:, None, None]
    offsets = np.arange(-_OFFSET_PX, _OFFSET_PX + 1)[:, None]
    rows = np.rint(turns * along + offsets).astype(np.intp) + _REACH_PX
    lines = (rows * count + places).reshape(-1, count)
    lines.setflags(write=False)
    return lines


def width_at_a_glance(
    pixels: PixelArray, sky: Background, ends: Box, psf_fwhm_px: float
) -> tuple[float, float]:
    """Signal to noise of a line matched to the stars' width, and to a much narrower one.

    What the narrower fits better by far is a cosmic ray or a column of the sensor. Of a long line
    its middle is looked at.
    """
    import cv2

    sigma = math.sqrt((psf_fwhm_px / FWHM_PER_SIGMA) ** 2 + INTERPOLATED_VARIANCE)
    x_a, y_a, x_b, y_b = ends
    length = max(math.hypot(x_b - x_a, y_b - y_a), 1.0)
    dx, dy = (x_b - x_a) / length, (y_b - y_a) / length
    half = 0.5 * min(length, _GLANCE_PX)
    reach = math.ceil(OFF_PX + 3.0 * sigma)
    x, y = 0.5 * (x_a + x_b) - half * dx, 0.5 * (y_a + y_b) - half * dy
    turned = np.array([[dx, -dy, x + reach * dy], [dy, dx, y - reach * dx]])
    size = (max(int(2.0 * half), 4), 2 * reach + 1)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    strip = cv2.warpAffine(pixels, turned, size, flags=flags, borderMode=cv2.BORDER_REFLECT_101)
    noise = max(sky.at(sky.noise, x, y), 1e-9)
    values = (strip.astype(np.float32) - np.float32(sky.at(sky.level, x, y))) / np.float32(noise)
    found = []
    for each in (sigma, min(_NARROW * sigma, _RAY_PX)):
        kernel = cv2.getGaussianKernel(2 * math.ceil(3.0 * each) + 1, each).astype(np.float32)
        smooth = cv2.filter2D(values, -1, kernel, borderType=cv2.BORDER_REFLECT_101)
        smooth /= float(np.sqrt((kernel**2).sum()))
        # Followed along: a proposal may be turned by a little. Hot pixels are not most of it.
        best = smooth[2:-2].max(axis=0)
        found.append(median_of(best))
    return found[0], found[1]
