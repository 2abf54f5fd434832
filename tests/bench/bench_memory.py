"""What each process of a night holds in memory, its peak and whether it stays level.

    python -m tests.bench.bench_memory [--frames 300] [--width 4656 --height 3520] [--no-record]
        [--write NAME]

Run from the project's root. The simulated observatory as fast as it goes, before it a whole engine
(``rsoconsole engine``) that keeps every frame, and a console on it in a pseudo-terminal, of 120 x
40 cells for the first half of the night and 200 x 60 for the second. Memory is the proportional
set size (PSS): pages that several processes share count in each for its part. It is read of all
processes some ten times a second, so a peak of a few milliseconds may pass unseen: ``high_water``
is the kernel's own (of the resident size, in which shared pages count whole). Flatness is the
slope of a line through each frame's median, after the first frames, of all but files: those count
for more as soon as any other program of this machine that shares them ends.

At the end all others are ended and the engine's processes read once more while they stand still:
libraries that the simulator or the console had shared with them then count in full (``alone``).

Ends with 1 where engine and children, or the console, hold more than their bar, or grow.
``--write`` keeps the figures under that name in ``results/memory.json``.
"""

import argparse
import contextlib
import json
import os
import platform
import signal
import sys
import tempfile
import time
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from rsoconsole.simulator import start_observatory
from rsoconsole.simulator.launch import Observatory
from tests.rigs.terminal import Terminal
from tests.rigs.whole_engine import CHILDREN, COMMAND, WholeEngine, whole_engine

RESULTS = Path(__file__).parent / "results" / "memory.json"
SCENARIO = "intelsat-14"
ENGINE_BAR_MIB, CONSOLE_BAR_MIB = 450.0, 120.0
"""With its children, at 16 megapixels and every frame kept; of one console."""
GROWTH_BAR_MIB = 10.0
"""Over 300 frames, of engine and children, and of a console."""
BAR_PIXELS = 16_400_000
WARM_UP_FRAMES = 20
SAMPLE_S = 0.08
SIZES = ((120, 40), (200, 60))
TREE = ("engine", "camera", "mount", "solver")
ALL = "engine and children"


def pss_mib(pid: int) -> tuple[float, float]:
    """Proportional set size of one process, and that without files; zeros where it is gone."""
    with contextlib.suppress(OSError):
        lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
        kib = {line.split()[0]: int(line.split()[1]) for line in lines[1:]}
        return kib["Pss:"] / 1024.0, (kib["Pss:"] - kib["Pss_File:"]) / 1024.0
    return 0.0, 0.0


def high_water_mib(pid: int) -> float:
    """Largest resident size that the kernel has seen of a process; 0 where it is gone."""
    with contextlib.suppress(OSError):
        for line in Path(f"/proc/{pid}/status").read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) / 1024.0
    return 0.0


class Samples:
    """Readings by process, each with the number of the frame under way."""

    def __init__(self) -> None:
        self.of: dict[str, list[tuple[int, float, float]]] = {}
        """Frame, proportional set size, and that without files."""
        self.high_water: dict[str, float] = {}

    def take(self, pids: dict[str, int], frame: int) -> None:
        """Read all of these once."""
        reading = {label: pss_mib(pid) for label, pid in pids.items()}
        tree = [reading.get(label, (0.0, 0.0)) for label in TREE]
        reading[ALL] = (sum(whole for whole, _ in tree), sum(own for _, own in tree))
        for label, (whole, own) in reading.items():
            if whole > 0.0:
                self.of.setdefault(label, []).append((frame, whole, own))
        for label, pid in pids.items():
            before = self.high_water.get(label, 0.0)
            self.high_water[label] = max(before, high_water_mib(pid))

    def figures(self, label: str) -> dict[str, float]:
        """Peak, median, and by how much it grows in 300 frames, MiB."""
        taken = self.of[label]
        frames: dict[int, list[float]] = {}
        for frame, _, own in taken:
            frames.setdefault(frame, []).append(own)
        first = min(frames)
        level = {f: median(v) for f, v in frames.items() if f >= first + WARM_UP_FRAMES}
        found = {
            "peak": max(whole for _, whole, _ in taken),
            "median": median(whole for _, whole, _ in taken),
        }
        if len(level) >= WARM_UP_FRAMES:
            slope = np.polyfit(list(level), list(level.values()), 1)[0]
            found["growth_300"] = 300.0 * float(slope)
        if label in self.high_water:
            found["high_water"] = self.high_water[label]
        return found


def watch(
    engine: WholeEngine, observatory: Observatory, frames: int
) -> tuple[Samples, dict[str, float]]:
    """A night of so many frames; the readings, and those of the engine's processes alone."""
    samples = Samples()
    engine.start()
    assert engine.process is not None
    with contextlib.ExitStack() as consoles:
        pids: dict[str, int] = {}
        terminal: Terminal | None = None
        frame, looked_s, seats = 0, 0.0, 0
        while frame < frames:
            if engine.process.poll() is not None:
                raise RuntimeError(f"the engine ended at frame {frame}: see {engine.folder}")
            if time.monotonic() - looked_s > 0.3:
                frame, looked_s = int(engine.status()["frame"]), time.monotonic()
                pids |= {"engine": engine.process.pid, "simulator": observatory.process.pid}
                pids |= {kind: pid for kind in CHILDREN if (pid := engine.child(kind))}
            if seats < len(SIZES) and frame >= seats * frames // len(SIZES):
                if terminal is not None:
                    terminal.kill()
                    terminal.hang_up()
                terminal = consoles.enter_context(
                    Terminal([*COMMAND, "console"], engine.environment, SIZES[seats])
                )
                pids = {k: v for k, v in pids.items() if not k.startswith("console")}
                columns, lines = SIZES[seats]
                pids[f"console {columns}x{lines}"] = terminal.process.pid
                seats += 1
            samples.take(pids, frame)
            time.sleep(SAMPLE_S)
    tree = {label: pids[label] for label in TREE if label in pids}
    for pid in tree.values():
        os.kill(pid, signal.SIGSTOP)
    observatory.process.kill()
    observatory.process.wait()
    alone = {label: pss_mib(pid)[0] for label, pid in tree.items()}
    return samples, {**alone, ALL: sum(alone.values())}


def too_much(figures: dict[str, dict[str, float]], pixels: int) -> list[str]:
    """What is above its bar, in words."""
    found = []
    for label, values in figures.items():
        is_console = label.startswith("console")
        bar = CONSOLE_BAR_MIB if is_console else ENGINE_BAR_MIB
        if label != ALL and not is_console:
            continue
        if (is_console or pixels <= BAR_PIXELS) and values["peak"] > bar:
            found.append(f"{label}: {values['peak']:.0f} MiB, {bar:.0f} at most")
        if values.get("growth_300", 0.0) > GROWTH_BAR_MIB:
            found.append(
                f"{label}: grows by {values['growth_300']:.1f} MiB in 300 frames,"
                f" {GROWTH_BAR_MIB:.0f} at most"
            )
    return found


def main() -> int:
    """Measure, print, and keep when asked to."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, default=300)
    parser.add_argument("--width", type=int, default=4656)
    parser.add_argument("--height", type=int, default=3520)
    parser.add_argument("--no-record", action="store_true", help="keep no frames")
    parser.add_argument("--write", metavar="NAME")
    options = parser.parse_args()
    optics = {"width_px": options.width, "height_px": options.height}
    settings: dict[str, dict[str, Any]] = {
        "optics": optics,
        "session": {"keep_frames": "none" if options.no_record else "all"},
        "exposure": {"frame_timeout_s": 300.0},
        "solver": {"deadline_s": 60.0},
    }
    with (
        tempfile.TemporaryDirectory() as place,
        start_observatory(SCENARIO, 1, 0.0, **optics) as observatory,
        whole_engine(Path(place), observatory, **settings) as engine,
    ):
        samples, alone = watch(engine, observatory, options.frames)
        kept = engine.reader.counts()
    labels = sorted(samples.of, key=lambda label: (label != ALL, label))
    figures = {label: samples.figures(label) for label in labels}
    for label, value in alone.items():
        figures[label]["alone"] = value
    print(f"{options.frames} frames of {options.width} x {options.height} px; {kept}")
    columns = ("peak", "median", "growth_300", "high_water", "alone")
    print(f"{'MiB':22}" + "".join(f"{name:>12}" for name in columns))
    for label, values in figures.items():
        cells = (f"{values[c]:12.1f}" if c in values else f"{'-':>12}" for c in columns)
        print(f"{label:22}" + "".join(cells))
    if options.write:
        table = json.loads(RESULTS.read_text("utf-8")) if RESULTS.exists() else {}
        about = {"machine": platform.machine(), "python": platform.python_version()}
        table[options.write] = {**about, **optics, "frames": options.frames} | {
            label: {name: round(value, 1) for name, value in values.items()}
            for label, values in figures.items()
        }
        RESULTS.write_text(json.dumps(table, indent=1) + "\n", encoding="utf-8")
    excess = too_much(figures, options.width * options.height)
    for words in excess:
        print(words)
    return 1 if excess else 0


if __name__ == "__main__":
    sys.exit(main())
