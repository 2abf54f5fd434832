"""A lock that lives as long as its process and says whose it is.

A POSIX record lock on an open file, because children must not inherit it: a camera's process that
outlives the engine would otherwise keep the next engine out.
"""

import contextlib
import fcntl
import os
import struct
import sys
import threading
from pathlib import Path
from typing import Self

from rsoconsole.errors import ControlError

_FLOCK = "hhqqi"
"""struct flock of 64-bit Linux: type, whence, start, length, process."""
_MOST_WORDS = 4096

_held: dict[Path, str] = {}
"""By this very process, with what the files say."""
_held_lock = threading.Lock()


def holder(path: Path) -> int | None:
    """The process that holds the lock of a file; None where none does or the system does not tell.

    Only asks: a lock taken for the asking would turn away a process that starts just now.
    """
    found = read_holder(path)
    return None if found is None else found[0]


def read_holder(path: Path) -> tuple[int, str] | None:
    """The same, with what its holder has written into the file."""
    if sys.platform != "linux":
        return None
    with _held_lock:
        # To close any descriptor of it would let go of this process's own lock.
        if path in _held:
            return os.getpid(), _held[path]
        try:
            descriptor = os.open(path, os.O_RDWR | os.O_CLOEXEC)
        except OSError:
            return None
        try:
            question = struct.pack(_FLOCK, fcntl.F_WRLCK, os.SEEK_SET, 0, 0, 0)
            kind, *_, pid = struct.unpack(_FLOCK, fcntl.fcntl(descriptor, fcntl.F_GETLK, question))
            said = os.read(descriptor, _MOST_WORDS).decode("utf-8", "replace")
        except OSError:
            return None
        finally:
            os.close(descriptor)
    return None if kind == fcntl.F_UNLCK else (int(pid), said)


class RecordLock:
    """Held by one process; the system lets go of it when that dies."""

    def __init__(self, path: Path, words: str, *, is_removed: bool = False) -> None:
        """``words``: what the file says of its holder; ``is_removed``: with its release."""
        self._path = path
        self._is_removed = is_removed
        self._words = words
        self._descriptor: int | None = None

    def refusal(self, holder_words: str) -> str:
        """What is said to the process that comes second; ``holder_words`` as the first has them."""
        return f"{self._path} is held: {holder_words.strip()}"

    def acquire(self) -> None:
        """Raises ControlError when another process holds it, or it cannot be made."""
        with _held_lock:
            # A process does not conflict with its own record lock.
            if self._path in _held:
                raise ControlError("an engine is already running in this very process")
            try:
                self._descriptor = self._locked()
            except OSError as error:
                raise ControlError(
                    f"the engine's lock {self._path} cannot be made: {error}"
                ) from error
            _held[self._path] = self._words

    def _locked(self) -> int:
        """The file, open and locked. Raises ControlError where it is held, OSError else."""
        self._path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        while True:
            descriptor = os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
            try:
                fcntl.lockf(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError as error:
                said = os.read(descriptor, _MOST_WORDS).decode("utf-8", "replace")
                os.close(descriptor)
                raise ControlError(self.refusal(said)) from error
            if self._is_there(descriptor):
                break
            os.close(descriptor)  # its last holder has removed it just now
        # A full disk does not take the words; the lock holds all the same.
        with contextlib.suppress(OSError):
            os.ftruncate(descriptor, 0)
            os.write(descriptor, self._words.encode())
        return descriptor

    def keep(self) -> bool:
        """Lock the file again where somebody has removed it; True where that was needed.

        A file without a name cannot get one again: the next process must meet this one's lock.
        Raises ControlError where another process was quicker, OSError where it cannot be done.
        """
        with _held_lock:
            if self._descriptor is None or self._is_there(self._descriptor):
                return False
            old, self._descriptor = self._descriptor, self._locked()
            os.close(old)
        return True

    def _is_there(self, descriptor: int) -> bool:
        try:
            found = self._path.lstat()
        except OSError:
            return False
        own = os.fstat(descriptor)
        return (found.st_dev, found.st_ino) == (own.st_dev, own.st_ino)

    def release(self) -> None:
        """Let the next one in; nothing when the lock is not held."""
        with _held_lock:
            if self._descriptor is not None:
                if self._is_removed and self._is_there(self._descriptor):
                    with contextlib.suppress(OSError):
                        self._path.unlink()
                os.close(self._descriptor)
                self._descriptor = None
                _held.pop(self._path, None)

    def __enter__(self) -> Self:
        self.acquire()
        return self

    def __exit__(self, *exception: object) -> None:
        self.release()
