"""The 2 x 2 mosaic of a colour camera evened out: one level and one response in all four pixels.

Nothing is interpolated. The four pixels of a cell are scaled by the light that stars show in them,
or without enough stars by the noise of the sky; the sky of each is then shifted to the mean of the
four.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from rsoconsole.records import FloatArray, Frame, PixelArray
from rsoconsole.vision.arrays import Float32Array

CELL = ((0, 0), (0, 1), (1, 0), (1, 1))
"""Row and column of the four pixels of a mosaic's cell."""
_COLOURS = frozenset("RGBCYMWL")
_GRID = 8
"""Number of pieces along each side in which the sky's levels are compared."""
_MIN_STARS, _MAX_STARS = 15, 200
_STAR_SIGMAS = 10.0
_STAR_FIELD_PX = 1500
"""Side of the middle in which stars are searched, in cells."""
_SAMPLES = 200_000
_MAX_GAIN = 8.0
_FINE_STEPS = 2.0
"""Noise, in steps of the converter, below which whole numbers would add noise."""


def has_mosaic(header: Mapping[str, Any]) -> bool:
    """True where the header names colours of a 2 x 2 mosaic (BAYERPAT, or MaxIm DL's COLORTYP)."""
    for key in ("BAYERPAT", "COLORTYP"):
        value = header.get(key)
        colours = str(value).strip().upper() if isinstance(value, str) else ""
        if len(colours) == 4 and set(colours) <= _COLOURS and len(set(colours)) > 1:
            return True
    return False


def without_mosaic(frame: Frame) -> Frame:
    """Return the frame with its mosaic evened out; the frame itself where its header names none.

    Pixels stay uint16 where the noise is wide against the converter's steps, else they become
    float32. The saturation is that of the colour that reaches it first.
    """
    if not has_mosaic(frame.header):
        return frame
    pixels, factors, offsets = even_out_mosaic(frame.pixels, frame.saturation_adu)
    full = [
        factor * frame.saturation_adu + offset
        for factor, offset in zip(factors, offsets, strict=True)
    ]
    return replace(frame, pixels=pixels, saturation_adu=float(min(*full, 65535.0)))


def even_out_mosaic(
    pixels: PixelArray, saturation_adu: float
) -> tuple[PixelArray, tuple[float, ...], tuple[float, ...]]:
    """Give the four pixels of a mosaic's cell one response and one level.

    Returns the pixels, the factor of each of the four (in the order of ``CELL``) and the median
    offset added to it, ADU. A last odd row or column is treated like the others.
    """
    height, width = (side // 2 * 2 for side in pixels.shape)
    planes = [pixels[row:height:2, column:width:2] for row, column in CELL]
    sky, noise = np.array([_sky_of(plane) for plane in planes]).T
    gains = _gains_of_stars(planes, sky, noise, saturation_adu)
    if gains is None:
        # Photon noise goes with the root of the light; read noise hides what it hides of gains too.
        variance = noise**2
        gains = np.clip(variance / variance.mean(), 1.0 / _MAX_GAIN, _MAX_GAIN)
    factors = 1.0 / gains
    # Levels after scaling, piece by piece: a sky that is brighter on one side is so in each colour.
    levels = np.stack([_levels(plane) for plane in planes]) * factors[:, None, None]
    shifts = levels.mean(axis=0) - levels
    is_fine = float(np.min(noise * factors)) < _FINE_STEPS
    is_whole = pixels.dtype == np.uint16 and not is_fine
    out = np.empty(pixels.shape, np.uint16 if is_whole else np.float32)
    for (row, column), factor, shift in zip(CELL, factors, shifts, strict=True):
        part = pixels[row::2, column::2].astype(np.float32)
        part *= np.float32(factor)
        part += _spread(shift, part.shape)
        if is_whole:
            np.clip(np.rint(part, out=part), 0.0, 65535.0, out=part)
        out[row::2, column::2] = part
    return out, tuple(map(float, factors)), tuple(float(np.median(shift)) for shift in shifts)


def _sky_of(plane: npt.NDArray[Any]) -> tuple[float, float]:
    """Median and noise of a place's pixels, from differences of neighbours: no slope is in it."""
    some = plane[:: max(1, plane.size // _SAMPLES), :].astype(np.float32)
    apart = np.abs(np.diff(some, axis=1))
    # The mean, because the median of a few steps of the converter is too coarse; without stars.
    apart = np.minimum(apart, 4.0 * max(float(np.median(apart)), 1.0))
    noise = float(apart.mean(dtype=np.float64)) * np.sqrt(np.pi) / 2.0
    return float(np.median(some)), max(noise, 0.3)


def _gains_of_stars(
    planes: list[npt.NDArray[Any]], sky: FloatArray, noise: FloatArray, saturation_adu: float
) -> FloatArray | None:
    """Share of each place in the light of bright stars, 1 in the mean; None with too few."""
    import cv2

    planes = [_middle(plane) for plane in planes]
    signal = np.zeros(planes[0].shape, np.float32)
    for plane, level, sigma in zip(planes, sky, noise, strict=True):
        # Each place counts alike and a hot pixel alone little.
        excess = np.clip((plane.astype(np.float32) - np.float32(level)) / np.float32(sigma), -3, 60)
        signal += excess
    signal /= np.float32(2.0)
    peaks = signal == cv2.dilate(signal, np.ones((9, 9), np.uint8))
    peaks &= signal > _STAR_SIGMAS
    peaks[:4], peaks[-4:], peaks[:, :4], peaks[:, -4:] = False, False, False, False
    y, x = np.nonzero(peaks)
    brightest = np.argsort(-signal[y, x], kind="stable")[: 4 * _MAX_STARS]
    shares = []
    for row, column in zip(y[brightest], x[brightest], strict=True):
        around = np.s_[row - 1 : row + 2, column - 1 : column + 2]
        boxes = np.stack([plane[around] for plane in planes]).astype(np.float64)
        if boxes.max() >= 0.9 * saturation_adu:
            continue
        light = (boxes - sky[:, None, None]).sum(axis=(1, 2))
        # A hot pixel lights one place alone; a star all four.
        if light.min() <= 0.0 or light.max() > 0.7 * light.sum():
            continue
        shares.append(light / light.sum())
        if len(shares) >= _MAX_STARS:
            break
    if len(shares) < _MIN_STARS:
        return None
    gains = np.median(np.array(shares), axis=0)
    gains /= gains.mean()
    return np.asarray(np.clip(gains, 1.0 / _MAX_GAIN, _MAX_GAIN))


def _middle(plane: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Middle of a place's pixels, large enough to hold enough stars."""
    cut = [max(0, (side - _STAR_FIELD_PX) // 2) for side in plane.shape]
    return plane[cut[0] : plane.shape[0] - cut[0], cut[1] : plane.shape[1] - cut[1]]


def _levels(plane: npt.NDArray[Any]) -> FloatArray:
    """(_GRID, _GRID) medians of a place's pixels, fewer where the frame is small."""
    rows = np.array_split(np.arange(plane.shape[0]), _GRID)
    columns = np.array_split(np.arange(plane.shape[1]), _GRID)
    piece = max(1, int(np.sqrt(plane.size / _GRID**2 / 10_000)))
    return np.array(
        [
            [
                _mean_of_middle(plane[r[0] : r[-1] + 1 : piece, c[0] : c[-1] + 1 : piece])
                for c in columns
            ]
            for r in rows
        ]
    )


def _mean_of_middle(values: npt.NDArray[Any]) -> float:
    """Mean of the middle half: like the median, but not in whole steps."""
    ordered = np.sort(values, axis=None)
    quarter = ordered.size // 4
    return float(ordered[quarter : ordered.size - quarter].mean(dtype=np.float64))


def _spread(grid: FloatArray, shape: tuple[int, int]) -> Float32Array:
    """Spread the pieces' values over a whole plane, with slopes between their middles."""
    import cv2

    size = (shape[1], shape[0])
    spread = cv2.resize(grid.astype(np.float32), size, interpolation=cv2.INTER_LINEAR)
    return np.asarray(spread, dtype=np.float32)
