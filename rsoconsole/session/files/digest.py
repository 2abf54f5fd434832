"""What tells whether a session is still what was written: hashes of files, the digest of a log.

The digest is SHA-256 over one line a record, in order of ``seq``, each ended by a line feed:
``seq|t_utc_ns|kind|frame_id|body`` in UTF-8, integers in decimal, ``frame_id`` empty where it is
NULL, ``body`` as it is stored. That is what ``sqlite3`` prints of these columns; see
``sessions/README.md`` for the command.
"""

import hashlib
import json
import sqlite3
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

from rsoconsole.session.log import LOG_ROWS, transaction

META_KEY = "log_digest"

Row: TypeAlias = tuple[int, int, str, int | None, str]
"""seq, t_utc_ns, kind, frame_id, body."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LogDigest:
    """The fingerprint of a session's log."""

    sha256: str
    """64 hexadecimal digits."""
    records: int

    def to_json(self) -> str:
        """As the table ``meta`` carries it."""
        return json.dumps({"sha256": self.sha256, "records": self.records})

    @classmethod
    def from_meta(cls, meta: Mapping[str, Any]) -> "LogDigest | None":
        """As the session carries it; None for one that is not closed."""
        found = meta.get(META_KEY)
        if not isinstance(found, dict):
            return None
        return cls(sha256=str(found.get("sha256")), records=int(found.get("records") or 0))


class Digester:
    """The digest, row by row."""

    def __init__(self) -> None:
        self._hash = hashlib.sha256()
        self._records = 0

    def add(self, row: Row) -> None:
        """Take the next row of the log, in order."""
        seq, t_utc_ns, kind, frame_id, body = row
        frame = "" if frame_id is None else frame_id
        self._hash.update(f"{seq}|{t_utc_ns}|{kind}|{frame}|{body}\n".encode())
        self._records += 1

    def result(self) -> LogDigest:
        """Of all that was taken."""
        return LogDigest(sha256=self._hash.hexdigest(), records=self._records)


def digest_rows(rows: Iterable[Row]) -> LogDigest:
    """Digest of a log's rows, given in order."""
    digester = Digester()
    for row in rows:
        digester.add(row)
    return digester.result()


def digest_log(connection: sqlite3.Connection) -> LogDigest:
    """Digest of the log as the database has it now. Raises sqlite3.Error."""
    return digest_rows(connection.execute(LOG_ROWS))


def mark_closed(connection: sqlite3.Connection) -> None:
    """Say in ``meta`` that the session is complete, with the digest of its log, in one commit.

    ``connection`` is in autocommit mode. Raises sqlite3.Error.
    """
    with transaction(connection):
        digest = digest_log(connection)
        connection.executemany(
            "INSERT OR REPLACE INTO meta (key, value) VALUES (?, ?)",
            [(META_KEY, digest.to_json()), ("is_closed", "true")],
        )


def sha256_of(content: bytes) -> str:
    """64 hexadecimal digits."""
    return hashlib.sha256(content).hexdigest()
