"""Detector and solver once more over the frames that a session has kept.

A frame that was not kept, or can no longer be read, keeps what was recorded of it. The plate is
moved from frame to frame as it was that night: where the engine solved in full, so does this.
"""

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

from rsoconsole.config import Config
from rsoconsole.errors import FrameError
from rsoconsole.instruments.frames import read_frame
from rsoconsole.pipeline.cycle import Shown
from rsoconsole.pipeline.frame import (
    FrameReducer,
    Part,
    calibration_warnings,
    measured,
    numbered_like,
    open_reducer,
)
from rsoconsole.records import Frame, FrameTaken, NotSolved, Solution
from rsoconsole.session.reading import SessionReader
from rsoconsole.vision.detector import ConfidenceCurve, Network
from rsoconsole.vision.stars import StarList

log = logging.getLogger(__name__)


@dataclass(slots=True, kw_only=True)
class RerunCounts:
    """How many frames were reduced again, and of how many the record was taken."""

    rerun: int = 0
    not_kept: int = 0
    unreadable: int = 0


class Rerun:
    """Calls itself for each frame of a replay (``replay``'s ``reduce_again``)."""

    def __init__(
        self,
        reader: SessionReader,
        reducer: FrameReducer,
        recorded_plate: "RecordedPlate | None",
        *,
        with_detector: bool,
        on_frame: Callable[[], None],
    ) -> None:
        self.counts = RerunCounts()
        self._reader = reader
        self._reducer = reducer
        self._recorded_plate = recorded_plate
        self._with_detector = with_detector
        self._on_frame = on_frame
        self._config: Config | None = None
        self._said: set[str] = set()

    def __call__(self, shown: Shown, config: Config) -> Shown:
        """What the frame shows now; what was recorded where its pixels are gone."""
        self._on_frame()
        frame = self._frame(shown)
        if frame is None:
            return shown
        if config != self._config:
            self._reducer.configure(config)
            self._config = config
        if self._recorded_plate is not None:
            self._recorded_plate.solution = shown.solution
        elif isinstance(shown.solution, Solution) and shown.solution.path == "full":
            self._reducer.forget_plate()
        reduction = self._reducer.reduce(frame)
        self.counts.rerun += 1
        for words in calibration_warnings(reduction.cautions):
            if words not in self._said:
                self._said.add(words)
                log.warning("%s", words)
        if self._with_detector:
            return replace(
                shown,
                detections=reduction.detections,
                solution=reduction.solution,
                measurements=numbered_like(
                    reduction.measurements, shown.measurements, shown.detections
                ),
            )
        return _with_plate(shown, reduction.solution, config)

    def _frame(self, shown: Shown) -> Frame | None:
        taken = shown.taken
        path = self._reader.frame_path(taken.frame_id)
        if path is None:
            self.counts.not_kept += 1
            return None
        try:
            frame = read_frame(path, taken.frame_id)
        except FrameError:
            self.counts.unreadable += 1
            return None
        return replace(as_recorded(frame, taken), name=taken.name)


def as_recorded(frame: Frame, taken: FrameTaken) -> Frame:
    """What the camera's process said of it counts, not what a card may have rounded."""
    return replace(
        frame,
        t_start_utc_ns=taken.t_start_utc_ns,
        exposure_s=taken.exposure_s,
        pointing_ra_icrs_deg=taken.pointing_ra_icrs_deg,
        pointing_dec_icrs_deg=taken.pointing_dec_icrs_deg,
    )


class RecordedPlate:
    """Gives the plate that is on record: for a detector that is tried alone."""

    def __init__(self) -> None:
        self.solution: Solution | NotSolved | None = None

    def configure(self, config: Config) -> None:
        """Nothing to take."""

    def forget(self) -> None:
        """Nothing to forget."""

    def solve(self, frame: Frame, stars: StarList) -> Solution | NotSolved | None:
        """What was found that night."""
        _ = frame, stars
        return self.solution

    def moved(self, frame: Frame, stars: StarList, part: Part) -> Solution | None:
        """Nobody looks at a part of a recorded frame."""
        _ = frame, stars, part
        return None


@contextmanager
def open_rerun(
    reader: SessionReader,
    config: Config,
    *,
    with_detector: bool,
    with_solver: bool,
    on_frame: Callable[[], None] = lambda: None,
) -> Iterator[tuple[Rerun, str]]:
    """Ready to reduce a session's frames again, and the network's SHA-256.

    Raises ModelError when the network cannot be loaded, SolverError without index files.
    """
    if with_solver:
        with open_reducer(config) as (reducer, sha256):
            yield (
                Rerun(reader, reducer, None, with_detector=with_detector, on_frame=on_frame),
                sha256,
            )
        return
    network = Network.load(config.detector.model, config.detector.threads)
    plate = RecordedPlate()
    reducer = FrameReducer(network, ConfidenceCurve.from_card(network.card), plate, config)
    yield (
        Rerun(reader, reducer, plate, with_detector=True, on_frame=on_frame),
        str(network.card["sha256"]),
    )


def _with_plate(shown: Shown, solution: Solution | NotSolved | None, config: Config) -> Shown:
    """The recorded detections, measured with another plate; what a hand marked stays as it is."""
    measurements = [m for m in shown.measurements if m.source == "operator"]
    if isinstance(solution, Solution):
        measurements += measured(shown.detections, solution, shown.taken, config.exposure)
    return replace(shown, solution=solution, measurements=tuple(measurements))
