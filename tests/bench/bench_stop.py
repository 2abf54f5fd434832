"""How long a STOP takes in each bad moment, by witnesses of their own.

Run from the project's root: ``python -m tests.bench.bench_stop [repeats]``. Prints medians and
maxima of wall milliseconds from the instant at which STOP is given: until the last byte of ABORT
has come out of the engine (ordered), until the mount tells somebody else that it stands, until the
answer (answered: the driver has taken it; of a command: it is measured how the mount moves). The
mount really moves each time. Bars: 200 ms and 2000 ms.

``--busy`` keeps every core busy with other work and gives ``repeats`` STOPs in all, in turn while
idle, while a frame arrives and while one is processed. Bars: ordered within 200 ms in all,
answered within 500 ms in 99 of 100.
"""

import argparse
import contextlib
import multiprocessing
import os
import signal
import statistics
import sys
import tempfile
from collections.abc import Callable, Iterator
from itertools import cycle, islice
from pathlib import Path

from tests.rigs.stop_situations import (
    SITUATIONS,
    Figures,
    Scene,
    scene,
    stop_by_command,
)

ABORT_BAR_MS, ENDED_BAR_MS = 200.0, 2000.0
ANSWERED_BAR_MS, ANSWERED_SHARE = 500.0, 0.99
SIZE_PX = (4656, 3520)


def by_command(stage: Scene) -> Figures:
    """``rsoconsole stop``, engine at work: a program's start is in it."""
    stage.arm()
    stage.ear.slew()
    return stage.stop(lambda: stop_by_command(stage))


def by_command_past_a_hung_engine(stage: Scene) -> Figures:
    """``rsoconsole stop`` while the whole engine hangs."""
    stage.arm()
    stage.ear.slew()
    process = stage.engine.process
    assert process is not None
    os.kill(process.pid, signal.SIGSTOP)

    def give() -> dict[str, object]:
        try:
            return stop_by_command(stage)
        finally:
            os.kill(process.pid, signal.SIGCONT)

    return stage.stop(give)


BY_SOCKET: dict[str, Callable[[Scene], Figures]] = dict(SITUATIONS)
BY_COMMAND: dict[str, Callable[[Scene], Figures]] = {
    "'rsoconsole stop'": by_command,
    "'rsoconsole stop', engine hung": by_command_past_a_hung_engine,
}


@contextlib.contextmanager
def every_core_busy() -> Iterator[None]:
    """As many processes as there are cores, each of which wants one for itself."""
    context = multiprocessing.get_context("spawn")
    workers = [context.Process(target=_work, daemon=True) for _ in range(os.cpu_count() or 1)]
    for each in workers:
        each.start()
    try:
        yield
    finally:
        for each in workers:
            each.kill()
            each.join()


def _work() -> None:
    number = 0
    while True:
        number = (number * 1_103_515_245 + 12_345) % (1 << 31)


def under_load(stage: Scene, repeats: int) -> None:
    """So many STOPs by the socket with every core busy; prints their distribution."""
    acts = ("idle", "while a frame arrives", "while one is processed")
    figures = []
    with every_core_busy():
        for number, name in enumerate(islice(cycle(acts), repeats)):
            figures.append(BY_SOCKET[name](stage))
            print(f"{number + 1} of {repeats}: {name} {figures[-1]}", file=sys.stderr)
    print(f"{repeats} STOPs, every core busy; ms: median, 95 %, 99 %, worst; above 200, above 500")
    columns = {
        "ordered": [each.abort_ms for each in figures],
        "mount stands": [each.ended_ms for each in figures],
        "answered": [each.answer_ms for each in figures],
    }
    for name, values in columns.items():
        ordered = sorted(values)
        shares = [ordered[min(len(ordered) - 1, int(share * len(ordered)))] for share in _SHARES]
        above = [sum(value > bar for value in values) for bar in (200.0, 500.0)]
        cells = "".join(f"{each:9.0f}" for each in (*shares, ordered[-1], *above))
        print(f"{name:14}{cells}")
    in_time = sum(value <= ANSWERED_BAR_MS for value in columns["answered"]) / repeats
    is_kept = all(each.is_answered for each in figures)
    is_kept = is_kept and max(columns["ordered"]) <= ABORT_BAR_MS and in_time >= ANSWERED_SHARE
    paths = "/".join(sorted({each.path for each in figures}))
    print(f"by {paths}; the bars are {'kept' if is_kept else 'MISSED'}")


_SHARES = (0.5, 0.95, 0.99)


def main() -> None:
    """Each situation so many times, in turn; or STOPs under load."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("repeats", nargs="?", type=int, default=10)
    parser.add_argument("--busy", action="store_true", help="keep every core busy meanwhile")
    asked = parser.parse_args()
    repeats = asked.repeats
    if asked.busy:
        with tempfile.TemporaryDirectory() as folder, scene(Path(folder), SIZE_PX) as stage:
            under_load(stage, repeats)
        return
    found: dict[str, list[Figures]] = {}
    with tempfile.TemporaryDirectory() as folder, scene(Path(folder), SIZE_PX) as stage:
        for number in range(repeats):
            for name, act in {**BY_SOCKET, **BY_COMMAND}.items():
                found.setdefault(name, []).append(act(stage))
            print(f"{number + 1} of {repeats}", file=sys.stderr)
    print(f"{repeats} times each; ms: median, worst")
    print(f"{'':34}{'ABORT written':>18}{'motion ended':>18}{'answer':>18}  path")
    for name, figures in found.items():
        columns = [
            [figure.abort_ms for figure in figures],
            [figure.ended_ms for figure in figures],
            [figure.answer_ms for figure in figures],
        ]
        cells = "".join(f"{statistics.median(each):9.0f}{max(each):9.0f}" for each in columns)
        paths = "/".join(sorted({figure.path for figure in figures}))
        is_kept = all(figure.is_answered for figure in figures) and (
            max(columns[0]) <= ABORT_BAR_MS or name in BY_COMMAND
        )
        is_kept = is_kept and (max(columns[1]) <= ENDED_BAR_MS or name in BY_COMMAND)
        print(f"{name:34}{cells}  {paths}{'' if is_kept else '  MISSED'}")


if __name__ == "__main__":
    main()
