"""Work over many sessions, distributed: one after another, on this machine's cores, or on Dask.

Results come in the order of the tasks and are the same in every pool. A task is a whole session: it
cannot be divided, because the reducer remembers earlier frames of it. Every worker computes with
one thread.
"""

import contextlib
import importlib.util
import itertools
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias, TypeVar

from rsoconsole.base import BatchError, FrameError
from rsoconsole.config import Config
from rsoconsole.instruments import read_frame
from rsoconsole.pipeline.cycle.cycle import Cycle, frame_taken_record
from rsoconsole.pipeline.frame.measurement import mid_exposure_utc_ns
from rsoconsole.pipeline.frame.reduce import FrameReducer, Reduction
from rsoconsole.pipeline.orbits.orbits import Orbits
from rsoconsole.records import Frame, Record
from rsoconsole.tracking import Following
from rsoconsole.vision import available_cores

Task = TypeVar("Task")
Result = TypeVar("Result")
Kind: TypeAlias = Literal["serial", "processes", "dask"]
THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENCV_FOR_THREADS_NUM")


@dataclass(frozen=True, slots=True, kw_only=True)
class WorkerPool:
    """Kind and number of the workers that run tasks."""

    kind: Kind
    workers: int
    scheduler: str | None = None
    """Address of a Dask scheduler; None: with kind ``dask``, a cluster on this machine."""


def choose_pool(
    tasks: int,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    is_serial: bool = False,
    is_dask_wanted: bool = True,
) -> WorkerPool:
    """Choose the pool for a number of tasks: Dask if installed, else processes; serial for one.

    Raises BatchError where a scheduler is named and Dask is not installed.
    """
    has_dask = importlib.util.find_spec("distributed") is not None
    if scheduler is not None:
        if not has_dask:
            raise BatchError("--scheduler needs Dask: pip install 'rsoconsole[dask]'")
        return WorkerPool(kind="dask", workers=workers or tasks, scheduler=scheduler)
    count = min(workers or available_cores(), tasks)
    if is_serial or tasks <= 1 or (workers is None and count <= 1):
        return WorkerPool(kind="serial", workers=1)
    return WorkerPool(kind="dask" if has_dask and is_dask_wanted else "processes", workers=count)


def run_tasks(
    work: Callable[[Task], Result],
    tasks: Sequence[Task],
    pool: WorkerPool,
    *,
    failed: Callable[[Task, str], Result],
    paths: Sequence[Path] = (),
    on_done: Callable[[], None] = lambda: None,
) -> Iterator[Result]:
    """Run the tasks and yield their results in order, each once those before it are complete.

    - ``work``, ``tasks``: go to other processes, so ``work`` must be a function of a module and
      each task a record.
    - ``failed``: returns the result of a task whose worker died, from the task and the reason.
    - ``paths``: must be within reach of every worker; checked where workers may run on other
      machines.
    - ``on_done``: called once a task.

    Raises BatchError where there is no worker.
    """
    if pool.kind == "serial":
        yield from _in_order(enumerate(map(work, tasks)), on_done)
    elif pool.kind == "processes":
        yield from _in_order(_by_processes(work, tasks, pool.workers, failed), on_done)
    else:
        from rsoconsole.pipeline.batch._batch_dask import run_on_dask

        with one_thread_per_process():
            results = run_on_dask(
                work,
                tasks,
                workers=pool.workers,
                scheduler=pool.scheduler,
                failed=failed,
                paths=paths,
            )
            yield from _in_order(results, on_done)


def _in_order(
    results: Iterator[tuple[int, Result]], on_done: Callable[[], None]
) -> Iterator[Result]:
    """Yield the results in the order of their tasks, from (number of the task, result)."""
    early: dict[int, Result] = {}
    given = 0
    for number, result in results:
        early[number] = result
        on_done()
        while given in early:
            yield early.pop(given)
            given += 1


def _by_processes(
    work: Callable[[Task], Result],
    tasks: Sequence[Task],
    workers: int,
    failed: Callable[[Task, str], Result],
) -> Iterator[tuple[int, Result]]:
    left = set(range(len(tasks)))
    for number, result in _as_processes_end(work, tasks, workers):
        left.remove(number)
        yield number, result
    # A worker that died (killed, out of memory) takes its pool along: what is left gets a pool
    # of its own each, so that the task it died of is known and the others are done.
    for number in sorted(left):
        alone = [result for _, result in _as_processes_end(work, tasks[number : number + 1], 1)]
        reason = "its worker died: out of memory, or killed from outside"
        yield number, alone[0] if alone else failed(tasks[number], reason)


def _as_processes_end(
    work: Callable[[Task], Result], tasks: Sequence[Task], workers: int
) -> Iterator[tuple[int, Result]]:
    """Yield (number, result) as they come; ends early where a worker dies."""
    ours = set(multiprocessing.active_children())
    with one_thread_per_process():
        executor = ProcessPoolExecutor(
            max_workers=workers,
            mp_context=multiprocessing.get_context("spawn"),
            initializer=_become_worker,
        )
        try:
            numbers = {executor.submit(work, task): n for n, task in enumerate(tasks)}
            for future in as_completed(numbers):
                yield numbers[future], future.result()
        except BrokenProcessPool:
            return
        except BaseException:
            # Interrupted: nothing that is under way is of use any more.
            executor.shutdown(wait=False, cancel_futures=True)
            for child in set(multiprocessing.active_children()) - ours:
                child.terminate()
            raise
        finally:
            executor.shutdown(wait=True, cancel_futures=True)


def _become_worker() -> None:
    """End with the parent process, however that ends, and leave Ctrl-C to it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is None:
        return

    def follow() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=follow, name="parent", daemon=True).start()


@contextlib.contextmanager
def one_thread_per_process() -> Iterator[None]:
    """Make every process started within this context compute with one thread."""
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


@dataclass(frozen=True, slots=True, kw_only=True)
class ProcessedFrame:
    """One processed frame: its reduction, the state after it and its records."""

    path: Path
    frame: Frame
    t_mid_utc_ns: int | None
    reduction: Reduction
    after: Following
    records: tuple[Record, ...]


def process_files(
    paths: Sequence[Path],
    reducer: FrameReducer,
    config: Config,
    *,
    numbers: Iterable[int] | None = None,
    extension: str | None = None,
) -> Iterator[ProcessedFrame | tuple[Path, FrameError]]:
    """Process every frame in the order given; yield an unusable frame as (path, its error).

    A frame without a time is detected and solved, and leaves the track as it is. ``numbers``: frame
    numbers; None: 1, 2, 3... ``extension``: as in ``read_frame``.
    """
    cycle, orbits = Cycle(reducer, config), Orbits(config)
    following = Following()
    for number, path in zip(numbers or itertools.count(1), paths, strict=False):
        try:
            frame = read_frame(path, number, extension=extension)
            outcomes: tuple[Record, ...] = ()
            if frame.t_mid_utc_ns is None or frame.exposure_s is None:
                reduction = reducer.reduce(frame)
            else:
                result = cycle.run(frame, following, orbits=orbits.last)
                reduction, following, outcomes = result.reduction, result.after, result.records
                for record in (frame_taken_record(frame), *outcomes):
                    orbits.receive(record)
                light = cycle.photometry(reduction, outcomes)
                outcomes = (*outcomes, *orbits.derive_frame_records(), light)
        except FrameError as error:
            yield path, error
            continue
        yield ProcessedFrame(
            path=path,
            frame=frame,
            t_mid_utc_ns=mid_exposure_utc_ns(frame, config.exposure),
            reduction=reduction,
            after=following,
            records=(frame_taken_record(frame), *outcomes),
        )
