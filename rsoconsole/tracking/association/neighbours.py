"""Neighbours of the tracked object, told from it after a coast by their pattern. Pure.

Satellites of one slot have one rate and one streak, and after a long coast the prediction's bounds
hold several of them: position alone would select whichever happens to be nearer. Brightness is no
help, since phase, cloud and tumbling change it by more than they differ. The pattern stays: an
error of the prediction shifts all of them alike. So each shift that would bring a measurement onto
a known object is weighed, and the shift that best explains all measurements is used. Where the two
best explanations name different objects at nearly the same cost, no measurement is accepted: one
streak alone, after a long coast, may be either of two. Later frames would not resolve this: the
objects keep their relative positions, and the bounds only grow.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rsoconsole.records import FloatArray, Measurement, TrackState, Wcs
from rsoconsole.sky import jacobian_arcsec_px, sky_to_pixel
from rsoconsole.tracking.association.pattern import BoolArray
from rsoconsole.tracking.filters.agreement import motion_between
from rsoconsole.tracking.filters.lqe import direction_icrs_deg, sky_covariance_arcsec2

NEAREST_ARCSEC = 30.0
"""Separation below which two detections count as one streak found twice."""
SIGMA_ARCSEC = 10.0
DRIFT_ARCSEC_S = 1.0 / 60.0
"""Growth of a neighbour's sigma: in a slot they swing by some 0.05 deg in half a day."""
UNSEEN_COST = 9.0
"""Cost of a known object that is not seen: as a deviation of 3 sigma."""
UNKNOWN_COST = 9.0
"""Cost of a streak with the same motion where no object is known."""
MIN_MARGIN = 4.0
"""Least difference in cost of the two best explanations, to accept the better: seven to one."""
KEPT_S = 7200.0
MAX_KEPT = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class Neighbour:
    """Object with the same motion as the tracked one, near it on the sky."""

    east_arcsec: float
    """Distance from the tracked object on the sky, eastward."""
    north_arcsec: float
    t_utc_ns: int
    error_arcsec: float = 0.0
    """One sigma of both objects' places at that instant, by the learnt errors of their streaks."""

    def sigma_arcsec(self, t_utc_ns: int) -> float:
        """Return one sigma, per axis, of the neighbour's offset from the tracked object."""
        drifted = SIGMA_ARCSEC + DRIFT_ARCSEC_S * abs(t_utc_ns - self.t_utc_ns) / 1e9
        return float(np.hypot(drifted, self.error_arcsec))


def neighbours_after(
    before: tuple[Neighbour, ...],
    taken: Measurement,
    others: Mapping[Measurement, float],
    error_arcsec: float = 0.0,
) -> tuple[Neighbour, ...]:
    """Return the neighbours of a track after a frame in which it accepted ``taken``.

    ``others``: the frame's measurements with the same motion, and the learnt error of each.
    ``error_arcsec``: the learnt error of ``taken``.
    """
    here = (taken.ra_icrs_deg, taken.dec_icrs_deg)
    seen = []
    for other, theirs_arcsec in others.items():
        away = motion_between(*here, other.ra_icrs_deg, other.dec_icrs_deg)
        if away.length_arcsec >= NEAREST_ARCSEC:
            seen.append(
                Neighbour(
                    east_arcsec=away.east_arcsec,
                    north_arcsec=away.north_arcsec,
                    t_utc_ns=taken.t_mid_utc_ns,
                    error_arcsec=float(np.hypot(error_arcsec, theirs_arcsec)),
                )
            )
    unseen = (
        old
        for old in before
        if (taken.t_mid_utc_ns - old.t_utc_ns) / 1e9 <= KEPT_S
        and not any(_apart_arcsec(old, new) < NEAREST_ARCSEC for new in seen)
    )
    return (*seen, *unseen)[:MAX_KEPT]


@dataclass(frozen=True, slots=True, kw_only=True)
class Field:
    """Field of view of one frame on the sky."""

    wcs: Wcs
    width_px: int
    height_px: int

    def holds(
        self, ra_icrs_deg: FloatArray, dec_icrs_deg: FloatArray, inside_arcsec: FloatArray
    ) -> BoolArray:
        """True for directions (N,) at least ``inside_arcsec`` within the frame's edges."""
        centre = ((self.width_px - 1) / 2.0, (self.height_px - 1) / 2.0)
        jacobian = jacobian_arcsec_px(self.wcs, *centre)
        inside_px = inside_arcsec / np.sqrt(abs(np.linalg.det(jacobian)))
        x_px, y_px = sky_to_pixel(self.wcs, ra_icrs_deg, dec_icrs_deg)
        from_edge_px = np.minimum(
            np.minimum(x_px, self.width_px - 1 - x_px), np.minimum(y_px, self.height_px - 1 - y_px)
        )
        return np.asarray(from_edge_px > inside_px)  # NaN, far outside the plate, is not


@dataclass(frozen=True, slots=True, kw_only=True)
class FollowedMatch:
    """Measurement matched to the tracked object, and the margin of the match."""

    measurement: Measurement | None
    """Matched measurement; None: the tracked object is not among the measurements."""
    margin: float
    """Cost of the best explanation that matches another measurement, over that of the best one."""


def best_match(
    alike: tuple[Measurement, ...],
    predicted: TrackState,
    neighbours: tuple[Neighbour, ...],
    *,
    streak_arcsec: float = 0.0,
    field: Field | None = None,
    errors_arcsec: Sequence[float] | None = None,
) -> FollowedMatch:
    """Find the tracked object among the measurements with its motion.

    Each pair of a measurement and a known object (the tracked one or a neighbour) implies a shift
    of the prediction. The cost of a shift, in NIS, is how unlikely it is by the prediction's
    bounds, plus how badly all known objects and all measurements then fit together. An object
    outside ``field``, or so near its edge that its streak of ``streak_arcsec`` would not be whole,
    may be unseen at no cost; without a field every object should be seen. ``errors_arcsec``: the
    learnt error of each measurement, beside its own.
    """
    errors = np.zeros(len(alike)) if errors_arcsec is None else np.array(errors_arcsec)
    away = np.array([(0.0, 0.0), *((n.east_arcsec, n.north_arcsec) for n in neighbours)])
    sigma = np.array([0.0, *(n.sigma_arcsec(predicted.t_utc_ns) for n in neighbours)])
    places = np.array([_from_prediction(m, predicted) for m in alike])
    bounds = sky_covariance_arcsec2(predicted)
    costs: dict[int | None, float] = {}
    for measurement, place, error in zip(alike, places, errors, strict=True):
        east, cross, north = measurement.cov_sky_arcsec2
        for offset, sigma_of in zip(away, sigma, strict=True):
            shift = place - offset
            more = (sigma_of**2 + error**2) * np.eye(2)
            spread = bounds + np.array([[east, cross], [cross, north]]) + more
            where = shift + away
            should_be_seen = np.ones(len(where), bool)
            if field is not None:
                directions = _directions(where, predicted)
                should_be_seen = field.holds(*directions, streak_arcsec / 2.0 + sigma)
            # What is laid onto its place brings its own error along.
            shifted = np.hypot(errors, error)
            cost, number = _misfit(where, places, sigma, shifted, should_be_seen)
            cost += float(shift @ np.linalg.solve(spread, shift))
            costs[number] = min(cost, costs.get(number, np.inf))
    return _decided(costs, alike, places)


def _decided(
    costs: dict[int | None, float], alike: tuple[Measurement, ...], places: FloatArray
) -> FollowedMatch:
    best = min(costs, key=lambda number: costs[number])

    def is_another(number: int | None) -> bool:
        if number is None or best is None:
            return number is not best
        return bool(np.hypot(*(places[number] - places[best])) >= NEAREST_ARCSEC)

    others = [cost for number, cost in costs.items() if is_another(number)]
    return FollowedMatch(
        measurement=None if best is None else alike[best],
        margin=min(others, default=np.inf) - costs[best],
    )


def _misfit(
    where: FloatArray,
    places: FloatArray,
    sigma_arcsec: FloatArray,
    errors_arcsec: FloatArray,
    should_be_seen: BoolArray,
) -> tuple[float, int | None]:
    """Cost of all known objects (K, 2) at ``where`` and all seen ones (M, 2) at ``places``.

    With it the index of the seen object at the place of the first known one, if any.
    """
    squares = np.sum((where[:, None, :] - places[None, :, :]) ** 2, axis=2)
    spread = np.maximum(sigma_arcsec, SIGMA_ARCSEC)[:, None] ** 2 + errors_arcsec[None, :] ** 2
    each = squares / spread
    nearest = each.min(axis=1)
    is_found = nearest <= UNSEEN_COST
    cost = float(np.sum(nearest[is_found]))
    cost += UNSEEN_COST * int(np.sum(~is_found & should_be_seen))
    cost += UNKNOWN_COST * int(np.sum(each.min(axis=0) > UNSEEN_COST))
    return cost, int(np.argmin(each[0])) if is_found[0] else None


def _directions(where: FloatArray, predicted: TrackState) -> tuple[FloatArray, FloatArray]:
    """RA and Dec (N,) of places (N, 2) relative to the prediction."""
    ra_deg, dec_deg = direction_icrs_deg(predicted)
    decs = dec_deg + where[:, 1] / 3600.0
    cos_dec = np.cos(np.radians((dec_deg + decs) / 2.0))
    return ra_deg + where[:, 0] / 3600.0 / np.maximum(cos_dec, 1e-3), decs


def _from_prediction(measurement: Measurement, predicted: TrackState) -> FloatArray:
    to = (measurement.ra_icrs_deg, measurement.dec_icrs_deg)
    away = motion_between(*direction_icrs_deg(predicted), *to)
    return np.array([away.east_arcsec, away.north_arcsec])


def _apart_arcsec(a: Neighbour, b: Neighbour) -> float:
    return float(np.hypot(a.east_arcsec - b.east_arcsec, a.north_arcsec - b.north_arcsec))
