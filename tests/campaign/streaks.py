"""How many streaks are found in frames that are altered as ordinary nights alter them.

    python -m tests.campaign.streaks all --count 300 --write
    python -m tests.campaign.streaks blur drift --count 40 --jobs 1

One frame a streak, half a second of a core each. Stop it when you like; the same command goes on
(``--folder``). ``--write`` puts the table into README.md and the rows into ``results/streaks``.
"""

import math
import statistics
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

from models.intervals import rate_interval, share_interval
from rsoconsole.config import DetectorConfig
from rsoconsole.records import BelowTau, Detection, Rejection
from rsoconsole.sky import line_angle_deg
from rsoconsole.vision import ConfidenceCurve, Network, StreakDetector
from tests.campaign.families import FAMILIES, draw
from tests.campaign.rows_kept import complete, keep, parser_of, put_into_page, read

TAU = 0.10
Trail: TypeAlias = tuple[float, float, float, float]
"""Both ends: x, y, x, y in px."""
_ACROSS_PX, _ALONG_SHARE, _TURN_DEG = 6.0, 0.25, 4.0
"""A detection is of the streak where its midpoint lies so near to it, and both run alike."""


def row_of(name: str, number: int) -> dict[str, Any]:
    """One frame through the detector that the engine has."""
    frame, truth, others = draw(name, number)
    found = detector().detect(frame, tau=TAU)
    middle = (0.5 * (truth.x_a_px + truth.x_b_px), 0.5 * (truth.y_a_px + truth.y_b_px))
    trail = (truth.x_a_px, truth.y_a_px, truth.x_b_px, truth.y_b_px)
    on_it = [d for d in found.detections if is_on(d, trail)]
    beside = [(s.x_px[0], s.y_px[0], s.x_px[-1], s.y_px[-1]) for s in others]
    strangers = [
        d for d in found.detections if d not in on_it and not any(_is_along(d, o) for o in beside)
    ]
    refused = [r for r in found.rejected if is_on(r.detection, trail)]
    best = max(on_it, key=lambda d: d.confidence, default=None)
    return {
        "number": number,
        "severity": round(truth.severity, 4),
        "snr": round(truth.snr, 2),
        "length_px": round(math.hypot(trail[2] - trail[0], trail[3] - trail[1]), 2),
        "confidence": round(best.confidence, 4) if best else 0.0,
        "off_px": round(math.hypot(best.x_px - middle[0], best.y_px - middle[1]), 3)
        if best
        else None,
        "lost": "" if best else (_kind(refused[0]) if refused else "not proposed"),
        "false": len(strangers),
        "false_confidences": [round(d.confidence, 4) for d in strangers],
        "ms": round(sum(found.stage_ms.values()), 1),
    }


def _kind(refused: Rejection) -> str:
    reason = refused.reason
    return "below tau" if isinstance(reason, BelowTau) else reason.kind


_detectors: list[StreakDetector] = []


def detector() -> StreakDetector:
    """One a process."""
    if not _detectors:
        network = Network.load(None, 1)
        curve = ConfidenceCurve.from_card(network.card)
        _detectors.append(StreakDetector(network, DetectorConfig(threads=1), curve))
    return _detectors[0]


def is_on(found: Detection, trail: Trail) -> bool:
    """Whether a detection is of this streak: its midpoint near the true one, both alike in way."""
    length_px = math.hypot(trail[2] - trail[0], trail[3] - trail[1])
    along, _ = off(found, trail)
    return _is_along(found, trail) and abs(along) < max(_ALONG_SHARE * length_px, _ACROSS_PX)


def _is_along(found: Detection, trail: Trail) -> bool:
    length_px = math.hypot(trail[2] - trail[0], trail[3] - trail[1])
    angle_deg = math.degrees(math.atan2(trail[3] - trail[1], trail[2] - trail[0]))
    leeway_deg = _TURN_DEG + math.degrees(3.0 / max(length_px, 1.0))
    is_alike = line_angle_deg(found.angle_deg, angle_deg % 180.0) < leeway_deg
    return is_alike and abs(off(found, trail)[1]) < _ACROSS_PX


def off(found: Detection, trail: Trail) -> tuple[float, float]:
    """Along and across, px, of the midpoint from the trail's."""
    x, y = 0.5 * (trail[0] + trail[2]), 0.5 * (trail[1] + trail[3])
    angle = math.atan2(trail[3] - trail[1], trail[2] - trail[0])
    dx, dy, c, s = found.x_px - x, found.y_px - y, math.cos(angle), math.sin(angle)
    return dx * c + dy * s, dy * c - dx * s


def run(name: str, count: int, folder: Path, jobs: int) -> None:
    """Every frame of a family that has no row yet."""
    complete(folder / f"{name}.jsonl", partial(row_of, name), count, jobs)


def line_of(name: str, rows: Sequence[dict[str, Any]]) -> str:
    """One line of the table."""
    hits, tries = sum(row["confidence"] > TAU for row in rows), len(rows)
    low, high = share_interval(hits, tries)
    false = sum(row["false"] for row in rows)
    off = [row["off_px"] for row in rows if row["off_px"] is not None]
    family = FAMILIES[name]
    span = "" if family.high == family.low else f" {family.low:g} to {family.high:g}"
    cells = [
        f"{family.title}{span}",
        f"{hits} of {tries}",
        f"{hits / tries:.2f} ({low:.2f}-{high:.2f})",
        f"{statistics.median(off):.2f}" if off else "-",
        f"{100.0 * false / tries:.1f} ({100.0 * rate_interval(false, tries)[1]:.1f})",
        _commonest([row["lost"] for row in rows if row["lost"]]),
    ]
    return "| " + " | ".join(cells) + " |\n"


def _commonest(words: Sequence[str]) -> str:
    return max(set(words), key=words.count) if words else ""


def table(folder: Path) -> str:
    """Of all families that have rows."""
    head = (
        "| family | found | share, 95 % | midpoint px | false in 100 (at most) | mostly lost as |\n"
        "|---|---|---|---|---|---|\n"
    )
    return head + "".join(
        line_of(name, rows) for name in FAMILIES if (rows := read(folder / f"{name}.jsonl"))
    )


def main() -> None:
    """Run what is missing, print the table."""
    parser = parser_of("streaks", __doc__, 300)
    parser.add_argument("families", nargs="+", choices=[*FAMILIES, "all", "table"])
    chosen = parser.parse_args()
    names = list(FAMILIES) if "all" in chosen.families else chosen.families
    for name in (each for each in names if each in FAMILIES):
        run(name, chosen.count, chosen.folder, chosen.jobs)
        print(line_of(name, read(chosen.folder / f"{name}.jsonl")), end="", flush=True)
    if chosen.write:
        keep(chosen.folder, "streaks")
        put_into_page("streaks", table(chosen.folder))


if __name__ == "__main__":
    main()
