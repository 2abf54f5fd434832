"""Marks over a frame that is processed again: as recorded, and by the new result."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from rsoconsole.console.picture.marks import SHOWN_REJECTED, Mark, frame_marks, streak_mark
from rsoconsole.night import NightFrame

if TYPE_CHECKING:
    from rsoconsole.pipeline import ComparedCandidate, JudgedCandidate

FAINT_FROM_PX = 3.0
"""Pixels a square above which points are drawn beyond a streak's ends while it is marked."""
BEYOND_SQUARES = 2.0
"""Distance of those points from the streak's ends, in squares."""
OUTSIDE_PX = -1e6
"""Place, outside the frame, of a mark that consists of outline points alone."""
BOX_POINTS = 24
SAME_PLACE_PX = 10.0
Box = tuple[float, float, float, float]


def reprocessed_frame_marks(
    detail: NightFrame, candidates: Sequence["ComparedCandidate"], chosen: int | None
) -> tuple[Mark, ...]:
    """Return the marks: boxes of the network, recorded marks, and marks of the new processing.

    New candidates that were rejected are left out, unless they are likely enough to be worth a look
    or chosen. ``chosen``: index among ``candidates``; None: none.
    """
    then = list(frame_marks(detail))
    now: list[Mark] = []
    for number, pair in enumerate(candidates):
        is_chosen = number == chosen
        if pair.now is not None:
            streak = pair.now.detection
            if pair.now.is_taken or is_chosen or streak.confidence >= SHOWN_REJECTED:
                now.append(_mark_now(pair.now, pair.is_as_recorded))
        elif is_chosen and pair.was is not None:
            then.append(streak_mark(pair.was.detection, "rejected"))
    boxes = (
        Mark(x_px=each.x_px, y_px=each.y_px, kind="box", outline_px=box_points(each.box_px))
        for each in detail.detected_streaks
    )
    return (*boxes, *(_making_room(mark, now) for mark in then), *now)


def _mark_now(judged: "JudgedCandidate", is_as_recorded: bool) -> Mark:
    mark = streak_mark(judged.detection, "now" if judged.is_taken else "now_rejected")
    return replace(mark, is_outer=True, label="=" if is_as_recorded else mark.label)


def _making_room(mark: Mark, others: list[Mark]) -> Mark:
    """Return the mark with its label a cell further out, where another sign stands about it."""
    is_within = any(
        max(abs(mark.x_px - other.x_px), abs(mark.y_px - other.y_px)) < SAME_PLACE_PX
        for other in others
    )
    return replace(mark, gap=1) if is_within else mark


def lead_place_px(detail: NightFrame) -> tuple[float, float] | None:
    """Return the lead's (x, y), pixels: measured, else predicted; None: not in the frame."""
    if detail.accepted_measurement is not None:
        return detail.accepted_measurement.x_px, detail.accepted_measurement.y_px
    size, marks = detail.detections, frame_marks(detail)
    if size is None:
        return None
    places = (
        (m.x_px, m.y_px) for kind in ("predicted", "coasted") for m in marks if m.kind == kind
    )
    inside = (at for at in places if 0 <= at[0] < size.width_px and 0 <= at[1] < size.height_px)
    return next(inside, None)


def marks_beyond_streak_ends(marks: Sequence[Mark], px_per_square: float) -> tuple[Mark, ...]:
    """Return a mark of points beyond every streak's ends; empty where squares are small.

    The points show the streaks while their own marks are hidden during a mark by hand.
    """
    if px_per_square <= FAINT_FROM_PX:
        return ()
    points: list[tuple[float, float]] = []
    for mark in marks:
        if mark.ends_px is None:
            continue
        (xa, ya), (xb, yb) = mark.ends_px
        length = math.hypot(xb - xa, yb - ya) or 1.0
        across, down = (xb - xa) / length, (yb - ya) / length
        far = BEYOND_SQUARES * px_per_square
        points += [(xa - across * far, ya - down * far), (xb + across * far, yb + down * far)]
    if not points:
        return ()
    return (Mark(x_px=OUTSIDE_PX, y_px=OUTSIDE_PX, kind="box", outline_px=tuple(points)),)


def box_points(box_px: Box) -> tuple[tuple[float, float], ...]:
    """Return points along the sides of a box (x0, y0, x1, y1), in order round it."""
    x0, y0, x1, y1 = box_px
    corners = ((x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0))
    shares = [k / BOX_POINTS for k in range(BOX_POINTS)]
    return tuple(
        (xa + share * (xb - xa), ya + share * (yb - ya))
        for (xa, ya), (xb, yb) in itertools.pairwise(corners)
        for share in shares
    )
