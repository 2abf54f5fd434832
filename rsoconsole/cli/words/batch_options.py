"""Options and progress of the verbs that work over many sessions."""

import contextlib
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from rich.progress import Progress, ProgressColumn, TaskID

WorkersOption = Annotated[
    int | None, typer.Option(min=1, help="How many sessions at once; default: the cores there are.")
]
SerialOption = Annotated[bool, typer.Option("--serial", help="One after another, in this process.")]
SchedulerOption = Annotated[
    str | None,
    typer.Option(
        metavar="ADDRESS",
        help="Share the work out over this Dask scheduler's workers, e.g. tcp://10.0.0.2:8786."
        " All paths must mean the same on every machine (a shared disk).",
    ),
]
NoDaskOption = Annotated[
    bool, typer.Option("--no-dask", help="Plain processes, also where Dask is installed.")
]


class ProgressBar:
    """Progress bar on stderr; shows nothing where stderr is no terminal."""

    def __init__(self, bars: "Progress | None" = None, task: "TaskID | None" = None) -> None:
        self._bars = bars
        self._task = task

    def __call__(self, steps: int = 1) -> None:
        """Advance the bar by a number of steps."""
        if self._bars is not None and self._task is not None:
            self._bars.advance(self._task, steps)

    @contextlib.contextmanager
    def hide_while_printing(self) -> Iterator[None]:
        """Context in which the bar is hidden, so that other lines can go to the same terminal."""
        if self._bars is None:
            yield
            return
        self._bars.stop()  # being transient, it leaves no trace
        try:
            yield
        finally:
            self._bars.start()


def stderr_progress_bars(*columns: "ProgressColumn") -> "Progress":
    """Return progress bars with these columns on stderr, removed when they end.

    Without a terminal they are hidden.
    """
    from rich.console import Console
    from rich.progress import Progress

    # stdout is the program's answer and may be a pipe: it never passes through a bar.
    return Progress(
        *columns,
        console=Console(stderr=True),
        transient=True,
        disable=not sys.stderr.isatty(),
        redirect_stdout=False,
        redirect_stderr=False,
    )


@contextlib.contextmanager
def progress_bar(words: str, total: int | None = None) -> Iterator[ProgressBar]:
    """Context of a progress bar on stderr, labelled ``words``; no bar without a terminal.

    ``total``: number of steps; None: it only counts the steps.
    """
    if not sys.stderr.isatty():
        yield ProgressBar()
        return
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        ProgressColumn,
        SpinnerColumn,
        TextColumn,
        TimeElapsedColumn,
    )

    name, elapsed = TextColumn("{task.description}"), TimeElapsedColumn()
    columns: tuple[ProgressColumn, ...] = (name, BarColumn(), MofNCompleteColumn(), elapsed)
    if total is None:
        columns = (SpinnerColumn(), name, TextColumn("{task.completed:.0f}"), elapsed)
    with stderr_progress_bars(*columns) as bars:
        yield ProgressBar(bars, bars.add_task(words, total=total))


@contextlib.contextmanager
def byte_progress() -> Iterator[Callable[[str, int, int], None]]:
    """Context that shows progress in bytes, file after file, on stderr if it is a terminal.

    Yields a function of a name, the bytes done and their total, which may be called from any
    thread.
    """
    from rich.progress import BarColumn, DownloadColumn, TextColumn, TimeRemainingColumn

    name = TextColumn("{task.description:12}")
    with stderr_progress_bars(name, BarColumn(), DownloadColumn(), TimeRemainingColumn()) as bars:
        task = bars.add_task("", total=None)

        def report(doing: str, done: int, total: int) -> None:
            bars.update(task, description=doing, completed=done, total=total)

        yield report


def resolved_paths(paths: list[Path]) -> list[Path]:
    """The paths as absolute ones, valid for workers with another current folder."""
    return [path.resolve() for path in paths]
