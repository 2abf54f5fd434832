"""What begins a track: two streaks that agree on one motion, or a chain of points. Pure.

A streak tells its motion, so two frames are enough of them. A point (a short exposure, a telescope
that keeps pace) tells nothing but a place: any two points are two points of something. What tells
an object from chance there are frames in a line, and company that moves alike, so points wait in a
window of frames until a chain of them (``link``) is far likelier than chance. A streak that the
frame before did not show may have been hidden in it: beside tracks the frame before that is asked
too.
"""

import math
from collections.abc import Collection, Mapping, Sequence

import numpy as np

from rsoconsole.records import FloatArray, Measurement
from rsoconsole.tracking.association import Following, FollowSettings, Seen, Tracked
from rsoconsole.tracking.filters import (
    SHORTEST_WITH_DIRECTION_ARCSEC,
    Plane,
    lqe,
    motion_between,
    streak_motion,
)
from rsoconsole.tracking.initiation.link import Motion, Tracklet, link_points
from rsoconsole.tracking.initiation.pairing import ALONE_COST, UNPAIRED_COST, UNSURE_COST, paired

WINDOW = 5
"""Frames, the present one among them."""
BEGINS_AT = 0.9
"""Probability from which on a chain of points begins a track: it is not taken back."""
CHANCE = 0.05
"""As many as chance makes of them, at most."""
_ALIKE_SIGMAS, _SHARE = 3.0, 0.02
"""What is near, and what moves alike: number of sigma, and share of the speed."""
_WIDER = 2.2
"""Of the variances that points claim, as a track believes before it has learnt (``bank``)."""
_MOST_POINTS = 60
"""In a window; with more of them there is no telling."""
_FEWEST_FALSE = 0.5
"""Points a frame that are no object's are believed at least."""
APART_COST = ALONE_COST + UNSURE_COST / 2.0
"""Of a pair that goes a way of its own beside tracks: its streaks' directions and lengths by one
sigma each or so. Worse ones wait for frames that show them better."""
ON_TRIAL, APART_ON_TRIAL = 1, 2
"""Measurements after its second that a track needs to outlive a miss; one that moves otherwise than
what is beside it, which chance makes more often. One that moves as another does needs none."""
_AS_ANOTHER_ARCSEC = 10.0
"""What moves as another does differs from its way by less: the shutter's scatter and a slot's."""
Chain = tuple[Measurement, ...]


def is_wide(settings: FollowSettings) -> bool:
    """Whether more than two successive frames are asked."""
    return settings.filter.preset == "adaptive"


def begun(
    before: Following,
    usable: Sequence[Measurement],
    seen: Seen,
    settings: FollowSettings,
    tracks: Sequence[Tracked] = (),
) -> dict[Measurement, Chain]:
    """By its last measurement, one of ``usable``: the earlier ones of each chain, in order of time.

    ``tracks``: what is followed beside it.
    """
    # Two that the operator wants to be one object are.
    if not is_wide(settings) or seen.chosen is not None:
        pairs = paired(before.candidates, usable, seen.exposure_s)
        return {second: (first,) for second, first in pairs.items()}
    streaks, points = _parted(usable)
    found: dict[Measurement, Chain] = {}
    ways = [lqe.sky_rate_arcsec_s(each.track) for each in tracks]
    firsts, older = _parted(before.candidates)[0], _parted(before.earlier)[0]
    asked = [(firsts, APART_COST if tracks else UNPAIRED_COST)]
    if tracks and older:
        last_but_one = max(m.frame_id for m in older)
        # What chance makes of frames that do not follow each other has a way of its own.
        asked.append(([m for m in older if m.frame_id == last_but_one], UNSURE_COST))
    for these, unpaired in asked:
        left = [m for m in streaks if m not in found]
        pairs = paired(these, left, seen.exposure_s, ways, unpaired=unpaired)
        found |= {second: (first,) for second, first in pairs.items()}
    return found | _of_points(points, before, seen, settings, ways)


def trials(
    begun_with: Sequence[Chain],
    settings: FollowSettings,
    rates_arcsec_s: Sequence[tuple[float, float]] = (),
) -> list[int]:
    """Of each chain that begins a track, how often that must be measured to outlive a miss.

    ``rates_arcsec_s``: of the tracks beside it, east and north.
    """
    if not is_wide(settings):
        return [ON_TRIAL] * len(begun_with)
    found = []
    for chain in begun_with:
        first, second = chain[0], chain[-1]
        dt_s = (second.t_mid_utc_ns - first.t_mid_utc_ns) / 1e9
        way = _way(chain)
        others = [rate * dt_s for rate in map(np.array, rates_arcsec_s)]
        others += [
            _way(each) for each in begun_with if each is not chain and _same_frames(each, chain)
        ]
        away = min((float(np.hypot(*(way - other))) for other in others), default=math.inf)
        if len(chain) > 2 or not others:
            found.append(ON_TRIAL)
        else:
            found.append(0 if away <= _AS_ANOTHER_ARCSEC else APART_ON_TRIAL)
    return found


def _way(chain: Chain) -> FloatArray:
    """From a chain's first to its last, arcsec east and north."""
    first, last = chain[0], chain[-1]
    to = (last.ra_icrs_deg, last.dec_icrs_deg)
    moved = motion_between(first.ra_icrs_deg, first.dec_icrs_deg, *to)
    return np.array([moved.east_arcsec, moved.north_arcsec])


def _same_frames(one: Chain, other: Chain) -> bool:
    return (one[0].frame_id, one[-1].frame_id) == (other[0].frame_id, other[-1].frame_id)


def kept(before: Following, taken: Collection[Measurement]) -> Chain:
    """Of the frames before this one what may still begin a track with later ones."""
    waiting = [m for m in (*before.earlier, *before.candidates) if m not in taken]
    frames = sorted({m.frame_id for m in waiting}, reverse=True)[: WINDOW - 2]
    return tuple(m for m in waiting if m.frame_id in frames)


def _parted(
    measurements: Sequence[Measurement],
) -> tuple[list[Measurement], list[Measurement]]:
    """Streaks and points."""
    streaks = [m for m in measurements if streak_motion(m) is not None]
    return streaks, [m for m in measurements if streak_motion(m) is None]


def _of_points(
    points: list[Measurement],
    before: Following,
    seen: Seen,
    settings: FollowSettings,
    ways: Sequence[tuple[float, float]],
) -> dict[Measurement, Chain]:
    waiting = _parted((*before.earlier, *before.candidates))[1]
    window = _by_frame([*waiting, *points])
    if not points or len(window) < 2 or sum(map(len, window.values())) > _MOST_POINTS:
        return {}
    plane = Plane.at(points[0].ra_icrs_deg, points[0].dec_icrs_deg)
    frames = list(window.values())
    places = [
        np.array([plane.place_of(m.ra_icrs_deg, m.dec_icrs_deg) for m in each]) for each in frames
    ]
    t_s = [(each[0].t_mid_utc_ns - seen.t_mid_utc_ns) / 1e9 for each in frames]
    known = _known(frames, seen, settings, ways)
    found = [each for each in link_points(t_s, places, known) if each.probability >= BEGINS_AT]
    last = len(frames) - 1
    return {
        chain[-1]: chain[:-1]
        for each in found
        if each.points[-1][0] == last
        and _by_chance(each, found, [len(each) for each in frames], t_s, known) < CHANCE
        for chain in [_measured(each, frames)]
    }


def _by_chance(
    tracklet: Tracklet,
    neighbours: Sequence[Tracklet],
    counts: Sequence[int],
    t_s: Sequence[float],
    known: Motion,
) -> float:
    """How many such chains, beside others that move alike, chance makes of these counts of points.

    Any two points make a chain with any motion. A point more has to lie on its line; another chain,
    or a track, has to have its motion.
    """
    alike = [each for each in neighbours if _is_alike(each, tracklet, t_s, known)]
    anyhow = math.pi * known.largest_speed**2
    number = 1.0
    for place, each in enumerate(sorted(alike, key=lambda each: -len(each.points))):
        first, last = each.points[0][0], each.points[-1][0]
        number *= counts[first] * counts[last]
        if place or known.common is not None:
            number *= _reach(_spread2(each, tracklet, t_s, known)) / anyhow
        for frame, _ in each.points[1:-1]:
            number *= counts[frame] * _reach(1.5 * known.sigma**2) / known.area
    return number


def _is_alike(one: Tracklet, other: Tracklet, t_s: Sequence[float], known: Motion) -> bool:
    """Whether two move as one, as far as their points tell."""
    if one is other:
        return True
    away2 = (one.x_rate - other.x_rate) ** 2 + (one.y_rate - other.y_rate) ** 2
    return away2 < _ALIKE_SIGMAS**2 * _spread2(one, other, t_s, known)


def _reach(variance: float) -> float:
    """Area in which a point counts as near."""
    return math.pi * _ALIKE_SIGMAS**2 * variance


def _spread2(one: Tracklet, other: Tracklet, t_s: Sequence[float], known: Motion) -> float:
    """Variance on an axis of one rate against another's."""
    own = sum(
        2.0 * (known.sigma / (t_s[each.points[-1][0]] - t_s[each.points[0][0]])) ** 2
        for each in (one, other)
    )
    return own + (_SHARE * math.hypot(other.x_rate, other.y_rate)) ** 2


def _measured(tracklet: Tracklet, frames: Sequence[Sequence[Measurement]]) -> Chain:
    return tuple(frames[frame][number] for frame, number in tracklet.points)


def _by_frame(points: Sequence[Measurement]) -> Mapping[int, list[Measurement]]:
    found: dict[int, list[Measurement]] = {}
    for m in sorted(points, key=lambda m: m.t_mid_utc_ns):
        found.setdefault(m.frame_id, []).append(m)
    return found


def _known(
    frames: Sequence[Sequence[Measurement]],
    seen: Seen,
    settings: FollowSettings,
    ways: Sequence[tuple[float, float]],
) -> Motion:
    """What the points and the field say of themselves."""
    every = [m for each in frames for m in each]
    variances = [0.5 * (m.cov_sky_arcsec2[0] + m.cov_sky_arcsec2[2]) for m in every]
    common = None
    if ways:
        middle = np.median(np.array(ways), axis=0)
        common = (float(middle[0]), float(middle[1]))
    return Motion(
        sigma=math.sqrt(_WIDER * max(float(np.median(variances)), lqe.SIGMA_FLOOR_ARCSEC**2)),
        area=(7200.0 * settings.half_field_deg) ** 2,
        # Faster, it would have drawn a streak.
        largest_speed=SHORTEST_WITH_DIRECTION_ARCSEC / seen.exposure_s,
        false_points=max(float(np.median([len(each) for each in frames])), _FEWEST_FALSE),
        common=common,
    )
