"""Options and progress of the verbs that work over many sessions."""

import contextlib
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated

import typer

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


@contextlib.contextmanager
def progress(words: str, total: int) -> Iterator[Callable[[], None]]:
    """A bar on a terminal's stderr, nothing elsewhere; gives what is called for each step."""
    if not sys.stderr.isatty():
        yield lambda: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bars:
        task = bars.add_task(words, total=total)
        yield lambda: bars.advance(task)


@contextlib.contextmanager
def counting(words: str) -> Iterator[Callable[[], None]]:
    """The same for work whose end is not known: a count of the steps."""
    if not sys.stderr.isatty():
        yield lambda: None
        return
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (
        SpinnerColumn(),
        TextColumn("{task.description} {task.completed:.0f}"),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bars:
        task = bars.add_task(words, total=None)
        yield lambda: bars.advance(task)


def everywhere(paths: list[Path]) -> list[Path]:
    """The paths as a worker on another machine, or in another folder, understands them."""
    return [path.resolve() for path in paths]
