"""How many satellites are found in frames that SatSim drew, altered as ordinary nights alter them.

    python -m tests.campaign.independent all --count 40 --write
    python -m tests.campaign.independent ring drift --count 10

Neither the frames nor the alterations are the product's: SatSim's frames are convolved, striped,
binned or dimmed with NumPy, then given the noise that a sensor would have added. A look is a part
of 1800 x 1400 px about one satellite, its severity uniform over the range of the family. Counted
are looks in which the satellite's integrated SNR, worked out from SatSim's own figure and what the
alteration leaves of a line of light, is at least 20. The same command goes on where it was stopped
(``--folder``).
"""

import math
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import cv2

from models.intervals import rate_interval, share_interval
from rsoconsole.config import DetectorConfig
from rsoconsole.records import BelowTau, Detection
from rsoconsole.sky import line_angle_deg
from rsoconsole.vision import ConfidenceCurve, Network, StreakDetector
from tests.campaign.rows_kept import complete, keep, parser_of, put_into_page, read
from tests.campaign.satsim_altered import FAMILIES, FRAMES, Ends, drawn, looks, snr_of

TAU, MIN_SNR = 0.10, 20.0

_detectors: list[StreakDetector] = []


def _detector() -> StreakDetector:
    if not _detectors:
        cv2.setNumThreads(1)
        network = Network.load(None, 1)
        curve = ConfidenceCurve.from_card(network.card)
        _detectors.append(StreakDetector(network, DetectorConfig(threads=1), curve))
    return _detectors[0]


def _is_on(found: Detection, ends: Ends) -> bool:
    length = math.hypot(ends[2] - ends[0], ends[3] - ends[1])
    x, y = 0.5 * (ends[0] + ends[2]), 0.5 * (ends[1] + ends[3])
    angle = math.degrees(math.atan2(ends[3] - ends[1], ends[2] - ends[0])) % 180.0
    leeway = 4.0 + math.degrees(3.0 / max(length, 1.0))
    near = math.hypot(found.x_px - x, found.y_px - y) < max(0.25 * length, 8.0)
    return near and line_angle_deg(found.angle_deg, angle) < leeway


def _is_crossing(found: Detection, name: str) -> bool:
    return name == "crossings" and found.kind != "streak"


def row_of(name: str, number: int) -> dict[str, Any]:
    """One look through the detector that the engine has."""
    frame, streaks, severity = drawn(name, number)
    analysis = _detector().analyse(frame, TAU)
    found = analysis.detections
    best = max((d.confidence for d in found.detections if _is_on(d, streaks[0])), default=0.0)
    strangers = [
        d
        for d in found.detections
        if not any(_is_on(d, each) for each in streaks) and not _is_crossing(d, name)
    ]
    refused = [r for r in found.rejected if _is_on(r.detection, streaks[0])]
    placed = [analysis.working.original_detection(each.found) for each in analysis.candidates]
    lost = ""
    if not best:
        reasons = [r.reason for r in refused]
        lost = "not proposed"
        if reasons:
            lost = "below tau" if isinstance(reasons[0], BelowTau) else reasons[0].kind
        if any(_is_on(each, streaks[0]) for each in placed):
            lost = f"measured; {lost}"
    return {
        "number": number,
        "look": looks()[number % len(looks())].name,
        "severity": round(severity, 3),
        "snr": round(snr_of(name, number), 1),
        "confidence": round(best, 4),
        "false": len(strangers),
        "false_confidence": round(max((d.confidence for d in strangers), default=0.0), 3),
        "lost": lost,
        "ms": round(sum(found.stage_ms.values()), 1),
    }


def line_of(name: str, rows: Sequence[dict[str, Any]]) -> str:
    """One line of the table."""
    family, frames = FAMILIES[name], len(rows)
    false = sum(row["false"] for row in rows)
    rows = [row for row in rows if row["snr"] >= MIN_SNR]
    tries = len(rows)
    span = "" if family.high == family.low else f" {family.low:g} to {family.high:g}"
    hits = sum(row["confidence"] > TAU for row in rows)
    low, high = share_interval(hits, tries)
    lost = [row["lost"] for row in rows if row["lost"]]
    return (
        f"| {family.title}{span} | {hits} of {tries} | {hits / tries:.2f} ({low:.2f}-{high:.2f}) "
        f"| {100 * false / frames:.1f} ({100 * rate_interval(false, frames)[1]:.1f}) "
        f"| {max(set(lost), key=lost.count) if lost else ''} |\n"
    )


def table(folder: Path) -> str:
    """Of all families that have rows."""
    head = (
        "| family | found | share, 95 % | false in 100 (at most) | mostly lost as |\n"
        "|---|---|---|---|---|\n"
    )
    return head + "".join(
        line_of(name, rows) for name in FAMILIES if (rows := read(folder / f"{name}.jsonl"))
    )


def main() -> None:
    """Run what is missing, print the table."""
    parser = parser_of("independent", __doc__, 42)
    parser.add_argument("families", nargs="+", choices=[*FAMILIES, "all", "table"])
    chosen = parser.parse_args()
    if not FRAMES.exists():
        parser.error(f"the frames of SatSim are not here: {FRAMES}")
    names = list(FAMILIES) if "all" in chosen.families else chosen.families
    for name in (each for each in names if each in FAMILIES):
        path = chosen.folder / f"{name}.jsonl"
        complete(path, partial(row_of, name), chosen.count, chosen.jobs)
        print(line_of(name, read(path)), end="", flush=True)
    if chosen.write:
        keep(chosen.folder, "independent")
        put_into_page("independent", table(chosen.folder))


if __name__ == "__main__":
    main()
