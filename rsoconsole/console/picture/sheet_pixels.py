"""A frame's pixels at any scale: means over blocks, made when first needed, drawn as greys.

Beside the frame itself there are maps of a sixteenth of its size and smaller: 4 bytes for each
block of 4 x 4 pixels and a third on top; twice that for the stretch in which faint streaks stand
out.
"""

import math
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from rsoconsole.console.picture.marks import Window
from rsoconsole.console.picture.picture import (
    FLOOR,
    LightImage,
    Stretch,
    cells_for_aspect,
    scale_to_brightness,
)
from rsoconsole.records import PixelArray
from rsoconsole.vision import (
    CODES_PER_SIGMA,
    LOWEST_SIGMA,
    Background,
    FrameMap,
    local_background,
    resample,
)

COARSE = 2
"""Log2 of the side of the smallest blocks that are kept; nearer views read the frame itself."""
CLIPPED_SIGMA = 3.0
"""Sigmas of a coarse block above the sky below which light is drawn dark, to bring out streaks."""
SOFTENING_SIGMAS = 2.0
"""Sigmas above the sky from which on the asinh stretch is about a logarithm."""
OUTSIDE = FLOOR / 2
"""Brightness, 0 to 1, beyond the frame's edge."""
_STRIP_ROWS = 256
Kind = Literal["means", "streaks"]
Edges = npt.NDArray[np.intp]


class FramePixelPyramid:
    """A frame's pixels and means over blocks of them, to be used by one thread at a time."""

    def __init__(self, pixels: PixelArray) -> None:
        self.pixels = pixels
        """Pixels of the frame, (height, width), ADU."""
        self._sky: Background | None = None
        self._levels: dict[tuple[Kind, int], LightImage] = {}

    def prepare_block_means(self) -> None:
        """Make the means that the first view needs, which takes a tenth of a second."""
        self._level("streaks", COARSE)

    @property
    def nbytes(self) -> int:
        """Bytes of the pixels and of all means."""
        return self.pixels.nbytes + sum(level.nbytes for level in self._levels.values())

    def pixel_adu(self, x_px: float, y_px: float) -> float:
        """Return the pixel value at a place, ADU; outside the frame that of the nearest pixel."""
        height, width = self.pixels.shape
        column = min(max(math.floor(x_px + 0.5), 0), width - 1)
        row = min(max(math.floor(y_px + 0.5), 0), height - 1)
        return float(self.pixels[row, column])

    def shares(
        self, window: Window, stretch: Stretch, across: int = 1, down: int = 2
    ) -> LightImage:
        """Return a window's brightness, 0 to 1: (rows * down, columns * across).

        ``across``, ``down``: parts of a cell. The stretch "streaks" brings streaks out of sky and
        noise in views from afar; near views use asinh instead.
        """
        size = window.rows * down, window.columns * across
        px = min(window.width_px / size[1], window.height_px / size[0])
        is_far = px >= 1 << COARSE
        kind: Kind = "streaks" if stretch == "streaks" and is_far else "means"
        light, inside = self._seen(window, size, px, kind)
        if kind == "streaks":
            # By the logarithm: a star's sigmas are hundreds, a streak's a few.
            light = np.log1p(light)
        elif stretch != "linear":
            light = self._compressed(light, px)
        shown = "asinh" if stretch == "streaks" and kind == "means" else stretch
        shares = np.full(size, OUTSIDE, np.float32)
        shares[inside] = scale_to_brightness(light, shown)
        return shares

    def _seen(
        self, window: Window, size: tuple[int, int], px: float, kind: Kind
    ) -> tuple[LightImage, tuple[slice, slice]]:
        """Return means over the squares in the frame, and their slices; ``px``: a square's side."""
        level = max(math.floor(math.log2(px)) - COARSE, COARSE) if px >= 1 << COARSE else 0
        if level:
            near, left_px, top_px = self._level(kind, level), 0, 0
        else:
            near, left_px, top_px = self._piece(window)
        y, x, inside = _edges(window, size, self.pixels.shape, 1 << level)
        y, x = y - top_px, x - left_px
        return np.asarray(_gathered(near, y, x, np.add) / _counts(near, y, x)), inside

    def _piece(self, window: Window) -> tuple[LightImage, int, int]:
        """Return the frame's own pixels in a window, and their first column and row."""
        height, width = self.pixels.shape
        x0, y0 = max(math.floor(window.x0_px + 0.5), 0), max(math.floor(window.y0_px + 0.5), 0)
        x1 = min(math.ceil(window.x0_px + 0.5 + window.width_px), width)
        y1 = min(math.ceil(window.y0_px + 0.5 + window.height_px), height)
        return np.asarray(self.pixels[y0:y1, x0:x1], np.float32), x0, y0

    def _level(self, kind: Kind, level: int) -> LightImage:
        """Return means over blocks of 2**level pixels a side; the last blocks may be cut."""
        made = self._levels.get((kind, level))
        if made is None:
            if level > COARSE:
                made = block_means(self._level(kind, level - 1), 2)
            elif kind == "means":
                made = block_means(self.pixels, 1 << COARSE)
            else:
                made = self._standing_out()
            self._levels[kind, level] = made
        return made

    def _standing_out(self) -> LightImage:
        """Return the light above its sky, in sigmas of a coarse block, less ``CLIPPED_SIGMA``."""
        means, sky = self._level("means", COARSE), self._background
        cell = max(sky.cell_px >> COARSE, 1)
        above = means - resample(sky.level, cell, *means.shape)
        above /= resample(sky.noise, cell, *means.shape) / np.float32(1 << COARSE)
        above -= np.float32(CLIPPED_SIGMA)
        return np.asarray(np.maximum(above, np.float32(0.0), out=above), np.float32)

    @property
    def _background(self) -> Background:
        if self._sky is None:
            self._sky = local_background(self.pixels)
        return self._sky

    def _compressed(self, light: LightImage, px: float) -> LightImage:
        sky = self._background
        level, noise = float(np.median(sky.level)), float(np.median(sky.noise))
        softening = SOFTENING_SIGMAS * noise / max(px, 1.0)
        return np.asarray(np.arcsinh((light - level) / np.float32(softening)), np.float32)


def block_means(pixels: npt.NDArray[np.generic], block: int) -> LightImage:
    """Return the means over blocks of ``block`` x ``block`` pixels.

    For a block cut by the frame's edge, the mean is over the part in the frame.
    """
    import cv2

    height, width = pixels.shape
    across, down = width // block, height // block
    out = np.empty((-(-height // block), -(-width // block)), np.float32)

    def fill(row: int, column: int, rows: int, columns: int) -> None:
        """Fill rows x columns blocks of means from (row, column) on, as far as the frame goes."""
        y, x = slice(row * block, (row + rows) * block), slice(column * block, None)
        piece = np.ascontiguousarray(pixels[y, x][:, : columns * block], np.float32)
        made = cv2.resize(piece, (columns, rows), interpolation=cv2.INTER_AREA)
        out[row : row + rows, column : column + columns] = made

    step = max(_STRIP_ROWS // block, 1)
    strips = [(row, min(step, down - row)) for row in range(0, down, step)]
    strips += [(down, 1)] if height % block else []
    for row, rows in strips:
        if across:
            fill(row, 0, rows, across)
        if width % block:
            fill(row, across, rows, 1)
    return out


def map_brightness(
    frame_map: FrameMap, window: Window, across: int = 1, down: int = 2
) -> LightImage:
    """Return a window of the network's map, brightness 0 to 1: (rows * down, columns * across).

    ``across``, ``down``: parts of a cell of the terminal. Where a part covers several cells of the
    map, the brightest counts.
    """
    size = window.rows * down, window.columns * across
    shape = frame_map.height_px, frame_map.width_px
    y, x, inside = _edges(window, size, shape, frame_map.block)
    seen = _gathered(frame_map.values, y, x, np.maximum).astype(np.float32)
    shares = np.full(size, OUTSIDE, np.float32)
    shares[inside] = np.float32(FLOOR) + seen * np.float32((1 - FLOOR) / 255.0)
    return shares


def map_snr(frame_map: FrameMap, x_px: float, y_px: float) -> float:
    """Return the SNR at a pixel by the network's map, which must be of mode ``fast``."""
    rows, columns = frame_map.values.shape
    row = min(max(int(frame_map.to_cells(y_px)), 0), rows - 1)
    column = min(max(int(frame_map.to_cells(x_px)), 0), columns - 1)
    return float(frame_map.values[row, column]) / CODES_PER_SIGMA + LOWEST_SIGMA


def _edges(
    window: Window, size: tuple[int, int], shape: tuple[int, ...], block: int
) -> tuple[Edges, Edges, tuple[slice, slice]]:
    """Return the edges of the squares down and across, in blocks, and the slices of those inside.

    Only squares that begin in the frame count: ``shape`` is its (height, width) in pixels.
    """
    starts = window.y0_px + 0.5, window.x0_px + 0.5
    lengths = window.height_px, window.width_px
    edges: list[Edges] = []
    inside: list[slice] = []
    for first, length, squares, side in zip(starts, lengths, size, shape, strict=True):
        px = first + length / squares * np.arange(squares + 1)
        count = int(np.count_nonzero(px[:-1] < side - 1e-6))
        edges.append(np.floor(px[: count + 1] / block + 1e-6).astype(np.intp))
        inside.append(slice(0, count))
    return edges[0], edges[1], (inside[0], inside[1])


def _gathered(
    light: npt.NDArray[np.generic], y: Edges, x: Edges, combine: np.ufunc
) -> npt.NDArray[Any]:
    """Return the blocks of each square combined; a square within a block has that block's value."""
    light = light[: max(y[-1], y[-2] + 1), : max(x[-1], x[-2] + 1)]
    return np.asarray(combine.reduceat(combine.reduceat(light, y[:-1], axis=0), x[:-1], axis=1))


def _counts(light: npt.NDArray[np.generic], y: Edges, x: Edges) -> npt.NDArray[np.float32]:
    """Return the number of blocks in each square."""
    down, across = (
        np.maximum(np.diff(np.minimum(edges, side)), 1).astype(np.float32)
        for edges, side in zip((y, x), light.shape, strict=True)
    )
    return np.asarray(down[:, None] * across)


CLOSEST = -2
"""Log2 of the pixels along a square's side in the nearest view: a quarter of a pixel."""
STEPS = (1, 4, 16, 64)
"""Squares that an arrow key moves the cross by, to choose from."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ZoomedFrame:
    """A view of a frame in a grid of cells, each two squares high, with a cross at one place."""

    width_px: int
    height_px: int
    columns: int
    rows: int
    """Rows of cells that there is room for."""
    x_px: float
    y_px: float
    """Row of the cross, pixels; the view centres on the cross where the frame's edge allows."""
    zoom: int | None = None
    """Log2 of the pixels along a square's side; None: the whole frame, as large as fits."""

    @property
    def farthest_zoom(self) -> int:
        """Largest ``zoom`` that does not show the whole frame; below CLOSEST: there is none."""
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
        """Pixels of the frame along one side of a square."""
        return self.width_px / self.window.columns if self.zoom is None else 2.0**self.zoom

    @property
    def window(self) -> Window:
        """The part of the frame in view; it may reach a little beyond the frame's far edges."""
        if self.zoom is None:
            aspect = self.width_px / self.height_px
            columns, rows = cells_for_aspect(aspect, self.columns, self.rows)
            size = float(self.width_px), float(self.height_px)
            return Window.at((-0.5, -0.5), size, (columns, rows))
        scale = 2.0**self.zoom
        all_columns = math.ceil(self.width_px / scale)
        all_squares = math.ceil(self.height_px / scale)
        columns = min(self.columns, all_columns)
        rows = min(self.rows, math.ceil(all_squares / 2))
        column = _first(self.x_px, scale, columns, all_columns)
        square = _first(self.y_px, scale, 2 * rows, all_squares)
        size = columns * scale, 2 * rows * scale
        return Window.at((column * scale - 0.5, square * scale - 0.5), size, (columns, rows))

    def zoomed(self, by: int) -> "ZoomedFrame":
        """Return the view zoomed out by ``by`` factors of two; a negative number zooms in.

        Zooming ends at the nearest view, and at the view of the whole frame.
        """
        farthest = self.farthest_zoom
        if farthest < CLOSEST:
            return replace(self, zoom=None)
        if self.zoom is None:
            return replace(self, zoom=farthest) if by < 0 else self
        zoom = max(self.zoom + by, CLOSEST)
        return replace(self, zoom=None if zoom > farthest else zoom)

    def moved(self, across: float, down: float) -> "ZoomedFrame":
        """Return the view with the cross moved by some squares, kept within the frame."""
        step = self.px_per_square
        return self.at(self.x_px + across * step, self.y_px + down * step)

    def at(self, x_px: float, y_px: float) -> "ZoomedFrame":
        """Return the view with the cross at a place, pixels; a place outside is moved to the
        edge.
        """
        x = min(max(x_px, 0.0), self.width_px - 1.0)
        y = min(max(y_px, 0.0), self.height_px - 1.0)
        return replace(self, x_px=x, y_px=y)

    def zoomed_to_fit(self, wide_px: float, high_px: float) -> "ZoomedFrame":
        """Return the nearest view that shows an area of that size, pixels, about the cross.

        A square is at least one pixel.
        """
        squares = max(wide_px / self.columns, high_px / (2 * self.rows), 1.0)
        zoom = math.ceil(math.log2(squares))
        return replace(self, zoom=None if zoom > self.farthest_zoom else zoom)

    def resized(self, columns: int, rows: int) -> "ZoomedFrame":
        """Return the view in another number of cells, of the whole frame if that fits."""
        other = replace(self, columns=max(columns, 1), rows=max(rows, 1))
        is_all = other.zoom is not None and other.zoom > other.farthest_zoom
        return replace(other, zoom=None) if is_all else other


def whole_frame_view(width_px: int, height_px: int, columns: int, rows: int) -> ZoomedFrame:
    """Return a view of the whole frame, with the cross in its middle."""
    return ZoomedFrame(
        width_px=width_px,
        height_px=height_px,
        columns=max(columns, 1),
        rows=max(rows, 1),
        x_px=float((width_px - 1) // 2),
        y_px=float((height_px - 1) // 2),
    )


def _first(at_px: float, scale: float, count: int, all_of_them: int) -> int:
    """Return the number of the first visible square, with the cross in the middle if possible."""
    return min(max(math.floor((at_px + 0.5) / scale) - count // 2, 0), max(all_of_them - count, 0))
