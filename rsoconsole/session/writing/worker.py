"""Runs slow jobs on a thread of its own, with a limit on the number waiting."""

import logging
import threading
from collections import deque
from collections.abc import Callable
from typing import TypeAlias

log = logging.getLogger(__name__)

Job: TypeAlias = Callable[[], None]
OnError: TypeAlias = Callable[[BaseException], None]


class BoundedWorker:
    """Thread that runs jobs one after another.

    At most ``max_jobs`` are accepted at a time, the running job included.
    """

    def __init__(self, name: str, max_jobs: int) -> None:
        self._max_jobs = max_jobs
        self._jobs: deque[tuple[Job, OnError]] = deque()
        self._is_running_job = False
        self._is_closing = False
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def submit(self, job: Job, on_error: OnError) -> bool:
        """Accept a job; return False, without running it, where too many wait.

        ``on_error`` is called, on the worker's thread, with an error that the job raises; the next
        job runs in any case.
        """
        with self._changed:
            if self._is_closing or len(self._jobs) + self._is_running_job >= self._max_jobs:
                return False
            self._jobs.append((job, on_error))
            self._changed.notify_all()
        return True

    def drain(self, timeout_s: float) -> bool:
        """Wait until all accepted jobs are done; return False when that takes longer."""
        with self._changed:
            return self._changed.wait_for(
                lambda: not self._jobs and not self._is_running_job, timeout_s
            )

    def close(self, timeout_s: float) -> bool:
        """Finish the accepted jobs and end the thread.

        Returns False when that takes longer than ``timeout_s``.
        """
        with self._changed:
            self._is_closing = True
            self._changed.notify_all()
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: bool(self._jobs) or self._is_closing)
                if not self._jobs:
                    return
                job, on_error = self._jobs.popleft()
                self._is_running_job = True
            try:
                _do(job, on_error)
            finally:
                with self._changed:
                    self._is_running_job = False
                    self._changed.notify_all()


def _do(job: Job, on_error: OnError) -> None:
    """Run a job; none of its errors may end the thread, or all later jobs would wait for ever."""
    try:
        job()
    except BaseException as error:
        try:
            on_error(error)
        except Exception:
            log.exception("a failed job could not be reported")


_GIVEN_UP = ("frame", "closeup", "preview")
"""Kinds of lost files that do not harm the night, the gravest first."""


class RecordingFaults:
    """Present faults of the recording, one text for each place; announces each new fault."""

    def __init__(self, on_fault: Callable[[str], None] | None) -> None:
        self._on_fault = on_fault
        self._texts: dict[str, str] = {}
        self._lock = threading.Lock()

    def report(self, place: str, text: str) -> None:
        """Set the fault at ``place``, and call ``on_fault`` if this place had no fault before."""
        with self._lock:
            is_new = place not in self._texts
            self._texts[place] = text
        if is_new and self._on_fault is not None:
            try:
                self._on_fault(text)
            except Exception as error:  # an alarm that fails must not end the record's thread
                with self._lock:
                    self._texts["alarm"] = f"the alarm could not be given: {error}"

    def clear(self, place: str) -> None:
        """Remove the fault at ``place``."""
        with self._lock:
            self._texts.pop(place, None)

    def texts(self) -> tuple[str, ...]:
        """Return the texts of all present faults; lost frames, close-ups and previews come last."""
        with self._lock:
            present = dict(self._texts)
        return tuple(present[place] for place in sorted(present, key=_rank))


def _rank(place: str) -> int:
    return _GIVEN_UP.index(place) if place in _GIVEN_UP else -1
