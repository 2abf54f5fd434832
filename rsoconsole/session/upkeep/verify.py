"""Whether a session, or its archive, is still what was written; what is not, and what to do.

Nothing is changed. A session that was cut off is not damaged: every acknowledged record is there.
"""

import sqlite3
from collections.abc import Callable, Iterable
from contextlib import closing
from pathlib import Path

from rsoconsole.errors import SessionError
from rsoconsole.session.files import (
    REPAIR,
    Digester,
    Holdings,
    LogDigest,
    Verification,
    holdings_of,
    state_of,
)
from rsoconsole.session.log import DATABASE, KINDS, LOG_ROWS, SCHEMA_VERSION, decode
from rsoconsole.session.reading import OtherSchemaError, SessionReader
from rsoconsole.session.upkeep.verify_files import FileRow, FilesCheck

_MOST_SQLITE_WORDS = 5
_FILE_ROWS = """
SELECT path, bytes, sha256 FROM files WHERE path IS NOT NULL ORDER BY role = 'frame' DESC, path
"""


def verify_session(place: Path, on_bytes: Callable[[int, int], None] | None = None) -> Verification:
    """Look at everything in a session's folder or in its archive (.tar).

    ``on_bytes`` is told (bytes read so far, bytes in all) of the files. Raises SessionError when
    there is no session at all, or one that another version wrote; a damaged one is a result.
    """
    place = Path(place)
    if not (place.is_file() or (place / DATABASE).is_file()):
        SessionReader(place)  # says what is missing
    found = Verification(session=place)
    with holdings_of(place) as holdings:
        rows = _verify_database(holdings, found)
        if rows is not None:
            try:
                FilesCheck(holdings, found, rows, on_bytes).run()
            except OSError as error:
                found.damage(str(place), f"cannot be read: {error}", "check the disk")
    return found


def page_faults(connection: sqlite3.Connection) -> list[str]:
    """What SQLite finds wrong with the database as a file; empty when all is well."""
    try:
        words = [str(row[0]) for row in connection.execute("PRAGMA integrity_check(20)")]
    except sqlite3.Error as error:
        return [str(error)]
    return [] if words == ["ok"] else words


def _verify_database(holdings: Holdings, found: Verification) -> list[FileRow] | None:
    """Judge the database; returns what files it names, None when it cannot be read."""
    try:
        reader = SessionReader(holdings.folder())
        about = reader.about()
    except OtherSchemaError:
        raise
    except SessionError as error:
        found.damage(DATABASE, str(error), REPAIR)
        return None
    found.schema = SCHEMA_VERSION
    found.state = state_of(about)
    try:
        with closing(reader.connect()) as connection:
            for words in page_faults(connection)[:_MOST_SQLITE_WORDS]:
                found.damage(DATABASE, f"SQLite: {' '.join(words.split())}", REPAIR)
            _verify_log(connection, found, LogDigest.from_meta(about))
            rows = [
                FileRow(path=path, bytes=size, sha256=sha256)
                for path, size, sha256 in connection.execute(_FILE_ROWS)
            ]
    except (SessionError, sqlite3.Error) as error:
        found.damage(DATABASE, f"the table of files cannot be read: {error}", REPAIR)
        return None
    if found.state == "cut off":
        what = "its engine ended without closing it; every acknowledged record is there"
        found.leftover(DATABASE, what)
    return rows


def _verify_log(
    connection: sqlite3.Connection, found: Verification, recorded: LogDigest | None
) -> None:
    digester, unknown, expected = Digester(), 0, 1
    gaps: list[tuple[int, int]] = []
    try:
        for row in connection.execute(LOG_ROWS):
            seq, _, kind, _, body = row
            if seq != expected:
                gaps.append((expected, seq - 1))
            expected = seq + 1
            digester.add(row)
            found.frames += kind == "FrameTaken"
            if kind not in KINDS:
                unknown += 1
                continue
            try:
                decode(kind, body)
            except SessionError as error:
                found.damage(f"record {seq}", str(error))
    except sqlite3.Error as error:
        found.damage(f"record {expected}", f"the log breaks off here: {error}", REPAIR)
    digest = digester.result()
    found.records = digest.records
    _judge_digest(found, digest, recorded)
    _judge_gaps(found, gaps)
    if unknown:
        what = f"{unknown} records are of kinds that this version does not know"
        found.remark("log", what, "update rsoconsole")


def _judge_digest(found: Verification, digest: LogDigest, recorded: LogDigest | None) -> None:
    if recorded is None:
        return
    found.digest = "confirmed" if digest == recorded else "differs"
    if digest != recorded:
        found.damage(
            "log",
            f"it is not the log that was closed: {digest.records} records with the digest "
            f"{digest.sha256[:12]}, where {recorded.records} with {recorded.sha256[:12]} were",
        )


def _judge_gaps(found: Verification, gaps: Iterable[tuple[int, int]]) -> None:
    for first, last in gaps:
        which = f"record {first}" if first == last else f"records {first} to {last}"
        if found.digest == "confirmed":
            found.remark(which, "not in the log, nor when the session was closed")
        else:
            found.damage(which, "missing in the order of the log")
