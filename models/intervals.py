"""Exact 95 % confidence intervals of shares and rates from counts."""

from scipy.stats import beta, chi2

LEVEL = 0.95


def share_interval(hits: int, tries: int) -> tuple[float, float]:
    """Two-sided 95 % interval of a share, Clopper and Pearson 1934; (0, 1) where ``tries`` is 0."""
    if not 0 <= hits <= tries:
        raise ValueError(f"{hits} of {tries} is no share")
    tail = 0.5 * (1.0 - LEVEL)
    low = float(beta.ppf(tail, hits, tries - hits + 1)) if hits > 0 else 0.0
    high = float(beta.ppf(1.0 - tail, hits + 1, tries - hits)) if hits < tries else 1.0
    return low, high


def rate_interval(count: int, exposure: float) -> tuple[float, float]:
    """Two-sided 95 % interval of a Poisson rate per unit of ``exposure``, Garwood 1936."""
    if count < 0 or exposure <= 0.0:
        raise ValueError(f"{count} in {exposure} is no rate")
    tail = 0.5 * (1.0 - LEVEL)
    low = 0.5 * float(chi2.ppf(tail, 2 * count)) if count > 0 else 0.0
    return low / exposure, 0.5 * float(chi2.ppf(1.0 - tail, 2 * count + 2)) / exposure


def rate_upper_limit(count: int, exposure: float) -> float:
    """One-sided 95 % upper limit of a Poisson rate per unit of ``exposure``.

    3 / ``exposure`` for a count of 0.
    """
    if count < 0 or exposure <= 0.0:
        raise ValueError(f"{count} in {exposure} is no rate")
    return 0.5 * float(chi2.ppf(LEVEL, 2 * count + 2)) / exposure
