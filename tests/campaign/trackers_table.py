"""The table of trackers on the same nights, with intervals by resampling the nights."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rsoconsole.records import FloatArray
from tests.campaign.slots import SLOTS

OURS = "own"
Row = Mapping[str, Any]
_DRAWS, _SEED = 4000, 20261125
TUNED_FROM_SEED = 100
"""Nights of higher seeds were for the choice of parameters: they are in no figure."""


def nights_of(rows: Sequence[Row], slot: str, tracker: str) -> dict[int, Row]:
    """By seed: the nights of a tracker; of a peer those of its best cell."""
    return {
        row["seed"]: row
        for row in rows
        if row["slot"] == slot and row["tracker"] == tracker and row["seed"] <= TUNED_FROM_SEED
    }


def interval(values: FloatArray) -> tuple[float, float, float]:
    """Mean and 95 % interval, by resampling the nights."""
    random = np.random.default_rng(_SEED)
    means = values[random.integers(0, len(values), (_DRAWS, len(values)))].mean(axis=1)
    low, high = np.percentile(means, [2.5, 97.5])
    return float(values.mean()), float(low), float(high)


def swaps_of(rows: Sequence[Row]) -> tuple[float, float, float]:
    """Swaps in 1,000 track-frames, with an interval by resampling the nights."""
    random = np.random.default_rng(_SEED)
    swaps, frames = np.array([[r["swaps"], r["taken"]] for r in rows], float).T
    chosen = random.integers(0, len(rows), (_DRAWS, len(rows)))
    each = 1000.0 * swaps[chosen].sum(axis=1) / frames[chosen].sum(axis=1)
    low, high = np.percentile(each, [2.5, 97.5])
    return float(1000.0 * swaps.sum() / frames.sum()), float(low), float(high)


def paired_gospa(rows: Sequence[Row], slot: str, peer: str) -> FloatArray:
    """Ours minus a peer's on the same nights, arcsec: below 0 where ours is better."""
    ours, theirs = nights_of(rows, slot, OURS), nights_of(rows, slot, peer)
    both = sorted(ours.keys() & theirs.keys())
    return np.array([ours[s]["gospa"] - theirs[s]["gospa"] for s in both])


def table(rows: Sequence[Row]) -> str:
    """One line a slot and tracker; then how ours stands to each over all slots."""
    text = (
        "| slot | tracker | nights | GOSPA, 95 % | ours minus its, 95 % | swaps in 1,000, 95 % "
        "| streaks taken | its parameters |\n|---|---|---|---|---|---|---|---|\n"
    )
    trackers = list(dict.fromkeys([OURS, *(row["tracker"] for row in rows)]))
    for slot, each in SLOTS.items():
        for tracker in trackers:
            nights = list(nights_of(rows, slot, tracker).values())
            if nights:
                text += _line(each.title, rows, [slot], tracker, nights)
    for title, is_known in (("**all**", True), ("**all, any shutter**", False)):
        slots = [name for name, each in SLOTS.items() if each.is_shutter_known == is_known]
        for tracker in trackers:
            nights = [n for slot in slots for n in nights_of(rows, slot, tracker).values()]
            if nights:
                text += _line(title, rows, slots, tracker, nights)
    return text


def _line(
    title: str, rows: Sequence[Row], slots: Sequence[str], tracker: str, nights: Sequence[Row]
) -> str:
    apart = np.concatenate([paired_gospa(rows, each, tracker) for each in slots])
    is_peer = tracker != OURS and len(apart)
    taken = sum(n["taken"] for n in nights) / sum(n["shown"] for n in nights)
    cells = [
        title,
        "rsoconsole" if tracker == OURS else f"Stone Soup {tracker}",
        str(len(nights)),
        _said(interval(np.array([n["gospa"] for n in nights])), '"'),
        _said(interval(apart), '"', "+") if is_peer else "",
        _said(swaps_of(nights)),
        f"{100.0 * taken:.1f} %",
        nights[0]["cell"] if len(slots) == 1 else "",
    ]
    return "| " + " | ".join(cells) + " |\n"


def _said(value: tuple[float, float, float], unit: str = "", sign: str = "") -> str:
    mean, low, high = value
    return f"{mean:{sign}.2f}{unit} ({low:{sign}.2f} to {high:{sign}.2f})"
