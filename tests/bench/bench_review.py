"""How quick and how frugal a review is, in a real pseudo-terminal.

    python -m tests.bench.bench_review [--frames 5000] [--repeats 5] [--write]

Run from the project's root. A made-up night of so many frames, with misses, refusals, rulings,
notes, losses, alarms and pictures, is reviewed as an operator does: timed from
the command until the time line and a frame are on the terminal, and until the night has been read;
from a key that goes to a random frame until that frame is, before and after the night has been
read; how much memory the program then has.
Prints; ``--write`` keeps the figures in ``results/review.json``.
"""

import argparse
import json
import os
import platform
import random
import sys
import tempfile
import time
from pathlib import Path
from statistics import median, quantiles
from typing import Any

from tests.bench.bench_console import wait
from tests.nights import eventful_night, made_up_night
from tests.rigs.terminal import Terminal

RESULTS = Path(__file__).parent / "results" / "review.json"
COMMAND = [sys.executable, "-c", "from rsoconsole.cli import main; main()", "review"]
SIZE = (120, 40)
JUMPS, EARLY_JUMPS = 40, 8
PICTURED = 25
"""Every so many frames one has pictures: 250 kB each."""
SETTLED_S = 0.4


def write_session(folder: Path, frames: int) -> None:
    """A night in which much comes to pass, with pictures of the frames that are gone to."""
    writer = eventful_night.write(folder, 0)
    at = 1
    for pictured in (1, *range(PICTURED, frames + 1, PICTURED)):
        eventful_night.go_on(writer, range(at, pictured + 1))
        made_up_night.add_previews(writer, range(pictured, pictured + 1))
        wait((folder / "closeups" / f"{pictured:06d}.png").exists)
        at = pictured + 1
    eventful_night.go_on(writer, range(at, frames + 1))
    writer.close()


def started(folder: Path, frames: int) -> dict[str, float]:
    """Seconds from the command to the first frame, and to the end of reading."""
    with Terminal([*COMMAND, str(folder)], os.environ, SIZE) as terminal:
        wait(lambda: terminal.shows("STOP", f"frame 1 of {frames}", "frame 0001 "))
        first_s = time.monotonic() - terminal.begun_s
        wait_read(terminal)
        return {"first": first_s, "all": time.monotonic() - terminal.begun_s}


def wait_read(terminal: Terminal) -> None:
    """Until the time line has said that it is being read, and says so no more."""
    wait(lambda: terminal.shows("reading "))
    known = terminal.text.rfind("reading ")
    while True:
        time.sleep(SETTLED_S)
        last = terminal.text.rfind("reading ")
        if last == known:
            return
        known = last


def jumped_ms(terminal: Terminal, frame_id: int) -> float:
    """From the last key of a jump to that frame until its picture's title is on the terminal."""
    terminal.press("g")
    time.sleep(0.3)
    terminal.press(f"{frame_id}")
    time.sleep(0.2)
    known = len(terminal.text)
    began = time.monotonic()
    terminal.press("\r")
    # Only what differs is written: the number's last digits, in the picture's title.
    wait(lambda: terminal.shows(f"{frame_id:04d} · 10 s", since=known))
    return (time.monotonic() - began) * 1e3


def memory_mb(pid: int) -> float:
    """Resident memory of a process."""
    line = next(
        line for line in Path(f"/proc/{pid}/status").read_text().splitlines() if "VmRSS" in line
    )
    return int(line.split()[1]) / 1e3


def main() -> None:
    """Measure, print, and write when asked to."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, default=5000)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--session", type=Path, help="measure on this one, written before")
    parser.add_argument("--write", action="store_true")
    options = parser.parse_args()
    figures: dict[str, Any] = {
        "machine": f"{platform.machine()}, {os.cpu_count()} cores",
        "load_before": round(os.getloadavg()[0], 1),
        "frames": options.frames,
        "terminal": f"{SIZE[0]}x{SIZE[1]}",
    }
    with tempfile.TemporaryDirectory() as place:
        folder = options.session or Path(place) / "night"
        if not folder.exists():
            write_session(folder, options.frames)
        figures |= measured(folder, options.frames, options.repeats)
    figures["load_after"] = round(os.getloadavg()[0], 1)
    for name, value in figures.items():
        print(f"{name:24s} {value}")
    if options.write:
        RESULTS.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")


def measured(folder: Path, frames: int, repeats: int) -> dict[str, float]:
    """Everything, over one session."""
    starts = [started(folder, frames) for _ in range(repeats)]
    chosen, pictured = random.Random(1), range(PICTURED, frames + 1, PICTURED)
    early: list[float] = []
    for _ in range(EARLY_JUMPS):
        with Terminal([*COMMAND, str(folder)], os.environ, SIZE) as terminal:
            wait(lambda t=terminal: t.shows("STOP", "frame 0001 "))  # type: ignore[misc]
            early.append(jumped_ms(terminal, chosen.choice(pictured[len(pictured) * 9 // 10 :])))
    with Terminal([*COMMAND, str(folder)], os.environ, SIZE) as terminal:
        wait_read(terminal)
        time.sleep(2.0)
        jumps = [jumped_ms(terminal, n) for n in chosen.sample(pictured, JUMPS)]
        rss_mb = memory_mb(terminal.process.pid)
    return {
        "first_paint_s": round(median(each["first"] for each in starts), 3),
        "whole_night_s": round(median(each["all"] for each in starts) - SETTLED_S, 2),
        "early_jump_ms": round(median(early), 1),
        "early_jump_largest_ms": round(max(early), 1),
        "jump_ms": round(median(jumps), 1),
        "jump_95_percent_ms": round(quantiles(jumps, n=20)[-1], 1),
        "jump_largest_ms": round(max(jumps), 1),
        "memory_mb": round(rss_mb, 1),
    }


if __name__ == "__main__":
    main()
