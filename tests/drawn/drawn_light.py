"""Small skies with lines and points of light, of known place and signal to noise."""

import numpy as np

from rsoconsole.simulator.camera.psf import add_points

NOISE, SIGMA_PX, SIZE = 20.0, 1.3, 400


def sky_with(*lights, seed: int = 1) -> np.ndarray:
    """Sky of 700 ADU with points of light: (x, y, flux) arrays."""
    light = np.zeros((SIZE, SIZE), dtype=np.float32)
    for x, y, flux in lights:
        add_points(light, x, y, flux, sigma_px=SIGMA_PX, faintest_e=0.01)
    noise = np.random.default_rng(seed).normal(0.0, NOISE, light.shape)
    return np.clip(np.rint(700.0 + light + noise), 0, 65535).astype(np.uint16)


def streak(x: float, y: float, angle_deg: float, length_px: float, ridge_snr: float):
    """Points of light so dense that they are a line; ridge_snr is per pixel on the ridge."""
    along = np.linspace(-0.5, 0.5, 4 * int(length_px)) * length_px
    per_px = ridge_snr * NOISE * np.sqrt(2.0 * np.pi) * SIGMA_PX
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    return x + c * along, y + s * along, np.full(along.size, per_px * length_px / along.size)
