"""Which rows take which columns, all together: the most probable ways of it, best first. Pure."""

import heapq
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from rsoconsole.records import FloatArray

Assignment = tuple[int, ...]
"""For each row the column that it takes; the last column of all means none."""
_MOST_STEPS = 4000
"""Of the search, after which what was found by then is the answer."""


def best_assignments(
    scores: FloatArray, rivals: npt.NDArray[np.bool_], most: int
) -> list[Assignment]:
    """The ``most`` assignments with the largest sums of scores, best first, and never none at all.

    ``scores`` (T, N + 1): logarithms; minus infinity is no choice, the last column is "none" and
    may be taken by any number of rows. ``rivals`` (T, T): rows that cannot take the same column.
    Exact, but where many thousand are nearly alike: then the best are among what is returned.
    """
    first = _by_linear_assignment(scores)
    found = _searched(scores, rivals, most)
    if first not in found and not found:
        return [first]
    return found if first in found or len(found) >= most else _sorted({*found, first}, scores)


def _sorted(found: set[Assignment], scores: FloatArray) -> list[Assignment]:
    rows = np.arange(len(scores))
    return sorted(found, key=lambda each: -float(np.sum(scores[rows, list(each)])))


def _by_linear_assignment(scores: FloatArray) -> Assignment:
    """The best where every two rows are rivals."""
    from scipy.optimize import linear_sum_assignment

    count, none = len(scores), scores.shape[1] - 1
    lowest = -1e9
    own_none = np.full((count, count), lowest)
    np.fill_diagonal(own_none, scores[:, none])
    whole = np.concatenate([np.maximum(scores[:, :none], lowest), own_none], axis=1)
    _, columns = linear_sum_assignment(whole, maximize=True)
    return tuple(min(int(column), none) for column in columns)


def _searched(scores: FloatArray, rivals: npt.NDArray[np.bool_], most: int) -> list[Assignment]:
    """Best first (A*): what is left can be no better than the best of each row by itself."""
    count, none = len(scores), scores.shape[1] - 1
    choices: Sequence[list[tuple[float, int]]] = [
        sorted(((float(s), n) for n, s in enumerate(row) if np.isfinite(s)), reverse=True)
        for row in scores
    ]
    ahead = np.zeros(count + 1)
    ahead[:count] = np.cumsum(np.max(scores, axis=1)[::-1])[::-1]
    waiting: list[tuple[float, Assignment, float]] = [(-float(ahead[0]), (), 0.0)]
    found: list[Assignment] = []
    for _ in range(_MOST_STEPS):
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
