"""Two checkouts against each other, in turn: what an operator waits for, before and after a change.

    python -m tests.bench.alternate BEFORE [--runs 7] [--only console,stop]

Run from the project's root; BEFORE is a commit or another checkout. Each benchmark runs there, then
here, ``--runs`` times, each tree's by its own program. Prints for each figure both medians and the
median of the ratios of the pairs (after / before) with its range. The cycle has a benchmark that
gives both trees the same frames: ``bench_cycle --against``.
"""

import argparse
import os
import re
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median

from tests.bench.trees import HERE, tree_of


@dataclass(frozen=True, slots=True, kw_only=True)
class Bench:
    """A program that prints lines of a name and a figure."""

    name: str
    arguments: Sequence[str]
    figures: Sequence[str]
    """Those that are compared, as their lines begin."""


ALL = (
    Bench(
        name="console",
        arguments=("--frames", "2000", "--seconds", "8", "--repeats", "3"),
        figures=("first_paint_s", "whole_night_s", "key_ms"),
    ),
    Bench(
        name="review",
        arguments=("--frames", "2000", "--repeats", "3"),
        figures=("first_paint_s", "whole_night_s", "early_jump_ms", "jump_ms"),
    ),
    Bench(name="what_if", arguments=(), figures=("read_s", "replay_s", "what_if_s", "command_s")),
    Bench(
        name="stop",
        arguments=("2",),
        figures=("idle", "while a frame arrives", "while one is processed", "'rsoconsole stop'  "),
    ),
)


def measured(bench: Bench, tree: Path) -> dict[str, float]:
    """The figures of one run."""
    command = [sys.executable, "-m", f"tests.bench.bench_{bench.name}", *bench.arguments]
    environment = {**os.environ, "PYTHONPATH": str(tree)}
    done = subprocess.run(
        command, cwd=tree, env=environment, capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise SystemExit(f"bench_{bench.name} failed in {tree}:\n{done.stderr[-2000:]}")
    found: dict[str, float] = {}
    for line in done.stdout.splitlines():
        for figure in bench.figures:
            told = re.match(r"\s+(-?[\d.]+)", line[len(figure.rstrip()) :])
            if line.startswith(figure) and told:
                found[figure.strip()] = float(told[1])
    return found


def main() -> None:
    """Run all in turn, and print the ratios."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("before", help="commit or folder")
    parser.add_argument("--runs", type=int, default=7)
    parser.add_argument("--only", default=",".join(bench.name for bench in ALL))
    options = parser.parse_args()
    with tree_of(options.before) as before:
        _compare(before, options.only.split(","), options.runs)


def _compare(before: Path, names: Sequence[str], runs: int) -> None:
    print(f"{'':40}{'before':>10}{'after':>10}{'ratio':>8}   range", flush=True)
    for bench in (each for each in ALL if each.name in names):
        pairs = []
        for number in range(runs):
            pairs.append((measured(bench, before), measured(bench, HERE)))
            print(f"{bench.name}: {number + 1} of {runs}", file=sys.stderr, flush=True)
        for figure in pairs[0][0]:
            both = [(old[figure], new[figure]) for old, new in pairs]
            ratios = sorted(new / old for old, new in both if old > 0.0)
            medians = [median(each) for each in zip(*both, strict=True)]
            cells = f"{medians[0]:10.3f}{medians[1]:10.3f}{median(ratios):8.2f}"
            print(
                f"{bench.name + ', ' + figure:40}{cells}   {ratios[0]:.2f} to {ratios[-1]:.2f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
