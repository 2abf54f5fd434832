"""Folders of sessions: what lies in one, and how one that is made beside its place takes it."""

import contextlib
import shutil
from pathlib import Path

from rsoconsole.errors import SessionError, said_as
from rsoconsole.session.log import DATABASE


def folders_in(root: Path) -> list[Path]:
    """What lies directly in a folder; nothing where there is none. Raises SessionError."""
    refused = said_as(SessionError, f"{root} cannot be looked into: ")
    with refused, contextlib.suppress(FileNotFoundError):
        return list(root.iterdir())
    return []


def written_ns(folder: Path) -> int:
    """When a session's log was written to last; 0: nobody can say."""
    with contextlib.suppress(OSError):
        return (folder / DATABASE).stat().st_mtime_ns
    return 0


def put_in_place(beside: Path, folder: Path) -> None:
    """Rename ``beside`` to ``folder``; what was there is gone only when the new one stands.

    Raises OSError.
    """
    if not folder.exists():
        beside.rename(folder)
        return
    gone = folder.with_name(f".{folder.name}.gone")
    shutil.rmtree(gone, ignore_errors=True)
    folder.rename(gone)
    beside.rename(folder)
    shutil.rmtree(gone, ignore_errors=True)
