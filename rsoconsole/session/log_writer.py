"""The thread that owns a live session's database."""

import sqlite3
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from rsoconsole.errors import SessionError
from rsoconsole.records import Event
from rsoconsole.session.codec import Record, encode
from rsoconsole.session.faults import Faults

COMMIT_S = 0.25
RETRY_S = 1.0
MAX_WAITING = 500_000
"""Records kept in memory while the disk refuses them: many nights' worth."""

# OR IGNORE: a commit that reported an error may have reached the disk all the same.
_INSERT_RECORD = (
    "INSERT OR IGNORE INTO log (seq, t_utc_ns, kind, frame_id, body) VALUES (?, ?, ?, ?, ?)"
)
_INSERT_FILE = (
    "INSERT OR REPLACE INTO files (frame_id, role, path, bytes, ms, reason) "
    "VALUES (?, ?, ?, ?, ?, ?)"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class KeptFile:
    """A file of the session beside its log, or why it is not there."""

    frame_id: int
    role: str
    path: str | None
    bytes: int | None
    ms: float | None
    reason: str | None


_Entry = tuple[int, int, Record] | KeptFile
_Statement = tuple[str, tuple[object, ...]]


class LogWriter:
    """Takes entries at once and commits them in batches; keeps them while the disk refuses."""

    def __init__(
        self,
        path: Path,
        faults: Faults,
        connect: Callable[[Path], sqlite3.Connection],
        commit_s: float = COMMIT_S,
    ) -> None:
        self._path = path
        self._faults = faults
        self._connect = connect
        self._commit_s = commit_s
        self._waiting: deque[_Entry] = deque()
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

    def put(self, record: Record, t_utc_ns: int) -> int:
        """Take a record; returns its place in the order of the log."""
        with self._lock:
            seq = self._next_seq
            self._next_seq += 1
            self._take((seq, t_utc_ns, record))
        return seq

    def put_file(self, file: KeptFile) -> None:
        """Take the news of a file."""
        with self._lock:
            self._take(file)

    def _take(self, entry: _Entry) -> None:
        if self._is_closing:
            self._faults.report("late", "a record came after the session was closed: it is lost")
        elif len(self._waiting) >= MAX_WAITING:
            self._faults.report("memory", f"{MAX_WAITING} records wait for the disk: some are lost")
        else:
            self._waiting.append(entry)
            self._taken += 1

    def flush(self, timeout_s: float) -> bool:
        """Commit all that was taken so far; False when the disk does not let it."""
        with self._lock:
            goal = self._taken
        self._wake.set()
        with self._progress:
            return self._progress.wait_for(lambda: self._committed >= goal, timeout_s)

    def close(self, timeout_s: float) -> bool:
        """Commit the rest and let go of the database; False when that did not succeed."""
        is_flushed = self.flush(timeout_s)
        with self._lock:
            self._is_closing = True
        self._wake.set()
        self._thread.join(timeout_s)
        return is_flushed and not self._thread.is_alive()

    def _run(self) -> None:
        while True:
            self._wake.wait(self._commit_s)
            self._wake.clear()
            with self._lock:
                is_last_round = self._is_closing
                batch = list(self._waiting)
            if batch:
                is_committed = self._commit(batch)
                if not is_committed and not is_last_round:
                    # A full disk seldom empties at once: spare it, but let flush() try.
                    self._wake.wait(RETRY_S)
                    continue
            if is_last_round:
                self._disconnect()
                return

    def _commit(self, batch: list[_Entry]) -> bool:
        try:
            statements = [self._statement(entry) for entry in batch]
            if self._connection is None:
                self._connection = self._connect(self._path)
            with self._connection:
                self._connection.execute("BEGIN IMMEDIATE")
                for sql, values in statements:
                    self._connection.execute(sql, values)
        except (sqlite3.Error, OSError) as error:
            self._faults.report("log", f"the session's log cannot be written: {error}")
            self._disconnect()
            return False
        self._faults.clear("log")
        with self._lock:
            for _ in batch:
                self._waiting.popleft()
        with self._progress:
            self._committed += len(batch)
            self._progress.notify_all()
        return True

    def _statement(self, entry: _Entry) -> _Statement:
        if isinstance(entry, KeptFile):
            return _INSERT_FILE, (
                entry.frame_id,
                entry.role,
                entry.path,
                entry.bytes,
                entry.ms,
                entry.reason,
            )
        seq, t_utc_ns, record = entry
        try:
            kind, frame_id, body = encode(record)
        except SessionError as error:
            # Its place in the order stays taken, so that the gap is seen.
            text = f"a {type(record).__name__} could not be recorded: {error}"
            self._faults.report("record", text)
            kind, frame_id, body = encode(Event(level="alarm", text=text))
        return _INSERT_RECORD, (seq, t_utc_ns, kind, frame_id, body)

    def _disconnect(self) -> None:
        if self._connection is not None:
            try:
                self._connection.close()
            except sqlite3.Error as error:
                self._faults.report("log", f"the session's log cannot be closed: {error}")
            self._connection = None


def leave_wal(path: Path, connect: Callable[[Path], sqlite3.Connection], timeout_s: float) -> None:
    """Fold the write-ahead log into the database, so that it is one file any reader can open.

    Raises sqlite3.Error when readers hold it for longer than ``timeout_s``.
    """
    deadline = time.monotonic() + timeout_s
    connection = connect(path)
    try:
        while True:
            try:
                connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
                mode = connection.execute("PRAGMA journal_mode=DELETE").fetchone()[0]
                if mode == "delete":
                    return
                raise sqlite3.OperationalError(f"the journal stays in mode {mode}")
            except sqlite3.OperationalError:
                if time.monotonic() > deadline:
                    raise
                time.sleep(0.05)
    finally:
        connection.close()
