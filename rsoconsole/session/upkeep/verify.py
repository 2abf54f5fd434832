"""Verifies a session or its archive against its hashes; reports findings with remedies.

Nothing is changed. A session that was cut off is not damaged: every acknowledged record is there.
"""

import sqlite3
from collections.abc import Callable, Iterable
from contextlib import closing
from pathlib import Path
from typing import TypeAlias

from rsoconsole.base import PART, SessionError
from rsoconsole.session.files.digest import REPAIR, Digester, LogDigest, Verification, session_state
from rsoconsole.session.files.session_files import (
    MANIFEST,
    FolderFiles,
    SessionFiles,
    hash_of,
    open_session_files,
    parse_manifest,
)
from rsoconsole.session.files.upkeep_log import KEEP, UPKEEP, parse_notes, pruning_times
from rsoconsole.session.log.codec import KINDS, decode
from rsoconsole.session.log.database import LOG_ROWS
from rsoconsole.session.log.schema import (
    BESIDE_DATABASE,
    BRANCHES,
    CONFIG,
    DATABASE,
    JOURNAL,
    SCHEMA_VERSION,
    WAL,
    WORLD,
)
from rsoconsole.session.reading.reader import OtherSchemaError, SessionReader

_KNOWN = {DATABASE, *BESIDE_DATABASE, CONFIG, WORLD, UPKEEP, KEEP, MANIFEST}


FileRow: TypeAlias = tuple[str, int | None, str | None]
"""A row of the table ``files``: path, bytes and SHA-256 of a file."""


class FilesCheck:
    """Checks all files of a session, reading each once."""

    def __init__(
        self,
        session_files: SessionFiles,
        found: Verification,
        rows: Iterable[FileRow],
        on_bytes: Callable[[int, int], None] | None,
    ) -> None:
        """Prepare the check. Raises OSError when the files cannot be listed."""
        self._session_files = session_files
        self._found = found
        self._rows = tuple(rows)
        self._on_bytes = on_bytes
        self._sizes = session_files.sizes()
        self._total = sum(self._sizes.get(path, 0) for path, _, _ in self._rows)

    def run(self) -> None:
        """Check the files that the session lists, and find files that it does not list.

        Raises OSError.
        """
        pruned = pruning_times(parse_notes(self._read(UPKEEP)))
        gone: dict[str, int] = {}
        for path, size_bytes, sha256 in self._rows:
            if path in self._sizes:
                self._judge(path, size_bytes, sha256)
            elif path in pruned:
                gone[pruned[path]] = gone.get(pruned[path], 0) + 1
            elif self._found.state != "live":
                self._found.add_damage(path, "the file is not there")
        for t_utc, number in gone.items():
            self._found.add_remark("files", f"{number} were pruned on {t_utc}")
        manifest = parse_manifest(self._read(MANIFEST).decode("utf-8", errors="replace"))
        judged = {path for path, _, _ in self._rows} | set(pruned)
        self._judge_manifest(manifest, judged)
        if self._found.state != "live":
            for path in sorted(set(self._sizes) - judged - set(manifest)):
                self._judge_stray(path)

    def _judge(self, path: str, size_bytes: int | None, sha256: str | None) -> None:
        size = self._sizes[path]
        self._found.files += 1
        try:
            if sha256 is None:
                self._found.add_damage(path, "no hash of it is on record")
            elif hash_of(self._session_files, path, self._count) != sha256:
                what = f"{size} bytes, not the {size_bytes} that were written"
                if size_bytes is None or size_bytes == size:
                    what = "its bytes are not those that were written"
                self._found.add_damage(path, what)
        except OSError as error:
            self._found.add_damage(path, f"cannot be read: {error.strerror or error}")

    def _judge_stray(self, path: str) -> None:
        is_closed = self._found.state == "closed"
        if path.startswith(f"{BRANCHES}/") or path in _KNOWN - set(BESIDE_DATABASE):
            return
        if path in BESIDE_DATABASE:
            if is_closed and self._sizes[path] and path in (WAL, JOURNAL):
                self._found.add_leftover(path, "the session is complete, but in two files")
        elif path.endswith(PART):
            self._found.add_leftover(path, "a file that was being written")
        else:
            self._found.add_leftover(
                path,
                "the session does not know this file",
                f"{REPAIR} where it is a frame or a picture",
            )

    def _judge_manifest(self, manifest: dict[str, str], judged: set[str]) -> None:
        """Compare an archive's own list with its files; frames and pictures were checked before.

        An unpacked session lives on: notes and branches may have changed since, but not its log.
        """
        is_archive = not isinstance(self._session_files, FolderFiles)
        for path in sorted(set(manifest) - judged):
            if not (is_archive or path == DATABASE):
                continue
            if path not in self._sizes:
                self._found.add_damage(path, "the archive's list names it; it is not there")
            elif hash_of(self._session_files, path) != manifest[path]:
                self._found.add_damage(path, "its bytes are not those that were archived")
        if is_archive and not manifest:
            self._found.add_remark(MANIFEST, "the archive has no list of hashes")

    def _read(self, path: str) -> bytes:
        if path not in self._sizes:
            return b""
        with self._session_files.open(path) as stream:
            return stream.read()

    def _count(self, size: int) -> None:
        self._found.bytes += size
        if self._on_bytes is not None:
            self._on_bytes(self._found.bytes, self._total)


_MAX_SQLITE_WORDS = 5
_FILE_ROWS = """
SELECT path, bytes, sha256 FROM files WHERE path IS NOT NULL ORDER BY role = 'frame' DESC, path
"""


def verify_session(place: Path, on_bytes: Callable[[int, int], None] | None = None) -> Verification:
    """Check everything in a session's folder or in its archive (.tar); return the findings.

    ``on_bytes`` is called with (bytes read so far, bytes in all). Damage is reported in the
    findings. Raises SessionError where there is no session, or where another version wrote it.
    """
    place = Path(place)
    if not (place.is_file() or (place / DATABASE).is_file()):
        SessionReader(place)  # says what is missing
    found = Verification(session=place)
    with open_session_files(place) as session_files:
        rows = _verify_database(session_files, found)
        if rows is not None:
            try:
                FilesCheck(session_files, found, rows, on_bytes).run()
            except OSError as error:
                found.add_damage(str(place), f"cannot be read: {error}", "check the disk")
    return found


def find_database_faults(connection: sqlite3.Connection) -> list[str]:
    """Return the faults that SQLite's own check finds in the database; [] for none."""
    try:
        words = [str(row[0]) for row in connection.execute("PRAGMA integrity_check(20)")]
    except sqlite3.Error as error:
        return [str(error)]
    return [] if words == ["ok"] else words


def _verify_database(session_files: SessionFiles, found: Verification) -> list[FileRow] | None:
    """Check the database; return the files that it names, None when it cannot be read."""
    try:
        reader = SessionReader(session_files.folder())
        about = reader.read_meta()
    except OtherSchemaError:
        raise
    except SessionError as error:
        found.add_damage(DATABASE, str(error), REPAIR)
        return None
    found.schema = SCHEMA_VERSION
    found.state = session_state(about)
    try:
        with closing(reader.connect()) as connection:
            for words in find_database_faults(connection)[:_MAX_SQLITE_WORDS]:
                found.add_damage(DATABASE, f"SQLite: {' '.join(words.split())}", REPAIR)
            _verify_log(connection, found, LogDigest.from_meta(about))
            rows: list[FileRow] = connection.execute(_FILE_ROWS).fetchall()
    except (SessionError, sqlite3.Error) as error:
        found.add_damage(DATABASE, f"the table of files cannot be read: {error}", REPAIR)
        return None
    if found.state == "cut off":
        what = "its engine ended without closing it; every acknowledged record is there"
        found.add_leftover(DATABASE, what)
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
                found.add_damage(f"record {seq}", str(error))
    except sqlite3.Error as error:
        found.add_damage(f"record {expected}", f"the log breaks off here: {error}", REPAIR)
    digest = digester.result()
    found.records = digest.records
    _judge_digest(found, digest, recorded)
    _judge_gaps(found, gaps)
    if unknown:
        what = f"{unknown} records are of kinds that this version does not know"
        found.add_remark("log", what, "update rsoconsole")


def _judge_digest(found: Verification, digest: LogDigest, recorded: LogDigest | None) -> None:
    if recorded is None:
        return
    found.digest = "confirmed" if digest == recorded else "differs"
    if digest != recorded:
        found.add_damage(
            "log",
            f"it is not the log that was closed: {digest.records} records with the digest "
            f"{digest.sha256[:12]}, where {recorded.records} with {recorded.sha256[:12]} were",
        )


def _judge_gaps(found: Verification, gaps: Iterable[tuple[int, int]]) -> None:
    for first, last in gaps:
        which = f"record {first}" if first == last else f"records {first} to {last}"
        if found.digest == "confirmed":
            found.add_remark(which, "not in the log, nor when the session was closed")
        else:
            found.add_damage(which, "missing in the order of the log")
