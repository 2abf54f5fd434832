"""A frame in which nothing fits a track: what fits only each other may take it over. Pure."""

import math
from dataclasses import dataclass, replace

import numpy as np

from rsoconsole.reasons import Cause, NotTaken
from rsoconsole.records import FoldRecord, Measurement, NotFollowed, TrackState
from rsoconsole.tracking.association import (
    MAY_BE_FOLLOWED,
    SURE_ODDS,
    Field,
    FollowSettings,
    RivalFilter,
    Seen,
    Tracked,
    after_miss,
    expected_motion,
    odds,
    three_sigma_deg,
)
from rsoconsole.tracking.filters import (
    SHORTER_TOLERANCE,
    StreakErrors,
    along_error_arcsec,
    disagreement,
    estimator,
    lqe,
    motion_between,
)
from rsoconsole.tracking.gates import nis_of
from rsoconsole.tracking.initiation import agree, initiated

_MOST_UNFIT = 6


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
    rivals = after_miss(known, usable[:_MOST_UNFIT], t_utc_ns, rival_filter)
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
