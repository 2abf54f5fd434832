"""Where a night's log goes when its own place fails: another session, on another disk if need be.

A disk that is full or gone keeps the newest records out for a while; a log that somebody removed,
cut or wrote over is lost for good. Either way what comes is written elsewhere at once, so that what
is acknowledged is on a disk.
"""

import contextlib
import shutil
import sqlite3
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from rsoconsole.config import state_dir
from rsoconsole.durable_files import write_durably
from rsoconsole.session.log import (
    CONFIG,
    DATABASE,
    FILE_ROWS,
    FOLDERS,
    INSERT_FILE,
    INSERT_RECORD,
    LOG_ROWS,
    connect_to_write,
    create_database,
    transaction,
)

Statement = tuple[str, tuple[object, ...]]
LEAST_BYTES = 200_000_000
"""Free on a disk that a rescue is begun on: many nights' logs."""
_AT_A_TIME = 1000
_TABLES = ((LOG_ROWS, INSERT_RECORD), (FILE_ROWS, INSERT_FILE))


def rescue_places() -> Iterator[Path]:
    """Folders to try, in order; a system whose every disk is full may not even have these."""
    yield state_dir() / "rescue"
    with contextlib.suppress(OSError):  # it tries to write there
        yield Path(tempfile.gettempdir()) / "rsoconsole-rescue"
    with contextlib.suppress(RuntimeError):
        yield Path.home() / "rsoconsole-rescue"


class Rescue:
    """The session that takes over; nothing of it is made before it is needed."""

    def __init__(
        self,
        session: Path,
        facts: Mapping[str, Any],
        config: bytes,
        places: Callable[[], Iterable[Path]] = rescue_places,
    ) -> None:
        """``session``: whose place may fail; ``facts`` and ``config`` are a copy's, too."""
        self._session = session
        self._facts = {**facts, "rescues": str(session.absolute())}
        self._config = config
        self._places = places
        self._connection: sqlite3.Connection | None = None
        self.folder: Path | None = None
        """Where it is; None before it is begun."""

    def begin(self) -> bool:
        """Make it; False where no place can be had."""
        if self._connection is not None:
            return True
        for place in self._places():
            folder = place / self._session.name
            try:
                place.mkdir(mode=0o700, parents=True, exist_ok=True)
                if shutil.disk_usage(place).free < LEAST_BYTES or folder.exists():
                    _leave(place)
                    continue
                self._make(folder)
            except (OSError, sqlite3.Error, ValueError):
                shutil.rmtree(folder, ignore_errors=True)
                _leave(place)
                continue
            self.folder = folder
            return True
        return False

    def _make(self, folder: Path) -> None:
        folder.mkdir()
        for name in FOLDERS.values():
            (folder / name).mkdir()
        write_durably(folder / CONFIG, self._config)
        create_database(folder / DATABASE, self._facts)
        self._connection = connect_to_write(folder / DATABASE)

    def copy(self, source: sqlite3.Connection | None, newest: Sequence[Statement]) -> bool:
        """Take all that ``source`` can still read, although its file may have no name any more.

        Then ``newest``, which it may have lost. False where this disk does not take them.
        """
        if self._connection is None:
            return False
        if source is not None:
            with contextlib.suppress(sqlite3.Error, MemoryError):
                for table in _TABLES:
                    self._copy_table(source, table)
        return self.write(newest)

    def _copy_table(self, source: sqlite3.Connection, table: tuple[str, str]) -> None:
        assert self._connection is not None
        rows = source.execute(table[0])
        while some := rows.fetchmany(_AT_A_TIME):
            with transaction(self._connection):
                self._connection.executemany(table[1], some)

    def write(self, statements: Sequence[Statement]) -> bool:
        """Commit them; False where this disk does not take them either."""
        if self._connection is None:
            return False
        try:
            with transaction(self._connection):
                for sql, values in statements:
                    self._connection.execute(sql, values)
        except sqlite3.Error:
            return False
        return True

    def discard(self) -> None:
        """It is not needed any more: the session itself has everything."""
        self.close()
        if self.folder is not None:
            shutil.rmtree(self.folder, ignore_errors=True)
            _leave(self.folder.parent)
            self.folder = None

    def close(self) -> None:
        """Let go of it."""
        if self._connection is not None:
            with contextlib.suppress(sqlite3.Error):
                self._connection.close()
            self._connection = None


def _leave(place: Path) -> None:
    """No empty folder stays behind in somebody's home."""
    with contextlib.suppress(OSError):  # it holds other rescues, or was never made
        place.rmdir()
