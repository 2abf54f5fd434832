"""Which sessions may give their disk back, by a policy: a plan first, then, when told so, the deed.

By default only frames go, the log stays for ever. What goes is on record beside the session before
it goes, so that a later verification reads "pruned" and not "missing".
"""

import shutil
import sqlite3
from collections.abc import Iterable
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias

from rsoconsole.errors import SessionError, said_as
from rsoconsole.session.files import add_note, written_ns
from rsoconsole.session.reading import SessionReader
from rsoconsole.session.upkeep.store import (
    SessionSummary,
    list_sessions,
    remove_folder,
    sweep_removed,
)

What: TypeAlias = Literal["frames", "previews", "all"]
"""The frames · the small pictures and closeups · the session whole, its log included."""
_ROLES = {"frames": ("frame",), "previews": ("preview", "closeup")}
NS_PER_DAY = 86_400_000_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Policy:
    """What may go; a session must be allowed to go by every rule that is set."""

    keep_days: float | None = None
    """Sessions younger than this are not touched."""
    keep_last: int | None = None
    """Number of newest sessions that are not touched."""
    free_bytes: int | None = None
    """The oldest go first, and no more than it takes until so much disk is free."""
    what: What = "frames"
    with_branches: bool = False
    """Also sessions on which a what-if branch stands."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """What would become of one session."""

    session: Path
    goes: bool
    why: str
    """Why it goes, or why it stays."""
    files: tuple[str, ...] = ()
    """Files that go, by their path in the session; empty for a session that goes whole."""
    bytes: int = 0
    """Disk that is given back."""


def plan_pruning(root: Path, policy: Policy, now_utc_ns: int) -> tuple[Step, ...]:
    """What the policy would do with every session under ``root``, the oldest first.

    Nothing is changed. A session is as old as its last record or its file, whichever is younger:
    the clock of a simulated night may stand years ago. Raises SessionError when the root cannot be
    looked into.
    """
    ages = sorted(((_last_touched_ns(each), each) for each in list_sessions(root)), key=_by_age)
    protected_from = len(ages) - (policy.keep_last or 0)
    is_wanted = policy.free_bytes is not None
    missing = policy.free_bytes - _free_bytes(root) if policy.free_bytes is not None else 0
    steps: list[Step] = []
    for place, (touched_ns, session) in enumerate(ages):
        age_days = (now_utc_ns - touched_ns) / NS_PER_DAY
        stays = _why_it_stays(session, policy)
        if stays is None and place >= protected_from:
            stays = f"one of the last {policy.keep_last}"
        if stays is None and policy.keep_days is not None and age_days < policy.keep_days:
            stays = f"{age_days:.1f} days old, kept for {policy.keep_days:g}"
        if stays is None and is_wanted and missing <= 0:
            stays = "enough disk is free without it"
        if stays is not None:
            steps.append(Step(session=session.folder, goes=False, why=stays))
            continue
        step = _what_goes(session, policy, f"{age_days:.0f} days old")
        missing -= step.bytes
        steps.append(step)
    return tuple(steps)


def prune(steps: Iterable[Step], policy: Policy, now_utc_ns: int) -> None:
    """Do what was planned. Each session's note is on the disk before its files go.

    Raises SessionError, naming the session, when the disk refuses; those before it are done.
    """
    for step in steps:
        if not step.goes:
            continue
        if policy.what == "all":
            sweep_removed(step.session.parent)
            remove_folder(step.session)
            continue
        remedy = "; see that you may write there, and prune again"
        with said_as(SessionError, f"{step.session} cannot be pruned: ", remedy):
            note = {"what": policy.what, "files": list(step.files), "bytes": step.bytes}
            add_note(step.session, "prune", now_utc_ns, note)
            for path in step.files:
                (step.session / path).unlink(missing_ok=True)


def _by_age(pair: tuple[int, SessionSummary]) -> tuple[int, str]:
    return pair[0], pair[1].folder.name


def _last_touched_ns(session: SessionSummary) -> int:
    return max(written_ns(session.folder), session.t_last_utc_ns or 0)


def _free_bytes(root: Path) -> int:
    with said_as(SessionError, f"{root} cannot be looked into: "):
        return shutil.disk_usage(root).free


def _why_it_stays(session: SessionSummary, policy: Policy) -> str | None:
    if session.is_kept:
        return "marked KEEP"
    if session.fault is not None:
        return "it cannot be read: repair it first"
    if session.state == "live":
        return "live"
    if session.state == "cut off":
        return "cut off: repair it first"
    if session.branches and not policy.with_branches:
        return f"a branch stands on it ({', '.join(session.branches)})"
    return None


def _what_goes(session: SessionSummary, policy: Policy, why: str) -> Step:
    if policy.what == "all":
        return Step(session=session.folder, goes=True, why=why, bytes=session.size_bytes)
    files = _files_there(session.folder, _ROLES[policy.what])
    if not files:
        return Step(session=session.folder, goes=False, why=f"no {policy.what} there")
    return Step(
        session=session.folder,
        goes=True,
        why=why,
        files=tuple(files),
        bytes=sum(files.values()),
    )


def _files_there(folder: Path, roles: tuple[str, ...]) -> dict[str, int]:
    """Bytes of the session's own files of these roles that are still there, by their path."""
    places = ", ".join("?" * len(roles))
    sql = f"SELECT path FROM files WHERE role IN ({places}) AND path IS NOT NULL ORDER BY path"
    try:
        with closing(SessionReader(folder).connect()) as connection:
            paths = [str(row[0]) for row in connection.execute(sql, roles)]
    except (SessionError, sqlite3.Error):
        return {}
    found: dict[str, int] = {}
    for path in paths:
        if Path(path).is_absolute() or ".." in Path(path).parts:
            continue
        try:
            found[path] = (folder / path).lstat().st_size
        except OSError:
            continue
    return found
