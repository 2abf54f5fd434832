"""Sessions under one root: their names, what is in each, how much disk they take."""

import re
import shutil
import sqlite3
import unicodedata
from contextlib import closing
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from rsoconsole.durable_files import PART, sync_folder
from rsoconsole.errors import SessionError, said_as
from rsoconsole.session.files import State, folders_in, is_kept, state_of, written_ns
from rsoconsole.session.log import BRANCHES, DATABASE, SCHEMA_VERSION, is_written
from rsoconsole.session.reading import OtherSchemaError, SessionReader

_MAX_TITLE = 40
LOOKED_AT = 20
REMOVED = ".removed-"
"""Before the name of a session's folder that is on its way out."""
_FOLLOWED = """
SELECT count(DISTINCT frame_id) FROM track WHERE step != 'predicted' AND NOT is_superseded
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionSummary:
    """One session at a glance."""

    folder: Path
    title: str | None = None
    t_first_utc_ns: int | None = None
    t_last_utc_ns: int | None = None
    frames: int = 0
    records: int = 0
    size_bytes: int
    is_closed: bool = False
    """False: live, or cut off before its end; every committed record is there all the same."""
    fault: str | None = None
    """Why the session cannot be read; the other members are then empty."""
    state: State = "unreadable"
    schema: int | None = None
    is_simulated: bool | None = None
    """None: the session does not say, such as one made of recorded frames."""
    followed_frames: int = 0
    """Frames in which the object followed was measured, and the track took it."""
    branches: tuple[str, ...] = ()
    """What-if branches by name."""
    is_kept: bool = False
    """Marked as never to be pruned."""
    rescues: Path | None = None
    """The session whose place it took while that could not be written; None of any other."""

    @property
    def duration_s(self) -> float | None:
        """From the first record to the last."""
        if self.t_first_utc_ns is None or self.t_last_utc_ns is None:
            return None
        return (self.t_last_utc_ns - self.t_first_utc_ns) / 1e9

    @property
    def followed_share(self) -> float | None:
        """Of all frames, those in which the object followed was measured, 0 to 1."""
        return self.followed_frames / self.frames if self.frames else None


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
    return tuple(summarise(folder) for folder in sorted(folders_in(root)) if _is_session(folder))


def cut_off_session(root: Path, *, is_simulated: bool) -> Path | None:
    """The newest session under ``root`` if its engine died before it could close it.

    Sessions of simulated and of real nights are told apart; one whose engine still lives is not
    cut off. Raises SessionError when the root cannot be looked into.
    """
    folders = filter(_is_session, folders_in(root))
    for folder in sorted(folders, key=written_ns, reverse=True)[:LOOKED_AT]:
        try:
            about = SessionReader(folder).about()
        except SessionError:
            continue
        if about.get("is_simulated") is is_simulated:
            is_over = about.get("is_closed") is True or is_written(about)
            return None if is_over else folder
    return None


def summarise(folder: Path) -> SessionSummary:
    """One session at a glance; a session that cannot be read says why."""
    try:
        reader = SessionReader(folder)
        counts = reader.counts()
        about = reader.about()
        followed_frames = _followed_frames(reader)
    except SessionError as error:
        return SessionSummary(
            folder=folder,
            size_bytes=size_bytes(folder),
            fault=str(error),
            state="other version" if isinstance(error, OtherSchemaError) else "unreadable",
            is_kept=is_kept(folder),
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
        state=state_of(about),
        schema=SCHEMA_VERSION,
        is_simulated=is_simulated if isinstance(is_simulated, bool) else None,
        followed_frames=followed_frames,
        branches=branches_of(folder),
        is_kept=is_kept(folder),
        rescues=Path(rescues) if isinstance(rescues, str) else None,
    )


def branches_of(folder: Path) -> tuple[str, ...]:
    """Names of the what-if branches in a session's folder, in order."""
    try:
        found = [path.name for path in (folder / BRANCHES).iterdir() if _is_session(path)]
    except OSError:
        return ()
    return tuple(sorted(found))


def remove_folder(folder: Path) -> None:
    """Remove a session whole: it is gone from the list at once, and its files follow.

    Raises SessionError.
    """
    going = folder.with_name(f"{REMOVED}{folder.name}")
    with said_as(SessionError, f"{folder} cannot be removed: "):
        folder.rename(going)
        shutil.rmtree(going)
        sync_folder(folder.parent)


def sweep_removed(root: Path) -> None:
    """Finish what a removal that was cut off has left."""
    for path in root.glob(f"{REMOVED}*"):
        shutil.rmtree(path, ignore_errors=True)


def _is_session(folder: Path) -> bool:
    """Whether a session lies there; one that is being made or removed is none."""
    if folder.name.startswith(REMOVED) or folder.name.endswith(PART):
        return False
    return (folder / DATABASE).exists()


def _followed_frames(reader: SessionReader) -> int:
    """Frames whose measurement the track took, as it stood in the end."""
    with closing(reader.connect()) as connection:
        try:
            ((frames,),) = connection.execute(_FOLLOWED)
        except sqlite3.Error as error:
            raise SessionError(f"the track of {reader.folder} cannot be read: {error}") from error
    return int(frames)


def size_bytes(folder: Path) -> int:
    """Disk taken by everything in the folder; files that vanish meanwhile count nothing."""
    total = 0
    for path in folder.rglob("*"):
        try:
            total += path.lstat().st_size if path.is_file() else 0
        except OSError:
            continue
    return total
