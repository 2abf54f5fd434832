"""Decisions of the operator on whole tracks: to drop one, or keep it while unseen. Pure.

A dropped track is still followed, but neither recorded nor listed: its streaks are recognised and
initiate no other track. It is forgotten once it has left the field, or may have left it.
"""

from dataclasses import replace

from rsoconsole.records import FoldRecord, Miss, NotFollowed, NotTaken, TrackState
from rsoconsole.tracking._takeover import FrameResult
from rsoconsole.tracking.association.following import (
    Following,
    FollowSettings,
    FrameInput,
    LiveTrack,
    not_followed_record,
    with_track_id,
)

MAX_DROPPED = 12
"""Largest number of dropped tracks whose streaks are recognised: those dropped last."""
DROPPED = NotTaken(kind="dropped")


def with_operator_decisions(
    before: Following, seen: FrameInput, settings: FollowSettings
) -> Following:
    """Return the state before a frame, after the operator's decisions that hold from it on."""
    if before.dropped:
        most_s = settings.filter.max_coast_s
        known = (
            each
            for each in before.dropped
            if 0.0 <= (seen.t_mid_utc_ns - each.track.t_utc_ns) / 1e9 <= most_s
        )
        before = replace(before, dropped=tuple(known))
    if not (seen.dropped or seen.kept or seen.released):
        return before
    left = tuple(_with_keeping(each, seen) for each in before.tracks)
    gone = tuple(each for each in left if each.track.track_id in seen.dropped)
    return _without(replace(before, tracks=left), gone)


def with_decisions_on_new_tracks(
    after: Following, records: tuple[FoldRecord, ...], seen: FrameInput
) -> tuple[Following, tuple[FoldRecord, ...]]:
    """Return state and records with the operator's decisions on tracks that the frame initiates."""
    if not (seen.dropped or seen.kept):
        return after, records
    tracks = tuple(_with_keeping(each, seen) for each in after.tracks)
    gone = tuple(each for each in tracks if each.track.track_id in seen.dropped)
    events = tuple(
        each
        for each in records
        if not isinstance(each, TrackState | Miss | NotFollowed)
        or each.track_id not in {one.track.track_id for one in gone}
    )
    return _without(replace(after, tracks=tracks), gone), events


def step_dropped_tracks(
    dropped: tuple[LiveTrack, ...], steps: list[FrameResult], seen: FrameInput
) -> tuple[tuple[LiveTrack, ...], tuple[FoldRecord, ...]]:
    """Return the dropped tracks after a frame, and records of the streaks that belong to them.

    A track whose streak the operator has chosen is removed from the dropped ones.
    """
    wanted = None if seen.chosen is None else seen.chosen.measurement_id
    after, records = list[LiveTrack](), tuple[FoldRecord, ...]()
    for before, step in zip(dropped, steps, strict=True):
        if step.after is None:
            continue
        taken = step.after.taken if step.is_measured else None
        if taken is None:
            after.append(step.after)
        elif taken.measurement_id != wanted:
            after.append(step.after)
            records += with_track_id((not_followed_record(taken, DROPPED),), before.track.track_id)
    return tuple(after), records


def without_accepted_measurements(seen: FrameInput, steps: list[FrameResult]) -> FrameInput:
    """Return the frame without measurements accepted in ``steps``, except the operator's choice."""
    taken = {
        step.after.taken.measurement_id
        for step in steps
        if step.is_measured and step.after is not None and step.after.taken is not None
    }
    if not taken:
        return seen
    left = (m for m in seen.measurements if m.measurement_id not in taken or m == seen.chosen)
    return replace(seen, measurements=tuple(left))


def with_kept_states_marked(
    records: tuple[FoldRecord, ...], *known: Following
) -> tuple[FoldRecord, ...]:
    """Return the records, with the states of kept tracks marked as kept."""
    kept = {each.track.track_id for one in known for each in one.tracks if each.is_kept}
    if not kept:
        return records
    return tuple(
        replace(each, is_kept=True)
        if isinstance(each, TrackState) and each.track_id in kept
        else each
        for each in records
    )


def with_first_as_lead(tracks: tuple[LiveTrack, ...]) -> tuple[LiveTrack, ...]:
    """Return the tracks with the first one marked as the lead, and no other."""
    return tuple(
        each
        if each.track.is_lead == (at == 0)
        else replace(each, track=replace(each.track, is_lead=at == 0))
        for at, each in enumerate(tracks)
    )


def _with_keeping(track: LiveTrack, seen: FrameInput) -> LiveTrack:
    number = track.track.track_id
    is_kept = number in seen.kept or (track.is_kept and number not in seen.released)
    return track if is_kept == track.is_kept else replace(track, is_kept=is_kept)


def _without(following: Following, gone: tuple[LiveTrack, ...]) -> Following:
    """Return the state without dropped tracks; where the lead is one, the next track leads."""
    if not gone:
        return following
    ended = {each.track.track_id for each in gone}
    left = tuple(each for each in following.tracks if each.track.track_id not in ended)
    # Kept, so that nothing but the field's edge ends it, and bounds as wide as the field.
    unseen = tuple(
        replace(each, track=replace(each.track, is_lead=False), is_kept=True) for each in gone
    )
    dropped = (*following.dropped, *unseen)[-MAX_DROPPED:]
    if left:
        return replace(following, tracks=with_first_as_lead(left), dropped=dropped)
    waiting = following.candidates
    state = following.without_track("ACQUIRE" if waiting else "SEARCH", waiting)
    return replace(state, dropped=dropped)
