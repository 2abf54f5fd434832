"""Offsets of rows and columns by the electronics: found, and subtracted where they exist.

The offset of a row shows in the excess of each of its pixels over the mean of the pixels above and
below. A first value is the median of these excesses along the row, which stars and streaks hardly
move, since they fill little of it; the mean of the excesses near that value refines it, however
coarse the converter's steps. A streak along one row for more than half of the frame would be taken
for an offset.
"""

from dataclasses import dataclass

import numpy as np

from rsoconsole.records import PixelArray
from rsoconsole.vision.arrays import Float32Array

SEEN_SIGMA = 0.15
"""Standard deviation of the offsets, over a pixel's noise, from which they are subtracted."""
_ABOUT = 65
"""Number of lines whose mean is the sky of the one in their middle."""
_BANDS, _BAND, _GLANCE_BAND = 4, 64, 18
_GLANCE, _FULL = 160, 1500
"""Least number of samples of a line for a first look and for its offset."""
_NEAR = 2.5
"""Sigmas of a pixel about the median within which the mean is taken."""
_FAR, _SOME = 4.0, 200
_MEDIAN_STEP = 3
_NOISE_LINES, _GLANCE_LINES = 32, 4
_SURELY_NONE = 0.5
"""Share of ``SEEN_SIGMA`` below which a glance at a few lines settles that there is no pattern."""
_MAD_TO_SIGMA = 1.4826
_COARSE_ADU = 5.0
"""Noise below which whole numbers would spoil the frame, ADU."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RowColumnPattern:
    """Offsets of rows and columns in ADU, their mean about 0."""

    rows: Float32Array | None
    """(height,) offsets of the rows; None where none is seen."""
    columns: Float32Array | None
    """(width,) offsets of the columns; None where none is seen."""
    noise_adu: float
    """One sigma of a pixel without the offsets, ADU."""

    def removed(self, pixels: PixelArray) -> PixelArray:
        """Return the pixels without the offsets.

        A uint16 frame remains uint16 where its noise is at least 5 ADU; all others become
        float32.
        """
        out = pixels.astype(np.float32)
        if self.rows is not None:
            out -= self.rows[:, None]
        if self.columns is not None:
            out -= self.columns
        if pixels.dtype != np.uint16 or self.noise_adu < _COARSE_ADU:
            return out
        np.rint(out, out=out)
        np.clip(out, 0.0, 65535.0, out=out)
        return out.astype(np.uint16)


def find_row_column_pattern(pixels: PixelArray) -> RowColumnPattern | None:
    """Find row and column offsets of ``pixels`` (height, width), uint16 or finite float32.

    None where they scatter by less than ``SEEN_SIGMA`` of a pixel's noise: a glance at a few lines
    shows most frames to have none, within 1 ms for 4656 x 3520.
    """
    both = pixels, pixels.T
    noise, limit = _noise(pixels, _GLANCE_LINES), _SURELY_NONE * SEEN_SIGMA
    if not any(_is_striped(each, noise, _GLANCE_BAND, limit) for each in both):
        return None
    noise = _noise(pixels, _NOISE_LINES)
    if noise <= 0.0:
        return None
    has_rows, has_columns = (_is_striped(each, noise, _BAND, SEEN_SIGMA) for each in both)
    if not (has_rows or has_columns):
        return None
    columns = _offsets(pixels.T, noise) if has_columns else None
    rows = _offsets(pixels, noise, columns) if has_rows else None
    return RowColumnPattern(rows=rows, columns=columns, noise_adu=noise)


def _noise(pixels: PixelArray, lines_wanted: int) -> float:
    """One sigma of a pixel by differences of differences, in which no line's offset is left."""
    step = max(3, pixels.shape[0] // lines_wanted)
    lines, below = (pixels[first::step, ::2].astype(np.float32) for first in (0, 2))
    steps = lines[: len(below)] - below
    off = np.abs(steps[:, 1:] - steps[:, :-1])
    # No median alone: of a converter's coarse steps it is a whole number.
    limit = _FAR * max(_MAD_TO_SIGMA * float(np.median(off)), _step_of(off))
    for _ in range(2):
        near = off[off <= limit]
        spread = float(np.sqrt(np.mean(np.square(near)))) if near.size else 0.0
        limit = _FAR * spread
    return spread / 2.0


def _step_of(off: Float32Array) -> float:
    """Least difference above 0; 0 where there is none."""
    some = off[:, : min(off.shape[1], _SOME)]
    above = some[some > 0.0]
    return float(above.min()) if above.size else 0.0


def _is_striped(pixels: PixelArray, noise: float, lines: int, seen_sigma: float) -> bool:
    """True where lines (axis 0) differ from their neighbours by more than their noise.

    ``lines``: number of them in each band. ``seen_sigma``: least offset by a pixel's noise.
    """
    height, width = pixels.shape
    step = max(1, width // _GLANCE) | 1
    first = (2 * np.arange(_BANDS) + 1) * height // (2 * _BANDS) - lines // 2
    rows = np.clip(first[:, None] + np.arange(lines - 2), 0, height - 3).ravel()
    # Against the next but one: no slope of the sky is in it, nor a mosaic's colours.
    line, next_but_one = (pixels[at, ::step].astype(np.float32) for at in (rows, rows + 2))
    between = next_but_one - line
    middle = np.median(between, axis=1, keepdims=True)
    steps = middle[:, 0] + _mean_of_near(between - middle, _FAR * noise)
    by_band = steps.reshape(_BANDS, -1)
    off = np.abs(by_band - np.median(by_band, axis=1, keepdims=True))
    spread = _MAD_TO_SIGMA * float(np.median(off)) / float(np.sqrt(2.0))
    by_chance = noise / float(np.sqrt(-(-width // step)))
    return spread**2 - by_chance**2 > (seen_sigma * noise) ** 2


def _offsets(pixels: PixelArray, noise: float, across: Float32Array | None = None) -> Float32Array:
    """Offset of each line (axis 0), ADU; ``across``: those of the other axis, subtracted first."""
    import cv2

    # An odd step: both colours of a mosaic's line.
    step = max(1, pixels.shape[1] // _FULL) | 1
    sample = pixels[:, ::step].astype(np.float32)
    if across is not None:
        sample -= across[::step]
    # Each place against those above and below it: no slope of the sky is left along the line.
    sample -= cv2.blur(sample, (1, _ABOUT), borderType=cv2.BORDER_REFLECT_101)
    about = np.median(sample[:, ::_MEDIAN_STEP], axis=1).astype(np.float32)
    sample -= about[:, None]
    above = about + _mean_of_near(sample, _NEAR * noise)
    # What the lines about each one have themselves, on the whole.
    about_each = cv2.blur(above[:, None], (1, _ABOUT), borderType=cv2.BORDER_REFLECT_101)[:, 0]
    return np.asarray(above + about_each, dtype=np.float32)


def _mean_of_near(about: Float32Array, limit: float) -> Float32Array:
    """Mean along each line of the values within ``limit`` of 0; ``about`` is overwritten."""
    is_near = np.abs(about) <= np.float32(limit)
    about *= is_near
    near = np.maximum(np.count_nonzero(is_near, axis=1), 1)
    return np.asarray(about.sum(axis=1) / near, dtype=np.float32)
