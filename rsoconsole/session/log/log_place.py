"""Whether the log's files are still those that are written: SQLite itself does not notice.

On an open file that somebody removes, replaces or cuts it goes on writing, and every commit seems
to succeed.
"""

import contextlib
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from rsoconsole.session.log.schema import WAL

_MAGIC = b"SQLite format 3\x00"


@dataclass(slots=True)
class _Seen:
    identity: tuple[int, int]
    size: int


class LogPlace:
    """The database and its write-ahead log, as they were when last looked at."""

    def __init__(self, database: Path) -> None:
        self._paths = {"log": database, "write-ahead log": database.with_name(WAL)}
        self._seen: dict[str, _Seen] = {}
        self._descriptor: int | None = None
        with contextlib.suppress(OSError):
            self._descriptor = os.open(database, os.O_RDONLY | os.O_CLOEXEC)
        self.damage(lambda: True)

    def close(self) -> None:
        """Only behind the last connection: to close any descriptor of a file lets go of SQLite's
        own lock of it, and another program would believe that nobody writes.
        """
        if self._descriptor is not None:
            os.close(self._descriptor)
            self._descriptor = None

    def forget_wal(self) -> None:
        """The connection is closed: SQLite removes the write-ahead log itself then."""
        self._seen.pop("write-ahead log", None)

    def damage(self, has_all: Callable[[], bool]) -> str | None:
        """What has become of them since the first look, in words; None where all is well.

        ``has_all``: whether a reader finds every record; asked where the write-ahead log is
        shorter, which is so after somebody has had SQLite fold it into the database, too.
        """
        for name, path in self._paths.items():
            try:
                found = path.stat()
            except FileNotFoundError:
                if name in self._seen:
                    return f"the session's {name} has been removed"
                continue
            except OSError as error:
                return f"the session's {name} cannot be seen: {error.strerror}"
            known = self._seen.setdefault(name, _Seen((found.st_dev, found.st_ino), found.st_size))
            if known.identity != (found.st_dev, found.st_ino):
                return f"the session's {name} has been replaced"
            is_folded = found.st_size < known.size and path.name == WAL and has_all()
            if found.st_size < known.size and not is_folded:
                return f"the session's {name} has been cut short"
            known.size = found.st_size
        return self._overwritten()

    def _overwritten(self) -> str | None:
        if self._descriptor is None:
            return None
        try:
            head = os.pread(self._descriptor, len(_MAGIC), 0)
        except OSError as error:
            return f"the session's log cannot be read: {error.strerror}"
        return None if head == _MAGIC else "the session's log has been written over"
