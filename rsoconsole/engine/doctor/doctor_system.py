"""Clock, disk and terminal, as the operating system reports them."""

import ctypes
import locale
import os
import shutil
import struct
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

_STA_UNSYNC, _STA_NANO = 0x0040, 0x2000
_TIMEX_BYTES = 512
_TIMESYNC_FLAG = Path("/run/systemd/timesync/synchronized")


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockReading:
    """The kernel's report on the system clock."""

    is_synchronised: bool | None
    """True when synchronised; None when the system does not report it."""
    offset_s: float | None = None
    """Offset of the clock that is still to be corrected, s; None: not reported."""
    max_error_s: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Terminal:
    """The terminal that this process runs in."""

    columns: int
    rows: int
    colours: int
    is_utf8: bool


def read_clock() -> ClockReading:
    """Read the kernel's report on its clock, by adjtimex(2); nothing is changed."""
    flag = True if _TIMESYNC_FLAG.exists() else None
    if not sys.platform.startswith("linux"):
        return ClockReading(is_synchronised=flag)
    # modes = 0 asks and changes nothing; the buffer is larger than any struct timex.
    answer = ctypes.create_string_buffer(_TIMEX_BYTES)
    try:
        state = ctypes.CDLL(None, use_errno=True).adjtimex(answer)
    except (OSError, AttributeError):
        return ClockReading(is_synchronised=flag)
    if state < 0:
        return ClockReading(is_synchronised=flag)
    _modes, offset, _frequency, max_error_us, _error_us, status = struct.unpack_from(
        "@Illlli", answer
    )
    if status & _STA_UNSYNC:
        # Some time services leave the kernel's mark alone and set a flag of their own.
        return ClockReading(is_synchronised=bool(flag))
    return ClockReading(
        is_synchronised=True,
        offset_s=offset * (1e-9 if status & _STA_NANO else 1e-6),
        max_error_s=max_error_us * 1e-6,
    )


def free_bytes(folder: Path) -> int:
    """Return the free bytes of the disk on which the folder is, or would be. Raises OSError."""
    return shutil.disk_usage(nearest_existing(folder)).free


def write_fault(folder: Path) -> str | None:
    """Return why a folder cannot be written or made; None when it can."""
    nearest = nearest_existing(folder)
    if not nearest.is_dir():
        return f"{nearest} is no folder"
    if nearest != folder:
        may_make = os.access(nearest, os.W_OK | os.X_OK)
        return None if may_make else f"it cannot be made in {nearest}"
    try:
        with tempfile.TemporaryFile(dir=folder) as probe:
            probe.write(b"x" * 4096)
    except OSError as error:
        return error.strerror or str(error)
    return None


def read_terminal(environ: Mapping[str, str] | None = None) -> Terminal | None:
    """Return the terminal behind stderr, stdout or stdin; None when there is none."""
    environ = os.environ if environ is None else environ
    for descriptor in (2, 1, 0):
        try:
            columns, rows = os.get_terminal_size(descriptor)
        except OSError:
            continue
        return Terminal(
            columns=columns,
            rows=rows,
            colours=terminal_colours(environ),
            is_utf8=locale.getpreferredencoding(do_setlocale=False).upper() in {"UTF-8", "UTF8"},
        )
    return None


def terminal_colours(environ: Mapping[str, str]) -> int:
    """Return the number of colours that the terminal's environment variables declare."""
    if environ.get("COLORTERM", "") in {"truecolor", "24bit"}:
        return 1 << 24
    term = environ.get("TERM", "dumb")
    if term in {"", "dumb", "unknown"} or term.startswith("vt"):
        return 2
    return 256 if "256" in term or "direct" in term else 16


def nearest_existing(folder: Path) -> Path:
    """Return the folder itself where it exists, else the nearest existing folder above it."""
    nearest = folder.absolute()
    while not nearest.exists() and nearest != nearest.parent:
        nearest = nearest.parent
    return nearest
