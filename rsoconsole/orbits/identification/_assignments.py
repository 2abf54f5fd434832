"""Joint assignment of rows to columns: the most probable assignments, best first. Pure."""

import heapq
import itertools
import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from rsoconsole.records import FloatArray

Assignment = tuple[int, ...]
"""Column that each row takes; the last column of all means none."""
_MAX_STEPS = 4000
"""Largest number of search steps, after which the assignments found are the answer."""
_NO_CHOICE = -1e9


def best_assignments(
    scores: FloatArray, rivals: npt.NDArray[np.bool_], most: int, within: float = np.inf
) -> list[Assignment]:
    """Find the ``most`` assignments with the largest sums of scores, best first; at least one.

    ``scores`` (T, N + 1): logarithms; minus infinity forbids a column, the last column is "none"
    and may be taken by any number of rows. ``rivals`` (T, T): True for rows that cannot take the
    same column. ``within``: largest distance of a sum below the best, applied where every two rows
    are rivals.

    Exact where every two rows are rivals (Murty 1968, Operations Research 16, 682). The search for
    all other cases is exact too unless many thousand assignments are nearly alike: then it returns
    the best of those found.
    """
    others = rivals | np.eye(len(rivals), dtype=bool)
    if np.all(others):
        return _by_murty(scores, most, within)
    return _searched(scores, rivals, most) or _by_murty(scores, 1, within)


def _by_murty(scores: FloatArray, most: int, within: float) -> list[Assignment]:
    """Best assignments by Murty's method: each answer parts the others by the number of first rows
    in which they agree with it.

    A part is solved once nothing that is left can be better than its bound: that each row takes
    the best that it may (Cox & Miller 1995, IEEE Trans. AES 31, 486).
    """
    count, none = len(scores), scores.shape[1] - 1
    whole = np.full((count, none + count), _NO_CHOICE)
    whole[:, :none] = np.maximum(scores[:, :none], _NO_CHOICE)
    whole[np.arange(count), none + np.arange(count)] = scores[:, none]
    order = itertools.count()
    first = _solved(whole)
    waiting: list[tuple[float, int, tuple[int, ...] | None, FloatArray]] = []
    if first is not None:
        waiting.append((-first[0], next(order), first[1], whole))
    found: list[Assignment] = []
    worst = math.inf if first is None else within - first[0]
    while waiting and len(found) < most and waiting[0][0] <= worst:
        minus, _, columns, allowed = heapq.heappop(waiting)
        if columns is None:
            solved = _solved(allowed)
            if solved is not None:
                # Its bound may lie below its sum by rounding alone.
                entry = (max(-solved[0], minus), next(order), solved[1], allowed)
                heapq.heappush(waiting, entry)
            continue
        found.append(tuple(min(column, none) for column in columns))
        if len(found) == most:
            break
        fixed = allowed.copy()
        for row, column in enumerate(columns):
            part = fixed.copy()
            part[row, column] = _NO_CHOICE
            best = part.max(axis=1)
            bound = max(-float(best.sum()), minus)
            if best.min() > _NO_CHOICE / 2.0 and bound <= worst:
                heapq.heappush(waiting, (bound, next(order), None, part))
            kept = fixed[row, column]
            fixed[row] = _NO_CHOICE
            fixed[row, column] = kept
    return found


def _solved(whole: FloatArray) -> tuple[float, tuple[int, ...]] | None:
    """Sum and columns of the best assignment; None where a row is left without a choice."""
    from scipy.optimize import linear_sum_assignment

    rows, columns = linear_sum_assignment(whole, maximize=True)
    values = whole[rows, columns]
    if values.min() <= _NO_CHOICE / 2.0:
        return None
    return float(values.sum()), tuple(columns.tolist())


def _searched(scores: FloatArray, rivals: npt.NDArray[np.bool_], most: int) -> list[Assignment]:
    """Best assignments first (A*): what is left can be no better than the best of each row by
    itself.
    """
    count, none = len(scores), scores.shape[1] - 1
    choices: Sequence[list[tuple[float, int]]] = [
        sorted(((float(s), n) for n, s in enumerate(row) if np.isfinite(s)), reverse=True)
        for row in scores
    ]
    ahead = np.zeros(count + 1)
    ahead[:count] = np.cumsum(np.max(scores, axis=1)[::-1])[::-1]
    waiting: list[tuple[float, Assignment, float]] = [(-float(ahead[0]), (), 0.0)]
    found: list[Assignment] = []
    for _ in range(_MAX_STEPS):
        if not waiting or len(found) == most:
            break
        _, taken, so_far = heapq.heappop(waiting)
        row = len(taken)
        if row == count:
            found.append(taken)
            continue
        blocked = {column for other, column in enumerate(taken) if rivals[row, other]}
        for score, column in choices[row]:
            if column == none or column not in blocked:
                total = so_far + score
                bound = -(total + float(ahead[row + 1]))
                heapq.heappush(waiting, (bound, (*taken, column), total))
    return found
