"""Log lines about long waits: for a process, a device, a server.

What waits makes a ``LongWait`` and looks at it now and then; what starts the program listens
with ``waits_reported_to``. Everything said is in the log, too.
"""

import contextlib
import logging
import time
from collections.abc import Callable, Iterator

SAY_EVERY_S = 5.0

log = logging.getLogger(__name__)


class LongWait:
    """One wait that logs, every few seconds, what for and for how long already."""

    def __init__(self, what: str, now_s: Callable[[], float] = time.monotonic) -> None:
        """``what``: as in "the mount's process"."""
        self.what = what
        """May change while it lasts."""
        self._now_s = now_s
        self._began_s = now_s()
        self._next_s = self._began_s + SAY_EVERY_S

    @property
    def waited_s(self) -> float:
        """Since the beginning."""
        return self._now_s() - self._began_s

    def look(self) -> None:
        """Log what is waited for, every few seconds; called while it is not there yet."""
        now_s = self._now_s()
        if now_s >= self._next_s:
            self._next_s = now_s + SAY_EVERY_S
            log.info("waiting for %s ... %.0f s", self.what, now_s - self._began_s)


@contextlib.contextmanager
def waits_reported_to(listener: Callable[[str], None]) -> Iterator[None]:
    """``listener`` gets every line that is said about waits, on the thread that waits."""
    handler = _Listening(listener)
    level = log.level
    log.addHandler(handler)
    log.setLevel(logging.INFO)
    try:
        yield
    finally:
        log.removeHandler(handler)
        log.setLevel(level)


class _Listening(logging.Handler):
    def __init__(self, listener: Callable[[str], None]) -> None:
        super().__init__()
        self._listener = listener

    def emit(self, record: logging.LogRecord) -> None:
        self._listener(record.getMessage())
