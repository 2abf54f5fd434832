"""Frames in which the operator marks a streak by hand; they are held longer than others."""

import logging
from pathlib import Path

from rsoconsole.base import RsoconsoleError
from rsoconsole.instruments import read_frame
from rsoconsole.records import PixelArray
from rsoconsole.session import SessionReader

BEGIN_MARK = "begin_mark"
HELD = 600
"""Number of frames for which a held frame stays; each weighs some 80 kB."""

log = logging.getLogger(__name__)


def recorded_pixels(folder: Path, frame_id: int) -> PixelArray | None:
    """Pixels of a recorded frame, (height, width) ADU.

    None where they were not kept, are not written yet, or are damaged.
    """
    try:
        path = SessionReader(folder).frame_path(frame_id)
        return None if path is None else read_frame(path, frame_id).pixels
    except RsoconsoleError as error:
        log.warning("the pixels of frame %d cannot be read: %s", frame_id, error)
        return None
