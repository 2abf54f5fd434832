"""Sky level and noise of a frame, as small maps that follow gradients, vignetting and clouds.

Means over cells of a few pixels, then a median over 5 x 5 cells: a streak or a star fills too
few of the 25 cells to lift the median. The noise comes from differences of near neighbours, so
neither gradients nor the sky's own structure enter it.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Float32Array = npt.NDArray[np.float32]

CELL_PX = 16
_TILE_CELLS = 8
_SAMPLES_PER_TILE = 1024
_CLIPPED_GAUSS_RMS = 0.9930
"""Root mean square of a unit normal cut at +-3.45 sigma."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Background:
    """Sky level and noise of one frame on a grid of cells."""

    level: Float32Array
    """(ceil(height / cell_px), ceil(width / cell_px)), ADU."""
    noise: Float32Array
    """One sigma of a single pixel, ADU, same shape; always positive."""
    cell_px: int
    width_px: int
    height_px: int

    def expand(self, small: Float32Array) -> Float32Array:
        """One of the small maps at full size (height_px, width_px), linear between cell centres."""
        return resample(small, self.cell_px, self.height_px, self.width_px)

    def at(self, small: Float32Array, x_px: float, y_px: float) -> float:
        """Value of one of the small maps in the cell that holds a pixel; edges are clamped."""
        row = min(max(int((y_px + 0.5) // self.cell_px), 0), small.shape[0] - 1)
        column = min(max(int((x_px + 0.5) // self.cell_px), 0), small.shape[1] - 1)
        return float(small[row, column])


def local_background(
    pixels: npt.NDArray[np.uint16] | Float32Array, cell_px: int = CELL_PX
) -> Background:
    """Sky level and noise of ``pixels`` (height, width), uint16 or finite float32, >= 64 px a side.

    About 20 ms for 4656 x 3520 on one core of a desktop.
    """
    height, width = pixels.shape
    level = _median_5x5(_cell_means(pixels, cell_px))
    noise = _tile_noise(pixels, cell_px * _TILE_CELLS)
    floor = max(float(np.median(noise)) * 1e-2, 1e-6)
    return Background(
        level=level,
        noise=np.maximum(_resize(noise, *level.shape), np.float32(floor)),
        cell_px=cell_px,
        width_px=width,
        height_px=height,
    )


def resample(small: Float32Array, cell: int, height: int, width: int) -> Float32Array:
    """A map of cells ``cell`` units wide as (height, width) units, linear between cell centres."""
    rows, columns = small.shape
    grown = _resize(small, rows * cell, columns * cell)
    return np.ascontiguousarray(grown[:height, :width])


def _resize(small: Float32Array, height: int, width: int) -> Float32Array:
    import cv2

    out: Float32Array = cv2.resize(small, (width, height), interpolation=cv2.INTER_LINEAR)
    return out


def _cell_means(pixels: npt.NDArray[np.uint16] | Float32Array, cell_px: int) -> Float32Array:
    """Mean of each cell; the cells of a ragged edge hold what there is of them, mirrored."""
    import cv2

    height, width = pixels.shape
    below, right = -height % cell_px, -width % cell_px
    if below or right:
        pixels = cv2.copyMakeBorder(pixels, 0, below, 0, right, cv2.BORDER_REFLECT_101)
    # Two steps: the first quarters the data before it becomes float.
    rows, columns = pixels.shape[0] // cell_px, pixels.shape[1] // cell_px
    means: Float32Array
    if pixels.dtype == np.uint16 and pixels.size > 1 << 20 and cell_px % 4 == 0:
        quarter = cv2.resize(
            pixels, (pixels.shape[1] // 4, pixels.shape[0] // 4), interpolation=cv2.INTER_AREA
        )
        pixels = quarter
    means = cv2.resize(
        pixels.astype(np.float32, copy=False), (columns, rows), interpolation=cv2.INTER_AREA
    )
    return means


def _median_5x5(cells: Float32Array) -> Float32Array:
    """Median over 5 x 5 cells, through 16 bits: OpenCV's median of 5 takes no floats."""
    import cv2

    low, high = (float(v) for v in np.percentile(cells, (0.0, 98.0)))
    # Cells brighter than most are stars: where exactly they lie cannot move a median.
    high += 0.25 * (high - low)
    step = max(high - low, 1e-6) / 65535.0
    coded = np.clip((cells - low) / step, 0.0, 65535.0).astype(np.uint16)
    # Mirrored, not repeated: a star in a corner must not count nine times.
    framed = cv2.copyMakeBorder(coded, 2, 2, 2, 2, cv2.BORDER_REFLECT_101)
    level: Float32Array = cv2.medianBlur(framed, 5)[2:-2, 2:-2].astype(np.float32)
    return level * np.float32(step) + np.float32(low)


def _tile_noise(pixels: npt.NDArray[np.uint16] | Float32Array, tile_px: int) -> Float32Array:
    """One sigma of a pixel in each tile, from clipped differences of pixels two columns apart."""
    height, width = pixels.shape
    rows, columns = max(1, height // tile_px), max(1, width // tile_px)
    tile_h, tile_w = height // rows, width // columns
    step = max(1, tile_h * (tile_w - 2) // _SAMPLES_PER_TILE)
    lines = pixels[: rows * tile_h, : columns * tile_w].reshape(rows, tile_h, columns * tile_w)
    lines = lines[:, step // 2 :: step, :].astype(np.float32)
    tiles = lines.reshape(rows, -1, columns, tile_w)
    difference = np.abs(tiles[..., 2:] - tiles[..., :-2]).transpose(0, 2, 1, 3)
    samples = difference.reshape(rows, columns, -1)
    count = samples.shape[-1]
    sorted_ = np.partition(samples, (int(count * 0.75), int(count * 0.95)), axis=-1)
    # 75 % of a normal's magnitudes lie below 1.15 sigma; coarse digitisation can make that 0.
    limit = 3.0 * np.where(
        sorted_[..., int(count * 0.75)] > 0,
        sorted_[..., int(count * 0.75)],
        sorted_[..., int(count * 0.95)],
    )
    is_kept = samples <= limit[..., None]
    total = np.where(is_kept, samples * samples, 0.0).sum(axis=-1)
    rms = np.sqrt(total / np.maximum(is_kept.sum(axis=-1), 1))
    noise: Float32Array = (rms / (np.sqrt(2.0) * _CLIPPED_GAUSS_RMS)).astype(np.float32)
    return noise
