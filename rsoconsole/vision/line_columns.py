"""The light of every column of a line in one frame, summed across it above the sky beside it."""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rsoconsole.records import FloatArray, PixelArray
from rsoconsole.vision.streak_search import Box
from rsoconsole.vision.streak_strip import length_of

BoolArray = npt.NDArray[np.bool_]

_CORE, _GAP, _SIDE_PX = 1.0, 1.8, 8
"""Half width of what is summed and distance of the sky beside it, in widths; rows of that sky."""
_PER_MAD, _LEFT = 1.4826, 0.83
"""Sigma of a normal law over its median deviation; of noise, after interpolation."""
_MEDIAN = 1.57
"""Variance of a median over that of a mean."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LineColumns:
    """Light along a line, ADU per px of length."""

    light_adu: FloatArray
    """(columns,)"""
    sigma_adu: float
    """One sigma of a column by the sky's noise alone, its level's included."""
    noise_adu: float
    """One sigma of a pixel."""
    is_inside: BoolArray
    """(columns,): whether the frame holds all that is summed."""


def on_line(ends: Box, u: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Pixels of places ``u`` along the line from end a and ``v`` across it."""
    length = length_of(ends)
    dx, dy = (ends[2] - ends[0]) / length, (ends[3] - ends[1]) / length
    return ends[0] + dx * u - dy * v, ends[1] + dy * u + dx * v


def rows_across(fwhm: float) -> FloatArray:
    """How far off the line, px, what is summed and the sky beside it are looked at."""
    _, near_px = _rows_px(fwhm)
    return np.arange(-near_px - _SIDE_PX, near_px + _SIDE_PX + 1, dtype=np.float64)


def _rows_px(fwhm: float) -> tuple[int, int]:
    """Half width of what is summed, and where the sky beside it begins."""
    core_px = max(math.ceil(_CORE * fwhm), 2)
    return core_px, max(math.ceil(_GAP * fwhm), core_px + 1)


def columns_at(
    pixels: PixelArray, x: FloatArray, y: FloatArray, v: FloatArray, fwhm: float
) -> LineColumns:
    """The light of columns whose pixels are at ``x``, ``y`` (rows, columns), NaN where nowhere.

    ``v``: (rows,) how far off the line each row is, as ``rows_across`` gives it.
    """
    import cv2

    height, width = pixels.shape
    is_known = np.isfinite(x) & np.isfinite(y)
    is_in = is_known & (x >= 0.0) & (x <= width - 1.0) & (y >= 0.0) & (y <= height - 1.0)
    core_px, near_px = _rows_px(fwhm)
    is_core, is_beside = np.abs(v) <= core_px, np.abs(v) >= near_px
    is_inside = is_in[is_core].all(axis=0)
    if not is_in.any():
        nothing = np.zeros(x.shape[1])
        return LineColumns(light_adu=nothing, sigma_adu=1.0, noise_adu=1.0, is_inside=is_inside)
    left, low = int(x[is_in].min()), int(y[is_in].min())
    right, high = int(x[is_in].max()) + 2, int(y[is_in].max()) + 2
    piece = np.ascontiguousarray(pixels[low:high, left:right], dtype=np.float32)
    strip = cv2.remap(
        piece,
        np.where(is_known, x - left, 0.0).astype(np.float32),
        np.where(is_known, y - low, 0.0).astype(np.float32),
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )
    beside = strip[is_beside]
    level = smoothed(np.median(beside, axis=0), 2 * math.ceil(2.0 * fwhm) + 1)
    deviation = np.abs(beside - level)[:, is_inside]
    noise = _PER_MAD / _LEFT * float(np.median(deviation)) if deviation.size else 1.0
    noise = max(noise, 1e-6)
    rows, rows_beside = float(is_core.sum()), float(is_beside.sum())
    return LineColumns(
        light_adu=(strip[is_core] - level).sum(axis=0),
        noise_adu=noise,
        sigma_adu=noise * math.sqrt(rows + _MEDIAN * rows**2 / rows_beside),
        is_inside=is_inside,
    )


def smoothed(values: FloatArray, window: int) -> FloatArray:
    """Running mean over ``window`` (odd), the ends repeated."""
    import cv2

    row = np.ascontiguousarray(values, dtype=np.float64)[None]
    return np.asarray(cv2.blur(row, (window, 1), borderType=cv2.BORDER_REPLICATE)[0])
