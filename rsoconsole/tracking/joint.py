"""Joint assignment of a frame's measurements to all tracks. Pure.

Likelihoods are given to each pair that passes the gates, to a track without a measurement, and to a
streak that belongs to no track. Of all explanations of the frame the likeliest is taken (global
nearest neighbour; Blackman & Popoli 1999, 6.4), by scipy's assignment.

An error of a frame's time moves all of its streaks alike, and errors of earlier frames are in the
predictions: all members of a slot may be as far from their predictions as from each other. So every
likely pair is assumed to be right in turn, and the other streaks then need only keep their earlier
position relative to it (``pattern``). A track accepts no streak if an explanation that does not
give it that streak is as likely. But two tracks that fit one streak equally well in every frame
would both be lost that way: after some frames the likelier one accepts it
(``filter.most_ambiguous``).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from rsoconsole.records import FloatArray, Measurement, NotTaken, TrackState
from rsoconsole.tracking._gates import nis_of
from rsoconsole.tracking.association.neighbours import MIN_MARGIN, NEAREST_ARCSEC
from rsoconsole.tracking.association.pattern import (
    NO_PATTERN,
    OTHER_MOTION_ARCSEC_S,
    BoolArray,
    TrackPattern,
    single_streak_covariance,
)
from rsoconsole.tracking.filters import adaptive, lqe
from rsoconsole.tracking.filters.agreement import measurement_displacement
from rsoconsole.tracking.filters.bank_update import inverses_and_log_dets
from rsoconsole.tracking.filters.estimator import CandidateUpdate
from rsoconsole.tracking.filters.sky_path import TangentPlane

DETECTION_PROBABILITY = 0.9
STRANGERS_ARCSEC2 = 1e-6
"""Density of other streaks that move like a track, per square arcsec: a crowded slot."""
_FREEDOM = 4.0
"""Degrees of freedom of the error law of relative positions."""
_ANCHORS = 3
"""Number of streaks of each track assumed to be right in turn: the likeliest."""
_AGAINST = 2.0 * math.log(2.0 * math.pi * STRANGERS_ARCSEC2 / DETECTION_PROBABILITY)
_MISSED = -2.0 * math.log(1.0 - DETECTION_PROBABILITY)


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackCandidates:
    """Candidate measurements of one track in a frame, with their updates and rejections."""

    predicted: TrackState
    updated: dict[Measurement, CandidateUpdate]
    reasons: dict[Measurement, NotTaken]
    by_filter: dict[Measurement, NotTaken] = field(default_factory=dict)
    """Reasons by the filter's own prediction, where the orbit's prediction is used instead."""
    must_decide: bool = False
    """True where the track has been ambiguous for so long that it accepts the likeliest."""

    @property
    def in_gate(self) -> tuple[Measurement, ...]:
        """Candidate measurements that passed the gates."""
        return tuple(m for m in self.updated if m not in self.reasons)

    def cost_alone(self, m: Measurement) -> float:
        """Return NIS and log determinant of the innovation of a measurement."""
        updated = self.updated[m].state
        S = adaptive.innovation_covariance(updated)
        return nis_of(updated) + math.log(float(np.linalg.det(S)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Assignment:
    """Result of an assignment: for each track its measurement, or None."""

    taken: tuple[Measurement | None, ...]
    is_ambiguous: tuple[bool, ...]
    """True for a track that accepts none because another explanation is as likely."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Pairs:
    """All pairs of a track and a streak: (tracks, streaks), NaN where the streak cannot be its."""

    columns: list[Measurement]
    same: list[set[int]]
    """Columns of each streak that are the same one, detected twice."""
    alone: FloatArray
    """NIS and log determinant by the track itself."""
    places: FloatArray
    """(streaks, 2) places on one plane, arcsec."""
    own: FloatArray
    """(tracks, streaks, 2, 2) covariance of a place, arcsec^2, without a frame's common errors."""
    ways: FloatArray
    """(tracks, tracks, 2) relative positions, arcsec."""
    ways_covariance: FloatArray
    """(tracks, tracks, 2, 2) covariances of the relative positions."""
    is_other_motion: BoolArray
    """(tracks, tracks) True where one moves unlike the other."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Explanation:
    cost: float
    chosen: tuple[int, ...]
    """Column of each track; from the number of streaks on: it was not seen."""


def assign_measurements(
    tracks: Sequence[TrackCandidates], pattern: TrackPattern | None = None
) -> Assignment:
    """Find the likeliest assignment of the frame's measurements to the tracks.

    ``pattern``: relative positions of the tracks in the frames before.
    """
    if len(tracks) == 1:
        # What has passed the gates is taken rather than none; it knows its neighbours by itself.
        taken = min(tracks[0].in_gate, key=tracks[0].cost_alone, default=None)
        return Assignment(taken=(taken,), is_ambiguous=(False,))
    pairs = _pairs(tracks, pattern or NO_PATTERN)
    if not pairs.columns:
        nobody = (None,) * len(tracks)
        return Assignment(taken=nobody, is_ambiguous=(False,) * len(tracks))
    costs = _costs(pairs)
    found = [_explained(each) for each in costs]
    number = min(range(len(found)), key=lambda n: found[n].cost)
    best, cost = found[number], costs[number]
    given: list[Measurement | None] = []
    is_ambiguous: list[bool] = []
    for row, column in enumerate(best.chosen):
        is_seen = column < len(pairs.columns)
        unsure = False
        if is_seen:
            same = pairs.same[column]
            others = [e.cost for e in found if e.chosen[row] not in same]
            without = cost.copy()
            without[row, list(same)] = np.inf
            others.append(_explained(without).cost)
            unsure = min(others) - best.cost < MIN_MARGIN and not tracks[row].must_decide
        given.append(pairs.columns[column] if is_seen and not unsure else None)
        is_ambiguous.append(unsure)
    return Assignment(taken=tuple(given), is_ambiguous=tuple(is_ambiguous))


def _pairs(tracks: Sequence[TrackCandidates], pattern: TrackPattern) -> _Pairs:
    columns = list(dict.fromkeys(m for each in tracks for m in each.in_gate))
    plane = TangentPlane.at(*lqe.direction_icrs_deg(tracks[0].predicted))
    alone = np.full((len(tracks), len(columns)), np.nan)
    own = np.zeros((*alone.shape, 2, 2))
    for row, each in enumerate(tracks):
        for m in each.in_gate:
            column = columns.index(m)
            alone[row, column] = each.cost_alone(m)
            own[row, column] = single_streak_covariance(m, each.updated[m].state)
    ways, covariances = _ways(tracks, pattern, plane)
    rates = np.array([lqe.sky_rate_arcsec_s(each.predicted) for each in tracks])
    apart = np.linalg.norm(rates[:, None] - rates[None], axis=-1)
    return _Pairs(
        columns=columns,
        same=[
            {
                k
                for k, m in enumerate(columns)
                if measurement_displacement(each, m).length_arcsec < NEAREST_ARCSEC
            }
            for each in columns
        ],
        alone=alone,
        places=np.array([plane.project_arcsec(m.ra_icrs_deg, m.dec_icrs_deg) for m in columns]),
        own=own,
        ways=ways,
        ways_covariance=covariances,
        is_other_motion=apart >= OTHER_MOTION_ARCSEC_S,
    )


def _ways(
    tracks: Sequence[TrackCandidates], pattern: TrackPattern, plane: TangentPlane
) -> tuple[FloatArray, FloatArray]:
    """Ways between all tracks and their covariances, by the pattern or by the predictions."""
    predicted = [each.predicted for each in tracks]
    number, ids = len(tracks), [each.track_id for each in predicted]
    known, ways, covariances = pattern.relative_positions_at(ids, predicted[0].t_utc_ns)
    unknown = [(i, j) for i in range(number) for j in range(i + 1, number) if not known[i, j]]
    if not unknown:
        return ways, covariances
    places = [plane.project_arcsec(*lqe.direction_icrs_deg(state)) for state in predicted]
    own = [lqe.sky_covariance_arcsec2(state) for state in predicted]
    for i, j in unknown:
        way = places[j] - places[i]
        ways[i, j], ways[j, i] = way, -way
        # No frame has shown both: whatever they share counts twice.
        covariances[i, j] = covariances[j, i] = own[i] + own[j]
    return ways, covariances


def _costs(pairs: _Pairs) -> list[FloatArray]:
    """Cost matrix for each pair that may be right, the other tracks placed relative to it.

    The last columns are those of a track that is not seen.
    """
    may = ~np.isnan(pairs.alone)
    found = []
    for row in range(len(may)):
        order = np.argsort(np.where(may[row], pairs.alone[row], np.inf))
        for column in order[: min(_ANCHORS, int(may[row].sum()))]:
            off = pairs.places[None] - pairs.places[column] - pairs.ways[row][:, None]
            spread = pairs.own + pairs.own[row, column] + pairs.ways_covariance[row][:, None]
            inverse, log_det = inverses_and_log_dets(spread)
            nis = np.einsum("tmi,tmij,tmj->tm", off, inverse, off)
            # One end behind a star or a cloud happens: tails as of Student's law, not of Gauss's.
            cost = (_FREEDOM + 2.0) * np.log1p(nis / _FREEDOM) + log_det
            # Where one stands to another that moves otherwise says less than its own prediction.
            cost = np.where(pairs.is_other_motion[row][:, None], pairs.alone, cost)
            cost[~may] = np.nan
            cost[row] = np.nan
            cost[row, column] = pairs.alone[row, column]
            anchored = _with_misses(cost + _AGAINST)
            anchored[row, len(pairs.columns) :] = np.inf
            found.append(anchored)
    return found


def _with_misses(cost: FloatArray) -> FloatArray:
    """(tracks, streaks + tracks) costs, infinite where a pair cannot be."""
    rows = len(cost)
    unseen = np.full((rows, rows), np.inf)
    np.fill_diagonal(unseen, _MISSED)
    return np.hstack([np.where(np.isnan(cost), np.inf, cost), unseen])


def _explained(cost: FloatArray) -> _Explanation:
    """Least total, infinite where a track is left nothing, and the column of each track."""
    if not np.isfinite(cost).any(axis=1).all():
        return _Explanation(cost=math.inf, chosen=(cost.shape[1] - 1,) * len(cost))
    # scipy weighs half a second: only who has several tracks pays for it.
    from scipy.optimize import linear_sum_assignment

    rows, chosen = linear_sum_assignment(np.where(np.isfinite(cost), cost, 1e9))
    total = float(cost[rows, chosen].sum())
    return _Explanation(cost=total, chosen=tuple(chosen.tolist()))
