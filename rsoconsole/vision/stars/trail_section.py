"""Cross-section of star trails: how wide a point is where every star is drawn out.

Pixels of bright trails are taken as they are, each at its distance from its trail's axis, so that
nothing is broadened by interpolation; the median over trails leaves out their neighbours.
"""

import math
from dataclasses import dataclass

import numpy as np

from rsoconsole.records import FloatArray, PixelArray
from rsoconsole.vision.frame.background import Background
from rsoconsole.vision.stars.star_list import StarList
from rsoconsole.vision.stars.star_moments import FWHM_PER_SIGMA

_MAX_TRAILS = 40
_MIN_TRAILS = 5
_MIN_SNR = 20.0
_INNER_SHARE = 0.35
"""Largest distance from the middle along a trail, by its length."""
_REACH_PX = 12.0
_STEP_PX = 0.25
_CORE_PX = 3.0
"""Largest distance from the axis of the light by which it is found, px."""
_CORE_SHARE = 0.3
"""Least light, by that of the axis, of what the width is fitted to."""
_MIN_CORE = 3
_MIN_FWHM_PX = 1.2
_SATURATED_SHARE = 0.95


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrailSection:
    """Median cross-section of a frame's star trails; arrays (n,)."""

    distance_px: FloatArray
    """Distance from the axis, px."""
    light: FloatArray
    """Light per pixel, by that within ``_REACH_PX`` of the axis."""
    fwhm_px: float
    """Full width at half maximum of the core, px."""
    direction_deg: float
    """Direction of the trails, x towards y, 0 to 180 deg: better known than by their moments."""


def measure_trail_section(
    pixels: PixelArray, sky: Background, stars: StarList, saturation_adu: float
) -> TrailSection | None:
    """Measure the cross-section of the brightest unsaturated trails; None where they are too few.

    ``stars``: with a trail; those whose inner part is inside the frame are used.
    """
    trail = stars.trail
    if trail is None:
        return None
    strips: list[_Strip] = []
    for n in np.flatnonzero(stars.snr > _MIN_SNR):
        place = float(stars.x_px[n]), float(stars.y_px[n])
        strip = _strip(pixels, sky, place, (trail.length_px, trail.angle_deg), saturation_adu)
        if strip is not None:
            strips.append(strip)
        if len(strips) == _MAX_TRAILS:
            break
    if len(strips) < _MIN_TRAILS:
        return None
    slope = float(np.median([strip.slope() for strip in strips]))
    edges = np.arange(0.0, _REACH_PX + _STEP_PX, _STEP_PX)
    sections = np.array([strip.section(slope, edges) for strip in strips])
    is_known = np.isfinite(sections).any(axis=0)
    middle = (0.5 * (edges[1:] + edges[:-1]))[is_known]
    light = np.nanmedian(sections[:, is_known], axis=0)
    light /= 2.0 * np.trapezoid(light, middle)
    core = light > _CORE_SHARE * light[0]
    if np.count_nonzero(core) < _MIN_CORE or not (light[core] > 0.0).all():
        return None
    fall = -float(np.polyfit(middle[core] ** 2, np.log(light[core]), 1)[0])
    if fall <= 0.0:
        return None
    return TrailSection(
        distance_px=middle,
        light=light,
        fwhm_px=max(FWHM_PER_SIGMA * math.sqrt(0.5 / fall), _MIN_FWHM_PX),
        direction_deg=(trail.angle_deg + math.degrees(math.atan(slope))) % 180.0,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Strip:
    """Pixels about one trail's inner part; arrays (n,)."""

    along: FloatArray
    """Distance from the middle along the trail, px."""
    across: FloatArray
    light: FloatArray
    """Light above the sky."""

    def slope(self) -> float:
        """Change of the middle of the light across with the distance along."""
        core = np.abs(self.across) < _CORE_PX
        weight, u, v = np.maximum(self.light[core], 0.0), self.along[core], self.across[core]
        design = np.stack([np.ones(u.size), u])
        fitted = np.linalg.lstsq(design @ (weight * design).T, design @ (weight * v), rcond=None)
        return float(fitted[0][1])

    def section(self, slope: float, edges: FloatArray) -> FloatArray:
        """Median light in bins of the distance from the axis; NaN in empty ones."""
        v = self.across - slope * self.along
        weight = np.where(np.abs(v) < _CORE_PX, np.maximum(self.light, 0.0), 0.0)
        total = float(weight.sum())
        number = np.digitize(np.abs(v - float(weight @ v) / total), edges) - 1
        order = np.argsort(number, kind="stable")
        first = np.searchsorted(number[order], np.arange(edges.size))
        out = np.full(edges.size - 1, np.nan)
        for k in range(edges.size - 1):
            if first[k + 1] > first[k]:
                out[k] = float(np.median(self.light[order[first[k] : first[k + 1]]])) / total
        return out


def _strip(
    pixels: PixelArray,
    sky: Background,
    place_px: tuple[float, float],
    line: tuple[float, float],
    saturation_adu: float,
) -> _Strip | None:
    """Pixels about one trail's inner part.

    ``line``: length, px, and direction, deg. None where the frame or saturation cuts it.
    """
    length, direction = line
    c, s = math.cos(math.radians(direction)), math.sin(math.radians(direction))
    inner = _INNER_SHARE * length
    half_x = math.ceil(inner * abs(c) + _REACH_PX * abs(s)) + 1
    half_y = math.ceil(inner * abs(s) + _REACH_PX * abs(c)) + 1
    x, y = place_px
    left, top = round(x) - half_x, round(y) - half_y
    height, width = pixels.shape
    if left < 0 or top < 0 or left + 2 * half_x >= width or top + 2 * half_y >= height:
        return None
    box = pixels[top : top + 2 * half_y + 1, left : left + 2 * half_x + 1].astype(np.float64)
    dy, dx = np.ogrid[: box.shape[0], : box.shape[1]]
    dx, dy = dx + (left - x), dy + (top - y)
    along, across = c * dx + s * dy, c * dy - s * dx
    near = (np.abs(along) < inner) & (np.abs(across) < _REACH_PX + 1.0)
    light, v = box[near], across[near]
    if float(light.max()) > _SATURATED_SHARE * saturation_adu:
        return None
    light -= sky.at(sky.level, x, y)
    if float(np.maximum(light[np.abs(v) < _CORE_PX], 0.0).sum()) <= 0.0:
        return None
    return _Strip(along[near], v, light)
