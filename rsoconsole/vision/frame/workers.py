"""Threads among which the work on one frame is divided."""

import math
import os
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from pathlib import Path
from typing import TypeVar

_Result = TypeVar("_Result")


class Workers:
    """Threads that share the work on a frame; the caller's thread is one of them.

    OpenCV and NumPy release Python's lock, so that the threads run at once.
    """

    def __init__(self, threads: int = 1) -> None:
        self._pool = ThreadPoolExecutor(threads - 1, "vision") if threads > 1 else None
        self._others = threads - 1

    def share(self, work: Callable[[Iterator[int]], None], count: int) -> None:
        """Call ``work`` in each thread with one common iterator over ``range(count)``.

        Each thread takes the next number when it is free, so that a slow one takes fewer. Returns
        when all numbers are done; threads that had not started by then are cancelled.
        """
        numbers = iter(range(count))
        begun: list[Future[None]] = []
        if self._pool is not None:
            begun = [self._pool.submit(work, numbers) for _ in range(min(self._others, count - 1))]
        try:
            work(numbers)
        finally:
            running = [other for other in begun if not other.cancel()]
            wait(running)
        for other in running:
            other.result()

    def begin(self, work: Callable[[], _Result]) -> "Future[_Result]":
        """Run ``work`` in another thread, or before returning where there is only one thread."""
        if self._pool is not None:
            return self._pool.submit(work)
        done: Future[_Result] = Future()
        done.set_result(work())
        return done


CALLER_ALONE = Workers()


MAX_THREADS = 4
"""Largest number of threads: more gain nothing on one frame; a Raspberry Pi has four cores."""
CGROUPS = Path("/sys/fs/cgroup")


def threads_for(wanted: int) -> int:
    """Return the number of threads for a configured number; 0: one a core, at most four."""
    return wanted if wanted > 0 else min(available_cores(), MAX_THREADS)


def available_cores(cgroups: Path = CGROUPS, own: Path = Path("/proc/self/cgroup")) -> int:
    """Number of cores that this process may use, by its affinity and its cgroups' CPU quota."""
    if hasattr(os, "sched_getaffinity"):
        cores = len(os.sched_getaffinity(0))
    else:
        cores = os.cpu_count() or 1
    quota = _quota_cores(cgroups, own)
    return cores if quota is None else max(1, min(cores, math.ceil(quota)))


def _quota_cores(cgroups: Path, own: Path) -> float | None:
    """Cores by the tightest quota from this process's group upward (cgroup v2); None: no quota."""
    try:
        lines = own.read_text(encoding="utf-8").splitlines()
    except (OSError, ValueError):
        return None
    place = next((line[3:] for line in lines if line.startswith("0::/")), None)
    if place is None:
        return None
    found: list[float] = []
    folder = cgroups / place.lstrip("/")
    for group in (folder, *folder.parents):
        if not group.is_relative_to(cgroups):
            break
        try:
            quota_us, period_us = (group / "cpu.max").read_text(encoding="ascii").split()
            found.append(int(quota_us) / int(period_us))
        except (OSError, ValueError, ZeroDivisionError):
            continue  # no such file in the topmost group; "max" is no limit
    return min(found, default=None)
