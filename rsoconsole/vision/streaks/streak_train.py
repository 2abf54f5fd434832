"""Streaks of one frame that run together: trains of satellites, and the lights of one aircraft."""

import math
from collections.abc import Sequence
from dataclasses import replace

from rsoconsole.records import Detection
from rsoconsole.sky import turn_deg

LEAST_CUT, LEAST_WHOLE = 2, 3
"""Lines that make a train: where the frame cuts two of them, and where it does not."""
SLOWEST_DEG_S = 0.05
"""Whole ones slower than this are neighbours in a slot, which run alike for ever."""
_PARALLEL_DEG, _SIGMAS = 1.0, 4.0
_SAME_LENGTH = 0.15
_LIGHTS_APART = 0.5
"""Most that the lights of one aircraft are apart, over the length of its trail."""
_TRAIN = ("satellite", "undetermined")


def with_context(
    streaks: Sequence[Detection], deg_s_per_px: float | None = None
) -> list[Detection]:
    """The same, each with what its company makes of it.

    What runs beside an aircraft, parallel and near, is another of its lights. What may be
    satellites and runs in parallel is a train; of whole streaks only where ``deg_s_per_px``
    (scale over exposure) tells that they are too fast for neighbours in a slot.
    """
    seen = [_as_its_light(each, streaks) for each in streaks]
    may_be = [
        each
        for each in seen
        if each.object_class in _TRAIN
        and each.method != "operator"
        and (each.kind != "streak" or each.length_px * (deg_s_per_px or 0.0) > SLOWEST_DEG_S)
    ]
    return [replace(each, train=_train(each, may_be)) for each in seen]


def _as_its_light(one: Detection, streaks: Sequence[Detection]) -> Detection:
    if one.object_class not in _TRAIN or one.method == "operator":
        return one
    beside = [
        other.class_probability
        for other in streaks
        if other.object_class == "aircraft" and _is_parallel(one, other) and _is_near(one, other)
    ]
    if not beside:
        return one
    return replace(one, object_class="aircraft", class_probability=max(beside))


def _train(one: Detection, streaks: Sequence[Detection]) -> int:
    if one not in streaks:
        return 0
    alike = [
        each
        for each in streaks
        if each is one or (_is_parallel(one, each) and _is_as_long(one, each))
    ]
    is_cut = sum(each.kind != "streak" for each in alike) >= LEAST_CUT
    return len(alike) if len(alike) >= (LEAST_CUT if is_cut else LEAST_WHOLE) else 0


def _is_parallel(one: Detection, other: Detection) -> bool:
    """Whether they run alike, as far as both directions are known."""
    error = math.hypot(one.sigma_angle_deg or 0.0, other.sigma_angle_deg or 0.0)
    return turn_deg(one.angle_deg, other.angle_deg) < _PARALLEL_DEG + _SIGMAS * error


def _is_as_long(one: Detection, other: Detection) -> bool:
    """Whether they are of one length, which what the frame cuts may be."""
    if "streak" not in {one.kind, other.kind} or one.kind != other.kind:
        return True
    longer = max(one.length_px, other.length_px)
    return abs(one.length_px - other.length_px) < _SAME_LENGTH * longer


def _is_near(one: Detection, other: Detection) -> bool:
    apart_px = math.hypot(one.x_px - other.x_px, one.y_px - other.y_px)
    return apart_px < _LIGHTS_APART * max(one.length_px, other.length_px)
