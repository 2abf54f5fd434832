"""One assignment of a frame's measurements to all tracks. Pure.

Each pair that passes the gates has a likelihood, so have a track that is not seen and a streak that
is no track's; of all ways to explain the frame the likeliest is taken (global nearest neighbour;
Blackman & Popoli 1999, 6.4), by scipy's assignment.

Errors of a frame's time are one number for all of its streaks, those of the frames before are in
all predictions alike: members of a slot may all be beside their predictions by as much as they are
from each other. So every pair is asked in turn what that one number would be if it were right, and
the frame explained with it: the others then need only agree with each other. Where an explanation
that does not give a track its streak is as likely, it takes none. (One track begins at a time:
several are followed where a caller gives several.)
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rsoconsole.reasons import NotTaken
from rsoconsole.records import FloatArray, Measurement, TrackState
from rsoconsole.tracking import adaptive, lqe
from rsoconsole.tracking.association import motion_between
from rsoconsole.tracking.gates import nis_of
from rsoconsole.tracking.neighbours import NEAREST_ARCSEC

DETECTED = 0.9
"""Chance that what is in the field is detected."""
STRANGERS_ARCSEC2 = 1e-6
"""Streaks in a square arcsec that move like a track and are not it: a crowded slot."""
LEAST_MARGIN = 4.0
"""By how much the likeliest explanation must be better than one without a track's streak: seven to
one."""
RELATIVE_ARCSEC = 5.0
"""Sigma along the motion of one track's place to another's, without what they share."""
_AGAINST = 2.0 * math.log(2.0 * math.pi * STRANGERS_ARCSEC2 / DETECTED)
_MISSED = -2.0 * math.log(1.0 - DETECTED)


@dataclass(frozen=True, slots=True, kw_only=True)
class Weighed:
    """What a frame may mean for one track."""

    predicted: TrackState
    updated: dict[Measurement, TrackState]
    """The track after each of the frame's measurements."""
    reasons: dict[Measurement, NotTaken]
    """Why some of them do not belong to it."""

    @property
    def fitting(self) -> tuple[Measurement, ...]:
        """Those that may."""
        return tuple(m for m in self.updated if m not in self.reasons)


@dataclass(frozen=True, slots=True, kw_only=True)
class Assignment:
    """What each track takes."""

    taken: tuple[Measurement | None, ...]
    is_ambiguous: tuple[bool, ...]
    """Whether a track takes none because another explanation is as likely."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Pairs:
    """Every track with every streak that may be its: (tracks, streaks), NaN where none may."""

    columns: list[Measurement]
    across: FloatArray
    """Innovation across the motion in its sigmas, squared, and its log variance."""
    along_arcsec: FloatArray
    total: FloatArray
    """Variance along the motion, arcsec^2: all of it."""
    own: FloatArray
    """Without what all tracks of a frame share."""
    alone: FloatArray
    """NIS and log determinant, of a track that is alone."""
    speed_arcsec_s: FloatArray
    """(tracks, 1)"""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Explanation:
    cost: float
    chosen: tuple[int, ...]
    """Column of each track; from the number of streaks on: it was not seen."""


def assigned(tracks: Sequence[Weighed]) -> Assignment:
    """The likeliest way to give the frame's measurements to the tracks."""
    pairs = _pairs(tracks)
    if not pairs.columns:
        nobody = (None,) * len(tracks)
        return Assignment(taken=nobody, is_ambiguous=(False,) * len(tracks))
    costs = _costs(pairs)
    found = [_explained(each) for each in costs]
    number = min(range(len(found)), key=lambda n: found[n].cost)
    best, cost = found[number], costs[number]
    taken: list[Measurement | None] = []
    is_ambiguous: list[bool] = []
    for row, column in enumerate(best.chosen):
        is_seen = column < len(pairs.columns)
        unsure = False
        if is_seen and len(tracks) > 1:  # one alone knows its neighbours by their pattern
            same = _same(pairs.columns, column)
            others = [e.cost for e in found if e.chosen[row] not in same]
            others.append(_explained(_without(cost, row, same)).cost)
            unsure = min(others) - best.cost < LEAST_MARGIN
        taken.append(pairs.columns[column] if is_seen and not unsure else None)
        is_ambiguous.append(unsure)
    return Assignment(taken=tuple(taken), is_ambiguous=tuple(is_ambiguous))


def _pairs(tracks: Sequence[Weighed]) -> _Pairs:
    columns = list(dict.fromkeys(m for each in tracks for m in each.fitting))
    shape = (len(tracks), len(columns))
    across, along, total, own, alone = (np.full(shape, np.nan) for _ in range(5))
    speeds = np.zeros((len(tracks), 1))
    for row, each in enumerate(tracks):
        rate = np.array(lqe.sky_rate_arcsec_s(each.predicted))
        speeds[row] = max(float(np.hypot(*rate)), 1e-3)
        ahead = rate / speeds[row]
        aside = np.array([-ahead[1], ahead[0]])
        for m in each.fitting:
            column, updated = columns.index(m), each.updated[m]
            S = adaptive.innovation_covariance(updated)
            innovation = np.array(updated.innovation_arcsec)
            side = float(aside @ S @ aside)
            along[row, column] = float(ahead @ innovation)
            total[row, column] = float(ahead @ S @ ahead)
            off = float(aside @ innovation) ** 2 / side
            # The mixture allows for more than its moments say.
            moments = off + along[row, column] ** 2 / total[row, column]
            allowed = min(nis_of(updated) / moments, 1.0) if moments > 0.0 else 1.0
            across[row, column] = allowed * off + math.log(side)
            alone[row, column] = nis_of(updated) + math.log(side * total[row, column])
            own[row, column] = _own_along(m, updated, ahead)
    own = np.minimum(own, total)
    return _Pairs(
        columns=columns,
        across=across,
        along_arcsec=along,
        total=total,
        own=own,
        alone=alone,
        speed_arcsec_s=speeds,
    )


def _own_along(m: Measurement, updated: TrackState, ahead: FloatArray) -> float:
    """Variance along the motion that a streak shares with no other."""
    ee, en, nn = m.cov_sky_arcsec2
    own = float(ahead @ np.array([[ee, en], [en, nn]]) @ ahead)
    said = updated.mixture
    scale, more = (1.0, 0.0) if said is None else (said.variance_scale, said.along_arcsec)
    return scale * own + more**2 + RELATIVE_ARCSEC**2


def _costs(pairs: _Pairs) -> list[FloatArray]:
    """A cost matrix for each value of what the frame's streaks share; one where there is one track.

    The last columns are those of a track that is not seen.
    """
    rows = len(pairs.along_arcsec)
    if rows == 1:
        # What has passed the gates is taken rather than none.
        return [_with_misses(pairs.alone + _AGAINST, missed=math.inf)]
    found = []
    late_s = pairs.along_arcsec / pairs.speed_arcsec_s
    for row, column in np.argwhere(np.isfinite(late_s)):
        shift = late_s[row, column] * pairs.speed_arcsec_s
        own = (pairs.along_arcsec - shift) ** 2 / pairs.own + np.log(pairs.own)
        common = pairs.along_arcsec[row, column] ** 2 / pairs.total[row, column]
        cost = _with_misses(pairs.across + own + _AGAINST)
        # Of the frame, once: what it shares is so much.
        cost += common / rows
        found.append(cost)
    return found


def _with_misses(cost: FloatArray, missed: float = _MISSED) -> FloatArray:
    """(tracks, streaks + tracks), infinite where a pair cannot be."""
    rows = len(cost)
    unseen = np.full((rows, rows), np.inf)
    np.fill_diagonal(unseen, missed)
    return np.hstack([np.where(np.isnan(cost), np.inf, cost), unseen])


def _same(columns: Sequence[Measurement], column: int) -> set[int]:
    """The columns of one streak, which may have been found twice."""
    return {k for k, m in enumerate(columns) if _apart_arcsec(columns[column], m) < NEAREST_ARCSEC}


def _without(cost: FloatArray, row: int, same: set[int]) -> FloatArray:
    other = cost.copy()
    other[row, list(same)] = np.inf
    return other


def _apart_arcsec(one: Measurement, other: Measurement) -> float:
    here, there = (one.ra_icrs_deg, one.dec_icrs_deg), (other.ra_icrs_deg, other.dec_icrs_deg)
    return motion_between(*here, *there).length_arcsec


def _explained(cost: FloatArray) -> _Explanation:
    """The least total, infinite where a track is left nothing, and the column of each track."""
    if len(cost) == 1:
        column = int(np.argmin(cost[0]))
        return _Explanation(cost=float(cost[0, column]), chosen=(column,))
    if not np.isfinite(cost).any(axis=1).all():
        return _Explanation(cost=math.inf, chosen=(cost.shape[1] - 1,) * len(cost))
    # scipy weighs half a second: only who has several tracks pays for it.
    from scipy.optimize import linear_sum_assignment

    rows, chosen = linear_sum_assignment(np.where(np.isfinite(cost), cost, 1e9))
    total = float(cost[rows, chosen].sum())
    return _Explanation(cost=total, chosen=tuple(chosen.tolist()))
