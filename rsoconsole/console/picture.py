"""A frame's preview as cells of a terminal: two pixels a cell, one above the other."""

import itertools
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from rsoconsole.console.night import FrameDetail
from rsoconsole.records import Solution
from rsoconsole.sky.wcs import sky_to_pixel

GREYS = 24
"""Steps of grey: enough for the eye, few enough that neighbouring cells share one."""

SKY_BLOCK_PX = 24
NOISE_SIGMAS = 6.0
DARK_PERCENT, BRIGHT_PERCENT = 65.0, 99.7
FLOOR = 0.08
"""Grey of the empty sky, so that the picture's edge is seen."""

LightImage = npt.NDArray[np.float32]


@dataclass(frozen=True, slots=True, kw_only=True)
class Mark:
    """Something to point at in the picture, in shares of its width and height."""

    x: float
    y: float
    half_width: float
    kind: Literal["followed", "candidate", "predicted"]
    label: str = ""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Picture:
    """A frame's preview and what is marked in it."""

    frame_id: int
    light: LightImage
    """(height, width), the preview's pixels above its sky; row 0 at the top."""
    detail: FrameDetail
    """What was said of the frame."""
    marks: tuple[Mark, ...] = ()

    @property
    def aspect(self) -> float:
        """Width over height."""
        return float(self.light.shape[1] / self.light.shape[0])


def read_preview(path: Path) -> LightImage | None:
    """The preview's light above its sky, (height, width); None when it cannot be read (yet)."""
    import cv2

    try:
        coded = np.frombuffer(path.read_bytes(), np.uint8)
        pixels: Any = cv2.imdecode(coded, cv2.IMREAD_GRAYSCALE) if coded.size else None
    except (OSError, cv2.error):
        return None
    if pixels is None or min(pixels.shape) < SKY_BLOCK_PX:
        return None
    return light_above_sky(pixels, _sky_of(pixels))


def light_above_sky(pixels: npt.NDArray[np.uint8], sky: npt.NDArray[np.float32]) -> LightImage:
    """What stands out of the noise: stars and streaks; vignetting and moonlight are gone."""
    above = pixels.astype(np.float32) - sky
    noise = 1.4826 * float(np.median(np.abs(above)))
    return np.asarray(np.clip(above - NOISE_SIGMAS * max(noise, 0.5), 0.0, None), np.float32)


def _sky_of(pixels: npt.NDArray[np.uint8]) -> npt.NDArray[np.float32]:
    """Medians of blocks, drawn smoothly between their centres."""
    import cv2

    n = SKY_BLOCK_PX
    height, width = pixels.shape
    rows, columns = height // n, width // n
    blocks = pixels[: rows * n, : columns * n].reshape(rows, n, columns, n).swapaxes(1, 2)
    medians = np.median(blocks.reshape(rows, columns, -1), axis=2).astype(np.float32)
    sky = cv2.resize(medians, (width, height), interpolation=cv2.INTER_LINEAR)
    return np.asarray(sky, np.float32)


def marks_of(detail: FrameDetail) -> tuple[Mark, ...]:
    """Detections, and where the track was expected, in one frame."""
    found = detail.detections
    if found is None or found.width_px <= 0 or found.height_px <= 0:
        return ()
    followed = detail.followed
    marks: list[Mark] = []
    for detection in found.detections:
        is_followed = (
            followed is not None
            and abs(followed.x_px - detection.x_px) < 1.0
            and abs(followed.y_px - detection.y_px) < 1.0
        )
        marks.append(
            Mark(
                x=(detection.x_px + 0.5) / found.width_px,
                y=(detection.y_px + 0.5) / found.height_px,
                half_width=abs(detection.x_b_px - detection.x_a_px) / 2.0 / found.width_px,
                kind="followed" if is_followed else "candidate",
                label=f"{detection.confidence:.2f}".removeprefix("0"),
            )
        )
    predicted = _predicted_mark(detail, found.width_px, found.height_px)
    return (*marks, predicted) if predicted is not None else tuple(marks)


def _predicted_mark(detail: FrameDetail, width_px: int, height_px: int) -> Mark | None:
    if detail.predicted is None or not isinstance(detail.solution, Solution):
        return None
    ra, _, dec, _ = detail.predicted.x
    x_px, y_px = (float(v) for v in sky_to_pixel(detail.solution.wcs, ra, dec))
    x, y = (x_px + 0.5) / width_px, (y_px + 0.5) / height_px
    if not (0.0 <= x < 1.0 and 0.0 <= y < 1.0):
        return None
    return Mark(x=x, y=y, half_width=0.0, kind="predicted")


def shrunk(light: LightImage, columns: int, rows: int) -> npt.NDArray[np.uint8]:
    """(2 * rows, columns) steps of grey, 0 to GREYS - 1, of the light under each.

    A crowded field fills every cell with faint stars: the fainter part of the cells stays dark.
    """
    height, width = light.shape
    y_edges = np.linspace(0, height, 2 * rows, endpoint=False).astype(np.intp)
    x_edges = np.linspace(0, width, columns, endpoint=False).astype(np.intp)
    total = np.add.reduceat(np.add.reduceat(light, y_edges, axis=0), x_edges, axis=1)
    low, high = (float(v) for v in np.percentile(total, (DARK_PERCENT, BRIGHT_PERCENT)))
    share = np.clip((total - low) / max(high - low, 1.0), 0.0, 1.0)
    return np.asarray(np.round((FLOOR + (1 - FLOOR) * share) * (GREYS - 1)), np.uint8)


def fitted_cells(aspect: float, columns: int, rows: int) -> tuple[int, int]:
    """(columns, rows) of the largest picture of that aspect: a cell is twice as high as wide."""
    fitting = min(columns, max(1, round(2 * rows * aspect)))
    return fitting, min(rows, max(1, round(fitting / aspect / 2)))


Cells = dict[tuple[int, int], tuple[str, str]]
"""(column, row) -> (character, kind of mark)."""


def overlay(marks: tuple[Mark, ...], columns: int, rows: int) -> Cells:
    """What is written over a picture of that many cells; what is followed is written last."""
    cells: Cells = {}
    order = {"predicted": 0, "candidate": 1, "followed": 2}
    for mark in sorted(marks, key=lambda m: order[m.kind]):
        column, row = int(mark.x * columns), int(mark.y * rows)
        for at, text in _signs(mark, column, columns):
            for offset, character in enumerate(text):
                if 0 <= at + offset < columns:
                    cells[at + offset, row] = character, mark.kind
    return cells


def _signs(mark: Mark, column: int, columns: int) -> list[tuple[int, str]]:
    """(column, text) of what a mark writes into its row."""
    if mark.kind == "predicted":
        return [(column, "+")]
    opening, closing = "[]" if mark.kind == "followed" else "()"
    reach = max(1, round(mark.half_width * columns) + 1)
    left, right = column - reach, column + reach
    fits_right = right + 1 + len(mark.label) <= columns
    label_at = right + 1 if fits_right else left - len(mark.label)
    streak = "━" * (right - left - 1)
    return [(left, opening + streak + closing), (label_at, mark.label)]


def runs(
    greys: npt.NDArray[np.uint8], marks: Cells, row: int
) -> list[tuple[str, tuple[int, int] | str]]:
    """One row of cells as (text, (upper grey, lower grey) or the mark's kind); equals joined."""
    upper, lower = greys[2 * row].tolist(), greys[2 * row + 1].tolist()
    cells: list[tuple[str, tuple[int, int] | str]] = [
        marks.get((column, row), ("▀", (a, b)))
        for column, (a, b) in enumerate(zip(upper, lower, strict=True))
    ]
    return [
        ("".join(text for text, _ in group), key)
        for key, group in itertools.groupby(cells, key=lambda cell: cell[1])
    ]
