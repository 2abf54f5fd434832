"""Pairs of the same star in two lists: each other's nearest, each star in one pair at most.

Pure: distances or places in, indices out; and how the light of such pairs compares.
"""

import math
from dataclasses import dataclass

import numpy as np

from rsoconsole.records import FloatArray
from rsoconsole.vision.arrays import IndexArray
from rsoconsole.vision.frame.median import median_of, quantiles_of

MIN_MATCHED = 6
_MAX_OFF = 0.5
"""Largest common shift of all stars, in star widths."""
_MAX_SCATTER = 0.5
"""Largest distance of the quartiles of the ratios of light over their median."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StarComparison:
    """Places and light of the stars that two lists have in common, compared."""

    flux_ratio: float
    """Median of the second list's light over the first's."""
    is_good: bool
    """True where the lists agree on places, and on one ratio of light all over the field."""


def mutual_nearest(distance: FloatArray, within: float) -> tuple[IndexArray, IndexArray]:
    """Rows and columns of the pairs that are each other's nearest, within a limit.

    ``distance``: (n, m) distances or their squares, without NaN; ``within``: the limit in the same
    unit.
    """
    nearest, rows = distance.argmin(axis=1), np.arange(len(distance))
    is_pair = (distance.argmin(axis=0)[nearest] == rows) & (distance[rows, nearest] <= within)
    return rows[is_pair], nearest[is_pair]


def squared_distances(one_px: FloatArray, other_px: FloatArray) -> FloatArray:
    """(n, m) squared distances of places (n, 2) and (m, 2); infinite for a place that is NaN."""
    (x, y), (other_x, other_y) = (np.where(np.isnan(p), np.inf, p).T for p in (one_px, -other_px))
    distance2 = np.asarray(np.add.outer(x, other_x) ** 2)
    distance2 += np.add.outer(y, other_y) ** 2
    return distance2


def match_stars(
    one_px: FloatArray, other_px: FloatArray, reach_px: float
) -> tuple[IndexArray, IndexArray]:
    """Indices of the pairs of places that are each other's nearest and within ``reach_px``.

    Places (n, 2) and (m, 2), px; one array of indices into each. Places that are NaN match none.
    """
    if not len(one_px) or not len(other_px):
        return np.zeros(0, dtype=np.intp), np.zeros(0, dtype=np.intp)
    return mutual_nearest(squared_distances(one_px, other_px), reach_px**2)


def compare_stars(
    one_px: FloatArray,
    one_adu: FloatArray,
    other_px: FloatArray,
    other_adu: FloatArray,
    fwhm: float,
) -> StarComparison | None:
    """Compare places and light of two frames' stars; None where too few are in both.

    Places (n, 2) and (m, 2) in pixels of one frame, light (n,) and (m,) in ADU, ``fwhm`` in px.
    """
    i, j = match_stars(one_px, other_px, max(1.5 * fwhm, 2.0))
    if len(i) < MIN_MATCHED:
        return None
    ratio = other_adu[j] / one_adu[i]
    low, middle, high = quantiles_of(ratio, (0.25, 0.5, 0.75))
    off_px = math.hypot(*map(median_of, (other_px[j] - one_px[i]).T))
    is_good = middle > 0.0 and off_px < _MAX_OFF * fwhm and high - low < _MAX_SCATTER * middle
    return StarComparison(flux_ratio=middle, is_good=is_good)
