"""Reads TIFF and PNG files by OpenCV.

Runs only in the decoding process: a damaged file may crash it.
"""

import os
from typing import Any

import numpy as np
import numpy.typing as npt

from rsoconsole.base import FrameError
from rsoconsole.instruments.frames._fits_by_astropy import MAX_PIXELS
from rsoconsole.instruments.frames.plain_fits import Content

# OpenCV looks once, when it is loaded: a picture of more pixels is refused before it is unpacked.
os.environ.setdefault("OPENCV_IO_MAX_IMAGE_PIXELS", str(MAX_PIXELS))


def picture_by_opencv(content: Content, name: str) -> npt.NDArray[Any]:
    """Read pixels as stored: (height, width) or (height, width, colours). Raises FrameError."""
    import cv2

    try:
        image = cv2.imdecode(np.frombuffer(content, dtype=np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        image = None
    if image is None:
        raise FrameError(f"{name} is truncated or damaged: copy it again or leave it out")
    return np.asarray(image)
