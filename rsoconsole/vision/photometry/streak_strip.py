"""Pixels beside a streak, in coordinates along and across it, without interpolation."""

import math
from dataclasses import dataclass

import numpy as np

from rsoconsole.records import FloatArray, PixelArray
from rsoconsole.vision.arrays import Float32Array, IndexArray
from rsoconsole.vision.frame.background import Background
from rsoconsole.vision.lines.segments import Ends, length_of


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StreakStrip:
    """Pixels within a distance of a streak and a margin beyond its ends; arrays (n,)."""

    x_px: FloatArray
    y_px: FloatArray
    u_px: FloatArray
    """Distance along the streak from end a."""
    v_px: FloatArray
    """Distance across it."""
    light_adu: FloatArray
    """Above the sky's level at the streak's middle, ADU."""
    noise_adu: float
    """One sigma of a pixel."""
    length_px: float
    margin_px: float
    half_px: float
    brightest_adu: float
    """Brightest pixel on the streak as read out, ADU."""
    ends: Ends

    @classmethod
    def of(
        cls, pixels: PixelArray, sky: Background, ends: Ends, half_px: float, margin_px: float
    ) -> "StreakStrip | None":
        """Gather the pixels about the line between ``ends``; None where they are too few."""
        length = max(length_of(ends), 1e-3)
        dx, dy = (ends[2] - ends[0]) / length, (ends[3] - ends[1]) / length
        is_steep = abs(dy) > abs(dx)
        height, width = pixels.shape
        # Along the longer axis one step a pixel, and the same number of pixels beside it at each.
        main, cross = (dy, dx) if is_steep else (dx, dy)
        first, across = (ends[1], ends[0]) if is_steep else (ends[0], ends[1])
        low = min(first, first + main * length) - margin_px * abs(main)
        high = max(first, first + main * length) + margin_px * abs(main)
        at = np.arange(math.floor(low), math.ceil(high) + 1)
        middle = np.rint(across + (at - first) * cross / main).astype(int)
        reach = math.ceil(half_px / abs(main)) + 1
        beside = middle[:, None] + np.arange(-reach, reach + 1)
        along = np.broadcast_to(at[:, None], beside.shape)
        y, x = (along, beside) if is_steep else (beside, along)
        u = (x - ends[0]) * dx + (y - ends[1]) * dy
        v = (y - ends[1]) * dx - (x - ends[0]) * dy
        is_in = (x >= 0) & (x < width) & (y >= 0) & (y < height)
        is_in &= (np.abs(v) <= half_px) & (u >= -margin_px) & (u <= length + margin_px)
        if int(is_in.sum()) < 60:
            return None
        x, y, u, v = x[is_in], y[is_in], u[is_in], v[is_in]
        raw = pixels[y, x].astype(np.float64)
        centre = 0.5 * (ends[0] + ends[2]), 0.5 * (ends[1] + ends[3])
        on_it = (np.abs(v) < 2.0) & (u > 0.0) & (u < length)
        return cls(
            x_px=x.astype(np.float64),
            y_px=y.astype(np.float64),
            u_px=u,
            v_px=v,
            light_adu=raw - sky.at(sky.level, *centre),
            noise_adu=max(sky.at(sky.noise, *centre), 1e-6),
            length_px=length,
            margin_px=margin_px,
            half_px=half_px,
            brightest_adu=float(raw[on_it].max()) if on_it.any() else 0.0,
            ends=ends,
        )

    def to_strip_px(self, places_px: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return (u, v) of places (n, 2) in the frame."""
        x_a, y_a, x_b, y_b = self.ends
        dx, dy = (x_b - x_a) / self.length_px, (y_b - y_a) / self.length_px
        x, y = places_px[:, 0] - x_a, places_px[:, 1] - y_a
        return x * dx + y * dy, y * dx - x * dy

    def to_frame_px(self, u_px: float, v_px: float) -> tuple[float, float]:
        """Return the place in the frame at (u, v)."""
        x_a, y_a, x_b, y_b = self.ends
        dx, dy = (x_b - x_a) / self.length_px, (y_b - y_a) / self.length_px
        return x_a + u_px * dx - v_px * dy, y_a + u_px * dy + v_px * dx

    def bins(self) -> tuple[IndexArray, int]:
        """Return the column of one pixel of length in which each pixel lies, and their number."""
        first = -math.ceil(self.margin_px)
        column = np.rint(self.u_px).astype(np.intp) - first
        return column, int(math.ceil(self.length_px + self.margin_px) - first + 1)

    def raster(self, values: FloatArray) -> tuple[Float32Array, Float32Array]:
        """Return (mean values, number of pixels) on a raster of 1 px: rows across, columns along.

        Row 0 lies ``ceil(half_px)`` to the negative side, column 0 ``ceil(margin_px)`` before a.
        """
        column, count = self.bins()
        row = np.rint(self.v_px).astype(int) + math.ceil(self.half_px)
        rows = 2 * math.ceil(self.half_px) + 1
        flat = np.clip(row, 0, rows - 1) * count + np.clip(column, 0, count - 1)
        number = np.bincount(flat, minlength=rows * count).reshape(rows, count)
        total = np.bincount(flat, values, minlength=rows * count).reshape(rows, count)
        mean = total / np.maximum(number, 1)
        return mean.astype(np.float32), number.astype(np.float32)
