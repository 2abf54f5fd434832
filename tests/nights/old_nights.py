"""Sessions as they were written before schema 4: their logs lie in ``data/schema-3``.

``busy``: all that may come between two frames, in a night of 60. ``ruled``: the operator marks,
accepts, rejects and chooses streaks, and looks for what was followed again.
"""

import gzip
import json
import sqlite3
from contextlib import closing
from pathlib import Path

from rsoconsole.config import Config
from rsoconsole.session.writing.writer import SessionWriter

DATA = Path(__file__).parents[1] / "data" / "schema-3"
CONFIG = Config.model_validate(
    {"search": {"recentre": "every"}, "filter": {"preset": "tuned", "max_coast_s": 3600}}
)


def old_session(folder: Path, name: str, schema: int = 3) -> Path:
    """A closed session of an old schema, whose records are those that were written then."""
    SessionWriter.create(folder, CONFIG, {"title": name}).close()
    lines = gzip.decompress((DATA / f"{name}.jsonl.gz").read_bytes()).splitlines()
    with closing(sqlite3.connect(folder / "session.db")) as connection, connection:
        connection.executemany("INSERT INTO log VALUES (?, ?, ?, ?, ?)", map(json.loads, lines))
        connection.execute("DELETE FROM meta WHERE key = 'log_digest'")
        connection.execute("UPDATE meta SET value = ? WHERE key = 'schema_version'", (str(schema),))
        connection.execute(f"PRAGMA user_version={schema}")
    return folder
