"""Random sequences of orders, foreign hands and driver faults at odd mounts.

    python -m tests.campaign odd_mounts --seeds 0-1999
    python -m tests.campaign odd_mounts --wire --seeds 0-39

In process a night takes half a second of a core; over the wire a minute of the clock and little
else. Each is judged by the mount's own motion; a seed that fails is named with its mount.
"""

import argparse
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path

from tests.campaign.arguments import seeds_of
from tests.rigs.odd_mount import Oddities
from tests.rigs.odd_sequence import OddNight
from tests.rigs.odd_wire_night import ABORT_S, run_wire_night


def main(arguments: Sequence[str] | None = None) -> int:
    """Exit status 0 where nothing was wrong."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.campaign odd_mounts",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--seeds", type=seeds_of, default=list(range(2000)))
    parser.add_argument("--wire", action="store_true", help="over the wire, in real time")
    chosen = parser.parse_args(arguments)
    wrong = rests = stops = 0
    slowest_s = 0.0
    for seed in chosen.seeds:
        if chosen.wire:
            with tempfile.TemporaryDirectory(prefix="odd-") as folder:
                wire = run_wire_night(seed, Path(folder))
            faults, rests, stops = wire.faults, rests + wire.rests, stops + len(wire.stops_s)
            slowest_s = max([slowest_s, *wire.stops_s])
            faults += [f"ABORT left after {s:.2f} s" for s in wire.stops_s if s > ABORT_S]
            mount = ""
        else:
            night = OddNight(seed)
            verdict = night.run()
            faults, rests = verdict.faults, rests + verdict.rests_told
            stops, mount = stops + verdict.stops, words_of(night.oddities)
        if faults:
            wrong += 1
            print(f"seed {seed}: {'; '.join(faults[:3])} {mount}", flush=True)
    slowest = f", the slowest ABORT left after {1e3 * slowest_s:.0f} ms" if chosen.wire else ""
    print(
        f"{len(chosen.seeds)} nights, {stops} STOPs, {rests} words of rest, {wrong} wrong{slowest}"
    )
    return 1 if wrong else 0


def words_of(oddities: Oddities) -> str:
    """What is odd about it."""
    chosen = ((each.name, getattr(oddities, each.name), each.default) for each in fields(Oddities))
    return " ".join(f"{name}={value}" for name, value, default in chosen if value != default)


if __name__ == "__main__":
    sys.exit(main())
