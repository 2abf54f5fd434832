"""Files that are whole on the disk, with their names, or not there at all."""

import errno
import os
from pathlib import Path

PART = ".part"
"""Ending of a file that is not yet whole."""


def write_durably(path: Path, content: bytes, mode: int | None = None) -> None:
    """Put a whole file in place or none, and wait until the disk has it and its name.

    ``mode``: its rights from the first byte on; None: the user's usual ones. Raises
    OSError; whatever happens, what was begun is removed.
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
