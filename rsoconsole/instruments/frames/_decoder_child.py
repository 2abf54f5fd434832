"""The process that decodes pictures, and FITS files that are not plain: a file may crash it.

Started with ``python -c``; it ends when the parent's end of the socket closes.
"""

import contextlib
import os
import resource
import sys
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from rsoconsole.base import FrameError

SPARE_BYTES = 900_000_000
"""Memory allowed for decoding a file, beyond the memory of the process itself, bytes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DecodeRequest:
    """Order to decode one image of a file; the file follows as bytes."""

    name: str
    extension: str | None = None
    min_side_px: int = 1
    is_picture: bool = False
    """True for TIFF or PNG; ``extension`` and ``min_side_px`` are then ignored."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DecodeReply:
    """A decoded image without its pixels, which follow as bytes; or why there is none."""

    fault: str = ""
    dtype: str = ""
    shape: tuple[int, ...] = ()
    header: dict[str, Any] | None = None
    label: str = ""
    others: tuple[str, ...] = ()


def main(socket_fd: int) -> None:
    """Decode files until the parent closes its end of the socket."""
    connection = Connection(socket_fd)
    import astropy.io.fits  # noqa: F401 - now, so that the first file does not wait

    _limit_memory()
    connection.send(DecodeReply())
    while True:
        try:
            request: DecodeRequest = connection.recv()
            content = connection.recv_bytes()
        except (EOFError, OSError):
            os._exit(0)
        if request.is_picture and "cv2" not in sys.modules:
            import cv2  # noqa: F401 - what it weighs itself is no file's fault

            _limit_memory()
        _answer(connection, request, content)


def _limit_memory() -> None:
    """Limit this process's memory: a file that needs more fails here, with a message."""
    with contextlib.suppress(OSError, ValueError, IndexError):
        said = Path("/proc/self/statm").read_text(encoding="ascii")
        most = int(said.split()[0]) * resource.getpagesize() + SPARE_BYTES
        resource.setrlimit(resource.RLIMIT_AS, (most, resource.getrlimit(resource.RLIMIT_AS)[1]))


def _answer(connection: Connection, request: DecodeRequest, content: bytes) -> None:
    import numpy as np

    from rsoconsole.instruments.frames._fits_by_astropy import image_by_astropy
    from rsoconsole.instruments.frames._pictures_by_opencv import picture_by_opencv
    from rsoconsole.instruments.frames.plain_fits import FitsImage

    try:
        image = (
            FitsImage(raw=picture_by_opencv(content, request.name), header={})
            if request.is_picture
            else image_by_astropy(content, request.name, request.extension, request.min_side_px)
        )
        pixels = np.ascontiguousarray(image.raw)
        reply = DecodeReply(
            dtype=pixels.dtype.str,
            shape=pixels.shape,
            header=image.header,
            label=image.label,
            others=image.others,
        )
    except FrameError as error:
        connection.send(DecodeReply(fault=str(error)))
        return
    except MemoryError:
        words = f"{request.name} asks for more memory than any frame needs: leave it out"
        connection.send(DecodeReply(fault=words))
        return
    connection.send(reply)
    connection.send_bytes(pixels.data.cast("B"))
