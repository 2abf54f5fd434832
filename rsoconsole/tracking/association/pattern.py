"""Relative positions of a field's satellites, from the frames that showed both. Pure.

An error of a frame's time or plate moves all of its streaks alike, so their relative positions are
free of it (differential coordinates). The relative position and rate of every two tracks have a
filter of their own. It still distinguishes the members of a slot after frames that missed one, when
the tracks' own predictions suffer from shutter errors of different frames.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from rsoconsole.records import FloatArray, Measurement, TrackState
from rsoconsole.sky import IntArray
from rsoconsole.tracking.filters import lqe
from rsoconsole.tracking.filters.agreement import streak_axis
from rsoconsole.tracking.filters.sky_path import TangentPlane

BoolArray = npt.NDArray[np.bool_]
_RATE_ARCSEC_S = 0.5
"""One sigma of the relative rate of two tracks before two frames have shown it."""
OTHER_MOTION_ARCSEC_S = 3.0 * _RATE_ARCSEC_S
"""Relative rate from which two tracks are not of one slot, and their own rates are used."""
_ACCELERATION_Q = 1e-9
"""White acceleration of the relative position, arcsec^2/s^3."""
_MIN_ARCSEC = 0.5
"""Least sigma on each axis of a relative position in a frame: the lens, errors of the ends."""


@dataclass(frozen=True, slots=True, eq=False)
class TrackPattern:
    """Relative positions of every two tracks on the sky, at the last frame that showed both."""

    track_ids: tuple[int, ...] = ()
    t_utc_ns: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    """(N, N) instants of the last frame that showed both tracks; 0: no frame has."""
    ways: FloatArray = field(default_factory=lambda: np.zeros((0, 0, 4)))
    """(N, N, 4) relative positions (east, north), arcsec, and their rates, arcsec/s."""
    covariances: FloatArray = field(default_factory=lambda: np.zeros((0, 0, 4, 4)))
    """(N, N, 4, 4) covariances of ``ways``."""

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, TrackPattern) or self.track_ids != other.track_ids:
            return False
        ours = (self.t_utc_ns, self.ways, self.covariances)
        theirs = (other.t_utc_ns, other.ways, other.covariances)
        return all(map(np.array_equal, ours, theirs))

    def __hash__(self) -> int:
        return hash(self.track_ids)

    def relative_positions_at(
        self, tracks: Sequence[int], t_utc_ns: int
    ) -> tuple[BoolArray, FloatArray, FloatArray]:
        """Relative positions of N tracks at an instant, with their covariances.

        Returns a mask (N, N), True where known; positions (N, N, 2) of the second track relative to
        the first, arcsec east and north; and covariances (N, N, 2, 2).
        """
        number = len(tracks)
        known, ways = np.zeros((number, number), bool), np.zeros((number, number, 2))
        covariances = np.zeros((number, number, 2, 2))
        i, j = np.triu_indices(number, 1)
        there, mean, covariance = self._carried(np.array(tracks), i, j, t_utc_ns)
        i, j = i[there], j[there]
        known[i, j] = known[j, i] = True
        ways[i, j], ways[j, i] = mean[:, :2], -mean[:, :2]
        covariances[i, j] = covariances[j, i] = covariance[:, :2, :2]
        return known, ways, covariances

    def _carried(
        self, tracks: IntArray, i: IntArray, j: IntArray, t_utc_ns: int
    ) -> tuple[BoolArray, FloatArray, FloatArray]:
        """Ways and rates (K, 4) of the known of M pairs at an instant.

        Before them True for the known ones (M,), after them the covariances (K, 4, 4).
        """
        at = _places_in(tracks, self.track_ids)
        a, b = at[i], at[j]
        there = (a >= 0) & (b >= 0)
        there[there] = self.t_utc_ns[a[there], b[there]] != 0.0
        a, b = a[there], b[there]
        dt_s = (t_utc_ns - self.t_utc_ns[a, b]) / 1e9
        carry = np.tile(np.eye(4), (len(a), 1, 1))
        carry[:, 0, 2] = carry[:, 1, 3] = dt_s
        span = np.abs(dt_s)
        noise = np.zeros((len(a), 4, 4))
        for axis in (0, 1):
            noise[:, axis, axis] = _ACCELERATION_Q * span**3 / 3.0
            noise[:, axis, axis + 2] = noise[:, axis + 2, axis] = _ACCELERATION_Q * dt_s * span / 2
            noise[:, axis + 2, axis + 2] = _ACCELERATION_Q * span
        mean = (carry @ self.ways[a, b][:, :, None])[:, :, 0]
        covariance = carry @ self.covariances[a, b] @ np.swapaxes(carry, 1, 2) + noise
        return there, mean, covariance


def _places_in(tracks: IntArray, known: Sequence[int]) -> IntArray:
    """(N,) index of each track among the known ones; -1: not among them."""
    number = {track: k for k, track in enumerate(known)}
    return np.array([number.get(track, -1) for track in tracks.tolist()], np.int64)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrackPlace:
    """Place and rate of one track in one frame."""

    ra_icrs_deg: float
    dec_icrs_deg: float
    covariance: FloatArray
    """(2, 2) covariance of the place, arcsec^2, without errors common to all of a frame."""
    rate_arcsec_s: FloatArray
    """(2,) rate of the track, east and north."""

    @classmethod
    def from_measurement(
        cls, m: Measurement, track: TrackState, along_arcsec: float | None = None
    ) -> "TrackPlace":
        """Return the place of an accepted streak.

        ``along_arcsec``: as in ``single_streak_covariance``.
        """
        return cls(
            ra_icrs_deg=m.ra_icrs_deg,
            dec_icrs_deg=m.dec_icrs_deg,
            covariance=single_streak_covariance(m, track, along_arcsec),
            rate_arcsec_s=np.array(lqe.sky_rate_arcsec_s(track)),
        )


NO_PATTERN = TrackPattern()


def pattern_after(
    before: TrackPattern, alive: Sequence[int], seen: Mapping[int, "TrackPlace"], t_utc_ns: int
) -> TrackPattern:
    """Return the pattern of the tracks ``alive``, updated with a frame.

    ``seen``: the place of each track that the frame showed, by the track's number.
    """
    if len(alive) < 2:
        return NO_PATTERN
    number, tracks = len(alive), np.array(alive)
    t, ways = np.zeros((number, number)), np.zeros((number, number, 4))
    covariances = np.zeros((number, number, 4, 4))
    i, j = np.triu_indices(number, 1)
    shown = np.array([track in seen for track in alive])
    both = shown[i] & shown[j]
    # What this frame has not shown stays as it was.
    at = _places_in(tracks, before.track_ids)
    old = ~both & (at[i] >= 0) & (at[j] >= 0)
    a, b = at[i[old]], at[j[old]]
    t[i[old], j[old]] = before.t_utc_ns[a, b]
    ways[i[old], j[old]] = before.ways[a, b]
    covariances[i[old], j[old]] = before.covariances[a, b]
    if both.any():
        i, j = i[both], j[both]
        t[i, j] = float(t_utc_ns)
        ways[i, j], covariances[i, j] = _shown(before, tracks, seen, (i, j), t_utc_ns)
    t += t.T
    ways -= np.swapaxes(ways, 0, 1)
    covariances += np.swapaxes(covariances, 0, 1)
    return TrackPattern(tuple(alive), t, ways, covariances)


def _shown(
    before: TrackPattern,
    tracks: IntArray,
    seen: Mapping[int, "TrackPlace"],
    pairs: tuple[IntArray, IntArray],
    t_utc_ns: int,
) -> tuple[FloatArray, FloatArray]:
    """Ways and rates (M, 4) of the pairs that a frame has shown, with covariances (M, 4, 4)."""
    i, j = pairs
    each = [seen.get(track) for track in tracks.tolist()]
    first = next(one for one in each if one is not None)
    plane = TangentPlane.at(first.ra_icrs_deg, first.dec_icrs_deg)
    none = np.full(2, np.nan)
    places = np.array(
        [none if e is None else plane.project_arcsec(e.ra_icrs_deg, e.dec_icrs_deg) for e in each]
    )
    rates = np.array([none if e is None else e.rate_arcsec_s for e in each])
    own = np.array([np.full((2, 2), np.nan) if e is None else e.covariance for e in each])
    R, rate = own[i] + own[j], rates[j] - rates[i]
    rate[np.hypot(*rate.T) < OTHER_MOTION_ARCSEC_S] = 0.0
    means = np.concatenate([places[j] - places[i], rate], axis=1)
    covariances = np.zeros((len(i), 4, 4))
    covariances[:, 2, 2] = covariances[:, 3, 3] = _RATE_ARCSEC_S**2
    covariances[:, :2, :2] = R
    known, mean, covariance = before._carried(tracks, i, j, t_utc_ns)
    R = R[known]
    gain = covariance[:, :, :2] @ np.linalg.inv(covariance[:, :2, :2] + R)
    left = np.tile(np.eye(4), (len(mean), 1, 1))
    left[:, :, :2] -= gain
    off = means[known, :2] - mean[:, :2]
    means[known] = mean + (gain @ off[:, :, None])[:, :, 0]
    across = np.swapaxes(gain, 1, 2)
    covariances[known] = left @ covariance @ np.swapaxes(left, 1, 2) + gain @ R @ across
    return means, covariances


def single_streak_covariance(
    m: Measurement, track: TrackState, along_arcsec: float | None = None
) -> FloatArray:
    """Covariance (2, 2) of a streak's position, arcsec^2, without errors common to the frame.

    It includes the errors that the track's filter has learnt. ``along_arcsec``: error along the
    streak that its length indicates; None: that of the streak that the track accepted last.
    """
    ee, en, nn = m.cov_sky_arcsec2
    said = track.mixture
    scale, more = (1.0, 0.0) if said is None else (said.variance_scale, said.along_arcsec)
    more = more if along_arcsec is None else along_arcsec
    ahead = streak_axis(m)
    if ahead is None:
        rate = np.array(lqe.sky_rate_arcsec_s(track))
        ahead = rate / max(float(np.hypot(*rate)), 1e-3)
    own = scale * np.array([[ee, en], [en, nn]]) + more**2 * np.outer(ahead, ahead)
    return own + _MIN_ARCSEC**2 * np.eye(2)


def learnt_error_arcsec(m: Measurement, track: TrackState) -> float:
    """One sigma of a streak's position on its worse axis, with the filter's learnt errors.

    0 for a filter that learns none: then only the measurement's own error is known.
    """
    if track.mixture is None:
        return 0.0
    return float(np.sqrt(np.linalg.eigvalsh(single_streak_covariance(m, track))[-1]))
