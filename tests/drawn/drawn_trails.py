"""Frames with the mount on a satellite's motion: stars are trails, satellites points.

Drawn by Moffat's law as in ``drawn_moffat``; the sensor has hot pixels, which stay in place.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from rsoconsole.records import FloatArray, PixelArray
from tests.drawn.drawn_moffat import NOISE_ADU, MoffatSky, streak_points

SHAPE = (640, 800)
FWHM_PX, BETA = 2.7, 4.0


def point_flux(snr: float, fwhm_px: float = FWHM_PX) -> float:
    """Light of a point with a matched SNR, for a Gaussian of the same width."""
    return snr * NOISE_ADU * 2.0 * math.sqrt(math.pi) * fwhm_px / 2.3548


@dataclass
class TrailedSky:
    """Stars that pass over a sensor with hot pixels, and points that stay."""

    rng: np.random.Generator
    stars: int = 70
    length_px: float = 100.0
    angle_deg: float = 0.0
    hot_pixels: int = 60
    fwhm_px: float = FWHM_PX
    star_places: FloatArray = field(init=False)
    star_flux: FloatArray = field(init=False)
    hot: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        span = np.array([SHAPE[1], SHAPE[0]])
        # Far beyond the frame, too: stars drift into it.
        self.star_places = self.rng.uniform(-1.0, 2.0, (9 * self.stars, 2)) * span
        light = 8e3 * (1.0 + self.rng.pareto(0.9, 9 * self.stars))
        self.star_flux = np.minimum(light, 6e5)
        places = self.rng.integers(5, (SHAPE[1] - 5, SHAPE[0] - 5), (self.hot_pixels, 2))
        height = 10.0 ** self.rng.uniform(2.0, 4.3, self.hot_pixels)
        self.hot = np.column_stack([places, height])

    def frame(self, points: FloatArray, drift_px: float = 0.0) -> PixelArray:
        """The sensor with points (n, 3) of x, y and light, stars ``drift_px`` farther on."""
        c, s = math.cos(math.radians(self.angle_deg)), math.sin(math.radians(self.angle_deg))
        half = 0.5 * self.length_px
        trails = [
            streak_points((x - half * c, y - half * s, x + half * c, y + half * s), float(flux))
            for (x, y), flux in zip(
                self.star_places + drift_px * np.array([c, s]), self.star_flux, strict=True
            )
            if -half < x < SHAPE[1] + half and -half < y < SHAPE[0] + half
        ]
        sky = MoffatSky(
            shape=SHAPE,
            fwhm_px=self.fwhm_px,
            beta=BETA,
            places_px=np.zeros((0, 2)),
            flux_adu=np.zeros(0),
        )
        pixels = sky.drawn(self.rng, points, *trails).astype(np.int64)
        columns, rows = self.hot[:, 0].astype(int), self.hot[:, 1].astype(int)
        pixels[rows, columns] += self.hot[:, 2].astype(int)
        return np.clip(pixels, 0, 65535).astype(np.uint16)


def spread_points(rng: np.random.Generator, snrs: FloatArray) -> FloatArray:
    """Points of given SNR, at least 40 px apart and from the rim: (n, 3) of x, y and light."""
    places: list[FloatArray] = []
    while len(places) < len(snrs):
        place = rng.uniform(40.0, (SHAPE[1] - 40.0, SHAPE[0] - 40.0))
        if all(np.hypot(*(place - other)) > 40.0 for other in places):
            places.append(place)
    return np.column_stack([np.array(places), [point_flux(float(each)) for each in snrs]])
