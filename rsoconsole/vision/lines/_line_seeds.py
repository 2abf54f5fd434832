"""Seeds of lines: sums of cells along straight lines that exceed a threshold. Pure."""

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from rsoconsole.records import FloatArray
from rsoconsole.vision.arrays import Float32Array, IndexArray
from rsoconsole.vision.frame.workers import CALLER_ALONE, Workers

THRESHOLD = 4.5
"""Threshold of a partial sum, in sigma of the sums of its length."""
_SHORTEST, _LONGEST, _STRADDLED = 3, 8, 4
"""Smallest and largest k of lines of 2^k rows of cells; from which parts straddle the others."""
_STEPS = 24.0
"""Whole numbers in one sigma: they add up twice as fast as floats."""
_MAX_STEPS = 32767 >> _LONGEST
_PER_DEVIATION = 1.2533
"""Sigma of a normal law over its mean deviation."""

_Table = npt.NDArray[np.int16]


def find_seeds(
    cells: Float32Array, workers: Workers = CALLER_ALONE
) -> tuple[FloatArray, FloatArray]:
    """Find the sums along straight lines in a map of signal to noise that exceed the threshold.

    ``cells``: (rows, columns), in sigma. Lines run in all directions. Returns their ends (n, 4:
    x_a, y_a, x_b, y_b; 0 is the centre of the first cell) and the sums over their noise (n,).
    """
    steps = cells * np.float32(_STEPS)
    np.clip(np.rint(steps, out=steps), -_MAX_STEPS, _MAX_STEPS, out=steps)
    whole = steps.astype(np.int16)
    turned = (whole, [1, 0, 3, 2]), (np.ascontiguousarray(whole.T), [0, 1, 2, 3])
    found: dict[int, tuple[FloatArray, FloatArray]] = {}

    def look(ways: Iterator[int]) -> None:
        for way in ways:
            table, order = turned[way // 2]
            is_flipped = way % 2 == 1
            ends, snr = _sums_that_stand_out(table[:, ::-1] if is_flipped else table)
            if is_flipped:
                ends[:, 1::2] = table.shape[1] - 1 - ends[:, 1::2]
            found[way] = ends[:, order].astype(np.float64), snr

    workers.share(look, 4)
    ends, snr = zip(*(found[way] for way in range(4)), strict=True)
    return np.concatenate(ends), np.concatenate(snr)


def _sums_that_stand_out(table: _Table) -> tuple[IndexArray, FloatArray]:
    """Return the best lines to the right, no flatter than 45 deg.

    Their ends (n, 4), each as row and column, and their SNR.
    """
    height, width = table.shape
    # Zeros where lines leave the table below and to the right.
    tall = -(-height >> _LONGEST) << _LONGEST
    wide = width + (1 << _LONGEST - 1)
    sums, longer = np.zeros((2, tall, wide), dtype=np.int16)
    sums[:height, :width] = table
    found: list[tuple[IndexArray | FloatArray, ...]] = []
    # Part j, shift s, column x: the line from row j * rows, column x, to s columns further right.
    for level in range(1, _LONGEST + 1):
        rows = 1 << level
        if level >= _STRADDLED and tall > rows:
            # Lines that begin in the middle of a part.
            between = sums[rows // 2 : tall - rows // 2]
            found.append(_best(_joined(between, rows, width, longer), rows, rows // 2))
        parts = _joined(sums, rows, width, longer)
        if level >= _SHORTEST:
            found.append(_best(parts, rows, 0))
        sums, longer = parts.reshape(tall, wide), sums
    count, row, x, shift, snr = (np.concatenate(each) for each in zip(*found, strict=True))
    return np.stack([row, x, row + count - 1, x + shift], axis=1), snr


def _joined(sums: _Table, rows: int, width: int, out: _Table) -> _Table:
    """Join sums of half as many rows: (parts * rows, wide) to (parts, rows, wide).

    A line's halves have half of its shift; the lower begins there, or a column further right.
    """
    height, wide = sums.shape
    half, parts, step = rows // 2, height // rows, sums.itemsize
    upper = sums.reshape(parts, 2, half, 1, wide)[:, 0, ..., :width]
    lower = np.lib.stride_tricks.as_strided(
        sums[half:], (parts, half, 2, width), (rows * wide * step, (wide + 1) * step, step, step)
    )
    longer = out[:height].reshape(parts, half, 2, wide)
    np.add(upper, lower, out=longer[..., :width])
    joined = longer.reshape(parts, rows, wide)
    joined[:, :, width:] = 0
    return joined


def _best(parts: _Table, rows: int, first: int) -> tuple[IndexArray | FloatArray, ...]:
    """Return the best sum above the threshold of every part and block of columns.

    Numbers of rows, first row and column, shift, and SNR.
    """
    wide = parts.shape[2]
    sample = parts[:, :: max(rows // 8, 1), ::5]
    sample = sample[sample != 0]
    sigma = max(_PER_DEVIATION * float(np.abs(sample).mean()) if sample.size else 1.0, 1.0)
    highest = parts.max(axis=1)
    part, x = np.divmod(np.flatnonzero(highest > THRESHOLD * sigma), wide)
    shift = parts[part, :, x].argmax(axis=1)
    snr = highest[part, x] / sigma
    # Of both neighbouring lines and neighbouring directions the best.
    block, turn = x // max(rows // 4, 3), shift // max(rows // 4, 3)
    order = np.lexsort((-snr, turn, block, part))
    place = np.stack([part, block, turn])[:, order]
    is_best = np.append(True, (place[:, 1:] != place[:, :-1]).any(axis=0))[: order.size]
    best = order[is_best]
    part, x, shift, snr = part[best], x[best], shift[best], snr[best]
    return np.full(part.size, rows), first + part * rows, x, shift, snr
