"""From a 16-megapixel frame in memory to the plan of the next exposure, by stage.

    python -m tests.bench.bench_cycle [--frames 20] [--only "one streak"]
    python -m tests.bench.bench_cycle --against 30d3adb [--rounds 3]

Frames of the simulated camera, the whole cycle (network, line fit, solver process, filter) and
the planning of the next exposure, by the default configuration. Prints the median and the 95 %
point of each stage. ``--against`` measures another commit's tree too, in the same environment:
both take turns at each frame, so that what else the machine does counts for both; printed are
the ratios (this tree over that one) with their 95 % intervals, by drawing the frames again. Not in
it: the frame's way from its last byte through the camera's process and the order to the mount;
``rsoconsole demo --headless --json`` has them as ``read`` and ``order``.
"""

import argparse
import contextlib
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from rsoconsole.cli import ONE_THREAD
from tests.bench.cycle_scenes import skies, write_frames
from tests.bench.trees import HERE, tree_of

PROGRAM = HERE / "tests" / "bench" / "cycle_program.py"
SETTLED = 3
"""Number of frames of a sky that are not counted: they find plate and track."""


@contextlib.contextmanager
def program(tree: Path, folders: Sequence[Path]) -> Iterator["subprocess.Popen[str]"]:
    """Run ``cycle_program`` in a tree."""
    running = subprocess.Popen(
        [sys.executable, str(PROGRAM), *map(str, folders)],
        cwd=tree,
        env={**os.environ, **dict.fromkeys(ONE_THREAD, "1"), "PYTHONPATH": str(tree)},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    with running:
        try:
            yield running
        finally:
            running.kill()


def taken(trees: Sequence[Path], skies_of: dict[str, Path], count: int) -> dict[str, Any]:
    """By sky what each tree measured of each frame, in turn."""
    found: dict[str, Any] = {name: [[] for _ in trees] for name in skies_of}
    with contextlib.ExitStack() as stack:
        folders = list(skies_of.values())
        running = [stack.enter_context(program(tree, folders)) for tree in trees]
        for name in skies_of:
            for number in range(count):
                turns = list(enumerate(running))
                for at, each in turns if number % 2 else reversed(turns):
                    assert each.stdin is not None
                    assert each.stdout is not None
                    each.stdin.write("\n")
                    each.stdin.flush()
                    line = each.stdout.readline()
                    if not line:
                        raise SystemExit(f"the cycle failed in {trees[at]}")
                    if number >= SETTLED:
                        found[name][at].append(json.loads(line))
    return found


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--frames", type=int, default=20)
    parser.add_argument("--only", action="append", help="a sky, by its name in the table")
    parser.add_argument("--against", metavar="COMMIT", help="or another tree's folder")
    parser.add_argument("--rounds", type=int, default=3, help="over all frames, with --against")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folders: dict[str, Path] = {}
        for name, sky in skies().items():
            if options.only is None or name in options.only:
                folders[name] = Path(scratch) / name.replace(" ", "_")
                folders[name].mkdir()
                write_frames(folders[name], sky, options.frames)
        if options.against is None:
            for name, (rows,) in taken([HERE], folders, options.frames).items():
                _print_stages(name, rows)
            return
        with tree_of(options.against) as old:
            trees, count = (old, HERE), options.frames
            rounds = [taken(trees, folders, count) for _ in range(options.rounds)]
        print(
            f"{'from frame to plan':30}{'streaks':>8}{'before':>8}{'after':>8}{'ratio':>7}   95 %"
        )
        for name in folders:
            before, after = (
                [row for each in rounds for row in each[name][at]] for at in range(len(trees))
            )
            _print_ratios(name, before, after)


def _print_stages(name: str, rows: Sequence[dict[str, Any]]) -> None:
    streaks = median(row["streaks"] for row in rows)
    print(f"{name}: {streaks:.0f} streaks, {rows[-1]['state']}, {rows[-1]['peak_mib']:.0f} MiB")
    print(f"{'stage':10} {'median ms':>10} {'95 % ms':>10}")
    for stage in rows[-1]["ms"]:
        values = [row["ms"].get(stage, 0.0) for row in rows]
        print(f"{stage:10} {median(values):10.1f} {np.quantile(values, 0.95):10.1f}")


def _print_ratios(
    name: str, before: Sequence[dict[str, Any]], after: Sequence[dict[str, Any]]
) -> None:
    ms = np.array([[row["ms"]["total"] for row in rows] for rows in (before, after)])
    streaks = "/".join(f"{median(row['streaks'] for row in rows):.0f}" for rows in (before, after))
    drawn = np.random.default_rng(1).integers(0, ms.shape[1], (2000, ms.shape[1]))
    for title, share in (("median", 0.5), ("95 %", 0.95)):
        old, new = np.quantile(ms, share, axis=1)
        olds, news = np.quantile(ms[:, drawn], share, axis=2)
        low, high = np.quantile(news / olds, (0.025, 0.975))
        print(
            f"{name + ', ' + title:30}{streaks:>8}{old:8.0f}{new:8.0f}{new / old:7.2f}   "
            f"{low:.2f} to {high:.2f}"
        )
    old, new = (rows[-1]["peak_mib"] for rows in (before, after))
    print(f"{name + ', MiB':38}{old:8.0f}{new:8.0f}{new / old:7.2f}")


if __name__ == "__main__":
    main()
