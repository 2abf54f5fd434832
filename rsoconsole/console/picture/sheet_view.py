"""Which piece of a frame is looked at, and how closely. Pure: no pixels, no terminal."""

import math
from dataclasses import dataclass, replace

from rsoconsole.console.picture.marks import Window
from rsoconsole.console.picture.picture import fitted_cells

CLOSEST = -2
"""Of the powers of two that are pixels a square: a quarter of a pixel."""
STEPS = (1, 4, 16, 64)
"""Squares that the cross goes with one key."""


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """A frame seen through a grid of cells, each two squares high, with a cross at one place."""

    width_px: int
    height_px: int
    columns: int
    rows: int
    """What there is room for."""
    x_px: float
    y_px: float
    """Where the cross is; it is in the middle wherever the frame goes on far enough."""
    zoom: int | None = None
    """Two to this are pixels a square; None: the whole frame in the most cells that fit."""

    @property
    def farthest(self) -> int:
        """The largest zoom at which not all of the frame is seen; below CLOSEST there is none."""
        zoom = 0
        while self._has_room(zoom) and zoom >= CLOSEST:
            zoom -= 1
        while not self._has_room(zoom + 1):
            zoom += 1
        return zoom

    def _has_room(self, zoom: int) -> bool:
        scale = 2.0**zoom
        fits_across = math.ceil(self.width_px / scale) <= self.columns
        return fits_across and math.ceil(self.height_px / scale) <= 2 * self.rows

    @property
    def px_per_square(self) -> float:
        """Pixels along one side of a square."""
        return self.width_px / self.window.columns if self.zoom is None else 2.0**self.zoom

    @property
    def window(self) -> Window:
        """The piece that is seen; it may reach a little beyond the frame's far edges."""
        if self.zoom is None:
            aspect = self.width_px / self.height_px
            columns, rows = fitted_cells(aspect, self.columns, self.rows)
            size = float(self.width_px), float(self.height_px)
            return _window(-0.5, -0.5, size, columns, rows)
        scale = 2.0**self.zoom
        all_columns = math.ceil(self.width_px / scale)
        all_squares = math.ceil(self.height_px / scale)
        columns = min(self.columns, all_columns)
        rows = min(self.rows, math.ceil(all_squares / 2))
        column = _first(self.x_px, scale, columns, all_columns)
        square = _first(self.y_px, scale, 2 * rows, all_squares)
        size = columns * scale, 2 * rows * scale
        return _window(column * scale - 0.5, square * scale - 0.5, size, columns, rows)

    def zoomed(self, by: int) -> "View":
        """Nearer (below 0) or farther, about the cross; beyond the ends nothing changes."""
        farthest = self.farthest
        if farthest < CLOSEST:
            return replace(self, zoom=None)
        if self.zoom is None:
            return replace(self, zoom=farthest) if by < 0 else self
        zoom = max(self.zoom + by, CLOSEST)
        return replace(self, zoom=None if zoom > farthest else zoom)

    def moved(self, across: float, down: float) -> "View":
        """With the cross moved by some squares; it stays in the frame."""
        step = self.px_per_square
        return self.at(self.x_px + across * step, self.y_px + down * step)

    def at(self, x_px: float, y_px: float) -> "View":
        """With the cross at that pixel, or at the nearest one that there is."""
        x = min(max(x_px, 0.0), self.width_px - 1.0)
        y = min(max(y_px, 0.0), self.height_px - 1.0)
        return replace(self, x_px=x, y_px=y)

    def showing(self, wide_px: float, high_px: float) -> "View":
        """As near as so much has room about the cross; never nearer than pixel by pixel."""
        squares = max(wide_px / self.columns, high_px / (2 * self.rows), 1.0)
        zoom = math.ceil(math.log2(squares))
        return replace(self, zoom=None if zoom > self.farthest else zoom)

    def resized(self, columns: int, rows: int) -> "View":
        """In another terminal; where all of it has room now, all of it is seen."""
        other = replace(self, columns=max(columns, 1), rows=max(rows, 1))
        is_all = other.zoom is not None and other.zoom > other.farthest
        return replace(other, zoom=None) if is_all else other


def whole(width_px: int, height_px: int, columns: int, rows: int) -> View:
    """All of a frame, with the cross in its middle."""
    return View(
        width_px=width_px,
        height_px=height_px,
        columns=max(columns, 1),
        rows=max(rows, 1),
        x_px=float((width_px - 1) // 2),
        y_px=float((height_px - 1) // 2),
    )


def _first(at_px: float, scale: float, count: int, all_of_them: int) -> int:
    """Number of the first square that is seen, with the cross in the middle where that can be."""
    return min(max(math.floor((at_px + 0.5) / scale) - count // 2, 0), max(all_of_them - count, 0))


def _window(x0: float, y0: float, size: tuple[float, float], columns: int, rows: int) -> Window:
    return Window(
        x0_px=x0, y0_px=y0, width_px=size[0], height_px=size[1], columns=columns, rows=rows
    )
