"""Stars of the frame's list in a cutout: which pixels they spoil, and the halos of giants."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rsoconsole.records import FloatArray
from rsoconsole.vision.stars import FWHM_PER_SIGMA, StarList
from rsoconsole.vision.streak_beside import BRIGHTEST_MODELLED
from rsoconsole.vision.streak_model import BoolArray

_REACH_PX = 40
_SEEN_HALO, _GOOD_HALO, _LEAST_HALO = 12.0, 3.0, 0.2
"""Halo over the sky's sigma up to which what remains of it is hardly felt by a fit, by a search
for a line, and from which it is taken away."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Layers:
    """A cutout's pixels and what stars do to them, (h, w) each; changed in place."""

    values: FloatArray
    halo: npt.NDArray[np.float32]
    """ADU of giants, taken away from ``values``."""
    is_good: BoolArray
    """False where a star shines."""
    is_seen: BoolArray
    """False where it shines too brightly to be modelled."""


def clear_of_stars(
    layers: Layers, corner: tuple[int, int], stars: StarList, noise: float
) -> list[int]:
    """Mark every pixel that a star lights and take the halos of giants away.

    Giants, listed or not, are not seen where they are brightest. Gives the listed stars that are
    faint enough to be modelled: their pixels stay seen.
    """
    (x0, y0), (height, width) = corner, layers.values.shape
    near = (stars.x_px > x0 - _REACH_PX) & (stars.x_px < x0 + width + _REACH_PX)
    near &= (stars.y_px > y0 - _REACH_PX) & (stars.y_px < y0 + height + _REACH_PX)
    modelled: list[int] = []
    giants = _giants(layers, BRIGHTEST_MODELLED * noise, stars.median_fwhm_px)
    for i in np.flatnonzero(near):
        sigma = max(stars.fwhm_px[i], stars.median_fwhm_px) / FWHM_PER_SIGMA
        peak = stars.flux[i] / (2.0 * np.pi * sigma**2)
        x, y = float(stars.x_px[i]) - x0, float(stars.y_px[i]) - y0
        if stars.is_saturated[i] or peak >= BRIGHTEST_MODELLED * noise:
            giants = [g for g in giants if np.hypot(g[0] - x, g[1] - y) > 8.0 * sigma]
            giants.append((x, y))
            continue
        modelled.append(int(i))
        radius = sigma * np.sqrt(2.0 * np.log(max(2.0 * peak / noise, 2.0)))
        _mark(layers.is_good, x, y, 1.15 * radius)
    for x, y in giants:
        _clear_giant(layers, (x, y), noise)
    return modelled


def _giants(layers: Layers, bright: float, fwhm_px: float) -> list[tuple[float, float]]:
    """Middles (x, y) of what is bright over far more than a star's width; all of it is marked.

    What hangs together with it is marked, too: columns into which a full pixel has bled.
    """
    import cv2

    is_bright = (layers.values > bright).astype(np.uint8)
    if cv2.countNonZero(is_bright) < 6.0 * fwhm_px**2:
        return []
    size = 2 * int(fwhm_px) + 3
    core = cv2.erode(is_bright, np.ones((size, size), dtype=np.uint8)) > 0
    if not core.any():
        return []
    _, parts, _, middles = cv2.connectedComponentsWithStats(is_bright)
    giants = [int(part) for part in np.unique(parts[core])]
    spoilt = np.isin(parts, giants).astype(np.uint8)
    is_clear = cv2.dilate(spoilt, np.ones((5, 5), dtype=np.uint8)) == 0
    layers.is_good[:] &= is_clear
    layers.is_seen[:] &= is_clear
    return [(float(middles[part][0]), float(middles[part][1])) for part in giants]


def _mark(mask: BoolArray, x: float, y: float, radius: float) -> None:
    """Set False within ``radius`` of (x, y)."""
    height, width = mask.shape
    top, bottom = max(0, int(y - radius)), min(height, int(y + radius) + 2)
    left, right = max(0, int(x - radius)), min(width, int(x + radius) + 2)
    if top < bottom and left < right:
        yy, xx = np.ogrid[top:bottom, left:right]
        mask[top:bottom, left:right] &= (xx - x) ** 2 + (yy - y) ** 2 > radius**2


def _clear_giant(layers: Layers, middle: tuple[float, float], noise: float) -> None:
    """Take away what a giant sheds alike in all directions; mark where that is too much to trust.

    The median over a ring knows nothing of a streak that crosses it.
    """
    (x, y), (height, width) = middle, layers.values.shape
    top, bottom = max(0, int(y) - _REACH_PX), min(height, int(y) + _REACH_PX + 2)
    left, right = max(0, int(x) - _REACH_PX), min(width, int(x) + _REACH_PX + 2)
    if top >= bottom or left >= right:
        return
    yy, xx = np.ogrid[top:bottom, left:right]
    radius = np.hypot(xx - x, yy - y)
    near = (slice(top, bottom), slice(left, right))
    profile = _profile(layers.values[near], radius, noise)
    light = np.interp(radius, np.arange(profile.size) + 0.5, profile)
    light[light < _LEAST_HALO * noise] = 0.0
    layers.is_seen[near] &= light < _SEEN_HALO * noise
    layers.is_good[near] &= light < _GOOD_HALO * noise
    layers.values[near] -= light
    layers.halo[near] += light.astype(np.float32)


def _profile(part: FloatArray, radius: FloatArray, noise: float) -> npt.NDArray[np.float64]:
    """Median of each ring of one pixel, never rising outwards; ADU."""
    ring = radius.astype(np.int64).ravel()
    # One sort for all rings: whole part the ring, broken part the value in 0 to 1.
    low, high = float(part.min()), float(part.max())
    scale = max(high - low, 1e-9) * 1.000001
    ordered = np.sort(ring + (part.ravel() - low) / scale)
    counts = np.bincount(ring, minlength=_REACH_PX)[:_REACH_PX]
    middles = np.minimum(np.cumsum(counts) - counts + counts // 2, ordered.size - 1)
    medians = (ordered[middles] % 1.0) * scale + low
    known = np.flatnonzero(counts >= 5)
    if known.size == 0:
        return np.full(1, 1e3 * noise)
    filled = np.interp(np.arange(_REACH_PX), known, medians[known])
    return np.asarray(np.minimum.accumulate(np.maximum(filled, 0.0)), dtype=np.float64)
