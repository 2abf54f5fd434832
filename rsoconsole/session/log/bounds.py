"""What the database of a session from anywhere may be: plain tables, and reading that ends.

SQL in a file may compute without end: a view in place of a table, a trigger, a generated column,
the expression of an index or of a check. A session has none of them on its tables, so a file that
has is refused before anything of it is run. What gets past that is ended by its steps: they depend
on the file alone, not on how fast or how busy the machine is.
"""

import re
import sqlite3
from pathlib import Path

from rsoconsole.session.log.schema import WAL

MOST_ROW_BYTES = 64_000_000
"""The largest records have some ten thousand bytes."""
STEPS_A_CALL = 100_000
LEAST_CALLS = 500
"""Fifty million steps: seconds on a slow machine."""
BYTES_A_CALL = 10_000
"""Ten steps a byte; all that the program asks of a session takes a thirtieth of a step."""
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


def bound(connection: sqlite3.Connection, path: Path) -> None:
    """End whatever asks for more than a file of this size explains, and refuse huge rows.

    SQLite then raises OperationalError with the code SQLITE_INTERRUPT, or DataError.
    """
    connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MOST_ROW_BYTES)
    left = LEAST_CALLS + sum(map(_bytes, (path, path.with_name(WAL)))) // BYTES_A_CALL

    def is_over() -> bool:
        nonlocal left
        left -= 1
        return left < 0

    connection.set_progress_handler(is_over, STEPS_A_CALL)


def is_interrupted(error: BaseException) -> bool:
    """Whether a statement was ended because it asked for too much."""
    return getattr(error, "sqlite_errorcode", None) == sqlite3.SQLITE_INTERRUPT


def computed_part(connection: sqlite3.Connection) -> str | None:
    """What of the tables is none or computes something, in words; None where all is plain.

    Raises sqlite3.Error.
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
