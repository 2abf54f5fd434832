"""The one reader of sessions, live or closed.

Each call opens the database read-only and lets go of it again: no transaction is held, the
writer is never kept from anything, and a session that ends can leave its write-ahead log.
"""

import json
import sqlite3
from collections.abc import Collection, Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from rsoconsole.config import Config
from rsoconsole.errors import SessionError
from rsoconsole.records import Event
from rsoconsole.session.codec import KINDS, Record, decode
from rsoconsole.session.schema import APPLICATION_ID, DATABASE, SCHEMA_VERSION, VIEWS

PAGE_RECORDS = 500
_SELECT = "SELECT seq, t_utc_ns, kind, body FROM log WHERE seq > ?"


@dataclass(frozen=True, slots=True, kw_only=True)
class Counts:
    """How much a session holds."""

    records: int
    frames: int
    t_first_utc_ns: int | None
    t_last_utc_ns: int | None


class SessionReader:
    """A session's records, facts and files. Cheap to make; safe to use from one thread at a time.

    Raises SessionError, here and in every method, when the folder holds no session, when the
    session is damaged, or when a later version wrote it.
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
        if version > SCHEMA_VERSION:
            raise SessionError(
                f"{self.folder} was written by a later rsoconsole (schema {version}, this one "
                f"knows {SCHEMA_VERSION}): update rsoconsole"
            )

    def about(self) -> dict[str, Any]:
        """What the session said of itself when it began: config, model_sha256, versions and so on.

        ``is_closed`` is False for a session that is live or was cut off.
        """
        return {key: json.loads(value) for key, value in self._fetch("SELECT key, value FROM meta")}

    def config(self) -> Config:
        """The configuration the session began with; settings of a later version are left out."""
        table = self.about().get("config")
        try:
            return Config.model_validate(_known(table))
        except ValidationError as error:
            raise SessionError(
                f"the configuration of {self.folder} is not one this version knows: "
                f"{error.error_count()} settings differ"
            ) from error

    def last_seq(self) -> int:
        """Place of the newest record; 0 before the first."""
        ((seq,),) = self._fetch("SELECT coalesce(max(seq), 0) FROM log")
        return int(seq)

    def counts(self) -> Counts:
        """Records, frames, and the instants between which they lie."""
        ((records, frames, t_first, t_last),) = self._fetch(
            "SELECT count(*), count(CASE kind WHEN 'FrameTaken' THEN 1 END), "
            "min(t_utc_ns), max(t_utc_ns) FROM log"
        )
        return Counts(records=records, frames=frames, t_first_utc_ns=t_first, t_last_utc_ns=t_last)

    def records(
        self,
        since_seq: int = 0,
        kinds: Collection[type[Any]] | None = None,
        *,
        frame_id: int | None = None,
    ) -> Iterator[tuple[int, int, Record]]:
        """(seq, t_utc_ns, record) in the order of the log, after ``since_seq``, to its end.

        ``kinds`` are record types, e.g. ``(Measurement, TrackState)``; None means all. With
        ``frame_id`` only the records of that frame. Kinds that this version does not know are
        passed over; in the place of a record that cannot be read
        stands an alarm that says so.
        """
        names = [kind.__name__ for kind in kinds] if kinds is not None else list(KINDS)
        places = ", ".join("?" * len(names))
        of_frame, frame = ("", ()) if frame_id is None else (" AND frame_id = ?", (frame_id,))
        sql = f"{_SELECT} AND kind IN ({places}){of_frame} ORDER BY seq LIMIT {PAGE_RECORDS}"
        while True:
            page = self._fetch(sql, (since_seq, *names, *frame))
            for seq, t_utc_ns, kind, body in page:
                yield seq, t_utc_ns, self._decoded(kind, body)
            if len(page) < PAGE_RECORDS:
                return
            since_seq = page[-1][0]

    @staticmethod
    def _decoded(kind: str, body: str) -> Record:
        try:
            return decode(kind, body)
        except SessionError as error:
            return Event(level="alarm", text=str(error))

    def view(self, name: str) -> list[dict[str, Any]]:
        """The rows of one of the public views, in order of the log."""
        if name not in VIEWS:
            raise SessionError(f"a session has no view {name!r}; it has {', '.join(VIEWS)}")
        with closing(self._open()) as connection:
            try:
                cursor = connection.execute(f"SELECT * FROM {name} ORDER BY seq")
                columns = [column[0] for column in cursor.description]
                return [dict(zip(columns, row, strict=True)) for row in cursor]
            except sqlite3.Error as error:
                raise self._damaged(error) from error

    def frame_path(self, frame_id: int) -> Path | None:
        """The frame's FITS file; None when it was not kept or is not written yet."""
        return self._file(frame_id, "frame")

    def not_kept_because(self, frame_id: int) -> str | None:
        """Why the frame's pixels were not kept; None when they were, or nothing is said of it."""
        sql = "SELECT reason FROM files WHERE frame_id = ? AND role = 'frame'"
        rows = self._fetch(sql, (frame_id,))
        return str(rows[0][0]) if rows and rows[0][0] else None

    def preview_path(self, frame_id: int) -> Path | None:
        """The frame's small picture; None when there is none."""
        return self._file(frame_id, "preview")

    def closeup_path(self, frame_id: int) -> Path | None:
        """The picture of a piece of the frame at full resolution; None when there is none.

        Which piece, its record ``Closeup`` says.
        """
        return self._file(frame_id, "closeup")

    def _file(self, frame_id: int, role: str) -> Path | None:
        rows = self._fetch(
            "SELECT path FROM files WHERE frame_id = ? AND role = ? AND path IS NOT NULL",
            (frame_id, role),
        )
        path = self.folder / rows[0][0] if rows else None
        return path if path is not None and path.is_file() else None

    def _fetch(self, sql: str, values: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
        with closing(self._open()) as connection:
            try:
                return connection.execute(sql, values).fetchall()
            except sqlite3.Error as error:
                raise self._damaged(error) from error

    def _open(self) -> sqlite3.Connection:
        address = self._database.resolve().as_uri()
        try:
            connection = sqlite3.connect(f"{address}?mode=ro", uri=True, timeout=2.0)
            try:
                connection.execute("SELECT 1 FROM sqlite_master LIMIT 1").fetchall()
                return connection
            except sqlite3.Error as error:
                connection.close()
                if self._has_unfolded_log() or not isinstance(error, sqlite3.OperationalError):
                    raise
            # On a medium that cannot be written, SQLite must be told that nobody writes.
            return sqlite3.connect(f"{address}?mode=ro&immutable=1", uri=True)
        except sqlite3.Error as error:
            raise self._damaged(error) from error

    def _has_unfolded_log(self) -> bool:
        beside = self._database.with_name(DATABASE + "-wal")
        return beside.exists() and beside.stat().st_size > 0

    def _damaged(self, error: sqlite3.Error) -> SessionError:
        if isinstance(error, sqlite3.OperationalError) and "no such table" in str(error):
            return SessionError(
                f"{self._database} lacks a part of a session ({error}): it was cut off while it was"
                " made, or something else has changed it"
            )
        if isinstance(error, sqlite3.OperationalError):
            return SessionError(
                f"{self._database} cannot be read: {error}; "
                "check that you may read the folder, or copy it to a place you can write"
            )
        return SessionError(
            f"{self._database} is damaged or no session: {error}; "
            "its frames are untouched, and 'sqlite3 session.db .recover' may save the log"
        )


def _known(table: Any) -> Any:
    """A configuration without the sections and settings that this version does not know."""
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
