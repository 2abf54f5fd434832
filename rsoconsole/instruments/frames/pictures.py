"""TIFF and PNG files, read by the decoding process."""

from typing import Any

import numpy.typing as npt

from rsoconsole.instruments.frames.frame_decoder import decoder
from rsoconsole.instruments.frames.plain_fits import Content

MAGIC = (b"\x89PNG", b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")


def picture(content: Content, name: str) -> npt.NDArray[Any]:
    """Its pixels as stored, (height, width) or (height, width, colours). Raises FrameError."""
    return decoder().decode_picture(content, name)
