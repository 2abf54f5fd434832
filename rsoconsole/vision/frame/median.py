"""Of a few values their median; of a few points those that stand out or lie on a line."""

import math

import numpy as np
import numpy.typing as npt

from rsoconsole.records import FloatArray
from rsoconsole.vision.arrays import BoolArray


def median_of(values: npt.ArrayLike) -> float:
    """As numpy's own of all values, to the last bit, in a tenth of its time for some hundreds.

    NaN where any value is, and of none.
    """
    flat = np.array(values).ravel()  # a copy, for it is put into order
    if flat.dtype.kind != "f":
        flat = flat.astype(np.float64)
    count = flat.size
    if count == 0:
        return math.nan
    middle = count // 2
    flat.partition((middle, count - 1) if count % 2 else (middle - 1, middle, count - 1))
    if np.isnan(flat[-1]):
        return math.nan
    if count % 2:
        return float(flat[middle])
    return float((flat[middle - 1] + flat[middle]) / flat.dtype.type(2.0))


_SMALLEST = 1e-9
_MIN_DETERMINED = 1e-3
"""Of two places' own products: closer ones cannot be told apart."""


def best_pair(gram: FloatArray, projected: FloatArray) -> list[int]:
    """The two of n places, or one twice, whose lights, none of them dark, explain most.

    ``gram`` (n, n): products of the images of the places; ``projected`` (n,): with the data.
    """
    own = np.maximum(np.diag(gram), _SMALLEST)
    single = np.maximum(projected, 0.0) ** 2 / own
    det = np.maximum(own[:, None] * own - gram**2, _MIN_DETERMINED * own[:, None] * own)
    first = (own[None] * projected[:, None] - gram * projected) / det
    gained = np.where(
        (first > 0.0) & (first.T > 0.0),
        first * projected[:, None] + first.T * projected,
        single[:, None],
    )
    return [int(at) for at in np.unravel_index(int(np.argmax(gained)), gained.shape)]


MIN_POINTS = 5
"""Of fewer it may be chance."""
MAX_POINTS = 40
"""Among more, a streak's pieces are the smaller part."""


def on_one_line(x_px: FloatArray, y_px: FloatArray, reach_px: float) -> BoolArray:
    """Which points, (n,) each, lie within ``reach_px`` of the line through two that holds most.

    None of them, where those are fewer than ``MIN_POINTS`` or not the larger part, or where
    there are more than ``MAX_POINTS``.
    """
    count = x_px.size
    none = np.zeros(count, dtype=bool)
    if not MIN_POINTS <= count <= MAX_POINTS:
        return none
    first, second = np.triu_indices(count, 1)
    dx, dy = x_px[second] - x_px[first], y_px[second] - y_px[first]
    length = np.maximum(np.hypot(dx, dy), 1e-6)
    off_x, off_y = x_px[:, None] - x_px[first], y_px[:, None] - y_px[first]
    is_on = np.abs(off_x * dy - off_y * dx) < reach_px * length
    on = is_on[:, int(np.argmax(is_on.sum(axis=0)))]
    most = np.count_nonzero(on)
    return on if most >= MIN_POINTS and 2 * most > count else none
