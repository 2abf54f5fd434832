"""Release of this process's free memory to the system.

The GNU C library adapts to freed blocks: after a few frames of 33 MB it allocates the next ones
from heaps that it never shrinks, one for each thread that held one.
"""

import ctypes
import mmap
from typing import Any

_LARGE_BYTES = 8 << 20
_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3
_DONTNEED = 4


def return_freed_blocks() -> bool:
    """Have every large block come from the system and return to it as soon as it is freed.

    Returns False where the C library cannot: then nothing has changed.
    """
    return bool(
        _call("mallopt", _MMAP_THRESHOLD, _LARGE_BYTES)
        and _call("mallopt", _TRIM_THRESHOLD, _LARGE_BYTES)
    )


def return_free_pages() -> bool:
    """Release, once, the pages that lie free between blocks in use; takes some milliseconds.

    Returns False where the C library cannot, or had nothing to release.
    """
    return bool(_call("malloc_trim", 0))


def forget_contents(address: int, size: int) -> bool:
    """Release the pages that lie wholly in a range of memory that stays allocated.

    Their contents are lost: they read as zeros, and are there again as soon as they are written.
    Returns False where the system does not do it: then the contents are as they were.
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
