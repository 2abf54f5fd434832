"""Master dark and master flat applied to a frame: prepared once, then one pass over each frame.

A calibrated pixel is ``raw * gain + offset``. The dark's median stays in it: the noise of a dark
sky does not fall below zero, and what saturates does so where it did before. Pixels that nothing
can be known of (no light in the flat, nearly saturated in the dark) take the median of their
neighbours.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from rsoconsole.records import FloatArray, Frame, PixelArray
from rsoconsole.vision.arrays import Float32Array, IndexArray
from rsoconsole.vision.frame.workers import CALLER_ALONE, Workers

CELL = ((0, 0), (0, 1), (1, 0), (1, 1))
"""Row and column of the four places."""
_COLOURS = frozenset("RGBCYMWL")
_GRID = 8
"""The sky's levels are compared in this many pieces along each side."""
_MIN_STARS, _MAX_STARS = 15, 200
_STAR_SIGMAS = 10.0
_STAR_FIELD_PX = 1500
"""Cells a side of the middle in which stars are looked for."""
_SAMPLES = 200_000
_MAX_GAIN = 8.0
_FINE_STEPS = 2.0
"""Where the noise is fewer steps of the converter, whole numbers would add noise."""


def has_mosaic(header: Mapping[str, Any]) -> bool:
    """Whether the header names the colours of a 2 x 2 mosaic (BAYERPAT, or MaxIm DL's COLORTYP)."""
    for key in ("BAYERPAT", "COLORTYP"):
        value = header.get(key)
        colours = str(value).strip().upper() if isinstance(value, str) else ""
        if len(colours) == 4 and set(colours) <= _COLOURS and len(set(colours)) > 1:
            return True
    return False


def evened(frame: Frame) -> Frame:
    """The frame without its mosaic; the frame itself where its header names none.

    Pixels stay uint16 where the noise is wide against the converter's steps, else they become
    float32. The saturation is that of the colour that reaches it first.
    """
    if not has_mosaic(frame.header):
        return frame
    pixels, factors, offsets = even_out(frame.pixels, frame.saturation_adu)
    full = [
        factor * frame.saturation_adu + offset
        for factor, offset in zip(factors, offsets, strict=True)
    ]
    return replace(frame, pixels=pixels, saturation_adu=float(min(*full, 65535.0)))


def even_out(
    pixels: PixelArray, saturation_adu: float
) -> tuple[PixelArray, tuple[float, ...], tuple[float, ...]]:
    """(pixels, factor of each place, what is added to it in the median), places as ``CELL``.

    Rows and columns beyond a whole number of cells, one at most, are treated like the others.
    """
    height, width = (side // 2 * 2 for side in pixels.shape)
    planes = [pixels[row:height:2, column:width:2] for row, column in CELL]
    sky, noise = np.array([_sky_of(plane) for plane in planes]).T
    gains = _mosaic_gains(planes, sky, noise, saturation_adu)
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


def _mosaic_gains(
    planes: list[npt.NDArray[Any]],
    sky: FloatArray,
    noise: FloatArray,
    saturation_adu: float,
) -> FloatArray:
    """Response of each place, 1 in the mean: by the stars, or else by the noise of its sky."""
    by_stars = _gains_of_stars(planes, sky, noise, saturation_adu)
    if by_stars is not None:
        return by_stars
    # Photon noise goes with the root of the light; read noise hides what it hides of the gains too.
    variance = noise**2
    return np.asarray(np.clip(variance / variance.mean(), 1.0 / _MAX_GAIN, _MAX_GAIN))


def _gains_of_stars(
    planes: list[npt.NDArray[Any]],
    sky: FloatArray,
    noise: FloatArray,
    saturation_adu: float,
) -> FloatArray | None:
    """Each place's share of the light of bright stars, 1 in the mean; None with too few of them."""
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
    """So much of a place's pixels as has stars enough."""
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
    """The pieces' values over a whole plane, with slopes between their middles."""
    import cv2

    size = (shape[1], shape[0])
    spread = cv2.resize(grid.astype(np.float32), size, interpolation=cv2.INTER_LINEAR)
    return np.asarray(spread, dtype=np.float32)


MIN_LIT = 0.1
"""Of the flat's median: what has less light is not divided by it."""
HOT_SHARE = 0.5
"""Of a pixel's range: where the dark fills more of it, the pixel is not used."""
MAX_DEFECTS = 0.01
"""Of all pixels: with more of them, none is filled from its neighbours."""
_HOTTEST = 0.01
"""Of all pixels: how many of the brightest in the dark are looked at."""
_COARSE_ADU = 5.0
"""Where the noise is less, whole numbers would spoil what is left."""
_STRIP_ROWS = 16
_NEIGHBOURS = 8
_SAMPLE = 5
"""Step in rows and columns of a median: an odd number meets all colours of a mosaic."""
_GAIN_STEPS = 65535.0


class DarkAndFlat:
    """One dark and one flat, ready for frames of their size. For one thread."""

    def __init__(
        self, dark: PixelArray, flat: PixelArray | None = None, *, has_mosaic: bool = False
    ) -> None:
        """``dark`` in ADU with the camera's offset in it, ``flat`` without; both (height, width).

        ``has_mosaic``: the colours of a 2 x 2 mosaic keep their levels among each other, and are
        filled from their like. Raises ValueError where shapes differ and where the flat has no
        light in it.
        """
        if flat is not None and flat.shape != dark.shape:
            raise ValueError(f"a flat of {flat.shape} does not fit a dark of {dark.shape}")
        self.shape = dark.shape
        self._step = 2 if has_mosaic else 1
        self.level_adu = float(np.rint(np.median(dark[::_SAMPLE, ::_SAMPLE])))
        """Median of the dark, which stays in the frame; whole, as frames are."""
        self._hot = _brightest(dark)
        self._hot_adu = dark.reshape(-1)[self._hot].astype(np.float32)
        self._gain, self._gain_step, self._unlit = _gains(flat, has_mosaic)
        self._offset = _offsets(dark, self._gain, self._gain_step, self.level_adu)
        self._is_whole = self._gain is None and bool(np.all(self._offset == np.rint(self._offset)))
        self._filled: tuple[float, IndexArray, IndexArray] | None = None

    def applied(self, frame: Frame, workers: Workers = CALLER_ALONE) -> Frame:
        """The calibrated frame; ``frame`` itself is not changed.

        Pixels stay uint16 where the noise is wide against whole numbers, or nothing but whole
        numbers is taken away; else they become float32. What was saturated stays at
        ``saturation_adu`` at least. Raises ValueError for a frame of another shape.
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

    def defects(self, saturation_adu: float) -> int:
        """How many pixels of a camera that saturates there are filled from their neighbours."""
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
        """Flat indices of what is not used, and of the pixels that stand for each, (n, 8)."""
        if self._filled is None or self._filled[0] != saturation_adu:
            fullest = self.level_adu + HOT_SHARE * (saturation_adu - self.level_adu)
            wanted = np.union1d(self._unlit, self._hot[self._hot_adu > fullest])
            if wanted.size > MAX_DEFECTS * self._offset.size:
                wanted = wanted[:0]
            self._filled = (saturation_adu, *_neighbours(wanted, self.shape, self._step))
        return self._filled[1:]


def normalised(flat: PixelArray, *, has_mosaic: bool = False) -> Float32Array:
    """The flat over its median, each colour of a mosaic over its own.

    Raises ValueError where a median is not positive: there is no light in it.
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
    """(gain in steps, the step, flat indices of single pixels without light).

    None for a gain of one everywhere.
    """
    import cv2

    nowhere = np.zeros(0, np.intp)
    if flat is None:
        return None, 1.0, nowhere
    light = normalised(flat, has_mosaic=has_mosaic)
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
    """What is added to a pixel after its gain, ADU."""
    out = -dark.astype(np.float32)
    if gain is not None:
        out *= gain
        out *= np.float32(step)
    out += np.float32(level_adu)
    return out


def _brightest(dark: PixelArray) -> IndexArray:
    """Flat indices of the pixels that stand out of the dark, the brightest where there are many."""
    sample = dark[::_SAMPLE, ::_SAMPLE].astype(np.float32)
    least = float(np.percentile(sample, 100.0 * (1.0 - _HOTTEST)))
    found = np.flatnonzero(dark.reshape(-1) > least)
    most = max(1, int(_HOTTEST * dark.size))
    if found.size <= most:
        return found
    values = dark.reshape(-1)[found]
    return np.sort(found[np.argpartition(values, -most)[-most:]])


def _is_wide(pixels: PixelArray) -> bool:
    """Whether a pixel's noise is several whole numbers, by differences of those of one colour."""
    rows = pixels[:: max(1, pixels.shape[0] // 16)].astype(np.float32)
    return float(np.median(np.abs(rows[:, 2:] - rows[:, :-2]))) >= _COARSE_ADU


def _neighbours(
    wanted: IndexArray, shape: tuple[int, ...], step: int
) -> tuple[IndexArray, IndexArray]:
    """Those of ``wanted`` with a usable pixel near, and their nearest usable ones, (n, 8).

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
