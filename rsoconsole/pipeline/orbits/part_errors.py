"""What an orbit is fitted to, where a satellite's streaks show a part of their length."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from rsoconsole.records import FrameTaken, Measurement, Record, TrackState
from rsoconsole.tracking.association import expected_motion
from rsoconsole.tracking.filters import remembered_with, with_part_error


class Exposures:
    """How long each frame was exposed: what a streak's length is held against."""

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
        self, taken: Iterable[Measurement], track: TrackState, exposures: Exposures
    ) -> tuple[Measurement, ...]:
        """The track's next measurements, those of parts with the error that they share."""
        found = []
        for each in taken:
            exposure_s = exposures.of(each)
            wider = each
            if exposure_s is not None:
                expected = expected_motion(track, exposure_s)
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
