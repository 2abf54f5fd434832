"""Centroid, width and light of stars by moments under a Gaussian weight. Pure."""

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from rsoconsole.records import FloatArray, PixelArray
from rsoconsole.vision.arrays import IndexArray
from rsoconsole.vision.frame.background import Background
from rsoconsole.vision.frame.bins import mirrored_indices

FWHM_PER_SIGMA = 2.3548

_ITERATIONS = 8


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StarMoments:
    """Windowed moments of star candidates; every array has one entry for each."""

    x_px: FloatArray
    y_px: FloatArray
    flux: FloatArray
    fwhm_px: FloatArray
    axis_ratio: FloatArray
    angle_deg: FloatArray
    """Direction of the longer axis, x towards y, 0 to 180."""
    peak_share: FloatArray
    peak_adu: FloatArray
    snr: FloatArray
    shift_px: FloatArray
    """Distance from the brightest pixel to the centroid, px."""


def measure_star_moments(
    pixels: PixelArray,
    sky: Background,
    x0_px: IndexArray,
    y0_px: IndexArray,
    *,
    sigma_px: float,
    half_px: int,
) -> StarMoments:
    """Measure windowed centroid, width and flux around each start pixel.

    Gaussian window of ``sigma_px``, in boxes of 2 half_px + 1; beyond its edges the frame is
    mirrored. A width follows from the windowed moment M and the window's W by 1/C = 1/M - 1/W,
    exact for a Gaussian star in a Gaussian window.
    """
    offset = np.arange(-half_px, half_px + 1)
    boxes, noise = _boxes(pixels, sky, x0_px, y0_px, half_px)
    at = np.zeros((2, x0_px.size))
    for _ in range(_ITERATIONS):
        sums = _sums(boxes, offset, at, sigma_px, 2)
        off = np.stack([sums[:, 1, 0], sums[:, 0, 1]]) / _or_infinite(sums[:, 0, 0])
        # Twice the windowed offset: the window halves it where it is as wide as the star.
        at = np.clip(at + 2.0 * off, -half_px / 2, half_px / 2)
    dy, dx = at
    wide_px = 1.5 * sigma_px
    total, mxx, myy, mxy = _moments(boxes, offset, at, wide_px)
    mean, half_gap = (mxx + myy) / 2, np.hypot((mxx - myy) / 2, mxy)
    small, large = np.maximum(mean - half_gap, 1e-3), np.maximum(mean + half_gap, 1e-3)
    inverse = np.maximum(1.0 / np.maximum(mean, 1e-3) - 1.0 / wide_px**2, 1e-2)
    variance = 1.0 / inverse
    matched = _sums(boxes, offset, at, sigma_px, 1)[:, 0, 0]
    inner = boxes[:, half_px - 1 : half_px + 2, half_px - 1 : half_px + 2]
    inner_sum = np.maximum(inner.sum(axis=(1, 2)), 1e-6)
    return StarMoments(
        x_px=x0_px + dx,
        y_px=y0_px + dy,
        flux=np.asarray(total * (variance + wide_px**2) / wide_px**2),
        fwhm_px=FWHM_PER_SIGMA * np.sqrt(variance),
        axis_ratio=np.sqrt(large / small),
        angle_deg=0.5 * np.degrees(np.arctan2(2.0 * mxy, mxx - myy)) % 180.0,
        peak_share=inner.max(axis=(1, 2)) / inner_sum,
        peak_adu=inner.max(axis=(1, 2)) + sky.all_at(sky.level, x0_px, y0_px),
        snr=matched / (noise * np.sqrt(np.pi) * sigma_px),
        shift_px=np.hypot(dx, dy),
    )


def _boxes(
    pixels: PixelArray, sky: Background, x0_px: IndexArray, y0_px: IndexArray, half_px: int
) -> tuple[FloatArray, FloatArray]:
    """Pixels above the sky, (n, 2 half + 1, 2 half + 1), and the noise of one pixel, (n,)."""
    size, (height, width) = 2 * half_px + 1, pixels.shape
    top, left = y0_px - half_px, x0_px - half_px
    boxes = np.empty((x0_px.size, size, size), dtype=np.float64)
    inside = (top >= 0) & (left >= 0) & (top + size <= height) & (left + size <= width)
    if inside.any():
        boxes[inside] = sliding_window_view(pixels, (size, size))[top[inside], left[inside]]
    ys = mirrored_indices(top[~inside, None] + np.arange(size), height)[:, :, None]
    xs = mirrored_indices(left[~inside, None] + np.arange(size), width)[:, None, :]
    boxes[~inside] = pixels[ys, xs]
    boxes -= sky.all_at(sky.level, x0_px, y0_px)[:, None, None]
    return boxes, sky.all_at(sky.noise, x0_px, y0_px).astype(np.float64)


def _moments(
    boxes: FloatArray, offset: IndexArray, at: FloatArray, sigma_px: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Windowed sum, and second moments about the mean: x x, y y, x y."""
    s = _sums(boxes, offset, at, sigma_px, 3)
    safe = _or_infinite(s[:, 0, 0])
    mx, my = s[:, 0, 1] / safe, s[:, 1, 0] / safe
    mxx, myy = s[:, 0, 2] / safe - mx**2, s[:, 2, 0] / safe - my**2
    return s[:, 0, 0], mxx, myy, s[:, 1, 1] / safe - mx * my


def _or_infinite(total: FloatArray) -> FloatArray:
    """Return sums to divide by, infinite where there is no light."""
    return np.where(total > 0, total, np.inf)


def _sums(
    boxes: FloatArray, offset: IndexArray, at: FloatArray, sigma_px: float, powers: int
) -> FloatArray:
    """Sums of light in a separable window, times powers of the distance from its centre.

    (n, powers, powers): by the power of the distance in y, then in x. ``at``: y and x of the
    centres, (2, n).
    """
    away = offset - at[:, :, None]
    window = np.exp(-0.5 * (away / sigma_px) ** 2)
    by_y, by_x = np.stack([window * away**power for power in range(powers)], axis=-1)
    return np.asarray(by_y.transpose(0, 2, 1) @ (boxes @ by_x))
