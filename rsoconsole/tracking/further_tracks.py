"""Tracks beside the lead, initiated by measurements that no track has accepted. Pure.

Frames that agree on one motion initiate such a track, as they initiate the lead. A track on trial
(``chains``) ends with its first miss, so that false streaks cost a frame or two; its last streak
may then initiate another track. A track with three or four measurements coasts for less time than
one of a whole night. A track that has left the field ends too: only the lead is searched for.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rsoconsole.records import FoldRecord, Measurement, Miss, NotFollowed, TrackLost, TrackState
from rsoconsole.tracking._takeover import FrameResult, is_neighbour
from rsoconsole.tracking.association.following import (
    TRACKABLE_CLASSES,
    Following,
    FollowSettings,
    FrameInput,
    LiveTrack,
    expected_motion,
    three_sigma_deg,
)
from rsoconsole.tracking.filters import adaptive, lqe
from rsoconsole.tracking.filters.agreement import (
    measurement_displacement,
    motion_between,
    motion_mismatch,
    streak_motion,
)
from rsoconsole.tracking.initiation import chains
from rsoconsole.tracking.initiation.acquisition import new_track

UNSEEN_EACH = 2
"""Number of unhidden frames without the track, for each with it after its first, that end it."""
_SAME_STREAK_ARCSEC = 8.0
"""Distance, arcsec, below which a streak is an accepted one of a track, detected twice."""
_BEYOND_SIGMAS, _BEYOND_ARCSEC = 5.0, 120.0
_OUTSIDE_S = 300.0


MANY = 6
"""Largest number of tracks that all keep the full grid of filters."""


def with_fewer_filters(before: Following) -> Following:
    """Return the state; with more than ``MANY`` tracks all but the lead get a coarser bank."""
    if len(before.tracks) + len(before.dropped) <= MANY:
        return before
    lead, *others = before.tracks
    return replace(
        before,
        tracks=(lead, *map(_lightened, others)),
        dropped=tuple(map(_lightened, before.dropped)),
    )


def _lightened(one: LiveTrack) -> LiveTrack:
    return replace(one, track=adaptive.with_coarse_bank(one.track))


def measurements_near_prediction(
    measurements: tuple[Measurement, ...], predicted: TrackState
) -> tuple[Measurement, ...]:
    """Return the measurements near enough to a prediction to be compared with it.

    All others are beyond any gate.
    """
    here = lqe.direction_icrs_deg(predicted)
    scatter_s = 0.0 if predicted.mixture is None else predicted.mixture.scatter_high_s
    reach_arcsec = _BEYOND_ARCSEC + _BEYOND_SIGMAS * (
        3600.0 * three_sigma_deg(predicted) / 3.0
        + scatter_s * float(np.hypot(*lqe.sky_rate_arcsec_s(predicted)))
    )
    near = []
    for m in measurements:
        ee, _, nn = m.cov_sky_arcsec2
        most_arcsec = reach_arcsec + 3.0 * math.sqrt(max(ee, nn))
        if abs(m.dec_icrs_deg - here[1]) * 3600.0 > most_arcsec:
            continue
        if motion_between(*here, m.ra_icrs_deg, m.dec_icrs_deg).length_arcsec <= most_arcsec:
            near.append(m)
    return tuple(near)


def end_unconfirmed_lead(
    steps: list[FrameResult],
    tracks: Sequence[LiveTrack],
    seen: FrameInput,
    settings: FollowSettings,
) -> list[FrameResult]:
    """End a lead that is missed on trial, if another track is confirmed; return the steps.

    The confirmed track then leads. Without one the lead continues, since its two streaks are the
    best prediction available.
    """
    confirmed = (
        step.is_measured and step.after is not None and _is_confirmed(step.after)
        for step in steps[1:]
    )
    is_lead = bool(steps) and tracks[0].track.is_lead and steps[0].reacquired is None
    after = steps[0].after if is_lead else None
    if after is None or not any(confirmed):
        return steps
    asked = replace(steps[0], after=replace(after, trial=max(after.trial, chains.ON_TRIAL)))
    return [end_track_if_lost(asked, tracks[0], seen, settings), *steps[1:]]


def end_track_if_lost(
    step: FrameResult, before: LiveTrack, seen: FrameInput, settings: FollowSettings
) -> FrameResult:
    """End an unmeasured track if it is on trial, too seldom seen, or out of the field.

    Returns the step unchanged where the track goes on.
    """
    if step.after is None or step.is_measured:
        return step
    lost: TrackLost | None = None
    track = step.after.track
    # What chance would hardly have made of points is no chance because one frame hides it.
    is_chain = before.taken is not None and streak_motion(before.taken) is None
    is_seldom = not step.after.is_kept and step.after.unexplained > UNSEEN_EACH * (
        track.innovations + 1
    )
    outlives = before.is_kept or (is_chain and track.misses == 1)
    if step.after.is_on_trial and not outlives:
        lost = TrackLost(kind="not confirmed")
    elif _has_left(step.after, seen):
        lost = TrackLost(kind="left the field")
    elif is_seldom and chains.uses_window(settings):
        lost = TrackLost(kind="seen too seldom", unseen_frames=step.after.unexplained)
    if lost is None:
        return step
    records = tuple(
        replace(r, reason=replace(r.reason, lost=lost)) if isinstance(r, Miss) else r
        for r in step.records
    )
    return FrameResult(records=records, after=None)


def _is_confirmed(tracked: LiveTrack) -> bool:
    """True where it was measured after its initiation, and is no longer on trial."""
    return tracked.track.innovations >= max(tracked.trial, chains.ON_TRIAL)


def _has_left(coasted: LiveTrack, seen: FrameInput) -> bool:
    """True where a track that a frame does not show has been outside the field for long."""
    if seen.field is None or coasted.taken is None:
        return False
    ra_deg, dec_deg = lqe.direction_icrs_deg(coasted.track)
    holds = seen.field.holds(np.array([ra_deg]), np.array([dec_deg]), np.zeros(1))
    coasted_s = (seen.t_mid_utc_ns - coasted.taken.t_mid_utc_ns) / 1e9
    return not bool(holds[0]) and coasted_s > _OUTSIDE_S


def initiate_tracks(  # noqa: PLR0917 -- one call, each argument a different thing
    before: Following,
    usable: tuple[Measurement, ...],
    alive: tuple[LiveTrack, ...],
    last_track_id: int,
    seen: FrameInput,
    settings: FollowSettings,
) -> tuple[tuple[LiveTrack, ...], set[Measurement]]:
    """Initiate tracks by chains of frames that agree; return them and all measurements used.

    Chains are used in the order of their last measurements in ``usable``, the surest first.
    ``alive``: the existing tracks; together with the new ones there are at most as many as the
    settings allow.
    """
    room = settings.filter.most_tracks - len(alive)
    if room <= 0 or not usable or not (before.candidates or before.earlier):
        return (), set()
    agreed = chains.find_chains(before, usable, seen, settings, alive)
    each = [(*agreed[last], last) for last in usable if last in agreed][:room]
    rates = [lqe.sky_rate_arcsec_s(one.track) for one in alive]
    tracks = tuple(
        new_track(chain, last_track_id + number, seen, settings, is_lead=False, trial=trial)
        for number, (chain, trial) in enumerate(
            zip(each, chains.trial_update_counts(each, settings, rates), strict=True), 1
        )
    )
    return tracks, {m for chain in each for m in chain}


def unclaimed_measurements(
    steps: list[FrameResult], seen: FrameInput, settings: FollowSettings
) -> tuple[Measurement, ...]:
    """Return the measurements that no track has accepted or claimed: they may initiate one.

    Claimed are possible streaks of a missed track (``_takeover``) and streaks that may belong to
    either of two tracks.
    """
    taken = [s.after.taken for s in steps if s.is_measured and s.after and s.after.taken]
    is_wide = chains.uses_window(settings)
    claimed = {m for step in steps for m in _waited_for(step, is_wide)}
    claimed |= {
        r.measurement
        for step in steps
        for r in step.records
        if isinstance(r, NotFollowed)
        and (
            r.reason.kind == "cannot be told apart"
            or (r.reason.kind == "another taken" and not (is_wide and _is_whole(r, step, seen)))
        )
    }
    return tuple(
        m
        for m in seen.measurements
        if not m.is_clipped
        and m.object_class in TRACKABLE_CLASSES
        and m not in claimed
        and not any(
            m.measurement_id == t.measurement_id
            or measurement_displacement(m, t).length_arcsec < _SAME_STREAK_ARCSEC
            for t in taken
        )
    )


def _waited_for(step: FrameResult, is_wide: bool) -> tuple[Measurement, ...]:
    """Measurements that may turn out to be of a missed track.

    A neighbour that was seen beside a track never is. Where more frames are used the lead alone
    waits: beside other tracks a streak elsewhere is rather another satellite than one that has left
    its path.
    """
    after = step.after
    if after is None or not after.unexplained or (is_wide and not after.track.is_lead):
        return ()
    return tuple(
        m
        for rival in after.rivals
        if not (is_wide and is_neighbour(rival.measurements[-1], after))
        for m in rival.measurements
    )


def _is_whole(refused: NotFollowed, step: FrameResult, seen: FrameInput) -> bool:
    """True where a streak beside the measurement of a track is as long: no part of the same."""
    if step.after is None:
        return False
    expected = expected_motion(step.after.track, seen.exposure_s)
    return motion_mismatch(refused.measurement, expected) is None


def with_new_tracks(  # noqa: PLR0917 -- one call, each argument a different thing
    before: Following,
    after: Following,
    steps: list[FrameResult],
    records: tuple[FoldRecord, ...],
    seen: FrameInput,
    settings: FollowSettings,
) -> tuple[Following, tuple[FoldRecord, ...]]:
    """Return state and records with the tracks that a frame initiates beside the existing ones."""
    free = unclaimed_measurements(steps, seen, settings)
    if chains.uses_window(settings):
        before = _with_given_back(before, steps)
    found, used = initiate_tracks(before, free, after.tracks, after.last_track_id, seen, settings)
    # What has begun a track is no longer refused by others.
    seconds = {each.taken for each in found}
    remaining = (
        r for r in records if not (isinstance(r, NotFollowed) and r.measurement in seconds)
    )
    return replace(
        after,
        candidates=tuple(m for m in free if m not in used),
        earlier=chains.waiting_measurements(before, used) if chains.uses_window(settings) else (),
        tracks=(*after.tracks, *found),
        last_track_id=after.last_track_id + len(found),
    ), (*remaining, *(each.track for each in found))


def _with_given_back(before: Following, steps: Sequence[FrameResult]) -> Following:
    """Free the last measurement of a track that ended on trial: its partner was wrong."""
    ended_on_trial = [
        each
        for each, step in zip(before.tracks, steps, strict=False)
        if step.after is None and not _is_confirmed(each)
    ]
    given_back = [each.taken for each in ended_on_trial if each.taken is not None]
    last = max(each.track.frame_id for each in before.tracks)
    of_last = tuple(m for m in given_back if m.frame_id == last)
    older = tuple(m for m in given_back if m.frame_id < last)
    return replace(
        before, candidates=(*before.candidates, *of_last), earlier=(*before.earlier, *older)
    )
