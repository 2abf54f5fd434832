"""Seeds of lines: sums of cells along straight lines that exceed a threshold. Pure."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rsoconsole.vision.arrays import Float32Array

THRESHOLD, LONG_THRESHOLD = 5.0, 4.6
"""Thresholds of a short and a long partial sum to be traced, in sigma of the cells' scatter."""
_SHORTEST, _LONGEST = 2, 7
"""Smallest and largest k of lines of 2^k rows of cells."""

_LONG_ROWS = 32

_STEPS = 24.0
"""Whole numbers in one sigma: they add up twice as fast as floats."""

_MAX_STEPS = 32767 >> _LONGEST


@dataclass(frozen=True, slots=True)
class LineSeed:
    """Straight line of cells whose sum exceeds the threshold, by both of its ends in cells.

    0 is the centre of the first cell; ``rows`` counts the cells along the line.
    """

    snr: float
    rows: int
    x_a: int
    y_a: int
    x_b: int
    y_b: int

    @property
    def group_key(self) -> tuple[int, bool]:
        """Key by which seeds are grouped: number of cells, and True along a row or column.

        Bad rows and columns of the sensor are in groups of their own that way.
        """
        return self.rows, self.x_a == self.x_b or self.y_a == self.y_b


def sum_threshold_sigma(rows: int) -> float:
    """Return the threshold of a sum of ``rows`` cells, sigma; lower for long sums (few)."""
    return THRESHOLD if rows < _LONG_ROWS else LONG_THRESHOLD


def find_seeds(cells: Float32Array) -> Iterator[LineSeed]:
    """Yield the sums along straight lines in a map of signal to noise that exceed their threshold.

    ``cells``: (rows, columns), in sigma. Lines run in all directions.
    """
    steps = np.clip(np.rint(cells * np.float32(_STEPS)), -_MAX_STEPS, _MAX_STEPS)
    whole = steps.astype(np.int16)
    for is_turned in (False, True):
        for is_flipped in (False, True):
            table = whole.T if is_turned else whole
            last = table.shape[1] - 1
            table = np.ascontiguousarray(table[:, ::-1] if is_flipped else table)
            for snr, row, x, rows, shift in _sums_that_stand_out(table):
                x_a, x_b = (last - x, last - x - shift) if is_flipped else (x, x + shift)
                y_a, y_b = row, row + rows - 1
                ends = (y_a, x_a, y_b, x_b) if is_turned else (x_a, y_a, x_b, y_b)
                yield LineSeed(snr, rows, *ends)


def _sums_that_stand_out(
    table: npt.NDArray[np.int16],
) -> Iterator[tuple[float, int, int, int, int]]:
    """Yield (snr, first row, first column, rows, right shift) of lines no flatter than 45 deg."""
    height, width = table.shape
    # Part j, shift s, column x: the line from row j * rows, column x, to s columns further right.
    sums = table[:, None, :]
    for level in range(1, _LONGEST + 1):
        rows = 1 << level
        parts = height // rows
        if parts == 0:
            return
        longer = np.empty((parts, rows, width), dtype=table.dtype)
        upper, lower = sums[: 2 * parts : 2], sums[1 : 2 * parts : 2]
        for shift in range(min(rows, width)):
            first, second = shift // 2, (shift + 1) // 2
            inside = width - second
            np.add(
                upper[:, first, :inside], lower[:, first, second:], out=longer[:, shift, :inside]
            )
            longer[:, shift, inside:] = upper[:, first, inside:]
        longer[:, width:] = 0
        sums = longer
        if level >= _SHORTEST:
            yield from _maxima(sums, rows, sum_threshold_sigma(rows) * _STEPS)


def _maxima(
    sums: npt.NDArray[np.int16], rows: int, threshold: float
) -> Iterator[tuple[float, int, int, int, int]]:
    """Yield the best line of every part and every block of columns, above a threshold in steps."""
    parts, _, width = sums.shape
    step = max(rows // 2, 4)
    best = sums.max(axis=1)
    spare = -width % step
    if spare:
        best = np.pad(best, ((0, 0), (0, spare)), constant_values=0)
    highest = best.reshape(parts, -1, step).max(axis=2)
    limit = threshold * math.sqrt(rows)
    for part, tile in np.argwhere(highest > limit).tolist():
        window = sums[part, :, tile * step : (tile + 1) * step]
        shift, x = divmod(int(np.argmax(window)), window.shape[1])
        snr = float(window[shift, x]) / math.sqrt(rows) / _STEPS
        yield snr, part * rows, tile * step + x, rows, shift
