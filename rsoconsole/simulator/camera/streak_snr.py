"""The integrated SNR of one streak, computed from the model that the renderer draws."""

import math

import cv2
import numpy as np

from rsoconsole.simulator.camera.psf import FWHM_PER_SIGMA, Float32Array, add_sources, annulus
from rsoconsole.simulator.camera.rendering import (
    FieldContent,
    Streak,
    streak_points,
    transmission_at,
)
from rsoconsole.simulator.camera.sensor import SensorModel, flat_field

_REACH_SIGMAS = 14.0
"""Distance from the streak to which its light counts: the disc's wings, short of the aureole."""
_FAINTEST_E = 0.004


def integrated_snr(sensor: SensorModel, content: FieldContent, streak: Streak) -> float:
    """Return the integrated SNR: sum(model x data / variance) / sqrt(sum(model^2 / variance)).

    Its expected value, with the streak as the renderer draws it as the model. The variance is that
    of sky, stars, dark current, read-out and the streak itself, without hot pixels. ``streak``:
    with the extinction of the air, without clouds, which are applied here.
    """
    box = _box(sensor, content, streak)
    if box is None or streak.electrons <= 0.0:
        return 0.0
    left, top, right, bottom = box
    model_e = np.zeros((bottom - top, right - left), dtype=np.float32)
    x, y, electrons = streak_points(sensor, content, streak)
    fwhm_px = content.fwhm_px if streak.fwhm_px is None else streak.fwhm_px
    add_sources(model_e, x - left, y - top, electrons, fwhm_px=fwhm_px, faintest_e=_FAINTEST_E)
    beside_e = _sky_and_stars(sensor, content, box)
    if content.defocus_px > 0.0:
        kernel = annulus(content.defocus_px)
        model_e, beside_e = (
            cv2.filter2D(part, -1, kernel, borderType=cv2.BORDER_REFLECT_101)
            for part in (model_e, beside_e)
        )
    flat = flat_field(sensor)[top:bottom, left:right]
    model_e *= flat
    variance_e2 = (
        model_e
        + beside_e * flat
        + sensor.dark_e_s * content.exposure_s
        + sensor.read_noise_e**2
        + sensor.e_per_adu12**2 / 12.0
    )
    return math.sqrt(float(np.sum(model_e.astype(np.float64) ** 2 / variance_e2)))


def _box(
    sensor: SensorModel, content: FieldContent, streak: Streak
) -> tuple[int, int, int, int] | None:
    """Box of the pixels that the streak lights: left, top, right, bottom; None off the sensor."""
    fwhm_px = max(content.fwhm_px, streak.fwhm_px or 0.0)
    reach_px = _REACH_SIGMAS * fwhm_px / FWHM_PER_SIGMA + content.defocus_px
    left = max(0, math.floor(float(streak.x_px.min()) - reach_px))
    right = min(sensor.width_px, math.ceil(float(streak.x_px.max()) + reach_px) + 1)
    top = max(0, math.floor(float(streak.y_px.min()) - reach_px))
    bottom = min(sensor.height_px, math.ceil(float(streak.y_px.max()) + reach_px) + 1)
    return (left, top, right, bottom) if left < right and top < bottom else None


def _sky_and_stars(
    sensor: SensorModel, content: FieldContent, box: tuple[int, int, int, int]
) -> Float32Array:
    """Electrons in the box from all but the streak, before the flat field."""
    left, top, right, bottom = box
    shape = (bottom - top, right - left)
    middle = np.array([(left + right) / 2.0]), np.array([(top + bottom) / 2.0])
    clouds = float(transmission_at(sensor, content.cloud_transmission, *middle)[0])
    glow = 1.0 + content.cloud_glow * (1.0 - clouds)
    slope = content.sky_gradient[0] * (
        float(middle[0][0]) / sensor.width_px - 0.5
    ) + content.sky_gradient[1] * (float(middle[1][0]) / sensor.height_px - 0.5)
    image_e = np.full(shape, content.sky_electrons_px * glow * (1.0 + slope), dtype=np.float32)
    x, y = content.star_x_px, content.star_y_px
    reach_px = _REACH_SIGMAS * content.fwhm_px
    near = (x > left - reach_px) & (x < right + reach_px)
    near &= (y > top - reach_px) & (y < bottom + reach_px)
    if np.any(near):
        x, y = x[near], y[near]
        light = content.star_electrons[near] * transmission_at(
            sensor, content.cloud_transmission, x, y
        )
        add_sources(image_e, x - left, y - top, light, fwhm_px=content.fwhm_px)
    return image_e
