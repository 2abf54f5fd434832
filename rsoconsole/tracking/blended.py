"""Streaks of two satellites: the measurement that each of both tracks may accept. Pure.

Where two satellites of a slot pass each other closer than a camera can resolve, a frame has a
single streak of both. Across the streak it lies somewhere between them, depending on their light;
along it, it is as long as both together, and its middle is that of the pair. Their relative
position is known from earlier frames (``pattern``), so that the streak still measures both: each
track accepts it shifted by half of the relative position, with the unknown division of the light as
its error (the merged measurements of Blair-Bar-Shalom; Bar-Shalom & Li 1995, 6.4, without a second
amplitude). The relative position itself is not updated.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rsoconsole.records import FloatArray, Measurement, TrackState
from rsoconsole.tracking.association.following import FollowSettings, FrameInput, expected_motion
from rsoconsole.tracking.association.pattern import TrackPattern
from rsoconsole.tracking.filters import estimator, lqe
from rsoconsole.tracking.filters.agreement import streak_motion
from rsoconsole.tracking.filters.sky_path import TangentPlane
from rsoconsole.tracking.joint import Assignment, TrackCandidates

WIDTHS = 2.5
"""Distance across the streaks, in star widths, below which two are found as one."""
USUAL_WIDTH_ARCSEC = 3.5
"""Full width of a star at half maximum where it was not measured."""
_LIGHT_SIGMA = 0.5
"""Sigma of the streak's place across the pair, over their distance: alike in every frame."""
_APART_ARCSEC = 12.0
"""Distance along each other, arcsec, from which a streak's length shows whether it is of both."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SharedStreak:
    """One track's part of a streak of two satellites."""

    streak: Measurement
    """The streak of both, as measured in the frame."""
    taken: Measurement
    """Measurement of this track's own place, derived from the streak."""
    updated: TrackState


def shared_streaks(
    weighed: Sequence[TrackCandidates],
    given: Assignment,
    pattern: TrackPattern,
    seen: FrameInput,
    settings: FollowSettings,
) -> dict[int, SharedStreak]:
    """Find streaks that two tracks share; return each track's part by index in ``weighed``.

    Only where the frame could not resolve the two, one of them has no streak of its own, and the
    streak fits both. ``given``: measurements assigned to the tracks so far.
    """
    found: dict[int, SharedStreak] = {}
    if None not in given.taken:
        return found
    tracks = [each.predicted.track_id for each in weighed]
    is_known, ways, covariances = pattern.relative_positions_at(tracks, seen.t_mid_utc_ns)
    for i, j in itertools.combinations(range(len(weighed)), 2):
        if i in found or j in found or (given.taken[i] is not None and given.taken[j] is not None):
            continue
        one, other = weighed[i].predicted, weighed[j].predicted
        known = ways[i, j], covariances[i, j]
        if not is_known[i, j] or not _is_one_streak(one, *known, seen):
            continue
        of_others = {m for n, m in enumerate(given.taken) if m is not None and n not in {i, j}}
        pairs = [
            pair
            for m in seen.measurements
            if m not in of_others
            and m.ends_icrs_deg is not None
            and not m.is_clipped
            and (pair := _of_both(m, (one, other), known, seen, settings)) is not None
        ]
        if pairs:
            best = min(pairs, key=lambda pair: sum(each.updated.nis or 0.0 for each in pair))
            found[i], found[j] = best
    return found


def _axes(state: TrackState) -> tuple[FloatArray, FloatArray]:
    rate = np.array(lqe.sky_rate_arcsec_s(state))
    along = rate / max(float(np.hypot(*rate)), 1e-6)
    return along, np.array([-along[1], along[0]])


def _is_one_streak(
    one: TrackState, way: FloatArray, covariance: FloatArray, seen: FrameInput
) -> bool:
    """True where two at this relative position are detected as one streak."""
    along, across = _axes(one)
    width = WIDTHS * (seen.star_width_arcsec or USUAL_WIDTH_ARCSEC)
    unsure = float(np.sqrt(across @ covariance @ across))
    length = expected_motion(one, seen.exposure_s).length_arcsec
    is_near = abs(float(way @ across)) < width and abs(float(way @ along)) < length
    return is_near and unsure < width  # else another frame may tell


def _of_both(
    m: Measurement,
    states: tuple[TrackState, TrackState],
    known: tuple[FloatArray, FloatArray],
    seen: FrameInput,
    settings: FollowSettings,
) -> tuple[SharedStreak, SharedStreak] | None:
    """Parts of a streak for each of the two tracks; None where it is not of both."""
    way, covariance = known
    along, across = _axes(states[0])
    apart_along, apart_across = abs(float(way @ along)), float(way @ across)
    streak = streak_motion(m)
    length = expected_motion(states[0], seen.exposure_s).length_arcsec
    if streak is None or streak.length_arcsec > 1.5 * (length + apart_along):
        return None
    if apart_along > _APART_ARCSEC and streak.length_arcsec - length < apart_along / 2.0:
        return None  # as long as one of them
    ee, en, nn = m.cov_sky_arcsec2
    spread = np.array([[ee, en], [en, nn]]) + covariance / 4.0
    spread += (_LIGHT_SIGMA * apart_across) ** 2 * np.outer(across, across)
    plane, pieces = TangentPlane.at(m.ra_icrs_deg, m.dec_icrs_deg), []
    for number, state in enumerate(states):
        ra_deg, dec_deg = plane.direction_of(*(way * (number - 0.5)))
        taken = replace(
            m,
            ra_icrs_deg=ra_deg,
            dec_icrs_deg=dec_deg,
            cov_sky_arcsec2=(float(spread[0, 0]), float(spread[0, 1]), float(spread[1, 1])),
            ends_icrs_deg=None,
        )
        updated = estimator.update(state, taken, settings.filter)
        if lqe.is_gated_out(updated.nis or 0.0, settings.filter):
            return None
        with_ = states[1 - number].track_id
        pieces.append(
            SharedStreak(streak=m, taken=taken, updated=replace(updated, shared_with=with_))
        )
    return pieces[0], pieces[1]
