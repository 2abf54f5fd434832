"""Return of this process's free memory to the operating system.

The GNU C library raises its thresholds as large blocks are freed: after a few frames of 33 MB it
takes the next frames from heaps that it never shrinks, one heap for each thread that held a
frame.
"""

import ctypes
import mmap
from typing import Any

_LARGE_BYTES = 8 << 20
_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3
_DONTNEED = 4


def return_freed_blocks_at_once() -> bool:
    """Set the C library to return every large block to the system as soon as it is freed.

    Returns False where the C library has no such setting: then nothing has changed.
    """
    return bool(
        _call("mallopt", _MMAP_THRESHOLD, _LARGE_BYTES)
        and _call("mallopt", _TRIM_THRESHOLD, _LARGE_BYTES)
    )


def return_free_pages() -> bool:
    """Return to the system, once, free pages between blocks in use; takes some milliseconds.

    Returns False where the C library cannot, or had nothing to return.
    """
    return bool(_call("malloc_trim", 0))


def discard_pages(address: int, size: int) -> bool:
    """Return to the system the whole pages within a range of memory that stays allocated.

    Their contents are lost: they read as zeros, and may be written again. Returns False where the
    system does not do this or no page is whole: then the contents are unchanged.
    """
    first = -(-address // mmap.PAGESIZE) * mmap.PAGESIZE
    length = (address + size) // mmap.PAGESIZE * mmap.PAGESIZE - first
    if length <= 0:
        return False
    return _call("madvise", ctypes.c_void_p(first), ctypes.c_size_t(length), _DONTNEED) == 0


def _call(function: str, *arguments: Any) -> int | None:
    """Result of a function of the C library; None where the library has no such function."""
    try:
        return int(getattr(ctypes.CDLL(None), function)(*arguments))
    except (OSError, AttributeError):
        return None
