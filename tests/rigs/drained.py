"""Waiting for slow work that a session does on a thread of its own."""

import time

from rsoconsole.session.log import BoundedWorker


def drained(worker: BoundedWorker, timeout_s: float) -> bool:
    """Whether nothing is left to do within that time."""
    deadline = time.monotonic() + timeout_s
    while time.monotonic() < deadline:
        with worker._changed:
            if not worker._jobs and not worker._is_running_job:
                return True
        time.sleep(0.002)
    return False
