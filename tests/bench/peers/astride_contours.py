"""ASTRiDE: contours of the frame above its sky, long and thin ones kept (Kim 2016).

It gives no score: what it measures of a contour ranks. It links contours of one slope across any
distance; ``is_linked`` says whether linked ones are one streak or only those that touch are.
"""

import sys
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from rsoconsole.records import Frame
from tests.bench.peers.joining import joined, union
from tests.bench.peers.scoring import Candidate, Line

SETTINGS: Mapping[str, Any] = {
    "remove_bkg": "map",
    "contour_threshold": 1.5,
    "min_points": 10,
    "shape_cut": 0.2,
    "area_cut": 20.0,
    "radius_dev_cut": 0.5,
    "connectivity_angle": 3.0,
    "is_linked": False,
    "rank": "area",
}
"""As documented, with a background that varies; fainter contours, which serve it best."""
GRID: tuple[Mapping[str, Any], ...] = (
    {"contour_threshold": 3.0},
    {"contour_threshold": 2.0},
    {"rank": "length"},
    {"rank": "thinness"},
    {"is_linked": True},
    {"radius_dev_cut": 0.4, "shape_cut": 0.3},
)


def open_peer(settings: Mapping[str, Any]) -> Callable[[Frame], list[Candidate]]:
    """Its own file reader, background, contours and cuts; segments of its fitted line."""
    # Its comparisons of texts by identity are told at compile time.
    warnings.simplefilter("ignore", SyntaxWarning)
    from astride import Streak
    from astropy.io import fits

    # Contours that close on themselves have no area, upright ones no slope: it says so for each.
    warnings.simplefilter("ignore", RuntimeWarning)
    chosen = {**SETTINGS, **settings}
    rank, is_linked = chosen.pop("rank"), chosen.pop("is_linked")
    # It compares this one by identity, which a text out of JSON does not have.
    chosen["remove_bkg"] = sys.intern(chosen["remove_bkg"])

    def find(frame: Frame) -> list[Candidate]:
        with TemporaryDirectory() as folder:
            path = Path(folder) / "frame.fits"
            fits.PrimaryHDU(frame.pixels).writeto(path)
            streak = Streak(str(path), **chosen)
            streak.detect()
        edges = [edge for edge in streak.streaks if np.all(np.isfinite(edge["extreme_points"]))]
        found = [_as_candidate(edge, rank) for edge in edges]
        return _linked(edges, found) if is_linked else joined(found)

    return find


def _as_candidate(edge: Mapping[str, Any], rank: str) -> Candidate:
    (x_a, y_a), (x_b, y_b) = edge["extreme_points"]
    line = Line(x_a_px=float(x_a), y_a_px=float(y_a), x_b_px=float(x_b), y_b_px=float(y_b))
    ranks = {
        "area": float(edge["area"]),
        "length": line.length_px,
        "thinness": 1.0 / max(float(edge["shape_factor"]), 1e-6),
    }
    return Candidate(line=line, score=ranks[rank])


def _linked(edges: Sequence[Mapping[str, Any]], found: Sequence[Candidate]) -> list[Candidate]:
    """Chains of its links as one streak each, with the best score among them."""
    at = {edge["index"]: place for place, edge in enumerate(edges)}
    group_of = list(range(len(edges)))
    # A link leads to a later edge: from the last to the first, every chain ends in one group.
    for place in reversed(range(len(edges))):
        group_of[place] = group_of[at.get(edges[place]["connectivity"], place)]
    groups: dict[int, list[Candidate]] = {}
    for group, candidate in zip(group_of, found, strict=True):
        groups.setdefault(group, []).append(candidate)
    ranked = [sorted(group, key=lambda c: -c.score) for group in groups.values()]
    return [Candidate(line=union(group), score=group[0].score) for group in ranked]
