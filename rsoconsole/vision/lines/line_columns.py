"""Light of every column of a line in one frame, summed across it above the sky beside it."""

import math
from dataclasses import dataclass

import numpy as np

from rsoconsole.records import FloatArray, PixelArray
from rsoconsole.vision.arrays import BoolArray, Float32Array
from rsoconsole.vision.frame.background import Background
from rsoconsole.vision.lines.segments import Ends, length_of

LONGEST_PX = 400
"""Length beyond which only the middle of a line is examined, px."""
_RIM_PX = 4


def ridge_snr(pixels: PixelArray, sky: Background, ends: Ends, psf_sigma: float) -> Float32Array:
    """Return the smoothed signal to noise at every pixel along a line, inside the frame.

    Only the middle of a line longer than ``LONGEST_PX`` is examined.
    """
    columns = int(min(length_of(ends), float(LONGEST_PX))) + 1
    smooth, is_inside = smoothed_snr_strip(
        pixels, sky, ends, psf_sigma, columns=columns, reach=_RIM_PX
    )
    ridge: Float32Array = smooth[_RIM_PX][is_inside[_RIM_PX]]
    return ridge


def smoothed_snr_strip(
    pixels: PixelArray, sky: Background, ends: Ends, psf_sigma: float, *, columns: int, reach: int
) -> tuple[Float32Array, BoolArray]:
    """Return smoothed signal to noise about a line, turned along the rows, and its mask.

    Two arrays (2 reach + 1, columns), centred on the line's middle: the nearest pixel of each
    place, smoothed with a Gaussian of ``psf_sigma`` px, in sigmas of the noise after smoothing; and
    True for places inside the frame.
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
    nearest = cv2.remap(pixels, column, row, cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE)
    strip = nearest.astype(np.float32)
    along = 0.5 * (columns - 1)
    dx, dy = along * math.cos(angle), along * math.sin(angle)
    levels = [sky.at(sky.level, x + k * dx, y + k * dy) for k in (-1, 0, 1)]
    strip -= np.interp(u, [-along, 0.0, along], levels).astype(np.float32)
    strip *= is_inside
    noise = max(sky.at(sky.noise, x, y), 1e-9)
    smooth = cv2.GaussianBlur(strip, (0, 0), psf_sigma)
    smooth *= np.float32(2.0 * math.sqrt(math.pi) * psf_sigma / noise)
    return np.asarray(smooth, dtype=np.float32), is_inside


_CORE, _GAP, _SIDE_PX = 1.0, 1.8, 8
"""Half width of the summed core and distance of the sky beside it, in widths; rows of that sky."""
_PER_MAD, _LEFT = 1.4826, 0.83
"""Sigma of a normal law over its median deviation, and sigma of noise left after interpolation."""
_MEDIAN = 1.57
"""Variance of a median over that of a mean."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LineColumns:
    """Light along a line, column by column of one pixel of length."""

    light_adu: FloatArray
    """(columns,) light, ADU per px of length."""
    sigma_adu: float
    """One sigma of a column's light by the noise of the sky, in the column and beside it."""
    noise_adu: float
    """One sigma of a pixel."""
    is_inside: BoolArray
    """(columns,) True where the frame holds every pixel of the sum."""


def pixels_of_line_places(
    ends: Ends, u: FloatArray, v: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Convert places along a line (``u`` from end a) and across it (``v``) to pixels x and y."""
    length = length_of(ends)
    dx, dy = (ends[2] - ends[0]) / length, (ends[3] - ends[1]) / length
    return ends[0] + dx * u - dy * v, ends[1] + dy * u + dx * v


def offsets_across_px(fwhm: float) -> FloatArray:
    """Return offsets across a line, px, (rows,): pixels to sum, and sky beside them."""
    _, near_px = _rows_px(fwhm)
    return np.arange(-near_px - _SIDE_PX, near_px + _SIDE_PX + 1, dtype=np.float64)


def _rows_px(fwhm: float) -> tuple[int, int]:
    """Half width of the summed core, and the distance at which the sky beside it begins, px."""
    core_px = max(math.ceil(_CORE * fwhm), 2)
    return core_px, max(math.ceil(_GAP * fwhm), core_px + 1)


def sum_line_columns(
    pixels: PixelArray, x: FloatArray, y: FloatArray, v: FloatArray, fwhm: float
) -> LineColumns:
    """Sum the light of a line's columns, above the sky beside it.

    - x, y: (rows, columns) pixels of the places; NaN where there is no pixel
    - v: (rows,) offset of each row from the line, as ``offsets_across_px`` gives it
    - fwhm: full width at half maximum across, px
    """
    import cv2

    height, width = pixels.shape
    core_px, near_px = _rows_px(fwhm)
    is_core, is_beside = np.abs(v) <= core_px, np.abs(v) >= near_px
    x_core, y_core = x[is_core], y[is_core]
    is_inside = (
        (x_core >= 0.0) & (x_core <= width - 1.0) & (y_core >= 0.0) & (y_core <= height - 1.0)
    ).all(axis=0)
    if not is_inside.any():
        nothing = np.zeros(x.shape[1])
        return LineColumns(light_adu=nothing, sigma_adu=1.0, noise_adu=1.0, is_inside=is_inside)
    left, right = _reach(x[:, is_inside], width)
    low, high = _reach(y[:, is_inside], height)
    piece = np.ascontiguousarray(pixels[low:high, left:right], dtype=np.float32)
    places_x, places_y = (x - left).astype(np.float32), (y - low).astype(np.float32)
    if not is_inside.all():
        places_x, places_y = np.nan_to_num(places_x), np.nan_to_num(places_y)
    strip = cv2.remap(piece, places_x, places_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    # Sorted once: a median costs three times as much.
    beside = np.sort(strip[is_beside], axis=0)
    middle = beside[(len(beside) - 1) // 2 : len(beside) // 2 + 1].mean(axis=0)
    level = running_mean(middle, 2 * math.ceil(2.0 * fwhm) + 1)
    deviation = np.abs(beside - level)[:, is_inside]
    noise = max(_PER_MAD / _LEFT * float(np.median(deviation)), 1e-6)
    rows, rows_beside = float(is_core.sum()), float(is_beside.sum())
    return LineColumns(
        light_adu=(strip[is_core] - level).sum(axis=0),
        noise_adu=noise,
        sigma_adu=noise * math.sqrt(rows + _MEDIAN * rows**2 / rows_beside),
        is_inside=is_inside,
    )


def _reach(places: FloatArray, side_px: int) -> tuple[int, int]:
    """First pixel and the one behind the last, of those that hold places, inside the frame."""
    first, last = float(places.min()), float(places.max())
    return int(min(max(first, 0.0), side_px - 2.0)), int(min(max(last, 0.0), side_px - 1.0)) + 2


def running_mean(values: FloatArray, window: int) -> FloatArray:
    """Return the running mean over ``window`` (odd) values; beyond the ends they repeat."""
    import cv2

    row = np.ascontiguousarray(values, dtype=np.float64)[None]
    return np.asarray(cv2.blur(row, (window, 1), borderType=cv2.BORDER_REPLICATE)[0])
