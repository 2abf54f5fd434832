"""Writes files that are complete under their final name or absent; locks files."""

import errno
import fcntl
import os
import time
from pathlib import Path

PART = ".part"
_POLL_S = 0.05


def write_durably(path: Path, content: bytes, mode: int | None = None) -> None:
    """Write a file so that ``path`` is complete or unchanged, and wait until it is on the disk.

    ``mode``: permissions, in force from the first byte on; None: the user's default ones. Raises
    OSError; on any failure the unfinished file is removed.
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
    """Wait until a folder's list of names is on the disk: a rename is durable only then.

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
    """Lock a file, created if missing, and return its descriptor; closing it releases the lock.

    Raises BlockingIOError where another process holds the lock for longer than ``wait_s``, OSError
    where the file cannot be created.
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
