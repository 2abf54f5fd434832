"""A session's SQLite file: creating it, opening it, and closing it as a single file."""

import contextlib
import json
import os
import re
import shutil
import sqlite3
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rsoconsole.base import PART, sync_folder, write_durably
from rsoconsole.session.log.schema import (
    APPLICATION_ID,
    CONFIG,
    DATABASE,
    FOLDERS,
    JOURNAL,
    SCHEMA_VERSION,
    WAL,
    create_script,
)

MAX_ROW_BYTES = 64_000_000
"""Largest allowed row, bytes; the largest records have some ten thousand."""
STEPS_A_CALL = 100_000
MIN_CALLS = 500
"""Least number of calls before a statement is ended: fifty million steps."""
BYTES_A_CALL = 10_000
"""Number of bytes of the file that allow one more call: ten steps a byte."""
_TABLES = ("log", "meta", "files")
_COMPUTED = re.compile(r"\b(check|generated|as|virtual)\b", re.IGNORECASE)
_GENERATED = (2, 3)
"""Kinds of hidden columns in ``table_xinfo``. Source: sqlite.org/pragma.html."""
_NAMED = (
    "SELECT type, name, coalesce(sql, '') FROM main.sqlite_master"
    " WHERE type = 'trigger' OR name COLLATE NOCASE IN ('log', 'meta', 'files')"
)
_INDEXES = (
    "SELECT name, coalesce(sql, '') FROM main.sqlite_master"
    " WHERE type = 'index' AND tbl_name COLLATE NOCASE IN ('log', 'meta', 'files')"
)


def limit_statements(connection: sqlite3.Connection, path: Path) -> None:
    """Limit the size of a row, and each statement's number of steps by the database's size.

    Beyond the limits SQLite raises OperationalError with the code SQLITE_INTERRUPT, or
    DataError.
    """
    connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MAX_ROW_BYTES)
    left = MIN_CALLS + sum(map(_bytes, (path, path.with_name(WAL)))) // BYTES_A_CALL

    def is_over() -> bool:
        nonlocal left
        left -= 1
        return left < 0

    connection.set_progress_handler(is_over, STEPS_A_CALL)


def is_query_limit_error(error: BaseException) -> bool:
    """True for the error of a statement that ``limit_statements`` ended."""
    return getattr(error, "sqlite_errorcode", None) == sqlite3.SQLITE_INTERRUPT


def untrusted_tables_reason(connection: sqlite3.Connection) -> str | None:
    """Return why the tables cannot be trusted, such as a trigger or a computed column.

    None where all are plain tables. Raises sqlite3.Error.
    """
    for kind, name, sql in connection.execute(_NAMED):
        if kind == "trigger":
            return f"the trigger {name} changes what is read or written"
        if kind != "table" or str(name).lower() not in _TABLES:
            return f"{name} is no table in it"
        if _COMPUTED.search(str(sql)):
            return f"its table {name} computes values"
    for name in _TABLES:
        columns = connection.execute(f"PRAGMA main.table_xinfo({name})").fetchall()
        if any(column[6] in _GENERATED for column in columns):
            return f"its table {name} computes values"
    for name, sql in connection.execute(_INDEXES):
        if str(sql).count("(") > 1 or re.search(r"\bwhere\b", str(sql), re.IGNORECASE):
            return f"its index {name} computes values"
    return None


def _bytes(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:
        return 0


class Database(sqlite3.Connection):
    """SQLite connection that raises sqlite3.Error also for a damaged schema.

    SQLite's message on a damaged schema quotes the damaged bytes, which Python cannot decode.
    """

    def execute(self, sql: str, parameters: Any = (), /) -> sqlite3.Cursor:
        """Execute a statement; raises sqlite3.DatabaseError for an unreadable schema."""
        try:
            return super().execute(sql, parameters)
        except UnicodeDecodeError as error:
            raise sqlite3.DatabaseError("the schema of the database is damaged") from error


def connect_to_write(path: Path) -> sqlite3.Connection:
    """Open a connection in autocommit mode; each commit returns when it is on the disk.

    Raises sqlite3.Error.
    """
    # mode=rw: a database that has vanished is a fault, never silently a new empty one.
    connection = sqlite3.connect(
        f"{path.resolve().as_uri()}?mode=rw",
        uri=True,
        timeout=2.0,
        isolation_level=None,
        factory=Database,
    )
    try:
        connection.execute("PRAGMA synchronous=FULL")
    except sqlite3.Error:
        connection.close()
        raise
    return connection


@contextmanager
def transaction(connection: sqlite3.Connection) -> Iterator[None]:
    """Run the context's body as one transaction: all its writes reach the disk, or none.

    ``connection`` must be in autocommit mode.
    """
    connection.execute("BEGIN IMMEDIATE")
    with connection:
        yield


def connect_to_read(path: Path, *, is_immutable: bool = False) -> sqlite3.Connection:
    """Open a read-only connection to a database that needs no recovery.

    ``is_immutable`` True: no process writes to the file, so SQLite need not lock it. Statements are
    limited (``limit_statements``). Raises sqlite3.Error.
    """
    mode = "mode=ro&immutable=1" if is_immutable else "mode=ro"
    connection = sqlite3.connect(
        f"{path.resolve().as_uri()}?{mode}", uri=True, timeout=2.0, factory=Database
    )
    limit_statements(connection, path)
    try:
        connection.execute("SELECT 1 FROM sqlite_master LIMIT 1").fetchall()
    except sqlite3.Error:
        connection.close()
        raise
    return connection


def recovered_database_copy(folder: Path, scratch: Path) -> Path:
    """Copy the session's database into ``scratch``, and complete a write that was cut off.

    Returns the path of the copy, a single file. Raises OSError or sqlite3.Error.
    """
    for name in (DATABASE, WAL, JOURNAL):
        if (folder / name).exists():
            shutil.copyfile(folder / name, scratch / name)
    merge_wal(scratch / DATABASE, timeout_s=0.0)
    return scratch / DATABASE


def create_database(path: Path, facts: Mapping[str, Any]) -> None:
    """Create a session's database, with ``facts`` in its table ``meta``.

    It is made under another name and renamed, so that no reader meets an incomplete one.
    """
    beside = path.with_name(path.name + PART)
    beside.unlink(missing_ok=True)
    connection = sqlite3.connect(beside, isolation_level=None)
    try:
        connection.execute(f"PRAGMA application_id={APPLICATION_ID}")
        connection.execute(f"PRAGMA user_version={SCHEMA_VERSION}")
        connection.executescript(f"BEGIN;{create_script()}COMMIT;")
        connection.execute("BEGIN")
        connection.executemany(
            "INSERT INTO meta (key, value) VALUES (?, ?)",
            [(key, json.dumps(value)) for key, value in facts.items()],
        )
        connection.execute("COMMIT")
    finally:
        connection.close()
    beside.replace(path)
    sync_folder(path.parent)
    connection = connect_to_write(path)
    try:
        connection.execute("PRAGMA journal_mode=WAL")
    finally:
        connection.close()


def lay_out_session(folder: Path, config_toml: bytes, facts: Mapping[str, Any]) -> None:
    """Fill an existing, empty session folder: sub-folders, configuration, database.

    ``facts`` go into the table ``meta``. Raises OSError, ValueError or sqlite3.Error.
    """
    for name in FOLDERS.values():
        (folder / name).mkdir(exist_ok=True)
    write_durably(folder / CONFIG, config_toml)
    create_database(folder / DATABASE, facts)


def merge_wal(path: Path, timeout_s: float) -> None:
    """Move the write-ahead log into the database, so that the session is a single file.

    Raises sqlite3.Error when readers hold the database for longer than ``timeout_s``.
    """
    deadline = time.monotonic() + timeout_s
    connection = connect_to_write(path)
    try:
        while True:
            try:
                connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
                mode = connection.execute("PRAGMA journal_mode=DELETE").fetchone()[0]
                if mode == "delete":
                    return
                raise sqlite3.OperationalError(f"the journal stays in mode {mode}")
            except sqlite3.OperationalError:
                if time.monotonic() > deadline:
                    raise
                time.sleep(0.05)
    finally:
        connection.close()


_MAGIC = b"SQLite format 3\x00"


class LogFileWatch:
    """Watch that detects damage by others to the database or its write-ahead log.

    Damage is a file that was removed, replaced, cut short or overwritten, which SQLite does not
    notice.
    """

    def __init__(self, database: Path) -> None:
        self._paths = {"log": database, "write-ahead log": database.with_name(WAL)}
        self._before: dict[str, os.stat_result] = {}
        self._descriptor: int | None = None
        with contextlib.suppress(OSError):
            self._descriptor = os.open(database, os.O_RDONLY | os.O_CLOEXEC)
        self.find_damage(lambda: True)

    def close(self) -> None:
        """Close the watch, but only after the process's last connection to the database.

        Closing any descriptor of a file releases SQLite's lock on it: another program would then
        conclude that no process writes.
        """
        if self._descriptor is not None:
            os.close(self._descriptor)
            self._descriptor = None

    def forget_wal(self) -> None:
        """Stop watching the write-ahead log, before the connection is closed.

        SQLite then removes that file itself.
        """
        self._before.pop("write-ahead log", None)

    def find_damage(self, has_all: Callable[[], bool]) -> str | None:
        """Return a phrase on damage to the files since the watch began; None where there is none.

        ``has_all``: called where the write-ahead log has become shorter; returns True where a
        reader finds every record, as after another program had SQLite merge the log, which is no
        damage.
        """
        for name, path in self._paths.items():
            try:
                found = path.stat()
            except FileNotFoundError:
                if name in self._before:
                    return f"the session's {name} has been removed"
                continue
            except OSError as error:
                return f"the session's {name} cannot be seen: {error.strerror}"
            before = self._before.setdefault(name, found)
            if not os.path.samestat(before, found):
                return f"the session's {name} has been replaced"
            is_folded = found.st_size < before.st_size and path.name == WAL and has_all()
            if found.st_size < before.st_size and not is_folded:
                return f"the session's {name} has been cut short"
            self._before[name] = found
        return self._overwritten()

    def _overwritten(self) -> str | None:
        if self._descriptor is None:
            return None
        try:
            head = os.pread(self._descriptor, len(_MAGIC), 0)
        except OSError as error:
            return f"the session's log cannot be read: {error.strerror}"
        return None if head == _MAGIC else "the session's log has been written over"


LOG_COLUMNS = "seq, t_utc_ns, kind, frame_id, body"
FILE_COLUMNS = "frame_id, role, path, bytes, ms, reason, sha256"
LOG_ROWS = f"SELECT {LOG_COLUMNS} FROM log ORDER BY seq"
LOG_ROW = f"SELECT {LOG_COLUMNS} FROM log WHERE seq = ?"
FILE_ROWS = f"SELECT {FILE_COLUMNS} FROM files"
FILE_ROW = f"{FILE_ROWS} WHERE frame_id = ? AND role = ?"
# OR IGNORE: a commit that reported an error may have reached the disk all the same.
INSERT_RECORD = f"INSERT OR IGNORE INTO log ({LOG_COLUMNS}) VALUES (?, ?, ?, ?, ?)"
INSERT_FILE = f"INSERT OR REPLACE INTO files ({FILE_COLUMNS}) VALUES (?, ?, ?, ?, ?, ?, ?)"
"""Statement that inserts a row of ``files``, replacing an earlier row of the same file."""
