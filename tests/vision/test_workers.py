"""Threads that share one frame's work."""

import subprocess
import sys
import threading
from collections.abc import Iterator

import pytest

from rsoconsole.vision import Workers


@pytest.mark.parametrize("threads", [1, 2, 4])
@pytest.mark.parametrize("count", [0, 1, 3, 200])
def test_every_number_is_worked_on_once(threads: int, count: int) -> None:
    seen: list[int] = []

    def work(numbers: Iterator[int]) -> None:
        seen.extend(numbers)

    Workers(threads).share(work, count)
    assert sorted(seen) == list(range(count))


def test_so_many_threads_work_at_once() -> None:
    meeting = threading.Barrier(3, timeout=20.0)

    def work(numbers: Iterator[int]) -> None:
        for _ in numbers:
            meeting.wait()

    Workers(3).share(work, 3)


@pytest.mark.parametrize("threads", [1, 2])
def test_an_error_in_any_thread_reaches_the_caller(threads: int) -> None:
    def work(numbers: Iterator[int]) -> None:
        for number in numbers:
            if number == 7:
                raise ValueError("seven")

    with pytest.raises(ValueError, match="seven"):
        Workers(threads).share(work, 20)


@pytest.mark.parametrize("threads", [1, 2])
def test_what_is_begun_answers_or_fails_when_it_is_asked(threads: int) -> None:
    def fails() -> None:
        raise ValueError("no")

    workers = Workers(threads)
    assert workers.begin(lambda: 5).result() == 5
    with pytest.raises(ValueError, match="no"):
        workers.begin(fails).result()


def test_libraries_start_no_threads_of_their_own_in_the_program() -> None:
    lines = [
        "import contextlib, os, sys",
        "from rsoconsole.cli import main",
        "assert 'numpy' not in sys.modules, 'too late: NumPy has read its environment'",
        "with contextlib.suppress(SystemExit): main()",
        "import cv2",
        "print(os.environ['OPENBLAS_NUM_THREADS'], cv2.getNumThreads())",
    ]
    told = subprocess.run(
        [sys.executable, "-c", "\n".join(lines), "--version"],
        env={"PATH": "", "OPENBLAS_NUM_THREADS": "3"},
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    # What the operator has set counts.
    assert told.stdout.splitlines()[1:] == ["3 1"]
