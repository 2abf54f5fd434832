"""A few points of light among many places where one may stand: which, and how bright."""

import numpy as np

from rsoconsole.records import FloatArray

_SMALLEST = 1e-9
_LEAST_DETERMINED = 1e-3
"""Of two places' own products: closer ones cannot be told apart."""


def best_pair(gram: FloatArray, projected: FloatArray) -> list[int]:
    """The two of n places, or one twice, whose lights, none of them dark, explain most.

    ``gram`` (n, n): products of the images of the places; ``projected`` (n,): with the data.
    """
    own = np.maximum(np.diag(gram), _SMALLEST)
    single = np.maximum(projected, 0.0) ** 2 / own
    det = np.maximum(own[:, None] * own - gram**2, _LEAST_DETERMINED * own[:, None] * own)
    first = (own[None] * projected[:, None] - gram * projected) / det
    gained = np.where(
        (first > 0.0) & (first.T > 0.0),
        first * projected[:, None] + first.T * projected,
        single[:, None],
    )
    return [int(at) for at in np.unravel_index(int(np.argmax(gained)), gained.shape)]
