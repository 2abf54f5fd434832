"""What is pointed at in a frame that is processed once more: then and now, each by its own sign."""

import itertools
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from rsoconsole.console.marks import SHOWN_REJECTED, Mark, mark_of, marks_of
from rsoconsole.console.night import FrameDetail

if TYPE_CHECKING:
    from rsoconsole.pipeline.reprocess import Compared, Verdict

BOX_POINTS = 24
"""Along each side of a box."""
SAME_PLACE_PX = 10.0
Box = tuple[float, float, float, float]


def sheet_marks(
    detail: FrameDetail, candidates: Sequence["Compared"], chosen: int | None
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


def _mark_now(verdict: "Verdict", is_as_recorded: bool) -> Mark:
    mark = mark_of(verdict.detection, "now" if verdict.is_taken else "now_rejected")
    return replace(mark, is_outer=True, label="=" if is_as_recorded else mark.label)


def _making_room(mark: Mark, others: list[Mark]) -> Mark:
    """With its label a cell further, where another sign stands about it."""
    is_within = any(
        max(abs(mark.x_px - other.x_px), abs(mark.y_px - other.y_px)) < SAME_PLACE_PX
        for other in others
    )
    return replace(mark, gap=1) if is_within else mark


def _boxes(detail: FrameDetail) -> list[Mark]:
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
