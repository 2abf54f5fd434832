"""Work over many sessions on Dask; nothing here is loaded where Dask is not asked for."""

import contextlib
import logging
import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, TypeVar

from rsoconsole import __version__
from rsoconsole.errors import BatchError

Task = TypeVar("Task")
Result = TypeVar("Result")
REACHED_S = 30.0
"""How long a scheduler and its workers are waited for."""


def by_dask(
    work: Callable[[Task], Result],
    tasks: Sequence[Task],
    *,
    workers: int,
    scheduler: str | None,
    failed: Callable[[Task, str], Result],
    paths: Sequence[Path],
    on_done: Callable[[], None],
) -> Iterator[Result]:
    """As ``batch_pool.share_out``; ``scheduler`` None: a cluster of this machine's own."""
    from distributed import as_completed as as_dask_completed

    with _client(workers, scheduler) as client:
        if scheduler is not None:
            _check_workers(client, paths)
        # A task that takes its worker's process along is not tried over and over.
        futures = [client.submit(work, task, pure=False, retries=0) for task in tasks]
        numbers = {future.key: number for number, future in enumerate(futures)}
        done: dict[int, Result] = {}
        given = 0
        for future in as_dask_completed(futures):
            number = numbers[future.key]
            if future.status == "finished":
                done[number] = future.result()
            else:
                done[number] = failed(tasks[number], f"its worker failed: {future.exception()}")
            on_done()
            while given in done:
                yield done.pop(given)
                given += 1


@contextlib.contextmanager
def _client(workers: int, scheduler: str | None) -> Iterator[Any]:
    """A Dask client, of the scheduler that is named or of a cluster on this machine alone."""
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
                dashboard_address=None,
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
    """Raises BatchError where a worker has another version or cannot reach what it needs."""
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
