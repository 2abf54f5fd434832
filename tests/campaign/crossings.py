"""How well trails that run right through a frame are found and where they are said to lie.

    python -m tests.campaign.crossings --count 200 --write
    python -m tests.campaign.crossings --count 20 --jobs 1

One trail a frame, a quarter of full size, on the sky of the model card's test split. Every other
one has a ridge SNR of 3, by which offset and angle are judged, the rest one of 1.5 to 30. Stop it
when you like; the same command goes on (``--folder``). ``--write`` puts the table into README.md
and the rows into ``results/crossings``.
"""

import math
import statistics
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from models.altered import QUARTER
from models.fields import clip_to_box
from models.frames import noise_electrons, sky_field
from models.intervals import share_interval
from rsoconsole.records import Detection, Frame
from rsoconsole.simulator import FWHM_PER_SIGMA, FieldContent, frame_rng, render, straight_streak
from rsoconsole.sky import line_angle_deg
from tests.campaign.rows_kept import complete, keep, parser_of, put_into_page, read
from tests.campaign.streaks import TAU, Trail, detector, off

RIDGE_SNR, JUDGED_SNR = (1.5, 30.0), 3.0
SHORTEST_PX = 300.0
"""Of what the frame shows of it: a trail through a corner is a short streak."""
_ACROSS_PX, _TURN_DEG = 6.0, 1.0
_BANDS = ((1.5, 2.0), (2.0, 3.0), (JUDGED_SNR, JUDGED_SNR), (3.0, 30.0))
_SEED = 20261124


def draw(number: int) -> tuple[Frame, Trail, float]:
    """A frame, where its trail enters and leaves it (pixels, 0-based), and its ridge SNR."""
    rng = frame_rng(_SEED, number)
    content = sky_field("test", "satellites", QUARTER, rng)
    low, high = RIDGE_SNR
    snr = math.exp(float(rng.uniform(math.log(low), math.log(high))))
    snr = JUDGED_SNR if number % 2 else snr
    reach = math.hypot(QUARTER.width_px, QUARTER.height_px)
    while True:
        x, y = float(rng.uniform(0, QUARTER.width_px)), float(rng.uniform(0, QUARTER.height_px))
        angle = float(rng.uniform(0.0, math.pi))
        dx, dy = reach * math.cos(angle), reach * math.sin(angle)
        seen = clip_to_box(
            (x - dx + 0.5, y - dy + 0.5, x + dx + 0.5, y + dy + 0.5),
            QUARTER.width_px,
            QUARTER.height_px,
        )
        if seen is not None and math.hypot(seen[2] - seen[0], seen[3] - seen[1]) > SHORTEST_PX:
            break
    light = snr * noise_electrons(QUARTER, content) / peak_share(content) * 2.0 * reach
    streak = straight_streak((x - dx, y - dy), (x + dx, y + dy), light)
    frame = Frame(
        frame_id=number,
        name=f"crossing-{number}",
        pixels=render(QUARTER, replace(content, streaks=(streak,)), frame_rng(_SEED, number, 1)),
        exposure_s=content.exposure_s,
        scale_arcsec_px=QUARTER.scale_arcsec_px,
        saturation_adu=QUARTER.saturation_adu,
    )
    x_a, y_a, x_b, y_b = (at - 0.5 for at in seen)
    return frame, (x_a, y_a, x_b, y_b), snr


def peak_share(content: FieldContent) -> float:
    """Of the light of one pixel's length, what falls on the pixel in the middle of the cut."""
    return math.erf(0.5 * FWHM_PER_SIGMA / (math.sqrt(2.0) * content.fwhm_px))


def row_of(number: int) -> dict[str, Any]:
    """One frame through the detector that the engine has."""
    frame, trail, snr = draw(number)
    found = detector().detect(frame, tau=TAU)
    offs = {d: lies_off(d, trail) for d in found.detections}
    near = [d for d, (across, turn) in offs.items() if across < _ACROSS_PX and turn < _TURN_DEG]
    best = max(near, key=lambda d: d.length_px, default=None)
    return {
        "number": number,
        "ridge_snr": round(snr, 3),
        "length_px": round(math.hypot(trail[2] - trail[0], trail[3] - trail[1]), 1),
        "kind": best.kind if best else "",
        "confidence": round(best.confidence, 4) if best else 0.0,
        "offset_px": round(offs[best][0], 4) if best else None,
        "sigma_across_px": round(best.sigma_across_px, 4) if best else None,
        "turn_deg": round(offs[best][1], 5) if best else None,
        "sigma_turn_deg": best.sigma_angle_deg if best else None,
        "false": len(found.detections) - len(near),
    }


def lies_off(found: Detection, trail: Trail) -> tuple[float, float]:
    """Across at the midpoint that was found, px, and turned, deg: both without a sign."""
    angle_deg = math.degrees(math.atan2(trail[3] - trail[1], trail[2] - trail[0])) % 180.0
    return abs(off(found, trail)[1]), line_angle_deg(found.angle_deg, angle_deg)


def line_of(band: tuple[float, float], rows: Sequence[dict[str, Any]]) -> str:
    """One line of the table."""
    hits = [row for row in rows if row["confidence"] > TAU]
    low, high = share_interval(len(hits), len(rows))
    whole = sum(row["kind"] == "crossing" for row in hits)
    cells = [
        f"{band[0]:g}" if band[0] == band[1] else f"{band[0]:g} to {band[1]:g}",
        f"{len(hits)} of {len(rows)}",
        f"{len(hits) / len(rows):.2f} ({low:.2f}-{high:.2f})",
        str(whole),
        f"{statistics.median(row['offset_px'] for row in hits):.3f}" if hits else "-",
        f"{statistics.median(row['turn_deg'] for row in hits):.4f}" if hits else "-",
        str(sum(row["false"] for row in rows)),
    ]
    return "| " + " | ".join(cells) + " |\n"


def table(rows: Sequence[dict[str, Any]]) -> str:
    """By ridge SNR; those of 3, by which offset and angle are judged, apart."""
    text = (
        "| ridge SNR | found | share, 95 % | said to be a crossing | offset px | angle deg |"
        " false |\n|---|---|---|---|---|---|---|\n"
    )
    for low, high in _BANDS:
        if low == high:
            some = [row for row in rows if row["ridge_snr"] == low]
        else:
            some = [row for row in rows if low <= row["ridge_snr"] < high]
            some = [row for row in some if row["ridge_snr"] != JUDGED_SNR]
        text += line_of((low, high), some) if some else ""
    return text


def main() -> None:
    """Run what is missing, print the table."""
    chosen = parser_of("crossings", __doc__, 200).parse_args()
    path = chosen.folder / "rows.jsonl"
    complete(path, row_of, chosen.count, chosen.jobs)
    text = table(read(path))
    print(text, end="")
    if chosen.write:
        keep(chosen.folder, "crossings")
        put_into_page("crossings", text)


if __name__ == "__main__":
    main()
