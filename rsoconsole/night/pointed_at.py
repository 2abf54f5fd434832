"""Whether a frame that shows nothing of the lead could have: it may have looked elsewhere. Pure."""

from collections.abc import Iterable

from rsoconsole.reasons import Cause
from rsoconsole.records import (
    FrameTaken,
    Miss,
    NotSolved,
    Record,
    Solution,
    StateChange,
    TrackState,
)


def is_without_detection(record: Record) -> bool:
    """Whether it says that a frame had none."""
    reason = record.reason if isinstance(record, Miss | StateChange) else None
    missed = reason.missed if isinstance(reason, Cause) else reason
    return missed is not None and missed.kind == "no detection" and not missed.hidden_by


def looked_elsewhere(
    predicted: TrackState | None,
    solution: Solution | NotSolved | None,
    taken: FrameTaken | None,
) -> bool:
    """Whether a solved frame's field does not have the place where the lead is predicted."""
    if predicted is None or taken is None or not isinstance(solution, Solution):
        return False
    from rsoconsole.sky import sky_to_pixel

    x_px, y_px = sky_to_pixel(solution.wcs, predicted.x[0] % 360.0, predicted.x[2])
    return not (0.0 <= x_px <= taken.width_px and 0.0 <= y_px <= taken.height_px)


def was_pointed_at(
    records: Iterable[Record], solution: Solution | NotSolved | None, taken: FrameTaken
) -> bool:
    """Of a folded frame by its records: False where the lead was missed for want of looking."""
    predicted = lead_id = None
    is_missed = False
    for each in records:
        if isinstance(each, TrackState) and each.is_lead:
            lead_id = each.track_id
            predicted = each if each.kind == "predicted" else predicted
        elif isinstance(each, Miss) and each.track_id in {None, lead_id}:
            is_missed = is_missed or is_without_detection(each)
    return not (is_missed and looked_elsewhere(predicted, solution, taken))
