"""From a 16-megapixel frame in memory to the plan of the next exposure, by stage.

    python -m tests.bench.bench_cycle [--frames 20] [--only "one streak"]
    python -m tests.bench.bench_cycle --against 30d3adb [--rounds 5]

Frames of the simulated camera, the whole cycle (network, line fit, solver process, filter) and
the planning of the next exposure, by the default configuration. Prints the median and the 95 %
point of each stage. ``--against`` measures the same frames in another commit's tree too, in turn
in the same environment, and prints the ratios (this tree over that one): the median of the
rounds, and their range. Not in it: the frame's way from its last byte through the camera's process
and the order to the mount; ``rsoconsole demo --headless --json`` has them as ``read``, ``order``.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from rsoconsole.cli import ONE_THREAD
from tests.bench.cycle_scenes import skies, write_frames
from tests.bench.trees import HERE, tree_of

PROGRAM = HERE / "tests" / "bench" / "cycle_program.py"


def measured(tree: Path, folders: Sequence[Path]) -> dict[str, Any]:
    """What ``cycle_program`` measures in a tree."""
    done = subprocess.run(
        [sys.executable, str(PROGRAM), *map(str, folders)],
        cwd=tree,
        env={**os.environ, **dict.fromkeys(ONE_THREAD, "1"), "PYTHONPATH": str(tree)},
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise SystemExit(f"the cycle failed in {tree}:\n{done.stderr[-2000:]}")
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return found


def points_of(rows: Sequence[dict[str, float]], stage: str) -> tuple[float, float]:
    """Median and 95 % point of a stage; the first three frames find plate and track."""
    values = [row.get(stage, 0.0) for row in rows[3:]]
    return median(values), float(np.quantile(values, 0.95))


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--frames", type=int, default=20)
    parser.add_argument("--only", action="append", help="a sky, by its name in the table")
    parser.add_argument("--against", metavar="COMMIT", help="or another tree's folder")
    parser.add_argument("--rounds", type=int, default=5, help="of both trees, with --against")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folders: dict[str, Path] = {}
        for name, sky in skies().items():
            if options.only is None or name in options.only:
                folders[name] = Path(scratch) / name.replace(" ", "_")
                folders[name].mkdir()
                write_frames(folders[name], sky, options.frames)
        if options.against is None:
            found = measured(HERE, list(folders.values()))["folders"]
            for name, folder in folders.items():
                _print_stages(name, found[str(folder)])
            return
        with tree_of(options.against) as before:
            _print_ratios(before, folders, options.rounds)


def _print_stages(name: str, found: dict[str, Any]) -> None:
    streaks = median(found["streaks"])
    print(f"{name}: {streaks:.0f} streaks, {found['state']}, {len(found['rows'])} frames")
    print(f"{'stage':10} {'median ms':>10} {'95 % ms':>10}")
    for stage in found["rows"][-1]:
        middle, tail = points_of(found["rows"], stage)
        print(f"{stage:10} {middle:10.1f} {tail:10.1f}")


def _print_ratios(before: Path, folders: dict[str, Path], rounds: int) -> None:
    pairs: list[tuple[dict[str, Any], dict[str, Any]]] = []
    for number in range(rounds):
        old, new = (measured(tree, list(folders.values())) for tree in (before, HERE))
        pairs.append((old, new))
        print(f"round {number + 1} of {rounds}", file=sys.stderr, flush=True)
    print(f"{'from frame to plan':22}{'streaks':>9}{'before':>9}{'after':>9}{'ratio':>7}   range")
    for name, folder in folders.items():
        both = [(old["folders"][str(folder)], new["folders"][str(folder)]) for old, new in pairs]
        streaks = "/".join(f"{median(each['streaks']):.0f}" for each in both[0])
        for at, point in enumerate(("median", "95 %")):
            ms = [[points_of(each["rows"], "total")[at] for each in pair] for pair in both]
            _print_row(f"{name}, {point}", streaks, ms)
    _print_row("memory, MiB", "", [[each["peak_mib"] for each in pair] for pair in pairs])


def _print_row(name: str, streaks: str, pairs: Sequence[Sequence[float]]) -> None:
    ratios = sorted(new / old for old, new in pairs)
    old, new = (median(each) for each in zip(*pairs, strict=True))
    print(
        f"{name:26}{streaks:>5}{old:9.0f}{new:9.0f}{median(ratios):7.2f}   "
        f"{ratios[0]:.2f} to {ratios[-1]:.2f}"
    )


if __name__ == "__main__":
    main()
