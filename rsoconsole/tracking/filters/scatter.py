"""What a bank of filters tells of the shutter's scatter, as an interval. Pure."""

import numpy as np

from rsoconsole.tracking.filters.bank import Bank

_TEMPERED = 0.65
"""The likelihood is too sharp, as no motion is quite what is followed: power that makes intervals
hold as often as they say (measured on SGP4's orbits)."""


def scatter_interval_s(bank: Bank, share: float = 0.9) -> tuple[float, float, float]:
    """Median and both ends of the interval that holds so much of what is believed of the scatter.

    The weights are densities on a logarithmic scale: a parabola through the three likeliest,
    straight lines where the likeliest is at an end.
    """
    log_s, each = np.log(bank.grid.scatters_s), bank.scatter_probabilities
    fine = np.linspace(log_s[0], log_s[-1], 40 * (len(log_s) - 1) + 1)
    logs, best = np.log(np.maximum(each, 1e-30)), int(np.argmax(each))
    fitted = np.interp(fine, log_s, logs)
    if 0 < best < len(log_s) - 1:
        before, after = log_s[best - 1] - log_s[best], log_s[best + 1] - log_s[best]
        down, up = (logs[best - 1] - logs[best]) / before, (logs[best + 1] - logs[best]) / after
        bend = (up - down) / (after - before)
        off = fine - log_s[best]
        fitted = logs[best] + off * (down - bend * before + bend * off)
    density = np.exp(_TEMPERED * (fitted - fitted.max()))
    summed = np.cumsum(density)
    summed = summed / summed[-1]
    cuts = [0.5, 0.5 - share / 2.0, 0.5 + share / 2.0]
    median, low, high = np.exp(np.interp(cuts, summed, fine))
    # At the known scatter the likelihood is flat towards none.
    return float(median), 0.0 if each[0] > 0.05 else float(low), float(high)
