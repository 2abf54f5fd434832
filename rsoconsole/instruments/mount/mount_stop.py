"""One STOP on two ways to the mount; whichever says first that it stands has confirmed it.

Ordered and confirmed are two things: ABORT is on its way to the mount, and the mount has said that
it stands. What becomes of tracking is settled after that, by the same way.
"""

import logging
import threading
import time
from collections.abc import Callable
from dataclasses import replace

from rsoconsole.instruments import StopPath, StopResult

log = logging.getLogger(__name__)

WAYS: dict[StopPath, str] = {"mount": "the mount's process", "indi": "a second INDI connection"}


class MountStop:
    """What is known of it; its ways report from threads of their own."""

    def __init__(self, on_news: Callable[[StopResult], None]) -> None:
        """``on_news`` hears when it is first ordered, and when the mount first says that it stands.

        Called with what is known by then, from the threads of the ways.
        """
        self._on_news = on_news
        self._began_s = time.monotonic()
        self._changed = threading.Condition()
        self._ordered_ms: float | None = None
        self._stands: StopResult | None = None
        self._ends: list[StopResult] = []
        self._ways = 0
        self._is_over = False

    @property
    def is_over(self) -> bool:
        """Whether nobody waits any more: a way that comes late leaves the mount alone."""
        return self._is_over

    def ordered(self, path: StopPath, at_s: float | None = None) -> None:
        """ABORT has left for the mount; ``at_s``: monotonic time, None: now."""
        with self._changed:
            if self._ordered_ms is not None or self._is_over:
                return
            self._ordered_ms = self._ms(at_s)
            news = self._result(stopped=False, path=path)
        self._on_news(news)

    def stands(self, path: StopPath, at_s: float | None = None) -> None:
        """The mount has said that it stands."""
        with self._changed:
            if self._stands is not None or self._is_over:
                return
            news = self._stands = self._result(stopped=True, path=path, ms=self._ms(at_s))
            self._changed.notify_all()
        self._on_news(news)

    def begin(self, path: StopPath, act: Callable[[], StopResult]) -> threading.Thread:
        """Go one way; ``act`` may raise, which is a way that has failed."""

        def go() -> None:
            try:
                result = act()
            except Exception as error:  # whatever is wrong with one way, there is the other
                log.warning("STOP does not get through by %s: %s", WAYS[path], error)
                result = StopResult(stopped=False, ms=self._ms(), path=path, detail=str(error))
            if result.stopped:
                self.stands(path)
            with self._changed:
                self._ends.append(result)
                self._changed.notify_all()

        with self._changed:
            self._ways += 1
        thread = threading.Thread(target=go, daemon=True, name=f"stop by {path}")
        thread.start()
        return thread

    def wait_stands(self, timeout_s: float) -> bool:
        """Whether the mount stands, or every way has failed, before the time is out."""
        with self._changed:
            self._changed.wait_for(
                lambda: self._stands is not None or len(self._ends) == self._ways, timeout_s
            )
            return self._stands is not None

    def wait_end(self, deadline_s: float) -> StopResult:
        """What came of it: of the way that ended well first, or of the last one that failed."""
        with self._changed:
            self._changed.wait_for(self._is_decided, max(0.0, deadline_s - time.monotonic()))
            self._is_over = True
            good = next((each for each in self._ends if each.stopped), None)
            if self._stands is not None:
                return replace(self._stands, is_tracking=None if good is None else good.is_tracking)
            last = self._ends[-1] if self._ends else None
            return self._result(
                stopped=False,
                path="indi" if last is None else last.path,
                detail="the mount does not answer" if last is None else last.detail,
            )

    def _is_decided(self) -> bool:
        return any(each.stopped for each in self._ends) or len(self._ends) == self._ways

    def _ms(self, at_s: float | None = None) -> float:
        return ((time.monotonic() if at_s is None else at_s) - self._began_s) * 1e3

    def _result(
        self, *, stopped: bool, path: StopPath, ms: float | None = None, detail: str = ""
    ) -> StopResult:
        return StopResult(
            stopped=stopped,
            ms=self._ms() if ms is None else ms,
            ordered_ms=self._ordered_ms,
            path=path,
            detail=detail,
        )
