"""Files that are written whole, name included, or not at all; files that lock."""

import errno
import fcntl
import os
import time
from pathlib import Path

PART = ".part"
"""Ending of a file that is not yet whole."""
_POLL_S = 0.05


def write_durably(path: Path, content: bytes, mode: int | None = None) -> None:
    """Put a whole file in place or none, and wait until the disk has it and its name.

    ``mode``: its permissions from the first byte on; None: the user's usual ones. Raises OSError;
    on any failure the unfinished file is removed.
    """
    beside = path.with_name(path.name + PART)
    try:
        with beside.open("wb") as stream:
            if mode is not None:
                os.fchmod(stream.fileno(), mode)
            stream.write(content)
            stream.flush()
            os.fsync(stream.fileno())
        beside.replace(path)
    except BaseException:
        beside.unlink(missing_ok=True)
        raise
    sync_folder(path.parent)


def sync_folder(folder: Path) -> None:
    """Wait until the disk has the names in the folder: a renamed file is safe only then.

    Raises OSError.
    """
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    except OSError as error:
        # Some file systems (network shares) cannot, and say so; they keep names by themselves.
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):
            raise
    finally:
        os.close(descriptor)


def lock_file(path: Path, *, wait_s: float = 0.0) -> int:
    """Return the descriptor of a file, created if missing, that others cannot lock until it is
    closed.

    Raises BlockingIOError where another has it for longer than ``wait_s``, OSError where it cannot
    be made.
    """
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    deadline = time.monotonic() + wait_s
    try:
        while True:
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
                return descriptor
            except BlockingIOError:
                if time.monotonic() >= deadline:
                    raise
                time.sleep(_POLL_S)
    except BaseException:
        os.close(descriptor)
        raise
