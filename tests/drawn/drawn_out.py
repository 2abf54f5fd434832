"""Stars of another program's frames drawn out to trails; what keeps pace stays as it was.

SatSim's frames at the satellites' rate have their stars as points, moved from frame to frame by
the sky's motion. Here each star is drawn out with the image that SatSim gave it. Satellites and hot
pixels keep the pixels of the file, shot noise and all; the rest gets the noise of the sky and of
the trails' light.
"""

import math
from collections.abc import Sequence

import cv2
import numpy as np

from rsoconsole.records import FloatArray, PixelArray
from rsoconsole.vision import local_background
from rsoconsole.vision.arrays import BoolArray
from rsoconsole.vision.frame.background import resample

_BRIGHT_SNR = 60.0
_RADII_PX = {True: (12.0, 14.0), False: (6.0, 8.0)}
"""Radius whose pixels are kept, and that is emptied of the satellite: bright and others."""
_HOT_SIGMA, _HOT_NEIGHBOURS = 4.5, 0.35
_STEP_ADU = 16
"""12 bits times 16."""


def drawn_out(light: FloatArray, length_px: float, angle_deg: float) -> tuple[FloatArray, float]:
    """Every source drawn out along a centred line; what that leaves of white noise's variance.

    By the line's transform, which broadens nothing across.
    """
    pad = math.ceil(length_px)
    wide = np.pad(light, pad)
    by_row = np.fft.fftfreq(wide.shape[0])[:, None]
    by_column = np.fft.rfftfreq(wide.shape[1])
    c, s = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    line = np.sinc(length_px * (c * by_column + s * by_row))
    drawn = np.fft.irfft2(np.fft.rfft2(wide) * line, wide.shape)
    return drawn[pad:-pad, pad:-pad], float((line**2).mean())


def drawn_out_stars(
    frames: Sequence[PixelArray],
    objects: Sequence[tuple[float, float, float]],
    *,
    e_per_adu: float,
    length_px: float,
    angle_deg: float,
    seed: int,
) -> list[PixelArray]:
    """Frames of one pointing at rest with their stars as trails centred on where they were.

    ``objects``: x, y and SNR of the satellites, the same in all frames.
    """
    rng = np.random.default_rng(seed)
    skies = [local_background(each) for each in frames]
    levels = [resample(sky.level, sky.cell_px, *frames[0].shape) for sky in skies]
    lights = [each.astype(np.float32) - level for each, level in zip(frames, levels, strict=True)]
    noise = float(np.median(skies[0].noise))
    hot = _hot(lights, noise)
    usual = np.median(np.array(lights), axis=0)
    kept, emptied = (_discs(objects, frames[0].shape, which) for which in (0, 1))
    # Where a star passes a satellite, as a point, the other frames have the satellite alone.
    limit = 4.0 * np.hypot(np.sqrt(noise**2 + np.maximum(usual, 0.0) / e_per_adu), 0.03 * usual)
    out: list[PixelArray] = []
    for light, level in zip(lights, levels, strict=True):
        stars = light.copy()
        stars[emptied] = rng.normal(0.0, noise, np.count_nonzero(emptied))
        stars[hot] = 0.0
        trails, left = drawn_out(stars, length_px, angle_deg)
        shot = np.maximum(trails, 0.0) / e_per_adu
        variance = noise**2 * (1.0 - left) + shot
        variance[kept] = shot[kept]
        made = trails + rng.standard_normal(light.shape) * np.sqrt(variance)
        alone = np.where(
            np.abs(light - usual) > limit, usual + rng.normal(0.0, noise, light.shape), light
        )
        made[kept] += alone[kept]
        made[hot & ~kept] += light[hot & ~kept]
        whole = np.rint((made + level) / _STEP_ADU) * _STEP_ADU
        out.append(np.clip(whole, 0, 65520).astype(np.uint16))
    return out


def _hot(lights: Sequence[FloatArray], noise: float) -> BoolArray:
    """Single pixels that are bright in all frames but one."""
    around = np.full((3, 3), 1.0 / 8.0, np.float32)
    around[1, 1] = 0.0
    times = sum(
        (
            (each > _HOT_SIGMA * noise) & (cv2.filter2D(each, -1, around) < _HOT_NEIGHBOURS * each)
        ).astype(int)
        for each in lights
    )
    return np.asarray(times >= len(lights) - 1)


def _discs(
    objects: Sequence[tuple[float, float, float]], shape: tuple[int, ...], which: int
) -> BoolArray:
    inside = np.zeros(shape, bool)
    y, x = np.ogrid[: shape[0], : shape[1]]
    for x_px, y_px, snr in objects:
        radius = _RADII_PX[snr > _BRIGHT_SNR][which]
        top, left = max(int(y_px) - 20, 0), max(int(x_px) - 20, 0)
        box = np.s_[top : int(y_px) + 21, left : int(x_px) + 21]
        dy, dx = y[top : int(y_px) + 21] - y_px, x[:, left : int(x_px) + 21] - x_px
        inside[box] |= np.hypot(dx, dy) <= radius
    return inside
