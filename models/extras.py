"""Lights in a frame other than satellites and single stars, which a detector must refuse.

Each function draws one kind of light for a frame of any size from a ``Canvas`` and a generator.
"""

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
import numpy.typing as npt

from models.light import lamp_curve, log_uniform, meteor_curve
from rsoconsole.simulator import FWHM_PER_SIGMA, WINGS, Streak, annulus, straight_streak

FloatArray = npt.NDArray[np.float64]
Points = tuple[FloatArray, FloatArray, FloatArray]
"""Points as x, y (pixels) and electrons, each (n,)."""


@dataclass(frozen=True, kw_only=True)
class Canvas:
    """Size, seeing and noise of a frame to be drawn."""

    width_px: int
    height_px: int
    fwhm_px: float
    noise_e: float
    """One sigma of one pixel of empty sky."""
    unit_px: float = 8.0
    """Unit of length proportional to the focal length: a fifteenth of a geostationary streak."""
    defocus_px: float = 0.0

    @property
    def diagonal_px(self) -> float:
        """Length of the frame's diagonal."""
        return float(np.hypot(self.width_px, self.height_px))

    def line_e_per_px(self, peak_snr: float, fwhm_px: float | None = None) -> float:
        """Electrons per pixel of length that give a line this peak SNR on its ridge.

        ``fwhm_px``: the line's width; None: that of a star.
        """
        if fwhm_px is None:
            return peak_snr * self.noise_e / self._ridge
        sigma = np.sqrt((fwhm_px / FWHM_PER_SIGMA) ** 2 + 1.0 / 12.0)
        return float(peak_snr * self.noise_e * np.sqrt(2 * np.pi) * sigma)

    @cached_property
    def _ridge(self) -> float:
        """Highest share of a line's light in one pixel across it."""
        sigma = np.sqrt((self.fwhm_px / FWHM_PER_SIGMA) ** 2 + 1.0 / 12.0)
        if self.defocus_px <= 0.0:
            return float(1.0 / (np.sqrt(2 * np.pi) * sigma))
        ring = annulus(self.defocus_px).sum(axis=0)
        x = np.arange(-3 * len(ring), 3 * len(ring) + 1)
        disc = np.exp(-0.5 * (x / sigma) ** 2) / (np.sqrt(2 * np.pi) * sigma)
        return float(np.convolve(disc, ring).max())

    def line_snr(self, e_per_px: float, length_px: float, spread_px: float = 0.0) -> float:
        """Integrated SNR of a uniform line on empty sky, as ``streak_snr`` defines it.

        ``spread_px``: one sigma of the blur by motion across the line, added to the disc.
        """
        light = e_per_px * self._section(spread_px)
        return float(np.sqrt(length_px * np.sum(light**2 / (self.noise_e**2 + light))))

    def line_of_snr(self, snr: float, length_px: float, spread_px: float = 0.0) -> float:
        """Electrons per pixel of length that give a uniform line this integrated SNR.

        ``spread_px`` as in ``line_snr``.
        """
        light = snr * self.noise_e
        # The line's own photons count: a few steps settle them.
        for _ in range(4):
            light *= snr / self.line_snr(light, length_px, spread_px)
        return light

    def _section(self, spread_px: float) -> FloatArray:
        """Share of a line's light in every pixel across it, wings and ring and all."""
        sigmas = [
            np.sqrt((self.fwhm_px * widening / FWHM_PER_SIGMA) ** 2 + 1.0 / 12.0 + spread_px**2)
            for _, widening in WINGS
        ]
        x = np.arange(-60, 61)
        light = np.zeros(len(x))
        for (share, _), sigma in zip(WINGS, sigmas, strict=True):
            light += share * np.exp(-0.5 * (x / sigma) ** 2) / (np.sqrt(2 * np.pi) * sigma)
        if self.defocus_px > 0.0:
            light = np.convolve(light, annulus(self.defocus_px).sum(axis=0))
        return light

    def star_e(self, peak_snr: float) -> float:
        """Electrons of a star in focus whose brightest pixel has this SNR."""
        variance = (self.fwhm_px / FWHM_PER_SIGMA) ** 2 + 1.0 / 12.0
        return float(peak_snr * self.noise_e * 2 * np.pi * variance)

    def place(self, rng: np.random.Generator, rim: float = 0.0) -> FloatArray:
        """A random point (x, y) in the frame, px.

        ``rim``: least distance from the edges, as a fraction of the frame's sides.
        """
        return rng.uniform(rim, 1.0 - rim, size=2) * (self.width_px, self.height_px)


def aircraft(canvas: Canvas, rng: np.random.Generator) -> list[Streak]:
    """The lamps of a random aircraft: parallel defocused trails, some blinking or ending inside."""
    angle = rng.uniform(0.0, 2 * np.pi)
    along = np.array([np.cos(angle), np.sin(angle)])
    across = np.array([-along[1], along[0]])
    centre = canvas.place(rng, 0.05)
    back, ahead = 1.1 * canvas.diagonal_px, 1.1 * canvas.diagonal_px
    if rng.random() < 0.35:
        ahead = rng.uniform(0.0, 0.3) * canvas.diagonal_px
    # A lamp at ten kilometres is as blurred as a defocus of half a unit.
    blur_px = canvas.unit_px * log_uniform(rng, 0.08, 4.0)
    fwhm_px = float(np.hypot(canvas.fwhm_px, blur_px))
    period_px = canvas.unit_px * log_uniform(rng, 1.5, 30.0)
    spread_px = canvas.unit_px * log_uniform(rng, 0.5, 30.0)
    trails = []
    for lamp in range(int(rng.integers(1, 5))):
        is_blinking = rng.random() < 0.6
        snr = log_uniform(rng, 1.0, 40.0)
        middle = centre + across * (rng.normal(0, spread_px) if lamp else 0.0)
        middle = middle + along * rng.normal(0, 0.3 * spread_px)
        start, end = middle - along * back, middle + along * ahead
        curve = lamp_curve(rng, (back + ahead) / period_px) if is_blinking else None
        light = canvas.line_e_per_px(snr, fwhm_px) * (back + ahead)
        trails.append(straight_streak(tuple(start), tuple(end), light, curve, fwhm_px))
    return trails


def meteor(canvas: Canvas, rng: np.random.Generator) -> list[Streak]:
    """One random meteor: wider than a star, brightening and fading, mostly from edge to edge."""
    angle = rng.uniform(0.0, 2 * np.pi)
    length = canvas.diagonal_px * log_uniform(rng, 0.15, 2.5)
    half = 0.5 * length * np.array([np.cos(angle), np.sin(angle)])
    fwhm_px = canvas.fwhm_px * rng.uniform(1.7, 4.0)
    light = canvas.line_e_per_px(log_uniform(rng, 2.0, 60.0), fwhm_px) * length
    middle = canvas.place(rng)
    ends = tuple(middle - half), tuple(middle + half)
    return [straight_streak(*ends, light, meteor_curve(rng), fwhm_px)]


def galaxy(canvas: Canvas, rng: np.random.Generator) -> list[Streak]:
    """One random galaxy: a smooth elongated patch, often edge-on, with a brighter middle."""
    minor_px = canvas.fwhm_px * log_uniform(rng, 1.4, 3.0)
    length = minor_px * rng.uniform(2.0, 9.0)
    angle = rng.uniform(0.0, np.pi)
    half = 0.5 * length * np.array([np.cos(angle), np.sin(angle)])
    profile = np.exp(-np.abs(np.linspace(-1.0, 1.0, 65)) * rng.uniform(2.5, 5.0))
    light = canvas.line_e_per_px(log_uniform(rng, 1.0, 20.0), minor_px) * length
    middle = canvas.place(rng)
    ends = tuple(middle - half), tuple(middle + half)
    return [straight_streak(*ends, light, profile, minor_px)]


def spiked_star(
    canvas: Canvas, rng: np.random.Generator, *, angle: float, arms: int
) -> tuple[Points, list[Streak]]:
    """A star far above the full well, and its diffraction spikes.

    ``angle``: direction of the first spike, rad. ``arms``: number of spikes.
    """
    middle = canvas.place(rng)
    snr = log_uniform(rng, 300.0, 30000.0)
    light = canvas.star_e(snr)
    reach = canvas.unit_px * rng.uniform(2.0, 5.0) * (snr / 300.0) ** 0.4
    away = np.linspace(0.0, 1.0, 48)
    fading = 1.0 / (1.0 + 25.0 * away**2)
    peak = min(0.03 * snr, 120.0) * rng.uniform(0.3, 1.0)
    spikes = []
    for arm in range(arms):
        turn = angle + 2 * np.pi * arm / arms
        end = middle + reach * np.array([np.cos(turn), np.sin(turn)])
        shine = canvas.line_e_per_px(peak) * reach
        spikes.append(straight_streak(tuple(middle), tuple(end), shine, fading))
    return (middle[:1], middle[1:], np.array([light])), spikes


def ghost(canvas: Canvas, rng: np.random.Generator) -> list[Streak]:
    """A random reflection in the optics: a faint ring, or a disc with or without a hole."""
    middle, radius = canvas.place(rng), canvas.unit_px * log_uniform(rng, 1.5, 30.0)
    surface_snr = rng.uniform(0.3, 4.0)
    if rng.random() < 0.4:
        turn = np.linspace(0.0, 2 * np.pi, 181)
        fwhm_px = max(canvas.fwhm_px, radius * rng.uniform(0.05, 0.2))
        light = canvas.line_e_per_px(surface_snr, fwhm_px) * 2 * np.pi * radius
        x, y = middle[0] + radius * np.cos(turn), middle[1] + radius * np.sin(turn)
        return [Streak(x_px=x, y_px=y, electrons=light, fwhm_px=fwhm_px)]
    # A spiral of equal area a turn fills a disc evenly.
    gap_px = max(radius / 12.0, 2.0)
    hole = rng.uniform(0.0, 0.5)
    share = np.sqrt(np.linspace(hole**2, 1.0, 1500))
    turn = 2 * np.pi * share * radius / gap_px
    x, y = middle[0] + radius * share * np.cos(turn), middle[1] + radius * share * np.sin(turn)
    light = surface_snr * canvas.noise_e * np.pi * radius**2 * (1.0 - hole**2)
    return [Streak(x_px=x, y_px=y, electrons=light, fwhm_px=1.3 * gap_px)]


def close_stars(canvas: Canvas, rng: np.random.Generator) -> Points:
    """Two to four stars almost in line, so close that they resemble a short streak."""
    count = int(rng.choice([2, 3, 4], p=[0.55, 0.3, 0.15]))
    angle = rng.uniform(0.0, np.pi)
    gap_px = canvas.unit_px * rng.uniform(0.5, 3.0)
    along = (np.arange(count) - (count - 1) / 2) * gap_px + rng.normal(0, 0.2 * gap_px, count)
    across = rng.normal(0, 0.12 * gap_px, count)
    cos, sin = np.cos(angle), np.sin(angle)
    x, y = canvas.place(rng)
    snr = log_uniform(rng, 2.0, 60.0) * np.exp(rng.normal(0, 0.4, count))
    electrons = snr * canvas.star_e(1.0)
    return x + along * cos - across * sin, y + along * sin + across * cos, electrons


def wander(canvas: Canvas, rng: np.random.Generator) -> FloatArray:
    """Random path (2, m) of all stars when the mount tracks badly: drift, arc, hook or shaking."""
    length = canvas.unit_px * (
        log_uniform(rng, 1.0, 8.0) if rng.random() < 0.6 else log_uniform(rng, 6.0, 45.0)
    )
    time = np.linspace(0.0, 1.0, 41)
    kind = int(rng.choice(4, p=[0.45, 0.15, 0.2, 0.2]))
    if kind == 3:
        # Gusts: the mount swings about its place.
        waves = rng.uniform(0.5, 4.0, size=(2, 4))
        phase = rng.uniform(0, 2 * np.pi, size=(2, 4))
        swing = np.sin(2 * np.pi * waves[:, :, None] * time + phase[:, :, None]).sum(axis=1)
        swing *= np.array([[1.0], [rng.uniform(0.0, 1.0)]])
        path = 0.15 * min(length, 12 * canvas.unit_px) * swing
    else:
        bend = np.zeros_like(time)
        if kind == 1:
            bend = rng.uniform(0.3, 2.5) * (time - 0.5)
        elif kind == 2:
            bend = np.where(time > rng.uniform(0.4, 0.85), rng.uniform(0.6, 2.4), 0.0)
        pace = np.full_like(time, 1.0)
        if rng.random() < 0.35:
            # It stood for most of the exposure.
            pace = np.where(time > rng.uniform(0.3, 0.85), 1.0, 0.002)
        pace /= pace.sum()
        path = length * np.cumsum(pace * np.array([np.cos(bend), np.sin(bend)]), axis=1)
    turn = rng.uniform(0.0, 2 * np.pi)
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    if kind != 3:
        path = path - path.mean(axis=1, keepdims=True)
    return np.asarray(rotation @ path)


def clouds(rng: np.random.Generator) -> npt.NDArray[np.float32]:
    """Random map of the clouds' mean transmission: banks drawn out by the wind, with gaps."""
    side = int(rng.integers(7, 28))
    coarse = rng.random((side, side)).astype(np.float32)
    smear = int(rng.integers(1, 6))
    if smear > 1:
        coarse = cv2.blur(coarse, (smear, 1) if rng.random() < 0.5 else (1, smear))
    low, high = float(coarse.min()), float(coarse.max())
    share = (coarse - low) / max(high - low, 1e-6)
    return np.clip(rng.uniform(0.1, 0.6) + 1.1 * share, 0.05, 1.0).astype(np.float32)
