"""Light that flashes evenly along a line: an aircraft's lamp, and no satellite's slow tumbling."""

import numpy as np

from rsoconsole.vision.streak_beside import Axes
from rsoconsole.vision.streak_model import Line
from rsoconsole.vision.streak_search import Cutout

_BIN_PX = 2.0
_LEAST_CONTRAST = 0.5
"""Root mean square of the light about its mean, over the mean."""
_LEAST_LIKENESS = 0.5
"""Correlation of the light with itself one period on."""
_LEAST_PERIODS = 4.0


def flash_period_px(cutout: Cutout, axes: Axes, line: Line) -> float | None:
    """Distance from flash to flash along a line; None where its light does not flash evenly."""
    u, v = axes
    low, high = line.knot_range
    core = (np.abs(v - line.offset - line.slope * u) < 1.5 * line.sigma) & cutout.is_seen
    core &= (u > low) & (u < high)
    bins = ((u[core] - low) / _BIN_PX).astype(int)
    count = np.bincount(bins)
    if count.size < 8 * _LEAST_PERIODS:
        return None
    light = np.bincount(bins, cutout.values[core]) / np.maximum(count, 1)
    # A star in the way is no flash.
    light = np.minimum(light, 4.0 * np.quantile(light, 0.9))
    mean = float(np.mean(light))
    noise2 = cutout.noise**2 * float(np.mean(1.0 / np.maximum(count, 1)))
    off = light - mean
    power = float(np.mean(off**2)) - noise2
    if mean <= 0.0 or power < (_LEAST_CONTRAST * mean) ** 2:
        return None
    spectrum = np.abs(np.fft.rfft(off, 2 * off.size)) ** 2
    overlap = np.arange(off.size, 0, -1)
    likeness = np.fft.irfft(spectrum)[: off.size] / overlap / power
    longest = int(off.size / _LEAST_PERIODS)
    falls = np.flatnonzero(likeness[:longest] < 0.0)
    if falls.size == 0 or falls[0] + 2 > longest:
        return None
    later = likeness[falls[0] : longest]
    highest = float(later.max())
    if highest < _LEAST_LIKENESS:
        return None
    # Two periods on it is as like itself as one: the first such rise counts.
    first = int(np.flatnonzero(later > 0.8 * highest)[0])
    best = first + int(np.argmax(later[first : first + 4]))
    return float(falls[0] + best) * _BIN_PX
