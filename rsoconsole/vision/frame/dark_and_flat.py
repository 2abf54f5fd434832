"""Master dark and flat applied to a frame: prepared once, then one pass over each frame.

A calibrated pixel is ``raw * gain + offset``. The median of the dark is not subtracted: so the
noise of a dark sky does not fall below zero, and pixels saturate where they did before. Unusable
pixels (no light in the flat, nearly saturated in the dark) take the median of their neighbours.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from rsoconsole.records import Frame, PixelArray
from rsoconsole.vision.arrays import Float32Array, IndexArray
from rsoconsole.vision.frame.mosaic import CELL
from rsoconsole.vision.frame.workers import CALLER_ALONE, Workers

MIN_LIT = 0.1
"""Least light in the flat, as a share of its median, by which a pixel is divided."""
HOT_SHARE = 0.5
"""Share of a pixel's range: where the dark fills more, the pixel is not used."""
MAX_DEFECTS = 0.01
"""Largest share of defective pixels: with more, none is filled from its neighbours."""
_HOTTEST = 0.01
"""Share of all pixels, the brightest of the dark, that are examined as hot."""
_COARSE_ADU = 5.0
"""Noise below which whole numbers would spoil the frame, ADU."""
_STRIP_ROWS = 16
_NEIGHBOURS = 8
_SAMPLE = 5
"""Step in rows and columns of a median: an odd number meets all colours of a mosaic."""
_GAIN_STEPS = 65535.0


class DarkAndFlat:
    """Master dark and flat, prepared to calibrate frames of their size; for use by one thread."""

    def __init__(
        self, dark: PixelArray, flat: PixelArray | None = None, *, has_mosaic: bool = False
    ) -> None:
        """Prepare the masters, (height, width) in ADU; only the dark has the camera's offset in it.

        ``has_mosaic``: the sensor has a 2 x 2 mosaic of colours. The flat is then normalised colour
        by colour, and defective pixels are filled from neighbours of their colour. Raises
        ValueError where shapes differ and where the flat has no light in it.
        """
        if flat is not None and flat.shape != dark.shape:
            raise ValueError(f"a flat of {flat.shape} does not fit a dark of {dark.shape}")
        self.shape = dark.shape
        self._step = 2 if has_mosaic else 1
        self.level_adu = float(np.rint(np.median(dark[::_SAMPLE, ::_SAMPLE])))
        """Median of the dark, ADU, rounded; calibrated frames keep this level."""
        self._hot = _brightest(dark)
        self._hot_adu = dark.reshape(-1)[self._hot].astype(np.float32)
        self._gain, self._gain_step, self._unlit = _gains(flat, has_mosaic)
        self._offset = _offsets(dark, self._gain, self._gain_step, self.level_adu)
        self._is_whole = self._gain is None and bool(np.all(self._offset == np.rint(self._offset)))
        self._filled: tuple[float, IndexArray, IndexArray] | None = None

    def calibrated_frame(self, frame: Frame, workers: Workers = CALLER_ALONE) -> Frame:
        """Return the calibrated frame; ``frame`` itself is not changed.

        Pixels stay uint16 where the noise is several ADU, or where only whole numbers are added;
        else they become float32. Saturated pixels stay at ``saturation_adu`` at least. Raises
        ValueError for a frame of another shape.
        """
        if frame.pixels.shape != self.shape:
            raise ValueError(f"masters of {self.shape} do not fit a frame of {frame.pixels.shape}")
        is_whole = self._is_whole or _is_wide(frame.pixels)
        dtype = np.uint16 if frame.pixels.dtype == np.uint16 and is_whole else np.float32
        out: PixelArray = np.empty(self.shape, dtype)

        def calibrate(strips: Iterator[int]) -> None:
            scratch = np.empty((_STRIP_ROWS, self.shape[1]), np.float32)
            for strip in strips:
                rows = slice(strip * _STRIP_ROWS, (strip + 1) * _STRIP_ROWS)
                self._calibrate(frame, rows, out[rows], scratch)

        workers.share(calibrate, -(-self.shape[0] // _STRIP_ROWS))
        defects, neighbours = self._defects(frame.saturation_adu)
        if defects.size:
            flat_view = out.reshape(-1)
            flat_view[defects] = np.median(flat_view[neighbours], axis=1).astype(out.dtype)
        return replace(frame, pixels=out)

    def defect_count(self, saturation_adu: float) -> int:
        """Return the number of pixels filled from neighbours, for this saturation level."""
        return int(self._defects(saturation_adu)[0].size)

    def _calibrate(
        self, frame: Frame, rows: slice, out: npt.NDArray[Any], scratch: Float32Array
    ) -> None:
        import cv2

        raw, offset = frame.pixels[rows], self._offset[rows]
        depth = cv2.CV_16U if out.dtype == np.uint16 else cv2.CV_32F
        if self._gain is None:
            cv2.add(raw, offset, dst=out, dtype=depth)
        else:
            scaled = scratch[: len(raw)]
            cv2.multiply(raw, self._gain[rows], scaled, self._gain_step, cv2.CV_32F)
            cv2.add(scaled, offset, dst=out, dtype=depth)
        if raw.max() >= frame.saturation_adu:
            # The light that a full pixel did not hold is not known: no gain may lower it.
            full = out.dtype.type(min(frame.saturation_adu, 65535.0))
            np.maximum(out, full, where=raw >= frame.saturation_adu, out=out)

    def _defects(self, saturation_adu: float) -> tuple[IndexArray, IndexArray]:
        """Flat indices of the unused pixels, and of the pixels that replace each, (n, 8)."""
        if self._filled is None or self._filled[0] != saturation_adu:
            fullest = self.level_adu + HOT_SHARE * (saturation_adu - self.level_adu)
            wanted = np.union1d(self._unlit, self._hot[self._hot_adu > fullest])
            if wanted.size > MAX_DEFECTS * self._offset.size:
                wanted = wanted[:0]
            self._filled = (saturation_adu, *_neighbours(wanted, self.shape, self._step))
        return self._filled[1:]


def normalised_flat(flat: PixelArray, *, has_mosaic: bool = False) -> Float32Array:
    """Return the flat divided by its median, each colour of a mosaic by its own median.

    Raises ValueError where a median is not positive: the flat has no light in it.
    """
    out = flat.astype(np.float32)
    for row, column in CELL if has_mosaic else ((0, 0),):
        plane = out[row::2, column::2] if has_mosaic else out
        level = float(np.median(plane[::_SAMPLE, ::_SAMPLE]))
        if level <= 0.0:
            raise ValueError("the flat has no light in it")
        plane /= np.float32(level)
    return out


def _gains(
    flat: PixelArray | None, has_mosaic: bool
) -> tuple[npt.NDArray[np.uint16] | None, float, IndexArray]:
    """Gains as (gain in steps, the step, flat indices of single pixels without light).

    None for a gain of one everywhere.
    """
    import cv2

    nowhere = np.zeros(0, np.intp)
    if flat is None:
        return None, 1.0, nowhere
    light = normalised_flat(flat, has_mosaic=has_mosaic)
    is_dark = light < MIN_LIT
    if is_dark.any():
        # In a dark corner the gain stays at its most; what is dark among the lit is a defect.
        coded = np.clip(light * 1000.0, 0.0, 65535.0).astype(np.uint16)
        around = cv2.medianBlur(coded, 5)
        nowhere = np.flatnonzero(is_dark & (around >= 1000.0 * MIN_LIT))
    gain = np.reciprocal(np.maximum(light, np.float32(MIN_LIT)))
    if np.all(gain == 1.0):
        return None, 1.0, nowhere
    step = float(gain.max()) / _GAIN_STEPS
    gain /= np.float32(step)
    return np.rint(gain, out=gain).astype(np.uint16), step, nowhere


def _offsets(
    dark: PixelArray, gain: npt.NDArray[np.uint16] | None, step: float, level_adu: float
) -> Float32Array:
    """Offsets added to the pixels after their gain, ADU."""
    out = -dark.astype(np.float32)
    if gain is not None:
        out *= gain
        out *= np.float32(step)
    out += np.float32(level_adu)
    return out


def _brightest(dark: PixelArray) -> IndexArray:
    """Flat indices of pixels that stand out of the dark, the brightest where there are many."""
    sample = dark[::_SAMPLE, ::_SAMPLE].astype(np.float32)
    least = float(np.percentile(sample, 100.0 * (1.0 - _HOTTEST)))
    found = np.flatnonzero(dark.reshape(-1) > least)
    most = max(1, int(_HOTTEST * dark.size))
    if found.size <= most:
        return found
    values = dark.reshape(-1)[found]
    return np.sort(found[np.argpartition(values, -most)[-most:]])


def _is_wide(pixels: PixelArray) -> bool:
    """True where a pixel's noise is several whole numbers, by differences within one colour."""
    rows = pixels[:: max(1, pixels.shape[0] // 16)].astype(np.float32)
    return float(np.median(np.abs(rows[:, 2:] - rows[:, :-2]))) >= _COARSE_ADU


def _neighbours(
    wanted: IndexArray, shape: tuple[int, ...], step: int
) -> tuple[IndexArray, IndexArray]:
    """Pixels of ``wanted`` with a usable one near, and their nearest usable ones, (n, 8).

    ``step`` 2 stays within one colour of a mosaic. Fewer than eight are repeated.
    """
    height, width = shape
    reach = np.arange(-2, 3)
    dy, dx = (each.ravel() for each in np.meshgrid(reach, reach, indexing="ij"))
    nearest = np.argsort(dy**2 + dx**2, kind="stable")[1:]
    y = wanted[:, None] // width + step * dy[nearest]
    x = wanted[:, None] % width + step * dx[nearest]
    is_good = (y >= 0) & (y < height) & (x >= 0) & (x < width)
    place = np.where(is_good, y * width + x, 0)
    is_good &= ~np.isin(place, wanted)
    order = np.argsort(~is_good, axis=1, kind="stable")
    count = is_good.sum(axis=1)
    near = count > 0
    turn = np.arange(_NEIGHBOURS) % np.minimum(np.maximum(count, 1), _NEIGHBOURS)[:, None]
    chosen = np.take_along_axis(place, np.take_along_axis(order, turn, axis=1), axis=1)
    return wanted[near], chosen[near]
