"""A thread that polls something again and again."""

import threading
from abc import ABC, abstractmethod

CLOSING_S = 0.5


class Poller(ABC):
    """Looks at regular intervals, and at once when it is woken."""

    def __init__(self, name: str, every_s: float) -> None:
        self._every_s = every_s
        self._wake = threading.Event()
        self._is_closing = False
        self._thread = threading.Thread(target=self._run, name=f"look-{name}", daemon=True)

    def start(self) -> None:
        """Begin to look."""
        self._thread.start()

    def look_now(self) -> None:
        """Look at once instead of at the next turn (any thread)."""
        self._wake.set()

    def close(self) -> None:
        """End the thread, without waiting for a slow disk or an engine that hangs."""
        self._is_closing = True
        self._wake.set()
        if self._thread.is_alive() and self._thread is not threading.current_thread():
            self._thread.join(CLOSING_S)

    @property
    def is_running(self) -> bool:
        """True while its thread lives."""
        return self._thread.is_alive()

    def _run(self) -> None:
        while not self._is_closing:
            self._look()
            self._wake.wait(self._every_s)
            self._wake.clear()

    @abstractmethod
    def _look(self) -> None:
        """Look once; raises nothing."""
