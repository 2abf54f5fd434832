"""One engine a mount, whatever becomes of the folder that its socket lies in.

The lock lies in the user's state folder, which a logout does not empty, one file for each mount
(INDI host, port, device). It names process and socket, so that a running engine is found by it.
"""

import os
import re
import shlex
from dataclasses import dataclass
from pathlib import Path

from rsoconsole.config import IndiConfig, state_dir
from rsoconsole.control.place import default_socket_path
from rsoconsole.control.record_lock import RecordLock, read_holder


def _folder() -> Path:
    return state_dir() / "mounts"


class MountLock(RecordLock):
    """Held by the engine that may move a mount."""

    def __init__(self, indi: IndiConfig, socket: Path) -> None:
        """``socket``: where it listens, or would."""
        name = re.sub(r"[^\w.-]+", "_", f"{indi.host}-{indi.port}-{indi.mount}")
        words = f"{os.getpid()}\n{socket}\n"
        super().__init__(_folder() / f"{name}.lock", words, is_removed=True)
        self._mount = indi.mount

    def refusal(self, holder_words: str) -> str:
        """What is said to a second engine."""
        pid, socket = holder_words.partition("\n")[0], _socket_in(holder_words)
        return (
            f"an engine already drives {self._mount} (process {pid or 'unknown'}):"
            f" 'rsoconsole console{socket_option(socket)}' attaches to it"
        )


@dataclass(frozen=True, slots=True)
class RunningEngine:
    """An engine that holds the lock of a mount."""

    pid: int
    socket: Path


def running_engines() -> list[RunningEngine]:
    """Every engine of this user that drives a mount."""
    found = []
    try:
        paths = sorted(_folder().glob("*.lock"))
    except OSError:
        return []
    for path in paths:
        known = read_holder(path)
        if known is not None:
            pid, said = known
            found.append(RunningEngine(pid, _socket_in(said)))
    return found


def engine_behind(socket: Path) -> RunningEngine | None:
    """The engine that listens there, or did before its socket was removed."""
    return next((each for each in running_engines() if each.socket == socket), None)


def socket_option(socket: Path) -> str:
    """What follows a verb that is to reach the engine there."""
    is_usual = socket in {Path(), default_socket_path()}
    return "" if is_usual else f" --socket {shlex.quote(str(socket))}"


def _socket_in(words: str) -> Path:
    return Path(words.strip().partition("\n")[2])
