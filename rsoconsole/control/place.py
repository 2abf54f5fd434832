"""Where the control socket lies, and who may open it: one engine for each user."""

import hashlib
import os
import stat
import tempfile
from pathlib import Path

from rsoconsole.config import runtime_dir
from rsoconsole.control.record_lock import RecordLock, holder
from rsoconsole.errors import ControlError

MAX_ADDRESS_BYTES = 100
"""Linux takes 107 bytes in ``sun_path``, macOS 103."""


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


def remove_socket(address: Path) -> Path | None:
    """Remove a socket that nobody serves; what is no socket is put aside: where, else None.

    The caller holds the engine's lock. Raises OSError where it can be moved nowhere.
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
    """The process that holds the engine's lock, listening or not yet; None where none does.

    None also where the system does not tell. Only asks: a lock taken for the asking would turn
    away an engine that starts just now.
    """
    return holder(address_of(socket_path).with_suffix(".lock"))


class EngineLock(RecordLock):
    """Held by the one engine behind a socket."""

    def __init__(self, socket_path: Path) -> None:
        super().__init__(address_of(socket_path).with_suffix(".lock"), f"{os.getpid()}\n")

    def refusal(self, holder_words: str) -> str:
        """What is said to a second engine."""
        return (
            f"an engine is already running (process {holder_words.strip() or 'unknown'}): "
            "'rsoconsole console' attaches to it"
        )
