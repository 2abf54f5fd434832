"""Gates of one track: measurements that may belong to it, and reasons against others. Pure."""

import numpy as np

from rsoconsole.records import Measurement, NotFollowed, NotTaken, TrackState
from rsoconsole.tracking.association.following import (
    FollowSettings,
    FrameInput,
    LiveTrack,
    expected_motion,
    not_followed_record,
    three_sigma_deg,
)
from rsoconsole.tracking.association.neighbours import MIN_MARGIN, Neighbour, best_match
from rsoconsole.tracking.association.pattern import learnt_error_arcsec
from rsoconsole.tracking.filters import adaptive, estimator, lqe
from rsoconsole.tracking.filters.agreement import (
    BENT_TOLERANCE_DEG,
    DIRECTION_TOLERANCE_DEG,
    FLASHING_TOLERANCE,
    LENGTH_TOLERANCE,
    LONGER_TOLERANCE,
    PART_TOLERANCE,
    Motion,
    motion_between,
    motion_mismatch,
)
from rsoconsole.tracking.filters.estimator import CandidateUpdate
from rsoconsole.tracking.filters.streak_length import is_flashing_by_lengths
from rsoconsole.tracking.initiation import chains
from rsoconsole.tracking.initiation.acquisition import streak_errors

INDISTINGUISHABLE = NotTaken(kind="cannot be told apart")


def track_updates(
    predicted: TrackState,
    measured: tuple[Measurement, ...],
    before: LiveTrack,
    seen: FrameInput,
    settings: FollowSettings,
) -> dict[Measurement, CandidateUpdate]:
    """Possible updates of a track, one for each measurement that it might accept.

    Each is made with the errors that the streak's shape indicates.
    """
    expected = expected_motion(predicted, seen.exposure_s)
    pairs = [(m, streak_errors(m, expected, before.streaks, settings)) for m in measured]
    return estimator.candidate_updates(predicted, pairs, settings.filter)


def gate_rejection_reasons(  # noqa: PLR0917 -- one call, each argument a different thing
    predicted: TrackState,
    expected: Motion,
    updated: dict[Measurement, CandidateUpdate],
    before: LiveTrack,
    seen: FrameInput,
    settings: FollowSettings,
) -> dict[Measurement, NotTaken]:
    """Return by measurement why it does not belong to the track: motion, position, neighbour.

    A measurement without an entry has passed all gates. ``expected``: the track's motion in one
    exposure. ``updated``: as from `track_updates`.
    """
    reasons: dict[Measurement, NotTaken] = {}
    shares = (LENGTH_TOLERANCE, LENGTH_TOLERANCE)
    if settings.filter.uses_filter_bank:
        is_flashing = is_flashing_by_lengths(before.streaks.excesses_arcsec, expected.length_arcsec)
        shares = (FLASHING_TOLERANCE if is_flashing else PART_TOLERANCE, LONGER_TOLERANCE)
    bent_deg = BENT_TOLERANCE_DEG if chains.uses_window(settings) else DIRECTION_TOLERANCE_DEG
    for measurement in updated:
        mismatch = motion_mismatch(measurement, expected, *shares, bent_deg)
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


def _strangers(  # noqa: PLR0917 -- one call, each argument a different thing
    alike: tuple[Measurement, ...],
    errors_arcsec: tuple[float, ...],
    predicted: TrackState,
    expected: Motion,
    neighbours: tuple[Neighbour, ...],
    seen: FrameInput,
    settings: FollowSettings,
) -> dict[Measurement, NotTaken]:
    """Reasons why measurements that move alike are not, or may not be, the tracked object."""
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
    """Reason why the visible part of a streak cannot be the track's; None when it can.

    Its own covariance says little along the streak, but its midpoint lies within half a streak of
    the whole one's.
    """
    to = (measurement.ra_icrs_deg, measurement.dec_icrs_deg)
    away = motion_between(*lqe.direction_icrs_deg(predicted), *to).length_arcsec
    allowed = expected.length_arcsec / 2.0 + three_sigma_deg(predicted) * 3600.0
    if away <= allowed:
        return None
    return NotTaken.clipped_and_far(away, allowed)


def rejection_records(
    reasons: dict[Measurement, NotTaken], updated: dict[Measurement, CandidateUpdate]
) -> tuple[NotFollowed, ...]:
    return tuple(not_followed_record(m, reason, updated[m].nis) for m, reason in reasons.items())


def nis_of(update: TrackState | CandidateUpdate) -> float:
    return update.nis or 0.0


def mixture_moments_nis(updated: TrackState, settings: FollowSettings) -> float:
    """NIS by the mean and covariance of the mixture alone.

    The update's own NIS is smaller, since it allows for the tails of the mixture. For a preset
    without a bank both are the same.
    """
    if not settings.filter.uses_filter_bank or updated.innovation_arcsec is None:
        return nis_of(updated)
    off = np.array(updated.innovation_arcsec)
    return float(off @ np.linalg.solve(adaptive.innovation_covariance(updated), off))
