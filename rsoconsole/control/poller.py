"""A thread that does the same work at regular intervals."""

import threading
from abc import ABC, abstractmethod

CLOSING_S = 0.5


class Poller(ABC):
    """Base of threads that poll something at regular intervals, and at once when woken.

    A subclass does its work in ``_look``.
    """

    def __init__(self, name: str, every_s: float) -> None:
        self._every_s = every_s
        self._wake = threading.Event()
        self._is_closing = False
        self._thread = threading.Thread(target=self._run, name=f"look-{name}", daemon=True)

    def start(self) -> None:
        """Start the thread; it looks at once."""
        self._thread.start()

    def poll_now(self) -> None:
        """Look at once instead of at the next interval; may be called from any thread."""
        self._wake.set()

    def close(self) -> None:
        """End the thread; a poll under way is waited for only briefly."""
        self._is_closing = True
        self._wake.set()
        if self._thread.is_alive() and self._thread is not threading.current_thread():
            self._thread.join(CLOSING_S)

    @property
    def is_running(self) -> bool:
        """True while the thread runs."""
        return self._thread.is_alive()

    def _run(self) -> None:
        while not self._is_closing:
            self._look()
            self._wake.wait(self._every_s)
            self._wake.clear()

    @abstractmethod
    def _look(self) -> None:
        """Look once; raises nothing."""
