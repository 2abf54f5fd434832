"""Chains that initiate a track: two streaks of one motion, or several points. Pure.

A streak shows its motion, so streaks in two frames are enough. A point (a short exposure, a
telescope that tracks the object) shows only a place, and any two points could be one object. Points
of one object differ from chance in that they lie on a line over several frames, and that other
objects move alike. So points wait in a window of frames until chance is far less likely than a
chain of them (``link``). A streak may have been hidden in the previous frame: beside existing
tracks it may also pair with a streak of the frame before that.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rsoconsole.records import FloatArray, Measurement
from rsoconsole.sky import IntArray
from rsoconsole.tracking.association.following import (
    Following,
    FollowSettings,
    FrameInput,
    LiveTrack,
)
from rsoconsole.tracking.filters import lqe
from rsoconsole.tracking.filters.agreement import (
    DIRECTION_TOLERANCE_DEG,
    SHORTEST_WITH_DIRECTION_ARCSEC,
    Motion,
    measurement_displacement,
    motion_in_exposure,
    streak_motion,
)
from rsoconsole.tracking.filters.sky_path import TangentPlane
from rsoconsole.tracking.initiation.link import MotionPrior, Tracklet, link_points

LOST_TOLERANCE = 0.4
"""Fraction of its expected length by which a streak of a pair may be too short or too long."""
ACROSS_ARCSEC, ACROSS_SHARE, LENGTH_SHARE = 3.0, 0.02, 0.15
"""Sigma of a streak's direction, as displacement across it, and of its length."""
BEND_DEG = 5.0
"""Sigma of the bend that all streaks of a frame share."""
COMMON_ARCSEC, COMMON_SHARE = 10.0, 0.05
"""Sigma of the motion from frame to frame that satellites of one field share."""
ALONE_COST = 12.0
"""Cost of a pair that moves unlike the others."""
UNSURE_COST = 8.0
"""Largest cost by errors of a pair with its own motion: directions, lengths by two sigmas each."""
UNPAIRED_COST = ALONE_COST + UNSURE_COST
_NOBODY = 1e6
"""Cost of a streak without a partner: as many as possible have one."""
_FREEDOM = 4.0
"""Degrees of freedom of the law by which directions and lengths err."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Half:
    """One streak of a pair against the displacement between both."""

    cost: float
    bend_deg: float = 0.0
    """Angle of its direction from the displacement's, counted towards east; 0 where it has none."""
    sigma_deg: float = math.inf


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Pairs:
    """Every second streak with every first one: (seconds, firsts)."""

    cost: FloatArray
    """Cost of the lengths; infinite where they are no pair."""
    bends_deg: FloatArray
    """(seconds, firsts, 2) bend of each streak from the displacement."""
    sigmas_deg: FloatArray
    """(seconds, firsts, 2) sigma of the bends."""
    ways_arcsec: FloatArray
    """(seconds, firsts, 2) displacement east and north from frame to frame."""


def pairs_between(
    firsts: Sequence[Measurement],
    seconds: Sequence[Measurement],
    exposure_s: float,
    rates_arcsec_s: Sequence[tuple[float, float]] = (),
    *,
    unpaired: float | None = None,
) -> dict[Measurement, Measurement]:
    """Pair the measurements of two frames that agree on one motion.

    Returns the first of each pair by the second. The pairing is the likeliest as a whole, and each
    measurement is in one pair at most: of two neighbours of which the first frame shows one, that
    one is paired with itself. ``rates_arcsec_s``: rates of the existing tracks (east, north).
    ``unpaired``: cost of a measurement without a partner; None: as many pairs as possible.
    """
    pairs = _pairs(firsts, seconds, exposure_s)
    is_one = np.isfinite(pairs.cost)
    if not is_one.any():
        return {}
    if unpaired is not None:
        dt_s = (seconds[0].t_mid_utc_ns - firsts[0].t_mid_utc_ns) / 1e9
        known = [np.array(rate) * dt_s for rate in rates_arcsec_s]
        rows, columns = _assigned(pairs, known, unpaired)
    else:
        rows, columns = _assigned(pairs) if is_one.sum() > 1 else is_one.nonzero()
    return {
        seconds[row]: firsts[column]
        for row, column in zip(rows.tolist(), columns.tolist(), strict=True)
        if is_one[row, column]
    }


def agree_on_motion(first: Measurement, second: Measurement, exposure_s: float) -> bool:
    """True where two measurements of different frames agree on one motion."""
    return _halves(first, second, exposure_s) is not None


def _pairs(
    firsts: Sequence[Measurement], seconds: Sequence[Measurement], exposure_s: float
) -> _Pairs:
    shape = (len(seconds), len(firsts))
    cost = np.full(shape, np.inf)
    bends, sigmas, ways = np.zeros((*shape, 2)), np.full((*shape, 2), np.inf), np.zeros((*shape, 2))
    for row, second in enumerate(seconds):
        for column, first in enumerate(firsts):
            halves = _halves(first, second, exposure_s)
            if halves is None:
                continue
            way = measurement_displacement(first, second)
            cost[row, column] = sum(each.cost for each in halves)
            bends[row, column] = [each.bend_deg for each in halves]
            sigmas[row, column] = [each.sigma_deg for each in halves]
            ways[row, column] = (way.east_arcsec, way.north_arcsec)
    return _Pairs(cost=cost, bends_deg=bends, sigmas_deg=sigmas, ways_arcsec=ways)


def _assigned(
    pairs: _Pairs, known_ways: Sequence[FloatArray] = (), unpaired: float = _NOBODY
) -> tuple[IntArray, IntArray]:
    """Find the likeliest assignment: second and first of each pair.

    ``known_ways``: displacements of the tracks from frame to frame; ``unpaired``: cost of one
    without.
    """
    # scipy weighs half a second: only who has a choice to make pays for it.
    from scipy.optimize import linear_sum_assignment

    is_one = np.isfinite(pairs.cost)
    anchors = [
        (pairs.ways_arcsec[row, column], pairs.bends_deg[row, column])
        for row, column in np.argwhere(is_one)
    ]
    anchors += [(way, np.zeros(2)) for way in known_ways]
    best = (math.inf, np.empty(0, np.int64), np.empty(0, np.int64))
    for way, bend in anchors:
        away2 = np.sum((pairs.ways_arcsec - way) ** 2, axis=-1)
        sigma = COMMON_ARCSEC + COMMON_SHARE * math.hypot(*way)
        bent = _student((pairs.bends_deg - bend) / pairs.sigmas_deg).sum(axis=-1)
        cost = pairs.cost + bent + np.minimum(away2 / sigma**2, ALONE_COST)
        cost = np.where(is_one & (cost < unpaired), cost, unpaired)
        rows, columns = linear_sum_assignment(cost)
        total = float(cost[rows, columns].sum() + _student(bend / BEND_DEG).sum())
        if total < best[0]:
            is_pair = cost[rows, columns] < unpaired
            best = (total, rows[is_pair], columns[is_pair])
    return best[1], best[2]


def _halves(
    first: Measurement, second: Measurement, exposure_s: float
) -> tuple[_Half, _Half] | None:
    """Both streaks against the displacement between them; None where they cannot be one object."""
    moved = motion_in_exposure(first, second, exposure_s)
    if moved is None:
        return None
    one, other = _half(first, moved), _half(second, moved)
    return None if one is None or other is None else (one, other)


def _half(measurement: Measurement, moved: Motion) -> _Half | None:
    streak = streak_motion(measurement)
    if streak is None:
        return _Half(cost=0.0)
    expected, length = moved.length_arcsec, streak.length_arcsec
    bend_deg, sigma_deg = 0.0, math.inf
    if min(length, expected) > SHORTEST_WITH_DIRECTION_ARCSEC:
        bend_deg = (streak.axis_deg - moved.axis_deg + 90.0) % 180.0 - 90.0
        if abs(bend_deg) > DIRECTION_TOLERANCE_DEG:
            return None
        sigma_deg = math.degrees(max(ACROSS_ARCSEC / expected, ACROSS_SHARE))
    if measurement.is_clipped:
        return _Half(cost=0.0, bend_deg=bend_deg, sigma_deg=sigma_deg)
    shorter = expected - length
    if abs(shorter) >= LOST_TOLERANCE * expected + 10.0:
        return None
    cost = float(_student(np.array(shorter / (LENGTH_SHARE * expected + 3.0))))
    return _Half(cost=cost, bend_deg=bend_deg, sigma_deg=sigma_deg)


def _student(sigmas: FloatArray) -> FloatArray:
    """Cost of errors given in sigma, with the tails of Student's law."""
    return np.asarray((_FREEDOM + 2.0) * np.log1p(sigmas**2 / _FREEDOM))


WINDOW = 5
"""Number of frames in which points wait, the present one among them."""
BEGINS_AT = 0.9
"""Probability from which a chain of points initiates a track: it is not revoked."""
CHANCE = 0.05
"""Largest number of such chains expected by chance for one to initiate a track."""
_ALIKE_SIGMAS, _SHARE = 3.0, 0.02
"""Limits of near points and like motions: number of sigma, and share of the speed."""
_WIDER = 2.2
"""Factor on the variances that points claim, as a track believes at first (``bank``)."""
_MAX_POINTS = 60
"""Largest number of points in a window; with more of them chains are not distinguishable."""
_MIN_FALSE = 0.5
"""Least assumed number of points a frame that are no object's."""
APART_COST = ALONE_COST + UNSURE_COST / 2.0
"""Cost of a pair with its own motion beside tracks: directions, lengths by one sigma each."""
ON_TRIAL, APART_ON_TRIAL = 1, 2
"""Measurements after its second that let a track outlive a miss; 2nd: unlike motion (alike: 0)."""
_AS_ANOTHER_ARCSEC = 10.0
"""Largest difference, arcsec, of the displacements of two that move alike."""
Chain = tuple[Measurement, ...]


def uses_window(settings: FollowSettings) -> bool:
    """True for presets that initiate tracks from more than two successive frames."""
    return settings.filter.uses_filter_bank


def find_chains(
    before: Following,
    usable: Sequence[Measurement],
    seen: FrameInput,
    settings: FollowSettings,
    tracks: Sequence[LiveTrack] = (),
) -> dict[Measurement, Chain]:
    """Find the chains that initiate tracks: the earlier measurements by each chain's last one.

    The earlier measurements are in order of time. ``tracks``: the existing tracks.
    """
    # Two that the operator wants to be one object are.
    if not uses_window(settings) or seen.chosen is not None:
        pairs = pairs_between(before.candidates, usable, seen.exposure_s)
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
        pairs = pairs_between(these, left, seen.exposure_s, ways, unpaired=unpaired)
        found |= {second: (first,) for second, first in pairs.items()}
    return found | _of_points(points, before, seen, settings, ways)


def trial_update_counts(
    begun_with: Sequence[Chain],
    settings: FollowSettings,
    rates_arcsec_s: Sequence[tuple[float, float]] = (),
) -> list[int]:
    """Return for each chain the number of updates after which its track outlives a miss.

    ``rates_arcsec_s``: rates of the other tracks, east and north.
    """
    if not uses_window(settings):
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
    """Displacement from a chain's first to its last, arcsec east and north."""
    first, last = chain[0], chain[-1]
    moved = measurement_displacement(first, last)
    return np.array([moved.east_arcsec, moved.north_arcsec])


def _same_frames(one: Chain, other: Chain) -> bool:
    return (one[0].frame_id, one[-1].frame_id) == (other[0].frame_id, other[-1].frame_id)


def waiting_measurements(before: Following, taken: Collection[Measurement]) -> Chain:
    """Measurements of earlier frames that may still initiate a track with later ones.

    ``taken``: measurements used already.
    """
    waiting = [m for m in (*before.earlier, *before.candidates) if m not in taken]
    frames = sorted({m.frame_id for m in waiting}, reverse=True)[: WINDOW - 2]
    return tuple(m for m in waiting if m.frame_id in frames)


def _parted(measurements: Sequence[Measurement]) -> tuple[list[Measurement], list[Measurement]]:
    """Split measurements into streaks and points."""
    streaks = [m for m in measurements if streak_motion(m) is not None]
    return streaks, [m for m in measurements if streak_motion(m) is None]


def _of_points(
    points: list[Measurement],
    before: Following,
    seen: FrameInput,
    settings: FollowSettings,
    ways: Sequence[tuple[float, float]],
) -> dict[Measurement, Chain]:
    waiting = _parted((*before.earlier, *before.candidates))[1]
    window = _by_frame([*waiting, *points])
    if not points or len(window) < 2 or sum(map(len, window.values())) > _MAX_POINTS:
        return {}
    plane = TangentPlane.at(points[0].ra_icrs_deg, points[0].dec_icrs_deg)
    frames = list(window.values())
    places = [
        np.array([plane.project_arcsec(m.ra_icrs_deg, m.dec_icrs_deg) for m in each])
        for each in frames
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
        for chain in [tuple(frames[frame][number] for frame, number in each.points)]
    }


def _by_chance(
    tracklet: Tracklet,
    neighbours: Sequence[Tracklet],
    counts: Sequence[int],
    t_s: Sequence[float],
    known: MotionPrior,
) -> float:
    """Expected number of such chance chains, beside others that move alike, by counts of points.

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


def _is_alike(one: Tracklet, other: Tracklet, t_s: Sequence[float], known: MotionPrior) -> bool:
    """True where two move as one, as far as their points show."""
    if one is other:
        return True
    away2 = (one.x_rate - other.x_rate) ** 2 + (one.y_rate - other.y_rate) ** 2
    return away2 < _ALIKE_SIGMAS**2 * _spread2(one, other, t_s, known)


def _reach(variance: float) -> float:
    """Area in which a point counts as near."""
    return math.pi * _ALIKE_SIGMAS**2 * variance


def _spread2(one: Tracklet, other: Tracklet, t_s: Sequence[float], known: MotionPrior) -> float:
    """Variance on an axis of one rate against another's."""
    own = sum(
        2.0 * (known.sigma / (t_s[each.points[-1][0]] - t_s[each.points[0][0]])) ** 2
        for each in (one, other)
    )
    return own + (_SHARE * math.hypot(other.x_rate, other.y_rate)) ** 2


def _by_frame(points: Sequence[Measurement]) -> Mapping[int, list[Measurement]]:
    found: dict[int, list[Measurement]] = {}
    for m in sorted(points, key=lambda m: m.t_mid_utc_ns):
        found.setdefault(m.frame_id, []).append(m)
    return found


def _known(
    frames: Sequence[Sequence[Measurement]],
    seen: FrameInput,
    settings: FollowSettings,
    ways: Sequence[tuple[float, float]],
) -> MotionPrior:
    """Prior for points and motions, from the points themselves and the field."""
    every = [m for each in frames for m in each]
    variances = [0.5 * (m.cov_sky_arcsec2[0] + m.cov_sky_arcsec2[2]) for m in every]
    common = None
    if ways:
        middle = np.median(np.array(ways), axis=0)
        common = (float(middle[0]), float(middle[1]))
    return MotionPrior(
        sigma=math.sqrt(_WIDER * max(float(np.median(variances)), lqe.SIGMA_FLOOR_ARCSEC**2)),
        area=(7200.0 * settings.half_field_deg) ** 2,
        # Faster, it would have drawn a streak.
        largest_speed=SHORTEST_WITH_DIRECTION_ARCSEC / seen.exposure_s,
        false_points=max(float(np.median([len(each) for each in frames])), _MIN_FALSE),
        common=common,
    )
