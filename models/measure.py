"""The proof: the product's detector on frames it has never met, with exact intervals.

    python -m models.measure [--frames 6000] [--kinds empty ...] [--workers 2] [--again] [--gallery]

Looks at whole frames of the split ``test`` (``models.frames``), keeps them as rows
(``models.rows``: work broken off goes on), and writes ``models/figures.json``, which
``python -m models.card`` puts into the model card. At the end the product runs as it is, curve, tau
and all, on some of the same frames with two threads: its answers must be those of the rows.
"""

import argparse
import json
from collections.abc import Sequence
from typing import Any

from models.figures import figures, outcome_of
from models.frames import KINDS, Kind, draw
from models.gallery import contact_sheet
from models.judging import FrameRow, confidences_of, measured_of
from models.rows import HERE, complete, fingerprint, folder_of
from rsoconsole.config import DetectorConfig
from rsoconsole.records import Detection
from rsoconsole.vision import FEATURES, ConfidenceCurve, Network, StreakDetector

FIGURES = HERE / "figures.json"
GALLERY = HERE / "gallery.png"
SPLIT: dict[Kind, float] = {
    "empty": 0.84,
    "satellites": 0.10,
    "clouds": 0.015,
    "aircraft": 0.015,
    "jitter": 0.015,
    "rays": 0.015,
}
CHECKED = 24
"""Number of frames on which the product's own answers are compared with the rows."""
_SAME_PX, _SAME_CONFIDENCE = 0.01, 1e-3


def counts_of(frames: int, kinds: Sequence[Kind]) -> dict[Kind, int]:
    """Number of frames of each of these kinds when ``frames`` are analysed in all."""
    return {kind: max(1, round(frames * SPLIT[kind])) for kind in KINDS if kind in kinds}


def as_it_is(rows: Sequence[FrameRow], network: Network, curve: ConfidenceCurve) -> dict[str, Any]:
    """Compare the unmodified product's answers with the rows; return the frames that differ."""
    settings = DetectorConfig(threads=2)
    detector = StreakDetector(network, settings, curve)
    chosen = sorted(rows, key=lambda row: (row["number"], row["kind"]))[: CHECKED + 1]
    differing: list[str] = []
    for row in chosen:
        true = draw("test", row["kind"], row["number"])
        found = detector.detect(true.frame)
        if not _is_as_said(row, found.detections, curve, settings.tau):
            differing.append(true.frame.name)
    return {"frames": len(chosen), "differing": differing}


def _is_as_said(
    row: FrameRow, found: Sequence[Detection], curve: ConfidenceCurve, tau: float
) -> bool:
    """True where these detections are the candidates of the row above tau."""
    said = [
        (measured_of(each, row["focus"]), confidence)
        for each, confidence in zip(row["candidates"], confidences_of(row, curve), strict=True)
        if each["is_taken"] and confidence > tau
    ]
    return len(said) == len(found) and all(
        any(
            abs(one.confidence - confidence) < _SAME_CONFIDENCE
            and abs(one.x_px - each.x_px) + abs(one.y_px - each.y_px) < _SAME_PX
            for one in found
        )
        for each, confidence in said
    )


def main() -> None:
    """Run the command line: analyse the test frames and write ``models/figures.json``."""
    parser = argparse.ArgumentParser(prog="python -m models.measure", description=__doc__)
    parser.add_argument("--frames", type=int, default=6000, help="of all kinds together")
    parser.add_argument("--kinds", nargs="*", choices=KINDS, default=list(KINDS))
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--again", action="store_true", help="look at every frame again")
    parser.add_argument("--gallery", action="store_true", help="draw models/gallery.png too")
    parser.add_argument("--print-only", action="store_true", help="leave figures.json as it is")
    args = parser.parse_args()
    network = Network.load(None, 2)
    curve = ConfidenceCurve.from_card(network.card)
    tau = DetectorConfig().tau
    counts = counts_of(args.frames, args.kinds)
    rows = complete(folder_of("measure"), "test", counts, args.workers, again=args.again)
    measured = {
        "network": network.version,
        "rows": fingerprint(),
        "curve": dict(zip(FEATURES, curve.weights, strict=True)),
        **figures(rows, curve, network.card, tau),
        "product_as_it_is": as_it_is(rows, network, curve),
    }
    text = json.dumps(measured, indent=1)
    print(text)
    if not args.print_only:
        FIGURES.write_text(text + "\n", encoding="utf-8")
    if args.gallery:
        contact_sheet(outcome_of(rows, curve, tau), tau, GALLERY)


if __name__ == "__main__":
    main()
