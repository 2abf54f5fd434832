"""One judge for every tracker: GOSPA of where its tracks are, and whose streaks they take.

GOSPA: Rahmathullah, Garcia-Fernandez & Svensson 2017, "Generalized optimal sub-pattern assignment
metric", with alpha 2; as Stone Soup computes it (``tests/project/test_campaign_slots.py``
compares).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from rsoconsole.records import FloatArray
from tests.campaign.slots import Night

CUT_ARCSEC, POWER = 20.0, 2.0
FROM_FRAME = 3
"""The first that is judged, from 0: every tracker may need three frames to begin."""


@dataclass(frozen=True, slots=True, kw_only=True)
class At:
    """One track after one frame."""

    track_id: int
    place: tuple[float, float]
    """Arcsec east and north."""
    taken: str | None
    """Id of the measurement that it took; of several that weighed in, the heaviest."""


def gospa(found: FloatArray, true: FloatArray, cut: float = CUT_ARCSEC) -> float:
    """Distance of two sets of places (N, 2) and (M, 2), arcsec."""
    found, true = np.reshape(found, (-1, 2)), np.reshape(true, (-1, 2))
    away = np.linalg.norm(found[:, None] - true[None], axis=-1)
    cost = np.minimum(away, cut) ** POWER
    rows, columns = linear_sum_assignment(cost)
    unpaired = len(found) + len(true) - 2 * len(rows)
    total = float(cost[rows, columns].sum()) + unpaired * cut**POWER / 2.0
    return float(total ** (1.0 / POWER))


def judged(night: Night, told: Sequence[Sequence[At]]) -> dict[str, Any]:
    """A night's figures: ``told`` has the tracks after each frame.

    A swap: a track takes a streak of another satellite than the one whose it took last.
    """
    distances, swaps, taken, shown = [], 0, 0, 0
    whose: dict[int, int] = {}
    for k, tracks in enumerate(told):
        owners = _owners(tracks, night.owner)
        if k >= FROM_FRAME:
            places = np.array([each.place for each in tracks])
            distances.append(gospa(places, night.truth[k]))
            swaps += sum(whose.get(track, owner) != owner for track, owner in owners.items())
            taken += len(set(owners.values()))
            shown += sum(m.measurement_id in night.owner for m in night.frames[k].measurements)
        whose |= owners
    return {
        "gospa": round(math.fsum(distances) / len(distances), 4),
        "swaps": swaps,
        "taken": taken,
        "shown": shown,
        "tracks": len({each.track_id for tracks in told for each in tracks}),
    }


def _owners(tracks: Sequence[At], owner: Mapping[str, int]) -> dict[int, int]:
    return {
        each.track_id: owner[each.taken]
        for each in tracks
        if each.taken is not None and each.taken in owner
    }
