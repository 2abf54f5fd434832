"""Frames in which the operator marks by hand, which are held for longer than the others."""

import logging
from pathlib import Path

from rsoconsole.base import RsoconsoleError
from rsoconsole.instruments import read_frame
from rsoconsole.records import PixelArray
from rsoconsole.session import SessionReader

BEGIN_MARK = "begin_mark"
"""Verb of the command that holds a frame."""
HELD = 600
"""Number of frames for which a held frame stays: a fast demo's five minutes, a real night's hours.
Each frame kept weighs some 80 kB, and takes some 7 ms when the frames are folded again."""

log = logging.getLogger(__name__)


def kept_pixels(folder: Path, frame_id: int) -> PixelArray | None:
    """Pixels of a recorded frame, (height, width) ADU.

    None where they were not kept, are not written yet, or are damaged.
    """
    try:
        path = SessionReader(folder).frame_path(frame_id)
        return None if path is None else read_frame(path, frame_id).pixels
    except RsoconsoleError as error:
        log.warning("the pixels of frame %d cannot be read: %s", frame_id, error)
        return None
