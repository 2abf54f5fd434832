"""Recovers the readable parts of a damaged session into a new session beside it.

The damaged session is only read. Its rows are read twice: by SQLite, which skips unreadable pages,
and page by page, which also finds rows that no table refers to any more.
"""

import errno
import os
import shutil
import sqlite3
import struct
from collections.abc import Iterator
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from rsoconsole.base import (
    PART,
    SessionError,
    parse_json,
    parse_toml,
    read_foreign_text,
    sync_folder,
)
from rsoconsole.session.files.digest import META_KEY as DIGEST_KEY
from rsoconsole.session.files.digest import Row, content_fault, mark_closed, stray_file_row
from rsoconsole.session.files.session_files import FolderFiles
from rsoconsole.session.files.upkeep_log import add_note
from rsoconsole.session.log.codec import KINDS, decode
from rsoconsole.session.log.database import (
    INSERT_FILE,
    INSERT_RECORD,
    LOG_COLUMNS,
    Database,
    connect_to_write,
    create_database,
    limit_statements,
    merge_wal,
    transaction,
    untrusted_tables_reason,
)
from rsoconsole.session.log.pages import MAGIC, DatabasePages, Fields
from rsoconsole.session.log.schema import (
    BESIDE_DATABASE,
    BRANCHES,
    CONFIG,
    DATABASE,
    FOLDERS,
    JOURNAL,
    SCHEMA_VERSION,
    WAL,
    parse_frame_file_path,
)
from rsoconsole.session.reading.reader import SessionReader, expect_schema

RECOVERED = ".recovered"
PAGE_BYTES = 4096
"""Bytes that SQLite and disks read at a time."""
MAX_DEAD_ROWS = 20_000
"""Number of unreadable records in succession at which the log counts as ended."""
MAX_GROWTH = 1000
"""Factor by which a header may state more than there is; beyond it the header is damaged itself."""
_HEADER = struct.Struct(">16sH10xI")
"""Layout of the header: magic, page size, pages. Source: sqlite.org/fileformat.html, 1.3."""
_LOG_FIELDS, _META_FIELDS, _FILES_FIELDS = 5, 2, 7


@dataclass(frozen=True, slots=True, kw_only=True)
class RecoveryResult:
    """A new session made from the readable parts of a damaged session."""

    folder: Path
    records: int
    files: int
    missing: int
    """Number of records missing from the log before the last saved record."""
    is_new: bool
    """True where this call made the session; False where an earlier repair had made it."""


def recover_session(folder: Path, now_utc_ns: int) -> RecoveryResult:
    """Save the readable parts into a new session ``NAME.recovered`` beside the damaged one.

    Frames and pictures are hard links to the files of the damaged session, or copies where the disk
    has no hard links. Raises SessionError when nothing can be saved or the disk refuses.
    """
    target = folder.resolve().with_name(folder.resolve().name + RECOVERED)
    if target.exists():
        return _as_it_is(target)
    beside = target.with_name(target.name + PART)
    try:
        shutil.rmtree(beside, ignore_errors=True)
        beside.mkdir()
        try:
            records, missing = _save_log(folder, beside)
            files = _save_files(folder, beside)
            with closing(connect_to_write(beside / DATABASE)) as connection:
                mark_closed(connection)
            merge_wal(beside / DATABASE, timeout_s=0.0)
            note = {"from": folder.name, "records": records, "missing": missing, "files": files}
            add_note(beside, "recover", now_utc_ns, note)
            beside.replace(target)
            sync_folder(target.parent)
        finally:
            shutil.rmtree(beside, ignore_errors=True)
    except (OSError, sqlite3.Error) as error:
        raise SessionError(
            f"{folder} is damaged, and nothing could be saved beside it: {error}; "
            "see that the disk has room and can be written"
        ) from error
    return RecoveryResult(folder=target, records=records, files=files, missing=missing, is_new=True)


def _as_it_is(target: Path) -> RecoveryResult:
    reader = SessionReader(target)
    counts = reader.counts()
    with closing(reader.connect()) as connection:
        ((files,),) = connection.execute("SELECT count(*) FROM files WHERE path IS NOT NULL")
    return RecoveryResult(
        folder=target,
        records=counts.records,
        files=files,
        missing=reader.last_seq() - counts.records,
        is_new=False,
    )


def _save_log(folder: Path, target: Path) -> tuple[int, int]:
    """Make the new database; return (records saved, places in the log that stay empty)."""
    with TemporaryDirectory(prefix="rsoconsole-", dir=target) as scratch:
        copy = Path(scratch) / DATABASE
        # The shared-memory file is only an index of the log beside it: SQLite makes it again.
        for name in (DATABASE, WAL, JOURNAL):
            if (folder / name).exists():
                _copy_readable(folder / name, Path(scratch) / name)
        # Now: SQLite may fold the log into the database. What it reads itself wins.
        pages = DatabasePages(copy, Path(scratch) / WAL)
        _fill_up(copy)
        read = _Read({}, {}, {})
        _walk(copy, read)
    _scan(pages, read)
    log = read.log
    if not log and not read.meta:
        raise OSError("no record and no fact can be read any more")
    facts = {**_facts(read.meta, folder), "recovered_from": folder.name}
    create_database(target / DATABASE, facts)
    with closing(connect_to_write(target / DATABASE)) as connection, transaction(connection):
        connection.executemany(INSERT_RECORD, (log[seq] for seq in sorted(log)))
        connection.executemany(INSERT_FILE, read.files.values())
    return len(log), max(log, default=0) - len(log)


@dataclass(slots=True)
class _Read:
    """Rows that were read and are valid."""

    log: dict[int, Row]
    meta: dict[str, str]
    files: dict[tuple[int, str], tuple[Any, ...]]


def _walk(database: Path, read: _Read) -> None:
    """Read the rows that SQLite still reads, one by one around the unreadable ones."""
    with (
        suppress(sqlite3.Error),
        closing(sqlite3.connect(database, factory=Database)) as connection,
    ):
        limit_statements(connection, database)
        if untrusted_tables_reason(connection):
            return  # what its tables hold stands on the pages
        for row in _log_around_damage(connection):
            _take_log(read, row)
        _take_rest(read, connection)


def _log_around_damage(connection: sqlite3.Connection) -> Iterator[tuple[Any, ...]]:
    seq, dead = 0, 0
    sql = f"SELECT {LOG_COLUMNS} FROM log WHERE seq {{}} ? ORDER BY seq"
    while dead < MAX_DEAD_ROWS:
        try:
            for row in connection.execute(sql.format(">"), (seq,)):
                yield row
                seq, dead = row[0], 0
            return
        except sqlite3.OperationalError:
            return  # no such table: nothing to walk along
        except sqlite3.DatabaseError:
            seq, dead = seq + 1, dead + 1
        with suppress(sqlite3.Error):
            yield from connection.execute(sql.format("="), (seq,))


def _scan(pages: DatabasePages, read: _Read) -> None:
    """Read the rows that still stand on some page, distinguished by their shape."""
    for rowid, fields in pages.rows():
        if rowid is not None and len(fields) == _LOG_FIELDS:
            _take_log(read, (rowid, *fields[1:]))
        elif rowid is None and len(fields) == _META_FIELDS:
            _take_fact(read, fields)
        elif rowid is None and len(fields) == _FILES_FIELDS:
            _take_file(read, fields)


def _take_log(read: _Read, row: tuple[Any, ...]) -> None:
    """Keep a valid record; damaged ones are dropped."""
    seq, t_utc_ns, kind, frame_id, body = row
    is_shaped = (
        isinstance(seq, int)
        and seq > 0
        and isinstance(t_utc_ns, int)
        and isinstance(kind, str)
        and (frame_id is None or isinstance(frame_id, int))
        and isinstance(body, str)
    )
    if not is_shaped:
        return
    try:
        decode(kind, body) if kind in KINDS else parse_json(body)
    except (SessionError, ValueError):
        return
    read.log.setdefault(seq, (seq, t_utc_ns, kind, frame_id, body))


def _take_rest(read: _Read, connection: sqlite3.Connection) -> None:
    with suppress(sqlite3.Error):
        for row in connection.execute("SELECT key, value FROM meta"):
            _take_fact(read, row)
    with suppress(sqlite3.Error):
        for row in connection.execute("SELECT * FROM files"):
            _take_file(read, row)


def _take_fact(read: _Read, row: Fields) -> None:
    key, value = row
    if isinstance(key, str) and key.isidentifier():
        with suppress(TypeError, ValueError):
            parse_json(value)  # type: ignore[arg-type]
            read.meta.setdefault(key, str(value))


def _take_file(read: _Read, row: Fields) -> None:
    """Keep a valid row of ``files``."""
    frame_id, role, path, size, ms, reason, sha256 = row
    is_shaped = (
        isinstance(frame_id, int)
        and isinstance(role, str)
        and role in FOLDERS
        and isinstance(path, str | None)
        and isinstance(size, int | None)
        and isinstance(reason, str | None)
    )
    if is_shaped:
        key = (int(frame_id or 0), str(role))
        read.files.setdefault(key, (frame_id, role, path, size, ms, reason, sha256))


def _facts(meta: dict[str, str], folder: Path) -> dict[str, Any]:
    """Facts of the session about itself; its configuration from the file beside where need be."""
    facts = {key: parse_json(value) for key, value in meta.items()}
    if not isinstance(facts.get("config"), dict):
        with suppress(OSError, ValueError):
            facts["config"] = parse_toml(read_foreign_text(folder / CONFIG))
    if isinstance(version := facts.get("schema_version"), int):
        expect_schema(folder, version)
    facts.setdefault("title", folder.name)
    if DIGEST_KEY in facts:
        facts["damaged_log_digest"] = facts.pop(DIGEST_KEY)
    return {**facts, "schema_version": SCHEMA_VERSION, "is_closed": False}


def _save_files(folder: Path, target: Path) -> int:
    """Copy the frames and pictures, with rows for those that the table lost."""
    saved: dict[str, tuple[str, int]] = {}
    for path in sorted(FolderFiles(folder).sizes()):
        if path in (DATABASE, *BESIDE_DATABASE) or path.endswith(PART):
            continue
        if path.startswith(f"{BRANCHES}/"):
            continue
        (target / path).parent.mkdir(parents=True, exist_ok=True)
        _link_or_copy(folder / path, target / path)
        place = parse_frame_file_path(path)
        if place is not None:
            saved[path] = place
    with closing(connect_to_write(target / DATABASE)) as connection, transaction(connection):
        rows = connection.execute("SELECT path FROM files WHERE path IS NOT NULL").fetchall()
        named = {str(row[0]) for row in rows}
        for path, (role, frame_id) in saved.items():
            content = b"" if path in named else (target / path).read_bytes()
            if path in named or content_fault(path, content) is not None:
                continue
            connection.execute(INSERT_FILE, stray_file_row(path, role, frame_id, content))
    return len(saved)


def _copy_readable(source: Path, target: Path) -> None:
    """Copy a file; unreadable parts become zeros, which SQLite knows as bad."""
    with source.open("rb", buffering=0) as bad, target.open("wb") as good:
        for place in range(0, source.stat().st_size, PAGE_BYTES):
            try:
                good.write(os.pread(bad.fileno(), PAGE_BYTES, place))
            except OSError as error:
                if error.errno != errno.EIO:
                    raise
                good.write(bytes(PAGE_BYTES))


def _fill_up(copy: Path) -> None:
    """Extend a truncated database to its full length: SQLite reads none that is too short."""
    with copy.open("r+b") as stream:
        header = stream.read(_HEADER.size)
        if len(header) < _HEADER.size:
            return
        magic, page_bytes, pages = _HEADER.unpack(header)
        size = (65536 if page_bytes == 1 else page_bytes) * pages
        held = stream.seek(0, os.SEEK_END)
        if magic == MAGIC and held < size <= MAX_GROWTH * held:
            stream.truncate(size)


def _link_or_copy(source: Path, target: Path) -> None:
    try:
        os.link(source, target)
    except OSError:
        # Another disk behind a link, or a file system without hard links.
        shutil.copyfile(source, target)
