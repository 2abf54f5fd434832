"""From what each frame showed to what is followed: a fold over recorded inputs.

``follow(before, seen, settings)`` is pure, so the engine, ``process``, what-if and a replay of a
session all get the same track from the same inputs, bit for bit. States and their passages are
those of the architecture page; IDLE, MANUAL and FAULT belong to who holds the mount and are set
from outside.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from rsoconsole.config import FilterConfig
from rsoconsole.reasons import Cause, Missed, NotTaken, TrackLost
from rsoconsole.records import (
    FoldRecord,
    LoopState,
    Measurement,
    Miss,
    NotFollowed,
    StateChange,
    TrackState,
)
from rsoconsole.tracking import estimator, lqe
from rsoconsole.tracking.adaptive import Bend
from rsoconsole.tracking.association import (
    LENGTH_TOLERANCE,
    LONGER_TOLERANCE,
    SHORTER_TOLERANCE,
    Motion,
    agree,
    disagreement,
    motion_between,
    pair_disagreement,
    pair_misfit_arcsec,
    paired,
)
from rsoconsole.tracking.neighbours import (
    LEAST_MARGIN,
    Field,
    Neighbour,
    best_match,
    remembered,
)
from rsoconsole.tracking.rivals import SURE_ODDS, Rival, RivalFilter, after_miss, odds
from rsoconsole.tracking.streak_length import along_error_arcsec, remembered_with

Choice = Literal["nearest", "most confident"]
AS_GOOD_AS_CERTAIN = 0.9
"""Confidence from which on how well its place is known says which of two to follow."""

NOTHING_SEEN = Missed(kind="no detection")
CROSSED = Missed(kind="crossing")
MAY_BE_FOLLOWED = ("satellite", "undetermined")
"""Classes of streaks that start a track; any other is told so, unless the operator chose it."""
REFUSED, NOT_CHOSEN = NotTaken(kind="refused"), NotTaken(kind="not chosen")
ANOTHER_OBJECT_NIS = 100.0
"""What the operator chooses ten sigmas from the prediction is another object: it begins anew."""
ALONE_FOR_S = 100.0
"""How long the motions of preset ``adaptive`` are believed without an orbit: three frames or so."""
_ABSENT = ("no detection", "nothing fits")
"""Misses that say that it was not there."""
_MOST_UNFIT = 6
CANNOT_TELL = NotTaken(kind="cannot be told apart")


@dataclass(frozen=True, slots=True, kw_only=True)
class Seen:
    """What one frame showed."""

    frame_id: int
    t_mid_utc_ns: int
    exposure_s: float
    measurements: tuple[Measurement, ...]
    """Most confident first."""
    absence: Missed | Callable[[], Missed] = NOTHING_SEEN
    """What a miss of this frame is put down to; a function is asked only where there is one."""
    field: Field | None = None
    """What the frame could show; None where that is not known."""
    chosen: Measurement | None = None
    """The one that the operator wants followed; one of ``measurements``."""
    refused: tuple[Measurement, ...] = ()
    """Those that the operator wants left alone; none of ``measurements``."""
    by_orbit: Callable[[TrackState], TrackState | None] | None = None
    """What the orbit foretells in the place of a prediction that failed; None where it does not.
    Asked only where nothing fits."""

    @property
    def why_absent(self) -> Missed:
        """What a miss of this frame is put down to."""
        return self.absence if isinstance(self.absence, Missed) else self.absence()


@dataclass(frozen=True, slots=True, kw_only=True)
class FollowSettings:
    """What the fold depends on beside its inputs."""

    filter: FilterConfig
    half_field_deg: float
    """Distance from the centre to the nearest edge of the usable field."""
    choice: Choice = "nearest"
    bend: Callable[[int, tuple[float, float], tuple[float, float]], Bend | None] | None = None
    """How an orbit through a direction with a rate (east, north, arcsec/s) may bend at an instant;
    None: nobody knows."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Tracked:
    """One track between two frames."""

    track: TrackState
    """Last state of the filter: updated, or predicted to the frame that missed."""
    taken: Measurement | None = None
    """The last measurement the track took."""
    neighbours: tuple[Neighbour, ...] = ()
    """What moves alike beside it."""
    rivals: tuple[Rival, ...] = ()
    """What has fitted nothing since, but each other; preset ``adaptive`` only."""
    unexplained: int = 0
    """Frames since then in which nothing hid it, and it was not there."""
    excesses_arcsec: tuple[float, ...] = ()
    """By how much its last streaks were longer than it moves in one exposure."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Following:
    """The loop between two frames."""

    state: LoopState = "SEARCH"
    candidates: tuple[Measurement, ...] = ()
    """Measurements of the last frame, one of which may start a track."""
    tracks: tuple[Tracked, ...] = ()
    """The lead first; empty where nothing is followed."""
    last_track_id: int = 0
    """Of the session's last track that has begun; 0 before the first."""

    @property
    def lead(self) -> Tracked | None:
        """The track that the telescope follows; None where there is none."""
        return self.tracks[0] if self.tracks else None

    @property
    def track(self) -> TrackState | None:
        """The lead's last state of the filter."""
        return self.tracks[0].track if self.tracks else None

    @property
    def taken(self) -> Measurement | None:
        """The last measurement the lead took."""
        return self.tracks[0].taken if self.tracks else None

    @property
    def track_id(self) -> int | None:
        """Of the lead; None where there is none."""
        return self.tracks[0].track.track_id if self.tracks else None

    def without_track(
        self, state: LoopState, candidates: tuple[Measurement, ...] = ()
    ) -> "Following":
        """Nothing is followed any more; the next track is another one."""
        return Following(state=state, candidates=candidates, last_track_id=self.last_track_id)


def follow(
    before: Following, seen: Seen, settings: FollowSettings
) -> tuple[Following, tuple[FoldRecord, ...]]:
    """The next state, and what to put on the record, in order."""
    seen, crossings = _without_crossings(seen)
    if before.state not in ("TRACK", "COAST") or not before.tracks:
        after, records = _acquire(before, seen, settings)
    else:
        after, records = _follow_tracks(before, seen, settings)
    records += _of_track(crossings, before.track_id)
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
    """Without what the next frame needs of it, which is large: that goes along in what follows."""
    if isinstance(record, TrackState) and record.memory is not None:
        return replace(record, memory=None)
    return record


def _without_crossings(seen: Seen) -> tuple[Seen, tuple[NotFollowed, ...]]:
    """What the frame showed that has a place in time, and the rest as not taken.

    Where neither end is in the frame nobody knows when it was where: even the operator's choice
    makes no measurement of it. What lies beside it is followed as ever.
    """
    crossings = tuple(m for m in seen.measurements if m.is_crossing)
    if not crossings:
        return seen, ()
    rest = tuple(m for m in seen.measurements if not m.is_crossing)
    is_all = not rest and seen.absence == NOTHING_SEEN
    left = replace(
        seen,
        measurements=rest,
        chosen=None if seen.chosen in crossings else seen.chosen,
        absence=CROSSED if is_all else seen.absence,
    )
    return left, tuple(_not_followed(m, NotTaken(kind="crossing")) for m in crossings)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Step:
    """What one frame makes of one track."""

    records: tuple[FoldRecord, ...]
    after: Tracked | None
    """None where the track has ended."""
    is_measured: bool = False
    begins_with: Measurement | None = None
    """Another object that the operator wants followed in its place."""
    reacquired: "_Reacquired | None" = None


@dataclass(frozen=True, slots=True, kw_only=True)
class _Reacquired:
    """What did not fit has turned out to be what is followed."""

    first: Measurement
    second: Measurement
    away_arcsec: float
    """From where the track had it."""
    frames: int
    odds: float


def _follow_tracks(
    before: Following, seen: Seen, settings: FollowSettings
) -> tuple[Following, tuple[FoldRecord, ...]]:
    """Each track in turn, the lead first; what one has taken is none of the next ones'.

    Where the lead ends, the next track leads.
    """
    steps: list[_Step] = []
    records: tuple[FoldRecord, ...] = ()
    left, last_track_id, causes = seen, before.last_track_id, list[Cause]()
    for number, each in enumerate(before.tracks):
        if number == 0 and seen.chosen is not None:
            step = _follow_chosen(each, seen.chosen, seen, settings)
        else:
            step = _follow_track(each, left, settings)
        refused = seen.refused if number == 0 else ()
        if step.reacquired is not None:
            last_track_id += 1
            causes += [_cause_of(step.reacquired)] * (number == 0)
            step = _initiated_again(step, each.track.is_lead, last_track_id, seen, settings)
        steps.append(step)
        told = (*step.records, *(_not_followed(m, REFUSED) for m in refused))
        records += _of_track(told, each.track.track_id)
        if step.begins_with is not None:
            return before.without_track("ACQUIRE", (step.begins_with,)), records
        is_last = number + 1 == len(before.tracks)
        if step.is_measured and step.after is not None and not is_last:
            others = tuple(m for m in left.measurements if m != step.after.taken)
            left = replace(left, measurements=others, chosen=None)
    after = replace(_led(before, tuple(steps)), last_track_id=last_track_id)
    if causes and after.state == "TRACK":
        change = StateChange(
            frame_id=seen.frame_id, before=before.state, after="TRACK", reason=causes[0]
        )
        records = (*records, change)
    return after, records


def _led(before: Following, steps: tuple[_Step, ...]) -> Following:
    """What goes on, the lead first."""
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
    )


def _of_track(records: tuple[FoldRecord, ...], track_id: int | None) -> tuple[FoldRecord, ...]:
    """What was not taken and what was missed, each with its track."""
    return tuple(
        replace(each, track_id=track_id) if isinstance(each, NotFollowed | Miss) else each
        for each in records
    )


def _reason(
    before: Following, after: Following, records: tuple[FoldRecord, ...], seen: Seen
) -> Cause:
    if after.state == "TRACK":
        return Cause(kind="measured again" if before.state == "COAST" else "two frames agree")
    if after.state == "ACQUIRE":
        return Cause(kind="waiting", detections=len(seen.measurements))
    lead = before.track_id
    missed = next((r for r in records if isinstance(r, Miss) and r.track_id == lead), None)
    return Cause(kind="missed", missed=seen.why_absent if missed is None else missed.reason)


def _acquire(
    before: Following, seen: Seen, settings: FollowSettings
) -> tuple[Following, tuple[FoldRecord, ...]]:
    """Two successive frames whose measurements agree on one motion start a track.

    The most confident one that has a partner leads; of those as good as certain, the one whose
    place is known best, which is the brightest as a rule. What the frame cuts, and what is surely
    no satellite, starts none unless the operator chose it. Every measurement hears its verdict
    once: a candidate that waits for a second frame hears it with that frame.
    """
    whole = tuple(m for m in seen.measurements if not m.is_clipped)
    usable = tuple(m for m in whole if m.object_class in MAY_BE_FOLLOWED)
    told_of_choice: tuple[NotFollowed, ...] = ()
    if seen.chosen is not None:
        told_of_choice = tuple(_not_followed(m, NOT_CHOSEN) for m in usable if m != seen.chosen)
        usable = (seen.chosen,)
    if settings.choice == "nearest":
        usable = tuple(sorted(usable, key=_rank))
    aside = tuple(
        _not_followed(m, NotTaken(kind="clipped at start"))
        for m in seen.measurements
        if m.is_clipped and m != seen.chosen
    )
    aside += tuple(
        _not_followed(m, NotTaken(kind="class", object_class=m.object_class))
        for m in whole
        if m.object_class not in MAY_BE_FOLLOWED and m != seen.chosen
    )
    aside += told_of_choice
    refused = tuple(_not_followed(m, REFUSED) for m in seen.refused)
    pairs: dict[Measurement, Measurement] = {}
    if settings.filter.preset == "adaptive":
        pairs = paired(before.candidates, usable, seen.exposure_s)
    for second in usable:
        if settings.filter.preset == "adaptive":
            partners = [pairs[second]] if second in pairs else []
        else:
            partners = [
                first
                for first in before.candidates
                if pair_disagreement(first, second, seen.exposure_s) is None
            ]
        if partners:
            first = min(partners, key=lambda m: pair_misfit_arcsec(m, second, seen.exposure_s))
            others = tuple(
                m for m in (*before.candidates, *usable) if m is not first and m is not second
            )
            track_id = before.last_track_id + 1
            track = _initiated(first, second, track_id, seen, settings)
            told = (_not_followed(m, NotTaken(kind="another leads")) for m in others)
            beside = _beside((), track, second, seen)
            after = Following(
                state="TRACK",
                tracks=(
                    Tracked(
                        track=track,
                        taken=second,
                        neighbours=beside,
                        excesses_arcsec=_excesses((), track, second, seen),
                    ),
                ),
                last_track_id=track_id,
            )
            return after, _of_track((track, *told, *aside, *refused), track_id)
    alone = tuple(_not_followed(m, _no_partner(m, usable, seen)) for m in before.candidates)
    state: LoopState = "ACQUIRE" if usable else "SEARCH"
    return before.without_track(state, usable), (*alone, *aside, *refused)


def _initiated(
    first: Measurement, second: Measurement, track_id: int, seen: Seen, settings: FollowSettings
) -> TrackState:
    """A track through two measurements."""
    here, there = (first.ra_icrs_deg, first.dec_icrs_deg), (second.ra_icrs_deg, second.dec_icrs_deg)
    way = motion_between(*here, *there)
    share = seen.exposure_s * 1e9 / max(second.t_mid_utc_ns - first.t_mid_utc_ns, 1)
    moved = Motion(way.east_arcsec * share, way.north_arcsec * share)
    return estimator.initialise(
        first,
        second,
        settings.filter,
        track_id=track_id,
        bend=_bend_of(first, second, settings),
        along_arcsec=(along_error_arcsec(first, moved), along_error_arcsec(second, moved)),
    )


def _updated(
    predicted: TrackState, m: Measurement, before: Tracked, seen: Seen, settings: FollowSettings
) -> TrackState:
    """A track after a measurement, whose error its streak's length tells too."""
    expected = expected_motion(predicted, seen.exposure_s)
    along = along_error_arcsec(m, expected, before.excesses_arcsec)
    return estimator.update(predicted, m, settings.filter, along)


def _excesses(
    before: tuple[float, ...], track: TrackState, taken: Measurement, seen: Seen
) -> tuple[float, ...]:
    return remembered_with(before, taken, expected_motion(track, seen.exposure_s))


def _bend_of(first: Measurement, second: Measurement, settings: FollowSettings) -> Bend | None:
    """What an orbit through the first of two measurements may do."""
    if settings.bend is None or settings.filter.preset != "adaptive":
        return None
    here, there = (first.ra_icrs_deg, first.dec_icrs_deg), (second.ra_icrs_deg, second.dec_icrs_deg)
    way = motion_between(*here, *there)
    dt_s = (second.t_mid_utc_ns - first.t_mid_utc_ns) / 1e9
    return settings.bend(
        first.t_mid_utc_ns, here, (way.east_arcsec / dt_s, way.north_arcsec / dt_s)
    )


def _rank(m: Measurement) -> tuple[float, float]:
    """Lowest first: by confidence as far as it tells them apart, then by variance."""
    east, _, north = m.cov_sky_arcsec2
    return -min(m.confidence, AS_GOOD_AS_CERTAIN), east + north


def _no_partner(first: Measurement, usable: tuple[Measurement, ...], seen: Seen) -> NotTaken:
    """Why a candidate came to nothing, by what came nearest to being its second."""
    if not usable:
        return NotTaken(kind="no second frame", missed=seen.why_absent)
    nearest = min(usable, key=lambda m: pair_misfit_arcsec(first, m, seen.exposure_s))
    mismatch = pair_disagreement(first, nearest, seen.exposure_s)
    return NotTaken(kind="no second frame", mismatch=mismatch)


def _beside(
    before: tuple[Neighbour, ...], track: TrackState, taken: Measurement, seen: Seen
) -> tuple[Neighbour, ...]:
    if taken.is_clipped:
        return before  # where it was taken is not where it is
    expected = expected_motion(track, seen.exposure_s)
    others = tuple(
        m
        for m in seen.measurements
        if m != taken and not m.is_clipped and disagreement(m, expected) is None
    )
    return remembered(before, taken, others)


def _follow_track(before: Tracked, seen: Seen, settings: FollowSettings) -> _Step:
    predicted = _predicted(before, seen, settings)
    step, reasons = _taken_by(predicted, before, seen, settings)
    is_filters = predicted.foretold_by == "filter"
    if step is None and seen.measurements and seen.by_orbit is not None and is_filters:
        by_orbit = seen.by_orbit(predicted)
        if by_orbit is not None:
            step, _ = _taken_by(by_orbit, before, seen, settings)
    if step is not None:
        return step
    reason = seen.why_absent
    if seen.measurements and reason == NOTHING_SEEN:
        reason = Missed(kind="nothing fits")
    is_nothing_fitting = isinstance(reason, Missed) and reason.kind == "nothing fits"
    if isinstance(reason, Missed) and is_nothing_fitting and CANNOT_TELL in reasons.values():
        reason = replace(reason, kind="cannot be told apart")
    updated = {m: _updated(predicted, m, before, seen, settings) for m in seen.measurements}
    refused = _verdicts(reasons, updated)
    step = _coast(before, predicted, seen, settings, (predicted, *refused), reason)
    if settings.filter.preset != "adaptive" or step.after is None:
        return step
    is_absent = isinstance(reason, Missed) and reason.kind in _ABSENT and not reason.hidden_by
    is_absent = is_absent and _is_in_field(predicted, seen.field)
    return _with_rivals(step, before, predicted, reasons, is_absent, seen, settings)


def _with_rivals(  # noqa: PLR0917 -- one call, each argument a different thing
    step: _Step,
    before: Tracked,
    predicted: TrackState,
    reasons: dict[Measurement, NotTaken],
    is_absent: bool,
    seen: Seen,
    settings: FollowSettings,
) -> _Step:
    """A step that coasts, with what fits nothing but each other, and whether that takes over."""
    unfit = tuple(m for m, why in reasons.items() if why.kind in {"NIS", "moves otherwise"})
    # Of whatever class: what flashes looks like a chain of stars now and then.
    usable = tuple(m for m in unfit if not m.is_clipped)
    t_utc_ns, frame_id = seen.t_mid_utc_ns, seen.frame_id
    rival_filter = RivalFilter(
        start=lambda first, second: _rival_track(first, second, seen, settings),
        predict=lambda track: estimator.predict(track, t_utc_ns, settings.filter, frame_id),
        update=lambda there, m: _rival_updated(there, m, seen, settings),
    )
    # What the operator will not have is no rival either.
    known = () if seen.refused else before.rivals
    rivals = after_miss(known, usable[:_MOST_UNFIT], t_utc_ns, rival_filter)
    unexplained = before.unexplained + is_absent
    assert step.after is not None
    after = replace(step.after, rivals=rivals, unexplained=unexplained)
    likely = [
        (odds(rival, predicted, unexplained), rival)
        for rival in rivals
        if rival.measurements[-1].frame_id == seen.frame_id
        and any(m.object_class in MAY_BE_FOLLOWED for m in rival.measurements)
        and not _is_neighbour(rival.measurements[-1], predicted, before.neighbours)
    ]
    if likely:
        chance, rival = max(likely, key=lambda each: each[0])
        last = rival.measurements[-1]
        if chance >= SURE_ODDS:
            to = (last.ra_icrs_deg, last.dec_icrs_deg)
            away = motion_between(*lqe.direction_icrs_deg(predicted), *to)
            found = _Reacquired(
                first=rival.measurements[-2],
                second=last,
                away_arcsec=away.length_arcsec,
                frames=len(rival.measurements),
                odds=chance,
            )
            others = tuple(
                r for r in step.records if not isinstance(r, NotFollowed) or r.measurement != last
            )
            return replace(step, records=others, after=after, reacquired=found)
    return replace(step, after=after)


def _rival_track(
    first: Measurement, second: Measurement, seen: Seen, settings: FollowSettings
) -> TrackState | None:
    """A track through two measurements of different frames; None where they disagree."""
    if not agree(first, second, seen.exposure_s):
        return None
    return _initiated(first, second, 0, seen, settings)


def _rival_updated(
    predicted: TrackState, m: Measurement, seen: Seen, settings: FollowSettings
) -> TrackState | None:
    """A track that was predicted to a measurement after it; None where it does not fit."""
    expected = expected_motion(predicted, seen.exposure_s)
    if disagreement(m, expected, SHORTER_TOLERANCE) is not None:
        return None
    updated = estimator.update(predicted, m, settings.filter, along_error_arcsec(m, expected))
    return None if lqe.is_gated_out(_nis(updated), settings.filter) else updated


def _is_in_field(predicted: TrackState, field: Field | None) -> bool:
    """Whether the frame should have shown it, as far as the frame's field is known."""
    if field is None:
        return True
    inside_arcsec = np.array([3600.0 * three_sigma_deg(predicted)])
    ra_deg, dec_deg = lqe.direction_icrs_deg(predicted)
    return bool(field.holds(np.array([ra_deg]), np.array([dec_deg]), inside_arcsec)[0])


def _is_neighbour(m: Measurement, predicted: TrackState, neighbours: tuple[Neighbour, ...]) -> bool:
    """Whether a measurement stands where a known neighbour of what is followed should."""
    to = (m.ra_icrs_deg, m.dec_icrs_deg)
    away = motion_between(*lqe.direction_icrs_deg(predicted), *to)
    spread_arcsec = 3600.0 * three_sigma_deg(predicted)
    return any(
        math.hypot(away.east_arcsec - n.east_arcsec, away.north_arcsec - n.north_arcsec)
        < 3.0 * n.sigma_arcsec(predicted.t_utc_ns) + spread_arcsec
        for n in neighbours
    )


def _initiated_again(
    step: _Step, is_lead: bool, track_id: int, seen: Seen, settings: FollowSettings
) -> _Step:
    """A new track takes the place of one that had gone astray."""
    found = step.reacquired
    assert found is not None
    track = _initiated(found.first, found.second, track_id, seen, settings)
    track = replace(track, is_lead=is_lead)
    fresh = Tracked(
        track=track,
        taken=found.second,
        neighbours=_beside((), track, found.second, seen),
        excesses_arcsec=_excesses((), track, found.second, seen),
    )
    return _Step(records=(*step.records, track), after=fresh, is_measured=True)


def _cause_of(found: _Reacquired) -> Cause:
    return Cause(
        kind="re-acquired",
        detail=(
            f"{found.away_arcsec:.0f} arcsec from the prediction:"
            f" {found.frames} frames agree, {min(found.odds, 1e6):.0f} to 1"
        ),
    )


def _predicted(before: Tracked, seen: Seen, settings: FollowSettings) -> TrackState:
    """Where the track is at a frame: after a while unseen, by the orbit of all that was seen.

    No motion without an orbit predicts a long coast; preset ``tuned`` asks the orbit only where
    its own prediction fits nothing.
    """
    predicted = estimator.predict(before.track, seen.t_mid_utc_ns, settings.filter, seen.frame_id)
    if settings.filter.preset != "adaptive" or seen.by_orbit is None or before.taken is None:
        return predicted
    coasted_s = (seen.t_mid_utc_ns - before.taken.t_mid_utc_ns) / 1e9
    if coasted_s <= ALONE_FOR_S:
        return predicted
    return seen.by_orbit(predicted) or predicted


def _taken_by(
    predicted: TrackState, before: Tracked, seen: Seen, settings: FollowSettings
) -> tuple[_Step | None, dict[Measurement, NotTaken]]:
    """The measurement that fits a prediction: the step with it, None where none does.

    With why the others do not fit.
    """
    expected = expected_motion(predicted, seen.exposure_s)
    updated = {m: _updated(predicted, m, before, seen, settings) for m in seen.measurements}
    reasons: dict[Measurement, NotTaken] = {}
    if settings.choice == "nearest":  # the paper's rule asks for nothing but confidence
        reasons = _refusals(predicted, expected, updated, before.neighbours, seen, settings)
    fitting = [m for m in seen.measurements if m not in reasons]
    if not fitting:
        return None, reasons
    chosen = fitting[0]
    if settings.choice == "nearest":
        chosen = min(fitting, key=lambda m: _nis(updated[m]))
    reasons |= {m: NotTaken(kind="another taken") for m in fitting if m is not chosen}
    told: tuple[FoldRecord, ...] = (predicted, updated[chosen], *_verdicts(reasons, updated))
    return _measured(updated[chosen], before, chosen, seen, told), reasons


def _measured(
    track: TrackState,
    before: Tracked,
    taken: Measurement,
    seen: Seen,
    records: tuple[FoldRecord, ...],
) -> _Step:
    """A track that has taken a measurement."""
    beside = _beside(before.neighbours, track, taken, seen)
    excesses = _excesses(before.excesses_arcsec, track, taken, seen)
    after = Tracked(track=track, taken=taken, neighbours=beside, excesses_arcsec=excesses)
    return _Step(records=records, after=after, is_measured=True)


def _follow_chosen(
    before: Tracked, chosen: Measurement, seen: Seen, settings: FollowSettings
) -> _Step:
    """What the operator wants followed is taken whatever the gates say, or begins a new track."""
    predicted = estimator.predict(before.track, seen.t_mid_utc_ns, settings.filter, seen.frame_id)
    others = tuple(_not_followed(m, NOT_CHOSEN) for m in seen.measurements if m != chosen)
    updated = _updated(predicted, chosen, before, seen, settings)
    if _nis(updated) > ANOTHER_OBJECT_NIS:
        return _Step(records=(predicted, *others), after=None, begins_with=chosen)
    return _measured(updated, before, chosen, seen, (predicted, updated, *others))


def _refusals(  # noqa: PLR0917 -- one call, each argument a different thing
    predicted: TrackState,
    expected: Motion,
    updated: dict[Measurement, TrackState],
    neighbours: tuple[Neighbour, ...],
    seen: Seen,
    settings: FollowSettings,
) -> dict[Measurement, NotTaken]:
    """Which measurements do not belong to the track, and why: motion, position, neighbours."""
    reasons: dict[Measurement, NotTaken] = {}
    is_adaptive = settings.filter.preset == "adaptive"
    shares = (LENGTH_TOLERANCE, LENGTH_TOLERANCE)
    if is_adaptive:
        shares = (SHORTER_TOLERANCE, LONGER_TOLERANCE)
    for measurement in updated:
        mismatch = disagreement(measurement, expected, *shares)
        reason = None if mismatch is None else NotTaken(kind="moves otherwise", mismatch=mismatch)
        if reason is None and measurement.is_clipped:
            reason = _too_far_for_clipped(measurement, predicted, expected)
        if reason is not None:
            reasons[measurement] = reason
    alike = tuple(m for m in updated if m not in reasons and not m.is_clipped)
    strangers = _strangers(alike, predicted, expected, neighbours, seen, settings)
    for measurement, state in updated.items():
        if measurement in reasons:
            continue
        if lqe.is_gated_out(_nis(state), settings.filter):
            reasons[measurement] = NotTaken.by_gate(_nis(state), settings.filter.gate_nis)
        elif measurement in strangers:
            reasons[measurement] = strangers[measurement]
    return reasons


def _strangers(  # noqa: PLR0917 -- one call, each argument a different thing
    alike: tuple[Measurement, ...],
    predicted: TrackState,
    expected: Motion,
    neighbours: tuple[Neighbour, ...],
    seen: Seen,
    settings: FollowSettings,
) -> dict[Measurement, NotTaken]:
    """Which of those that move alike are not what is followed, or may not be, and why."""
    if not neighbours or not alike:
        return {}
    match = best_match(
        alike,
        predicted,
        neighbours,
        streak_arcsec=expected.length_arcsec,
        field=seen.field,
    )
    # The paper's bounds are wider than any slot: no position could ever meet a margin in them.
    if settings.filter.preset != "paper" and match.margin < LEAST_MARGIN:
        return dict.fromkeys(alike, CANNOT_TELL)
    others = (m for m in alike if m is not match.measurement)
    return dict.fromkeys(others, NotTaken(kind="neighbour"))


def _too_far_for_clipped(
    measurement: Measurement, predicted: TrackState, expected: Motion
) -> NotTaken | None:
    """Why the visible part of a streak cannot be the track's; None when it can.

    Its own covariance says little along the streak, but its midpoint lies within half a streak
    of the whole one's.
    """
    to = (measurement.ra_icrs_deg, measurement.dec_icrs_deg)
    away = motion_between(*lqe.direction_icrs_deg(predicted), *to).length_arcsec
    allowed = expected.length_arcsec / 2.0 + three_sigma_deg(predicted) * 3600.0
    if away <= allowed:
        return None
    return NotTaken.clipped_and_far(away, allowed)


def _verdicts(
    reasons: dict[Measurement, NotTaken], updated: dict[Measurement, TrackState]
) -> tuple[NotFollowed, ...]:
    return tuple(_not_followed(m, reason, updated[m].nis) for m, reason in reasons.items())


def _not_followed(
    measurement: Measurement, reason: NotTaken, nis: float | None = None
) -> NotFollowed:
    return NotFollowed(
        frame_id=measurement.frame_id, measurement=measurement, reason=reason, nis=nis
    )


def _nis(state: TrackState) -> float:
    return state.nis or 0.0


def _coast(  # noqa: PLR0917 -- one call, each argument a different thing
    before: Tracked,
    predicted: TrackState,
    seen: Seen,
    settings: FollowSettings,
    records: tuple[FoldRecord, ...],
    reason: Missed,
) -> _Step:
    miss = Miss(frame_id=seen.frame_id, reason=reason)
    since_ns = predicted.t_utc_ns if before.taken is None else before.taken.t_mid_utc_ns
    coasted_s = (seen.t_mid_utc_ns - since_ns) / 1e9
    lost: TrackLost | None = None
    # The paper's bounds are wider than any field from the first prediction on and say nothing.
    bound_deg = three_sigma_deg(predicted)
    most_deg = settings.filter.max_3sigma_arcmin / 60.0
    if settings.filter.preset != "paper" and bound_deg > min(settings.half_field_deg, most_deg):
        fits_field = most_deg < settings.half_field_deg
        lost = TrackLost.by_bounds(bound_deg * 60, fits_field=fits_field)
    elif coasted_s > settings.filter.max_coast_s:
        lost = TrackLost.by_time(coasted_s)
    if lost is not None:
        ended = replace(miss, reason=replace(reason, lost=lost))
        return _Step(records=(*records, ended), after=None)
    return _Step(records=(*records, miss), after=replace(before, track=predicted))


def expected_motion(track: TrackState, exposure_s: float) -> Motion:
    """Motion on the sky during one exposure at the track's rates."""
    east_arcsec_s, north_arcsec_s = lqe.sky_rate_arcsec_s(track)
    return Motion(east_arcsec_s * exposure_s, north_arcsec_s * exposure_s)


def three_sigma_deg(track: TrackState) -> float:
    """Half length of the longer side of the 3-sigma box of the state's position on the sky."""
    cos_dec = math.cos(math.radians(track.x[2]))
    return 3.0 * max(math.sqrt(track.P[0][0]) * cos_dec, math.sqrt(track.P[2][2]))
