"""Stars of one list that are those of another, and what their light says of the two."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rsoconsole.records import FloatArray

IntArray = npt.NDArray[np.intp]

FEWEST_MATCHED = 6
_MOST_OFF = 0.5
"""Widths of a star by which all stars may be off in common."""
_MOST_SCATTER = 0.5
"""Distance of the quartiles of the ratios of light over their median: more is cloud in parts."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StarAgreement:
    """How two lists of the same stars compare."""

    flux_ratio: float
    """Median of the second's light over the first's."""
    is_good: bool
    """Whether they agree on places, and on one ratio of light all over the field."""


def matched(one_px: FloatArray, other_px: FloatArray, reach_px: float) -> tuple[IntArray, IntArray]:
    """Indices into (n, 2) and (m, 2) places of those that are nearest to each other."""
    nothing = np.zeros(0, dtype=np.intp)
    if not len(one_px) or not len(other_px):
        return nothing, nothing
    apart = np.hypot(*(one_px[:, None] - other_px[None]).transpose(2, 0, 1))
    apart = np.where(np.isfinite(apart), apart, np.inf)
    nearest = np.argmin(apart, axis=1)
    index = np.arange(len(one_px))
    is_mutual = np.argmin(apart, axis=0)[nearest] == index
    kept = np.flatnonzero(is_mutual & (apart[index, nearest] < reach_px))
    return kept, nearest[kept]


def agreement(
    one_px: FloatArray,
    one_adu: FloatArray,
    other_px: FloatArray,
    other_adu: FloatArray,
    fwhm: float,
) -> StarAgreement | None:
    """Of places (n, 2) in pixels of one frame and light (n,); None where too few are the same."""
    i, j = matched(one_px, other_px, max(1.5 * fwhm, 2.0))
    if len(i) < FEWEST_MATCHED:
        return None
    ratio = other_adu[j] / one_adu[i]
    low, middle, high = (float(each) for each in np.percentile(ratio, (25.0, 50.0, 75.0)))
    off_px = float(np.hypot(*np.median(other_px[j] - one_px[i], axis=0)))
    is_good = middle > 0.0 and off_px < _MOST_OFF * fwhm and high - low < _MOST_SCATTER * middle
    return StarAgreement(flux_ratio=middle, is_good=is_good)
