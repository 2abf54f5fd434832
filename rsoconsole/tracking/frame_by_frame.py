"""Tracking frame by frame: a pure fold over recorded inputs.

``follow(before, seen, settings)`` is pure, so the engine, ``process``, what-if and a replay of a
session all get the same track from the same inputs, bit for bit. States and transitions are those
of the architecture page; IDLE, MANUAL and FAULT belong to the controller of the mount and are set
from outside.
"""

import math
from dataclasses import replace

from rsoconsole.records import (
    Cause,
    FoldRecord,
    Measurement,
    Miss,
    NotFollowed,
    NotTaken,
    StateChange,
    TrackState,
)
from rsoconsole.tracking import blended, further_tracks, track_decisions
from rsoconsole.tracking._gates import (
    INDISTINGUISHABLE,
    gate_rejection_reasons,
    nis_of,
    track_updates,
)
from rsoconsole.tracking._one_track import (
    follow_chosen,
    predicted_track,
    reinitiated_track,
    update_or_coast,
    update_with_shared_streak,
)
from rsoconsole.tracking._takeover import FrameResult
from rsoconsole.tracking.association import pattern as patterns
from rsoconsole.tracking.association.following import (
    NO_DETECTION,
    ONLY_CROSSING,
    Following,
    FollowSettings,
    FrameInput,
    LiveTrack,
    expected_motion,
    not_followed_record,
    with_track_id,
)
from rsoconsole.tracking.association.pattern import TrackPattern, TrackPlace
from rsoconsole.tracking.initiation import chains
from rsoconsole.tracking.initiation.acquisition import REFUSED, acquire
from rsoconsole.tracking.joint import TrackCandidates, assign_measurements

_GATE_SIGMAS, _MAX_BY_CHANCE = 3.0, 0.05
"""Gate in which a streak below tau may lie, and the largest number there by chance."""


def follow(
    before: Following, seen: FrameInput, settings: FollowSettings
) -> tuple[Following, tuple[FoldRecord, ...]]:
    """Return the state after a frame, and the frame's records in order."""
    seen, crossings = _without_crossings(seen)
    before = track_decisions.with_operator_decisions(before, seen, settings)
    if before.state not in ("TRACK", "COAST") or not before.tracks:
        steps = _steps_of_dropped(before, seen, settings)
        dropped, said = track_decisions.step_dropped_tracks(before.dropped, steps, seen)
        after, records = acquire(
            before, track_decisions.without_accepted_measurements(seen, steps), settings
        )
        after, records = replace(after, dropped=dropped), (*records, *said)
    else:
        after, records = _follow_tracks(before, seen, settings)
    after, records = track_decisions.with_decisions_on_new_tracks(after, records, seen)
    records = track_decisions.with_kept_states_marked(records, before, after)
    records += with_track_id(crossings, before.track_id)
    if after.state != before.state and not any(isinstance(r, StateChange) for r in records):
        change = StateChange(
            frame_id=seen.frame_id,
            before=before.state,
            after=after.state,
            reason=_reason(before, after, records, seen),
        )
        records = (*records, change)
    return after, tuple(_as_recorded(each) for each in records)


def _as_recorded(record: FoldRecord) -> FoldRecord:
    """Record without the large memory for the next frame, which the state carries."""
    if isinstance(record, TrackState) and record.memory is not None:
        return replace(record, memory=None)
    return record


def _without_crossings(seen: FrameInput) -> tuple[FrameInput, tuple[NotFollowed, ...]]:
    """Split a frame into measurements with a place in time, and crossings as not accepted.

    Where neither end is in the frame the time of each place is unknown: even the operator's choice
    makes no measurement of it. Streaks beside it are used as ever.
    """
    crossings = tuple(m for m in seen.measurements if m.is_crossing)
    if not crossings:
        return seen, ()
    rest = tuple(m for m in seen.measurements if not m.is_crossing)
    is_all = not rest and seen.absence == NO_DETECTION
    left = replace(
        seen,
        measurements=rest,
        chosen=None if seen.chosen in crossings else seen.chosen,
        absence=ONLY_CROSSING if is_all else seen.absence,
    )
    return left, tuple(not_followed_record(m, NotTaken(kind="crossing")) for m in crossings)


def _follow_tracks(
    before: Following, seen: FrameInput, settings: FollowSettings
) -> tuple[Following, tuple[FoldRecord, ...]]:
    """Follow all tracks through a frame, the lead first; where it ends, the next track leads."""
    is_joint = settings.filter.uses_filter_bank and settings.choice == "nearest"
    if is_joint:
        before = further_tracks.with_fewer_filters(before)
    alone, seen = seen, _with_faint(before, seen, settings)
    if seen.chosen is not None and is_joint and len(before.tracks) > 1:
        before, seen = _with_chosen_lead(before, seen, settings)
    if seen.chosen is None and is_joint:
        steps = _steps_of_all(before, seen, settings)
    else:
        steps = _steps_in_turn(before, seen, settings)
        if before.dropped:
            steps += _steps_of_dropped(
                before, track_decisions.without_accepted_measurements(seen, steps), settings
            )
    of_dropped = steps[len(steps) - len(before.dropped) :]
    dropped, of_those_dropped = track_decisions.step_dropped_tracks(
        before.dropped, of_dropped, seen
    )
    if before.dropped:
        before = replace(before, dropped=dropped)
    records: tuple[FoldRecord, ...] = ()
    last_track_id, causes, ended = before.last_track_id, list[Cause](), list[FrameResult]()
    for number, (each, step) in enumerate(zip(before.tracks, steps, strict=False)):
        done = step
        if step.reacquired is not None:
            last_track_id += 1
            causes += [step.reacquired.cause] * (number == 0)
            done = reinitiated_track(step, each, last_track_id, seen, settings)
        ended.append(done)
        refused = seen.refused if number == 0 else ()
        said = (*done.records, *(not_followed_record(m, REFUSED) for m in refused))
        records += with_track_id(said, each.track.track_id)
        if done.begins_with is not None:
            return before.without_track("ACQUIRE", (done.begins_with,)), records
    after = replace(_led(before, tuple(ended)), last_track_id=last_track_id)
    if is_joint and seen.chosen is None and settings.filter.most_tracks > 1 and after.tracks:
        after, records = further_tracks.with_new_tracks(
            before, after, [*ended, *of_dropped], records, alone, settings
        )
    if len(after.tracks) + len(after.dropped) > 1:
        after = replace(after, pattern=_pattern(before, after, seen))
    if causes and after.state == "TRACK":
        change = StateChange(
            frame_id=seen.frame_id, before=before.state, after="TRACK", reason=causes[0]
        )
        records = (*records, change)
    return after, (*records, *of_those_dropped)


def _with_faint(before: Following, seen: FrameInput, settings: FollowSettings) -> FrameInput:
    """Add streaks below tau that lie where a track is expected and nothing above tau does.

    Only where chance hardly puts one of a frame's candidates into the gate.
    """
    if not seen.faint or settings.choice != "nearest":
        return seen
    near: list[Measurement] = []
    field_arcsec2 = (7200.0 * settings.half_field_deg) ** 2
    for each in before.tracks:
        weighed = _weighed(each, seen, settings)
        if weighed.in_gate:
            continue
        asked = replace(seen, measurements=seen.faint)
        weighed = _weighed_by(weighed.predicted, each, asked, settings)
        for m in weighed.in_gate:
            sigmas = weighed.updated[m].state.sigma_innovation_arcsec or (math.inf, math.inf)
            gate_arcsec2 = math.pi * _GATE_SIGMAS**2 * sigmas[0] * sigmas[1]
            if len(seen.faint) * gate_arcsec2 < _MAX_BY_CHANCE * field_arcsec2:
                near.append(m)
    return replace(seen, measurements=(*seen.measurements, *dict.fromkeys(near)))


def _with_chosen_lead(
    before: Following, seen: FrameInput, settings: FollowSettings
) -> tuple[Following, FrameInput]:
    """Let the track lead that accepts the measurement which the operator wants followed.

    Nothing else changes by it: no track ends, and each accepts the same measurement.
    """
    # The word has a copy of its own, of the recorded instant: what was measured once counts once.
    once = {m.measurement_id: m for m in reversed(seen.measurements)}
    unsaid = replace(
        seen,
        chosen=None,
        measurements=tuple(m for m in seen.measurements if once[m.measurement_id] is m),
    )
    wanted = None if seen.chosen is None else seen.chosen.measurement_id
    steps = _steps_of_all(before, unsaid, settings)[: len(before.tracks)]
    for number, step in enumerate(steps):
        taken = step.after.taken if step.is_measured and step.after is not None else None
        if taken is not None and taken.measurement_id == wanted:
            tracks = before.tracks
            in_order = (tracks[number], *tracks[:number], *tracks[number + 1 :])
            return replace(before, tracks=track_decisions.with_first_as_lead(in_order)), unsaid
    return before, seen


def _pattern(before: Following, after: Following, seen: FrameInput) -> TrackPattern:
    """Return the relative positions of the tracks after a frame."""
    tracks = (*after.tracks, *after.dropped)
    shown = {
        each.track.track_id: TrackPlace.from_measurement(each.taken, each.track)
        for each in tracks
        if each.taken is not None
        and each.taken.frame_id == seen.frame_id
        # Where what the frame cuts was taken is not where it is.
        and not each.taken.is_clipped
        # What no frame shows apart says nothing of the way between.
        and each.track.shared_with is None
    }
    alive = [each.track.track_id for each in tracks]
    return patterns.pattern_after(before.pattern, alive, shown, seen.t_mid_utc_ns)


def _steps_in_turn(
    before: Following, seen: FrameInput, settings: FollowSettings
) -> list[FrameResult]:
    """Step each track in turn; a measurement accepted by one is not available to the next ones."""
    steps: list[FrameResult] = []
    left = seen
    for number, each in enumerate(before.tracks):
        if number == 0 and seen.chosen is not None:
            step = follow_chosen(each, seen.chosen, seen, settings)
        else:
            weighed = _weighed(each, left, settings)
            step = update_or_coast(weighed, _nearest(weighed, settings), each, left, settings)
        steps.append(step)
        if step.begins_with is not None:
            return steps
        is_last = number == len(before.tracks) - 1
        if not is_last and step.is_measured and step.after is not None:
            others = tuple(m for m in left.measurements if m != step.after.taken)
            left = replace(left, measurements=others, chosen=None)
    return steps


def _steps_of_all(
    before: Following, seen: FrameInput, settings: FollowSettings
) -> list[FrameResult]:
    """Step all tracks at once, then the dropped ones; each measurement goes to one at most."""
    all_tracks = (*before.tracks, *before.dropped)
    alone = len(all_tracks) == 1
    # Where several are followed, neighbours are tracks themselves.
    tracks = [each if alone else replace(each, neighbours=()) for each in all_tracks]
    weighed = [_weighed(each, seen, settings) for each in tracks]
    given = assign_measurements(weighed, before.pattern)
    of_two = blended.shared_streaks(weighed, given, before.pattern, seen, settings)
    steps = []
    for number, (each, taken, unsure, track) in enumerate(
        zip(weighed, given.taken, given.is_ambiguous, all_tracks, strict=True)
    ):
        if number in of_two:
            steps.append(update_with_shared_streak(each, of_two[number], track, seen))
            continue
        of_others = {m for m in given.taken if m is not None and m is not taken}
        of_others |= {one.streak for one in of_two.values()}
        left = tuple(m for m in seen.measurements if m not in of_others)
        own = TrackCandidates(
            predicted=each.predicted,
            updated={m: each.updated[m] for m in left if m in each.updated},
            reasons={m: why for m, why in each.reasons.items() if m not in of_others},
        )
        if unsure:
            unclear = dict.fromkeys(own.in_gate, INDISTINGUISHABLE)
            own = replace(own, reasons={**own.reasons, **unclear})
        step = update_or_coast(own, taken, track, replace(seen, measurements=left), settings)
        steps.append(
            step
            if track.track.is_lead
            else further_tracks.end_track_if_lost(step, track, seen, settings)
        )
    if not chains.uses_window(settings):
        return steps
    return further_tracks.end_unconfirmed_lead(steps, all_tracks, seen, settings)


def _steps_of_dropped(
    before: Following, seen: FrameInput, settings: FollowSettings
) -> list[FrameResult]:
    """Step the dropped tracks through a frame, each alone."""
    if not before.dropped:
        return []
    dropped = replace(before, tracks=before.dropped, dropped=())
    return _steps_of_all(dropped, seen, replace(settings, choice="nearest"))


def _led(before: Following, steps: tuple[FrameResult, ...]) -> Following:
    """Return the state of the continuing tracks, the lead first."""
    alive = [step for step in steps if step.after is not None]
    if not alive:
        return before.without_track("LOST")
    tracks = [step.after for step in alive if step.after is not None]
    first = tracks[0]
    if not first.track.is_lead:
        tracks[0] = replace(first, track=replace(first.track, is_lead=True))
    return Following(
        state="TRACK" if alive[0].is_measured else "COAST",
        tracks=tuple(tracks),
        last_track_id=before.last_track_id,
        dropped=before.dropped,
    )


def _reason(
    before: Following, after: Following, records: tuple[FoldRecord, ...], seen: FrameInput
) -> Cause:
    if after.state == "TRACK":
        return Cause(kind="measured again" if before.state == "COAST" else "two frames agree")
    if after.state == "ACQUIRE":
        return Cause(kind="waiting", detections=len(seen.measurements))
    lead = before.track_id
    missed = next((r for r in records if isinstance(r, Miss) and r.track_id == lead), None)
    return Cause(kind="missed", missed=seen.miss_reason if missed is None else missed.reason)


def _weighed(before: LiveTrack, seen: FrameInput, settings: FollowSettings) -> TrackCandidates:
    """Candidates of a frame for a track: by its filter, or by its orbit where nothing fits that."""
    predicted = predicted_track(before, seen, settings)
    weighed = _weighed_by(predicted, before, seen, settings)
    is_filters = predicted.foretold_by == "filter"
    if not weighed.in_gate and seen.measurements and seen.by_orbit is not None and is_filters:
        by_orbit = seen.by_orbit(predicted)
        if by_orbit is not None:
            again = _weighed_by(by_orbit, before, seen, settings)
            return replace(again, by_filter=weighed.reasons) if again.in_gate else weighed
    return weighed


def _weighed_by(
    predicted: TrackState, before: LiveTrack, seen: FrameInput, settings: FollowSettings
) -> TrackCandidates:
    expected = expected_motion(predicted, seen.exposure_s)
    asked = seen.measurements
    if not predicted.is_lead and settings.filter.uses_filter_bank:
        asked = further_tracks.measurements_near_prediction(asked, predicted)
    updated = track_updates(predicted, asked, before, seen, settings)
    reasons: dict[Measurement, NotTaken] = {}
    if settings.choice == "nearest":  # the paper's rule asks for nothing but confidence
        reasons = gate_rejection_reasons(predicted, expected, updated, before, seen, settings)
    return TrackCandidates(
        predicted=predicted,
        updated=updated,
        reasons=reasons,
        must_decide=before.ambiguous >= settings.filter.most_ambiguous,
    )


def _nearest(weighed: TrackCandidates, settings: FollowSettings) -> Measurement | None:
    """Fitting measurement that a track accepts when it is considered alone."""
    fitting = weighed.in_gate
    if not fitting or settings.choice != "nearest":
        return next(iter(fitting), None)
    return min(fitting, key=lambda m: nis_of(weighed.updated[m]))
