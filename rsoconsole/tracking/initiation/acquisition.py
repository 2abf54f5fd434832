"""Track initiation by frames that agree on one motion: two of streaks, or more of points. Pure."""

from dataclasses import replace

from rsoconsole.records import (
    Cause,
    FoldRecord,
    LoopState,
    Measurement,
    NotFollowed,
    NotTaken,
    StateChange,
    TrackState,
)
from rsoconsole.tracking.association import pattern as patterns
from rsoconsole.tracking.association.following import (
    TRACKABLE_CLASSES,
    Following,
    FollowSettings,
    FrameInput,
    LiveTrack,
    expected_motion,
    not_followed_record,
    with_track_id,
)
from rsoconsole.tracking.association.neighbours import Neighbour, neighbours_after
from rsoconsole.tracking.association.pattern import (
    NO_PATTERN,
    TrackPattern,
    TrackPlace,
    learnt_error_arcsec,
)
from rsoconsole.tracking.filters import estimator
from rsoconsole.tracking.filters.adaptive import Bend
from rsoconsole.tracking.filters.agreement import (
    Motion,
    measurement_displacement,
    motion_mismatch,
    pair_misfit_arcsec,
    pair_motion_mismatch,
)
from rsoconsole.tracking.filters.streak_length import (
    NO_ERRORS,
    NO_STREAKS,
    StreakErrors,
    StreakHistory,
    across_error_arcsec,
    along_error_arcsec,
    append_end_offset,
    append_length_excess,
)
from rsoconsole.tracking.initiation import chains
from rsoconsole.tracking.initiation.chains import Chain
from rsoconsole.tracking.initiation.faint import WAITS_AT, FaintChain, faint_chain, waiting_faint

AS_GOOD_AS_CERTAIN = 0.9
"""Confidence from which the smaller position error decides which of two to follow."""


REFUSED, NOT_CHOSEN = NotTaken(kind="refused"), NotTaken(kind="not chosen")


def acquire(
    before: Following, seen: FrameInput, settings: FollowSettings
) -> tuple[Following, tuple[FoldRecord, ...]]:
    """Initiate tracks from frames whose measurements agree on one motion (``chains``).

    The most confident measurement with a partner in an earlier frame leads; among those with a
    confidence of ``AS_GOOD_AS_CERTAIN`` or more, the one with the smallest position error. Where no
    measurements do, candidates below tau may (``faint``). Streaks cut by the frame's edge, and
    those of a class outside ``TRACKABLE_CLASSES``, initiate no track unless the operator chose
    them. Each measurement that is not accepted is recorded once, with its
    reason; one that waits for a second frame is recorded with that frame.
    """
    whole = tuple(m for m in seen.measurements if not m.is_clipped)
    usable = tuple(m for m in whole if m.object_class in TRACKABLE_CLASSES)
    not_chosen: tuple[NotFollowed, ...] = ()
    if seen.chosen is not None:
        not_chosen = tuple(not_followed_record(m, NOT_CHOSEN) for m in usable if m != seen.chosen)
        usable = (seen.chosen,)
    if settings.choice == "nearest":
        usable = tuple(sorted(usable, key=_rank))
    aside = tuple(
        not_followed_record(m, NotTaken(kind="clipped at start"))
        for m in seen.measurements
        if m.is_clipped and m != seen.chosen
    )
    aside += tuple(
        not_followed_record(m, NotTaken(kind="class", object_class=m.object_class))
        for m in whole
        if m.object_class not in TRACKABLE_CLASSES and m != seen.chosen
    )
    aside += not_chosen
    refused = tuple(not_followed_record(m, REFUSED) for m in seen.refused)
    agreed: dict[Measurement, Chain] = {}
    if settings.filter.uses_filter_bank:
        agreed = chains.find_chains(before, usable, seen, settings)
    for second in usable:
        if settings.filter.uses_filter_bank:
            earlier = agreed.get(second, ())
        else:
            earlier = _partner(before.candidates, second, seen)
        if earlier:
            lead = (*earlier, second)
            return _begun(lead, agreed, before, usable, (*aside, *refused), seen, settings)
    faint = _faint_chain(before, usable, seen, settings)
    if faint is not None and faint.begins:
        after, records = _begun(
            faint.streaks, {}, before, usable, (*aside, *refused), seen, settings
        )
        return after, (*records, *_agreed(faint, before, "TRACK"))
    alone = tuple(not_followed_record(m, _no_partner(m, usable, seen)) for m in before.candidates)
    waits = faint is not None and not usable and faint.probability >= WAITS_AT
    state: LoopState = "ACQUIRE" if usable or waits else "SEARCH"
    waiting = chains.waiting_measurements(before, ()) if chains.uses_window(settings) else ()
    after = before.without_track(state, usable, waiting)
    said = _agreed(faint, before, "ACQUIRE") if faint is not None and waits else ()
    return replace(after, faint=waiting_faint(before, seen)), (*alone, *aside, *refused, *said)


def _faint_chain(
    before: Following, usable: Chain, seen: FrameInput, settings: FollowSettings
) -> FaintChain | None:
    """Chain with streaks below tau; None where the operator, or another preset, decides."""
    is_asked = chains.uses_window(settings) and seen.chosen is None and not before.dropped
    return faint_chain(before, usable, seen, settings) if is_asked else None


def _agreed(found: FaintChain, before: Following, after: LoopState) -> tuple[StateChange, ...]:
    """Change of state that a chain with streaks below tau leads to, if it is one."""
    if before.state == after:
        return ()
    reason = Cause(
        kind="faint frames agree",
        frames=len(found.streaks),
        probability=min(round(found.probability, 2), 0.99),
    )
    frame_id = found.streaks[-1].frame_id
    return (StateChange(frame_id=frame_id, before=before.state, after=after, reason=reason),)


def _partner(candidates: Chain, second: Measurement, seen: FrameInput) -> Chain:
    """Partner of the frame before that agrees best, if any does."""
    partners = [
        first
        for first in candidates
        if pair_motion_mismatch(first, second, seen.exposure_s) is None
    ]
    if not partners:
        return ()
    return (min(partners, key=lambda m: pair_misfit_arcsec(m, second, seen.exposure_s)),)


def _begun(  # noqa: PLR0917 -- one call, each argument a different thing
    lead: Chain,
    agreed: dict[Measurement, Chain],
    before: Following,
    usable: tuple[Measurement, ...],
    set_aside: tuple[NotFollowed, ...],
    seen: FrameInput,
    settings: FollowSettings,
) -> tuple[Following, tuple[FoldRecord, ...]]:
    """Initiate the lead, and beside it a track of every other chain as far as there is room."""
    is_alone = seen.chosen is not None or not settings.filter.uses_filter_bank
    room = 1 if is_alone else settings.filter.most_tracks
    others = [(*agreed[m], m) for m in usable if m in agreed and m is not lead[-1]]
    begun_with = [lead, *others[: room - 1]]
    tracks = tuple(
        new_track(
            chain, before.last_track_id + number, seen, settings, is_lead=chain is lead, trial=trial
        )
        for number, (chain, trial) in enumerate(
            zip(begun_with, chains.trial_update_counts(begun_with, settings), strict=True), 1
        )
    )
    used = {m for chain in begun_with for m in chain}
    left = tuple(m for m in (*before.candidates, *usable) if m not in used)
    refused = (not_followed_record(m, NotTaken(kind="another leads")) for m in left)
    after = Following(
        state="TRACK",
        candidates=tuple(m for m in usable if m not in used) if room > 1 else (),
        earlier=chains.waiting_measurements(before, used)
        if room > 1 and chains.uses_window(settings)
        else (),
        tracks=tracks,
        pattern=_pattern_of(tracks, begun_with, seen),
        last_track_id=before.last_track_id + len(tracks),
        dropped=before.dropped,
    )
    begun = tuple(each.track for each in tracks)
    return after, (*begun, *with_track_id((*refused, *set_aside), begun[0].track_id))


def _pattern_of(
    tracks: tuple[LiveTrack, ...], begun_with: list[Chain], seen: FrameInput
) -> TrackPattern:
    """Relative positions of tracks that begin together, from their frames."""
    found = NO_PATTERN
    alive = [each.track.track_id for each in tracks]
    frames: dict[int, dict[int, TrackPlace]] = {}
    times: dict[int, int] = {}
    for each, chain in zip(tracks, begun_with, strict=True):
        expected = expected_motion(each.track, seen.exposure_s)
        for m in chain:
            along = along_error_arcsec(m, expected)
            shown = frames.setdefault(m.frame_id, {})
            shown[each.track.track_id] = TrackPlace.from_measurement(m, each.track, along)
            times.setdefault(m.frame_id, m.t_mid_utc_ns)
    for frame_id in sorted(frames, key=lambda frame_id: times[frame_id]):
        found = patterns.pattern_after(found, alive, frames[frame_id], times[frame_id])
    return found


def new_track(
    chain: Chain,
    track_id: int,
    seen: FrameInput,
    settings: FollowSettings,
    *,
    is_lead: bool,
    trial: int = chains.ON_TRIAL,
) -> LiveTrack:
    """Initiate a new track through a chain of two measurements or more.

    ``trial``: as in ``LiveTrack``.
    """
    track = track_from_pair(chain[0], chain[1], track_id, seen, settings)
    streaks = append_to_streak_history(NO_STREAKS, track, chain[1], seen)
    for m in chain[2:]:
        at = estimator.predict(track, m.t_mid_utc_ns, settings.filter, m.frame_id)
        expected = expected_motion(at, seen.exposure_s)
        errors = streak_errors(m, expected, streaks, settings)
        track = estimator.update(at, m, settings.filter, errors)
        streaks = append_to_streak_history(streaks, track, m, seen)
    if len(chain) > 2:
        track = replace(
            track,
            kind="initial",
            nis=None,
            innovation_arcsec=None,
            sigma_innovation_arcsec=None,
            begun_with=(chain[0].measurement_id, chain[-1].measurement_id),
            begun_through=tuple(m.measurement_id for m in chain[1:-1]),
        )
    track = replace(track, is_lead=is_lead)
    return LiveTrack(
        track=track,
        taken=chain[-1],
        neighbours=updated_neighbours((), track, chain[-1], seen),
        streaks=streaks,
        since_utc_ns=chain[-1].t_mid_utc_ns,
        trial=trial,
    )


def track_from_pair(
    first: Measurement,
    second: Measurement,
    track_id: int,
    seen: FrameInput,
    settings: FollowSettings,
) -> TrackState:
    """Initiate a track through two measurements."""
    way = measurement_displacement(first, second)
    share = seen.exposure_s * 1e9 / max(second.t_mid_utc_ns - first.t_mid_utc_ns, 1)
    moved = Motion(way.east_arcsec * share, way.north_arcsec * share)
    return estimator.initialise(
        first,
        second,
        settings.filter,
        track_id=track_id,
        bend=_bend_of(first, second, settings),
        along_arcsec=(along_error_arcsec(first, moved), along_error_arcsec(second, moved)),
        is_shutter_known=settings.is_shutter_known,
    )


def append_to_streak_history(
    before: StreakHistory, track: TrackState, taken: Measurement, seen: FrameInput
) -> StreakHistory:
    """Return the history of a track's streak shapes, with one more measurement's streak.

    End offsets are kept for preset ``adaptive`` only.
    """
    expected, turns = expected_motion(track, seen.exposure_s), before.half_turns_arcsec
    return StreakHistory(
        excesses_arcsec=append_length_excess(before.excesses_arcsec, taken, expected),
        half_turns_arcsec=()
        if track.mixture is None
        else append_end_offset(turns, taken, expected),
    )


def streak_errors(
    m: Measurement, expected: Motion, before: StreakHistory, settings: FollowSettings
) -> StreakErrors:
    """Return the errors of a streak's middle that its shape indicates.

    ``before``: history of the track's earlier streaks. ``NO_ERRORS`` for presets without a bank.
    """
    if not settings.filter.uses_filter_bank:
        return NO_ERRORS  # the other presets believe what a measurement states
    return StreakErrors(
        along_error_arcsec(m, expected, before.excesses_arcsec),
        across_error_arcsec(m, expected, before.half_turns_arcsec, before.excesses_arcsec),
    )


def _bend_of(first: Measurement, second: Measurement, settings: FollowSettings) -> Bend | None:
    """Possible bend of an orbit through the first of two measurements."""
    if settings.bend is None or not settings.filter.uses_filter_bank:
        return None
    way, here = measurement_displacement(first, second), (first.ra_icrs_deg, first.dec_icrs_deg)
    dt_s = (second.t_mid_utc_ns - first.t_mid_utc_ns) / 1e9
    return settings.bend(
        first.t_mid_utc_ns, here, (way.east_arcsec / dt_s, way.north_arcsec / dt_s)
    )


def _rank(m: Measurement) -> tuple[float, float]:
    """Sort key, lowest first: by confidence as far as it separates them, then by variance."""
    east, _, north = m.cov_sky_arcsec2
    return -min(m.confidence, AS_GOOD_AS_CERTAIN), east + north


def _no_partner(first: Measurement, usable: tuple[Measurement, ...], seen: FrameInput) -> NotTaken:
    """Reason why a candidate found no partner, by the measurement nearest to being its second."""
    if not usable:
        return NotTaken(kind="no second frame", missed=seen.miss_reason)
    nearest = min(usable, key=lambda m: pair_misfit_arcsec(first, m, seen.exposure_s))
    mismatch = pair_motion_mismatch(first, nearest, seen.exposure_s)
    return NotTaken(kind="no second frame", mismatch=mismatch)


def updated_neighbours(
    before: tuple[Neighbour, ...], track: TrackState, taken: Measurement, seen: FrameInput
) -> tuple[Neighbour, ...]:
    if taken.is_clipped:
        return before  # where it was taken is not where it is
    expected = expected_motion(track, seen.exposure_s)
    others = {
        m: learnt_error_arcsec(m, track)
        for m in seen.measurements
        if m.measurement_id != taken.measurement_id
        and not m.is_clipped
        and motion_mismatch(m, expected) is None
    }
    return neighbours_after(before, taken, others, learnt_error_arcsec(taken, track))
