"""Seeds of lines: sums of cells along straight lines that exceed a threshold. Pure."""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rsoconsole.records import FloatArray
from rsoconsole.vision.arrays import Float32Array, IndexArray

THRESHOLD, LONG_THRESHOLD = 5.0, 4.6
"""Thresholds of a short and a long partial sum to be traced, in sigma of the cells' scatter."""
_SHORTEST, _LONGEST = 2, 7
"""Smallest and largest k of lines of 2^k rows of cells."""

_LONG_ROWS = 32

_STEPS = 24.0
"""Whole numbers in one sigma: they add up twice as fast as floats."""

_MAX_STEPS = 32767 >> _LONGEST


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LineSeeds:
    """Straight lines of cells whose sums exceed their threshold."""

    rows: IndexArray
    """(n,) numbers of cells along them."""
    snr: FloatArray
    """(n,) sums over their noise."""
    ends: IndexArray
    """(n, 4) first and last cell: x_a, y_a, x_b, y_b; 0 is the centre of the first cell."""


def sum_threshold_sigma(rows: int) -> float:
    """Return the threshold of a sum of ``rows`` cells, sigma; lower for long sums (few)."""
    return THRESHOLD if rows < _LONG_ROWS else LONG_THRESHOLD


def find_seeds(cells: Float32Array) -> LineSeeds:
    """Return the sums along straight lines in a map of signal to noise that exceed their threshold.

    ``cells``: (rows, columns), in sigma. Lines run in all directions.
    """
    steps = cells * np.float32(_STEPS)
    np.clip(np.rint(steps, out=steps), -_MAX_STEPS, _MAX_STEPS, out=steps)
    whole = steps.astype(np.int16)
    found = []
    for turned, order in ((whole, [1, 0, 3, 2]), (np.ascontiguousarray(whole.T), [0, 1, 2, 3])):
        for is_flipped in (False, True):
            rows, snr, ends = _sums_that_stand_out(turned[:, ::-1] if is_flipped else turned)
            if is_flipped:
                ends[:, 1::2] = turned.shape[1] - 1 - ends[:, 1::2]
            found.append((rows, snr, ends[:, order]))
    rows, snr, ends = (np.concatenate(each) for each in zip(*found, strict=True))
    return LineSeeds(rows=rows, snr=snr, ends=ends)


def _sums_that_stand_out(
    table: npt.NDArray[np.int16],
) -> tuple[IndexArray, FloatArray, IndexArray]:
    """Return the best lines to the right, no flatter than 45 deg.

    Their numbers of rows, SNR, and ends (n, 4), each as row and column.
    """
    height, width = table.shape
    # Zeros where lines leave the table to the right.
    wide, step = width + (1 << _LONGEST - 1), table.itemsize
    sums, longer = np.zeros((2, height, wide), dtype=table.dtype)
    sums[:, :width] = table
    found: list[tuple[IndexArray, ...]] = [(np.empty(0, np.intp),) * 5]
    # Part j, shift s, column x: the line from row j * rows, column x, to s columns further right.
    for level in range(1, _LONGEST + 1):
        rows = 1 << level
        half, parts = rows // 2, height // rows
        if parts == 0:
            break
        height = parts * rows
        upper = sums[:height].reshape(parts, 2, half, 1, wide)[:, 0, ..., :width]
        # A line's halves have half of its shift; the lower begins there, or a column further right.
        lower = np.ndarray(
            (parts, half, 2, width),
            sums.dtype,
            sums,
            half * wide * step,
            (rows * wide * step, (wide + 1) * step, step, step),
        )
        longer = longer[:height].reshape(parts, half, 2, wide)
        np.add(upper, lower, out=longer[..., :width])
        longer = longer.reshape(parts, rows, wide)
        longer[:, width:] = 0
        if level >= _SHORTEST:
            highest = longer.max(axis=1)
            limit = int(sum_threshold_sigma(rows) * _STEPS * math.sqrt(rows))
            part, x = np.divmod(np.flatnonzero(highest > limit), wide)
            shift = longer[part, :, x].argmax(axis=1)
            found.append((np.full(part.size, rows), part * rows, x, shift, highest[part, x]))
        sums, longer = longer.reshape(height, wide), sums
    count, row, x, shift, value = (np.concatenate(each) for each in zip(*found, strict=True))
    # The best of every part and every block of columns.
    block = x // np.maximum(count // 2, 4)
    order = np.lexsort((shift, -value, block, row, count))
    place = np.stack([count, row, block])[:, order]
    is_best = np.append(True, (place[:, 1:] != place[:, :-1]).any(axis=0))[: order.size]
    best = order[is_best]
    count, row, x, shift = count[best], row[best], x[best], shift[best]
    snr = value[best] / (_STEPS * np.sqrt(count))
    return count, snr, np.stack([row, x, row + count - 1, x + shift], axis=1)
