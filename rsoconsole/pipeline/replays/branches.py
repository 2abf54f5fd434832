"""Branches of a session: named what-ifs, stored in its folder.

``SESSION/branches/NAME`` holds a database like a session's, with the whole log as it would have
been. Its ``meta`` holds the original session (``branch_of``), the changed settings (``tried``), and
the figures before and after. The original is never written to. A branch has no pictures or frames
of its own: the reader takes them from the original.
"""

import re
import shutil
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from rsoconsole import __version__
from rsoconsole.base import SessionError, value_errors_as
from rsoconsole.pipeline.replays.what_if_log import WhatIf, rewritten_log
from rsoconsole.session import DATABASE, SessionReader, SessionWriter, paths_in, replace_folder

BRANCHES = "branches"
RESERVED = ("figures", "exports")
"""Names that a branch cannot have: folders for other derived files."""
_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,63}")
_OF_THE_SESSION = ("model_sha256", "clock_offset_s", "is_simulated", "t_started_utc_ns")
"""Keys of ``meta`` that a branch shares with its session."""
_WRITE_S = 120.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Branch:
    """Named what-if of a session, as stored in its folder."""

    name: str
    folder: Path
    changes: dict[str, Any] = field(default_factory=dict)
    figures: dict[str, Any] = field(default_factory=dict)
    t_made_utc_ns: int | None = None
    fault: str | None = None
    """Reason why the branch cannot be read; its figures and changes are then empty."""


def branch_folder(session: Path, name: str) -> Path:
    """Folder of the branch with that name. Raises SessionError for a name that is not allowed."""
    if not _NAME.fullmatch(name) or name.endswith("."):
        raise SessionError(
            f"{name!r} cannot name a branch: use up to 64 letters, digits, '-', '_' and '.',"
            " the first a letter, a digit or '_'"
        )
    if name.lower() in RESERVED:
        raise SessionError(f"'{name}' is kept for other derived files: choose another name")
    return session / BRANCHES / name


def new_branch_folder(session: Path, name: str, *, force: bool = False) -> Path:
    """Return the folder for a new branch. Raises SessionError where it cannot be made.

    ``force``: an existing branch of that name may be replaced.
    """
    folder = branch_folder(session, name)
    if folder.exists() and not force:
        raise SessionError(f"{session} has a branch '{name}' already: --force replaces it")
    if folder.exists() and not _is_branch(folder):
        raise SessionError(f"{folder} is no branch: move it away, or choose another name")
    return folder


def save_branch(what_if: WhatIf, name: str, *, force: bool = False) -> Path:
    """Save a what-if as a branch of its session; return the branch's folder.

    The branch is complete or absent: it is written in a temporary folder and renamed. Raises
    SessionError for a name that is not allowed or is taken (unless ``force``), and where it cannot
    be written.
    """
    folder = new_branch_folder(what_if.session, name, force=force)
    beside = folder.with_name(f".{name}.part")
    try:
        folder.parent.mkdir(exist_ok=True)
        shutil.rmtree(beside, ignore_errors=True)
        _write(what_if, name, beside)
        replace_folder(beside, folder)
    except OSError as error:
        raise SessionError(
            f"no branch can be written in {folder.parent}: {error}; free some disk, or copy the"
            " session to a place that you can write"
        ) from error
    finally:
        shutil.rmtree(beside, ignore_errors=True)
    return folder


def branches_of(session: Path) -> tuple[Branch, ...]:
    """Session's branches in order of name. Raises SessionError where they cannot be listed."""
    folders = sorted(paths_in(session / BRANCHES))
    return tuple(_branch(folder) for folder in folders if _is_branch(folder))


def drop_branch(session: Path, name: str) -> Path:
    """Delete a branch; return its former folder. Raises SessionError where there is none."""
    folder = branch_folder(session, name)
    if not _is_branch(folder):
        names = ", ".join(each.name for each in branches_of(session)) or "none"
        raise SessionError(f"{session} has no branch '{name}'; it has: {names}")
    gone = folder.with_name(f".{name}.gone")
    with value_errors_as(SessionError, f"{folder} cannot be deleted: ", OSError):
        shutil.rmtree(gone, ignore_errors=True)
        folder.rename(gone)
        shutil.rmtree(gone)
    return folder


def _is_branch(folder: Path) -> bool:
    return (
        not folder.name.startswith(".")
        and folder.name not in RESERVED
        and (folder / DATABASE).is_file()
    )


def _branch(folder: Path) -> Branch:
    try:
        about = SessionReader(folder).read_meta()
    except SessionError as error:
        return Branch(name=folder.name, folder=folder, fault=str(error))
    made = about.get("t_made_utc_ns")
    return Branch(
        name=folder.name,
        folder=folder,
        changes=dict(about.get("tried") or {}),
        figures=dict(about.get("figures") or {}),
        t_made_utc_ns=made if isinstance(made, int) else None,
    )


def _write(what_if: WhatIf, name: str, folder: Path) -> None:
    session = SessionReader(what_if.session).read_meta()
    title = session.get("title") or what_if.session.resolve().name
    about = {key: session[key] for key in _OF_THE_SESSION if key in session}
    about |= {
        "title": f"{title} · {name}",
        "branch_of": "../..",
        "tried": dict(what_if.changes),
        "rerun": None if what_if.rerun is None else asdict(what_if.rerun),
        "figures": {"recorded": asdict(what_if.recorded), "what_if": asdict(what_if.what_if)},
        "t_made_utc_ns": time.time_ns(),
        "versions": {"rsoconsole": __version__},
    }
    if what_if.model_sha256 is not None:
        about["model_sha256"] = what_if.model_sha256
    records = 0
    writer = SessionWriter.create(folder, what_if.config, about)
    try:
        for t_utc_ns, record in rewritten_log(what_if):
            writer.append(record, t_utc_ns)
            records += 1
    finally:
        writer.close(_WRITE_S)
    if writer.faults:  # a live session's never raises for them
        raise SessionError(f"the branch cannot be written: {'; '.join(writer.faults)}")
    if SessionReader(folder).counts().records != records:
        raise SessionError("the branch could not be written in whole: free some disk and try again")
    for empty in (path for path in folder.iterdir() if path.is_dir()):
        empty.rmdir()
