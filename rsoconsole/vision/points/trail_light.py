"""Light of star trails at every pixel, from the pixels before and behind it along the trails.

All trails of a frame are parallel and longer than the two windows, so that within a trail, also
near its end, at least one of the windows lies on it; a point is in neither. No list of the stars is
needed, and no law of their image: what is alike along the trails goes.
"""

import math
from dataclasses import dataclass

import numpy as np

from rsoconsole.records import FloatArray
from rsoconsole.vision.arrays import Float32Array

MIN_TRAIL_FWHM = 8.0
"""Least length of trails, by the width of a star, among which points are told."""
_GAP_FWHM, _STEP_FWHM = 2.2, 1.15
"""Distance of the nearest sample from the pixel, and between samples, by the width of a star."""
_SAMPLES = 5
_LENGTH_SHARE = 0.45
"""Largest distance of a sample, by the length of the trails."""
_ALIKE_SIGMA, _UNLIKE_SIGMA = 1.5, 2.5
"""Differences of the windows by noise alone, and surely not; in sigma of the filtered sky."""
_BAND_ROWS = 64
_OUTSIDE, _UNKNOWN = np.float32(-1e6), np.float32(-1e5)
_MIN_TILT_PX = 0.02


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrailLight:
    """A frame sheared so that trails lie along its rows, without them; arrays (rows, width)."""

    points: Float32Array
    """Light that is left; exactly 0 outside the frame."""
    trails: Float32Array
    """Light of the trails."""
    meeting: Float32Array
    """Largest light that is left where two trails' ends meet here; 0 where none do. Infinite near
    the frame's rim, where what lies beyond it may be a trail that ends here."""
    slope: float
    """Rows by which a trail climbs in each column."""
    first_row: float
    """Row of the frame at column 0 of row 0."""
    is_swapped: bool
    """Whether columns and rows of the frame are exchanged."""

    def frame_places(self, column: FloatArray, row: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Convert places here to (x_px, y_px) of the frame."""
        along, across = column, row + self.first_row + self.slope * column
        return (across, along) if self.is_swapped else (along, across)

    def frame_slopes(
        self, by_column: Float32Array, by_row: Float32Array
    ) -> tuple[Float32Array, Float32Array]:
        """Convert derivatives by column and row here to those by x and y of the frame."""
        along, across = by_column - self.slope * by_row, by_row
        return (across, along) if self.is_swapped else (along, across)


def without_trails(
    light: Float32Array, *, fwhm_px: float, length_px: float, direction_deg: float
) -> TrailLight | None:
    """Separate points from trails; None where the trails are too short.

    ``light``: (height, width), filtered by the image of a point, in sigma of that.
    """
    gap = max(round(_GAP_FWHM * fwhm_px), 2)
    farthest = _LENGTH_SHARE * length_px
    step = min(round(_STEP_FWHM * fwhm_px), int((farthest - gap) / (_SAMPLES - 1)))
    if step < 1 or length_px < MIN_TRAIL_FWHM * fwhm_px:
        return None
    import cv2

    c, s = math.cos(math.radians(direction_deg)), math.sin(math.radians(direction_deg))
    is_swapped = abs(s) > abs(c)
    slope = c / s if is_swapped else s / c
    sheared, first_row = _sheared(np.ascontiguousarray(light.T) if is_swapped else light, slope)
    rows, width = sheared.shape
    reach = gap + (_SAMPLES - 1) * step
    wide = cv2.copyMakeBorder(
        sheared, 0, 0, reach, reach, cv2.BORDER_CONSTANT, value=float(_OUTSIDE)
    )
    points, trails, meeting = (np.empty_like(sheared) for _ in range(3))
    places = [gap + k * step for k in range(_SAMPLES)]
    for top in range(0, rows, _BAND_ROWS):
        band = slice(top, top + _BAND_ROWS)
        piece = wide[band]
        before = _median_of_five([piece[:, reach - d : reach - d + width] for d in places])
        behind = _median_of_five([piece[:, reach + d : reach + d + width] for d in places])
        apart = np.abs(before - behind)
        brighter, fainter = np.maximum(before, behind), np.minimum(before, behind)
        trails[band] = np.where(apart < _ALIKE_SIGMA, 0.5 * (before + behind), brighter)
        np.subtract(sheared[band], trails[band], out=points[band])
        # Outside, and in corners that both windows reach beyond, nothing is known.
        points[band][(brighter < _UNKNOWN) | (sheared[band] < _UNKNOWN)] = 0.0
        meeting[band] = np.where(apart > _UNLIKE_SIGMA, np.maximum(fainter, 0.0), 0.0)
        meeting[band][fainter < _UNKNOWN] = np.inf
    return TrailLight(
        points=points,
        trails=trails,
        meeting=meeting,
        slope=slope,
        first_row=first_row,
        is_swapped=is_swapped,
    )


def _sheared(light: Float32Array, slope: float) -> tuple[Float32Array, float]:
    """Shift each column so that lines of a slope lie along rows; the row of the frame at (0, 0)."""
    import cv2

    height, width = light.shape
    if abs(slope) * width < _MIN_TILT_PX:
        return light, 0.0
    climb = slope * (width - 1)
    first_row = -float(math.ceil(max(climb, 0.0)))
    rows = height + math.ceil(abs(climb))
    inverse = np.array([[1.0, 0.0, 0.0], [slope, 1.0, first_row]])
    sheared: Float32Array = cv2.warpAffine(
        light,
        inverse,
        (width, rows),
        flags=cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REPLICATE,
    )
    row = np.arange(rows, dtype=np.float32)[:, None] + np.float32(first_row)
    y = row + np.float32(slope) * np.arange(width, dtype=np.float32)
    sheared[(y < 0.0) | (y > height - 1)] = _OUTSIDE
    return sheared, first_row


def _median_of_five(parts: list[Float32Array]) -> Float32Array:
    """Median of five arrays, element by element."""
    a, b, c, d, e = parts
    low, high = np.minimum, np.maximum
    f, g = high(low(a, b), low(c, d)), low(high(a, b), high(c, d))
    return np.asarray(high(low(f, g), low(high(f, g), e)))
