"""What an orbit is fitted to, where a satellite's streaks show a part of their length."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rsoconsole.records import FrameTaken, Measurement, Record, TrackState
from rsoconsole.tracking.association import expected_motion
from rsoconsole.tracking.filters import Motion, motion_in_exposure, remembered_with, with_part_error

_BESIDE, _BESIDE_S = 5, 600.0
"""Measurements to either side, and seconds, over which a satellite's rate is taken for one."""


class Exposures:
    """How long each frame was exposed: what a streak's length is compared with."""

    def __init__(self) -> None:
        self._of_frame_s: dict[int, float] = {}

    def receive(self, record: Record) -> None:
        """One record of the log."""
        if isinstance(record, FrameTaken) and record.exposure_s is not None:
            self._of_frame_s[record.frame_id] = record.exposure_s

    def of(self, measurement: Measurement) -> float | None:
        """Seconds; None where the frame did not say."""
        return self._of_frame_s.get(measurement.frame_id)


class PartErrors:
    """Knows the lengths of the streaks that one track has taken."""

    def __init__(self) -> None:
        self._excesses: tuple[float, ...] = ()
        self._added_arcsec2: tuple[float, ...] = (0.0, 0.0, 0.0)
        """To the covariance of the last one."""

    def widened(
        self,
        fresh: Sequence[Measurement],
        taken: Sequence[Measurement],
        track: TrackState,
        exposures: Exposures,
    ) -> tuple[Measurement, ...]:
        """The track's next measurements, those of parts with the error that they share.

        ``fresh``: the last of ``taken``, with whatever else their covariances hold; ``taken``: all
        that the track has taken, in order of time; ``track``: its state now.
        """
        found, first = [], len(taken) - len(fresh)
        for n, each in enumerate(fresh, start=first):
            exposure_s = exposures.of(each)
            wider = each
            if exposure_s is not None:
                expected = _motion(taken, n, exposure_s) or expected_motion(track, exposure_s)
                wider = with_part_error(each, expected, self._excesses)
                self._excesses = remembered_with(self._excesses, each, expected)
            found.append(wider)
            added = np.subtract(wider.cov_sky_arcsec2, each.cov_sky_arcsec2)
            self._added_arcsec2 = tuple(map(float, added))
        return tuple(found)

    def last_of(self, measurement: Measurement) -> Measurement:
        """The last one, whatever else its covariance holds, with the same error."""
        ee, en, nn = np.add(measurement.cov_sky_arcsec2, self._added_arcsec2)
        return replace(measurement, cov_sky_arcsec2=(float(ee), float(en), float(nn)))


def _motion(taken: Sequence[Measurement], n: int, exposure_s: float) -> Motion | None:
    """In one exposure, by what was measured beside the n-th; None where nothing was.

    The state's own rate is that of now: of an eccentric orbit it was another an hour ago.
    """
    here_ns = taken[n].t_mid_utc_ns
    near = [
        each
        for each in taken[max(n - _BESIDE, 0) : n + _BESIDE + 1]
        if abs(each.t_mid_utc_ns - here_ns) <= _BESIDE_S * 1e9
    ]
    first, last = near[0], near[-1]
    if (last.t_mid_utc_ns - first.t_mid_utc_ns) / 1e9 <= exposure_s:
        return None
    return motion_in_exposure(first, last, exposure_s)
