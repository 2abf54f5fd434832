"""Pixels about a line, turned so that it runs along the rows, and its light profile.

Listed stars are masked and the sky beside the line is subtracted; the rest is summed across the
line with the frame's own point-spread function as weight.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from rsoconsole.records import FloatArray, PixelArray
from rsoconsole.vision.arrays import BoolArray, Float32Array, IndexArray
from rsoconsole.vision.frame.background import Background
from rsoconsole.vision.frame.median import median_of
from rsoconsole.vision.lines.segments import Ends
from rsoconsole.vision.stars.star_list import StarList, lit_radius_px

OFF_PX = 9.0
"""Largest distance of a true line from the proposed one, px, at its middle and at its ends."""
INTERPOLATED_VARIANCE = 1.0 / 6.0
"""Variance that linear interpolation adds across, px^2."""
_BEYOND, _MIN_BEYOND_PX = 0.35, 40.0
_ON_LINE_PX, _FLASHES, _FLASHED_SHARE, _LISTED_SHARE = 4.0, 3, 0.25, 0.45
MIN_KNOWN = 0.4
"""Share of a column's weight that must be unmasked to measure the line there."""
_SKY_PX, _SKY_LIMIT = 41, 3.0
_SMALLEST = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class LineStrip:
    """Pixels about a line, turned so that the line runs along the rows."""

    values: Float32Array
    """(2 reach + 1, columns) light above the sky, in units of a pixel's noise."""
    is_good: BoolArray
    x0_px: float
    """Column of the frame at the strip's column 0 and middle row (``reach``)."""
    y0_px: float
    dx: float
    dy: float
    reach: int
    is_cut: tuple[bool, bool]
    """True at the first, at the last column: the strip ends there with the frame."""

    @property
    def columns(self) -> IndexArray:
        """Indices of the columns, from 0."""
        return np.arange(self.values.shape[1])

    @property
    def rows(self) -> Float32Array:
        """(2 reach + 1, 1) rows, counted from the middle one."""
        return np.arange(-self.reach, self.reach + 1, dtype=np.float32)[:, None]

    def at(self, u: float, v: float) -> tuple[float, float]:
        """Convert a place in the strip (``u`` along, ``v`` across, px) to a pixel of the frame."""
        return self.x0_px + u * self.dx - v * self.dy, self.y0_px + u * self.dy + v * self.dx


@dataclass(frozen=True, slots=True)
class StripLine:
    """Straight line in a strip: slope, row offset at column ``middle``, and their errors."""

    middle: float
    offset: float
    slope: float
    sigma_offset: float
    sigma_slope: float

    def at(self, columns: IndexArray | FloatArray | float) -> FloatArray:
        """Rows of the line at these columns, counted from the strip's middle row."""
        return np.asarray(self.offset + self.slope * (np.asarray(columns) - self.middle))


class StripPath(Protocol):
    """Path of light in a strip, straight or not."""

    def at(self, columns: IndexArray) -> FloatArray:
        """Rows of the path at these columns, counted from the strip's middle row."""
        ...


def cut_out_strip(
    pixels: PixelArray, sky: Background, ends: Ends, stars: StarList, sigma: float
) -> LineStrip | None:
    """Cut out and turn the pixels about a line between ``ends``, with listed stars masked.

    The strip extends beyond either end by 35 % of the length, at least 40 px, but not beyond the
    frame. ``sigma``: of the stars, px. None where the line is too short or hardly in the frame.
    """
    import cv2

    x_a, y_a, x_b, y_b = ends
    length = math.hypot(x_b - x_a, y_b - y_a)
    if length < 4.0:
        return None
    dx, dy = (x_b - x_a) / length, (y_b - y_a) / length
    height, width = pixels.shape
    more = max(_BEYOND * length, _MIN_BEYOND_PX)
    low, high = wanted = -more, length + more
    for start, rate, size in ((x_a, dx, width), (y_a, dy, height)):
        if abs(rate) > 1e-6:
            rim = sorted(((0.0 - start) / rate, (size - 1 - start) / rate))
            low, high = max(low, rim[0]), min(high, rim[1])
    count = int(high - low)
    if count < 8:
        return None
    reach = math.ceil(OFF_PX + 4.0 * sigma)
    x0, y0 = x_a + low * dx, y_a + low * dy
    turned = np.array([[dx, -dy, x0 + reach * dy], [dy, dx, y0 - reach * dx]], dtype=np.float64)
    size = (count, 2 * reach + 1)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    # Only what lies about the line: OpenCV's warp takes at most 32,767 pixels a side.
    values = cv2.warpAffine(
        pixels, turned, size, flags=flags, borderMode=cv2.BORDER_REFLECT_101
    ).astype(np.float32)
    u = np.arange(count, dtype=np.float32)
    cells_x = ((x0 + u * dx + 0.5) / sky.cell_px - 0.5).astype(np.float32)[None]
    cells_y = ((y0 + u * dy + 0.5) / sky.cell_px - 0.5).astype(np.float32)[None]
    level, noise = (
        cv2.remap(small, cells_x, cells_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        for small in (sky.level, sky.noise)
    )
    values -= level
    values /= np.maximum(noise, _SMALLEST)
    is_there = np.ones(values.shape, dtype=bool)
    for start, along, across, edge in ((x0, dx, -dy, width), (y0, dy, dx, height)):
        corners = [start + i * along + j * across for i in (0, count - 1) for j in (-reach, reach)]
        if min(corners) < -0.5 or max(corners) > edge - 0.5:
            place = start + u * along + np.arange(-reach, reach + 1)[:, None] * across
            is_there &= (place >= -0.5) & (place <= edge - 0.5)
    strip = LineStrip(values, is_there, x0, y0, dx, dy, reach, (low > wanted[0], high < wanted[1]))
    _mask_stars(strip, stars, median_of(noise), -low, length - low)
    return strip


def _mask_stars(
    strip: LineStrip, stars: StarList, noise: float, first_px: float, last_px: float
) -> None:
    """Mask the pixels that listed stars light.

    Unless enough lie on the line to be its flashes, or between its ends, at these columns, there is
    little else: a short streak is on the list of stars itself.
    """
    off_x, off_y = stars.x_px - strip.x0_px, stars.y_px - strip.y0_px
    along, across = off_x * strip.dx + off_y * strip.dy, off_y * strip.dx - off_x * strip.dy
    columns = strip.values.shape[1]
    half_trail = 0.5 * stars.trail.length_px if stars.trail is not None else 0.0
    room = 40.0 + half_trail
    near = (along > -room) & (along < columns + room) & (np.abs(across) < strip.reach + room)
    if not near.any():
        return
    tilt = 0.0
    if stars.trail is not None:
        tilt = math.radians(stars.trail.angle_deg) - math.atan2(strip.dy, strip.dx)
    v = np.arange(-strip.reach, strip.reach + 1)[:, None]
    radii = lit_radius_px(stars, noise)
    on_line = near & (np.abs(across) < _ON_LINE_PX) & (along > 0.0) & (along < columns)
    is_flashing = on_line.sum() >= _FLASHES
    between = on_line & (along > first_px) & (along < last_px)
    is_short = 2.0 * radii[between].sum() > _LISTED_SHARE * (last_px - first_px)
    if is_short or (is_flashing and 2.0 * radii[on_line].sum() > _FLASHED_SHARE * columns):
        near &= ~on_line
    for i in np.flatnonzero(near).tolist():
        radius = radii[i] + 0.5
        size = radius + half_trail
        first, last = int(along[i] - size), int(along[i] + size) + 2
        first, last = max(first, 0), min(last, columns)
        if first >= last:
            continue
        du, dv = np.arange(first, last) - along[i], v - across[i]
        if half_trail:
            cos, sin = math.cos(tilt), math.sin(tilt)
            along_trail, across_trail = du * cos + dv * sin, dv * cos - du * sin
            beyond = np.maximum(np.abs(along_trail) - half_trail, 0.0)
            strip.is_good[:, first:last] &= beyond**2 + across_trail**2 > radius**2
        else:
            strip.is_good[:, first:last] &= du**2 + dv**2 > radius**2


def subtract_sky_beside(strip: LineStrip, course: StripLine, sigma: float) -> None:
    """Subtract from a strip, in place, the light beside the line: glow, a bright star's wings."""
    import cv2

    v = np.arange(-strip.reach, strip.reach + 1, dtype=np.float32)[:, None]
    away = np.abs(v - course.at(strip.columns).astype(np.float32))
    beside = ((away > 3.5 * sigma + 1.0) & strip.is_good).astype(np.float32)
    light = (np.clip(strip.values, -_SKY_LIMIT, _SKY_LIMIT) * beside).sum(axis=0)
    count = beside.sum(axis=0)
    window = (_SKY_PX, 1)
    light, count = (
        cv2.blur(each[None], window, borderType=cv2.BORDER_REFLECT_101)[0]
        for each in (light, count)
    )
    strip.values[:] -= light / np.maximum(count, 1.0)


def rows_about(reach: int, paths: Float32Array, sigma: float) -> slice:
    """Rows of a strip within five sigma of paths' rows (any shape), counted from its middle."""
    room = 5.0 * sigma
    first, last = float(paths.min()) - room, float(paths.max()) + room
    return slice(max(math.floor(first + reach), 0), max(math.ceil(last + reach) + 1, 0))


def gaussian_across(off: Float32Array, sigma: float) -> Float32Array:
    """Return the weight of pixels ``off`` px beside a path: a Gaussian whose sum is 1."""
    scaled = off / np.float32(sigma)
    scaled *= scaled
    scaled *= np.float32(-0.5)
    weight: Float32Array = np.exp(scaled, out=scaled)
    weight /= np.float32(math.sqrt(2 * math.pi) * sigma)
    return weight


@dataclass(frozen=True, kw_only=True, eq=False)
class LineProfile:
    """Light along a line, per pixel of length, in sigmas of a pixel's noise."""

    light: FloatArray
    """Light per pixel of length; 0 where it is not known."""
    error: FloatArray
    """One sigma of the light; infinite where masked stars hide the line."""
    sigma: float
    """Sigma of the Gaussian across to which the light is matched, px."""

    @cached_property
    def columns(self) -> IndexArray:
        """Places along the line, px."""
        return np.arange(self.light.size)

    @cached_property
    def is_known(self) -> BoolArray:
        """True for the columns in which the line is not hidden."""
        return np.isfinite(self.error)

    def is_known_between(self, first: float, last: float) -> BoolArray:
        """Return True for the columns between two places, px, where the light is known."""
        between = np.zeros(self.light.size, dtype=bool)
        inside = slice(max(math.ceil(first), 0), max(math.floor(last) + 1, 0))
        between[inside] = self.is_known[inside]
        return between


def profile_of(strip: LineStrip, course: StripPath, sigma: float) -> LineProfile:
    """Measure the light of a strip along a path in it, matched across to ``sigma`` px."""
    path = course.at(strip.columns).astype(np.float32)
    light, error = light_along(strip.values, strip.is_good, path, sigma)
    return LineProfile(light=light, error=error, sigma=sigma)


def light_along(
    values: Float32Array, is_good: BoolArray, paths: Float32Array, sigma: float
) -> tuple[FloatArray, FloatArray]:
    """Light per pixel of length along paths (..., columns) in a strip, and its error.

    As in ``LineProfile``.
    """
    reach = values.shape[0] // 2
    rows = rows_about(reach, paths, sigma)
    v = np.arange(-reach, reach + 1, dtype=np.float32)[rows, None]
    weight = gaussian_across(v - paths[..., None, :], sigma)
    known = weight * is_good[rows]
    light = (known * values[rows]).sum(axis=-2).astype(np.float64)
    known *= weight
    share = known.sum(axis=-2).astype(np.float64)
    is_known = share > MIN_KNOWN / (2.0 * math.sqrt(math.pi) * sigma)
    share = np.maximum(share, _SMALLEST)
    return np.where(is_known, light / share, 0.0), np.where(is_known, 1.0 / np.sqrt(share), np.inf)
