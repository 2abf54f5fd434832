"""Small pictures of a session's frames for a page: inside it, and within a budget of bytes."""

import base64
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from rsoconsole.export import MeasuredRow
from rsoconsole.night import NightFrame
from rsoconsole.notebook.night import DrawnNight
from rsoconsole.records import FrameTaken, Solution
from rsoconsole.session.reading import SessionReader
from rsoconsole.sky import sky_to_pixel
from rsoconsole.words import clock

MOST_PICTURES = 40
"""Evenly chosen; those of missed frames come on top."""
MOST_BYTES = 5_000_000
"""Of all pictures together, as the page carries them."""
WIDE_PX = 300
QUALITY = 72


@dataclass(frozen=True, slots=True, kw_only=True)
class Picture:
    """One frame's picture."""

    frame_id: int
    data_uri: str
    width_px: int
    height_px: int


@dataclass(frozen=True, slots=True, kw_only=True)
class ShownFrame:
    """One picture with the marks on it, in per cent of its size."""

    picture: Picture
    caption: str
    is_missed: bool
    taken: tuple[float, float] | None
    predicted: tuple[float, float] | None


def chosen_frames(frames: list[int], missed: Iterable[int]) -> list[int]:
    """At most ``MOST_PICTURES`` spread evenly, first and last among them, and all the missed."""
    count = len(frames)
    most = min(count, MOST_PICTURES)
    even = {frames[round(k * (count - 1) / max(most - 1, 1))] for k in range(most)}
    return sorted(even | (set(missed) & set(frames)))


def pictures(session: Path, frames: Iterable[int]) -> tuple[Picture, ...]:
    """Those of the frames that have a readable preview, until the budget is spent."""
    reader = SessionReader(session)
    found: list[Picture] = []
    spent_bytes = 0
    for frame_id in frames:
        path = reader.preview_path(frame_id)
        picture = None if path is None else _picture(frame_id, path)
        if picture is None:
            continue
        spent_bytes += len(picture.data_uri)
        if spent_bytes > MOST_BYTES:
            break
        found.append(picture)
    return tuple(found)


def _picture(frame_id: int, path: Path) -> Picture | None:
    """None for a file that is damaged or gone: a report does without."""
    import cv2
    import numpy as np

    try:
        coded = np.frombuffer(path.read_bytes(), np.uint8)
        pixels = cv2.imdecode(coded, cv2.IMREAD_GRAYSCALE)
    except (OSError, cv2.error):
        return None
    if pixels is None:
        return None
    height, width = pixels.shape
    if width > WIDE_PX:
        height, width = max(1, round(height * WIDE_PX / width)), WIDE_PX
        pixels = cv2.resize(pixels, (width, height), interpolation=cv2.INTER_AREA)
    ok, jpeg = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    if not ok:
        return None
    text = base64.b64encode(jpeg.tobytes()).decode("ascii")
    return Picture(
        frame_id=frame_id,
        data_uri=f"data:image/jpeg;base64,{text}",
        width_px=width,
        height_px=height,
    )


def shown_frames(
    session: Path, night: DrawnNight, rows: tuple[MeasuredRow, ...]
) -> list[ShownFrame]:
    """The chosen frames of a night with their marks. Raises SessionError."""
    frames = {frame.frame_id: frame for frame in night.frames}
    missed = [number for number, frame in frames.items() if frame.missed is not None]
    reader = SessionReader(session)
    sizes: dict[int, tuple[int, int]] = {}
    plates: dict[int, Solution] = {}
    for _, _, record in reader.records(kinds=(FrameTaken, Solution)):
        if isinstance(record, FrameTaken):
            sizes[record.frame_id] = (record.width_px, record.height_px)
        elif isinstance(record, Solution):
            plates[record.frame_id] = record
    taken = {row.frame_id: row for row in rows if row.is_taken and not row.is_superseded}
    shown = []
    for picture in pictures(session, chosen_frames(list(frames), missed)):
        number = picture.frame_id
        frame, size, row = frames[number], sizes[number], taken.get(number)
        shown.append(
            ShownFrame(
                picture=picture,
                caption=_caption(frame, row),
                is_missed=frame.missed is not None,
                taken=None if row is None else _per_cent(row.x_px, row.y_px, size),
                predicted=_predicted(frame, plates.get(number), size),
            )
        )
    return shown


def _caption(frame: NightFrame, row: MeasuredRow | None) -> str:
    words = f"{frame.frame_id} · {clock(frame.t_mid_utc_ns)}"
    if frame.missed is not None:
        return f"{words} · missed: {frame.missed}"
    return words if row is None else f"{words} · {row.confidence:.2f}"


def _predicted(
    frame: NightFrame, plate: Solution | None, size: tuple[int, int]
) -> tuple[float, float] | None:
    if frame.predicted is None or plate is None:
        return None
    x_px, y_px = sky_to_pixel(plate.wcs, frame.predicted.x[0], frame.predicted.x[2])
    return _per_cent(float(x_px), float(y_px), size)


def _per_cent(x_px: float, y_px: float, size: tuple[int, int]) -> tuple[float, float] | None:
    """None for what lies outside the frame."""
    x, y = (x_px + 0.5) / size[0] * 100.0, (y_px + 0.5) / size[1] * 100.0
    return (x, y) if 0.0 <= x <= 100.0 and 0.0 <= y <= 100.0 else None
