"""A quick look along a line: is it broken, and does its light go on beyond an end?"""

import math

import numpy as np

from rsoconsole.records import PixelArray
from rsoconsole.vision.frame.background import Background
from rsoconsole.vision.frame.median import median_of
from rsoconsole.vision.lines.line_columns import ridge_snr
from rsoconsole.vision.lines.segments import Ends, length_of
from rsoconsole.vision.stars.star_moments import FWHM_PER_SIGMA

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
