"""Algorithm 1 over recorded frames: what the engine does with a camera's, without a mount."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rsoconsole.config import Config
from rsoconsole.errors import FrameError
from rsoconsole.instruments.frame_files import read_frame
from rsoconsole.pipeline.reduce import FrameReducer, Reduction
from rsoconsole.records import Frame, FrameTaken
from rsoconsole.tracking.follow import Following, FollowSettings, follow


@dataclass(frozen=True, slots=True, kw_only=True)
class Processed:
    """One frame, what it gave, and what is followed after it."""

    path: Path
    frame: Frame
    reduction: Reduction
    after: Following
    records: tuple[Any, ...]
    """All that belongs on the record, in order."""


def process_files(
    paths: list[Path], reducer: FrameReducer, config: Config
) -> Iterator[Processed | tuple[Path, FrameError]]:
    """Every frame in the order given; a frame that cannot be used is passed on with its error."""
    following = Following()
    for number, path in enumerate(paths, start=1):
        try:
            frame = read_frame(path, number)
            reduction = reducer.reduce(frame)
        except FrameError as error:
            yield path, error
            continue
        taken = taken_record(frame)
        outcomes: tuple[Any, ...] = ()
        if frame.t_mid_utc_ns is not None and frame.exposure_s is not None:
            t_mid_ns = frame.t_mid_utc_ns + round(config.exposure.header_latency_s * 1e9)
            seen = reduction.seen(frame, t_mid_ns, frame.exposure_s)
            following, outcomes = follow(following, seen, _settings(config, frame))
        solution = () if reduction.solution is None else (reduction.solution,)
        yield Processed(
            path=path,
            frame=frame,
            reduction=reduction,
            after=following,
            records=(taken, reduction.detections, *solution, *reduction.measurements, *outcomes),
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


def _settings(config: Config, frame: Frame) -> FollowSettings:
    scale_arcsec_px = frame.scale_arcsec_px or config.optics.scale_arcsec_px
    return FollowSettings(
        filter=config.filter,
        half_field_deg=min(frame.width_px, frame.height_px) * scale_arcsec_px / 7200.0,
        choice=config.search.follow,
    )
