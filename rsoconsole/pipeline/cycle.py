"""One cycle: a frame, what it shows, what is followed after it, and all that goes on record.

The engine, ``process`` and every replay run this, so that the same frames give the same track.
"""

from dataclasses import dataclass
from typing import Any

from rsoconsole.config import Config
from rsoconsole.errors import FrameError
from rsoconsole.pipeline.measure import shutter_mid_utc_ns
from rsoconsole.pipeline.reduce import FrameReducer, Reduction
from rsoconsole.records import Frame, FrameTaken
from rsoconsole.tracking.follow import Following, FollowSettings, Seen, follow


@dataclass(frozen=True, slots=True, kw_only=True)
class CycleResult:
    """What one frame led to."""

    reduction: Reduction
    after: Following
    records: tuple[Any, ...]
    """All that belongs on the record behind ``FrameTaken``, in order."""


class Cycle:
    """Reducer and fold under one configuration."""

    def __init__(self, reducer: FrameReducer, config: Config) -> None:
        self._reducer = reducer
        self._config = config

    def configure(self, config: Config) -> None:
        """Take new tunables; in force from the next frame."""
        self._config = config
        self._reducer.configure(config)

    def forget_plate(self) -> None:
        """The camera has turned: the last plate says nothing any more."""
        self._reducer.forget_plate()

    def run(self, frame: Frame, before: Following) -> CycleResult:
        """Reduce one frame and fold it. Raises FrameError for a frame without a time."""
        t_mid_ns = shutter_mid_utc_ns(frame, self._config.exposure)
        exposure_s = frame.exposure_s
        if t_mid_ns is None or exposure_s is None:
            raise FrameError(
                f"{frame.name} has no DATE-OBS or EXPTIME: it can be detected and solved,"
                " not followed; have the camera's driver write them"
            )
        reduction = self._reducer.reduce(frame)
        seen = Seen(
            frame_id=frame.frame_id,
            t_mid_utc_ns=t_mid_ns,
            exposure_s=exposure_s,
            measurements=reduction.measurements,
            absence=reduction.absence,
        )
        after, outcomes = follow(before, seen, follow_settings(self._config, frame))
        solution = () if reduction.solution is None else (reduction.solution,)
        return CycleResult(
            reduction=reduction,
            after=after,
            records=(reduction.detections, *solution, *reduction.measurements, *outcomes),
        )


def follow_settings(config: Config, frame: Frame | FrameTaken) -> FollowSettings:
    """The fold's settings for a frame of this size."""
    half_field_px = min(frame.width_px, frame.height_px) / 2.0
    return FollowSettings(
        filter=config.filter,
        half_field_deg=half_field_px * config.optics.scale_arcsec_px / 3600.0,
        choice=config.search.follow,
    )


def taken_record(frame: Frame) -> FrameTaken:
    """What the session keeps of a frame beside its pixels."""
    return FrameTaken(
        frame_id=frame.frame_id,
        name=frame.name,
        t_start_utc_ns=frame.t_start_utc_ns,
        exposure_s=frame.exposure_s,
        width_px=frame.width_px,
        height_px=frame.height_px,
        pointing_ra_icrs_deg=frame.pointing_ra_icrs_deg,
        pointing_dec_icrs_deg=frame.pointing_dec_icrs_deg,
    )
