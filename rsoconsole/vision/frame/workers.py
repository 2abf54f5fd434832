"""Threads among which the work on one frame is divided."""

from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from typing import TypeVar

_Result = TypeVar("_Result")


class Workers:
    """Threads, the caller's own among them; OpenCV and NumPy let them run side by side."""

    def __init__(self, threads: int = 1) -> None:
        self._pool = ThreadPoolExecutor(threads - 1, "vision") if threads > 1 else None
        self._others = threads - 1

    def share(self, work: Callable[[Iterator[int]], None], count: int) -> None:
        """Call ``work`` once a thread; all draw their numbers from one ``range(count)``.

        A thread that comes late to its turn draws fewer; nobody waits for one that comes too late.
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
        """Run ``work`` beside the caller; with one thread it has run when this returns."""
        if self._pool is not None:
            return self._pool.submit(work)
        done: Future[_Result] = Future()
        done.set_result(work())
        return done


CALLER_ALONE = Workers()
