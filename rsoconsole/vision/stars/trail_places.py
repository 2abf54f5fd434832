"""Places of trails, where a fainter neighbour has shifted the middle of their light.

The light along a trail is a plateau as long as every other one; where it fits best is found by
least squares, to which what a neighbour adds beyond one end matters little. Across, the light is
weighed by a Gaussian that moves onto it.
"""

import math
from dataclasses import replace

import numpy as np

from rsoconsole.records import FloatArray, PixelArray
from rsoconsole.vision.stars.star_list import StarList
from rsoconsole.vision.stars.star_moments import FWHM_PER_SIGMA

_MAX_SHIFT_PX = 8.0
_STEP_PX = 0.25
_INNER_SHARE, _ROUNDS = 0.8, 4
_HALF_WIDTH = 0.6
"""Half the width of the strip whose light is taken, by that of a star."""


def place_along_trails(pixels: PixelArray, stars: StarList) -> StarList:
    """Return the stars with their places moved onto their trails; those at the rim stay."""
    trail = stars.trail
    if trail is None:
        return stars
    c, s = math.cos(math.radians(trail.angle_deg)), math.sin(math.radians(trail.angle_deg))
    half = 0.5 * trail.length_px
    u = np.arange(-math.ceil(half + 2 * _MAX_SHIFT_PX), math.ceil(half + 2 * _MAX_SHIFT_PX) + 1.0)
    shifts = np.arange(-_MAX_SHIFT_PX, _MAX_SHIFT_PX + 0.5 * _STEP_PX, _STEP_PX)
    # Share of each unit of the strip that a plateau at each shift covers, less its mean.
    ends = (np.clip(half - np.abs(u - each) + 0.5, 0.0, 1.0) for each in shifts)
    models = np.stack([each - each.mean() for each in ends])
    models /= np.linalg.norm(models, axis=1, keepdims=True)
    reach = _HALF_WIDTH * trail.fwhm_px
    v = np.linspace(-reach, reach, 5)[:, None]
    x_px, y_px = stars.x_px.copy(), stars.y_px.copy()
    for n in range(len(stars)):
        aside = _across(pixels, (x_px[n], y_px[n]), (c, s), (half, trail.fwhm_px))
        x_px[n] -= s * aside
        y_px[n] += c * aside
        light = _along(pixels, x_px[n] + c * u - s * v, y_px[n] + s * u + c * v)
        if light is None:
            continue
        fit = models @ light
        best = int(np.argmax(fit))
        if 0 < best < shifts.size - 1:
            below, top, above = fit[best - 1 : best + 2]
            bend = below - 2.0 * top + above
            shift = shifts[best] + (0.5 * _STEP_PX * (below - above) / bend if bend else 0.0)
            x_px[n] += c * shift
            y_px[n] += s * shift
    return replace(stars, x_px=x_px, y_px=y_px)


def _across(
    pixels: PixelArray,
    place_px: tuple[float, float],
    direction: tuple[float, float],
    size_px: tuple[float, float],
) -> float:
    """How far a trail's axis is from a place, px; 0 where the frame cuts it.

    ``direction``: cosine and sine; ``size_px``: half the length, and the width of a star.
    """
    (x, y), (c, s), (half, fwhm) = place_px, direction, size_px
    v = np.arange(-2.0 * fwhm, 2.0 * fwhm + 0.25, 0.5)
    u = np.arange(-_INNER_SHARE * half, _INNER_SHARE * half + 1.0, 2.0)[:, None]
    section = _along(pixels, x + c * u - s * v, y + s * u + c * v)
    if section is None:
        return 0.0
    section = section - np.percentile(section, 10.0)
    aside, sigma = 0.0, fwhm / FWHM_PER_SIGMA
    for _ in range(_ROUNDS):
        weight = section * np.exp(-0.5 * ((v - aside) / sigma) ** 2)
        # Twice: the window holds the light back by half.
        aside += 2.0 * float(weight @ (v - aside)) / max(float(weight.sum()), 1e-9)
    return aside if abs(aside) < fwhm else 0.0


def _along(pixels: PixelArray, x_px: FloatArray, y_px: FloatArray) -> FloatArray | None:
    """Mean light across a strip at its places along; None where the frame cuts it."""
    height, width = pixels.shape
    if x_px.min() < 0 or y_px.min() < 0 or x_px.max() > width - 2 or y_px.max() > height - 2:
        return None
    left, top = np.floor(x_px).astype(np.intp), np.floor(y_px).astype(np.intp)
    dx, dy = x_px - left, y_px - top
    light = sum(
        (dx if i else 1.0 - dx) * (dy if j else 1.0 - dy) * pixels[top + j, left + i]
        for i in (0, 1)
        for j in (0, 1)
    )
    return np.asarray(np.median(light, axis=0))
