"""Decodes pictures, and FITS files that are not plain, in a process limited in time and memory.

Decoders of compressed images are native code: a damaged tile may corrupt their memory, a false
length may keep them busy for ever. The process is started with the first such file, stays for the
next ones, and is restarted when a file has ended it.
"""

import atexit
import os
import threading
from multiprocessing.connection import Connection

import numpy as np

from rsoconsole.base import ChildProcess, FrameError
from rsoconsole.instruments.frames._decoder_child import DecodeReply, DecodeRequest
from rsoconsole.instruments.frames.plain_fits import Content, FitsImage

START_S = 60.0
MIN_S, BYTES_A_S = 15.0, 8_000_000
"""Least time limit of a file, s, and the speed, bytes/s, that adds to it by length."""


class FrameDecoder:
    """The parent's access to the decoding process; one file at a time."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._child = ChildProcess("rsoconsole.instruments.frames._decoder_child")

    def decode(self, request: DecodeRequest, content: Content) -> FitsImage:
        """Decode a file in the process, by ``image_by_astropy`` or ``picture_by_opencv``.

        Raises FrameError, also where the file crashes the process.
        """
        with self._lock:
            try:
                return self._ask(request, content)
            except (EOFError, OSError) as error:
                self._child.end()
                raise FrameError(
                    f"{request.name} is damaged: it crashed the decoder;"
                    " copy it again or leave it out"
                ) from error
            except FrameError:
                raise
            except BaseException:
                self._child.end()  # what was asked would be the answer to the next question
                raise

    def _ask(self, request: DecodeRequest, content: Content) -> FitsImage:
        connection = self._connected()
        connection.send(request)
        connection.send_bytes(content)
        patience_s = MIN_S + len(content) / BYTES_A_S
        if not connection.poll(patience_s):
            self._child.end()
            raise FrameError(
                f"{request.name} is damaged: the decoder is not done after {patience_s:.0f} s;"
                " copy it again or leave it out"
            )
        reply: DecodeReply = connection.recv()
        if reply.fault:
            raise FrameError(reply.fault)
        pixels = np.empty(reply.shape, np.dtype(reply.dtype))
        if pixels.nbytes:
            connection.recv_bytes_into(pixels.data.cast("B"))
        return FitsImage(
            raw=pixels, header=dict(reply.header or {}), label=reply.label, others=reply.others
        )

    def _connected(self) -> Connection:
        is_new = self._child.pid is None
        connection = self._child.start()
        if is_new:
            if not connection.poll(START_S):
                raise OSError("the decoder does not start")
            connection.recv()
        return connection

    def close(self) -> None:
        """End the process."""
        with self._lock:
            self._child.end()


_decoders: dict[int, FrameDecoder] = {}
"""Decoders by process id: a forked process must not use that of its parent."""


def decoder() -> FrameDecoder:
    """Return the decoder of this process, created at the first call."""
    found = _decoders.get(os.getpid())
    if found is None:
        _decoders.clear()
        found = _decoders[os.getpid()] = FrameDecoder()
        atexit.register(found.close)
    return found
