"""Frame maps: a frame reduced to the small map that the network takes, in two modes.

- fast: the frame is binned 2 x 2 where the block allows it. Every bin becomes as bright as the
  darkest of five in a row along the best direction, so that stars all but vanish and lines stay.
  The map has the brightest bin of every block, above the local background, in units of the local
  noise, graded from -2 to +14 sigma.
- paper: an 8-bit JPEG, made black and white at full size, as by Jordan et al. (arXiv 2304.06227); a
  cell is white where its block holds any white.

A cell's coordinates are continuous: cell i covers [i, i + 1), pixel x covers [x - 0.5, x + 0.5),
hence ``x_px = u * block - 0.5`` exactly, whatever the padding, which is on the right and below.
"""

from dataclasses import dataclass

import numpy as np

from rsoconsole.records import MapMode, PixelArray
from rsoconsole.vision.arrays import ByteArray, Float32Array
from rsoconsole.vision.frame.background import local_background, resample, sky_noise
from rsoconsole.vision.frame.bins import (
    CELL_PX,
    FrameBins,
    bin_frame,
    bin_side_px,
    block_maximum,
    cell_means_of_whole_blocks,
    median_5x5,
)
from rsoconsole.vision.frame.workers import CALLER_ALONE, Workers

NETWORK_WIDTH_CELLS = 608
NETWORK_HEIGHT_CELLS = 448
MAP_KIND = "lines of 5 bins"
"""Kind of map that a network for mode ``fast`` must be trained on; its card states the kind."""
LOWEST_SIGMA = -2.0
HIGHEST_SIGMA = 14.0
LINE_GAIN, LINE_SHIFT = 1.25, 1.25
"""Gain and shift that make good the loss by the darkest of five."""
CODES_PER_SIGMA = 255.0 / (HIGHEST_SIGMA - LOWEST_SIGMA)
SIDEREAL_ARCSEC_S = 15.04

_STRETCH_PER_SIGMA = 10.0
_STRETCH_BLACK = 50.0
_WHITE_SIGMA = 4.0
_JPEG_QUALITY = 95
_BLOCKS = (2, 4, 8, 16)
_FINE_BLOCK = 4
_SHORTEST_STREAK_CELLS = 12.0
_SMALLEST_MAP_CELLS = 48


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrameMap:
    """Map of one frame for the network."""

    values: ByteArray
    """(ceil(height_px / block), ceil(width_px / block)); see CODES_PER_SIGMA."""
    block: int
    """Pixels along one side of a cell."""
    mode: MapMode
    width_px: int
    height_px: int

    def to_px(self, cells: float) -> float:
        """Convert a place in the map to a column or row in raw pixels (0: centre of the first)."""
        return cells * self.block - 0.5

    def to_cells(self, px: float) -> float:
        """Convert a raw pixel's column or row to a place in the map (0: first cell's left edge)."""
        return (px + 0.5) / self.block


def choose_blocks(
    width_px: int, height_px: int, scale_arcsec_px: float | None, exposure_s: float | None
) -> tuple[int, ...]:
    """Return the blocks (side of a map's cell, px) at which to search a frame, smallest first.

    - scale and exposure known: the block for which a geostationary streak is 12 to 24 cells long,
      for example 8 for the paper's telescope, but at most the block that leaves 48 cells a side. A
      block below 4 is replaced by 4 unless its map fits the network in one piece. Beside a block
      above 4 the block 4 is searched too, for short streaks, if that map fits the network in one
      piece.
    - scale or exposure None: every block whose map fits the network in one piece and has 48 cells a
      side
    """
    short_px = min(width_px, height_px)
    fitting = [
        block for block in _BLOCKS if short_px >= _SMALLEST_MAP_CELLS * block or block == _BLOCKS[0]
    ]
    if scale_arcsec_px and exposure_s and scale_arcsec_px > 0 and exposure_s > 0:
        streak_px = SIDEREAL_ARCSEC_S * exposure_s / scale_arcsec_px
        suiting = [block for block in fitting if streak_px >= _SHORTEST_STREAK_CELLS * block]
        usual = suiting[-1] if suiting else fitting[0]
        if usual < _FINE_BLOCK and not _fits_at_once(width_px, height_px, usual):
            usual = _FINE_BLOCK
        if usual > _FINE_BLOCK in fitting and _fits_at_once(width_px, height_px, _FINE_BLOCK):
            return _FINE_BLOCK, usual
        return (usual,)
    at_once = [block for block in fitting if _fits_at_once(width_px, height_px, block)]
    return tuple(at_once) or (fitting[-1],)


def _fits_at_once(width_px: int, height_px: int, block: int) -> bool:
    return width_px <= block * NETWORK_WIDTH_CELLS and height_px <= block * NETWORK_HEIGHT_CELLS


def make_map(
    pixels: PixelArray,
    mode: MapMode,
    block: int,
    *,
    bins: FrameBins | None = None,
    noise: Float32Array | None = None,
    workers: Workers = CALLER_ALONE,
) -> FrameMap:
    """Reduce ``pixels`` (height, width), uint16 or finite float32 ADU, to the network's map.

    ``block``: pixels along the side of a cell. ``bins`` and ``noise`` (``map_noise``): those of the
    same frame; None, or bins without this block: they are computed. Raises ValueError for a block
    below 1.
    """
    if block < 1:
        raise ValueError(f"a block of {block} pixels: it must be 1 or more")
    height, width = pixels.shape
    if mode == "fast":
        values = _fast_map(pixels, block, bins, noise, workers)
    else:
        values = _paper_map(_whole_blocks(pixels, block), block)
    return FrameMap(values=values, block=block, mode=mode, width_px=width, height_px=height)


def map_noise(pixels: PixelArray, block: int, *, workers: Workers = CALLER_ALONE) -> Float32Array:
    """Measure in every cell the noise (one sigma) of the bins of a map of mode ``fast``, ADU."""
    cell_px = _cells_of(block)[1]
    shape = tuple(-(-side // cell_px) for side in pixels.shape)
    binning = bin_side_px(block)
    return sky_noise(pixels, shape, cell_px, block=block, binning=binning, workers=workers)


def _cells_of(block: int) -> tuple[int, int]:
    """Blocks along one side of a cell, and pixels."""
    blocks_per_cell = max(1, round(CELL_PX / block))
    return blocks_per_cell, blocks_per_cell * block


def _whole_blocks(pixels: PixelArray, block: int) -> PixelArray:
    """Return the frame up to whole blocks: mirrored, so that the rim has the noise of the rest."""
    import cv2

    below, right = -pixels.shape[0] % block, -pixels.shape[1] % block
    if not (below or right):
        return pixels
    out: PixelArray = cv2.copyMakeBorder(pixels, 0, below, 0, right, cv2.BORDER_REFLECT_101)
    return out


def _fast_map(
    pixels: PixelArray,
    block: int,
    bins: FrameBins | None,
    noise: Float32Array | None,
    workers: Workers,
) -> ByteArray:
    blocks_per_cell, cell_px = _cells_of(block)
    if bins is None or block not in bins.lines:
        bins = bin_frame(pixels, line_blocks=(block,), cell_px=cell_px, workers=workers)
    if noise is None:
        noise = map_noise(pixels, block, workers=workers)
    level = bins.level
    if any(-(-side // block) * block % cell_px for side in pixels.shape):
        level = median_5x5(cell_means_of_whole_blocks(pixels, bins, block))
    lines = bins.lines[block]
    # Within a block the sky does not change: it is taken away after the maximum.
    excess = lines - resample(level, blocks_per_cell, *lines.shape)
    excess *= np.float32(LINE_GAIN) / resample(noise, blocks_per_cell, *lines.shape)
    excess += np.float32(LINE_SHIFT)
    return to_map_bytes(excess)


def to_map_bytes(excess_sigma: Float32Array) -> ByteArray:
    """Convert signal to noise, in sigma, to the bytes of a ``fast`` map, clipped at both ends."""
    coded = np.rint((excess_sigma - LOWEST_SIGMA) * CODES_PER_SIGMA)
    codes: ByteArray = np.clip(coded, 0.0, 255.0).astype(np.uint8)
    return codes


def _paper_map(pixels: PixelArray, block: int) -> ByteArray:
    import cv2

    stretched = np.empty(pixels.shape, dtype=np.uint8)
    sky = local_background(pixels)
    level, gain = sky.level, np.float32(_STRETCH_PER_SIGMA) / sky.noise
    cell, width = sky.cell_px, pixels.shape[1]
    for row in range(level.shape[0]):
        strip = pixels[row * cell : (row + 1) * cell].astype(np.float32)
        strip -= np.repeat(level[row], cell)[:width]
        strip *= np.repeat(gain[row], cell)[:width]
        strip += np.float32(_STRETCH_BLACK)
        stretched[row * cell : (row + 1) * cell] = np.clip(strip, 0.0, 255.0)
    quality = [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY]
    _, compressed = cv2.imencode(".jpg", stretched, quality)
    decoded = cv2.imdecode(compressed, cv2.IMREAD_GRAYSCALE)
    white_above = _STRETCH_BLACK + _WHITE_SIGMA * _STRETCH_PER_SIGMA
    _, black_and_white = cv2.threshold(decoded, white_above, 255, cv2.THRESH_BINARY)
    reduced: ByteArray = block_maximum(black_and_white, block)
    return reduced
