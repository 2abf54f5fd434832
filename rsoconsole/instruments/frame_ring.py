"""Shared memory for frames: three slots, so that no frame ever goes through a pipe.

The memory has no name, only a descriptor that the child inherits: it cannot be left behind,
whoever dies how.
"""

import mmap
import os
import tempfile

import numpy as np

from rsoconsole.records import PixelArray

SLOTS = 3
_PAGE = mmap.PAGESIZE


class FrameRing:
    """Three slots of equal size in memory that two processes see."""

    def __init__(self, descriptor: int, slot_bytes: int) -> None:
        """Map an existing ring; ``slot_bytes`` as ``create`` rounded it."""
        self.descriptor = descriptor
        self.slot_bytes = slot_bytes
        self._memory = mmap.mmap(descriptor, SLOTS * slot_bytes)
        self._next = 0

    @classmethod
    def create(cls, frame_bytes: int) -> "FrameRing":
        """A new ring whose slots hold at least ``frame_bytes``."""
        slot_bytes = -(-max(frame_bytes, 1) // _PAGE) * _PAGE
        if hasattr(os, "memfd_create"):
            descriptor = os.memfd_create("rsoconsole-frames")
        else:
            with tempfile.TemporaryFile() as unnamed:
                descriptor = os.dup(unnamed.fileno())
        os.ftruncate(descriptor, SLOTS * slot_bytes)
        return cls(descriptor, slot_bytes)

    def put(self, pixels: PixelArray) -> int:
        """Copy pixels into the next slot and return its number. Raises ValueError when too big."""
        if pixels.nbytes > self.slot_bytes:
            raise ValueError(
                f"a frame of {pixels.shape[1]} x {pixels.shape[0]} pixels is larger than the "
                "configured sensor: set optics.width_px and optics.height_px"
            )
        slot = self._next
        self._next = (slot + 1) % SLOTS
        self._view(slot, pixels.dtype.str, pixels.shape)[:] = pixels
        return slot

    def copy(self, slot: int, dtype: str, shape: tuple[int, ...]) -> PixelArray:
        """The caller's own copy of what lies in a slot."""
        return self._view(slot, dtype, shape).copy()

    def close(self) -> None:
        """Give the memory back; it is gone when the other process has, too."""
        self._memory.close()
        os.close(self.descriptor)

    def _view(self, slot: int, dtype: str, shape: tuple[int, ...]) -> PixelArray:
        count = int(np.prod(shape))
        flat = np.frombuffer(
            self._memory, dtype=np.dtype(dtype), count=count, offset=slot * self.slot_bytes
        )
        view: PixelArray = flat.reshape(shape)
        return view
