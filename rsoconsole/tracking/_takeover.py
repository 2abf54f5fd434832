"""A frame in which nothing fits a track: what fits only each other may take it over. Pure."""

import math
from dataclasses import dataclass, replace

import numpy as np

from rsoconsole.records import Cause, FoldRecord, Measurement, NotFollowed, NotTaken, TrackState
from rsoconsole.tracking.association.following import (
    MAY_BE_FOLLOWED,
    SURE_ODDS,
    FollowSettings,
    RivalFilter,
    Seen,
    Tracked,
    after_miss,
    expected_motion,
    not_followed,
    odds,
    three_sigma_deg,
)
from rsoconsole.tracking.association.neighbours import MIN_MARGIN, Field, Neighbour, best_match
from rsoconsole.tracking.association.pattern import learnt_error_arcsec
from rsoconsole.tracking.filters import adaptive, estimator, lqe
from rsoconsole.tracking.filters.agreement import (
    BENT_TOLERANCE_DEG,
    DIRECTION_TOLERANCE_DEG,
    FLASHING_TOLERANCE,
    LENGTH_TOLERANCE,
    LONGER_TOLERANCE,
    PART_TOLERANCE,
    SHORTER_TOLERANCE,
    Motion,
    disagreement,
    motion_between,
)
from rsoconsole.tracking.filters.estimator import Update
from rsoconsole.tracking.filters.streak_length import StreakErrors, along_error_arcsec, shows_parts
from rsoconsole.tracking.initiation import chains
from rsoconsole.tracking.initiation.acquisition import errors_of, initiated
from rsoconsole.tracking.initiation.chains import agree

INDISTINGUISHABLE = NotTaken(kind="cannot be told apart")


def updated_with(
    predicted: TrackState, m: Measurement, before: Tracked, seen: Seen, settings: FollowSettings
) -> Update:
    """A measurement that a track may take, whose error its streak tells too."""
    return all_updated_with(predicted, (m,), before, seen, settings)[m]


def all_updated_with(
    predicted: TrackState,
    measured: tuple[Measurement, ...],
    before: Tracked,
    seen: Seen,
    settings: FollowSettings,
) -> dict[Measurement, Update]:
    """``updated_with`` of several measurements."""
    expected = expected_motion(predicted, seen.exposure_s)
    history = before.excesses_arcsec, before.half_turns_arcsec
    pairs = [(m, errors_of(m, expected, *history, settings)) for m in measured]
    return estimator.all_weighed(predicted, pairs, settings.filter)


def refusals(  # noqa: PLR0917 -- one call, each argument a different thing
    predicted: TrackState,
    expected: Motion,
    updated: dict[Measurement, Update],
    before: Tracked,
    seen: Seen,
    settings: FollowSettings,
) -> dict[Measurement, NotTaken]:
    """Which measurements do not belong to the track, and why: motion, position, neighbours."""
    reasons: dict[Measurement, NotTaken] = {}
    shares = (LENGTH_TOLERANCE, LENGTH_TOLERANCE)
    if settings.filter.preset == "adaptive":
        shares = (_most_missing(expected, before), LONGER_TOLERANCE)
    bent_deg = BENT_TOLERANCE_DEG if chains.is_wide(settings) else DIRECTION_TOLERANCE_DEG
    for measurement in updated:
        mismatch = disagreement(measurement, expected, *shares, bent_deg)
        reason = None if mismatch is None else NotTaken(kind="moves otherwise", mismatch=mismatch)
        if reason is None and measurement.is_clipped:
            reason = _too_far_for_clipped(measurement, predicted, expected)
        if reason is not None:
            reasons[measurement] = reason
    alike = tuple(m for m in updated if m not in reasons and not m.is_clipped)
    neighbours = before.neighbours
    errors = tuple(learnt_error_arcsec(m, updated[m].state) for m in alike) if neighbours else ()
    strangers = _strangers(alike, errors, predicted, expected, neighbours, seen, settings)
    for measurement, update in updated.items():
        if measurement in reasons:
            continue
        if lqe.is_gated_out(nis_of(update), settings.filter):
            reasons[measurement] = NotTaken.by_gate(nis_of(update), settings.filter.gate_nis)
        elif measurement in strangers:
            reasons[measurement] = strangers[measurement]
    return reasons


def _most_missing(expected: Motion, before: Tracked) -> float:
    """Which share of its length a streak of the track may lack."""
    is_flashing = shows_parts(before.excesses_arcsec, expected.length_arcsec)
    return FLASHING_TOLERANCE if is_flashing else PART_TOLERANCE


def _strangers(  # noqa: PLR0917 -- one call, each argument a different thing
    alike: tuple[Measurement, ...],
    errors_arcsec: tuple[float, ...],
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
        errors_arcsec=errors_arcsec,
    )
    # The paper's bounds are wider than any slot: no position could ever meet a margin in them.
    if settings.filter.preset != "paper" and match.margin < MIN_MARGIN:
        return dict.fromkeys(alike, INDISTINGUISHABLE)
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


def rejections(
    reasons: dict[Measurement, NotTaken], updated: dict[Measurement, Update]
) -> tuple[NotFollowed, ...]:
    return tuple(not_followed(m, reason, updated[m].nis) for m, reason in reasons.items())


def nis_of(update: TrackState | Update) -> float:
    return update.nis or 0.0


def off_nis(updated: TrackState, settings: FollowSettings) -> float:
    """How far an innovation is off by the moments: a mixture allows for more."""
    if settings.filter.preset != "adaptive" or updated.innovation_arcsec is None:
        return nis_of(updated)
    off = np.array(updated.innovation_arcsec)
    return float(off @ np.linalg.solve(adaptive.innovation_covariance(updated), off))


_MAX_UNFIT = 6


@dataclass(frozen=True, slots=True, kw_only=True)
class Reacquired:
    """What did not fit has turned out to be what is followed."""

    first: Measurement
    second: Measurement
    away_arcsec: float
    """From where the track had it."""
    frames: int
    odds: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """What one frame makes of one track."""

    records: tuple[FoldRecord, ...]
    after: Tracked | None
    """None where the track has ended."""
    is_measured: bool = False
    begins_with: Measurement | None = None
    """Another object that the operator wants followed in its place."""
    reacquired: Reacquired | None = None


def with_rivals(  # noqa: PLR0917 -- one call, each argument a different thing
    step: Step,
    before: Tracked,
    predicted: TrackState,
    reasons: dict[Measurement, NotTaken],
    is_absent: bool,
    seen: Seen,
    settings: FollowSettings,
) -> Step:
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
    rivals = after_miss(known, usable[:_MAX_UNFIT], t_utc_ns, rival_filter)
    unexplained = before.unexplained + is_absent
    assert step.after is not None
    after = replace(step.after, rivals=rivals, unexplained=unexplained)
    likely = [
        (odds(rival, predicted, unexplained), rival)
        for rival in rivals
        if rival.measurements[-1].frame_id == seen.frame_id
        and any(m.object_class in MAY_BE_FOLLOWED for m in rival.measurements)
        # Two streaks alone may be of two objects: what stood beside them then says nothing.
        and not (
            before.track.innovations
            and is_neighbour(rival.measurements[-1], replace(before, track=predicted))
        )
    ]
    if likely:
        chance, rival = max(likely, key=lambda each: each[0])
        last = rival.measurements[-1]
        if chance >= SURE_ODDS:
            to = (last.ra_icrs_deg, last.dec_icrs_deg)
            away = motion_between(*lqe.direction_icrs_deg(predicted), *to)
            found = Reacquired(
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
    return initiated(first, second, 0, seen, settings)


def _rival_updated(
    predicted: TrackState, m: Measurement, seen: Seen, settings: FollowSettings
) -> TrackState | None:
    """A track that was predicted to a measurement after it; None where it does not fit."""
    expected = expected_motion(predicted, seen.exposure_s)
    if disagreement(m, expected, SHORTER_TOLERANCE) is not None:
        return None
    errors = StreakErrors(along_error_arcsec(m, expected))
    update = estimator.weighed(predicted, m, settings.filter, errors)
    return None if lqe.is_gated_out(nis_of(update), settings.filter) else update.state


def is_in_field(predicted: TrackState, field: Field | None) -> bool:
    """Whether the frame should have shown it, as far as the frame's field is known."""
    if field is None:
        return True
    inside_arcsec = np.array([3600.0 * three_sigma_deg(predicted)])
    ra_deg, dec_deg = lqe.direction_icrs_deg(predicted)
    return bool(field.holds(np.array([ra_deg]), np.array([dec_deg]), inside_arcsec)[0])


def is_neighbour(m: Measurement, tracked: Tracked) -> bool:
    """Whether a measurement stands where a known neighbour of what is followed should.

    ``tracked`` as it was predicted to the measurement's frame.
    """
    predicted, to = tracked.track, (m.ra_icrs_deg, m.dec_icrs_deg)
    away = motion_between(*lqe.direction_icrs_deg(predicted), *to)
    spread_arcsec = 3600.0 * three_sigma_deg(predicted)
    return any(
        math.hypot(away.east_arcsec - n.east_arcsec, away.north_arcsec - n.north_arcsec)
        < 3.0 * n.sigma_arcsec(predicted.t_utc_ns) + spread_arcsec
        for n in tracked.neighbours
    )


def cause_of(found: Reacquired) -> Cause:
    return Cause(
        kind="re-acquired",
        detail=(
            f"{found.away_arcsec:.0f} arcsec from the prediction:"
            f" {found.frames} frames agree, {min(found.odds, 1e6):.0f} to 1"
        ),
    )
