"""Schema of the session's database: a public interface with a version.

The table ``log`` is the record: every record in the order in which the engine made it, as JSON. The
views spread the records into columns for SQL; SQLite may round decimals in the last digit there,
the JSON is exact. A change that would make earlier sessions unreadable increases the version; a
session of another version is refused.
"""

import re
from collections.abc import Mapping
from types import MappingProxyType

from rsoconsole.records import SUPERSEDED, TABLES, Column, Table

DATABASE = "session.db"
WAL = f"{DATABASE}-wal"
JOURNAL = f"{DATABASE}-journal"
BESIDE_DATABASE = (WAL, JOURNAL, f"{DATABASE}-shm")
"""Files that SQLite keeps beside a database that is written to, or was cut off."""
CONFIG = "config.toml"
WORLD = "world.toml"
"""Name of the file with the settings of the simulated observatory, in a simulated night."""
BRANCHES = "branches"
"""Name of the folder of what-if branches of the session; they are no part of its record."""

FOLDERS: Mapping[str, str] = MappingProxyType(
    {"frame": "frames", "preview": "previews", "closeup": "closeups"}
)
_ENDINGS = {"frame": ".fits.fz", "preview": ".png", "closeup": ".png"}
_NUMBERED = re.compile(r"(?P<folder>[a-z]+)/(?P<frame_id>\d{6,})(?P<ending>(\.[a-z]+)+)")

SCHEMA_VERSION = 1
APPLICATION_ID = 0x52534F43
"""``RSOC`` as a number in the database's header: marks a SQLite file as a session."""

_TABLES_SQL = """
CREATE TABLE meta (key TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE log (
  seq INTEGER PRIMARY KEY,
  t_utc_ns INTEGER NOT NULL,
  kind TEXT NOT NULL,
  frame_id INTEGER,
  body TEXT NOT NULL
);
CREATE INDEX log_kind ON log (kind, frame_id);
CREATE TABLE files (
  frame_id INTEGER NOT NULL,
  role TEXT NOT NULL,
  path TEXT,
  bytes INTEGER,
  ms REAL,
  reason TEXT,
  sha256 TEXT,
  PRIMARY KEY (frame_id, role)
) WITHOUT ROWID;
"""

_FROM_FILES = {
    "file": "kept.path",
    "file_bytes": "kept.bytes",
    "not_kept_because": "kept.reason",
    "preview": "shown.path",
    "file_sha256": "kept.sha256",
}
_WITH_FILES = """
LEFT JOIN files AS kept ON kept.frame_id = log.frame_id AND kept.role = 'frame'
LEFT JOIN files AS shown ON shown.frame_id = log.frame_id AND shown.role = 'preview'
"""

_SUPERSEDED = (
    "EXISTS (SELECT 1 FROM log AS later WHERE later.kind = 'FollowedAgain'"
    " AND later.frame_id = log.frame_id AND later.seq > log.seq)"
)
"""SQL condition, true where a frame was processed again by decision: the row no longer counts."""
VIEWS = tuple(TABLES)


def frame_file_path(role: str, frame_id: int) -> str:
    """Return the path, in the session's folder, of a frame's file of this role."""
    return f"{FOLDERS[role]}/{frame_id:06d}{_ENDINGS[role]}"


def parse_frame_file_path(path: str) -> tuple[str, int] | None:
    """Return (role, frame_id) of a file, from its path in the session; None for another file."""
    match = _NUMBERED.fullmatch(path)
    if match is None:
        return None
    for role in FOLDERS:
        if frame_file_path(role, int(match["frame_id"])) == path:
            return role, int(match["frame_id"])
    return None


def view_select_sql(name: str) -> str:
    """Return the SQL that selects the rows of a public view."""
    table = TABLES[name]
    columns = ["seq", "t_utc_ns", "log.frame_id AS frame_id"]
    columns += [f"{_value(table, column)} AS {column.name}" for column in table.own]
    columns += [f"{_SUPERSEDED} AS {SUPERSEDED.name}"] * table.may_be_superseded
    parts = f", json_each(body, '$.{table.parts}') AS one" if table.parts else ""
    files = _WITH_FILES if any(column.source == "files" for column in table.own) else ""
    kind = table.kind.__name__
    return f"SELECT {', '.join(columns)} FROM log{parts}{files} WHERE log.kind = '{kind}'"


def _value(table: Table, column: Column) -> str:
    """SQL of one column."""
    if column.source == "files":
        return _FROM_FILES[column.name]
    if column.record_path in {"#", "="}:
        return "one.key" if column.record_path == "#" else "one.value"
    body = "one.value" if table.parts else "body"
    place = "$" + "".join(
        f"[{step}]" if step.isdigit() else f".{step}" for step in column.record_path.split(".")
    )
    value = f"json_extract({body}, '{place}')"
    if column.has_sentence:
        # A kind with its figures, and what they say as text; or text alone.
        value = f"coalesce(json_extract({body}, '{place}.text'), {value})"
    return value


def create_script() -> str:
    """Return the SQL that makes an empty session database: tables, then the public views."""
    views = (f"CREATE VIEW {name} AS {view_select_sql(name)};\n" for name in VIEWS)
    return _TABLES_SQL + "".join(views)
