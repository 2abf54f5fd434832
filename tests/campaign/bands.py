"""Streaks by bands: by signal to noise and length, and by thirds of scale and of exposure.

    python -m tests.campaign.streaks limit telescope --count 900
    python -m tests.campaign.bands --write

Of the rows that the first command made: full-size frames as they are, with streaks near the limit;
and frames of any telescope, another one in each.
"""

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from models.intervals import share_interval
from models.telescopes import Telescope, telescope
from tests.campaign.rows_kept import put_into_page, read
from tests.campaign.streaks import TAU

WAYS: dict[str, Callable[[Telescope], float]] = {
    "scale, arcsec/px": lambda seen: seen.sensor.scale_arcsec_px,
    "exposure, s": lambda seen: seen.exposure_s,
}
SNR, LENGTHS_PX = ((9, 12), (12, 15), (15, 20), (20, 25)), ((30, 60), (60, 300))


@dataclass(frozen=True, slots=True, kw_only=True)
class Third:
    """Telescopes between two bounds: what was said of their detections and what is true."""

    bounds: str
    streaks: int
    found: int
    said: float
    """Mean confidence of the detections above tau."""
    share: float
    """Share of them that are of a streak."""


def thirds(rows: Sequence[dict[str, Any]]) -> list[Third]:
    """Each third of the rows by each of ``WAYS``."""
    found = []
    for title, value_of in WAYS.items():
        values = np.array([value_of(telescope(row["severity"])) for row in rows])
        for part in np.array_split(np.argsort(values), 3):
            of_part = [rows[i] for i in part]
            true = [row["confidence"] for row in of_part if row["confidence"] > TAU]
            false = [said for row in of_part for said in row["false_confidences"]]
            count = max(len(true) + len(false), 1)
            found.append(
                Third(
                    bounds=f"{title} {values[part[0]]:.2g} to {values[part[-1]]:.2g}",
                    streaks=len(of_part),
                    found=len(true),
                    said=(sum(true) + sum(false)) / count,
                    share=len(true) / count,
                )
            )
    return found


def of_telescopes(rows: Sequence[dict[str, Any]]) -> str:
    """All thirds as a table."""
    head = "| telescopes | found | mean confidence | share true |\n|---|---|---|---|\n"
    return head + "".join(
        f"| {each.bounds} | {each.found} of {each.streaks} | {each.said:.3f} | {each.share:.3f} |\n"
        for each in thirds(rows)
    )


def at_the_limit(rows: Sequence[dict[str, Any]]) -> str:
    """Found streaks by signal to noise and length as a table."""
    head = "| SNR |" + "".join(f" {low} to {high} px |" for low, high in LENGTHS_PX)
    lines = [head, "|---|" + "---|" * len(LENGTHS_PX)]
    for low, high in SNR:
        cells = [f"{low} to {high}"]
        for short, long in LENGTHS_PX:
            of_cell = [
                row["confidence"] > TAU
                for row in rows
                if low <= row["snr"] < high and short <= row["length_px"] < long
            ]
            hits, tries = sum(of_cell), max(len(of_cell), 1)
            least, most = share_interval(hits, tries)
            cells.append(f"{hits} of {tries}: {hits / tries:.2f} ({least:.2f}-{most:.2f})")
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--folder", type=Path, default=Path(".cache/campaign/streaks"))
    parser.add_argument("--write", action="store_true", help="into README.md")
    chosen = parser.parse_args()
    for name, table in (("limit", at_the_limit), ("telescope", of_telescopes)):
        rows = read(chosen.folder / f"{name}.jsonl")
        if rows:
            text = table(rows)
            print(text)
            if chosen.write:
                put_into_page(name, text)


if __name__ == "__main__":
    main()
