"""The tracker beside Stone Soup's on the same detections of real slots.

    python -m tests.campaign.trackers all --seeds 1-20 --write
    python -m tests.campaign.trackers 30W --seeds 1-3 --trackers own GNN
    python -m tests.campaign.trackers table

Each of Stone Soup's trackers runs with the parameters that were best for that slot on nights of
other seeds, of a stated grid; ours with its everyday settings on all. Stop it when you like; the
same command goes on (``--folder``). Without Stone Soup (``requirements-peers.txt``) its rows are
left out. ``--write`` puts the table into README.md and the rows into ``results/trackers``.
"""

import argparse
import importlib.util
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tests.campaign import own_tracker, stone_soup
from tests.campaign.arguments import seeds_of
from tests.campaign.rows_kept import RESULTS, keep, put_into_page, read
from tests.campaign.slots import SLOTS, drawn
from tests.campaign.slots_judge import judged
from tests.campaign.stone_soup import Cell, Method
from tests.campaign.trackers_table import OURS, table

NAME = "trackers"
METHODS: tuple[Method, ...] = ("GNN", "JPDA", "MFA")
CLOSEST = "30W"
TUNED_ON = (101,)
"""Seeds of the nights on which the grid is tried."""
TUNED_ON_ANY = (101, 102, 103, 104)
"""Where each night's shutter is another one."""


class Kept:
    """Rows on disk: one a night and tracker, one a night and cell of the grid."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._path = folder / "rows.jsonl"
        if self._path.exists() and self._path.read_bytes()[-1:] not in {b"", b"\n"}:
            with self._path.open("a", encoding="utf-8") as out:
                out.write("\n")
        self.rows = read(self._path)

    def has(self, slot: str, seed: int, tracker: str, cell: str) -> bool:
        """Whether that was run."""
        return self._of(slot, seed, tracker, cell) is not None

    def gospa(self, slot: str, seed: int, tracker: str, cell: str) -> float:
        """Of a night that was run."""
        row = self._of(slot, seed, tracker, cell)
        assert row is not None
        return float(row["gospa"])

    def add(self, slot: str, seed: int, tracker: str, cell: str, figures: dict[str, Any]) -> None:
        """Put a night on disk."""
        row = {"slot": slot, "seed": seed, "tracker": tracker, "cell": cell, **figures}
        self.rows.append(row)
        with self._path.open("a", encoding="utf-8") as out:
            out.write(json.dumps(row) + "\n")

    def _of(self, slot: str, seed: int, tracker: str, cell: str) -> dict[str, Any] | None:
        key = (slot, seed, tracker, cell)
        return next(
            (r for r in self.rows if (r["slot"], r["seed"], r["tracker"], r["cell"]) == key), None
        )


def best_cell(kept: Kept, slot: str, method: Method) -> Cell:
    """The one with the least GOSPA on the nights that are for this: of the grid, then of its q."""
    found = _best(kept, CLOSEST, method, stone_soup.grid(method))
    is_known = SLOTS[slot].is_shutter_known
    cells = stone_soup.around(found, is_shutter_known=is_known)
    return _best(kept, slot, method, cells, TUNED_ON if is_known else TUNED_ON_ANY)


def _best(
    kept: Kept,
    slot: str,
    method: Method,
    cells: Sequence[Cell],
    seeds: Sequence[int] = TUNED_ON,
) -> Cell:
    for seed in seeds:
        missing = [c for c in cells if not kept.has(slot, seed, method, c.words)]
        night = drawn(slot, seed) if missing else None
        for cell in missing:
            assert night is not None
            figures = judged(night, stone_soup.followed(night, cell))
            kept.add(slot, seed, method, cell.words, figures)
    return min(cells, key=lambda c: sum(kept.gospa(slot, s, method, c.words) for s in seeds))


def run(kept: Kept, slots: Sequence[str], seeds: Sequence[int], trackers: Sequence[str]) -> None:
    """Every night that was not run yet."""
    for slot in slots:
        for tracker in trackers:
            cell = None if tracker == OURS else best_cell(kept, slot, tracker)  # type: ignore[arg-type]
            words = "" if cell is None else cell.words
            for seed in seeds:
                if kept.has(slot, seed, tracker, words):
                    continue
                night = drawn(slot, seed)
                told = (
                    own_tracker.followed(night)
                    if cell is None
                    else stone_soup.followed(night, cell)
                )
                kept.add(slot, seed, tracker, words, judged(night, told))
            print(f"{slot} {tracker} {words}", flush=True)


def main() -> None:
    """Run what is missing, print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("slots", nargs="+", choices=[*SLOTS, "all", "table"])
    parser.add_argument("--seeds", type=seeds_of, default=list(range(1, 21)))
    parser.add_argument("--trackers", nargs="+", default=[OURS, *METHODS], choices=[OURS, *METHODS])
    parser.add_argument("--folder", type=Path, default=Path(".cache/campaign", NAME))
    parser.add_argument("--write", action="store_true", help="into README.md and results/")
    chosen = parser.parse_args()
    trackers = chosen.trackers
    if importlib.util.find_spec("stonesoup") is None and trackers != [OURS]:
        print("Stone Soup is not installed (requirements-peers.txt): left out")
        trackers = [each for each in trackers if each == OURS]
    kept = Kept(chosen.folder)
    slots = list(SLOTS) if "all" in chosen.slots else [s for s in chosen.slots if s in SLOTS]
    run(kept, slots, chosen.seeds, trackers)
    text = table(kept.rows)
    print(text, end="")
    if chosen.write:
        keep(chosen.folder, NAME)
        put_into_page(NAME, text)


KEPT_ROWS = RESULTS / NAME / "rows.jsonl"

if __name__ == "__main__":
    main()
