"""Fit the curve that turns a measured candidate into a probability, on whole frames.

    python -m models.confidence [--frames 1000] [--workers 2] [--again] [--print-only]

Looks with the product's detector at frames of the split ``calibrate`` (``models.frames``), which
are kept as rows (``models.rows``): work broken off goes on, and another curve on the same rows
costs a second. What is fitted and why is told in ``models.curve_fit``. Judged by cross-validation:
every candidate by a curve that never saw its frame. Writes ``measured_confidence`` into the
network's card.
"""

import argparse
import json
from collections.abc import Sequence
from typing import Any

from models.curve_fit import (
    ORDINARY,
    SHARES,
    TAU,
    FittedCurve,
    counts,
    fit_curve,
    gathered,
    out_of_fold,
    population_weights,
    reliability,
)
from models.frames import HARD, Kind
from models.judging import FrameRow
from models.rows import HERE, complete, folder_of
from rsoconsole.vision import FEATURES, MODEL_NAME, VERIFIER_NAME

CARD = (HERE / MODEL_NAME).with_suffix(".json")
SPLIT: dict[Kind, float] = {
    "empty": 0.171,
    "satellites": 0.0795,
    "clouds": 0.0183,
    "aircraft": 0.0428,
    "jitter": 0.0244,
    "rays": 0.0306,
    "altered": 0.6334,
}
"""Number of frames of each kind to analyse, as fractions of ``--frames``.

By what a kind costs and teaches, not by how often it occurs.
"""
ENOUGH = 200
MAX_OFF = 0.05
"""Largest error of a bin of confidence with at least ``ENOUGH`` candidates."""
SNR_BANDS = ((0.8, 1.5), (1.5, 2.0), (2.0, 3.0), (3.0, 5.0), (5.0, 30.0))


def counts_of(frames: int) -> dict[Kind, int]:
    """Number of frames of each kind when ``frames`` are analysed in all."""
    return {kind: max(1, round(frames * SPLIT[kind])) for kind in SPLIT}


def judged(rows: Sequence[FrameRow], curve: FittedCurve) -> dict[str, Any]:
    """Figures of the curve by cross-validation: every frame by a curve fitted without it."""
    them = gathered(rows)
    confidence = out_of_fold(rows, curve.frames_per_satellite)
    is_false = ~them.is_true & (confidence > TAU)
    weights = population_weights(them, curve.frames_per_satellite)
    table = reliability(confidence, them.is_true, weights)
    judged_bins = [abs(b["said"] - b["share"]) for b in table if b["candidates"] >= ENOUGH]
    found: dict[tuple[int, int], float] = {}
    place = 0
    for number, row in enumerate(rows):
        for each in row["candidates"]:
            if counts(row, each):
                if each["trail"] is not None:
                    key = number, each["trail"]
                    found[key] = max(found.get(key, 0.0), confidence[place])
                place += 1
    recall = {}
    for low, high in SNR_BANDS:
        asked = [
            bool(found.get((number, index), 0.0) > TAU)
            for number, row in enumerate(rows)
            for index, trail in enumerate(row["trails"])
            if low <= trail["peak_snr"] < high
        ]
        recall[f"{low:g}-{high:g}"] = [sum(asked), len(asked)]
    return {
        "frames": sum(them.frames.get(kind, 0) for kind in ORDINARY),
        "false_above_tau": int((is_false & them.of_kind(*ORDINARY)).sum()),
        "hard_frames": sum(them.frames.get(kind, 0) for kind in HARD),
        "hard_false_above_tau": {
            kind: [int((is_false & them.of_kind(kind)).sum()), them.frames.get(kind, 0)]
            for kind in (*HARD, "clouds")
        },
        "candidates": len(confidence),
        "true": int(them.is_true.sum()),
        "found_of_any_length": recall,
        "reliability": table,
        "worst_of_bins_with_enough": round(max(judged_bins), 4) if judged_bins else None,
    }


def entry(rows: Sequence[FrameRow], one_in: int | None = None) -> dict[str, Any]:
    """The fitted curve with its figures, as the network's card states it.

    ``one_in``: frames per frame with satellites in the population; None: chosen by the fit.
    """
    curve = fit_curve(gathered(rows), one_in)
    verifier_card = json.loads((HERE / VERIFIER_NAME).with_suffix(".json").read_text("utf-8"))
    return {
        "weights": dict(zip(FEATURES, (round(float(w), 6) for w in curve.weights), strict=True)),
        "tau": TAU,
        "population": {
            "one_frame_with_satellites_in": curve.frames_per_satellite,
            "shares_of_frames": dict(SHARES),
        },
        "verifier_sha256": verifier_card["sha256"],
        "keeps_false_alarms": {"ordinary": curve.keeps_ordinary, "hard": curve.keeps_hard},
        "judged": judged(rows, curve),
    }


def _say(fitted: dict[str, Any]) -> None:
    """Print what the curve does not keep."""
    for kind, keeps in fitted["keeps_false_alarms"].items():
        if not keeps:
            print(f"{kind} frames: more false ones above tau are expected than allowed")
    worst = fitted["judged"]["worst_of_bins_with_enough"]
    if worst is None:
        print(f"no bin of confidence has {ENOUGH} candidates: more --frames judge it better")
    elif worst > MAX_OFF:
        print(f"a bin of confidence is off by {worst:.3f}, {MAX_OFF} allowed")


def main() -> None:
    """Run the command line: analyse frames, fit the curve, write it into the card."""
    parser = argparse.ArgumentParser(prog="python -m models.confidence", description=__doc__)
    parser.add_argument("--frames", type=int, default=1000, help="of all kinds together")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--one-in", type=int, help="frames of which one holds satellites")
    parser.add_argument("--again", action="store_true", help="look at every frame again")
    parser.add_argument("--print-only", action="store_true", help="leave the card as it is")
    args = parser.parse_args()
    rows = complete(
        folder_of("confidence"), "calibrate", counts_of(args.frames), args.workers, again=args.again
    )
    fitted = entry(rows, args.one_in)
    print(json.dumps(fitted, indent=1))
    _say(fitted)
    if not args.print_only:
        card = json.loads(CARD.read_text(encoding="utf-8"))
        card["measured_confidence"] = fitted
        CARD.write_text(json.dumps(card, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
