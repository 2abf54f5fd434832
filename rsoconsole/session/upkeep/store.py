"""The sessions under one root folder: their names, summaries, removal and pruning."""

import re
import shutil
import sqlite3
import tempfile
import unicodedata
from collections.abc import Iterable
from contextlib import closing
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal, TypeAlias

from rsoconsole.base import PART, SessionError, sample_session_folder, sync_folder, system_errors_as
from rsoconsole.session.files.digest import State, session_state
from rsoconsole.session.files.session_files import last_write_utc_ns, paths_in
from rsoconsole.session.files.upkeep_log import add_note, is_prune_protected
from rsoconsole.session.log.liveness import is_being_written
from rsoconsole.session.log.schema import BRANCHES, DATABASE, SCHEMA_VERSION
from rsoconsole.session.reading.reader import OtherSchemaError, SessionReader

_MAX_TITLE = 40
MAX_SEARCHED = 20
REMOVED = ".removed-"
"""Prefix given to the name of a session's folder while it is being removed."""
_FOLLOWED = """
SELECT count(DISTINCT frame_id) FROM track WHERE step != 'predicted' AND NOT is_superseded
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionSummary:
    """Summary of one session."""

    folder: Path
    title: str | None = None
    t_first_utc_ns: int | None = None
    t_last_utc_ns: int | None = None
    frames: int = 0
    records: int = 0
    size_bytes: int
    is_closed: bool = False
    """True where closed; False: live, or cut off before its end with all committed records."""
    fault: str | None = None
    """Reason why the session cannot be read (all other members are then empty); None: readable."""
    state: State = "unreadable"
    schema: int | None = None
    is_simulated: bool | None = None
    """True for a simulated night; None: not recorded, as for a session of recorded frames."""
    followed_frames: int = 0
    """Number of frames with a measurement that the lead track accepted."""
    branches: tuple[str, ...] = ()
    is_kept: bool = False
    """True where the session is marked as never to be pruned."""
    rescues: Path | None = None
    """Session that this session is a rescue of; None where it is no rescue."""

    @property
    def duration_s(self) -> float | None:
        """Time from the first to the last record, s; None where unknown."""
        if self.t_first_utc_ns is None or self.t_last_utc_ns is None:
            return None
        return (self.t_last_utc_ns - self.t_first_utc_ns) / 1e9

    @property
    def followed_share(self) -> float | None:
        """Fraction of the session's frames with a measurement of the lead track; None: no
        frames.
        """
        return self.followed_frames / self.frames if self.frames else None


def new_session_folder(root: Path, title: str, t_utc_ns: int) -> Path:
    """Return a free path for a new session, named by the UTC instant and the title.

    Creates nothing.
    """
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
    """Summarise every session directly under ``root``, in order of name; () without a root.

    Raises SessionError when the root cannot be read.
    """
    return tuple(summarise(folder) for folder in sorted(paths_in(root)) if _is_session(folder))


def find_cut_off_session(root: Path, *, is_simulated: bool) -> Path | None:
    """Return the newest session under ``root`` if its engine died before closing it, or None.

    ``is_simulated``: whether simulated or real nights are searched. Raises SessionError when the
    root cannot be read.
    """
    folders = filter(_is_session, paths_in(root))
    for folder in sorted(folders, key=last_write_utc_ns, reverse=True)[:MAX_SEARCHED]:
        try:
            about = SessionReader(folder).read_meta()
        except SessionError:
            continue
        if about.get("is_simulated") is is_simulated:
            is_over = about.get("is_closed") is True or is_being_written(about)
            return None if is_over else folder
    return None


def summarise(folder: Path) -> SessionSummary:
    """Return the summary of one session; for an unreadable one ``fault`` has the reason."""
    try:
        reader = SessionReader(folder)
        counts = reader.counts()
        about = reader.read_meta()
        followed_frames = _followed_frames(reader)
    except SessionError as error:
        return SessionSummary(
            folder=folder,
            size_bytes=size_bytes(folder),
            fault=str(error),
            state="other version" if isinstance(error, OtherSchemaError) else "unreadable",
            is_kept=is_prune_protected(folder),
        )
    title, is_simulated = about.get("title"), about.get("is_simulated")
    rescues = about.get("rescues")
    return SessionSummary(
        folder=folder,
        title=title if isinstance(title, str) else None,
        t_first_utc_ns=counts.t_first_utc_ns,
        t_last_utc_ns=counts.t_last_utc_ns,
        frames=counts.frames,
        records=counts.records,
        size_bytes=size_bytes(folder),
        is_closed=about.get("is_closed") is True,
        state=session_state(about),
        schema=SCHEMA_VERSION,
        is_simulated=is_simulated if isinstance(is_simulated, bool) else None,
        followed_frames=followed_frames,
        branches=list_branch_names(folder),
        is_kept=is_prune_protected(folder),
        rescues=Path(rescues) if isinstance(rescues, str) else None,
    )


def list_branch_names(folder: Path) -> tuple[str, ...]:
    """Return the names of the what-if branches in a session's folder, in order."""
    try:
        found = [path.name for path in (folder / BRANCHES).iterdir() if _is_session(path)]
    except OSError:
        return ()
    return tuple(sorted(found))


def remove_session(folder: Path) -> None:
    """Remove a session's folder with all of its files; raise SessionError on failure.

    A rename first hides it, so that no list shows a partly removed session.
    """
    going = folder.with_name(f"{REMOVED}{folder.name}")
    with system_errors_as(SessionError, f"{folder} cannot be removed: "):
        folder.rename(going)
        shutil.rmtree(going)
        sync_folder(folder.parent)


def finish_removals(root: Path) -> None:
    """Delete the remaining files of sessions under ``root`` whose removal was interrupted."""
    for path in root.glob(f"{REMOVED}*"):
        shutil.rmtree(path, ignore_errors=True)


def _is_session(folder: Path) -> bool:
    """True for a session's folder; one that is being made or removed is none."""
    if folder.name.startswith(REMOVED) or folder.name.endswith(PART):
        return False
    return (folder / DATABASE).exists()


def _followed_frames(reader: SessionReader) -> int:
    """Number of frames whose measurement the track accepted, by the final state."""
    with closing(reader.connect()) as connection:
        try:
            ((frames,),) = connection.execute(_FOLLOWED)
        except sqlite3.Error as error:
            raise SessionError(f"the track of {reader.folder} cannot be read: {error}") from error
    return int(frames)


def size_bytes(folder: Path) -> int:
    """Return the total size of all files in the folder, bytes; vanished files count 0."""
    total = 0
    for path in folder.rglob("*"):
        try:
            total += path.lstat().st_size if path.is_file() else 0
        except OSError:
            continue
    return total


SAMPLE_NAME = "sample-intelsat-14"


def get_or_copy_sample_session(root: Path) -> Path:
    """Return the sample session's copy under ``root``; make the copy where there is none.

    Branches go into the copy, not into the installed original. Raises SessionError.
    """
    folder = root / SAMPLE_NAME
    if (folder / "session.db").exists():
        return folder
    words = f"the sample session cannot be copied to {folder} ("
    with system_errors_as(SessionError, words, "): make room there, or set session.root"):
        source = sample_session_folder()
        root.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".sample-", dir=root) as scratch:
            made = Path(scratch) / SAMPLE_NAME
            shutil.copytree(source, made, ignore=shutil.ignore_patterns("branches"))
            for path in (made, *made.rglob("*")):
                # An installation may be read-only, the session is the user's.
                path.chmod(0o755 if path.is_dir() else 0o644)
            made.rename(folder)
    return folder


What: TypeAlias = Literal["frames", "previews", "all"]
"""Files to prune: frames, small pictures and closeups, or the whole session with its log."""
_ROLES = {"frames": ("frame",), "previews": ("preview", "closeup")}
NS_PER_DAY = 86_400_000_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class PruningPolicy:
    """Rules of pruning; a session is pruned only where every rule that is set allows it."""

    keep_days: float | None = None
    """Sessions younger than this are not touched, days; None: no such rule."""
    keep_last: int | None = None
    """Number of newest sessions that are not touched; None: no such rule."""
    free_bytes: int | None = None
    """Free disk to reach: the oldest go first, and no more than needed."""
    what: What = "frames"
    with_branches: bool = False
    """False: sessions that have a what-if branch are not touched."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PruningStep:
    """What pruning will do with one session, and why."""

    session: Path
    goes: bool
    why: str
    files: tuple[str, ...] = ()
    """Files to remove, by path in the session; empty where the whole session is removed."""
    bytes: int = 0


def plan_pruning(root: Path, policy: PruningPolicy, now_utc_ns: int) -> tuple[PruningStep, ...]:
    """Plan the pruning of every session under ``root``, the oldest first; change nothing.

    A session's age counts from its last record or the last write to it, whichever is later: the
    clock of a simulated night may be years off. Raises SessionError when the root cannot be read.
    """
    ages = [
        (max(last_write_utc_ns(each.folder), each.t_last_utc_ns or 0), each)
        for each in list_sessions(root)
    ]
    ages.sort(key=lambda pair: pair[0])  # sessions of one age stay in order of name
    protected_from = len(ages) - (policy.keep_last or 0)
    missing = policy.free_bytes - _free_bytes(root) if policy.free_bytes is not None else 0
    steps: list[PruningStep] = []
    for place, (touched_ns, session) in enumerate(ages):
        age_days = (now_utc_ns - touched_ns) / NS_PER_DAY
        stays = _reason_to_keep(session, policy)
        if stays is None and place >= protected_from:
            stays = f"one of the last {policy.keep_last}"
        if stays is None and policy.keep_days is not None and age_days < policy.keep_days:
            stays = f"{age_days:.1f} days old, kept for {policy.keep_days:g}"
        if stays is None and policy.free_bytes is not None and missing <= 0:
            stays = "enough disk is free without it"
        if stays is not None:
            steps.append(PruningStep(session=session.folder, goes=False, why=stays))
            continue
        step = _pruning_step(session, policy, f"{age_days:.0f} days old")
        missing -= step.bytes
        steps.append(step)
    return tuple(steps)


def prune(steps: Iterable[PruningStep], policy: PruningPolicy, now_utc_ns: int) -> None:
    """Remove the files or sessions that a plan of ``plan_pruning`` names.

    The note of a session is on the disk before files of it are removed; removed sessions get none.
    Raises SessionError, naming the session, when the disk refuses; the sessions earlier in the plan
    have then been pruned.
    """
    for step in steps:
        if not step.goes:
            continue
        if policy.what == "all":
            finish_removals(step.session.parent)
            remove_session(step.session)
            continue
        remedy = "; see that you may write there, and prune again"
        with system_errors_as(SessionError, f"{step.session} cannot be pruned: ", remedy):
            note = {"what": policy.what, "files": list(step.files), "bytes": step.bytes}
            add_note(step.session, "prune", now_utc_ns, note)
            for path in step.files:
                (step.session / path).unlink(missing_ok=True)


def _free_bytes(root: Path) -> int:
    with system_errors_as(SessionError, f"{root} cannot be looked into: "):
        return shutil.disk_usage(root).free


def _reason_to_keep(session: SessionSummary, policy: PruningPolicy) -> str | None:
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


def _pruning_step(session: SessionSummary, policy: PruningPolicy, why: str) -> PruningStep:
    if policy.what == "all":
        return PruningStep(session=session.folder, goes=True, why=why, bytes=session.size_bytes)
    files = _files_there(session.folder, _ROLES[policy.what])
    if not files:
        return PruningStep(session=session.folder, goes=False, why=f"no {policy.what} there")
    return PruningStep(
        session=session.folder, goes=True, why=why, files=tuple(files), bytes=sum(files.values())
    )


def _files_there(folder: Path, roles: tuple[str, ...]) -> dict[str, int]:
    """Sizes of the session's own files of these roles that are still there, bytes by path."""
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
