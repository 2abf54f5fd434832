"""Sessions under one root: their names, what is in each, how much disk they take."""

import os
import re
import unicodedata
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from rsoconsole.errors import SessionError
from rsoconsole.session.reader import SessionReader
from rsoconsole.session.schema import DATABASE

_MAX_TITLE = 40
LOOKED_AT = 20


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionSummary:
    """One session at a glance."""

    folder: Path
    title: str | None
    t_first_utc_ns: int | None
    t_last_utc_ns: int | None
    frames: int
    records: int
    size_bytes: int
    is_closed: bool
    """False: live, or cut off before its end; every committed record is there all the same."""
    fault: str | None
    """Why the session cannot be read; the other members are then empty."""


def new_session_folder(root: Path, title: str, t_utc_ns: int) -> Path:
    """A folder name that is free: the UTC instant, then the title. Nothing is made yet."""
    instant = datetime.fromtimestamp(t_utc_ns // 1_000_000_000, tz=UTC)
    plain = unicodedata.normalize("NFKD", title).encode("ascii", "ignore").decode().lower()
    words = re.sub(r"[^a-z0-9]+", "-", plain).strip("-")[:_MAX_TITLE].strip("-")
    name = f"{instant:%Y%m%dT%H%M%SZ}" + (f"-{words}" if words else "")
    folder, number = root / name, 1
    while folder.exists():
        number += 1
        folder = root / f"{name}-{number}"
    return folder


def list_sessions(root: Path) -> tuple[SessionSummary, ...]:
    """Every session directly under ``root``, in order of name; empty when there is no root.

    Raises SessionError when the root cannot be looked into.
    """
    try:
        folders = sorted(p for p in root.iterdir() if (p / DATABASE).exists())
    except FileNotFoundError:
        return ()
    except OSError as error:
        raise SessionError(f"{root} cannot be looked into: {error}") from error
    return tuple(summarise(folder) for folder in folders)


def cut_off_session(root: Path, *, is_simulated: bool) -> Path | None:
    """The newest session under ``root`` if its engine died before it could close it.

    Sessions of simulated and of real nights are told apart; one whose engine still lives is not
    cut off. Raises SessionError when the root cannot be looked into.
    """
    try:
        folders = [path for path in root.iterdir() if (path / DATABASE).exists()]
        newest = sorted(folders, key=lambda path: (path / DATABASE).stat().st_mtime, reverse=True)
    except FileNotFoundError:
        return None
    except OSError as error:
        raise SessionError(f"{root} cannot be looked into: {error}") from error
    for folder in newest[:LOOKED_AT]:
        try:
            about = SessionReader(folder).about()
        except SessionError:
            continue
        if about.get("is_simulated") is is_simulated:
            is_over = about.get("is_closed") is True or is_alive(about.get("pid"))
            return None if is_over else folder
    return None


def is_alive(pid: object) -> bool:
    """Whether the process that a session names as its engine still runs on this machine."""
    if not isinstance(pid, int):
        return False
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True


def summarise(folder: Path) -> SessionSummary:
    """One session at a glance; a session that cannot be read says why."""
    try:
        reader = SessionReader(folder)
        counts = reader.counts()
        about = reader.about()
    except SessionError as error:
        return SessionSummary(
            folder=folder,
            title=None,
            t_first_utc_ns=None,
            t_last_utc_ns=None,
            frames=0,
            records=0,
            size_bytes=size_bytes(folder),
            is_closed=False,
            fault=str(error),
        )
    title = about.get("title")
    return SessionSummary(
        folder=folder,
        title=title if isinstance(title, str) else None,
        t_first_utc_ns=counts.t_first_utc_ns,
        t_last_utc_ns=counts.t_last_utc_ns,
        frames=counts.frames,
        records=counts.records,
        size_bytes=size_bytes(folder),
        is_closed=about.get("is_closed") is True,
        fault=None,
    )


def size_bytes(folder: Path) -> int:
    """Disk taken by everything in the folder; files that vanish meanwhile count nothing."""
    total = 0
    for path in folder.rglob("*"):
        try:
            total += path.lstat().st_size if path.is_file() else 0
        except OSError:
            continue
    return total
