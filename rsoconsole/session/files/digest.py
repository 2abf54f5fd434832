"""Integrity of a session: hashes of its files, the digest of its log, the findings of a check.

The digest is the SHA-256 of the log as text, one line per record in order of ``seq``, each ended by
a line feed: ``seq|t_utc_ns|kind|frame_id|body`` in UTF-8, integers in decimal, ``frame_id`` empty
where it is NULL, ``body`` as it is stored. ``sqlite3`` prints these columns in the same form; see
``sessions/README.md`` for the command.
"""

import hashlib
import io
import json
import sqlite3
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any, Literal, TypeAlias

from rsoconsole.session.log.database import LOG_ROWS, transaction
from rsoconsole.session.log.liveness import is_being_written

META_KEY = "log_digest"

Row: TypeAlias = tuple[int, int, str, int | None, str]
"""One row of the log: seq, t_utc_ns, kind, frame_id, body."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LogDigest:
    """Digest of a session's log, with the number of its records."""

    sha256: str
    """SHA-256 of the log, 64 hexadecimal digits."""
    records: int

    def to_json(self) -> str:
        """Return the digest as JSON, for the table ``meta``."""
        return json.dumps({"sha256": self.sha256, "records": self.records})

    @classmethod
    def from_meta(cls, meta: Mapping[str, Any]) -> "LogDigest | None":
        """Return the digest in a session's table ``meta``.

        None for a session that is not closed.
        """
        found = meta.get(META_KEY)
        if not isinstance(found, dict):
            return None
        return cls(sha256=str(found.get("sha256")), records=int(found.get("records") or 0))


class Digester:
    """Computes the digest of a log, row by row."""

    def __init__(self) -> None:
        self._hash = hashlib.sha256()
        self._records = 0

    def add(self, row: Row) -> None:
        """Add the next row of the log, in order."""
        seq, t_utc_ns, kind, frame_id, body = row
        frame = "" if frame_id is None else frame_id
        self._hash.update(f"{seq}|{t_utc_ns}|{kind}|{frame}|{body}\n".encode())
        self._records += 1

    def result(self) -> LogDigest:
        """Return the digest of all rows added so far."""
        return LogDigest(sha256=self._hash.hexdigest(), records=self._records)


def digest_rows(rows: Iterable[Row]) -> LogDigest:
    """Return the digest of a log's rows, given in order."""
    digester = Digester()
    for row in rows:
        digester.add(row)
    return digester.result()


def digest_log(connection: sqlite3.Connection) -> LogDigest:
    """Compute the digest of the log in the database as it is now. Raises sqlite3.Error."""
    return digest_rows(connection.execute(LOG_ROWS))


def mark_closed(connection: sqlite3.Connection) -> None:
    """Mark the session as complete in ``meta``, with the digest of its log, in one commit.

    ``connection`` must be in autocommit mode. Raises sqlite3.Error.
    """
    with transaction(connection):
        digest = digest_log(connection)
        connection.executemany(
            "INSERT OR REPLACE INTO meta (key, value) VALUES (?, ?)",
            [(META_KEY, digest.to_json()), ("is_closed", "true")],
        )


def sha256_of(content: bytes) -> str:
    """Return the SHA-256 of ``content``, 64 hexadecimal digits."""
    return hashlib.sha256(content).hexdigest()


_PNG_MAGIC = b"\x89PNG\r\n\x1a\n"
_CHUNK_BYTES_BESIDE_DATA = 12
"""Bytes of a chunk's length, type and CRC. Source: PNG specification (ISO/IEC 15948), 5.3."""


def stray_file_row(path: str, role: str, frame_id: int, content: bytes) -> tuple[object, ...]:
    """Return a row of the table ``files`` for a file on the disk that the table lacks."""
    return frame_id, role, path, len(content), None, None, sha256_of(content)


def content_fault(name: str, content: bytes) -> str | None:
    """Return why a FITS or PNG file is damaged; None for a sound file.

    None also for files of other kinds, which are not examined.
    """
    suffixes = {suffix.lower() for suffix in PurePosixPath(name).suffixes}
    if ".png" in suffixes:
        return _png_fault(content)
    if suffixes & {".fits", ".fit", ".fts"}:
        return _fits_fault(content)
    return None


def _png_fault(content: bytes) -> str | None:
    """Fault of a PNG file by its chunks' own checksums, without a decoder; None for a sound one."""
    if not content.startswith(_PNG_MAGIC):
        return "it is no PNG picture"
    place = len(_PNG_MAGIC)
    while place + _CHUNK_BYTES_BESIDE_DATA <= len(content):
        size = int.from_bytes(content[place : place + 4], "big")
        end = place + 8 + size
        if end + 4 > len(content):
            break
        if zlib.crc32(content[place + 4 : end]) != int.from_bytes(content[end : end + 4], "big"):
            return "a part of the picture is damaged"
        if content[place + 4 : place + 8] == b"IEND":
            return None
        place = end + 4
    return "the picture breaks off"


def _fits_fault(content: bytes) -> str | None:
    import warnings

    from astropy.io import fits

    try:
        with warnings.catch_warnings():
            # A file that breaks off is only worth a warning to astropy.
            warnings.simplefilter("error")
            with fits.open(io.BytesIO(content), memmap=False) as hdus:
                shapes = [hdu.data.shape for hdu in hdus if hdu.is_image and hdu.data is not None]
    except Exception as error:  # astropy raises whatever a damaged file makes it stumble over
        return f"it cannot be read as FITS ({error})"
    return None if any(len(shape) == 2 for shape in shapes) else "it holds no image"


Severity: TypeAlias = Literal["damage", "leftover", "remark"]
"""Severity of a finding: record lost or changed, something to be repaired, or good to know."""
State: TypeAlias = Literal["closed", "live", "cut off", "other version", "unreadable"]
Digest: TypeAlias = Literal["confirmed", "differs", "none"]

REPAIR = "'rsoconsole sessions repair' sets it right"
FROM_COPY = "take it from a copy of the session, if there is one; the rest is not affected"
NOTHING_TO_DO = "nothing to do"


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """One difference between a session's files and what its record says."""

    severity: Severity
    place: str
    """Where: path of a file in the session's folder, or a part of the log."""
    what: str
    remedy: str


@dataclass(slots=True, kw_only=True)
class Verification:
    """Result of checking one session."""

    session: Path
    state: State = "unreadable"
    schema: int | None = None
    records: int = 0
    frames: int = 0
    files: int = 0
    """Number of files whose bytes were read."""
    bytes: int = 0
    digest: Digest = "none"
    """Result of comparing the log with its digest; "none": the session is not closed."""
    findings: list[Finding] = field(default_factory=list)

    @property
    def is_sound(self) -> bool:
        """True where nothing is damaged; leftovers that wait for a repair do not count."""
        return all(found.severity != "damage" for found in self.findings)

    def add_damage(self, place: str, what: str, remedy: str = FROM_COPY) -> None:
        """Add a finding of damage: part of the record is lost or changed."""
        self._add("damage", place, what, remedy)

    def add_leftover(self, place: str, what: str, remedy: str = REPAIR) -> None:
        """Add a finding of a leftover: something waits to be repaired, nothing is lost."""
        self._add("leftover", place, what, remedy)

    def add_remark(self, place: str, what: str, remedy: str = NOTHING_TO_DO) -> None:
        """Add a finding for information: nothing is to be done."""
        self._add("remark", place, what, remedy)

    def _add(self, severity: Severity, place: str, what: str, remedy: str) -> None:
        self.findings.append(Finding(severity=severity, place=place, what=what, remedy=remedy))


def session_state(about: Mapping[str, Any]) -> State:
    """Return the state of a session (closed, live or cut off), from its table ``meta``."""
    if about.get("is_closed") is True:
        return "closed"
    return "live" if is_being_written(about) else "cut off"
