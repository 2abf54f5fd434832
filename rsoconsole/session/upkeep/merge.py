"""Merges a rescue session, written while a session's disk failed, into that session.

The rescue session is removed only when all of its content has been read back from the other
session. Where anything fails before, the rescue session remains.
"""

import os
import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rsoconsole.base import SessionError, value_errors_as
from rsoconsole.session.files.digest import META_KEY as DIGEST_KEY
from rsoconsole.session.files.digest import LogDigest, digest_log, mark_closed
from rsoconsole.session.files.upkeep_log import add_note
from rsoconsole.session.log.database import (
    FILE_ROW,
    FILE_ROWS,
    INSERT_FILE,
    INSERT_RECORD,
    LOG_ROW,
    LOG_ROWS,
    connect_to_write,
    merge_wal,
    transaction,
)
from rsoconsole.session.log.liveness import is_being_written
from rsoconsole.session.log.schema import DATABASE
from rsoconsole.session.reading.reader import SessionReader
from rsoconsole.session.upkeep.store import remove_session
from rsoconsole.session.upkeep.verify import find_database_faults
from rsoconsole.session.writing.log_writer import rescue_places

LEAVE_WAL_S = 3.0


@dataclass(frozen=True, slots=True, kw_only=True)
class MergeResult:
    """Result of merging a rescue session into its session; the rescue session is removed."""

    rescue: Path
    session: Path
    records: int
    files: int


def session_of_rescue(folder: Path) -> Path | None:
    """Return the session that a rescue session stands in for; None for any other folder.

    None also for a rescue session that cannot be read.
    """
    try:
        named = SessionReader(folder).read_meta().get("rescues")
    except SessionError:
        return None
    is_path = isinstance(named, str) and "\0" not in named and Path(named).is_absolute()
    return Path(str(named)) if is_path else None


def find_rescues() -> tuple[Path, ...]:
    """Find every rescue session of this user, in all folders where one may have been made."""
    found: dict[Path, None] = {}
    for place in rescue_places():
        try:
            folders = sorted(path for path in place.iterdir() if (path / DATABASE).is_file())
        except OSError:
            continue
        found |= dict.fromkeys(path for path in folders if path.lstat().st_uid == os.getuid())
    return tuple(found)


def rescues_of(session: Path) -> tuple[Path, ...]:
    """Find the rescue sessions of this session."""
    own = session.resolve()
    return tuple(
        rescue
        for rescue in find_rescues()
        if (named := session_of_rescue(rescue)) is not None and named.resolve() == own
    )


def merge_rescue(rescue: Path, now_utc_ns: int) -> MergeResult:
    """Copy a rescue's records and file rows to its session, verify them, remove the rescue.

    Copied are records that the session lacks; no record of it is changed: where one differs between
    the two, nothing is copied. Rows of the table ``files`` replace the session's rows of the same
    files. Raises SessionError with the reason; the rescue session then remains.
    """
    session = session_of_rescue(rescue)
    if session is None:
        raise SessionError(f"{rescue} does not say which session it is a rescue of")
    if session.resolve() == rescue.resolve():
        raise SessionError(f"{rescue} calls itself its own rescue")
    source = SessionReader(rescue)
    with value_errors_as(SessionError, "its session is gone or cannot be read: ", SessionError):
        target = SessionReader(session)
    for reader in (source, target):
        about = reader.read_meta()
        if is_being_written(about):
            raise SessionError(f"{reader.folder} is being written: end its engine first")
        with closing(reader.connect()) as connection:
            if find_database_faults(connection):
                raise SessionError(f"the database of {reader.folder} is damaged")
    _expect_sound_digest(target)
    with value_errors_as(SessionError, f"{session} does not take it: ", (sqlite3.Error, OSError)):
        records, files = _insert(source, session / DATABASE)
        merge_wal(session / DATABASE, LEAVE_WAL_S)
        _expect_all(source, SessionReader(session))
        details: dict[str, Any] = {"rescue": str(rescue), "records": records, "files": files}
        add_note(session, "merge", now_utc_ns, details)
    remove_session(rescue)
    return MergeResult(rescue=rescue, session=session, records=records, files=files)


def _expect_sound_digest(target: SessionReader) -> None:
    """Raise SessionError where the log is not the log that was closed: it is not continued."""
    recorded = LogDigest.from_meta(target.read_meta())
    with closing(target.connect()) as connection:
        if recorded is not None and digest_log(connection) != recorded:
            raise SessionError(f"the log of {target.folder} is not the log that was closed")


def _insert(source: SessionReader, database: Path) -> tuple[int, int]:
    """Insert records and rows of files in one commit, then mark the end; return their numbers."""
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
    """Insert the rescue's row, which counts: it was written when the session accepted no more."""
    is_new = bool(connection.execute(FILE_ROW, row[:2]).fetchone() != row)
    if is_new:
        connection.execute(INSERT_FILE, row)
    return is_new


def _expect_all(source: SessionReader, target: SessionReader) -> None:
    """Read back what was written. Raises SessionError where anything is missing."""
    with closing(target.connect()) as connection:
        if find_database_faults(connection):
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
        yield from connection.execute(sql)
