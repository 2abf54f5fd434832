"""Where the control socket lies, and who may open it: one engine for each user."""

import fcntl
import hashlib
import os
import stat
import struct
import sys
import tempfile
import threading
from pathlib import Path

from rsoconsole.config import runtime_dir
from rsoconsole.errors import ControlError

MAX_ADDRESS_BYTES = 100
"""Linux takes 107 bytes in ``sun_path``, macOS 103."""

_FLOCK = "hhqqi"
"""struct flock of 64-bit Linux: type, whence, start, length, process."""

_held: set[Path] = set()
_held_guard = threading.Lock()


def default_socket_path() -> Path:
    """Where the engine of this user listens."""
    return runtime_dir() / "engine.sock"


def address_of(path: Path) -> Path:
    """``path`` where a socket can have so long a name; else a short one made from it.

    The short one lies in a folder of this user's own under the folder for temporary files.
    Raises ControlError when that folder belongs to another or lets others in.
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


def remove_socket(address: Path) -> None:
    """Remove a socket that nobody serves; what is no socket is left alone.

    The caller holds the engine's lock. Raises ControlError when something else lies there.
    """
    try:
        mode = address.lstat().st_mode
    except FileNotFoundError:
        return
    if not stat.S_ISSOCK(mode):
        raise ControlError(f"{address} is not a socket")
    address.unlink(missing_ok=True)


def engine_pid(socket_path: Path) -> int | None:
    """The process that holds the engine's lock, listening or not yet; None where none does.

    None also where the system does not tell. Only asks: a lock taken for the asking would turn
    away an engine that starts just now.
    """
    if sys.platform != "linux":
        return None
    path = address_of(socket_path).with_suffix(".lock")
    with _held_guard:
        # To close any descriptor of it would let go of this process's own lock.
        if path in _held:
            return os.getpid()
        try:
            descriptor = os.open(path, os.O_RDWR | os.O_CLOEXEC)
        except OSError:
            return None
        try:
            question = struct.pack(_FLOCK, fcntl.F_WRLCK, os.SEEK_SET, 0, 0, 0)
            kind, *_, pid = struct.unpack(_FLOCK, fcntl.fcntl(descriptor, fcntl.F_GETLK, question))
        except OSError:
            return None
        finally:
            os.close(descriptor)
    return None if kind == fcntl.F_UNLCK else int(pid)


class EngineLock:
    """Held by the one engine behind a socket; the system lets go of it when the engine dies.

    A POSIX record lock, because children must not inherit it: a camera's process that outlives
    the engine would otherwise keep the next engine out.
    """

    def __init__(self, socket_path: Path) -> None:
        self._path = address_of(socket_path).with_suffix(".lock")
        self._descriptor: int | None = None

    def acquire(self) -> None:
        """Raises ControlError, with the other engine's process number, when one is running."""
        with _held_guard:
            # A process does not conflict with its own record lock.
            if self._path in _held:
                raise ControlError("an engine is already running in this very process")
            try:
                self._path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
                descriptor = os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
            except OSError as error:
                raise ControlError(
                    f"the engine's lock {self._path} cannot be made: {error}"
                ) from error
            try:
                fcntl.lockf(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError as error:
                holder = os.read(descriptor, 32).decode("ascii", "replace").strip()
                os.close(descriptor)
                raise ControlError(
                    f"an engine is already running (process {holder or 'unknown'}): "
                    "'rsoconsole console' attaches to it"
                ) from error
            os.ftruncate(descriptor, 0)
            os.write(descriptor, f"{os.getpid()}\n".encode("ascii"))
            self._descriptor = descriptor
            _held.add(self._path)

    def release(self) -> None:
        """Let the next engine in; nothing when the lock is not held."""
        with _held_guard:
            if self._descriptor is not None:
                os.close(self._descriptor)
                self._descriptor = None
                _held.discard(self._path)

    def __enter__(self) -> "EngineLock":
        self.acquire()
        return self

    def __exit__(self, *exception: object) -> None:
        self.release()
