"""Whose light it was: a satellite's that has moved on is no star's.

Satellites of a slot draw streaks that are as long, in the same direction. Where one follows another
by what both go between two frames, the second lies where the first has been: the same light at the
same place of the sky, as stars have it. But the first has left: a streak like it lies further on by
its length times cadence over exposure. Stars in a row have no such heir.
"""

import math

import numpy as np

from rsoconsole.pipeline.comparison.solved_field import SolvedField, to_field
from rsoconsole.records import Detection, FloatArray
from rsoconsole.sky import turn_deg
from rsoconsole.vision.stars import StarList

_SAME_WAY_DEG, _SAME_LENGTH = 10.0, 1.4
"""Turn and ratio of lengths up to which two streaks are of one motion."""
_BESIDE_SHARE, _BESIDE_FWHM = 0.12, 2.0
"""Of its way, or in widths of a star, by which what has moved on may lie beside where it should:
where the mount drifts, a streak is as long and as turned as the drift makes it, the way is not."""


def has_moved_on(streak: Detection, here: SolvedField, before: SolvedField, later_s: float) -> bool:
    """Whether what lay at a streak's place in the frame before is another streak of this frame.

    ``later_s``: from the middle of that exposure to the middle of this one.
    """
    exposure_s = before.frame.exposure_s
    if not exposure_s:
        return False
    way_per_length = later_s / exposure_s
    others = [each for each in here.streaks if each != streak and _is_alike(each, streak)]
    return any(
        _leads(earlier, other, streak, way_per_length, here.stars)
        for earlier in _at_its_place(streak, here, before)
        for other in others
    )


def _is_alike(one: Detection, other: Detection) -> bool:
    if one.kind != "streak" or min(one.length_px, other.length_px) <= 0.0:
        return False
    ratio = one.length_px / other.length_px
    turned = abs(turn_deg(one.angle_deg, other.angle_deg))
    return 1.0 / _SAME_LENGTH < ratio < _SAME_LENGTH and turned < _SAME_WAY_DEG


def _at_its_place(
    streak: Detection, here: SolvedField, before: SolvedField
) -> list[tuple[float, float, float]]:
    """Middles (x, y) on this frame, and lengths, of earlier streaks that overlap with it."""
    found = []
    for each in before.streaks:
        if not _is_alike(each, streak):
            continue
        x, y = to_field(before, here, _one(each.x_px), _one(each.y_px))
        if math.hypot(x[0] - streak.x_px, y[0] - streak.y_px) < streak.length_px:
            found.append((float(x[0]), float(y[0]), each.length_px))
    return found


def _leads(
    earlier: tuple[float, float, float],
    other: Detection,
    streak: Detection,
    way_per_length: float,
    stars: StarList,
) -> bool:
    """Whether the other one lies where the earlier streak's own motion has brought it."""
    x, y, length_px = earlier
    way_px = length_px * way_per_length
    dx, dy = other.x_px - x, other.y_px - y
    angle = math.radians(streak.angle_deg)
    along = dx * math.cos(angle) + dy * math.sin(angle)
    across = dy * math.cos(angle) - dx * math.sin(angle)
    beside_px = max(_BESIDE_SHARE * way_px, _BESIDE_FWHM * stars.median_fwhm_px)
    return max(abs(abs(along) - way_px), abs(across)) < beside_px


def _one(value: float) -> FloatArray:
    return np.array([value])
