"""Points that lie on one line: the pieces of a streak, where few stars shine beside them."""

import numpy as np
import numpy.typing as npt

from rsoconsole.records import FloatArray

FEWEST_POINTS = 5
"""Of fewer it may be chance."""
MOST_POINTS = 40
"""Among more, a streak's pieces are the smaller part."""


def on_one_line(x_px: FloatArray, y_px: FloatArray, reach_px: float) -> npt.NDArray[np.bool_]:
    """Which points, (n,) each, lie within ``reach_px`` of the line through two that holds most.

    None of them, where those are fewer than ``FEWEST_POINTS`` or not the larger part, or where
    there are more than ``MOST_POINTS``.
    """
    count = x_px.size
    none = np.zeros(count, dtype=bool)
    if not FEWEST_POINTS <= count <= MOST_POINTS:
        return none
    first, second = np.triu_indices(count, 1)
    dx, dy = x_px[second] - x_px[first], y_px[second] - y_px[first]
    length = np.maximum(np.hypot(dx, dy), 1e-6)
    off_x, off_y = x_px[:, None] - x_px[first], y_px[:, None] - y_px[first]
    is_on = np.abs(off_x * dy - off_y * dx) < reach_px * length
    on = is_on[:, int(np.argmax(is_on.sum(axis=0)))]
    most = np.count_nonzero(on)
    return on if most >= FEWEST_POINTS and 2 * most > count else none
