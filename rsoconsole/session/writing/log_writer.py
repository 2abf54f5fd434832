"""The thread that writes a live session's database."""

import contextlib
import itertools
import shutil
import sqlite3
import tempfile
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Any

from rsoconsole.config import state_dir
from rsoconsole.records import Event, Record
from rsoconsole.session.log.codec import encode
from rsoconsole.session.log.database import (
    FILE_ROWS,
    INSERT_FILE,
    INSERT_RECORD,
    LOG_ROWS,
    LogFileWatch,
    connect_to_read,
    connect_to_write,
    lay_out_session,
    transaction,
)
from rsoconsole.session.log.schema import DATABASE
from rsoconsole.session.writing.worker import RecordingFaults

Statement = tuple[str, tuple[object, ...]]
MIN_BYTES = 200_000_000
"""Least free disk for a rescue session, bytes: many nights of records."""
_ROWS_PER_BATCH = 1000
_TABLES = ((LOG_ROWS, INSERT_RECORD), (FILE_ROWS, INSERT_FILE))


def rescue_places() -> Iterator[Path]:
    """Yield the folders in which a rescue session may be made, in order of preference.

    They need not exist, nor have free disk.
    """
    yield state_dir() / "rescue"
    with contextlib.suppress(OSError):  # it tries to write there
        yield Path(tempfile.gettempdir()) / "rsoconsole-rescue"
    with contextlib.suppress(RuntimeError):
        yield Path.home() / "rsoconsole-rescue"


class RescueSession:
    """Rescue session: a session in another folder, written when the session's own disk fails.

    Its files are created only when they are needed.
    """

    def __init__(
        self,
        session: Path,
        facts: Mapping[str, Any],
        config: bytes,
        places: Callable[[], Iterable[Path]] = rescue_places,
    ) -> None:
        """``session``: folder whose disk may fail.

        ``facts`` and ``config`` go into the rescue session, too.
        """
        self._session = session
        self._facts = {**facts, "rescues": str(session.absolute())}
        self._config = config
        self._places = places
        self._connection: sqlite3.Connection | None = None
        self.folder: Path | None = None
        """Folder of the rescue session; None before it is begun."""

    def begin(self) -> bool:
        """Create the rescue session; return False where no folder can be used."""
        if self._connection is not None:
            return True
        for place in self._places():
            folder = place / self._session.name
            try:
                place.mkdir(mode=0o700, parents=True, exist_ok=True)
                if shutil.disk_usage(place).free < MIN_BYTES or folder.exists():
                    _remove_if_empty(place)
                    continue
                folder.mkdir()
                lay_out_session(folder, self._config, self._facts)
                self._connection = connect_to_write(folder / DATABASE)
            except (OSError, sqlite3.Error, ValueError):
                shutil.rmtree(folder, ignore_errors=True)
                _remove_if_empty(place)
                continue
            self.folder = folder
            return True
        return False

    def copy(self, source: sqlite3.Connection | None, newest: Sequence[Statement]) -> bool:
        """Copy all rows that ``source`` can still read, then write ``newest``.

        ``source``: connection to the lost log, whose file may be deleted. ``newest``: statements
        that the lost log may lack. Returns False where the rescue session's disk refuses them.
        """
        if source is not None:
            with contextlib.suppress(sqlite3.Error, MemoryError):
                for table in _TABLES:
                    self._copy_table(source, table)
        return self.write(newest)

    def _copy_table(self, source: sqlite3.Connection, table: tuple[str, str]) -> None:
        assert self._connection is not None
        rows = source.execute(table[0])
        while some := rows.fetchmany(_ROWS_PER_BATCH):
            with transaction(self._connection):
                self._connection.executemany(table[1], some)

    def write(self, statements: Sequence[Statement]) -> bool:
        """Commit statements; return False where the rescue session's disk refuses them."""
        assert self._connection is not None
        try:
            with transaction(self._connection):
                for sql, values in statements:
                    self._connection.execute(sql, values)
        except sqlite3.Error:
            return False
        return True

    def discard(self) -> None:
        """Remove the rescue session, because the session itself now has every record."""
        self.close()
        if self.folder is not None:
            shutil.rmtree(self.folder, ignore_errors=True)
            _remove_if_empty(self.folder.parent)
            self.folder = None

    def close(self) -> None:
        """Close the rescue session's database."""
        if self._connection is not None:
            with contextlib.suppress(sqlite3.Error):
                self._connection.close()
            self._connection = None


def _remove_if_empty(place: Path) -> None:
    """Remove a folder that is empty, so that none stays behind in a user's home."""
    with contextlib.suppress(OSError):  # it holds other rescues, or was never made
        place.rmdir()


COMMIT_S = 0.25
RETRY_S = 1.0
MAX_BATCH = 2000
_MAX_RECENT = 2000
MAX_WAITING = 500_000
"""Largest number of records held in memory while the disk refuses them: many nights' worth."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionFileRow:
    """A row of the database's table ``files``, which lists the files beside the log.

    The fields are the columns in order. ``path`` None: the file is missing; ``reason`` says why.
    """

    frame_id: int
    role: str
    path: str | None = None
    bytes: int | None = None
    ms: float | None = None
    reason: str | None = None
    sha256: str | None = None


_Entry = tuple[int, int, Record] | SessionFileRow


class LogWriter:
    """Accepts records without waiting, and commits them in batches on a thread of its own.

    While the disk refuses them, they are held in memory and in a rescue session elsewhere.
    Where the log was removed or damaged, all further records go into the rescue session.
    """

    def __init__(self, path: Path, faults: RecordingFaults, rescue: RescueSession) -> None:
        self._path = path
        self._place = LogFileWatch(path)
        self._rescue = rescue
        self._rescued = 0
        """Number of the oldest unwritten statements that are in the rescue session already."""
        self._is_lost = False
        self._damage = ""
        self._has_taken_over = False
        """True once the rescue session has all that could still be read of the lost log."""
        self._recent: deque[Statement] = deque(maxlen=_MAX_RECENT)
        """Latest committed statements: some of them may be lost with the log."""
        self._faults = faults
        self._waiting: deque[_Entry] = deque()
        self._unwritten: deque[Statement] = deque()
        self._lock = threading.Lock()
        self._next_seq = 1
        self._taken = 0
        self._committed = 0
        self._progress = threading.Condition()
        self._wake = threading.Event()
        self._is_closing = False
        self._connection: sqlite3.Connection | None = None
        self._thread = threading.Thread(target=self._run, name="session-log", daemon=True)
        self._thread.start()

    @property
    def path(self) -> Path:
        """Path of the database that has all records: the rescue session's once the log is lost."""
        folder = self._rescue.folder if self._has_taken_over else None
        return self._path if folder is None else folder / DATABASE

    def add_record(self, record: Record, t_utc_ns: int) -> int:
        """Queue a record for writing; return its ``seq``, its number in the log."""
        with self._lock:
            seq = self._next_seq
            self._next_seq += 1
            self._take((seq, t_utc_ns, record))
        return seq

    def add_file_row(self, file: SessionFileRow) -> None:
        """Queue a row of the database's table ``files`` for writing."""
        with self._lock:
            self._take(file)

    def _take(self, entry: _Entry) -> None:
        if self._is_closing:
            self._faults.report("late", "a record came after the session was closed: it is lost")
        elif self._taken - self._committed >= MAX_WAITING:
            self._faults.report("memory", f"{MAX_WAITING} records wait for the disk: some are lost")
        else:
            self._waiting.append(entry)
            self._taken += 1

    def flush(self, timeout_s: float) -> bool:
        """Commit all accepted records; return False where this session's log lacks some of them.

        Records in the rescue session alone count as lacking: a reader of this session does not find
        them.
        """
        if not self._is_durable(timeout_s) or self._is_lost:
            return False
        with self._progress:
            # The disk may take it again with the next try.
            return self._progress.wait_for(lambda: not self._rescued, min(timeout_s, 1.5 * RETRY_S))

    def _is_durable(self, timeout_s: float) -> bool:
        """Wait until all accepted entries are on some disk; return False where the time is out."""
        with self._lock:
            goal = self._taken
        self._wake.set()
        with self._progress:
            return self._progress.wait_for(lambda: self._committed >= goal, timeout_s)

    def close(self, timeout_s: float) -> bool:
        """Commit all queued records and close the database; return False if it lacks any."""
        is_flushed = self._is_durable(timeout_s)
        with self._lock:
            self._is_closing = True
        self._wake.set()
        self._thread.join(timeout_s)
        if self._rescued:
            words = f"its newest records are in the rescue session {self._rescue.folder} alone"
            self._faults.report("close", f"the session is not complete: {words}")
            return False
        return is_flushed and not self._thread.is_alive()

    def _run(self) -> None:
        while True:
            self._wake.wait(COMMIT_S)
            self._wake.clear()
            with self._lock:
                is_last_round = self._is_closing
                fresh = list(self._waiting)
                self._waiting.clear()
            self._unwritten.extend(self._statement(entry) for entry in fresh)
            is_written = self._write()
            if is_last_round:
                self._disconnect()
                self._place.close()
                self._rescue.close()
                if not is_written and len(self._unwritten) > self._rescued:
                    lost = f"the session is closed without its last {len(self._unwritten)} records"
                    self._faults.report("close", lost)
                return
            if not is_written:
                # A full disk seldom empties at once: spare it, but let flush() try.
                self._wake.wait(RETRY_S)

    def _write(self) -> bool:
        """Commit the unwritten statements, oldest first.

        Returns False as soon as the disk refuses them.
        """
        if not self._is_lost and self._connection is not None:
            self._check_log_file()
        if self._is_lost:
            return self._write_to_rescue()
        while self._unwritten:
            batch = list(itertools.islice(self._unwritten, MAX_BATCH))
            try:
                if self._connection is None:
                    self._connection = connect_to_write(self._path)
                with transaction(self._connection):
                    for sql, values in batch:
                        self._connection.execute(sql, values)
            except (sqlite3.Error, OSError) as error:
                waiting = f"{len(self._unwritten)} records wait in memory"
                text = f"the session's log cannot be written ({error}): free space; {waiting}"
                self._disconnect()
                if self._write_to_rescue():
                    text += f" and in the rescue session {self._rescue.folder}"
                self._faults.report("log", text)
                return False
            self._faults.clear("log")
            for _ in batch:
                self._recent.append(self._unwritten.popleft())
            again = min(self._rescued, len(batch))
            # Acknowledged is what a reader finds.
            is_there = self._check_log_file()
            if not is_there and not self._has_taken_over:
                self._unwritten.extendleft(reversed(batch))
                return False
            self._rescued -= again
            if is_there and not self._rescued:
                self._rescue.discard()
            self._advance(len(batch) - again)
            if self._is_lost:
                return self._write_to_rescue()
        return True

    def _advance(self, count: int) -> None:
        """Count records that are now on the disk."""
        with self._progress:
            self._committed += count
            self._progress.notify_all()

    def _write_to_rescue(self) -> bool:
        """Write the unwritten statements into the rescue session; return False where that fails."""
        rescue = self._rescue
        if not (self._take_over() if self._is_lost else rescue.begin()):
            return False
        fresh = list(itertools.islice(self._unwritten, self._rescued, None))
        if fresh and not rescue.write(fresh):
            return False
        if self._is_lost:
            self._unwritten.clear()
            self._rescued = 0
        else:
            self._rescued += len(fresh)
        self._advance(len(fresh))
        return True

    def _check_log_file(self) -> bool:
        """Check that the log is still in its place; SQLite does not notice when it is not."""
        damage = self._place.find_damage(self._has_all)
        if damage is None:
            return True
        self._is_lost, self._damage = True, damage
        if not self._take_over():
            self._faults.report("log", f"{damage}: what comes is not on any disk")
        return False

    def _take_over(self) -> bool:
        """Have the rescue session take over; return False while that is not yet possible.

        As long as the connection lives, most of it can still be read.
        """
        if self._has_taken_over:
            return True
        rescue = self._rescue
        if not rescue.begin() or not rescue.copy(self._connection, list(self._recent)):
            return False
        self._has_taken_over = True
        self._disconnect()
        words = f"{self._damage}: the night goes on in the rescue session {rescue.folder}"
        self._faults.report("log", words)
        return True

    def _has_all(self) -> bool:
        """True where a reader finds the newest record that was committed."""
        newest = next((v[0] for sql, v in reversed(self._recent) if sql == INSERT_RECORD), None)
        if newest is None:
            return True
        try:
            with closing(connect_to_read(self._path)) as reader:
                ((found,),) = reader.execute("SELECT max(seq) FROM log")
        except (sqlite3.Error, OSError):
            return False
        return bool(found == newest)

    def _statement(self, entry: _Entry) -> Statement:
        if isinstance(entry, SessionFileRow):
            return INSERT_FILE, astuple(entry)
        seq, t_utc_ns, record = entry
        try:
            kind, frame_id, body = encode(record)
            if not 0 <= t_utc_ns < 2**63:
                raise ValueError(f"{t_utc_ns} is no instant")
        except Exception as error:  # one bad record must not end the log of all others
            # Its place in the order stays taken, so that the gap is seen.
            text = f"a {type(record).__name__} could not be recorded: {error}"
            self._faults.report("record", text)
            kind, frame_id, body = encode(Event(level="alarm", text=text))
            t_utc_ns = 0
        return INSERT_RECORD, (seq, t_utc_ns, kind, frame_id, body)

    def _disconnect(self) -> None:
        if self._connection is not None:
            try:
                self._connection.close()
            except sqlite3.Error as error:
                self._faults.report("log", f"the session's log cannot be closed: {error}")
            self._connection = None
            self._place.forget_wal()
