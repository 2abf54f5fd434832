"""Places tracks' numbers in a picture, apart from each other and from the streaks.

Geostationary satellites of one slot are a few cells apart: each number stands as near to its streak
as there is room, outwards from the middle of all streaks.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from statistics import fmean
from typing import NamedTuple, get_args

from rsoconsole.console.drawing.plot import TrackInk

Cell = tuple[int, int]
"""(column, row)."""
REACH = 8, 4
"""Columns and rows from a streak within which its number may stand."""
CELL_HEIGHT = 2.0
"""Height of a cell in units of its width."""
OUTWARDS = 0.4
"""Cell widths by which a place outwards from the middle of all streaks counts as nearer."""
_LEFT_OUT = 1.5
"""Cost of a place over another sign, in units of the reach: used where no other is free."""
_INKS: tuple[TrackInk, ...] = get_args(TrackInk)


def track_ink(track_id: int) -> TrackInk:
    """Return the ink of a track's number, wherever it is written."""
    return _INKS[track_id % len(_INKS)]


class NumberedTrack(NamedTuple):
    """Track's number, and the cells of its streak's ends, or twice of its predicted place."""

    text: str
    left: Cell
    right: Cell
    kind: str


def place_track_numbers(
    numbered: Sequence[NumberedTrack],
    size: tuple[int, int],
    taken: Mapping[Cell, object],
    streaks: Collection[Cell],
) -> dict[Cell, tuple[str, str]]:
    """Return where the numbers stand: (column, row) -> (character, kind of mark).

    ``size``: columns and rows of the picture.
    ``taken``: cells with text or signs, which numbers avoid.
    ``streaks``: cells in which no number may stand.
    """
    middles = ((each, _middle(each)) for each in numbered)
    shown = [each for each, (x, y) in middles if 0 <= x < size[0] and 0 <= y < size[1]]
    if not shown:
        return {}
    columns, rows = zip(*map(_middle, shown), strict=True)
    centre = fmean(columns), fmean(rows)
    # The outermost first: they have the room that the inner ones leave.
    order = sorted(shown, key=lambda each: -_away(_middle(each), centre))
    written: dict[Cell, tuple[str, str]] = {}
    for each in order:
        at = _best_place(each, centre, size, taken, streaks, written)
        if at is not None:
            for offset, character in enumerate(each.text):
                written[at[0] + offset, at[1]] = character, each.kind
    return written


def _best_place(  # noqa: PLR0917 -- one call, each argument a different thing
    each: NumberedTrack,
    centre: tuple[float, float],
    size: tuple[int, int],
    taken: Mapping[Cell, object],
    streaks: Collection[Cell],
    written: Mapping[Cell, object],
) -> Cell | None:
    """Return the nearest free place, or one over another sign; None: numbers fill all."""
    columns, rows = size
    wide = len(each.text)
    best: tuple[float, Cell] | None = None
    for row in range(each.left[1] - REACH[1], each.left[1] + REACH[1] + 1):
        for column in range(each.left[0] - REACH[0] - wide, each.right[0] + REACH[0] + 2):
            if not (0 <= row < rows and column >= 0 and column + wide <= columns):
                continue
            cells = [(column + n, row) for n in range(wide)]
            # A number beside another one would read as one.
            if any(at in written for at in ((column - 1, row), *cells, (column + wide, row))):
                continue
            if any(at in streaks for at in cells):
                continue
            cost = _distance(each, cells) - OUTWARDS * _outwards(each, cells, centre)
            cost += sum(_LEFT_OUT * REACH[0] for at in cells if at in taken)
            if best is None or cost < best[0]:
                best = cost, (column, row)
    return None if best is None else best[1]


def _distance(each: NumberedTrack, cells: Sequence[Cell]) -> float:
    """Return the least distance between a number's ends and its streak's, in cell widths."""
    ends = (each.left, each.right)
    return min(_away(cell, end) for cell in (cells[0], cells[-1]) for end in ends)


def _outwards(each: NumberedTrack, cells: Sequence[Cell], centre: tuple[float, float]) -> float:
    """Return the cosine between number and outward direction, seen from the streak: -1 to 1."""
    x, y = _middle(each)
    at = (cells[0][0] + cells[-1][0]) / 2.0 - x, CELL_HEIGHT * (cells[0][1] - y)
    out = x - centre[0], CELL_HEIGHT * (y - centre[1])
    length = math.hypot(*at) * math.hypot(*out)
    return (at[0] * out[0] + at[1] * out[1]) / length if length else 0.0


def _middle(each: NumberedTrack) -> tuple[float, float]:
    return (each.left[0] + each.right[0]) / 2.0, (each.left[1] + each.right[1]) / 2.0


def _away(one: tuple[float, float], other: tuple[float, float]) -> float:
    return math.hypot(one[0] - other[0], CELL_HEIGHT * (one[1] - other[1]))
