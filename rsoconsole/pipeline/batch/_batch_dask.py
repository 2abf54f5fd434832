"""Work on many sessions with Dask; loaded only where Dask is used."""

import contextlib
import logging
import os
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, TypeVar

from rsoconsole import __version__
from rsoconsole.base import BatchError

Task = TypeVar("Task")
Result = TypeVar("Result")
REACHED_S = 30.0
LOOK_S = 5.0


def run_on_dask(
    work: Callable[[Task], Result],
    tasks: Sequence[Task],
    *,
    workers: int,
    scheduler: str | None,
    failed: Callable[[Task, str], Result],
    paths: Sequence[Path],
) -> Iterator[tuple[int, Result]]:
    """Run tasks on Dask; yield (index of the task, its result) as they are completed.

    ``scheduler``: address of a Dask scheduler; None: a cluster is started on this machine. The
    other arguments are those of ``batch_pool.run_tasks``. Raises BatchError where there is no
    worker, and where the scheduler or its last worker ends before all tasks are done.
    """
    from concurrent.futures import CancelledError

    from distributed import KilledWorker

    named = scheduler or "this machine's own"
    with _client(workers, scheduler) as client:
        if scheduler is not None:
            _check_workers(client, paths)
        # A task that takes its worker's process along is not tried over and over.
        futures = [client.submit(work, task, pure=False, retries=0) for task in tasks]
        numbers = {future.key: number for number, future in enumerate(futures)}
        for done, future in enumerate(_as_they_end(client, futures, named)):
            number = numbers[future.key]
            try:
                result = future.result() if future.status == "finished" else None
                error = None if result is not None else future.exception()
            except (OSError, CancelledError) as gone:  # while what it gave was fetched
                raise BatchError(_gone_words(named, len(tasks), done)) from gone
            if result is None:
                died = "its worker died: out of memory, or killed from outside"
                is_killed = isinstance(error, KilledWorker)
                reason = died if is_killed else f"its worker failed: {error}"
                result = failed(tasks[number], reason)
            yield number, result


def _as_they_end(client: Any, futures: Sequence[Any], scheduler: str) -> Iterator[Any]:
    """Yield each future as it ends. Raises BatchError where no worker or scheduler is left."""
    from concurrent.futures import CancelledError

    from distributed import wait

    pending = set(futures)
    seen_s = time.monotonic()
    while pending:
        try:
            ended = wait(pending, timeout=LOOK_S, return_when="FIRST_COMPLETED").done
        except TimeoutError:
            if client.scheduler_info().get("workers"):
                seen_s = time.monotonic()
            elif time.monotonic() - seen_s > REACHED_S:
                raise BatchError(
                    f"the Dask scheduler {scheduler} has no worker any more: "
                    + _left_words(len(futures), len(futures) - len(pending))
                ) from None
            continue
        except CancelledError as error:  # so the client says that its scheduler is gone
            ended = {each for each in pending if each.status == "finished"}
            yield from ended
            done = len(futures) - len(pending - ended)
            raise BatchError(_gone_words(scheduler, len(futures), done)) from error
        pending -= ended
        seen_s = time.monotonic()
        yield from ended


def _gone_words(scheduler: str, count: int, done: int) -> str:
    return f"the Dask scheduler {scheduler} does not answer any more: {_left_words(count, done)}"


def _left_words(count: int, done: int) -> str:
    return (
        f"{done} of {count} are done; start it again and give the same command again,"
        " which does what is left"
    )


@contextlib.contextmanager
def _client(workers: int, scheduler: str | None) -> Iterator[Any]:
    """Open a Dask client of the named scheduler, or of a cluster on this machine alone."""
    import dask
    from distributed import Client, LocalCluster

    settings = {
        "distributed.worker.daemon": False,  # the plate solver is a child of the worker
        "distributed.scheduler.allowed-failures": 0,
        "distributed.comm.timeouts.connect": f"{REACHED_S:.0f}s",
    }
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    with dask.config.set(settings), contextlib.ExitStack() as stack:
        address: Any = scheduler
        if scheduler is None:
            cluster = LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                processes=True,
                host="127.0.0.1",
                dashboard_address="127.0.0.1:0",  # whatever else runs on this machine
                silence_logs=logging.CRITICAL,
                memory_limit=0,
            )
            address = stack.enter_context(cluster)
        try:
            client = stack.enter_context(Client(address, timeout=REACHED_S))
        except (OSError, ValueError, TimeoutError) as error:
            raise BatchError(
                f"no Dask scheduler answers at {scheduler}: {error}; start one with"
                " 'dask scheduler' and workers with 'dask worker ADDRESS --nthreads 1 --no-nanny'"
            ) from error
        yield client


def _check_workers(client: Any, paths: Sequence[Path]) -> None:
    """Raise BatchError where a worker has another version or cannot reach a path it needs."""
    try:
        client.wait_for_workers(1, timeout=REACHED_S)
        answers: dict[str, Any] = client.run(_what_a_worker_lacks, [str(p) for p in paths])
    except Exception as error:  # whatever the workers raise, rsoconsole's absence above all
        raise BatchError(
            f"the scheduler's workers cannot do this work ({type(error).__name__}: {error}):"
            " they need rsoconsole, and one at least must be running"
        ) from error
    for worker, (version, missing) in answers.items():
        if version != __version__:
            raise BatchError(f"{worker} runs rsoconsole {version}, this is {__version__}: use one")
        if missing:
            raise BatchError(
                f"{worker} cannot reach {missing[0]}: give paths that mean the same on every"
                " machine, such as a shared disk's"
            )


def _what_a_worker_lacks(paths: Sequence[str]) -> tuple[str, list[str]]:
    return __version__, [path for path in paths if not os.access(path, os.R_OK)]
