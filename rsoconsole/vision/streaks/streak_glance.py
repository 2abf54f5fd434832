"""A quick look along a proposal: is there light all along a line near it?

It takes a small part of a fit's time and so decides which proposals are fitted. Most faint
proposals of the network are a few stars in a row: bright here and there, dark between. Light is
limited to a few sigmas before it is summed, so that stars count little and an unbroken line counts
in full.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from rsoconsole.records import PixelArray
from rsoconsole.vision.arrays import IndexArray
from rsoconsole.vision.frame.background import Background
from rsoconsole.vision.frame.median import median_of
from rsoconsole.vision.lines.line_columns import LONGEST_PX, ridge_snr, smoothed_snr_strip
from rsoconsole.vision.lines.line_strip import INTERPOLATED_VARIANCE, OFF_PX
from rsoconsole.vision.lines.segments import Ends, length_of
from rsoconsole.vision.stars.star_moments import FWHM_PER_SIGMA

_LIMITS = (-1.5, 4.0)
"""Limits of the smoothed signal to noise of a place on the line."""
_OFFSET_PX = 10
_TURN_PX = 7
"""Largest error of a proposal's line, px: in its middle, and by its direction at its ends."""
_RIM_PX = 4
_REACH_PX = _OFFSET_PX + _TURN_PX + _RIM_PX
_STEP_PX = 2
_SHORTEST_PX = 12
_COUNTS = 4
"""Step of the places along a line: fewer tables of lines to keep."""
_NEEDED, _FREE_LOGIT, _NEEDED_PER_LOGIT = 9.0, -4.0, 1.0
"""Signal to noise from which a fit is worth its time; more for each unit of the network's log-odds
below -4. Measured on 92 frames of the calibration split: of 106 streaks above tau one was darker,
and of ten proposals a frame worth considering, 2.1 that are no streak are bright enough."""
_NEEDED_OF_MOST = 0.9
"""Largest share of the highest value possible at this length that is required."""
_SMALLEST = 1e-7
_GLANCE_PX = 300.0
_NARROW, _RAY_PX = 0.45, 0.55
"""Width of the narrower line: share of the stars' width, and largest sigma, px."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LineSignal:
    """Signal to noise along a line, measured quickly to decide whether a fit is worth its time."""

    value: float
    """Signal to noise of light along the best line, limited; the noise is that of plain sky."""
    most: float
    """Largest ``value`` possible for a line of this length: bright all along."""

    def is_worth_a_fit(self, network_confidence: float) -> bool:
        """Return True where there is enough light for a fit.

        The less confident the network is, the more light is required.
        """
        p = min(max(network_confidence, _SMALLEST), 1.0 - _SMALLEST)
        doubt = max(0.0, _FREE_LOGIT - math.log(p / (1.0 - p)))
        needed = min(_NEEDED + _NEEDED_PER_LOGIT * doubt, _NEEDED_OF_MOST * self.most)
        return self.value >= needed > 0.0


def line_signal(pixels: PixelArray, sky: Background, ends: Ends, psf_sigma: float) -> LineSignal:
    """Measure the light along the best line near ``ends`` (x_a, y_a, x_b, y_b).

    ``value`` and ``most`` are 0 where the line is outside the frame.
    """
    length = min(max(length_of(ends), _SHORTEST_PX), LONGEST_PX)
    count = max(int(length) // _STEP_PX // _COUNTS, 1) * _COUNTS + 1
    smooth, is_inside = smoothed_snr_strip(
        pixels, sky, ends, psf_sigma, columns=_STEP_PX * (count - 1) + 1, reach=_REACH_PX
    )
    limited = np.minimum(np.maximum(smooth[:, ::_STEP_PX], _LIMITS[0]), _LIMITS[1])
    lines = _lines(count)
    total = limited.take(lines).sum(axis=-1)
    seen = np.full(total.shape, count)
    if not is_inside.all():
        seen = is_inside[:, ::_STEP_PX].take(lines).sum(axis=-1)
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
def _lines(count: int) -> IndexArray:
    """Indices in a strip of every place of every line searched: (lines, places)."""
    places = np.arange(count)
    along = np.linspace(-1.0, 1.0, count)
    turns = np.arange(-_TURN_PX, _TURN_PX + 1)[:, None, None]
    offsets = np.arange(-_OFFSET_PX, _OFFSET_PX + 1)[:, None]
    rows = np.rint(turns * along + offsets).astype(np.intp) + _REACH_PX
    lines = (rows * count + places).reshape(-1, count)
    lines.setflags(write=False)
    return lines


def star_width_and_narrow_snr(
    pixels: PixelArray, sky: Background, ends: Ends, psf_fwhm_px: float
) -> tuple[float, float]:
    """Return the signal to noise of a line as wide as stars, and of a much narrower one.

    Where the second is far larger, the line is a cosmic ray or a column of the sensor. Only the
    middle of a long line is examined.
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
        kernel /= np.linalg.norm(kernel)
        smooth = cv2.filter2D(values, -1, kernel, borderType=cv2.BORDER_REFLECT_101)
        # Followed along: a proposal may be turned by a little. Hot pixels are not most of it.
        best = smooth[2:-2].max(axis=0)
        found.append(median_of(best))
    return found[0], found[1]


_SURE = 3.0
"""Sigmas from which a difference is sure."""
_BEYOND_PX = (30.0, 150.0)
"""Least and largest distance examined beyond an end, px."""
_LIKE = 0.5
"""Share of a line's level from which light beyond an end is more of the same."""
_SPREAD_OF_NOISE, _SPREAD_OF_LIGHT = 2.4, 1.45
"""Largest spread of a line's middle half: by noise, and, times the level, by a sine's light."""
_DARK, _GAP_WIDTHS = 0.25, 3.0
"""Share of a line's level below which it is dark, and star widths from which that is a gap."""


def is_broken_line(pixels: PixelArray, sky: Background, ends: Ends, psf_sigma: float) -> bool:
    """Return True where the light between ``ends`` is a few stars, or a line with a gap.

    Brightness varies more along a row of stars than along a tumbling satellite's streak; a gap is a
    dark stretch longer than stars are wide. Both are compared with the effect of noise.
    """
    ridge = ridge_snr(pixels, sky, ends, psf_sigma)
    widths_px = FWHM_PER_SIGMA * psf_sigma
    window = max(round(widths_px), 1)
    if ridge.size < 4 * window:
        return False
    low, level, high = (float(each) for each in np.percentile(ridge, (25.0, 50.0, 75.0)))
    if high - low > _SPREAD_OF_NOISE + _SPREAD_OF_LIGHT * max(level, 0.0):
        return True
    # Smoothed by the stars' width already, the mean of a window is hardly calmer than one place.
    calm = np.convolve(ridge, np.full(window, 1.0 / window), mode="valid")
    is_dark = calm < min(_DARK * level, level - _SURE)
    edges = np.diff(np.concatenate([[0], is_dark.astype(np.int8), [0]]))
    starts, stops = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    longest = int((stops - starts).max(initial=0))
    return longest > 0 and longest + window > _GAP_WIDTHS * widths_px


def continues_beyond_end(pixels: PixelArray, sky: Background, ends: Ends, psf_sigma: float) -> bool:
    """True where the light of a line from a to b continues beyond b, at least half as bright.

    Both brightnesses are medians along the line, so that stars on it do not count.
    """
    x_a, y_a, x_b, y_b = ends
    length = max(length_of(ends), 1.0)
    dx, dy = (x_b - x_a) / length, (y_b - y_a) / length
    near = 3.0 * psf_sigma + 2.0
    far = near + float(np.clip(0.5 * length, *_BEYOND_PX))
    further = (x_b + near * dx, y_b + near * dy, x_b + far * dx, y_b + far * dy)
    inside = ridge_snr(pixels, sky, ends, psf_sigma)
    beyond = ridge_snr(pixels, sky, further, psf_sigma)
    if beyond.size < _BEYOND_PX[0] - 2 or not inside.size:
        return False
    typical, level = median_of(beyond), median_of(inside)
    # Of a median of smoothed places: 1.25 / sqrt(n), n as many as stand alone.
    error = 1.25 / math.sqrt(beyond.size / (2.0 * math.sqrt(math.pi) * psf_sigma))
    return typical > _LIKE * level and typical > _SURE * error
