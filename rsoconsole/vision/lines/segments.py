"""Straight segments by both ends, and boxes, in pixels of a frame; 0 is the first one's centre."""

import math

Ends = tuple[float, float, float, float]
"""Ends of a segment: x_a, y_a, x_b, y_b."""
Box = tuple[float, float, float, float]
"""Box of least and largest column and row: x0, y0, x1, y1."""


def length_of(ends: Ends) -> float:
    """Length from end to end, px."""
    return math.hypot(ends[2] - ends[0], ends[3] - ends[1])


def midpoint_of(ends: Ends) -> tuple[float, float]:
    """Column and row of the midpoint of a segment."""
    return 0.5 * (ends[0] + ends[2]), 0.5 * (ends[1] + ends[3])


def box_about(*segments: Ends) -> Box:
    """Return the smallest box that holds all of these segments or boxes."""
    x = [each[at] for each in segments for at in (0, 2)]
    y = [each[at] for each in segments for at in (1, 3)]
    return min(x), min(y), max(x), max(y)
