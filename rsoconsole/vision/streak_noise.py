"""How much brighter pixels are noisier: photons, a flickering source, stars not quite our disc."""

from dataclasses import dataclass

import numpy as np

from rsoconsole.records import FloatArray

GLARE_ERROR = 0.12
"""Share of a star's light, pixel by pixel, that our disc of a star gets wrong."""
_WIDTH_PIXELS = 5.9
"""Pixels that count in one width of a line of unit sigma."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SourceNoise:
    """Variance that a streak's own light adds."""

    excess: float
    """ADU^2 per ADU: photons, and a blur unlike ours."""
    unsteady: float
    """ADU^2 per ADU^2: how much its light flickers along the line."""

    def flicker(self, sigma: float) -> float:
        """Share by which the light changes from one width of the seeing to the next."""
        return float(np.sqrt(self.unsteady / _WIDTH_PIXELS) / sigma)


NO_SOURCE_NOISE = SourceNoise(excess=0.0, unsteady=0.0)


def variance_of(
    plain: FloatArray, light: FloatArray, glare: FloatArray, noise: SourceNoise
) -> FloatArray:
    """``plain`` and what the streak's own light adds, and how badly a star is known."""
    glare_error = GLARE_ERROR * glare
    lit = np.maximum(light, 0.0)
    return plain + (noise.excess + noise.unsteady * lit) * lit + glare_error * glare_error


def excess_of(
    residual: FloatArray, plain: FloatArray, light: FloatArray, glare: FloatArray
) -> float:
    """Variance per ADU of the source, from the residuals away from stars; never negative.

    Residuals beyond four sigma are cut back: what stands in the way is no noise.
    """
    source = np.where(glare < 0.3 * light, np.maximum(light, 0.0), 0.0)
    total = float(source @ source)
    if total <= 0.0:
        return 0.0
    squared, typical = residual**2, 0.2 * float(np.sqrt(plain.min()))
    excess = 0.0
    for _ in range(2):
        limit = 16.0 * (plain + max(excess, typical) * source)
        excess = max(0.0, float(source @ (np.minimum(squared, limit) - plain)) / total)
    return excess


def unsteady_of(
    residual: FloatArray,
    light: FloatArray,
    along: FloatArray,
    *,
    sigma: float,
    pixel_variance: float,
) -> float:
    """Variance per ADU^2 of the source that its changes over one width of the seeing make.

    Tumbling, scintillation and a wavering mount move light along the line: each stretch of one
    width is off by a share of its own. Written as noise of each pixel, as the fits take it.
    ``along``: place of each pixel of the line's inside, from 0.
    """
    if along.size == 0:
        return 0.0
    bins = (along / (2.36 * sigma)).astype(int)
    power = np.bincount(bins, light * light)
    is_full = power > 0.5 * np.max(power)
    power = power[is_full]
    share = np.bincount(bins, light * residual)[is_full] / power
    squared = np.sort(share**2 - pixel_variance / power)
    if squared.size < 5:
        return 0.0
    kept = squared[: -max(1, squared.size // 10)]
    return _WIDTH_PIXELS * sigma**2 * max(0.0, float(np.mean(kept)))
