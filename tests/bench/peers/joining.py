"""Several segments of one streak made one, for peers that give its two edges or its pieces."""

from collections.abc import Sequence

import numpy as np

from tests.bench.peers.scoring import Candidate, Line, turn_deg

_ACROSS_PX, _GAP_PX, _TURN_DEG = 8.0, 8.0, 12.0


def joined(candidates: Sequence[Candidate]) -> list[Candidate]:
    """Segments on one line as one, from the first end to the last, with the best score."""
    left = sorted(candidates, key=lambda c: -c.score)
    whole: list[Candidate] = []
    while left:
        best = left.pop(0)
        group = [best]
        for other in list(left):
            if _is_on(best.line, other.line):
                group.append(other)
                left.remove(other)
        whole.append(Candidate(line=union(group), score=best.score))
    return whole


def _frame_of(line: Line) -> tuple[float, float, float, float]:
    angle = np.radians(line.angle_deg)
    return (*line.middle_px, float(np.cos(angle)), float(np.sin(angle)))


def _is_on(line: Line, other: Line) -> bool:
    if turn_deg(line.angle_deg, other.angle_deg) > _TURN_DEG:
        return False
    x, y, cos, sin = _frame_of(line)
    dx, dy = other.middle_px[0] - x, other.middle_px[1] - y
    reach_px = (line.length_px + other.length_px) / 2 + _GAP_PX
    return abs(dy * cos - dx * sin) < _ACROSS_PX and abs(dx * cos + dy * sin) < reach_px


def union(group: Sequence[Candidate]) -> Line:
    """From the first end to the last along the first one's axis."""
    x, y, cos, sin = _frame_of(group[0].line)
    ends = [
        point
        for each in group
        for point in (
            (each.line.x_a_px - x, each.line.y_a_px - y),
            (each.line.x_b_px - x, each.line.y_b_px - y),
        )
    ]
    along = [dx * cos + dy * sin for dx, dy in ends]
    across = float(np.mean([dy * cos - dx * sin for dx, dy in ends]))
    first, last = min(along), max(along)
    return Line(
        x_a_px=x + first * cos - across * sin,
        y_a_px=y + first * sin + across * cos,
        x_b_px=x + last * cos - across * sin,
        y_b_px=y + last * sin + across * cos,
    )
