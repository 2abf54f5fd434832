"""What speaks against a fitted line in the light along it: gaps in it, light beyond it."""

import math

import numpy as np

from rsoconsole.records import PixelArray
from rsoconsole.vision.frame import Background, median_of
from rsoconsole.vision.lines import Box, length_of, ridge_of
from rsoconsole.vision.stars import FWHM_PER_SIGMA

_SURE = 3.0
"""Sigmas."""
_BEYOND_PX = (30.0, 150.0)
"""How far at least and at most is looked beyond an end."""
_LIKE = 0.5
"""Light beyond an end is more of the same from this share of its level on."""
_SPREAD_OF_NOISE, _SPREAD_OF_LIGHT = 2.4, 1.45
"""Of the middle half of a line's places: most that noise makes (1.35 on average), and times the
level what a brightness that comes and goes as a sine makes."""
_DARK, _GAP_WIDTHS = 0.25, 3.0
"""Share of a line's level below which it is dark, and the widths of a star from which on a dark
stretch is a gap."""


def is_broken(pixels: PixelArray, sky: Background, ends: Box, psf_sigma: float) -> bool:
    """Whether what lies between ``ends`` is no one line: a few stars, or light with a gap in it.

    Stars spread the middle half of the places further than a tumbling satellite's light does; a
    gap is a dark stretch longer than stars are wide. Both are held against what noise makes.
    """
    ridge = ridge_of(pixels, sky, ends, psf_sigma)
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


def goes_on_beyond(pixels: PixelArray, sky: Background, ends: Box, psf_sigma: float) -> bool:
    """Whether the light of a line from a to b goes on beyond b, typically half as bright or more.

    Typical is the median along the line, so that stars in the way say nothing.
    """
    x_a, y_a, x_b, y_b = ends
    length = max(length_of(ends), 1.0)
    dx, dy = (x_b - x_a) / length, (y_b - y_a) / length
    near = 3.0 * psf_sigma + 2.0
    far = near + float(np.clip(0.5 * length, *_BEYOND_PX))
    further = (x_b + near * dx, y_b + near * dy, x_b + far * dx, y_b + far * dy)
    inside = ridge_of(pixels, sky, ends, psf_sigma)
    beyond = ridge_of(pixels, sky, further, psf_sigma)
    if beyond.size < _BEYOND_PX[0] - 2 or not inside.size:
        return False
    typical, level = median_of(beyond), median_of(inside)
    # Of a median of smoothed places: 1.25 / sqrt(n), n as many as stand alone.
    error = 1.25 / math.sqrt(beyond.size / (2.0 * math.sqrt(math.pi) * psf_sigma))
    return typical > _LIKE * level and typical > _SURE * error
