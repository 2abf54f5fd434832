"""Log lines about long waits: for a process, a device, a server.

Code that waits makes a ``LongWait`` and calls ``look`` now and then; code that starts the program
shows the lines with ``report_waits_to``. Every line is in the log, too.
"""

import contextlib
import logging
import time
from collections.abc import Callable, Iterator

SAY_EVERY_S = 5.0

log = logging.getLogger(__name__)


class LongWait:
    """One wait; logs every few seconds what is awaited, and for how long by now."""

    def __init__(self, what: str, now_s: Callable[[], float] = time.monotonic) -> None:
        """``what``: the awaited thing, e.g. "the mount's process"."""
        self.what = what
        """Awaited thing, in words; may change during the wait."""
        self._now_s = now_s
        self._began_s = now_s()
        self._next_s = self._began_s + SAY_EVERY_S

    @property
    def waited_s(self) -> float:
        """Time since the wait began, s."""
        return self._now_s() - self._began_s

    def log_if_due(self) -> None:
        """Log the wait where a line is due; to be called repeatedly while waiting."""
        now_s = self._now_s()
        if now_s >= self._next_s:
            self._next_s = now_s + SAY_EVERY_S
            log.info("waiting for %s ... %.0f s", self.what, now_s - self._began_s)


@contextlib.contextmanager
def report_waits_to(listener: Callable[[str], None]) -> Iterator[None]:
    """Context in which ``listener`` is called with each line, on the thread that waits."""
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
