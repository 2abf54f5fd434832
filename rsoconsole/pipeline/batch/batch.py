"""Algorithm 1 over recorded frames: what the engine does with a camera's, without a mount."""

import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from rsoconsole.config import Config
from rsoconsole.errors import FrameError
from rsoconsole.instruments.frames import read_frame
from rsoconsole.pipeline.cycle import Cycle, taken_record
from rsoconsole.pipeline.frame import FrameReducer, Reduction, shutter_mid_utc_ns
from rsoconsole.pipeline.orbits import Orbits
from rsoconsole.records import Frame, Record
from rsoconsole.tracking.association import Following


@dataclass(frozen=True, slots=True, kw_only=True)
class Processed:
    """One frame, what it gave, and what is followed after it."""

    path: Path
    frame: Frame
    t_mid_utc_ns: int | None
    reduction: Reduction
    after: Following
    records: tuple[Record, ...]
    """All that belongs on the record, in order."""


def process_files(
    paths: Sequence[Path],
    reducer: FrameReducer,
    config: Config,
    *,
    numbers: Iterable[int] | None = None,
    extension: str | None = None,
) -> Iterator[Processed | tuple[Path, FrameError]]:
    """Every frame in the order given; a frame that cannot be used is passed on with its error.

    A frame without a time is detected and solved, and leaves the track as it is. ``numbers``: the
    frames' own; from 1 on with None. ``extension`` as ``read_frame`` takes it.
    """
    cycle, orbits = Cycle(reducer, config), Orbits(config)
    following = Following()
    for number, path in zip(numbers or itertools.count(1), paths, strict=False):
        try:
            frame = read_frame(path, number, extension=extension)
            outcomes: tuple[Record, ...] = ()
            if frame.t_mid_utc_ns is None or frame.exposure_s is None:
                reduction = reducer.reduce(frame)
            else:
                result = cycle.run(frame, following, orbits=orbits.last)
                reduction, following, outcomes = result.reduction, result.after, result.records
                for record in (taken_record(frame), *outcomes):
                    orbits.receive(record)
                outcomes = (*outcomes, *orbits.refine())
        except FrameError as error:
            yield path, error
            continue
        yield Processed(
            path=path,
            frame=frame,
            t_mid_utc_ns=shutter_mid_utc_ns(frame, config.exposure),
            reduction=reduction,
            after=following,
            records=(taken_record(frame), *outcomes),
        )
