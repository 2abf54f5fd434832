"""Pictures drawn by the terminal's own graphics: Kitty's protocol or sixels.

textual-image sends them; marks are painted into the picture.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

from rsoconsole.config import Graphics
from rsoconsole.console.drawing.blocks import BY_NAME, QUADRANTS, BlockSet
from rsoconsole.console.drawing.terminal_query import finest_blocks, query_terminal
from rsoconsole.console.picture.marks import Mark, Window

if TYPE_CHECKING:
    from textual.widget import Widget

GraphicsKind = Literal["kitty", "sixel"]
Colour = tuple[int, int, int]

RedGreenBlue = npt.NDArray[np.uint8]
"""Image array, (height, width, 3): red, green, blue."""

MARGIN_PX = 6
CROSS_GAP_PX = 4
FONT_SCALE, FONT_ROOM_PX = 0.42, 4


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawingMode:
    """How pictures are drawn in a terminal."""

    graphics: GraphicsKind | None = None
    """The terminal's own graphics; None: characters draw pictures."""
    blocks: BlockSet = QUADRANTS
    """The block characters, where there are no graphics."""


def choose_drawing_mode(wanted: Graphics) -> DrawingMode:
    """Return how to draw pictures: as wanted, or the finest way that the terminal has.

    May ask the terminal, so it must be called before the application runs.
    """
    if wanted in BY_NAME:
        return DrawingMode(blocks=BY_NAME[wanted])
    if wanted == "kitty" or wanted == "sixel":  # noqa: PLR1714 -- mypy narrows only this
        drawn = DrawingMode(graphics=wanted)
    else:
        terminal = query_terminal()
        found: GraphicsKind | None = (
            "kitty" if terminal.has_kitty else "sixel" if terminal.has_sixel else None
        )
        kind = found if wanted == "auto" else None
        drawn = DrawingMode(graphics=kind, blocks=finest_blocks(terminal))
    if drawn.graphics is not None:
        # Importing it asks the terminal for the size of its cells, which is not possible later.
        from textual_image import widget

        _ = widget
    return drawn


def image_widget(kind: GraphicsKind) -> "Widget":
    """Return a widget that shows its attribute ``image`` by these graphics."""
    from textual_image.widget import SixelImage, TGPImage

    image: Widget = TGPImage() if kind == "kitty" else SixelImage()
    return image


def cell_size_px() -> tuple[int, int]:
    """Return the width and height of a terminal's cell in pixels."""
    from textual_image.widget import get_cell_size

    size = get_cell_size()
    return size.width, size.height


def paint_picture(
    grey: npt.NDArray[np.float32],
    window: Window,
    marks: tuple[Mark, ...],
    colours: Mapping[str, Colour],
    *,
    cell: tuple[int, int],
    is_red: bool = False,
) -> Any:
    """Return a PIL image as large as the window's cells, with the marks painted over it.

    ``grey``: (height, width), 0 to 1.
    ``colours``: (red, green, blue) by the kind of mark.
    ``cell``: width and height of a cell, pixels.
    ``is_red``: True for reds instead of greys, as in the night theme.
    """
    import cv2
    from PIL import Image

    size = window.columns * cell[0], window.rows * cell[1]
    shrinks = size[0] < grey.shape[1]
    scaled = cv2.resize(grey, size, interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_NEAREST)
    weights = (0.75, 0.12, 0.06) if is_red else (1.0, 1.0, 1.0)
    light = np.clip(scaled, 0.0, 1.0)[..., None] * 255.0 * np.array(weights)
    canvas = np.ascontiguousarray(light.astype(np.uint8))
    for mark in marks:
        _draw(canvas, mark, window, colours)
    return Image.fromarray(canvas)


def _draw(canvas: RedGreenBlue, mark: Mark, window: Window, colours: Mapping[str, Colour]) -> None:
    import cv2

    colour = colours.get(mark.kind, (255, 255, 255))

    def at(x_px: float, y_px: float) -> tuple[int, int]:
        height, width = canvas.shape[:2]
        x = (x_px - window.x0_px) / window.width_px * width
        y = (y_px - window.y0_px) / window.height_px * height
        return round(x), round(y)

    x, y = at(mark.x_px, mark.y_px)
    if mark.outline_px:
        points = np.array([at(*point) for point in mark.outline_px], np.int32)
        cv2.polylines(canvas, [points], True, colour, 1, cv2.LINE_AA)
    if mark.kind == "box":
        return
    if mark.kind in {"predicted", "coasted", "cursor"}:
        # Open in its middle: what lies there is what one wants to see.
        gap, arm = CROSS_GAP_PX, CROSS_GAP_PX + MARGIN_PX * (1 + (mark.kind == "cursor"))
        for side in (-1, 1):
            cv2.line(canvas, (x + side * gap, y), (x + side * arm, y), colour, 1)
            cv2.line(canvas, (x, y + side * gap), (x, y + side * arm), colour, 1)
        label_at = (x + arm + FONT_ROOM_PX, y)
    else:
        ends = mark.ends_px or ((mark.x_px, mark.y_px),) * 2
        corners = np.array([at(*end) for end in ends])
        margin = 2 * MARGIN_PX if mark.is_outer else MARGIN_PX
        low, high = corners.min(axis=0) - margin, corners.max(axis=0) + margin
        left_top, right_bottom = (int(low[0]), int(low[1])), (int(high[0]), int(high[1]))
        cv2.rectangle(canvas, left_top, right_bottom, colour, 1)
        label_at = (right_bottom[0] + FONT_ROOM_PX, right_bottom[1])
    if mark.label:
        font, ink = cv2.FONT_HERSHEY_SIMPLEX, colours.get(mark.number_kind or "", colour)
        cv2.putText(canvas, mark.label, label_at, font, FONT_SCALE, ink, 1, cv2.LINE_AA)
