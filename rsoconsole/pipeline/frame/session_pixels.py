"""The pixels of a frame that the session under way has kept already."""

import logging
from pathlib import Path

from rsoconsole.errors import RsoconsoleError
from rsoconsole.instruments.frames import read_frame
from rsoconsole.records import PixelArray
from rsoconsole.session.reading import SessionReader

log = logging.getLogger(__name__)


def kept_pixels(folder: Path, frame_id: int) -> PixelArray | None:
    """(height, width) ADU; None where they were not kept, are not written yet, or are damaged."""
    try:
        path = SessionReader(folder).frame_path(frame_id)
        return None if path is None else read_frame(path, frame_id).pixels
    except RsoconsoleError as error:
        log.warning("the pixels of frame %d cannot be read: %s", frame_id, error)
        return None
