"""Frames of stars and streaks with the wings of a real atmosphere, drawn by a law of their own.

Moffat 1969 (A&A 3, 455), evaluated at the middle of each pixel; a streak is many points in a row.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rsoconsole.records import FloatArray, PixelArray

NOISE_ADU = 20.0
LEVEL_ADU = 600.0


@dataclass(frozen=True, slots=True, kw_only=True)
class MoffatSky:
    """Stars with their light, and the widths with which they are drawn."""

    shape: tuple[int, int]
    fwhm_px: float
    beta: float
    places_px: FloatArray
    flux_adu: FloatArray

    @classmethod
    def of(cls, rng: np.random.Generator, shape: tuple[int, int] = (600, 800)) -> "MoffatSky":
        """Some hundred stars, many faint and few bright."""
        count = int(rng.uniform(60, 250))
        places = rng.uniform(0.0, 1.0, (count, 2)) * (shape[1], shape[0])
        flux = np.minimum(400.0 * rng.pareto(0.9, count) + 200.0, 4e5)
        fwhm, beta = float(rng.uniform(2.0, 4.5)), float(rng.uniform(2.8, 4.5))
        return cls(shape=shape, fwhm_px=fwhm, beta=beta, places_px=places, flux_adu=flux)

    def drawn(self, rng: np.random.Generator, *streaks: FloatArray) -> PixelArray:
        """The sky with its stars, and points (n, 3) of x, y and light, photons counted."""
        image = np.full(self.shape, NOISE_ADU**2)
        stars = np.column_stack([self.places_px, self.flux_adu])
        for x, y, flux in np.concatenate([stars, *streaks]):
            self._add(image, float(x), float(y), float(flux))
        counted = rng.poisson(image) + LEVEL_ADU - NOISE_ADU**2
        return np.clip(counted, 0, 65535).astype(np.uint16)

    def _add(self, image: FloatArray, x: float, y: float, flux: float) -> None:
        core = self.fwhm_px / 2.0 / math.sqrt(2.0 ** (1.0 / self.beta) - 1.0)
        reach = int((12.0 if flux > 500.0 else 5.0) * self.fwhm_px)
        left, top = max(round(x) - reach, 0), max(round(y) - reach, 0)
        piece = image[top : round(y) + reach + 1, left : round(x) + reach + 1]
        if round(x) + reach < 0 or round(y) + reach < 0 or not piece.size:
            return
        dy, dx = np.ogrid[: piece.shape[0], : piece.shape[1]]
        r2 = (dx + left - x) ** 2 + (dy + top - y) ** 2
        law = (self.beta - 1.0) / (math.pi * core**2) * (1.0 + r2 / core**2) ** -self.beta
        piece += flux * law


def streak_points(
    ends: tuple[float, float, float, float],
    flux_adu: float,
    light: Callable[[FloatArray], FloatArray] = np.ones_like,
) -> FloatArray:
    """Points of a streak whose light along it (0 to 1 from end a) follows ``light``."""
    x_a, y_a, x_b, y_b = ends
    count = int(3.0 * math.hypot(x_b - x_a, y_b - y_a)) + 1
    t = (np.arange(count) + 0.5) / count
    weight = light(t)
    return np.column_stack(
        [x_a + t * (x_b - x_a), y_a + t * (y_b - y_a), flux_adu * weight / weight.sum()]
    )


def flux_of_snr(snr: float, length_px: float, fwhm_px: float) -> float:
    """Light of an even streak with an integrated SNR."""
    sigma = fwhm_px / 2.3548
    return snr * NOISE_ADU * math.sqrt(length_px * 2.0 * math.sqrt(math.pi) * sigma)
