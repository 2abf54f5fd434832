"""Where the satellites of a field stand to each other, from the frames that showed both. Pure.

What a frame's time or plate is wrong by moves all of its streaks alike, so the way from one to
another knows nothing of it (differential coordinates). Of every two tracks that way and its rate
are filtered by themselves: they tell members of a slot apart after frames in which one of them was
not seen, where each track's own prediction is off by what the shutter did in the others.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rsoconsole.records import FloatArray, Measurement, TrackState
from rsoconsole.tracking import lqe
from rsoconsole.tracking.sky_path import Plane

_RATE_ARCSEC_S = 0.5
"""One sigma of how fast one may move against another before two frames have shown it."""
OTHERWISE_ARCSEC_S = 3.0 * _RATE_ARCSEC_S
"""Faster by their own rates they are no members of one slot: those rates are believed."""
_ACCELERATION_Q = 1e-9
"""White acceleration of that, arcsec^2/s^3: relative orbits, and tangent planes that turn."""
_LEAST_ARCSEC = 0.5
"""Sigma on each axis of any place against another in its frame: the lens, ends that err."""


@dataclass(frozen=True, slots=True, eq=False)
class Pattern:
    """The ways from each track to each other, arcsec east and north, at the last frame of both."""

    track_ids: tuple[int, ...] = ()
    t_utc_ns: FloatArray | None = None
    """(N, N); 0 where no frame has shown both."""
    ways: FloatArray | None = None
    """(N, N, 4): east, north and their rates."""
    covariances: FloatArray | None = None
    """(N, N, 4, 4)"""

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Pattern) or self.track_ids != other.track_ids:
            return False
        ours = (self.t_utc_ns, self.ways, self.covariances)
        theirs = (other.t_utc_ns, other.ways, other.covariances)
        return all(
            one is another or (one is not None and another is not None and _is_same(one, another))
            for one, another in zip(ours, theirs, strict=True)
        )

    def __hash__(self) -> int:
        return hash(self.track_ids)

    def way(self, one: int, other: int, t_utc_ns: int) -> tuple[FloatArray, FloatArray] | None:
        """From a track to another at an instant: (2,) and covariance (2, 2); None: not known."""
        if one not in self.track_ids or other not in self.track_ids:
            return None
        i, j = self.track_ids.index(one), self.track_ids.index(other)
        assert self.t_utc_ns is not None
        if self.t_utc_ns[i, j] == 0.0:
            return None
        mean, covariance = self.carried(i, j, t_utc_ns)
        return mean[:2], covariance[:2, :2]

    def carried(self, i: int, j: int, t_utc_ns: int) -> tuple[FloatArray, FloatArray]:
        """Way and rate (4,) from the i-th to the j-th at an instant, with covariance (4, 4)."""
        assert self.t_utc_ns is not None
        assert self.ways is not None
        assert self.covariances is not None
        dt_s = (t_utc_ns - float(self.t_utc_ns[i, j])) / 1e9
        carry = np.eye(4)
        carry[0, 2] = carry[1, 3] = dt_s
        span = abs(dt_s)
        noise = np.zeros((4, 4))
        for axis in (0, 1):
            noise[axis, axis] = _ACCELERATION_Q * span**3 / 3.0
            noise[axis, axis + 2] = noise[axis + 2, axis] = _ACCELERATION_Q * dt_s * span / 2.0
            noise[axis + 2, axis + 2] = _ACCELERATION_Q * span
        return carry @ self.ways[i, j], carry @ self.covariances[i, j] @ carry.T + noise


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Place:
    """What a frame has shown of one track."""

    ra_icrs_deg: float
    dec_icrs_deg: float
    covariance: FloatArray
    """(2, 2) of the place, arcsec^2, without what all of a frame share."""
    rate_arcsec_s: FloatArray
    """(2,) of the track, east and north."""

    @classmethod
    def of(cls, m: Measurement, track: TrackState, along_arcsec: float | None = None) -> "Place":
        """Of the streak that a track has taken; ``along_arcsec`` as ``own_covariance`` has it."""
        return cls(
            ra_icrs_deg=m.ra_icrs_deg,
            dec_icrs_deg=m.dec_icrs_deg,
            covariance=own_covariance(m, track, along_arcsec),
            rate_arcsec_s=np.array(lqe.sky_rate_arcsec_s(track)),
        )


NO_PATTERN = Pattern()
"""Of a field with fewer than two tracks."""


def _is_same(one: FloatArray, other: FloatArray) -> bool:
    return bool(np.array_equal(one, other))


def after(
    before: Pattern,
    alive: Sequence[int],
    seen: Mapping[int, "Place"],
    t_utc_ns: int,
) -> Pattern:
    """The pattern of the tracks ``alive``, with what a frame has shown of them.

    ``seen``: what the frame has shown of each track.
    """
    if len(alive) < 2:
        return NO_PATTERN
    number = len(alive)
    t, ways = np.zeros((number, number)), np.zeros((number, number, 4))
    covariances = np.zeros((number, number, 4, 4))
    first = next(iter(seen.values()), None)
    plane = None if first is None else Plane.at(first.ra_icrs_deg, first.dec_icrs_deg)
    places = {
        track: plane.place_of(each.ra_icrs_deg, each.dec_icrs_deg)
        for track, each in seen.items()
        if plane is not None
    }
    old = {track: k for k, track in enumerate(before.track_ids)}
    for i, one in enumerate(alive):
        for j, other in enumerate(alive):
            if i >= j:
                continue
            if one in places and other in places:
                way = places[other] - places[one]
                R = seen[one].covariance + seen[other].covariance
                rate = seen[other].rate_arcsec_s - seen[one].rate_arcsec_s
                if float(np.hypot(*rate)) < OTHERWISE_ARCSEC_S:
                    rate = np.zeros(2)
                begun = np.concatenate([way, rate])
                mean, covariance = _taken(before, old.get(one), old.get(other), begun, R, t_utc_ns)
                at = float(t_utc_ns)
            elif one in old and other in old and before.t_utc_ns is not None:
                a, b = old[one], old[other]
                assert before.ways is not None
                assert before.covariances is not None
                mean, covariance = before.ways[a, b], before.covariances[a, b]
                at = float(before.t_utc_ns[a, b])
            else:
                continue
            t[i, j] = t[j, i] = at
            ways[i, j], ways[j, i] = mean, -mean
            covariances[i, j] = covariances[j, i] = covariance
    return Pattern(tuple(alive), t, ways, covariances)


def own_covariance(
    m: Measurement, track: TrackState, along_arcsec: float | None = None
) -> FloatArray:
    """Covariance (2, 2) of a streak's place that it shares with no other, arcsec^2.

    By what its track has learnt of its errors; ``along_arcsec``: what its length adds along the
    motion; None: as of the one that the track took last.
    """
    ee, en, nn = m.cov_sky_arcsec2
    said = track.mixture
    scale, more = (1.0, 0.0) if said is None else (said.variance_scale, said.along_arcsec)
    more = more if along_arcsec is None else along_arcsec
    rate = np.array(lqe.sky_rate_arcsec_s(track))
    ahead = rate / max(float(np.hypot(*rate)), 1e-3)
    own = scale * np.array([[ee, en], [en, nn]]) + more**2 * np.outer(ahead, ahead)
    return own + _LEAST_ARCSEC**2 * np.eye(2)


def learnt_error_arcsec(m: Measurement, track: TrackState) -> float:
    """One sigma of a streak's place by what its track has learnt, on its worse axis.

    0 where the filter learns nothing: what the measurement states is all that is known.
    """
    if track.mixture is None:
        return 0.0
    return float(np.sqrt(np.linalg.eigvalsh(own_covariance(m, track))[-1]))


def _taken(  # noqa: PLR0917 -- one update, each argument a different thing
    before: Pattern, i: int | None, j: int | None, begun: FloatArray, R: FloatArray, t_utc_ns: int
) -> tuple[FloatArray, FloatArray]:
    if i is None or j is None or before.t_utc_ns is None or before.t_utc_ns[i, j] == 0.0:
        covariance = np.diag([0.0, 0.0, _RATE_ARCSEC_S**2, _RATE_ARCSEC_S**2])
        covariance[:2, :2] = R
        return begun, covariance
    mean, covariance = before.carried(i, j, t_utc_ns)
    gain = covariance[:, :2] @ np.linalg.inv(covariance[:2, :2] + R)
    left = np.eye(4)
    left[:, :2] -= gain
    return mean + gain @ (begun[:2] - mean[:2]), left @ covariance @ left.T + gain @ R @ gain.T
