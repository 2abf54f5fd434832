"""How long a STOP takes in each bad moment, by witnesses of their own.

Run from the project's root: ``python -m tests.bench.bench_stop [repeats]``. Prints medians and
maxima of wall milliseconds from the instant at which STOP is given: until the last byte of ABORT
has come out of the engine, until the mount tells somebody else that it stands, until the answer.
The mount really moves each time. Bars: 200 ms and 2000 ms.
"""

import os
import signal
import statistics
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from tests.stop_situations import (
    SITUATIONS,
    Figures,
    Scene,
    scene,
    stop_by_command,
)

ABORT_BAR_MS, ENDED_BAR_MS = 200.0, 2000.0
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


def main() -> None:
    """Each situation so many times, in turn."""
    repeats = int(sys.argv[1]) if len(sys.argv) > 1 else 10
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
        is_kept = all(figure.is_stopped for figure in figures) and (
            max(columns[0]) <= ABORT_BAR_MS or name in BY_COMMAND
        )
        is_kept = is_kept and (max(columns[1]) <= ENDED_BAR_MS or name in BY_COMMAND)
        print(f"{name:34}{cells}  {paths}{'' if is_kept else '  MISSED'}")


if __name__ == "__main__":
    main()
