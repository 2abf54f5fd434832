"""Reads sessions, live or closed.

Each call opens the database read-only and closes it again: no transaction stays open, the writer is
never blocked, and a session that ends can merge its write-ahead log.

A session of another schema is refused. A branch (its ``meta`` names the original session in
``branch_of``) is read like a session; files that the branch lacks are taken from the original.
"""

import os
import shutil
import sqlite3
import stat
import weakref
from collections.abc import Collection, Iterator
from contextlib import closing
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

from pydantic import ValidationError

from rsoconsole.base import SessionError, parse_json
from rsoconsole.config import Config
from rsoconsole.records import Event, Record
from rsoconsole.session.files.upkeep_log import pruning_times, read_notes
from rsoconsole.session.log.codec import KINDS, decode
from rsoconsole.session.log.database import (
    connect_to_read,
    is_query_limit_error,
    recovered_database_copy,
    untrusted_tables_reason,
)
from rsoconsole.session.log.schema import (
    APPLICATION_ID,
    DATABASE,
    FOLDERS,
    JOURNAL,
    SCHEMA_VERSION,
    VIEWS,
    WAL,
    view_select_sql,
)
from rsoconsole.session.reading._plausibility import LAST_UTC_NS, expect_plausible
from rsoconsole.words import utc_ns_to_iso

PAGE_RECORDS = 500
MAX_BRANCH_DEPTH = 8
"""Largest number of branches of branches followed to find a file; more are a circle."""
_SELECT = "SELECT seq, t_utc_ns, kind, body FROM log WHERE seq > ?"


_GOOD_TIME = (
    f"CASE WHEN typeof(t_utc_ns) = 'integer' AND t_utc_ns BETWEEN 0 AND {LAST_UTC_NS}"
    " THEN t_utc_ns END"
)


class OtherSchemaError(SessionError):
    """Raised for a session that another version wrote; the session itself is sound."""


def expect_schema(folder: Path, version: int) -> None:
    """Raise OtherSchemaError where ``version``, the session's schema, is not this program's."""
    if version != SCHEMA_VERSION:
        how = "update rsoconsole" if version > SCHEMA_VERSION else "open it with that one"
        raise OtherSchemaError(
            f"{folder} was written by another version of rsoconsole (schema {version}, here"
            f" {SCHEMA_VERSION}): {how}"
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionCounts:
    """Numbers of records and frames of a session, and its first and last instant."""

    records: int
    frames: int
    t_first_utc_ns: int | None
    t_last_utc_ns: int | None


class SessionReader:
    """Reader of a session's records, table ``meta`` and files. For one thread at a time.

    It is cheap to create. The constructor and every method raise SessionError when the folder holds
    no session, when the session is damaged, or when its schema is another version's.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = Path(folder)
        self._database = self.folder / DATABASE
        if not self._database.is_file():
            what = "does not exist" if not self.folder.exists() else f"holds no {DATABASE}"
            raise SessionError(
                f"{self.folder} {what}: name a session's folder, such as 'rsoconsole engine' and "
                "'rsoconsole demo' name when they begin (session.root, a folder a night)"
            )
        ((application_id,),) = self._fetch("PRAGMA application_id")
        if application_id != APPLICATION_ID:
            raise SessionError(f"{self._database} is not a session of rsoconsole")
        ((version,),) = self._fetch("PRAGMA user_version")
        expect_schema(self.folder, version)

    def connect(self) -> sqlite3.Connection:
        """Open a read-only connection for the caller's own SQL statements; close it soon.

        While it is open, a live session cannot merge its write-ahead log. A statement is stopped
        where it takes far more steps than the database's size explains.
        """
        connection = self._opened()
        try:
            computed = untrusted_tables_reason(connection)
        except sqlite3.Error as error:
            connection.close()
            raise self._damaged(error) from error
        if computed:
            connection.close()
            raise SessionError(
                f"{self.folder} is no session of this program: {computed}; what its tables hold"
                f" 'rsoconsole sessions repair {self.folder}' saves"
            )
        return connection

    def read_meta(self) -> dict[str, Any]:
        """Read the session's table ``meta``: config, model_sha256, versions and so on.

        ``is_closed`` is False for a session that is live or was cut off. Raises SessionError where
        the table cannot be read.
        """
        rows = self._fetch("SELECT key, value FROM meta")
        try:
            return {key: parse_json(value) for key, value in rows}
        except (ValueError, TypeError, RecursionError) as error:
            raise SessionError(
                f"what {self.folder} says of itself is damaged (table meta: {error}): 'rsoconsole"
                " sessions verify' says what else is"
            ) from error

    def config(self) -> Config:
        """Read the configuration at the start of the session; unknown settings are left out."""
        table = self.read_meta().get("config")
        try:
            return Config.model_validate(_known(table))
        except ValidationError as error:
            raise SessionError(
                f"the configuration of {self.folder} is not one this version knows: "
                f"{error.error_count()} settings differ"
            ) from error

    def last_seq(self) -> int:
        """Return the sequence number of the newest record; 0 where there is no record."""
        ((seq,),) = self._fetch("SELECT coalesce(max(seq), 0) FROM log")
        return int(seq)

    def counts(self) -> SessionCounts:
        """Count records and frames; find the first and the last instant."""
        ((records, frames, t_first, t_last),) = self._fetch(
            "SELECT count(*), count(CASE kind WHEN 'FrameTaken' THEN 1 END), "
            f"min({_GOOD_TIME}), max({_GOOD_TIME}) FROM log"
        )
        return SessionCounts(
            records=records, frames=frames, t_first_utc_ns=t_first, t_last_utc_ns=t_last
        )

    def records(
        self,
        since_seq: int = 0,
        kinds: Collection[type[Any]] | None = None,
        *,
        frame_id: int | None = None,
    ) -> Iterator[tuple[int, int, Record]]:
        """Yield (seq, t_utc_ns, record) in the order of the log, from ``since_seq`` + 1 on.

        ``kinds``: record types, e.g. ``(Measurement, TrackState)``; None: all. ``frame_id``: only
        records of this frame. Kinds that this version does not know are skipped. A record that
        cannot be read, or has no valid time, is replaced by an ``Event`` of level alarm.
        """
        names = [kind.__name__ for kind in kinds] if kinds is not None else list(KINDS)
        places = ", ".join("?" * len(names))
        # With + SQLite goes through the log itself: by the index of kinds it would sort all that is
        # left of the log for each page. Few kinds are found by the index.
        column = "+kind" if kinds is None and frame_id is None else "kind"
        of_frame, frame = ("", ()) if frame_id is None else (" AND frame_id = ?", (frame_id,))
        sql = f"{_SELECT} AND {column} IN ({places}){of_frame} ORDER BY seq LIMIT {PAGE_RECORDS}"
        while True:
            page = self._fetch(sql, (since_seq, *names, *frame))
            for seq, t_utc_ns, kind, body in page:
                if isinstance(t_utc_ns, int) and 0 <= t_utc_ns <= LAST_UTC_NS:
                    yield seq, t_utc_ns, _decoded(kind, body)
                else:
                    yield seq, 0, Event(level="alarm", text=f"the time of a {kind} is damaged")
            if len(page) < PAGE_RECORDS:
                return
            since_seq = page[-1][0]

    def record_headers(self) -> list[tuple[int, int, str, int | None]]:
        """List (seq, t_utc_ns, kind, frame_id or None) of every record, in order.

        Fast: no record is decoded.
        """
        return self._fetch("SELECT seq, t_utc_ns, kind, frame_id FROM log ORDER BY seq")

    def view_rows(self, name: str) -> list[dict[str, Any]]:
        """Read the rows of a public view, each as a dict, in the order of the log."""
        if name not in VIEWS:
            raise SessionError(f"a session has no view {name!r}; it has {', '.join(VIEWS)}")
        with closing(self.connect()) as connection:
            try:
                cursor = connection.execute(f"{view_select_sql(name)} ORDER BY seq")
                columns = [column[0] for column in cursor.description]
                return [dict(zip(columns, row, strict=True)) for row in cursor]
            except sqlite3.Error as error:
                raise self._damaged(error) from error

    def frame_path(self, frame_id: int) -> Path | None:
        """Return the path of the frame's FITS file; None when not kept or not yet written."""
        return self._file(frame_id, "frame")

    def frames_with_pixels(self) -> frozenset[int]:
        """Return the numbers of frames whose pixels exist; for a branch, also the original's."""
        sql = "SELECT frame_id, path FROM files WHERE role = 'frame' AND path IS NOT NULL"
        there = {p.name for p in (self.folder / FOLDERS["frame"]).glob("*")}
        own = {int(number) for number, path in self._fetch(sql) if Path(path).name in there}
        before = frozenset[int]() if self._origin is None else self._origin.frames_with_pixels()
        return before | own

    def missing_pixels_reason(self, frame_id: int) -> str | None:
        """Return why the frame's pixels are missing; None where they exist.

        None also where no reason is recorded. For a pruned frame it is the time of pruning, from
        ``upkeep.jsonl``.
        """
        sql = "SELECT reason, path FROM files WHERE frame_id = ? AND role = 'frame'"
        rows = self._fetch(sql, (frame_id,))
        if not rows:
            return None if self._origin is None else self._origin.missing_pixels_reason(frame_id)
        ((reason, path),) = rows
        if reason or path is None or self._inside(path) is not None:
            return str(reason) if reason else None
        pruned = pruning_times(read_notes(self.folder)).get(path)
        return None if pruned is None else f"pruned on {pruned}"

    def preview_path(self, frame_id: int) -> Path | None:
        """Return the path of the frame's small picture; None when there is none."""
        return self._file(frame_id, "preview")

    def closeup_path(self, frame_id: int) -> Path | None:
        """Return the path of the frame's close-up, a part at full resolution; None without one.

        The frame's record ``Closeup`` says which part.
        """
        return self._file(frame_id, "closeup")

    @cached_property
    def original_folder(self) -> Path | None:
        """Folder of the original session of a branch; None where the session is no branch.

        It need not exist: a branch may have been moved away from its original.
        """
        rows = self._fetch("SELECT value FROM meta WHERE key = 'branch_of'")
        try:
            named = parse_json(rows[0][0]) if rows else None
        except (ValueError, TypeError):
            return None
        if not isinstance(named, str) or not named or Path(named).is_absolute():
            return None
        try:
            folder = (self.folder / named).resolve()
            folder.exists()
        except (OSError, ValueError):  # no name that a folder can have
            return None
        return None if folder == self.folder.resolve() else folder

    @cached_property
    def _origin(self) -> "SessionReader | None":
        """Reader of the session this one branches from, where it can be read."""
        if self.original_folder is None:
            return None
        try:
            return SessionReader(self.original_folder)
        except SessionError:
            return None

    def _file(self, frame_id: int, role: str) -> Path | None:
        reader: SessionReader | None = self
        for _ in range(MAX_BRANCH_DEPTH):
            if reader is None:
                return None
            path = reader._own_file(frame_id, role)
            if path is not None:
                return path
            reader = reader._origin
        return None

    def _own_file(self, frame_id: int, role: str) -> Path | None:
        rows = self._fetch(
            "SELECT path FROM files WHERE frame_id = ? AND role = ? AND path IS NOT NULL",
            (frame_id, role),
        )
        return self._inside(rows[0][0]) if rows else None

    def _inside(self, named: object) -> Path | None:
        """Path of the regular file of the session in a row; None where the row names none."""
        if not isinstance(named, str) or "\0" in named:
            return None
        if Path(named).is_absolute() or ".." in Path(named).parts:
            return None
        path = self.folder / named
        try:
            is_own = stat.S_ISREG(path.lstat().st_mode) and path.resolve().is_relative_to(
                self.folder.resolve()
            )
        except (OSError, ValueError):
            return None
        return path if is_own else None

    def _fetch(self, sql: str, values: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
        with closing(self.connect()) as connection:
            try:
                return connection.execute(sql, values).fetchall()
            except sqlite3.Error as error:
                raise self._damaged(error) from error

    def _opened(self) -> sqlite3.Connection:
        try:
            try:
                return connect_to_read(self._database)
            except sqlite3.OperationalError as error:
                if not self._is_unfinished():
                    # On a medium that cannot be written, SQLite must be told that nobody writes.
                    return connect_to_read(self._database, is_immutable=True)
                if _is_busy(error) or not self._is_left():
                    raise
            # What a cut has left can only be finished by writing: in a copy, as readers write not.
            scratch = Path(mkdtemp(prefix="rsoconsole-"))  # as long as this reader
            weakref.finalize(self, shutil.rmtree, scratch, ignore_errors=True)
            self._database = recovered_database_copy(self.folder, scratch)
            return connect_to_read(self._database)
        except (sqlite3.Error, OSError) as error:
            raise self._damaged(error) from error

    def _is_unfinished(self) -> bool:
        """True where part of the database lies in a file beside it, where a cut has left it."""
        beside = (self.folder / WAL, self.folder / JOURNAL)
        return any(path.exists() and path.stat().st_size > 0 for path in beside)

    def _is_left(self) -> bool:
        """True where the unfinished write will stay in the folder.

        Nobody can write there, or a journal was left.
        """
        return not os.access(self.folder, os.W_OK) or (self.folder / JOURNAL).exists()

    def _damaged(self, error: sqlite3.Error | OSError) -> SessionError:
        if is_query_limit_error(error):
            return SessionError(
                f"{self.folder} is no session of this program: reading its database does not come"
                " to an end"
            )
        if isinstance(error, sqlite3.OperationalError) and "no such table" in str(error):
            return SessionError(
                f"{self._database} lacks a part of a session ({error}): it was cut off while it was"
                " made, or something else has changed it"
            )
        if isinstance(error, sqlite3.OperationalError | OSError):
            return SessionError(
                f"{self._database} cannot be read: {error}; "
                "check that you may read the folder, or copy it to a place you can write"
            )
        return SessionError(
            f"{self._database} is damaged or no session: {error}; "
            f"its frames are untouched, 'rsoconsole sessions repair {self.folder}' saves the rest"
        )


def _decoded(kind: str, body: str) -> Record:
    """Decode a record; an alarm takes its place where that fails."""
    try:
        found = decode(kind, body)
        expect_plausible(found)
    except SessionError as error:
        return Event(level="alarm", text=str(error))
    except ValueError as error:
        return Event(level="alarm", text=f"a {kind} of this session is damaged: {error}")
    return found


def _is_busy(error: sqlite3.OperationalError) -> bool:
    return error.sqlite_errorcode & 0xFF in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED)


def _known(table: Any) -> Any:
    """Return a configuration without the sections and settings that this version does not know."""
    if not isinstance(table, dict):
        return table
    known: dict[str, Any] = {}
    for name, section in table.items():
        field = Config.model_fields.get(name)
        if field is None or not isinstance(section, dict):
            continue
        settings = getattr(field.annotation, "model_fields", {})
        known[name] = {key: value for key, value in section.items() if key in settings}
    return known


def clock_fault_lines(reader: SessionReader) -> tuple[str, ...]:
    """Return one line, with time and fault, for each fault of the computer's clock, in order.

    () where there was none. Raises SessionError where the session cannot be read.
    """
    return tuple(
        f"{utc_ns_to_iso(t_utc_ns, 0)} {record.text.partition(': ')[0]}"
        for _, t_utc_ns, record in reader.records(kinds=(Event,))
        if isinstance(record, Event) and record.topic == "clock" and record.level != "info"
    )
