"""The detector beside its peers, on the same frames, judged by one rule.

    python -m tests.bench.bench_peers [--parts drawn independent binarising] [--frames 60]
    python -m tests.bench.bench_peers --parts tuning --frames 4

Run from the project's root in an environment that has ``requirements-peers.txt`` too. Every peer
runs in a process of its own with a time-out; a frame without an answer counts as one where
nothing was found; a peer that is not installed is named and left out. Tuning tries each peer's
grid on frames of other seeds.
"""

import argparse
import json
import math
import os
import pickle
import platform
import tempfile
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from typing import Any

from rsoconsole.vision import Network
from tests.bench.peers import binarising
from tests.bench.peers.child import Child
from tests.bench.peers.frames import (
    BENCH,
    LENGTHS_PX,
    LONG,
    SEED,
    SNR_BINS,
    TUNING,
    BenchFrame,
    drawn_frames,
    independent_frames,
)
from tests.bench.peers.roster import PEERS, present
from tests.bench.peers.scoring import Candidate, Judged, Line, judge, summary

RESULTS = Path(__file__).parent / "results" / "peers.json"
TIMEOUT_S = 300.0
FALSE_PER_FRAME = (0.0, 0.1, 1.0)
LONG_PX = 90.0
PARTS = ("tuning", "drawn", "independent", "binarising")
RANGES = [f"{low:g}-{high:g}" for low, high in SNR_BINS]


@dataclass(slots=True)
class Tally:
    """What one peer did, frame by frame."""

    judged: list[Judged] = field(default_factory=list)
    kinds: list[str] = field(default_factory=list)
    names: list[str] = field(default_factory=list)
    answers: list[dict[str, Any]] = field(default_factory=list)

    def add(self, bench: BenchFrame, answer: dict[str, Any]) -> None:
        """Judge one answer; one that did not come has no candidates."""
        rows = answer.pop("candidates", [])
        candidates = [
            Candidate(line=Line(x_a_px=a, y_a_px=b, x_b_px=c, y_b_px=d), score=score)
            for a, b, c, d, score in rows
        ]
        self.judged.append(judge(candidates, bench.truth))
        self.kinds.append(bench.kind)
        self.names.append(bench.name)
        self.answers.append(answer)

    def report(self, slow_frames: int) -> dict[str, Any]:
        """Figures for JSON; "first": of the frames that the slow peers had too."""
        no_aircraft = [
            j for j, kind in zip(self.judged, self.kinds, strict=True) if kind != "aircraft"
        ]
        done = [a for a in self.answers if "error" not in a]
        return {
            "frames": len(self.judged),
            "failed": [a["error"] for a in self.answers if "error" in a],
            "all": summary(self.judged, SNR_BINS, FALSE_PER_FRAME),
            "first": summary(self.judged[:slow_frames], SNR_BINS, FALSE_PER_FRAME),
            "without_aircraft": summary(no_aircraft, SNR_BINS, FALSE_PER_FRAME),
            "long": summary([_only_long(j) for j in self.judged], SNR_BINS, FALSE_PER_FRAME),
            "false_per_kind": {
                kind: sum(
                    len(j.false_scores)
                    for j, k in zip(self.judged, self.kinds, strict=True)
                    if k == kind
                )
                / self.kinds.count(kind)
                for kind in sorted(set(self.kinds))
            },
            **{
                name: median(a[name] for a in done) if done else None
                for name in ("wall_s", "cpu_s", "peak_mb", "extra_mb")
            },
        }


def _only_long(judged: Judged) -> Judged:
    rows = tuple(row for row in judged.found if row[0].line.length_px >= LONG_PX)
    return Judged(found=rows, false_scores=judged.false_scores)


def run_peers(
    frames: Iterable[BenchFrame],
    settings: Mapping[str, tuple[str, Mapping[str, Any]]],
    slow_frames: int,
    folder: Path,
) -> dict[str, Tally]:
    """All entries (label to peer and settings) on all frames, the slow ones on the first few."""
    tallies = {label: Tally() for label in settings}
    path = folder / "frame.pickle"
    with ExitStack() as stack:
        children = {
            label: stack.enter_context(Child(peer, chosen, folder / "children.log"))
            for label, (peer, chosen) in settings.items()
        }
        for number, bench in enumerate(frames):
            path.write_bytes(pickle.dumps(bench.frame, protocol=5))
            for label, (peer, _) in settings.items():
                if PEERS[peer].is_slow and number >= slow_frames:
                    continue
                tallies[label].add(bench, children[label].ask(path, TIMEOUT_S))
            print(f"{number + 1}: {bench.name} ({bench.kind})", flush=True)
    return tallies


def print_table(reports: Mapping[str, Mapping[str, Any]], part: str) -> None:
    """One row a peer: average precision and recall at 0.1 false a frame in every range of SNR."""
    print(f"\n{part}: average precision | recall at 0.1 false per frame, by peak signal to noise")
    print(f"{'':33s} frames  {'all':>11s} " + " ".join(f"{name:>11s}" for name in RANGES), end="")
    print("  centroid  false/frame   wall s    CPU s  extra MB  failed")
    for name, report in reports.items():
        every = report[part]["all"]
        cells = [report[part][key] for key in ("all", *RANGES)]
        pairs = [f"{_two(c['average_precision'])} | {_two(c['recall_at_0.1'])}" for c in cells]
        print(f"{name:33s} {every['frames']:6.0f}  " + " ".join(f"{p:>11s}" for p in pairs), end="")
        print(f"  {_two(every['centroid_px']):>8s} {every['false_per_frame']:12.2f}", end="")
        costs = [report[key] for key in ("wall_s", "cpu_s", "extra_mb")]
        print("".join(" " * 9 + "-" if c is None else f" {c:8.2f}" for c in costs), end="")
        print(f"  {len(report['failed']):4d}")


def _two(value: float | None) -> str:
    return "   -" if value is None or math.isnan(value) else f"{value:.2f}"


def tune(names: Sequence[str], frames: int, folder: Path) -> dict[str, Any]:
    """Average precision of every entry of the grids on frames of other seeds."""
    entries: dict[str, tuple[str, Mapping[str, Any]]] = {}
    for name in names:
        base = PEERS[name].settings()
        entries[f"{name}: chosen"] = (name, base)
        for change in PEERS[name].grid():
            entries[f"{name}: {json.dumps(dict(change))}"] = (name, {**base, **change})
    tallies = run_peers(drawn_frames(frames, TUNING), entries, 1, folder)
    reports = {label: tally.report(frames) for label, tally in tallies.items()}
    print_table(reports, "all")
    return {"seed": [SEED, TUNING], "frames": frames} | {
        label: {
            "average_precision": report["all"]["all"]["average_precision"],
            "recall_at_0.1": report["all"]["all"]["recall_at_0.1"],
            "wall_s": report["wall_s"],
        }
        for label, report in reports.items()
    }


def independent(names: Sequence[str], folder: Path) -> dict[str, Any]:
    """The frames of other people: what was found of what is there, and what else was said."""
    tallies = run_peers(
        independent_frames(), {n: (n, PEERS[n].settings()) for n in names}, 2, folder
    )
    table: dict[str, Any] = {}
    for name, tally in tallies.items():
        table[name] = {
            frame: _one_frame(judged, answer)
            for frame, judged, answer in zip(tally.names, tally.judged, tally.answers, strict=True)
        }
        every = summary(tally.judged, (), FALSE_PER_FRAME)["all"]
        scores = [score for j in tally.judged for _, score, _ in j.found if score is not None]
        others = [score for j in tally.judged for score in j.false_scores]
        stronger = sum(score >= min(scores, default=float("inf")) for score in others)
        table[name]["together"] = every | {"others": len(others), "stronger_others": stronger}
        print(
            f"{name:33s} {len(tally.names)} frames: {len(scores)} of {every['asked']:.0f} found, ",
            end="",
        )
        print(f"{len(others)} others, {stronger} of them stronger than the weakest found; ", end="")
        print(f"AP {every['average_precision']:.2f}, middle {every['centroid_px']:.2f} px")
    return table


def _one_frame(judged: Judged, answer: Mapping[str, Any]) -> dict[str, Any]:
    scores = [score for _, score, _ in judged.found if score is not None]
    errors = [round(error, 2) for _, _, error in judged.found if error is not None]
    row: dict[str, Any] = {
        "asked": len(judged.found),
        "found": len(scores),
        "errors_px": errors,
        "false": len(judged.false_scores),
        "strongest_false": max(judged.false_scores, default=None),
        "weakest_found": min(scores, default=None),
    }
    return row | ({"error": answer["error"]} if "error" in answer else {})


def print_binarising(report: Mapping[str, Any]) -> None:
    """Confidence and average precision of the same network on differently made maps."""
    print("\nnetwork alone: median confidence | average precision, by peak signal to noise")
    for name, row in report.items():
        if not isinstance(row, dict):
            continue
        pairs = [
            f"{row['confidence'][key]:.3f} | {row['figures'][key]['average_precision']:.2f}"
            for key in RANGES
        ]
        print(f"{name:52s} " + "  ".join(pairs))


def _rounded(value: Any) -> Any:
    """For JSON: four digits, no nan."""
    if isinstance(value, dict):
        return {key: _rounded(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_rounded(each) for each in value]
    if isinstance(value, float):
        return float(f"{value:.4g}") if abs(value) < float("inf") else None
    return value


def main() -> None:
    """Run the parts asked for; the file keeps what other parts wrote."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--parts", nargs="*", default=list(PARTS[1:]), choices=PARTS)
    parser.add_argument("--frames", type=int, default=60)
    parser.add_argument("--slow-frames", type=int, default=6, help="for the slow peers")
    parser.add_argument("--minutes", type=float, default=1e6, help="no new frame after so long")
    parser.add_argument("--peers", nargs="*", default=list(PEERS), choices=list(PEERS))
    parser.add_argument("--out", type=Path, default=RESULTS)
    args = parser.parse_args()
    args.peers = present(args.peers)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for part in args.parts:
            if part == "tuning":
                found = tune(args.peers, args.frames, folder)
            elif part == "drawn":
                found = drawn(args, folder)
            elif part == "independent":
                found = independent(args.peers, folder)
            else:
                found = {
                    "frames": args.frames,
                    "lengths_px": LENGTHS_PX[LONG],
                } | binarising.compare(drawn_frames(args.frames, LONG))
                print_binarising(found)
            kept = json.loads(args.out.read_text()) if args.out.exists() else {}
            args.out.parent.mkdir(exist_ok=True)
            args.out.write_text(json.dumps(_rounded(kept | {part: found}), indent=1) + "\n")


def drawn(args: argparse.Namespace, folder: Path) -> dict[str, Any]:
    """The comparison on drawn frames."""
    settings = {name: (name, PEERS[name].settings()) for name in args.peers}
    frames = _until(drawn_frames(args.frames), args.minutes)
    tallies = run_peers(frames, settings, args.slow_frames, folder)
    reports = {name: tally.report(args.slow_frames) for name, tally in tallies.items()}
    tuned: Mapping[str, Any] = {}
    if args.out.exists():
        # Other peers' figures stay: the slow ones may have been run on another evening.
        kept = json.loads(args.out.read_text())
        before, tuned = kept.get("drawn", {}), kept.get("tuning", {})
        reports = before.get("peers", {}) | _rounded(reports)
        settings = {n: (n, s) for n, s in before.get("settings", {}).items()} | settings
    for part in ("all", "first", "without_aircraft", "long"):
        print_table(reports, part)
    return {
        "network": Network.load(None, 1).version,
        "seed": [SEED, BENCH],
        "tuned_on": tuned.get("frames", 0),
        "first_frames": args.slow_frames,
        "lengths_px": LENGTHS_PX[BENCH],
        "timeout_s": TIMEOUT_S,
        "machine": f"{platform.machine()}, {os.cpu_count()} cores",
        "settings": {name: dict(chosen) for name, (_, chosen) in settings.items()},
        "peers": reports,
    }


def _until(frames: Iterator[BenchFrame], minutes: float) -> Iterator[BenchFrame]:
    began = time.monotonic()
    for bench in frames:
        yield bench
        if time.monotonic() - began > 60 * minutes:
            return


if __name__ == "__main__":
    main()
