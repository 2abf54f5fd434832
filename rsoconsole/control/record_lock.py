"""Where the engine's socket lies, and locks that end with their process: one engine a mount."""

import contextlib
import fcntl
import hashlib
import os
import re
import shlex
import stat
import struct
import sys
import tempfile
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from rsoconsole.base import ControlError
from rsoconsole.config import IndiConfig, runtime_dir, state_dir

_FLOCK = "hhqqi"
"""Layout of ``struct flock`` on 64-bit Linux: type, whence, start, length, process."""
_MAX_WORDS = 4096

_held: dict[Path, str] = {}
"""Locks that this process holds, by file, with the text written into each file."""
_held_lock = threading.Lock()


def read_lock_holder(path: Path) -> tuple[int, str] | None:
    """Return (process id, file's text) of the process that holds a lock; None: nobody.

    None also where the system does not report the holder. The lock is only queried: taking it even
    briefly would make a process fail that is just starting.
    """
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
            said = os.read(descriptor, _MAX_WORDS).decode("utf-8", "replace")
        except OSError:
            return None
        finally:
            os.close(descriptor)
    return None if kind == fcntl.F_UNLCK else (int(pid), said)


class RecordLock:
    """Lock on a file (a POSIX record lock); the system releases it when its process dies."""

    def __init__(self, path: Path, words: str, *, is_removed: bool = False) -> None:
        """Make the lock, without taking it.

        ``words``: text about the holder, written into the file; ``is_removed``: True where the file
        is removed on release.
        """
        self._path = path
        self._is_removed = is_removed
        self._words = words
        self._descriptor: int | None = None

    def refusal(self, holder_words: str) -> str:
        """Return the error message for a process that finds the lock held.

        ``holder_words``: text in the file, written by the process that holds the lock.
        """
        return f"{self._path} is held: {holder_words.strip()}"

    def acquire(self) -> None:
        """Take the lock.

        Raises ControlError where another process holds it, and where the file cannot be made.
        """
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
        """Return the file's descriptor, open and locked.

        Raises ControlError where another process holds the lock, OSError for other faults.
        """
        self._path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        while True:
            descriptor = os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
            try:
                fcntl.lockf(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError as error:
                said = os.read(descriptor, _MAX_WORDS).decode("utf-8", "replace")
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
        """Make and lock the file again if it has been removed; return True if it had been.

        The removed file cannot be put back, and another process must find a locked file under that
        name. Raises ControlError if another process has taken the lock meanwhile, OSError if the
        file cannot be made.
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
        """Release the lock for the next process; does nothing where it is not held."""
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


MAX_ADDRESS_BYTES = 100
"""Greatest length of a socket's path, bytes: Linux allows 107 in ``sun_path``, macOS 103."""


def default_socket_path() -> Path:
    """Return the path of the socket on which this user's engine listens."""
    return runtime_dir() / "engine.sock"


def socket_address(path: Path) -> Path:
    """Return ``path``, or a short path derived from it if it is too long for a socket.

    The short path lies in a folder of this user under the folder for temporary files. Raises
    ControlError if that folder belongs to another user or others can enter it.
    """
    absolute = Path(os.path.abspath(path))  # noqa: PTH100 - resolve() would ask the disk
    if len(os.fsencode(absolute)) <= MAX_ADDRESS_BYTES:
        return absolute
    folder = Path(tempfile.gettempdir()) / f"rsoconsole-{os.getuid()}"
    folder.mkdir(mode=0o700, exist_ok=True)
    found = folder.lstat()
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.getuid() or found.st_mode & 0o077:
        raise ControlError(
            f"{folder} is not this user's own closed folder: remove it, or set XDG_RUNTIME_DIR "
            "to a shorter path"
        )
    digest = hashlib.sha256(os.fsencode(absolute)).hexdigest()[:16]
    short = folder / f"{digest}.sock"
    if len(os.fsencode(short)) > MAX_ADDRESS_BYTES:
        raise ControlError(f"{short} is too long for a socket: set TMPDIR to a shorter path")
    return short


def remove_socket(address: Path) -> Path | None:
    """Remove a socket that nobody serves, or move another file out of its place.

    Returns the new path of a file that was moved, else None. The caller holds the engine's lock.
    Raises OSError where the file cannot be moved.
    """
    try:
        mode = address.lstat().st_mode
    except FileNotFoundError:
        return None
    if stat.S_ISSOCK(mode):
        address.unlink(missing_ok=True)
        return None
    # An engine without its socket takes no STOP from a console: whatever lies there must go.
    number = 1
    while os.path.lexists(aside := address.with_name(f"{address.name}.aside-{number}")):
        number += 1
    address.rename(aside)
    return aside


def engine_pid(socket_path: Path) -> int | None:
    """Return the process that holds the engine's lock; None where none does.

    That process may not listen on its socket yet. None also where the system does not report the
    holder. The lock is only queried: to take it would turn away an engine that is just starting.
    """
    found = read_lock_holder(socket_address(socket_path).with_suffix(".lock"))
    return None if found is None else found[0]


class EngineLock(RecordLock):
    """Lock that allows one engine only behind each socket."""

    def __init__(self, socket_path: Path) -> None:
        super().__init__(socket_address(socket_path).with_suffix(".lock"), f"{os.getpid()}\n")

    def refusal(self, holder_words: str) -> str:
        """Return the error message for a second engine that finds the lock held."""
        return (
            f"an engine is already running (process {holder_words.strip() or 'unknown'}): "
            "'rsoconsole console' attaches to it"
        )


def _folder() -> Path:
    return state_dir() / "mounts"


class MountLock(RecordLock):
    """Lock that allows one engine only to move each mount."""

    def __init__(self, indi: IndiConfig, socket: Path) -> None:
        """``socket``: path of the socket on which the engine listens, or would listen."""
        name = re.sub(r"[^\w.-]+", "_", f"{indi.host}-{indi.port}-{indi.mount}")
        words = f"{os.getpid()}\n{socket}\n"
        super().__init__(_folder() / f"{name}.lock", words, is_removed=True)
        self._mount = indi.mount

    def refusal(self, holder_words: str) -> str:
        """Return the error message for a second engine that finds the lock held."""
        pid, socket = holder_words.partition("\n")[0], _socket_in(holder_words)
        return (
            f"an engine already drives {self._mount} (process {pid or 'unknown'}):"
            f" 'rsoconsole console{socket_option(socket)}' attaches to it"
        )


@dataclass(frozen=True, slots=True)
class RunningEngine:
    """An engine that holds a mount's lock: its process, and the socket on which it listens."""

    pid: int
    socket: Path


def running_engines() -> list[RunningEngine]:
    """Return every engine of this user that drives a mount."""
    found = []
    try:
        paths = sorted(_folder().glob("*.lock"))
    except OSError:
        return []
    for path in paths:
        known = read_lock_holder(path)
        if known is not None:
            pid, said = known
            found.append(RunningEngine(pid, _socket_in(said)))
    return found


def running_engine_at(socket: Path) -> RunningEngine | None:
    """Return the running engine that was started with this socket path; None if there is none.

    The socket's file may be gone.
    """
    return next((each for each in running_engines() if each.socket == socket), None)


def socket_option(socket: Path) -> str:
    """Return the shell option that names an engine's socket; empty for the default socket."""
    is_usual = socket in {Path(), default_socket_path()}
    return "" if is_usual else f" --socket {shlex.quote(str(socket))}"


def _socket_in(words: str) -> Path:
    return Path(words.strip().partition("\n")[2])
