"""What is pointed at in a frame that is processed once more: then and now, each by its own sign."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from rsoconsole.console.picture.marks import SHOWN_REJECTED, Mark, mark_of, marks_of
from rsoconsole.night import NightFrame

if TYPE_CHECKING:
    from rsoconsole.pipeline import ComparedCandidate, JudgedCandidate

FAINT_FROM_PX = 3.0
"""In larger squares a streak that is to be marked has its ends pointed at."""
BEYOND_SQUARES = 2.0
OUTSIDE_PX = -1e6
"""A mark of points alone has no middle in the frame."""
BOX_POINTS = 24
"""Along each side of a box."""
SAME_PLACE_PX = 10.0
Box = tuple[float, float, float, float]


def sheet_marks(
    detail: NightFrame, candidates: Sequence["ComparedCandidate"], chosen: int | None
) -> tuple[Mark, ...]:
    """The recorded marks, the boxes of what was detected, and what the detector says now.

    Of the rejected ones those that are likely enough to be worth a look, and the chosen one.
    """
    then = list(marks_of(detail))
    now: list[Mark] = []
    for number, pair in enumerate(candidates):
        is_chosen = number == chosen
        if pair.now is not None:
            streak = pair.now.detection
            if pair.now.is_taken or is_chosen or streak.confidence >= SHOWN_REJECTED:
                now.append(_mark_now(pair.now, pair.is_as_recorded))
        elif is_chosen and pair.was is not None:
            then.append(mark_of(pair.was.detection, "rejected"))
    return (*_boxes(detail), *(_making_room(mark, now) for mark in then), *now)


def _mark_now(judged: "JudgedCandidate", is_as_recorded: bool) -> Mark:
    mark = mark_of(judged.detection, "now" if judged.is_taken else "now_rejected")
    return replace(mark, is_outer=True, label="=" if is_as_recorded else mark.label)


def _making_room(mark: Mark, others: list[Mark]) -> Mark:
    """With its label a cell further, where another sign stands about it."""
    is_within = any(
        max(abs(mark.x_px - other.x_px), abs(mark.y_px - other.y_px)) < SAME_PLACE_PX
        for other in others
    )
    return replace(mark, gap=1) if is_within else mark


def place_in(detail: NightFrame) -> tuple[float, float] | None:
    """Where the frame shows the lead, else where the track had it; None: neither is known."""
    if detail.followed is not None:
        return detail.followed.x_px, detail.followed.y_px
    marks = marks_of(detail)
    found = (m for kind in ("predicted", "coasted") for m in marks if m.kind == kind)
    found = (m for m in found if _is_in(m, detail))
    mark = next(found, None)
    return None if mark is None else (mark.x_px, mark.y_px)


def _is_in(mark: Mark, detail: NightFrame) -> bool:
    size = detail.detections
    return size is not None and 0 <= mark.x_px < size.width_px and 0 <= mark.y_px < size.height_px


def faint_ends(marks: Sequence[Mark], px_per_square: float) -> tuple[Mark, ...]:
    """A point beyond each end of every streak, where it is too small to be seen without; else none.

    Of a view with squares of that many pixels.
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


def _boxes(detail: NightFrame) -> list[Mark]:
    """What the network put about each recorded detection."""
    found = detail.detections.detections if detail.detections is not None else ()
    return [
        Mark(x_px=each.x_px, y_px=each.y_px, kind="box", outline_px=box_points(each.box_px))
        for each in found
    ]


def box_points(box_px: Box) -> tuple[tuple[float, float], ...]:
    """Points along a box's sides, one after another."""
    x0, y0, x1, y1 = box_px
    corners = ((x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0))
    points: list[tuple[float, float]] = []
    for (xa, ya), (xb, yb) in itertools.pairwise(corners):
        for k in range(BOX_POINTS):
            share = k / BOX_POINTS
            points.append((xa + share * (xb - xa), ya + share * (yb - ya)))
    return tuple(points)
