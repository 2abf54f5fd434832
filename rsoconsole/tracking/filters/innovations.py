"""Consistency of a filter: conclusions about Q and R from its innovations. Pure.

The normalised innovation squared (NIS) of a sound filter with two measured coordinates is
chi-square distributed with 2 degrees of freedom, and innovations of successive frames are
uncorrelated (Bar-Shalom, Li & Kirubarajan 2001, Estimation with Applications, 5.4.2). If the mean
NIS is too large and successive innovations have the same sign, the filter lags behind the motion (Q
is too small); if they do not, the measurements scatter more than assumed (R is too small).
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from statistics import NormalDist
from typing import Literal

NIS_BAND = (0.0506, 7.3778)
"""Bounds of 95 % of the NIS of a sound filter with two degrees of freedom."""
WINDOW = 12
MIN_UPDATES = 5
_CHANCE_TOO_LARGE = 1e-3
"""Probability that the mean of a sound filter's last NIS is called too large."""
SETTLING, ENOUGH, _TOO_SMALL = 20, 30, 1.0
"""First updates that are left out, least updates after them, and mean NIS: the filter is too wide.

A sound filter has so small a mean with a probability of 4e-4.
"""
_MAX_STEPS = 60
_ONE_SIDED = 0.5
"""Correlation of successive innovations from which they run on one side."""

Verdict = Literal["too few", "sound", "over-confident", "under-confident"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Consistency:
    """Consistency of a filter, judged by its last innovations."""

    verdict: Verdict
    mean: float | None
    """Mean of the last NIS, about 2 for a sound filter; None: no update yet."""
    count: int
    words: str


def consistency(
    nis: Sequence[float], residuals_arcsec: Sequence[tuple[float, float]] = ()
) -> Consistency:
    """Judge the consistency of a filter by its updates since its settings were last changed.

    Oldest first, for each update: ``nis``, its NIS, and ``residuals_arcsec``, its innovation (east,
    north). That NIS are too large, the last ``WINDOW`` tell; that they are too small, all that
    follow on the first ``SETTLING``.
    """
    recent = list(nis)[-WINDOW:]
    count = len(recent)
    if count < MIN_UPDATES:
        words = f"{count} of the {MIN_UPDATES} updates that it takes to judge the filter"
        mean = sum(recent) / count if count else None
        return Consistency(verdict="too few", mean=mean, count=count, words=words)
    mean = sum(recent) / count
    settled = list(nis)[SETTLING:]
    verdict: Verdict = "sound"
    low, high = mean_nis_band(count)
    words = "in band"
    if not low <= mean <= high:
        words = f"{'below' if mean < low else 'above'} the band of {low:.1f} to {high:.1f}"
    if mean > _mean_exceeded(count, _CHANCE_TOO_LARGE):
        verdict = "over-confident"
        axes = zip(*residuals_arcsec[-WINDOW:], strict=True)
        name = "Q" if any(_correlation(each) > _ONE_SIDED for each in axes) else "R"
        above = sum(value > NIS_BAND[1] for value in recent)
        what = f"{above} of the last {count} NIS above {NIS_BAND[1]:.1f}"
        if not above:
            what = f"mean NIS {mean:.1f} (ideal 2) of the last {count}"
        words = f"{name} looks too small: {what}"
    elif len(settled) >= ENOUGH and sum(settled) / len(settled) <= _TOO_SMALL:
        verdict = "under-confident"
        smaller = sum(settled) / len(settled)
        words = f"R looks too large: mean NIS {smaller:.2f} (ideal 2) of {len(settled)}"
    return Consistency(verdict=verdict, mean=mean, count=count, words=words)


@lru_cache(maxsize=256)
def mean_nis_band(count: int) -> tuple[float, float]:
    """Return the 95 % bounds of the mean of ``count`` NIS of a sound filter."""
    return _mean_exceeded(count, 0.975), _mean_exceeded(count, 0.025)


def _mean_exceeded(count: int, chance: float) -> float:
    """Value that the mean of chi-square variates of two degrees of freedom exceeds with ``chance``.

    Half their sum follows Erlang's law, a sum of Poisson terms; scipy's would weigh 18 MB in every
    console. Newton's method, begun where Wilson & Hilferty (1931) have it.
    """
    ninth = 1.0 / (9.0 * count)
    start = 1.0 - ninth + NormalDist().inv_cdf(1.0 - chance) * math.sqrt(ninth)
    half_sum = count * max(start, 0.01) ** 3
    for _ in range(_MAX_STEPS):
        log_terms = [k * math.log(half_sum) - half_sum - math.lgamma(k + 1.0) for k in range(count)]
        surplus = math.fsum(map(math.exp, log_terms)) - chance
        step = surplus / math.exp(log_terms[-1])
        half_sum = max(half_sum + step, 0.5 * half_sum)
        if abs(step) <= 1e-12 * half_sum:
            break
    return 2.0 * half_sum / count


def lag_one_correlation(innovations: Sequence[tuple[float, float]]) -> float | None:
    """Return the correlation of successive innovations, both axes together.

    ``innovations``: (east, north), each over its sigma. About 0 for a sound filter: within 2 /
    sqrt(n) in 95 % of cases. None for fewer than three.
    """
    total = math.fsum(value * value for each in innovations for value in each)
    if len(innovations) < 3 or total <= 0.0:
        return None
    share = len(innovations) / (len(innovations) - 1)
    products = (a * b for one in itertools.pairwise(innovations) for a, b in zip(*one, strict=True))
    return math.fsum(products) * share / total


def _correlation(values: Sequence[float]) -> float:
    """Correlation of successive values about zero: an innovation's mean is part of the test."""
    power = math.fsum(value * value for value in values)
    if len(values) < MIN_UPDATES or power <= 0.0:
        return 0.0
    return math.fsum(a * b for a, b in itertools.pairwise(values)) / power
