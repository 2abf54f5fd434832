"""Frames of Gaussian stars and streaks whose width changes over the field, by NumPy alone.

Nothing of the product or of its renderer draws here: the width of every star is what it says.
"""

from collections.abc import Callable

import numpy as np
from scipy.special import erf

from rsoconsole.records import Frame
from rsoconsole.vision import NetworkBox
from rsoconsole.vision.detector.verifier import Verifier

HEIGHT, WIDTH = 900, 1200
SKY_ADU, NOISE_ADU = 700.0, 20.0
T0_UTC_NS = 1_750_000_000 * 10**9
PIXEL_FWHM = 0.68
"""What a pixel's own width adds to a Gaussian's, in quadrature: 2.3548 / sqrt(12)."""

FwhmPx = Callable[[float, float], float]
"""True width at a place, the pixel's own not counted."""
Ends = tuple[float, float, float, float]


def soft_and_tilted(x_px: float, y_px: float) -> float:
    """2.5 px in the middle, 5 px in the corners on average, and a tilt of 10 % to either side."""
    x, y = x_px - 0.5 * (WIDTH - 1), y_px - 0.5 * (HEIGHT - 1)
    r2 = (x * x + y * y) / (0.25 * (WIDTH**2 + HEIGHT**2))
    return 2.5 * (1.0 + r2) * (1.0 + 0.2 * x / WIDTH)


def drawn(fwhm: FwhmPx, count: int = 250, seed: int = 0, streak: Ends | None = None) -> Frame:
    """Stars of 10 to 100 sigma a pixel, and a streak of 500 ADU a pixel along, as wide as they."""
    rng = np.random.default_rng(seed)
    image = rng.normal(SKY_ADU, NOISE_ADU, (HEIGHT, WIDTH))
    for _ in range(count):
        x, y = rng.uniform(8, WIDTH - 8), rng.uniform(8, HEIGHT - 8)
        _add_star(image, x, y, fwhm(x, y), NOISE_ADU * 10 ** rng.uniform(1.0, 2.0))
    if streak is not None:
        _add_streak(image, streak, fwhm(*middle(streak)), adu_a_px=500.0)
    pixels = np.clip(np.rint(image), 0, 65535).astype(np.uint16)
    return Frame(
        frame_id=1,
        name="drawn",
        pixels=pixels,
        t_start_utc_ns=T0_UTC_NS,
        exposure_s=10.0,
        scale_arcsec_px=1.3,
    )


def middle(streak: Ends) -> tuple[float, float]:
    return 0.5 * (streak[0] + streak[2]), 0.5 * (streak[1] + streak[3])


def about(streak: Ends, confidence: float = 0.5) -> NetworkBox:
    """A proposal a pixel or two off."""
    x_a, y_a, x_b, y_b = streak
    return NetworkBox(
        confidence=confidence,
        corners_px=(min(x_a, x_b) - 4, min(y_a, y_b) - 4, max(x_a, x_b) + 4, max(y_a, y_b) + 4),
        ends_px=(x_a + 2, y_a - 1, x_b + 2, y_b - 1),
    )


class Proposes:
    """Answers every map with the same proposals."""

    verifier = Verifier.load()

    def __init__(self, *boxes: NetworkBox) -> None:
        self.boxes = boxes

    def run(self, _frame_map: object) -> tuple[NetworkBox, ...]:
        return self.boxes


def _add_star(image: np.ndarray, x: float, y: float, fwhm: float, peak_adu: float) -> None:
    reach = int(3 * fwhm) + 2
    s = fwhm / 2.3548 * np.sqrt(2)
    ix = np.arange(max(round(x) - reach, 0), min(round(x) + reach + 1, image.shape[1]))
    iy = np.arange(max(round(y) - reach, 0), min(round(y) + reach + 1, image.shape[0]))
    fx = erf((ix + 0.5 - x) / s) - erf((ix - 0.5 - x) / s)
    fy = erf((iy + 0.5 - y) / s) - erf((iy - 0.5 - y) / s)
    image[iy[0] : iy[-1] + 1, ix[0] : ix[-1] + 1] += (
        peak_adu * np.outer(fy, fx) / fx.max() / fy.max()
    )


def _add_streak(image: np.ndarray, streak: Ends, fwhm: float, adu_a_px: float) -> None:
    """A line of even light under a Gaussian, summed over 3 x 3 places in each pixel."""
    x_a, y_a, x_b, y_b = streak
    length = np.hypot(x_b - x_a, y_b - y_a)
    dx, dy = (x_b - x_a) / length, (y_b - y_a) / length
    s = fwhm / 2.3548 * np.sqrt(2)
    steps = np.array([-1.0, 0.0, 1.0]) / 3.0
    for sub_y in steps:
        for sub_x in steps:
            y, x = np.mgrid[: image.shape[0], : image.shape[1]]
            x, y = x + sub_x - x_a, y + sub_y - y_a
            along, across = x * dx + y * dy, y * dx - x * dy
            even = 0.5 * (erf(along / s) - erf((along - length) / s))
            image += adu_a_px / 9.0 * even * np.exp(-((across / s) ** 2)) / (s * np.sqrt(np.pi))
