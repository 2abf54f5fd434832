"""Every satellite in the field: what no track has taken may begin another one. Pure.

Two successive frames that agree on one motion begin it, as they do the first; until it has been
measured once more it is on trial and ends with its first miss, so that two false streaks cost one
frame. One that has left the field ends too: the lead alone is looked for.
"""

from dataclasses import replace

import numpy as np

from rsoconsole.reasons import Missed, NotTaken, TrackLost
from rsoconsole.records import FoldRecord, Measurement, Miss, NotFollowed, TrackState
from rsoconsole.tracking import lqe
from rsoconsole.tracking.acquire import first_state
from rsoconsole.tracking.association import motion_between
from rsoconsole.tracking.following import (
    MAY_BE_FOLLOWED,
    Following,
    FollowSettings,
    Seen,
    Tracked,
    three_sigma_deg,
)
from rsoconsole.tracking.pairing import paired
from rsoconsole.tracking.takeover import Step

ON_TRIAL = 1
"""Measurements after its second that a track needs to outlive a miss."""
_SAME_STREAK_ARCSEC = 8.0
"""A streak that lies closer to one that a track has taken is that one, found twice."""
_BEYOND_SIGMAS, _BEYOND_ARCSEC = 5.0, 120.0
_OUTSIDE_S = 300.0


def within_reach(
    measurements: tuple[Measurement, ...], predicted: TrackState
) -> tuple[Measurement, ...]:
    """Those that may be asked whether they are a track's: the others are far beyond any gate."""
    here = lqe.direction_icrs_deg(predicted)
    scatter_s = 0.0 if predicted.mixture is None else predicted.mixture.scatter_high_s
    reach_arcsec = _BEYOND_ARCSEC + _BEYOND_SIGMAS * (
        3600.0 * three_sigma_deg(predicted) / 3.0
        + scatter_s * float(np.hypot(*lqe.sky_rate_arcsec_s(predicted)))
    )
    return tuple(
        m
        for m in measurements
        if motion_between(*here, m.ra_icrs_deg, m.dec_icrs_deg).length_arcsec
        <= reach_arcsec + 3.0 * float(np.sqrt(max(m.cov_sky_arcsec2[0], m.cov_sky_arcsec2[2])))
    )


def ended(step: Step, before: Tracked, seen: Seen) -> Step:
    """A step of one that does not lead: on trial it ends with a miss, and outside the field."""
    if step.after is None or step.is_measured:
        return step
    lost: TrackLost | None = None
    if step.after.track.innovations < ON_TRIAL and not before.is_kept:
        lost = TrackLost(kind="not confirmed")
    elif _has_left(step.after, seen):
        lost = TrackLost(kind="left the field")
    if lost is None:
        return step
    records = tuple(
        replace(r, reason=replace(r.reason, lost=lost))
        if isinstance(r, Miss) and isinstance(r.reason, Missed)
        else r
        for r in step.records
    )
    return Step(records=records, after=None)


def _has_left(coasted: Tracked, seen: Seen) -> bool:
    """Whether a track that a frame does not show has been outside the field for long."""
    if seen.field is None or coasted.taken is None:
        return False
    ra_deg, dec_deg = lqe.direction_icrs_deg(coasted.track)
    holds = seen.field.holds(np.array([ra_deg]), np.array([dec_deg]), np.zeros(1))
    coasted_s = (seen.t_mid_utc_ns - coasted.taken.t_mid_utc_ns) / 1e9
    return not bool(holds[0]) and coasted_s > _OUTSIDE_S


def begun(  # noqa: PLR0917 -- one call, each argument a different thing
    candidates: tuple[Measurement, ...],
    usable: tuple[Measurement, ...],
    last_track_id: int,
    room: int,
    seen: Seen,
    settings: FollowSettings,
) -> tuple[Tracked, ...]:
    """Tracks through what two frames agree on, the surest first; ``room``: for so many."""
    if room <= 0 or not candidates or not usable:
        return ()
    pairs = paired(candidates, usable, seen.exposure_s)
    each = [(pairs[second], second) for second in usable if second in pairs][:room]
    return tuple(
        first_state(first, second, last_track_id + number, seen, settings, is_lead=False)
        for number, (first, second) in enumerate(each, 1)
    )


def left_over(steps: list[Step], seen: Seen) -> tuple[Measurement, ...]:
    """What may begin a track: nobody has taken it, and nobody waits for it.

    What a track that is missed may yet turn out to be (``takeover``) and what may be one of two
    tracks' is not free.
    """
    taken = [s.after.taken for s in steps if s.is_measured and s.after is not None]
    claimed = {
        m
        for step in steps
        if step.after is not None and step.after.unexplained
        for rival in step.after.rivals
        for m in rival.measurements
    }
    claimed |= {
        r.measurement
        for step in steps
        for r in step.records
        if isinstance(r, NotFollowed)
        and isinstance(r.reason, NotTaken)
        and r.reason.kind in {"cannot be told apart", "another taken"}
    }
    return tuple(
        m
        for m in seen.measurements
        if not m.is_clipped
        and m.object_class in MAY_BE_FOLLOWED
        and m not in claimed
        and not any(t is not None and _is_same(m, t) for t in taken)
    )


def _is_same(m: Measurement, taken: Measurement) -> bool:
    to = (taken.ra_icrs_deg, taken.dec_icrs_deg)
    return motion_between(m.ra_icrs_deg, m.dec_icrs_deg, *to).length_arcsec < _SAME_STREAK_ARCSEC


def without_verdicts_on(
    records: tuple[FoldRecord, ...], tracks: tuple[Tracked, ...]
) -> tuple[FoldRecord, ...]:
    """What has begun a track is no longer refused by others."""
    seconds = {each.taken for each in tracks}
    return tuple(
        r for r in records if not (isinstance(r, NotFollowed) and r.measurement in seconds)
    )


def joined_by_new(  # noqa: PLR0917 -- one call, each argument a different thing
    before: Following,
    after: Following,
    steps: list[Step],
    records: tuple[FoldRecord, ...],
    seen: Seen,
    settings: FollowSettings,
) -> tuple[Following, tuple[FoldRecord, ...]]:
    """With the tracks that begin beside those that there are."""
    free = left_over(steps, seen)
    room = settings.filter.most_tracks - len(after.tracks)
    found = begun(before.candidates, free, after.last_track_id, room, seen, settings)
    taken = {each.taken for each in found}
    told = without_verdicts_on(records, found)
    return replace(
        after,
        candidates=tuple(m for m in free if m not in taken),
        tracks=(*after.tracks, *found),
        last_track_id=after.last_track_id + len(found),
    ), (*told, *(each.track for each in found))
