"""Finds out whether the process that writes a session still lives, from the table ``meta``."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

META_KEY = "writer"
_BOOT_ID = Path("/proc/sys/kernel/random/boot_id")
_START_FIELD = 19
"""Place of ``starttime`` in /proc/PID/stat, counted after the name. Source: proc(5), field 22."""


def writer_identity() -> dict[str, Any]:
    """Return JSON values that identify this process among all, for the table ``meta``."""
    pid = os.getpid()
    return {"pid": pid, "boot_id": _boot_id(), "start_ticks": _start_ticks(pid)}


def is_being_written(about: Mapping[str, Any]) -> bool:
    """True while a process writes the session: it is not closed, and its process lives.

    ``about``: the session's table ``meta``. A session that names no process counts as abandoned.
    """
    if about.get("is_closed") is True:
        return False
    mark = about.get(META_KEY)
    if not isinstance(mark, Mapping):
        return False
    if mark.get("boot_id") not in (None, _boot_id()) or not _is_running(mark.get("pid")):
        return False
    return mark.get("start_ticks") in (None, _start_ticks(mark["pid"]))


def _is_running(pid: object) -> bool:
    if not isinstance(pid, int) or pid <= 0:
        return False
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):
        return True
    return True


def _boot_id() -> str | None:
    try:
        return _BOOT_ID.read_text(encoding="ascii").strip()
    except (OSError, UnicodeDecodeError):
        return None


def _start_ticks(pid: int) -> int | None:
    try:
        stat = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8", errors="replace")
        # The name, in brackets, may hold blanks and brackets of its own.
        return int(stat.rpartition(")")[2].split()[_START_FIELD])
    except (OSError, ValueError, IndexError):
        return None
