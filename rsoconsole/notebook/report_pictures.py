"""Small pictures of a session's frames for a page: inside it, and within a budget of bytes."""

import base64
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from rsoconsole.session.reader import SessionReader

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
