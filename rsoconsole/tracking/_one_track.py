"""One track through one frame: update, coast or new initiation. Pure."""

from dataclasses import replace

from rsoconsole.records import (
    FoldRecord,
    Measurement,
    Miss,
    Missed,
    NotTaken,
    TrackLost,
    TrackState,
)
from rsoconsole.tracking._gates import (
    INDISTINGUISHABLE,
    mixture_moments_nis,
    rejection_records,
    track_updates,
)
from rsoconsole.tracking._takeover import FrameResult, add_rivals_or_take_over, is_in_field
from rsoconsole.tracking.association.following import (
    NO_DETECTION,
    FollowSettings,
    FrameInput,
    LiveTrack,
    not_followed_record,
    three_sigma_deg,
)
from rsoconsole.tracking.blended import SharedStreak
from rsoconsole.tracking.filters import estimator
from rsoconsole.tracking.initiation.acquisition import (
    NOT_CHOSEN,
    append_to_streak_history,
    new_track,
    updated_neighbours,
)
from rsoconsole.tracking.joint import TrackCandidates

ANOTHER_OBJECT_NIS = 100.0
"""NIS from which the operator's choice is another object, and initiates a new track."""

ALONE_FOR_S = 100.0
"""Longest coast of preset ``adaptive`` without an orbit, s: about three frames."""

_ABSENT = ("no detection", "nothing fits")
"""Kinds of miss that mean that it was not there."""


def update_or_coast(
    weighed: TrackCandidates,
    chosen: Measurement | None,
    before: LiveTrack,
    seen: FrameInput,
    settings: FollowSettings,
) -> FrameResult:
    """Return a track after a frame: updated with ``chosen``, or coasted where that is None."""
    predicted, updated, reasons = weighed.predicted, weighed.updated, weighed.reasons
    if chosen is not None:
        state = updated[chosen].state
        by_filter = weighed.by_filter.get(chosen)
        if by_filter is not None and by_filter.kind == "NIS":
            state = replace(state, filter_nis=by_filter.nis)
        return _measured(state, before, chosen, seen, _records(weighed, state, chosen))
    reason = seen.miss_reason
    if seen.measurements and reason == NO_DETECTION:
        reason = Missed(kind="nothing fits")
    if reason.kind == "nothing fits" and INDISTINGUISHABLE in reasons.values():
        reason = replace(reason, kind="cannot be told apart")
        before = replace(before, ambiguous=before.ambiguous + 1)
    records: tuple[FoldRecord, ...] = (predicted, *rejection_records(reasons, updated))
    step = _coast(before, predicted, seen, settings, records, reason)
    if not settings.filter.uses_filter_bank or step.after is None:
        return step
    is_absent = reason.kind in _ABSENT and not reason.hidden_by
    is_absent = is_absent and is_in_field(predicted, seen.field)
    return add_rivals_or_take_over(step, before, predicted, reasons, is_absent, seen, settings)


def update_with_shared_streak(
    weighed: TrackCandidates, own: SharedStreak, before: LiveTrack, seen: FrameInput
) -> FrameResult:
    """Update a track with its part of a streak that shows two satellites; return the result."""
    records = _records(weighed, own.updated, own.streak)
    return _measured(own.updated, before, own.taken, seen, records)


def _records(
    weighed: TrackCandidates, updated: TrackState, streak: Measurement
) -> tuple[FoldRecord, ...]:
    """Records of the prediction, the update, and the reasons against other streaks."""
    reasons = {m: why for m, why in weighed.reasons.items() if m is not streak}
    reasons |= {m: NotTaken(kind="another taken") for m in weighed.in_gate if m is not streak}
    return (weighed.predicted, updated, *rejection_records(reasons, weighed.updated))


def reinitiated_track(
    step: FrameResult, before: LiveTrack, track_id: int, seen: FrameInput, settings: FollowSettings
) -> FrameResult:
    """Initiate a new track in place of one that had lost its object.

    ``step``: the frame's result for the old track; its ``reacquired`` holds the two measurements
    that initiate the new one. ``track_id``: number of the new track.
    """
    found = step.reacquired
    assert found is not None
    fresh = new_track(found.pair, track_id, seen, settings, is_lead=before.track.is_lead)
    track = replace(fresh.track, replaces=before.track.track_id)
    fresh = replace(fresh, track=track, is_kept=before.is_kept)
    return FrameResult(records=(*step.records, fresh.track), after=fresh, is_measured=True)


def predicted_track(before: LiveTrack, seen: FrameInput, settings: FollowSettings) -> TrackState:
    """Predict a track to a frame: by its filter, or after a long coast by its orbit.

    With preset ``adaptive``, the orbit through all measurements, if there is one, predicts coasts
    of more than ``ALONE_FOR_S``. Preset ``tuned`` uses the orbit only where no measurement fits its
    own prediction.
    """
    predicted = estimator.predict(before.track, seen.t_mid_utc_ns, settings.filter, seen.frame_id)
    if not settings.filter.uses_filter_bank or seen.by_orbit is None or before.taken is None:
        return predicted
    coasted_s = (seen.t_mid_utc_ns - before.taken.t_mid_utc_ns) / 1e9
    if coasted_s <= ALONE_FOR_S:
        return predicted
    return seen.by_orbit(predicted) or predicted


def _measured(
    track: TrackState,
    before: LiveTrack,
    taken: Measurement,
    seen: FrameInput,
    records: tuple[FoldRecord, ...],
) -> FrameResult:
    """Return a track that has accepted a measurement."""
    after = replace(
        before,
        track=track,
        taken=taken,
        neighbours=updated_neighbours(before.neighbours, track, taken, seen),
        streaks=append_to_streak_history(before.streaks, track, taken, seen),
        rivals=(),
        unexplained=0,
        ambiguous=0,
    )
    return FrameResult(records=records, after=after, is_measured=True)


def follow_chosen(
    before: LiveTrack, chosen: Measurement, seen: FrameInput, settings: FollowSettings
) -> FrameResult:
    """Update the track with the operator's choice regardless of gates, or end the track.

    It ends for a NIS above ``ANOTHER_OBJECT_NIS``; ``begins_with`` then has the choice.
    """
    predicted = estimator.predict(before.track, seen.t_mid_utc_ns, settings.filter, seen.frame_id)
    others = tuple(not_followed_record(m, NOT_CHOSEN) for m in seen.measurements if m != chosen)
    updated = track_updates(predicted, (chosen,), before, seen, settings)[chosen].state
    if mixture_moments_nis(updated, settings) > ANOTHER_OBJECT_NIS:
        return FrameResult(records=(predicted, *others), after=None, begins_with=chosen)
    return _measured(updated, before, chosen, seen, (predicted, updated, *others))


def _coast(  # noqa: PLR0917 -- one call, each argument a different thing
    before: LiveTrack,
    predicted: TrackState,
    seen: FrameInput,
    settings: FollowSettings,
    records: tuple[FoldRecord, ...],
    reason: Missed,
) -> FrameResult:
    miss = Miss(frame_id=seen.frame_id, reason=reason)
    since_ns = predicted.t_utc_ns if before.taken is None else before.taken.t_mid_utc_ns
    coasted_s = (seen.t_mid_utc_ns - since_ns) / 1e9
    lost: TrackLost | None = None
    # The paper's bounds are wider than any field from the first prediction on and say nothing.
    bound_deg = three_sigma_deg(predicted)
    most_deg = settings.filter.max_3sigma_arcmin / 60.0
    if before.is_kept:
        most_deg = settings.half_field_deg  # beyond that nobody knows whether it is in the field
    if settings.filter.preset != "paper" and bound_deg > min(settings.half_field_deg, most_deg):
        fits_field = most_deg < settings.half_field_deg
        lost = TrackLost.by_uncertainty(bound_deg * 60, fits_field=fits_field)
    elif coasted_s > settings.filter.max_coast_s and not before.is_kept:
        lost = TrackLost.by_time(coasted_s)
    if lost is not None:
        ended = replace(miss, reason=replace(reason, lost=lost))
        return FrameResult(records=(*records, ended), after=None)
    return FrameResult(records=(*records, miss), after=replace(before, track=predicted))
