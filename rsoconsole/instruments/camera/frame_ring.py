"""Shared memory for frames: three slots, so that no frame goes through a pipe.

The memory has no name, only a descriptor that the child inherits: nothing remains when either
process dies. Each order names the slot into which the child writes the frame. A frame stays in its
slot, which is lent to its users; no other frame is ordered into that slot until the last user has
released it.
"""

import contextlib
import mmap
import os
import tempfile
import weakref
from typing import Any

import numpy as np
import numpy.typing as npt

from rsoconsole.base import FrameError
from rsoconsole.records import PixelArray

SLOTS = 3
_PAGE = mmap.PAGESIZE


class FrameRing:
    """Three slots of equal size, in memory shared by two processes."""

    def __init__(self, descriptor: int, slot_bytes: int) -> None:
        """Map an existing ring; ``slot_bytes``: size of a slot as ``create`` has rounded it."""
        self.descriptor = descriptor
        self.slot_bytes = slot_bytes
        self._memory = mmap.mmap(descriptor, SLOTS * slot_bytes)
        self._lent: set[int] = set()

    @classmethod
    def create(cls, frame_bytes: int) -> "FrameRing":
        """Create a ring whose slots each hold at least ``frame_bytes``."""
        slot_bytes = -(-max(frame_bytes, 1) // _PAGE) * _PAGE
        if hasattr(os, "memfd_create"):
            descriptor = os.memfd_create("rsoconsole-frames")
        else:
            with tempfile.TemporaryFile() as unnamed:
                descriptor = os.dup(unnamed.fileno())
        os.ftruncate(descriptor, SLOTS * slot_bytes)
        return cls(descriptor, slot_bytes)

    def free_slot(self) -> int:
        """Return the number of the first slot whose frame is not in use.

        A night that uses one frame at a time so needs two slots: for the frame, and for the frame
        before, with which it is compared.
        """
        return next(slot for slot in range(SLOTS) if slot not in self._lent)

    def writable_slot(
        self, slot: int, shape: tuple[int, ...], dtype: npt.DTypeLike
    ) -> npt.NDArray[Any]:
        """Return a slot's memory as a writable array.

        Raises FrameError when the slot is too small.
        """
        if int(np.prod(shape)) * np.dtype(dtype).itemsize > self.slot_bytes:
            raise FrameError(
                f"a frame of {shape[1]} x {shape[0]} pixels is larger than the "
                "configured sensor: set optics.width_px and optics.height_px"
            )
        return self._view(slot, dtype, shape)

    def lend_slot(self, slot: int, dtype: npt.DTypeLike, shape: tuple[int, ...]) -> PixelArray:
        """Return a slot's frame as a read-only array, and reserve the slot while it is in use.

        A copy, where reserving the slot would leave none for the next frame.
        """
        if len(self._lent) >= SLOTS - 1:
            return self._view(slot, dtype, shape).copy()
        pixels = self._view(slot, dtype, shape)
        whole = pixels.base
        assert whole is not None
        # Every view of the pixels, and of those, keeps the whole alive, not the pixels.
        self._lent.add(slot)
        weakref.finalize(whole, self._lent.discard, slot).atexit = False
        pixels.flags.writeable = False
        return pixels

    def close(self) -> None:
        """Release the memory; it is freed once the other process and all users have done so."""
        with contextlib.suppress(BufferError):
            self._memory.close()
        os.close(self.descriptor)

    def _view(self, slot: int, dtype: npt.DTypeLike, shape: tuple[int, ...]) -> npt.NDArray[Any]:
        count = int(np.prod(shape))
        flat = np.frombuffer(
            self._memory, dtype=np.dtype(dtype), count=count, offset=slot * self.slot_bytes
        )
        return flat.reshape(shape)
