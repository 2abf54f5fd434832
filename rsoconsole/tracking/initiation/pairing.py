"""Which streaks of two frames are one object, where nothing is followed yet. Pure.

The way from one frame to the next must be the streaks' own motion. Streaks tell their direction
well and their length badly: cloud, glint and stars upon its ends make one shorter. What the
streaks of a frame share is no evidence against a pair: stars that drift during the exposure bend
all of them alike. And most of what a field shows moves alike. So each likely pair is held to be
right in turn, with the bend and the way that it means for all.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rsoconsole.records import FloatArray, Measurement
from rsoconsole.sky import IntArray
from rsoconsole.tracking.filters import (
    DIRECTION_TOLERANCE_DEG,
    SHORTEST_WITH_DIRECTION_ARCSEC,
    Motion,
    motion_between,
    motion_in_exposure,
    streak_motion,
)

LOST_TOLERANCE = 0.4
"""A streak may have lost, or gained, so much of its length."""
ACROSS_ARCSEC, ACROSS_SHARE, LENGTH_SHARE = 3.0, 0.02, 0.15
"""Sigma of a streak's direction, as displacement across it, and of its length."""
BEND_DEG = 5.0
"""Sigma of the bend that all streaks of a frame share."""
COMMON_ARCSEC, COMMON_SHARE = 10.0, 0.05
"""Sigma of the way from frame to frame that satellites of one field share."""
ALONE_COST = 12.0
"""Of one that goes a way of its own."""
UNSURE_COST = 8.0
"""Of what a pair that goes a way of its own may be off by in all: its streaks' two directions and
lengths by two sigmas each or so. One that is off by more is rather two objects, each seen once."""
UNPAIRED_COST = ALONE_COST + UNSURE_COST
_NOBODY = 1e6
"""Of one that is left without a partner: as many as can be have one."""
_FREEDOM = 4.0
"""Degrees of freedom of the law by which directions and lengths err."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Half:
    """One streak of a pair against the way between both."""

    cost: float
    """Of its length."""
    bend_deg: float = 0.0
    """Its direction from the way's, counted towards east; 0 where it has none."""
    sigma_deg: float = math.inf
    """Of its direction."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Pairs:
    """Every second streak with every first one: (seconds, firsts)."""

    cost: FloatArray
    """Of the lengths; infinite where they are no pair."""
    bends_deg: FloatArray
    """(seconds, firsts, 2)"""
    sigmas_deg: FloatArray
    """(seconds, firsts, 2)"""
    ways_arcsec: FloatArray
    """(seconds, firsts, 2) east and north from frame to frame."""


def paired(
    firsts: Sequence[Measurement],
    seconds: Sequence[Measurement],
    exposure_s: float,
    rates_arcsec_s: Sequence[tuple[float, float]] = (),
    *,
    unpaired: float | None = None,
) -> dict[Measurement, Measurement]:
    """The first of each second one, where two frames agree; each is in one pair at most.

    Of all ways to pair them the likeliest: of two neighbours of which the first frame shows one,
    that one is paired with itself. ``rates_arcsec_s``: how what is followed beside them moves
    (east, north); ``unpaired``: cost of one without, where that may be likelier than a pair; None:
    as many as can be have one.
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


def agree(first: Measurement, second: Measurement, exposure_s: float) -> bool:
    """Whether two measurements of different frames agree on one motion."""
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
            to = (second.ra_icrs_deg, second.dec_icrs_deg)
            way = motion_between(first.ra_icrs_deg, first.dec_icrs_deg, *to)
            cost[row, column] = sum(each.cost for each in halves)
            bends[row, column] = [each.bend_deg for each in halves]
            sigmas[row, column] = [each.sigma_deg for each in halves]
            ways[row, column] = (way.east_arcsec, way.north_arcsec)
    return _Pairs(cost=cost, bends_deg=bends, sigmas_deg=sigmas, ways_arcsec=ways)


def _assigned(
    pairs: _Pairs, known_ways: Sequence[FloatArray] = (), unpaired: float = _NOBODY
) -> tuple[IntArray, IntArray]:
    """The likeliest assignment: second and first of each pair.

    ``known_ways``: from frame to frame, of what is followed; ``unpaired``: cost of one without.
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
    """Both streaks against the way between them; None where they cannot be one object."""
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
    """Cost of errors given in sigma: tails as of Student's law."""
    return np.asarray((_FREEDOM + 2.0) * np.log1p(sigmas**2 / _FREEDOM))
