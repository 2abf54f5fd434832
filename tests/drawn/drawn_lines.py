"""Lines of light drawn by hand, pixel by pixel, without the product's own renderer."""

import math

import numpy as np
from scipy.special import erf

from rsoconsole.records import FloatArray, PixelArray

SKY_ADU, NOISE_ADU = 900.0, 30.0


def line_of_light(
    shape: tuple[int, int],
    ends: tuple[float, float, float, float],
    sigma_px: float,
    brightness: object = None,
) -> FloatArray:
    """A segment blurred by a Gaussian, 1 a pixel of length; ``brightness``: of 0 to 1 along it."""
    x_a, y_a, x_b, y_b = ends
    length = math.hypot(x_b - x_a, y_b - y_a)
    dx, dy = (x_b - x_a) / length, (y_b - y_a) / length
    yy, xx = np.mgrid[: shape[0], : shape[1]]
    u, v = (xx - x_a) * dx + (yy - y_a) * dy, (yy - y_a) * dx - (xx - x_a) * dy
    across = np.exp(-0.5 * (v / sigma_px) ** 2) / (math.sqrt(2 * math.pi) * sigma_px)
    root = math.sqrt(2.0) * sigma_px
    light = 0.5 * (erf(u / root) - erf((u - length) / root)) * across
    if brightness is not None:
        light = light * brightness(np.clip(u / length, 0.0, 1.0))  # type: ignore[operator]
    return np.asarray(light)


def integrated_snr(light: FloatArray, noise_adu: float = NOISE_ADU) -> float:
    """Of light in ADU whose shape is known."""
    return float(math.sqrt(float((light**2).sum())) / noise_adu)


def exposed(light: FloatArray, rng: np.random.Generator) -> PixelArray:
    """Light in ADU on a sky with noise, as a camera stores it."""
    noisy = SKY_ADU + light + rng.normal(0.0, NOISE_ADU, light.shape)
    return np.clip(np.rint(noisy), 0, 65535).astype(np.uint16)


def random_ends(
    rng: np.random.Generator, shape: tuple[int, int], length_px: float, rim_px: float = 12.0
) -> tuple[float, float, float, float]:
    """A segment of this length anywhere inside."""
    while True:
        angle = rng.uniform(0.0, 2.0 * math.pi)
        half = 0.5 * length_px * np.array([math.cos(angle), math.sin(angle)])
        room = np.array(shape[::-1]) / 2.0 - np.abs(half) - rim_px
        if (room > 0.0).all():
            x, y = np.array(shape[::-1]) / 2.0 + rng.uniform(-room, room)
            return x - half[0], y - half[1], x + half[0], y + half[1]


def stars(
    shape: tuple[int, int], count: int, sigma_px: float, rng: np.random.Generator
) -> FloatArray:
    """Points of light, many faint and few bright, ADU."""
    light = np.zeros(shape)
    flux = NOISE_ADU * 10.0 ** rng.exponential(0.6, count) * 5.0
    reach = math.ceil(6.0 * sigma_px)
    for total, x, y in zip(
        flux, rng.uniform(0, shape[1], count), rng.uniform(0, shape[0], count), strict=True
    ):
        x0, x1 = max(int(x) - reach, 0), min(int(x) + reach + 1, shape[1])
        y0, y1 = max(int(y) - reach, 0), min(int(y) + reach + 1, shape[0])
        yy, xx = np.mgrid[y0:y1, x0:x1]
        disc = np.exp(-0.5 * ((xx - x) ** 2 + (yy - y) ** 2) / sigma_px**2)
        light[y0:y1, x0:x1] += total * disc / (2 * math.pi * sigma_px**2)
    return light
