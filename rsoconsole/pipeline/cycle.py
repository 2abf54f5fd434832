"""One cycle: a frame, what it shows, what is followed after it, and all that goes on record.

The engine, ``process`` and every replay run this, so that the same frames give the same track.
``fold`` is the half of it that needs no pixels: pure, from what is on record alone.
"""

from dataclasses import dataclass
from typing import Any

from rsoconsole.config import Config
from rsoconsole.errors import FrameError
from rsoconsole.pipeline.absence import StarHistory, counted, explain_absence, stars_of
from rsoconsole.pipeline.measure import shutter_mid_utc_ns
from rsoconsole.pipeline.reduce import FrameReducer, Reduction, plain_absence
from rsoconsole.records import (
    Detections,
    Frame,
    FrameTaken,
    Measurement,
    NotSolved,
    Solution,
)
from rsoconsole.tracking.follow import NOTHING_FITS, Following, FollowSettings, Seen, follow
from rsoconsole.tracking.neighbours import Field


@dataclass(frozen=True, slots=True, kw_only=True)
class CycleResult:
    """What one frame led to."""

    reduction: Reduction
    after: Following
    records: tuple[Any, ...]
    """All that belongs on the record behind ``FrameTaken``, in order."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Shown:
    """What a frame showed, as the record has it."""

    taken: FrameTaken
    detections: Detections
    solution: Solution | NotSolved | None
    measurements: tuple[Measurement, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Folded:
    """What is known after a frame."""

    following: Following
    stars: StarHistory
    records: tuple[Any, ...]
    """What the fold puts on record, in order."""


def fold(before: Following, stars_before: StarHistory, shown: Shown, config: Config) -> Folded:
    """What is followed after a frame. Pure. Raises FrameError for a frame without a time."""
    taken = shown.taken
    t_mid_ns, exposure_s = _when(taken, config)
    stars = stars_of(shown.detections, exposure_s)
    plain = NOTHING_FITS
    if not shown.measurements:
        plain = plain_absence(shown.detections, shown.solution, t_mid_ns)
    absence = explain_absence(
        plain,
        stars=stars,
        stars_before=stars_before,
        track=before.track,
        site=config.site.to_site(),
        t_utc_ns=t_mid_ns,
        blocked=taken.blocked,
    )
    seen = Seen(
        frame_id=taken.frame_id,
        t_mid_utc_ns=t_mid_ns,
        exposure_s=exposure_s,
        measurements=shown.measurements,
        absence=absence,
        field=_field(shown),
    )
    after, records = follow(before, seen, follow_settings(config, taken))
    return Folded(
        following=after, stars=counted(stars_before, stars, shown.solution), records=records
    )


def _field(shown: Shown) -> Field | None:
    if not isinstance(shown.solution, Solution):
        return None
    size = (shown.taken.width_px, shown.taken.height_px)
    return Field(wcs=shown.solution.wcs, width_px=size[0], height_px=size[1])


def _when(taken: FrameTaken, config: Config) -> tuple[int, float]:
    """Mid-exposure by the shutter, and the exposure's length. Raises FrameError without a time."""
    t_mid_ns = shutter_mid_utc_ns(taken, config.exposure)
    if t_mid_ns is None or taken.exposure_s is None:
        raise FrameError(
            f"{taken.name} has no DATE-OBS or EXPTIME: it can be detected and solved,"
            " not followed; have the camera's driver write them"
        )
    return t_mid_ns, taken.exposure_s


def looked_at(stars_before: StarHistory, shown: Shown) -> StarHistory:
    """The stars known after a frame that is not followed."""
    if shown.taken.exposure_s is None:
        return stars_before
    return counted(stars_before, stars_of(shown.detections, shown.taken.exposure_s), shown.solution)


class Cycle:
    """Reducer and fold under one configuration."""

    def __init__(self, reducer: FrameReducer, config: Config) -> None:
        self._reducer = reducer
        self._config = config
        self._stars = StarHistory()

    def configure(self, config: Config) -> None:
        """Take new tunables; in force from the next frame."""
        self._config = config
        self._reducer.configure(config)

    def forget_plate(self) -> None:
        """The camera has turned: the last plate says nothing any more."""
        self._reducer.forget_plate()

    def look(self, frame: Frame) -> tuple[Reduction, tuple[Any, ...]]:
        """Reduce a frame that is not followed; (what it shows, what belongs on the record)."""
        reduction = self._reducer.reduce(frame)
        self._stars = looked_at(self._stars, _shown(taken_record(frame), reduction))
        return reduction, _on_record(reduction)

    def run(self, frame: Frame, before: Following, blocked: str | None = None) -> CycleResult:
        """Reduce one frame and fold it. Raises FrameError for a frame without a time.

        ``blocked``: why the slew to the track was refused before this frame, as ``FrameTaken``
        carries it.
        """
        taken = taken_record(frame, blocked)
        _when(taken, self._config)  # before the work: such a frame cannot be folded
        reduction = self._reducer.reduce(frame)
        folded = fold(before, self._stars, _shown(taken, reduction), self._config)
        self._stars = folded.stars
        return CycleResult(
            reduction=reduction,
            after=folded.following,
            records=(*_on_record(reduction), *folded.records),
        )


def _shown(taken: FrameTaken, reduction: Reduction) -> Shown:
    return Shown(
        taken=taken,
        detections=reduction.detections,
        solution=reduction.solution,
        measurements=reduction.measurements,
    )


def _on_record(reduction: Reduction) -> tuple[Any, ...]:
    solution = () if reduction.solution is None else (reduction.solution,)
    return (reduction.detections, *solution, *reduction.measurements)


def follow_settings(config: Config, frame: Frame | FrameTaken) -> FollowSettings:
    """The fold's settings for a frame of this size."""
    half_field_px = min(frame.width_px, frame.height_px) / 2.0
    return FollowSettings(
        filter=config.filter,
        half_field_deg=half_field_px * config.optics.scale_arcsec_px / 3600.0,
        choice=config.search.follow,
    )


def taken_record(frame: Frame, blocked: str | None = None) -> FrameTaken:
    """What the session keeps of a frame beside its pixels; ``blocked`` as ``Cycle.run`` has it."""
    return FrameTaken(
        frame_id=frame.frame_id,
        name=frame.name,
        t_start_utc_ns=frame.t_start_utc_ns,
        exposure_s=frame.exposure_s,
        width_px=frame.width_px,
        height_px=frame.height_px,
        pointing_ra_icrs_deg=frame.pointing_ra_icrs_deg,
        pointing_dec_icrs_deg=frame.pointing_dec_icrs_deg,
        blocked=blocked,
    )
