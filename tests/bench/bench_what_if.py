"""A thousand measurements with other Q and R: from the session's file to the figures of both.

    .venv/bin/python -m tests.bench.bench_what_if [--write]

A generated session of 1,000 frames, each with one measurement; the processor's seconds on one
core, the median of the repeats. ``what_if``: reading, the recorded settings and the tried ones, the
log retold; ``command``: the whole program, from its start; ``proposal``: Q and R sought over 200
frames. ``--write`` keeps the figures.
"""

import json
import os
import platform
import resource
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from rsoconsole.pipeline import propose, replay, what_if_session
from rsoconsole.session import SessionReader
from tests.nights.measured_night import record_night

RESULTS = Path(__file__).parent / "results" / "what_if.json"
FRAMES = 1000
REPEATS = 7
TRIED = {"filter.q_multiplier": 4.0, "filter.r_multiplier": 0.5}


def median_s(work: Callable[[], object], repeats: int = REPEATS) -> float:
    """The processor's time for one call and its children, after one that is not counted."""
    work()
    took = []
    for _ in range(repeats):
        began_s = processor_s()
        work()
        took.append(processor_s() - began_s)
    return statistics.median(took)


def processor_s() -> float:
    """Of this process and of those that it has waited for."""
    used = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(each.ru_utime + each.ru_stime for each in used)


def command(folder: Path) -> None:
    """As a shell runs it."""
    program = "from rsoconsole.cli import main; main()"
    arguments = ["what-if", str(folder), "--q", "4", "--r", "0.5", "--json"]
    subprocess.run([sys.executable, "-c", program, *arguments], check=True, capture_output=True)


def main() -> None:
    """Measure and print."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    with tempfile.TemporaryDirectory() as scratch:
        folder = record_night(Path(scratch) / "thousand", frames=FRAMES, seed=1)
        short = record_night(Path(scratch) / "short", frames=200, seed=1)
        reader = SessionReader(folder)
        records = [record for _, _, record in reader.records()]
        config = reader.config()
        figures = {
            "read_s": median_s(lambda: list(reader.records())),
            "replay_s": median_s(lambda: list(replay(records, config, changes=TRIED))),
            "what_if_s": median_s(lambda: what_if_session(folder, TRIED)),
            "command_s": median_s(lambda: command(folder)),
            "proposal_200_s": median_s(lambda: propose([short]), 1),
        }
    for name, value in figures.items():
        print(f"{name:16} {value:7.3f}")
    if "--write" in sys.argv:
        machine = {
            "machine": f"{platform.machine()}, one core",
            "load": round(os.getloadavg()[0], 1),
        }
        rounded = {name: round(value, 3) for name, value in figures.items()}
        text = json.dumps({**machine, "frames": FRAMES, **rounded}, indent=1)
        RESULTS.write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
