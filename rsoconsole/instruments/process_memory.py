"""Memory of this process that the system may have back.

The GNU C library learns from whatever is freed: after a few frames of 33 MB it takes the next ones
from heaps that it never shrinks, one for each thread that held one.
"""

import ctypes
import mmap

_LARGE_BYTES = 8 << 20
_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3
_DONTNEED = 4


def return_what_is_freed() -> bool:
    """Have every large block come from the system and go back to it as soon as it is freed.

    False where the C library does not know how: then nothing has changed.
    """
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (OSError, AttributeError):
        return False
    return bool(mallopt(_MMAP_THRESHOLD, _LARGE_BYTES) and mallopt(_TRIM_THRESHOLD, _LARGE_BYTES))


def return_free_pages() -> bool:
    """Give back, once, what lies free between blocks in use; takes some milliseconds.

    False where the C library does not know how, or had nothing to give.
    """
    try:
        return bool(ctypes.CDLL(None).malloc_trim(0))
    except (OSError, AttributeError):
        return False


def forget_contents(address: int, size: int) -> bool:
    """Give back the pages that lie wholly in a range of memory that stays allocated.

    What was written there is lost: it reads as zeros, and is there again as soon as it is written.
    False where the system does not do it: then the contents are as they were.
    """
    first = -(-address // mmap.PAGESIZE) * mmap.PAGESIZE
    length = (address + size) // mmap.PAGESIZE * mmap.PAGESIZE - first
    if length <= 0:
        return False
    try:
        madvise = ctypes.CDLL(None).madvise
    except (OSError, AttributeError):
        return False
    return not madvise(ctypes.c_void_p(first), ctypes.c_size_t(length), _DONTNEED)
