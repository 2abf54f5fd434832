"""Brings what a rescue session holds back into the session whose place it took.

The rescue is removed only when all of it has been read back from there; whatever goes wrong before,
both are as they were.
"""

import os
import shutil
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rsoconsole.durable_files import PART
from rsoconsole.errors import SessionError, raised_as
from rsoconsole.session.files.digest import META_KEY as DIGEST_KEY
from rsoconsole.session.files.digest import (
    LogDigest,
    content_fault,
    digest_log,
    found_row,
    mark_closed,
)
from rsoconsole.session.files.holdings import FolderHoldings
from rsoconsole.session.files.upkeep_log import add_note
from rsoconsole.session.log.database import (
    FILE_ROW,
    FILE_ROWS,
    INSERT_FILE,
    INSERT_RECORD,
    LOG_ROW,
    LOG_ROWS,
    connect_to_write,
    leave_wal,
    transaction,
)
from rsoconsole.session.log.schema import BRANCHES, DATABASE, JOURNAL, WAL, role_of
from rsoconsole.session.log.worker import is_written
from rsoconsole.session.reading.reader import OtherSchemaError, SessionReader
from rsoconsole.session.upkeep.recover import Recovered, recover_session
from rsoconsole.session.upkeep.store import remove_folder
from rsoconsole.session.upkeep.verify import page_faults
from rsoconsole.session.writing.log_writer import rescue_places

LEAVE_WAL_S = 3.0
_AT_A_TIME = 1000


@dataclass(frozen=True, slots=True, kw_only=True)
class Merged:
    """What came from a rescue session into its session; the rescue is gone."""

    rescue: Path
    session: Path
    records: int
    files: int


def rescued_session(folder: Path) -> Path | None:
    """The session that this one is a rescue of; None where it is none, or cannot be read."""
    try:
        named = SessionReader(folder).about().get("rescues")
    except SessionError:
        return None
    is_path = isinstance(named, str) and "\0" not in named and Path(named).is_absolute()
    return Path(str(named)) if is_path else None


def find_rescues() -> tuple[Path, ...]:
    """Every rescue session of this user, in all places where one may be."""
    found: dict[Path, None] = {}
    for place in rescue_places():
        try:
            folders = sorted(path for path in place.iterdir() if (path / DATABASE).is_file())
        except OSError:
            continue
        found |= dict.fromkeys(path for path in folders if path.lstat().st_uid == os.getuid())
    return tuple(found)


def rescues_of(session: Path) -> tuple[Path, ...]:
    """The rescue sessions of a session."""
    own = session.resolve()
    return tuple(
        rescue
        for rescue in find_rescues()
        if (named := rescued_session(rescue)) is not None and named.resolve() == own
    )


def merge_rescue(rescue: Path, now_utc_ns: int) -> Merged:
    """Take what the rescue has and its session lacks into the session, verify that, remove it.

    No record is changed: where both have one and they differ, nothing is done. Raises SessionError
    with why not; the rescue is kept then.
    """
    session = rescued_session(rescue)
    if session is None:
        raise SessionError(f"{rescue} does not say which session it is a rescue of")
    if session.resolve() == rescue.resolve():
        raise SessionError(f"{rescue} calls itself its own rescue")
    source, target = SessionReader(rescue), _target(session)
    for reader in (source, target):
        about = reader.about()
        if is_written(about):
            raise SessionError(f"{reader.folder} is being written: end its engine first")
        with closing(reader.connect()) as connection:
            if page_faults(connection):
                raise SessionError(f"the database of {reader.folder} is damaged")
    _expect_sound_digest(target)
    with raised_as(SessionError, f"{session} does not take it: ", (sqlite3.Error, OSError)):
        records, files = _insert(source, session / DATABASE)
        leave_wal(session / DATABASE, LEAVE_WAL_S)
        _expect_all(source, SessionReader(session))
        details: dict[str, Any] = {"rescue": str(rescue), "records": records, "files": files}
        add_note(session, "merge", now_utc_ns, details)
    remove_folder(rescue)
    return Merged(rescue=rescue, session=session, records=records, files=files)


def _target(session: Path) -> SessionReader:
    with raised_as(SessionError, "its session is gone or cannot be read: ", SessionError):
        return SessionReader(session)


def _expect_sound_digest(target: SessionReader) -> None:
    """A log that is not what was closed is not continued."""
    recorded = LogDigest.from_meta(target.about())
    with closing(target.connect()) as connection:
        if recorded is not None and digest_log(connection) != recorded:
            raise SessionError(f"the log of {target.folder} is not the log that was closed")


def _insert(source: SessionReader, database: Path) -> tuple[int, int]:
    """Numbers of records and rows of files that came, in one commit; then the end is marked."""
    free_bytes = shutil.disk_usage(database.parent).free
    needed_bytes = (source.folder / DATABASE).stat().st_size
    if free_bytes < 2 * needed_bytes:
        raise SessionError(
            f"{database.parent} has {free_bytes / 1e6:.0f} MB left on its disk, "
            f"{2 * needed_bytes / 1e6:.0f} are needed"
        )
    with closing(connect_to_write(database)) as connection:
        with transaction(connection):
            records = sum(_take_record(connection, row) for row in _rows(source, LOG_ROWS))
            files = sum(_take_file(connection, row) for row in _rows(source, FILE_ROWS))
            # Until its end is marked again it counts as cut off.
            connection.execute("DELETE FROM meta WHERE key = ?", (DIGEST_KEY,))
            connection.execute("UPDATE meta SET value = 'false' WHERE key = 'is_closed'")
        mark_closed(connection)
    return records, files


def _take_record(connection: sqlite3.Connection, row: tuple[Any, ...]) -> bool:
    known = connection.execute(LOG_ROW, row[:1]).fetchone()
    if known is None:
        connection.execute(INSERT_RECORD, row)
    elif known != row:
        raise SessionError(f"record {row[0]} is another one in the session than in the rescue")
    return known is None


def _take_file(connection: sqlite3.Connection, row: tuple[Any, ...]) -> bool:
    """The rescue's row holds: it was written when the session took no more."""
    is_new = bool(connection.execute(FILE_ROW, row[:2]).fetchone() != row)
    if is_new:
        connection.execute(INSERT_FILE, row)
    return is_new


def _expect_all(source: SessionReader, target: SessionReader) -> None:
    """Read back what was written. Raises SessionError where anything is missing."""
    with closing(target.connect()) as connection:
        if page_faults(connection):
            raise SessionError(f"the database of {target.folder} is damaged")
        for row in _rows(source, LOG_ROWS):
            if connection.execute(LOG_ROW, row[:1]).fetchone() != row:
                raise SessionError(f"record {row[0]} cannot be read back from {target.folder}")
        known = {tuple(row) for row in connection.execute(FILE_ROWS)}
    if any(row not in known for row in _rows(source, FILE_ROWS)):
        raise SessionError(f"the files of {source.folder} cannot be read back")
    _expect_sound_digest(target)


def _rows(source: SessionReader, sql: str) -> Iterator[tuple[Any, ...]]:
    with closing(source.connect()) as connection:
        cursor = connection.execute(sql)
        while some := cursor.fetchmany(_AT_A_TIME):
            yield from some


@dataclass(slots=True, kw_only=True)
class Repair:
    """What was done to one session."""

    session: Path
    closed: bool = False
    """It was cut off: its end is now marked, with the digest of its log."""
    folded: bool = False
    """The write-ahead log went into the database."""
    adopted: list[str] = field(default_factory=list)
    """Files that were whole on the disk and not yet in the log."""
    removed: list[str] = field(default_factory=list)
    """What was half written."""
    left: dict[str, str] = field(default_factory=dict)
    """Files that were not adopted, and why not."""
    merged: list[Merged] = field(default_factory=list)
    """Rescue sessions that went back into their session, and are gone."""
    unmerged: dict[Path, str] = field(default_factory=dict)
    """Those that did not, and why not."""
    recovered: Recovered | None = None
    """Where the database was damaged: the new session with what could be saved."""

    @property
    def did_anything(self) -> bool:
        """False where there was nothing to do."""
        done = self.closed or self.folded or bool(self.adopted or self.removed or self.merged)
        return done or (self.recovered is not None and self.recovered.is_new)


def repair_session(folder: Path, now_utc_ns: int) -> Repair:
    """Set a session right; a second time there is nothing left to do.

    A rescue session goes back into its session where that can be read, whichever of the two is
    named. ``now_utc_ns`` dates the note in ``upkeep.jsonl``. Raises SessionError when there is no
    session, when its engine still lives, when somebody has it open, or when the disk refuses.
    """
    folder = Path(folder)
    about = _readable_about(folder)
    if is_written(about):
        raise SessionError(f"{folder} is being written, its engine lives: end the engine first")
    rescues = (folder,) if rescued_session(folder) is not None else rescues_of(folder)
    if _is_damaged(folder):
        done = Repair(session=folder, recovered=recover_session(folder, now_utc_ns))
        done.unmerged = dict.fromkeys(rescues, "the session's database is damaged")
        return done
    try:
        done = _set_right(SessionReader(folder), about, now_utc_ns)
        _merge(rescues, done, now_utc_ns)
        return done
    except (sqlite3.Error, OSError) as error:
        raise SessionError(
            f"{folder} cannot be repaired now: {error}; close whatever shows it, "
            "see that the disk has room and can be written, and try again"
        ) from error


def _merge(rescues: Sequence[Path], done: Repair, now_utc_ns: int) -> None:
    for rescue in rescues:
        try:
            done.merged.append(merge_rescue(rescue, now_utc_ns))
        except SessionError as error:
            done.unmerged[rescue] = str(error)


def _readable_about(folder: Path) -> dict[str, Any]:
    """What the session says of itself; nothing where it is too damaged to say anything.

    Raises SessionError where there is no session, or one that this version must not touch.
    """
    try:
        return SessionReader(folder).about()
    except OtherSchemaError:
        raise
    except SessionError:
        if not (folder / DATABASE).is_file():
            raise
        return {}


def _is_damaged(folder: Path) -> bool:
    """Whether SQLite cannot read the database whole."""
    try:
        with closing(SessionReader(folder).connect()) as connection:
            return bool(page_faults(connection))
    except SessionError:
        return True


def _set_right(reader: SessionReader, about: dict[str, Any], now_utc_ns: int) -> Repair:
    folder = reader.folder
    done = Repair(session=folder)
    strays = _strays(reader, done)
    is_open = about.get("is_closed") is not True
    is_split = any((folder / name).exists() for name in (WAL, JOURNAL))
    if strays or is_open or is_split:
        with closing(connect_to_write(folder / DATABASE)) as connection:
            if strays:
                with transaction(connection):
                    connection.executemany(INSERT_FILE, strays.values())
                done.adopted = list(strays)
            if is_open:
                mark_closed(connection)
                done.closed = True
        # With a stray alone this folds nothing, and does no harm.
        leave_wal(folder / DATABASE, LEAVE_WAL_S)
        done.folded = is_split
    _remove_parts(folder, done)
    if done.did_anything:
        details: dict[str, Any] = {"closed": done.closed, "folded": done.folded}
        add_note(
            folder,
            "repair",
            now_utc_ns,
            {**details, "adopted": done.adopted, "removed": done.removed},
        )
    return done


def _strays(reader: SessionReader, done: Repair) -> dict[str, tuple[object, ...]]:
    """Rows for whole frames and pictures that the table ``files`` does not know, by their path."""
    with closing(reader.connect()) as connection:
        known = {tuple(row) for row in connection.execute("SELECT role, frame_id FROM files")}
    found: dict[str, tuple[object, ...]] = {}
    for path in sorted(FolderHoldings(reader.folder).sizes()):
        place = role_of(path)
        if place is None or place in known:
            continue
        content = (reader.folder / path).read_bytes()
        fault = content_fault(path, content)
        if fault is not None:
            done.left[path] = fault
        else:
            found[path] = found_row(path, *place, content)
    return found


def _remove_parts(folder: Path, done: Repair) -> None:
    for path in sorted(FolderHoldings(folder).sizes()):
        if path.endswith(PART) and not path.startswith(f"{BRANCHES}/"):
            (folder / path).unlink(missing_ok=True)
            done.removed.append(path)
