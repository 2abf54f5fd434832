"""Pixels about a line, turned so that it runs along the rows, matched to the stars."""

import math

import numpy as np
import numpy.typing as npt

from rsoconsole.records import PixelArray
from rsoconsole.vision.frame import Background
from rsoconsole.vision.lines.streak_search import Box

Float32Array = npt.NDArray[np.float32]
BoolArray = npt.NDArray[np.bool_]

LONGEST_PX = 400
"""Of a longer line its middle is looked at."""
_RIM_PX = 4


def length_of(ends: Box) -> float:
    """From end to end, px."""
    return math.hypot(ends[2] - ends[0], ends[3] - ends[1])


def ridge_of(pixels: PixelArray, sky: Background, ends: Box, psf_sigma: float) -> Float32Array:
    """Smoothed signal to noise at every pixel along a line, as far as it is in the frame."""
    columns = int(min(length_of(ends), float(LONGEST_PX))) + 1
    smooth, is_inside = smoothed_strip(pixels, sky, ends, psf_sigma, columns=columns, reach=_RIM_PX)
    ridge: Float32Array = smooth[_RIM_PX][is_inside[_RIM_PX]]
    return ridge


def smoothed_strip(
    pixels: PixelArray,
    sky: Background,
    ends: Box,
    psf_sigma: float,
    *,
    columns: int,
    reach: int,
) -> tuple[Float32Array, BoolArray]:
    """Pixels about a line's middle, turned so that it runs along the rows, and which exist.

    The nearest pixel of each place, smoothed by ``psf_sigma`` px as stars are, in units of the
    noise that is left: (2 reach + 1, columns) each.
    """
    import cv2

    x_a, y_a, x_b, y_b = ends
    x, y, angle = 0.5 * (x_a + x_b), 0.5 * (y_a + y_b), math.atan2(y_b - y_a, x_b - x_a)
    u = np.arange(columns, dtype=np.float32) - np.float32(0.5 * (columns - 1))
    v = np.arange(-reach, reach + 1, dtype=np.float32)[:, None]
    cos, sin = np.float32(math.cos(angle)), np.float32(math.sin(angle))
    column, row = np.float32(x) + cos * u - sin * v, np.float32(y) + sin * u + cos * v
    height, width = pixels.shape
    is_inside = (column > -0.5) & (column < width - 0.5) & (row > -0.5) & (row < height - 0.5)
    columns_px = np.clip(np.rint(column), 0, width - 1).astype(np.intp)
    rows_px = np.clip(np.rint(row), 0, height - 1).astype(np.intp)
    strip = pixels[rows_px, columns_px].astype(np.float32)
    along = 0.5 * (columns - 1)
    dx, dy = along * math.cos(angle), along * math.sin(angle)
    levels = [sky.at(sky.level, x + k * dx, y + k * dy) for k in (-1, 0, 1)]
    strip -= np.interp(u, [-along, 0.0, along], levels).astype(np.float32)
    strip *= is_inside
    noise = max(sky.at(sky.noise, x, y), 1e-9)
    smooth = cv2.GaussianBlur(strip, (0, 0), psf_sigma)
    smooth *= np.float32(2.0 * math.sqrt(math.pi) * psf_sigma / noise)
    return np.asarray(smooth, dtype=np.float32), is_inside
