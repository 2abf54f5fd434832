"""The session's SQLite file: how it is made, opened to be written, and left as one file."""

import json
import shutil
import sqlite3
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rsoconsole.durable_files import PART, sync_folder
from rsoconsole.session.log.bounds import bound
from rsoconsole.session.log.schema import (
    APPLICATION_ID,
    DATABASE,
    JOURNAL,
    SCHEMA_VERSION,
    WAL,
    create_script,
)


class Database(sqlite3.Connection):
    """A connection whose errors are sqlite3.Error, whatever bytes SQLite's message quotes.

    Of a damaged schema it quotes what is damaged, and Python fails to decode that.
    """

    def execute(self, sql: str, parameters: Any = (), /) -> sqlite3.Cursor:
        """As of any connection."""
        try:
            return super().execute(sql, parameters)
        except UnicodeDecodeError as error:
            raise sqlite3.DatabaseError("the schema of the database is damaged") from error


def connect_to_write(path: Path) -> sqlite3.Connection:
    """A connection in autocommit mode whose commits wait for the disk. Raises sqlite3.Error."""
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
    """All that is written within, on the disk behind it or undone; in autocommit mode."""
    connection.execute("BEGIN IMMEDIATE")
    with connection:
        yield


def connect_to_read(path: Path, *, is_immutable: bool = False) -> sqlite3.Connection:
    """A connection that cannot write, to a database that SQLite can read as it stands.

    ``is_immutable`` promises that nobody writes. What asks for more than the file's size explains
    is ended (``session/log/bounds.py``). Raises sqlite3.Error.
    """
    mode = "mode=ro&immutable=1" if is_immutable else "mode=ro"
    connection = sqlite3.connect(
        f"{path.resolve().as_uri()}?{mode}", uri=True, timeout=2.0, factory=Database
    )
    bound(connection, path)
    try:
        connection.execute("SELECT 1 FROM sqlite_master LIMIT 1").fetchall()
    except sqlite3.Error:
        connection.close()
        raise
    return connection


def finish_copy(folder: Path, scratch: Path) -> Path:
    """Copy the session's database into ``scratch`` and have SQLite finish what was cut off.

    Returns the copy, one file. Raises OSError or sqlite3.Error.
    """
    for name in (DATABASE, WAL, JOURNAL):
        if (folder / name).exists():
            shutil.copyfile(folder / name, scratch / name)
    leave_wal(scratch / DATABASE, timeout_s=0.0)
    return scratch / DATABASE


def create_database(path: Path, facts: Mapping[str, Any]) -> None:
    """Make the database beside its place and rename it, so that no reader meets half of one."""
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


def leave_wal(path: Path, timeout_s: float) -> None:
    """Fold the write-ahead log into the database, so that it is one file any reader can open.

    Raises sqlite3.Error when readers hold it for longer than ``timeout_s``.
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
