"""Whether two detections are one streak. Pure."""

import numpy as np
import numpy.typing as npt

from rsoconsole.records import Detection, FloatArray
from rsoconsole.sky import turn_deg
from rsoconsole.vision.detector.network import NetworkBox

BoolArray = npt.NDArray[np.bool_]

SAME_STREAK_DEG, _SAME_WIDTHS, _LEAST_WIDTH_PX = 10.0, 1.5, 2.0
"""Turn, and distance across in widths of it, with a least width in px."""
_RUNS_ALIKE_DEG = 6.0
"""What a proposal's direction is worth."""


def distinct(found: list[tuple[NetworkBox, ...]]) -> tuple[NetworkBox, ...]:
    """Candidates of maps of several blocks, each streak once, at its most confident."""
    if len(found) == 1:
        return found[0]
    boxes = sorted((b for each in found for b in each), key=lambda b: -b.confidence)
    if not boxes:
        return ()
    same = _are_same(np.array([ends_of_box(box) for box in boxes]))
    is_kept = np.zeros(len(boxes), dtype=bool)
    for i in range(len(boxes)):
        is_kept[i] = not (same[i] & is_kept).any()
    return tuple(box for box, is_one in zip(boxes, is_kept.tolist(), strict=True) if is_one)


def _are_same(ends: FloatArray) -> BoolArray:
    """``is_same_streak`` of every box with every other, (n, n); ``ends`` (n, 4)."""
    along = ends[:, 2:] - ends[:, :2]
    middle, lengths = 0.5 * (ends[:, 2:] + ends[:, :2]), np.hypot(along[:, 0], along[:, 1])
    cos, sin = (along / np.maximum(lengths, 1e-6)[:, None]).T
    cross = np.abs(cos[:, None] * sin[None] - sin[:, None] * cos[None])
    turn = np.degrees(np.arcsin(np.minimum(cross, 1.0)))
    shortest = np.maximum(np.minimum(lengths[:, None], lengths[None]), 1.0)
    off = middle[:, None] - middle[None]
    # Of row i on the line of column j.
    place = np.abs(off[..., 0] * cos + off[..., 1] * sin)
    across = np.abs(off[..., 1] * cos - off[..., 0] * sin)
    lies = (across < _SAME_WIDTHS * _LEAST_WIDTH_PX) & (place < 0.5 * lengths + 1.0)
    return np.asarray((turn <= SAME_STREAK_DEG + np.degrees(2.0 / shortest)) & (lies | lies.T))


def is_same_streak(one: Detection, other: Detection) -> bool:
    """True when the midpoint of either lies on the other's line, and both run alike."""
    turn = turn_deg(one.angle_deg, other.angle_deg)
    shortest = max(min(one.length_px, other.length_px), 1.0)
    if turn > SAME_STREAK_DEG + float(np.degrees(2.0 / shortest)):
        return False
    return _lies_on(one, other) or _lies_on(other, one)


def runs_alike(one: Detection, others: list[Detection]) -> bool:
    """Whether any of ``others`` may have the direction of a proposal."""
    turns = (turn_deg(one.angle_deg, other.angle_deg) for other in others)
    return any(turn < _RUNS_ALIKE_DEG for turn in turns)


def _lies_on(one: Detection, other: Detection) -> bool:
    angle = np.radians(other.angle_deg)
    dx, dy = one.x_px - other.x_px, one.y_px - other.y_px
    along = abs(dx * np.cos(angle) + dy * np.sin(angle))
    across = abs(dy * np.cos(angle) - dx * np.sin(angle))
    reach_px = _SAME_WIDTHS * max(other.width_px, _LEAST_WIDTH_PX)
    return bool(across < reach_px and along < 0.5 * other.length_px + 1.0)


def ends_of_box(box: NetworkBox) -> tuple[float, float, float, float]:
    return box.x_a_px, box.y_a_px, box.x_b_px, box.y_b_px
