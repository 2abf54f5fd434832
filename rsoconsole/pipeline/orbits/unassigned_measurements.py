"""Measurements that no track accepted, and the search among them for those of an orbit.

A track begins with the first two frames that agree, and its gate may exclude measurements. Earlier
or excluded measurements may still be of the same object. One belongs to the object where the
orbit's predicted density at its direction far exceeds that of unrelated detections.
"""

import math
from collections.abc import Collection, Iterable
from itertools import chain

import numpy as np

from rsoconsole.orbits import KnownOrbit, predict
from rsoconsole.records import (
    FloatArray,
    FollowedAgain,
    Measurement,
    NotFollowed,
    Record,
    Site,
    TrackState,
)
from rsoconsole.sky import wrap_180
from rsoconsole.tracking import REFUSED, STRANGERS_ARCSEC2, SURE_ODDS, TRACKABLE_CLASSES
from rsoconsole.words import NS_PER_S

KEPT_S = 7200.0
"""Age beyond which measurements are dropped, s: no track has lasted unseen for longer."""
_MOST = 600
_GATE_NIS = 9.21
"""Gate on the NIS of two numbers, which excludes a hundredth of the object's own measurements."""


class UnassignedMeasurements:
    """Keeps the measurements of the last two hours that no track accepted, from the records."""

    def __init__(self) -> None:
        self._seen: dict[str, Measurement] = {}
        self._settled: dict[int, set[str]] = {}
        """Ids by frame: measurements that tracks accepted, and those that the operator rejected."""

    def receive(self, record: Record) -> None:
        """Process the next record of the log; kinds that do not concern it are ignored."""
        if isinstance(record, Measurement):
            self._seen[record.measurement_id] = record
            self._let_go(record.t_mid_utc_ns)
        elif isinstance(record, FollowedAgain):
            self._settled.pop(record.frame_id, None)
        elif isinstance(record, TrackState) and record.kind != "predicted":
            ids = (record.measurement_id, *(record.begun_with or ()), *record.begun_through)
            self._settle(record.frame_id, ids)
        elif isinstance(record, NotFollowed) and record.reason == REFUSED:
            self._settle(record.frame_id, (record.measurement.measurement_id,))

    def measurements_of_orbit(
        self, orbit: KnownOrbit, site: Site, without: Collection[int], learnt: tuple[float, float]
    ) -> tuple[Measurement, ...]:
        """Return the unassigned measurements that belong to an orbit, at most one per frame.

        They are in order of time. ``without``: frames to leave out, in which the object is measured
        already; ``learnt``: (timing scatter, s; factor on variances) as the track has learned
        them.
        """
        settled = set(chain.from_iterable(self._settled.values()))
        asked = [
            m
            for m in self._seen.values()
            if m.measurement_id not in settled
            and m.frame_id not in without
            and not m.is_clipped
            and m.object_class in TRACKABLE_CLASSES
            and _is_direction(m)
        ]
        if not asked:
            return ()
        own = _are_own(asked, orbit, site, learnt)
        found: dict[int, list[Measurement]] = {}
        for m, is_own in zip(asked, own, strict=True):
            if is_own:
                found.setdefault(m.frame_id, []).append(m)
        return tuple(each[0] for each in found.values() if len(each) == 1)

    def _settle(self, frame_id: int, ids: Iterable[str | None]) -> None:
        self._settled.setdefault(frame_id, set()).update(each for each in ids if each)

    def _let_go(self, now_utc_ns: int) -> None:
        while self._seen:
            oldest = next(iter(self._seen))
            m = self._seen[oldest]
            is_old = now_utc_ns - m.t_mid_utc_ns > KEPT_S * NS_PER_S
            if not is_old and len(self._seen) <= _MOST:
                return
            del self._seen[oldest]
            for frame_id in [each for each in self._settled if each < m.frame_id]:
                del self._settled[frame_id]


def _is_direction(m: Measurement) -> bool:
    ee, en, nn = m.cov_sky_arcsec2
    numbers = (m.ra_icrs_deg, m.dec_icrs_deg, ee, en, nn)
    return all(map(math.isfinite, numbers)) and min(ee, nn) > 0.0 and ee * nn > en * en


def _are_own(
    asked: list[Measurement], orbit: KnownOrbit, site: Site, learnt: tuple[float, float]
) -> FloatArray:
    """True for each measurement, (N,), with a density by the orbit far above that of strangers."""
    ahead = predict(orbit, site, np.array([m.t_mid_utc_ns for m in asked], np.int64))
    places = ahead.places
    cos_dec = np.cos(np.radians(places.dec_icrs_deg))
    off = 3600.0 * np.stack(
        [
            wrap_180(np.array([m.ra_icrs_deg for m in asked]) - places.ra_icrs_deg) * cos_dec,
            np.array([m.dec_icrs_deg for m in asked]) - places.dec_icrs_deg,
        ],
        axis=-1,
    )
    scatter_s, scale = learnt
    along = 3600.0 * np.stack([places.ra_rate_deg_s * cos_dec, places.dec_rate_deg_s], axis=-1)
    ee, en, nn = (ahead.cov_sky_arcsec2 + scale * np.array([m.cov_sky_arcsec2 for m in asked])).T
    spread = np.stack([np.stack([ee, en], axis=-1), np.stack([en, nn], axis=-1)], axis=-2)
    spread = spread + scatter_s**2 * along[:, :, None] * along[:, None, :]
    is_finite = np.isfinite(spread).all(axis=(-2, -1)) & np.isfinite(off).all(axis=-1)
    spread = np.where(is_finite[:, None, None], spread, np.eye(2))
    off = np.where(is_finite[:, None], off, 0.0)
    nis = np.einsum("ni,nij,nj->n", off, np.linalg.inv(spread), off)
    log_density = -nis / 2.0 - np.log(2.0 * math.pi) - np.linalg.slogdet(spread)[1] / 2.0
    is_sure = log_density - math.log(STRANGERS_ARCSEC2) >= math.log(SURE_ODDS)
    return np.asarray(is_finite & (nis <= _GATE_NIS) & is_sure)
