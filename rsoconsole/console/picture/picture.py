"""A frame's small pictures, drawn as greys into the cells of a terminal.

A cell is two squares high. The session keeps a small picture of the whole frame and a close-up.
"""

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from rsoconsole.console.drawing.blocks import QUADRANTS, BlockSet
from rsoconsole.console.picture.marks import Mark, Window, frame_marks
from rsoconsole.night import NightFrame
from rsoconsole.records import ChartStar, Closeup
from rsoconsole.session import SessionReader, decode_preview_stars

GREYS = 24
"""Steps of grey: enough for the eye, few enough that neighbouring cells share one."""
FLOOR = 0.08
"""Brightness of the empty sky, 0 to 1, so that the picture's edge is visible."""

SKY_BLOCK_PX = 24
NOISE_SIGMAS = 6.0
DARK_PERCENT, BRIGHT_PERCENT = 50.0, 99.7
BRIGHTEST_SHARE = 0.5
LOOSE = 1.2
"""Most by which a chart is drawn wider or higher than the frame's shape: terminals differ by it."""
MARGIN = 1.3
"""Size of a close-up as a factor on the size of its streak."""

ByteImage = npt.NDArray[np.uint8]
LightImage = npt.NDArray[np.float32]

Stretch = Literal["streaks", "asinh", "linear"]
STRETCHES: tuple[Stretch, ...] = ("streaks", "asinh", "linear")
Look = Literal["chart"] | Stretch
LOOKS: tuple[Look, ...] = ("chart", *STRETCHES)
"""Ways to draw the field: as a chart of its stars, or its pixels by one of the stretches."""
_PERCENT: dict[Stretch, tuple[float, float]] = {
    "streaks": (DARK_PERCENT, BRIGHT_PERCENT),
    "asinh": (2.0, 99.8),
    "linear": (2.0, 99.5),
}
"""Percentiles of the squares' light that are drawn darkest and brightest."""
_MIN_RANGE = 0.02
"""Least range of light between darkest and brightest: the noise of an empty picture stays dark."""
_LINEAR_PER_CODE = 5.0 / 255.0
"""The small pictures are asinh of light over two sigmas, from -1 to 4 in 255 steps."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Picture:
    """A frame's small pictures, with its record and its marks."""

    frame_id: int
    codes: ByteImage
    """The whole frame's small picture as the session keeps it, (height, width); row 0 on top."""
    light: LightImage
    """The small picture above sky and noise, (height, width)."""
    detail: NightFrame
    marks: tuple[Mark, ...] = ()
    closeup: ByteImage | None = None
    """The close-up: a part of the frame at full resolution; None: none is kept."""
    place: Closeup | None = None
    """Where in the frame the close-up is; None: none is kept."""
    stars: tuple[ChartStar, ...] | None = None
    """The frame's brightest stars; None: not known, so there is no chart."""

    @property
    def has_chart(self) -> bool:
        """True where the field can be drawn as a chart."""
        return self.stars is not None and self.detail.detections is not None

    @property
    def aspect(self) -> float:
        """Width of the frame over its height."""
        return float(self.codes.shape[1] / self.codes.shape[0])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DrawnPicture:
    """A picture drawn into cells."""

    greys: ByteImage
    """Steps of grey, 0 to GREYS - 1: (blocks.down * rows, blocks.across * columns)."""
    blocks: BlockSet
    window: Window
    px_per_square: float
    """Pixels of the frame along a square: across a cell, or down half a cell."""


def decode_preview(coded: bytes) -> ByteImage | None:
    """Decode a small picture of a session, (height, width); None where it is not whole (yet)."""
    import cv2

    try:
        given = np.frombuffer(coded, np.uint8)
        pixels: Any = cv2.imdecode(given, cv2.IMREAD_GRAYSCALE) if given.size else None
    except cv2.error:
        return None
    if pixels is None or min(pixels.shape) < SKY_BLOCK_PX:
        return None
    return np.asarray(pixels, np.uint8)


def _read(path: Path | None) -> bytes:
    """Return a file's bytes; empty where there is none, or it cannot be read (yet)."""
    try:
        return b"" if path is None else path.read_bytes()
    except OSError:
        return b""


def preview_light(codes: ByteImage) -> LightImage:
    """Return a small picture's light above sky and noise: stars and streaks alone.

    Vignetting and moonlight are subtracted with the sky.
    """
    above = codes.astype(np.float32) - _sky_of(codes)
    noise = 1.4826 * float(np.median(np.abs(above)))
    return np.asarray(np.clip(above - NOISE_SIGMAS * max(noise, 0.5), 0.0, None), np.float32)


def _sky_of(codes: ByteImage) -> LightImage:
    """Return the sky: medians of blocks, interpolated smoothly between the blocks' centres."""
    import cv2

    n = SKY_BLOCK_PX
    height, width = codes.shape
    rows, columns = height // n, width // n
    blocks = codes[: rows * n, : columns * n].reshape(rows, n, columns, n).swapaxes(1, 2)
    medians = np.median(blocks.reshape(rows, columns, -1), axis=2).astype(np.float32)
    sky = cv2.resize(medians, (width, height), interpolation=cv2.INTER_LINEAR)
    return np.asarray(sky, np.float32)


def draw_field(
    picture: Picture, stretch: Stretch, columns: int, rows: int, blocks: BlockSet = QUADRANTS
) -> DrawnPicture:
    """Draw the whole frame, as large as its shape allows in ``columns`` x ``rows`` cells."""
    window = _field_window(picture, columns, rows)
    light = _reduced(_field_light(picture, stretch), window.columns, window.rows, blocks)
    return DrawnPicture(
        greys=greys(scale_to_brightness(light, stretch)),
        blocks=blocks,
        window=window,
        px_per_square=window.width_px / window.columns,
    )


def draw_empty_field(
    picture: Picture, columns: int, rows: int, blocks: BlockSet = QUADRANTS
) -> DrawnPicture:
    """Draw the whole frame as dark sky alone, for the signs of a chart.

    It fills the cells where they have about the frame's shape.
    """
    window = _field_window(picture, columns, rows)
    if columns <= window.columns * LOOSE and rows <= window.rows * LOOSE:
        window = replace(window, columns=columns, rows=rows)
    size = window.rows * blocks.down, window.columns * blocks.across
    return DrawnPicture(
        greys=greys(np.full(size, FLOOR, np.float32)),
        blocks=blocks,
        window=window,
        px_per_square=window.width_px / window.columns,
    )


def _field_window(picture: Picture, columns: int, rows: int) -> Window:
    found = picture.detail.detections
    cells = cells_for_aspect(picture.aspect, columns, rows)
    size = (found.width_px, found.height_px) if found is not None else picture.codes.shape[::-1]
    return Window.at((-0.5, -0.5), (float(size[0]), float(size[1])), cells)


def draw_closeup(
    picture: Picture,
    stretch: Stretch,
    columns: int,
    rows: int,
    *,
    is_native: bool = False,
    blocks: BlockSet = QUADRANTS,
) -> DrawnPicture | None:
    """Draw the middle of the close-up, a whole number of pixels to a square; None: no close-up.

    The number is such that the streak in the middle fits; ``is_native``: the number is 1.
    """
    codes, place = picture.closeup, picture.place
    if codes is None or place is None or not columns or not rows:
        return None
    height, width = codes.shape
    middle = place.x0_px + (width - 1) / 2.0, place.y0_px + (height - 1) / 2.0
    n = 1
    if not is_native:
        all_of_it = max(math.ceil(width / columns), math.ceil(height / (2 * rows)))
        n = min(_pixels_a_square(picture.marks, middle, columns, rows), all_of_it)
    columns, rows = min(columns, width // n), min(rows, height // (2 * n))
    x0, y0 = (width - n * columns) // 2, (height - 2 * n * rows) // 2
    piece = codes[y0 : y0 + 2 * n * rows, x0 : x0 + n * columns]
    light = _light(piece, stretch)
    corner_px = place.x0_px + x0 - 0.5, place.y0_px + y0 - 0.5
    window = Window.at(corner_px, (float(n * columns), float(2 * n * rows)), (columns, rows))
    made = greys(scale_to_brightness(_reduced(light, columns, rows, blocks), stretch))
    return DrawnPicture(greys=made, blocks=blocks, window=window, px_per_square=float(n))


def _pixels_a_square(
    marks: tuple[Mark, ...], middle: tuple[float, float], columns: int, rows: int
) -> int:
    """Return the pixels along a square's side at which the streak nearest to ``middle`` fits."""
    streaks = [mark for mark in marks if mark.ends_px is not None]
    if not streaks:
        return 1
    nearest = min(streaks, key=lambda m: math.dist((m.x_px, m.y_px), middle))
    assert nearest.ends_px is not None
    (xa, ya), (xb, yb) = nearest.ends_px
    wide, high = MARGIN * abs(xb - xa), MARGIN * abs(yb - ya)
    return max(1, math.ceil(wide / columns), math.ceil(high / (2 * rows)))


def _field_light(picture: Picture, stretch: Stretch) -> LightImage:
    return picture.light if stretch == "streaks" else _light(picture.codes, stretch)


def _light(codes: ByteImage, stretch: Stretch) -> LightImage:
    light = codes.astype(np.float32)
    return np.sinh(light * np.float32(_LINEAR_PER_CODE) - 1.0) if stretch == "linear" else light


def _reduced(light: LightImage, columns: int, rows: int, blocks: BlockSet) -> LightImage:
    """Return the light of each part of a cell: its mean, or half its brightest if that is more.

    The mean of many squares of dark sky would hide a streak that is one square wide.
    """
    down, across = rows * blocks.down, columns * blocks.across
    height, width = light.shape
    y_edges = np.linspace(0, height, down, endpoint=False).astype(np.intp)
    x_edges = np.linspace(0, width, across, endpoint=False).astype(np.intp)
    total = np.add.reduceat(np.add.reduceat(light, y_edges, axis=0), x_edges, axis=1)
    count = np.diff(np.append(y_edges, height))[:, None] * np.diff(np.append(x_edges, width))
    mean = total / np.maximum(count, 1)
    most = np.maximum.reduceat(np.maximum.reduceat(light, y_edges, axis=0), x_edges, axis=1)
    return np.asarray(np.maximum(mean, BRIGHTEST_SHARE * most), np.float32)


def greys(shares: LightImage) -> ByteImage:
    """Turn brightness, 0 to 1, into steps of grey, 0 to GREYS - 1."""
    return np.asarray(np.round(shares * (GREYS - 1)), np.uint8)


def scale_to_brightness(light: LightImage, stretch: Stretch) -> LightImage:
    """Scale light to brightness, ``FLOOR`` to 1, between two percentiles of this light.

    So in a crowded field, where every square holds faint stars, the fainter ones stay dark.
    """
    low, high = (float(v) for v in np.percentile(light, _PERCENT[stretch]))
    share = np.clip((light - low) / max(high - low, _MIN_RANGE), 0.0, 1.0)
    return np.asarray(FLOOR + (1 - FLOOR) * share, np.float32)


def drawn_brightness(
    picture: Picture, drawing: DrawnPicture, stretch: Stretch, *, is_field: bool
) -> LightImage:
    """Return the brightness, 0 to 1, of the drawn part of a picture, not reduced.

    ``is_field``: True for the whole small picture, (height, width); False for the part of the
    close-up that ``drawing`` shows.
    """
    if is_field:
        light = _field_light(picture, stretch)
    else:
        assert picture.closeup is not None
        assert picture.place is not None
        window = drawing.window
        x0 = round(window.x0_px + 0.5 - picture.place.x0_px)
        y0 = round(window.y0_px + 0.5 - picture.place.y0_px)
        rows, columns = round(window.height_px), round(window.width_px)
        light = _light(picture.closeup[y0 : y0 + rows, x0 : x0 + columns], stretch)
    return scale_to_brightness(light, stretch)


def cells_for_aspect(aspect: float, columns: int, rows: int) -> tuple[int, int]:
    """Return (columns, rows) of the largest picture that fits.

    ``aspect``: width over height of the picture. A cell is twice as high as wide.
    """
    fitting = min(columns, max(1, round(2 * rows * aspect)))
    return fitting, min(rows, max(1, round(fitting / aspect / 2)))


def read_picture(reader: SessionReader, frame_id: int, detail: NightFrame) -> Picture | None:
    """Read a frame's picture and make its marks; None where no picture is kept, or not yet.

    Raises SessionError.
    """
    coded = _read(reader.preview_path(frame_id))
    codes = decode_preview(coded)
    if codes is None:
        return None
    return Picture(
        frame_id=frame_id,
        codes=codes,
        light=preview_light(codes),
        detail=detail,
        marks=frame_marks(detail),
        closeup=read_closeup(reader, detail),
        place=detail.closeup,
        stars=decode_preview_stars(coded),
    )


def read_closeup(reader: SessionReader, detail: NightFrame) -> ByteImage | None:
    """Read a frame's close-up; None where none is kept, or not yet. Raises SessionError."""
    if detail.closeup is None:
        return None
    return decode_preview(_read(reader.closeup_path(detail.closeup.frame_id)))
