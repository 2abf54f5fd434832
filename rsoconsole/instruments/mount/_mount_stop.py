"""One STOP on two paths to the mount: sent, answered by the driver, motion measured.

The first answer counts, whichever path it comes by; the path that received it sets tracking.
Changes of the motion are reported for half a minute, or until the next order.
"""

import logging
import threading
import time
from collections.abc import Callable
from dataclasses import replace

from rsoconsole.instruments.motion import Motion
from rsoconsole.instruments.ports import StopPath, StopResult
from rsoconsole.words import NO_ANSWER

log = logging.getLogger(__name__)

WAYS: dict[StopPath, str] = {"mount": "the mount's process", "indi": "a second INDI connection"}


class MountStop:
    """State of one STOP; its two paths report to it from their own threads."""

    def __init__(self, on_news: Callable[[StopResult], None]) -> None:
        """``on_news`` is called with the result so far, from the threads of the paths.

        When ABORT is first sent, when it is first answered, and with the measured motion.
        """
        self._on_news = on_news
        self._began_s = time.monotonic()
        self._changed = threading.Condition()
        self._ordered_ms: float | None = None
        self._answered: StopResult | None = None
        self._ends: list[StopResult] = []
        self._failed: StopResult | None = None
        """Most informative result of the paths that have failed."""
        self._ways = 0
        self._is_settled = False
        self._last: StopResult | None = None
        self.is_over = False
        """True when nothing waits for this STOP: no more is sent to the mount for it."""

    def leaves_to(self, path: StopPath) -> bool:
        """Return True where the path other than ``path`` may end.

        It may where the STOP is over, and where the STOP has its result and ``path`` has finished:
        ``path`` then measures the motion.
        """
        return self.is_over or (self._is_settled and any(each.path == path for each in self._ends))

    def ordered(self, path: StopPath, at_s: float | None = None) -> None:
        """Note that ``path`` has sent ABORT; ``at_s``: monotonic time, None: now."""
        with self._changed:
            if self._ordered_ms is not None or self._is_settled:
                return
            self._ordered_ms = self._ms(at_s)
            news = self._result(is_answered=False, path=path)
        self._on_news(news)

    def answered(self, path: StopPath, at_s: float | None = None) -> None:
        """Note that the driver has accepted ABORT and reports no motion.

        ``at_s``: monotonic time, None: now.
        """
        with self._changed:
            if self._answered is not None or self._is_settled:
                return
            news = self._answered = self._result(is_answered=True, path=path, ms=self._ms(at_s))
            self._changed.notify_all()
        self._on_news(news)

    def measured(self, path: StopPath, motion: Motion, at_s: float | None = None) -> None:
        """Add a motion measured by ``path``; it is reported where its kind has changed."""
        with self._changed:
            last = None if self._last is None or self._last.motion is None else self._last.motion
            if self.is_over or (last is not None and last.kind == motion.kind):
                return
            known = self._answered or self._result(is_answered=False, path=path)
            news = self._last = replace(known, motion=motion, measured_ms=self._ms(at_s))
            self.is_over = motion.is_at_rest
        self._on_news(news)

    def end(self, detail: str = "", *, is_superseded: bool = False) -> None:
        """End the measurement, and report an unknown motion where none was measured.

        It is also reported where another order ended a measurement under way (``is_superseded``).
        ``detail``: reason in that report.
        """
        if not self.is_over and (self._last is None or is_superseded):
            known = self._answered or self._result(is_answered=False, path="mount")
            self.is_over = True
            self._on_news(
                replace(
                    known,
                    motion=Motion(),
                    measured_ms=self._ms(),
                    detail=detail,
                    is_superseded=is_superseded,
                )
            )
        self.is_over = True

    def begin(self, path: StopPath, act: Callable[[], StopResult]) -> threading.Thread:
        """Start ``path`` on a new thread that runs ``act``; the path fails where ``act`` raises."""

        def go() -> None:
            try:
                result = act()
                is_broken = False
            except Exception as error:  # whatever is wrong with one way, there is the other
                log.warning("STOP does not get through by %s: %s", WAYS[path], error)
                result = self._result(is_answered=False, path=path, detail=str(error))
                is_broken = True
            if result.is_answered:
                self.answered(path)
            with self._changed:
                self._ends.append(result)
                # The mount's process knows best why its driver has not obeyed.
                if self._failed is None or (path == "mount" and not is_broken):
                    self._failed = result
                self._changed.notify_all()

        with self._changed:
            self._ways += 1
        thread = threading.Thread(target=go, daemon=True, name=f"stop by {path}")
        thread.start()
        return thread

    def wait_answered(self, timeout_s: float) -> bool:
        """Wait until the driver has answered, every path has failed, or the time is over.

        Returns whether the driver has answered.
        """
        with self._changed:
            self._changed.wait_for(
                lambda: self._answered is not None or len(self._ends) == self._ways, timeout_s
            )
            return self._answered is not None

    def wait_end(self, deadline_s: float) -> StopResult:
        """Wait until a path has ended with an answer, or all have ended; return the result.

        ``deadline_s``: monotonic time at which the wait ends in any case.
        """
        with self._changed:
            self._changed.wait_for(self._is_decided, max(0.0, deadline_s - time.monotonic()))
            self._is_settled = True
            good = next((each for each in self._ends if each.is_answered), None)
            if self._answered is not None:
                is_tracking = None if good is None else good.is_tracking
                return replace(self._answered, is_tracking=is_tracking)
            failed = self._failed
            return self._result(
                is_answered=False,
                path="indi" if failed is None else failed.path,
                detail=NO_ANSWER if failed is None else failed.detail,
            )

    def _is_decided(self) -> bool:
        return any(each.is_answered for each in self._ends) or len(self._ends) == self._ways

    def _ms(self, at_s: float | None = None) -> float:
        return ((time.monotonic() if at_s is None else at_s) - self._began_s) * 1e3

    def _result(
        self, *, is_answered: bool, path: StopPath, ms: float | None = None, detail: str = ""
    ) -> StopResult:
        return StopResult(
            is_answered=is_answered,
            ms=self._ms() if ms is None else ms,
            ordered_ms=self._ordered_ms,
            path=path,
            detail=detail,
        )
