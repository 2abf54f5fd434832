"""Repairs a session that was cut off or damaged.

No record is ever changed, and only half-written files are removed. What is readable of a damaged
session is saved into a new session beside it.
"""

import sqlite3
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rsoconsole.base import PART, SessionError
from rsoconsole.session.files.digest import content_fault, mark_closed, stray_file_row
from rsoconsole.session.files.session_files import FolderFiles
from rsoconsole.session.files.upkeep_log import add_note
from rsoconsole.session.log.database import INSERT_FILE, connect_to_write, merge_wal, transaction
from rsoconsole.session.log.liveness import is_being_written
from rsoconsole.session.log.schema import BRANCHES, DATABASE, JOURNAL, WAL, parse_frame_file_path
from rsoconsole.session.reading.reader import OtherSchemaError, SessionReader
from rsoconsole.session.upkeep._recover import RecoveryResult, recover_session
from rsoconsole.session.upkeep.merge import (
    LEAVE_WAL_S,
    MergeResult,
    merge_rescue,
    rescues_of,
    session_of_rescue,
)
from rsoconsole.session.upkeep.verify import find_database_faults


@dataclass(slots=True, kw_only=True)
class RepairResult:
    """Result of repairing one session."""

    session: Path
    closed: bool = False
    """True where a session that was cut off is now marked closed, with the digest of its log."""
    folded: bool = False
    adopted: list[str] = field(default_factory=list)
    """Files that were complete on the disk and missing in the log; the log has them now."""
    removed: list[str] = field(default_factory=list)
    left: dict[str, str] = field(default_factory=dict)
    merged: list[MergeResult] = field(default_factory=list)
    unmerged: dict[Path, str] = field(default_factory=dict)
    recovered: RecoveryResult | None = None
    """New session with the readable parts of a damaged database; None for a sound database."""

    @property
    def did_anything(self) -> bool:
        """True where the repair changed anything."""
        done = self.closed or self.folded or bool(self.adopted or self.removed or self.merged)
        return done or (self.recovered is not None and self.recovered.is_new)


def repair_session(folder: Path, now_utc_ns: int) -> RepairResult:
    """Repair a session, and merge its rescue sessions into it.

    ``folder``: the session, or a rescue session, which is itself repaired and then merged. A rescue
    that cannot be merged remains, with the reason in ``unmerged`` of the result. With a damaged
    database, the readable parts are saved into a new session instead, and nothing is merged.
    Repeating a complete repair changes nothing. ``now_utc_ns`` dates the note in ``upkeep.jsonl``.
    Raises SessionError when there is no session, when its engine is running, when another process
    has it open, or when the disk refuses.
    """
    folder = Path(folder)
    about = _readable_about(folder)
    if is_being_written(about):
        raise SessionError(f"{folder} is being written, its engine lives: end the engine first")
    rescues = (folder,) if session_of_rescue(folder) is not None else rescues_of(folder)
    if _is_damaged(folder):
        done = RepairResult(session=folder, recovered=recover_session(folder, now_utc_ns))
        done.unmerged = dict.fromkeys(rescues, "the session's database is damaged")
        return done
    try:
        done = _repair(SessionReader(folder), about, now_utc_ns)
        _merge(rescues, done, now_utc_ns)
        return done
    except (sqlite3.Error, OSError) as error:
        raise SessionError(
            f"{folder} cannot be repaired now: {error}; close whatever shows it, "
            "see that the disk has room and can be written, and try again"
        ) from error


def _merge(rescues: Sequence[Path], done: RepairResult, now_utc_ns: int) -> None:
    for rescue in rescues:
        try:
            done.merged.append(merge_rescue(rescue, now_utc_ns))
        except SessionError as error:
            done.unmerged[rescue] = str(error)


def _readable_about(folder: Path) -> dict[str, Any]:
    """Facts of the session about itself; empty where it is too damaged.

    Raises SessionError where there is no session, or one that this version must not touch.
    """
    try:
        return SessionReader(folder).read_meta()
    except OtherSchemaError:
        raise
    except SessionError:
        if not (folder / DATABASE).is_file():
            raise
        return {}


def _is_damaged(folder: Path) -> bool:
    """True where SQLite cannot read the database whole."""
    try:
        with closing(SessionReader(folder).connect()) as connection:
            return bool(find_database_faults(connection))
    except SessionError:
        return True


def _repair(reader: SessionReader, about: dict[str, Any], now_utc_ns: int) -> RepairResult:
    folder = reader.folder
    done = RepairResult(session=folder)
    strays = _stray_rows(reader, done)
    is_open = about.get("is_closed") is not True
    is_split = any((folder / name).exists() for name in (WAL, JOURNAL))
    if strays or is_open or is_split:
        with closing(connect_to_write(folder / DATABASE)) as connection:
            if strays:
                with transaction(connection):
                    connection.executemany(INSERT_FILE, strays.values())
                done.adopted = list(strays)
            if is_open:
                mark_closed(connection)
                done.closed = True
        # With a stray alone this folds nothing, and does no harm.
        merge_wal(folder / DATABASE, LEAVE_WAL_S)
        done.folded = is_split
    _remove_parts(folder, done)
    if done.did_anything:
        details: dict[str, Any] = {"closed": done.closed, "folded": done.folded}
        add_note(
            folder,
            "repair",
            now_utc_ns,
            {**details, "adopted": done.adopted, "removed": done.removed},
        )
    return done


def _stray_rows(reader: SessionReader, done: RepairResult) -> dict[str, tuple[object, ...]]:
    """Rows for whole frames and pictures that are missing in the table ``files``, by their path."""
    with closing(reader.connect()) as connection:
        known = {tuple(row) for row in connection.execute("SELECT role, frame_id FROM files")}
    found: dict[str, tuple[object, ...]] = {}
    for path in sorted(FolderFiles(reader.folder).sizes()):
        place = parse_frame_file_path(path)
        if place is None or place in known:
            continue
        content = (reader.folder / path).read_bytes()
        fault = content_fault(path, content)
        if fault is not None:
            done.left[path] = fault
        else:
            found[path] = stray_file_row(path, *place, content)
    return found


def _remove_parts(folder: Path, done: RepairResult) -> None:
    for path in sorted(FolderFiles(folder).sizes()):
        if path.endswith(PART) and not path.startswith(f"{BRANCHES}/"):
            (folder / path).unlink(missing_ok=True)
            done.removed.append(path)
