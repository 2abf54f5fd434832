"""Takeover of a track without fitting streaks, by streaks that fit only each other. Pure."""

import math
from dataclasses import dataclass, replace

import numpy as np

from rsoconsole.records import Cause, FoldRecord, Measurement, NotFollowed, NotTaken, TrackState
from rsoconsole.tracking._gates import nis_of
from rsoconsole.tracking.association.following import (
    TRACKABLE_CLASSES,
    FollowSettings,
    FrameInput,
    LiveTrack,
    Rival,
    expected_motion,
    three_sigma_deg,
)
from rsoconsole.tracking.association.neighbours import Field
from rsoconsole.tracking.filters import estimator, lqe
from rsoconsole.tracking.filters.agreement import SHORTER_TOLERANCE, motion_between, motion_mismatch
from rsoconsole.tracking.filters.streak_length import StreakErrors, along_error_arcsec
from rsoconsole.tracking.initiation.acquisition import track_from_pair
from rsoconsole.tracking.initiation.chains import agree_on_motion

SURE_ODDS = 100.0
"""Odds (to one) from which a rival takes the track over."""
MIN_RIVAL_FRAMES = 3
MANOEUVRE_PROBABILITY = 0.002
WRONG_PAIR_PROBABILITY = 0.05
"""Probability that a track's first two streaks are of two objects, while no third fits it."""
UNDETECTED = 0.1
"""Probability that an object in the field is not detected although nothing hides it."""
OTHERS_A_DEG2 = 0.04
"""Density of other objects with a like motion, per square degree: a crowded part of the belt."""
_BROKEN_ARCSEC = 60.0
"""Scale of the distance to where it reappears, arcsec; far away the density falls with the cube."""
_MOST = 8
_MAX_MISSED = 6
"""Number of frames without it from which more count no further: whatever hides it may last."""
_KEPT_S = 130.0
"""Longest time that a rival is kept without another streak of it, s."""
_MAX_UNFIT = 6


@dataclass(frozen=True, slots=True, kw_only=True)
class Reacquisition:
    """Decision that a rival is the tracked object, with the pair that restarts the track."""

    pair: tuple[Measurement, Measurement]
    """Last two measurements of the rival, which initiate the track again."""
    cause: Cause


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameResult:
    """Result of one frame for one track: the track after it, and the frame's records."""

    records: tuple[FoldRecord, ...]
    after: LiveTrack | None
    """Track after the frame; None where it has ended."""
    is_measured: bool = False
    begins_with: Measurement | None = None
    """Measurement of another object, which the operator wants followed in place of this track."""
    reacquired: Reacquisition | None = None


def add_rivals_or_take_over(  # noqa: PLR0917 -- one call, each argument a different thing
    step: FrameResult,
    before: LiveTrack,
    predicted: TrackState,
    reasons: dict[Measurement, NotTaken],
    is_absent: bool,
    seen: FrameInput,
    settings: FollowSettings,
) -> FrameResult:
    """Return a coasting track's result with its rivals, or with a takeover by one of them.

    Rivals are streaks that do not fit the track but fit each other. ``reasons``: why the frame's
    measurements do not belong to the track. ``is_absent``: True where the frame should have shown
    the object and did not.
    """
    unfit = tuple(m for m, why in reasons.items() if why.kind in {"NIS", "moves otherwise"})
    # Of whatever class: what flashes looks like a chain of stars now and then.
    usable = tuple(m for m in unfit if not m.is_clipped)
    # What the operator will not have is no rival either.
    known = () if seen.refused else before.rivals
    rivals = _rivals_after(known, usable[:_MAX_UNFIT], seen, settings)
    unexplained = before.unexplained + is_absent
    assert step.after is not None
    after = replace(step.after, rivals=rivals, unexplained=unexplained)
    likely = [
        (rival_odds(rival, predicted, unexplained), rival)
        for rival in rivals
        if rival.measurements[-1].frame_id == seen.frame_id
        and any(m.object_class in TRACKABLE_CLASSES for m in rival.measurements)
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
            detail = (
                f"{away.length_arcsec:.0f} arcsec from the prediction:"
                f" {len(rival.measurements)} frames agree, {min(chance, 1e6):.0f} to 1"
            )
            found = Reacquisition(
                pair=(rival.measurements[-2], last), cause=Cause(kind="re-acquired", detail=detail)
            )
            others = tuple(
                r for r in step.records if not isinstance(r, NotFollowed) or r.measurement != last
            )
            return replace(step, records=others, after=after, reacquired=found)
    return replace(step, after=after)


def _rivals_after(
    before: tuple[Rival, ...],
    unfit: tuple[Measurement, ...],
    seen: FrameInput,
    settings: FollowSettings,
) -> tuple[Rival, ...]:
    """Return the rivals after a frame that did not show the track; the longest first."""
    left, found = list(unfit), list[Rival]()
    for rival in sorted(before, key=lambda each: -len(each.measurements)):
        longer = _longer(rival, left, seen, settings)
        if longer is not None:
            left.remove(longer.measurements[-1])
            found.append(longer)
        elif (seen.t_mid_utc_ns - rival.measurements[-1].t_mid_utc_ns) / 1e9 <= _KEPT_S:
            found.append(rival)
    found += [Rival(measurements=(each,)) for each in left]
    return tuple(sorted(found, key=lambda each: -len(each.measurements)))[:_MOST]


def _longer(
    rival: Rival, left: list[Measurement], seen: FrameInput, settings: FollowSettings
) -> Rival | None:
    """Return a rival with the best of the measurements that fit it; None where none does."""
    fits: list[tuple[float, Measurement, TrackState]] = []
    predicted = None
    if rival.track is not None and left:
        at = (seen.t_mid_utc_ns, settings.filter, seen.frame_id)
        predicted = estimator.predict(rival.track, *at)
    for each in left:
        if predicted is None:
            track = _rival_track(rival.measurements[-1], each, seen, settings)
        else:
            track = _rival_updated(predicted, each, seen, settings)
        if track is not None:
            fits.append((track.nis or 0.0, each, track))
    if not fits:
        return None
    _, taken, track = min(fits, key=lambda fit: fit[0])
    return Rival(measurements=(*rival.measurements, taken), track=track)


def rival_odds(rival: Rival, predicted: TrackState, unexplained: int) -> float:
    """Return the odds that a rival is the tracked object rather than another one.

    ``predicted``: the track at the rival's last frame. ``unexplained``: number of frames in which
    the tracked object was not detected although nothing hid it.
    """
    if len(rival.measurements) < MIN_RIVAL_FRAMES:
        return 0.0
    last = rival.measurements[-1]
    away = motion_between(
        *lqe.direction_icrs_deg(predicted), last.ra_icrs_deg, last.dec_icrs_deg
    ).length_arcsec
    spread = lqe.sky_covariance_arcsec2(predicted)
    scale2 = _BROKEN_ARCSEC**2 + math.sqrt(max(float(spread[0, 0] * spread[1, 1]), 0.0))
    # Cauchy's density in two dimensions.
    reappears = (1.0 + away**2 / scale2) ** -1.5 / (2.0 * math.pi * scale2)
    another = OTHERS_A_DEG2 / 3600.0**2
    missed = min(unexplained, _MAX_MISSED)
    breaks = WRONG_PAIR_PROBABILITY if predicted.innovations == 0 else MANOEUVRE_PROBABILITY
    return float(breaks * reappears / another * UNDETECTED**-missed)


def _rival_track(
    first: Measurement, second: Measurement, seen: FrameInput, settings: FollowSettings
) -> TrackState | None:
    """Start a track through two measurements of different frames; None where they disagree."""
    if not agree_on_motion(first, second, seen.exposure_s):
        return None
    return track_from_pair(first, second, 0, seen, settings)


def _rival_updated(
    predicted: TrackState, m: Measurement, seen: FrameInput, settings: FollowSettings
) -> TrackState | None:
    """Update a track predicted to a later measurement; None where it does not fit."""
    expected = expected_motion(predicted, seen.exposure_s)
    if motion_mismatch(m, expected, SHORTER_TOLERANCE) is not None:
        return None
    errors = StreakErrors(along_error_arcsec(m, expected))
    update = estimator.candidate_update(predicted, m, settings.filter, errors)
    return None if lqe.is_gated_out(nis_of(update), settings.filter) else update.state


def is_in_field(predicted: TrackState, field: Field | None) -> bool:
    """True where the frame should have shown the object; also where ``field`` is unknown."""
    if field is None:
        return True
    inside_arcsec = np.array([3600.0 * three_sigma_deg(predicted)])
    ra_deg, dec_deg = lqe.direction_icrs_deg(predicted)
    return bool(field.holds(np.array([ra_deg]), np.array([dec_deg]), inside_arcsec)[0])


def is_neighbour(m: Measurement, tracked: LiveTrack) -> bool:
    """True where a measurement lies at the expected place of a known neighbour of the track.

    ``tracked``: the track, predicted to the measurement's frame.
    """
    predicted, to = tracked.track, (m.ra_icrs_deg, m.dec_icrs_deg)
    away = motion_between(*lqe.direction_icrs_deg(predicted), *to)
    spread_arcsec = 3600.0 * three_sigma_deg(predicted)
    return any(
        math.hypot(away.east_arcsec - n.east_arcsec, away.north_arcsec - n.north_arcsec)
        < 3.0 * n.sigma_arcsec(predicted.t_utc_ns) + spread_arcsec
        for n in tracked.neighbours
    )
