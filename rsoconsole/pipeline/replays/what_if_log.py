"""What-if of a recorded session: its figures, and the log as it would have been."""

import logging
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from rsoconsole.base import ConfigError, FrameError, SessionError
from rsoconsole.config import Config, with_changes, with_setting
from rsoconsole.instruments import read_frame
from rsoconsole.night import FigureAccumulator, TrackFigures
from rsoconsole.pipeline.cycle.frame_fold import FrameObservations, ReducedFrame
from rsoconsole.pipeline.frame.frame_cautions import calibration_warnings
from rsoconsole.pipeline.frame.measurement import measure_detections, with_recorded_ids
from rsoconsole.pipeline.frame.plate import FixedPlateSource
from rsoconsole.pipeline.frame.reduce import FrameReducer, open_reducer
from rsoconsole.pipeline.replays._rewrite_log import LogRewriter
from rsoconsole.pipeline.replays.refold import ReduceAgain, ReplayedFrame, ReplayState, replay
from rsoconsole.records import Frame, FrameTaken, NotSolved, Record, Solution
from rsoconsole.session import SessionReader
from rsoconsole.vision import ConfidenceCurve, Network


def last_version_of_each(frames: Iterable[ReplayedFrame]) -> list[ReplayedFrame]:
    """Return the frames by number; of a frame replayed several times only the last version."""
    by_number = {each.taken.frame_id: each for each in frames}
    return [by_number[number] for number in sorted(by_number)]


def add_replayed(found: FigureAccumulator, frame: ReplayedFrame) -> None:
    """Add a replayed frame to the sum of the figures."""
    found.add(frame.taken, frame.records, frame.after.state, frame.observations.solution)


def track_figures(
    frames: Iterable[ReplayedFrame], last: int | None = None, *, of_lead: bool = False
) -> TrackFigures:
    """Return the track figures of a replayed night.

    ``last``: number of latest frames to include; None: all. ``of_lead``: include the lead alone.
    """
    found = FigureAccumulator(of_lead=of_lead)
    for each in frames:
        add_replayed(found, each)
    return found.figures(last)


def what_if(
    records: Iterable[Record],
    config: Config,
    changes: Mapping[str, float | str],
    last: int | None = None,
    *,
    of_lead: bool = False,
) -> TrackFigures:
    """Return the figures of a night replayed with changed settings.

    ``last``, ``of_lead``: as in ``track_figures``. Raises ConfigError for a setting that does not
    exist, or a value that it cannot have.
    """
    return track_figures(replay(records, config, changes=changes), last, of_lead=of_lead)


log = logging.getLogger(__name__)


@dataclass(slots=True, kw_only=True)
class RerunCounts:
    """Numbers of frames: reduced again, or left as recorded (not kept, or unreadable)."""

    rerun: int = 0
    not_kept: int = 0
    unreadable: int = 0


class RecordedFrameReducer:
    """Reduces recorded frames again; called for each frame by ``ReplayState.reduce_again``."""

    def __init__(
        self,
        reader: SessionReader,
        reducer: FrameReducer,
        recorded_plate: FixedPlateSource | None,
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

    def __call__(self, observed: FrameObservations, config: Config) -> FrameObservations:
        """Return the frame's observations, reduced again; the recorded ones without its pixels."""
        self._on_frame()
        frame = self._frame(observed)
        if frame is None:
            return observed
        if config != self._config:
            self._reducer.configure(config)
            self._config = config
        if self._recorded_plate is not None:
            self._recorded_plate.solution = observed.solution
        elif isinstance(observed.solution, Solution) and observed.solution.path == "full":
            self._reducer.forget_plate()
        reduction = self._reducer.reduce(frame)
        self.counts.rerun += 1
        for words in calibration_warnings(reduction.cautions):
            if words not in self._said:
                self._said.add(words)
                log.warning("%s", words)
        if self._with_detector:
            return replace(
                observed,
                detections=reduction.detections,
                solution=reduction.solution,
                measurements=with_recorded_ids(
                    reduction.measurements, observed.measurements, observed.detections
                ),
            )
        return _with_plate(observed, reduction.solution, config)

    def _frame(self, observed: FrameObservations) -> Frame | None:
        taken = observed.taken
        path = self._reader.frame_path(taken.frame_id)
        if path is None:
            self.counts.not_kept += 1
            return None
        try:
            frame = read_frame(path, taken.frame_id)
        except FrameError:
            self.counts.unreadable += 1
            return None
        return replace(with_recorded_time_and_pointing(frame, taken), name=taken.name)


def with_recorded_time_and_pointing(frame: Frame, taken: FrameTaken) -> Frame:
    """Return the frame with the recorded time and pointing, which its file may hold rounded."""
    return replace(
        frame,
        t_start_utc_ns=taken.t_start_utc_ns,
        exposure_s=taken.exposure_s,
        pointing_ra_icrs_deg=taken.pointing_ra_icrs_deg,
        pointing_dec_icrs_deg=taken.pointing_dec_icrs_deg,
    )


@contextmanager
def open_rerun(
    reader: SessionReader,
    config: Config,
    *,
    with_detector: bool,
    with_solver: bool,
    on_frame: Callable[[], None] = lambda: None,
) -> Iterator[tuple[RecordedFrameReducer, str]]:
    """Open a reducer of recorded frames, as a context; yield it with the network's SHA-256.

    ``with_detector``, ``with_solver``: which of them run again. Raises ModelError when the network
    cannot be loaded, SolverError without index files.
    """
    rerun = partial(RecordedFrameReducer, reader, on_frame=on_frame)
    if with_solver:
        with open_reducer(config) as (reducer, sha256):
            yield rerun(reducer, None, with_detector=with_detector), sha256
        return
    network = Network.load(config.detector.model, config.detector.threads)
    plate = FixedPlateSource()
    reducer = FrameReducer(network, ConfidenceCurve.from_card(network.card), plate, config)
    yield rerun(reducer, plate, with_detector=True), str(network.card["sha256"])


def _with_plate(
    observed: FrameObservations, solution: Solution | NotSolved | None, config: Config
) -> FrameObservations:
    """Recorded detections, measured with another plate; marks by hand stay as they are."""
    measurements = [m for m in observed.measurements if m.source == "operator"]
    if isinstance(solution, Solution):
        measurements += measure_detections(
            observed.detections, solution, observed.taken, config.exposure
        )
    return replace(observed, solution=solution, measurements=tuple(measurements))


OF_THE_FOLD = (
    "filter.",
    "search.follow",
    "detector.tau",
    "exposure.calibrated",
    "exposure.header_latency_s",
    "exposure.timing_sigma_s",
    "exposure.line_time_us",
    "optics.focal_length_mm",
    "optics.pixel_um",
    "site.",
)
"""Prefixes of the settings that affect the tracks."""
OF_A_PRESET = {"filter.sigma_arcsec": "paper", "filter.q_arcsec2_s3": "tuned"}


@dataclass(frozen=True, slots=True, kw_only=True)
class WhatIf:
    """Session as it was recorded and as it would have been."""

    session: Path
    changes: Mapping[str, float | str]
    before: Mapping[str, Any]
    recorded: TrackFigures
    what_if: TrackFigures
    is_reproduced: bool
    """True where a replay with the recorded settings gives the recorded track, but for rounding."""
    config: Config
    frames: tuple[ReplayedFrame, ...]
    """Frames replayed with the changes; empty where they were not kept."""
    log: tuple[tuple[int, Any], ...]
    """Log of the night as it would have been, (t_utc_ns, record); empty where it was not kept."""
    is_kept: bool
    """True where ``frames`` and ``log`` are kept, which are large for a long night."""
    rerun: RerunCounts | None
    """Numbers of frames reduced again; None where neither detector nor solver was to run again."""
    model_sha256: str | None
    """SHA-256 of the network that reduced frames again; None where ``rerun`` is None."""


def what_if_session(
    folder: Path,
    changes: Mapping[str, float | str] | None = None,
    *,
    detector: bool = False,
    solver: bool = False,
    keep: bool = True,
    on_frame: Callable[[], None] = lambda: None,
) -> WhatIf:
    """Replay a session with changed settings, given by their dotted names.

    - ``detector``, ``solver``: run it again on the frames that the session has kept. Without it
      none of its settings can be changed, but for tau.
    - ``keep``: keep frames and log in the result; without them even a long night takes little
      memory.
    - ``on_frame``: called before each frame that is reduced again.

    Raises SessionError for a folder without a session or a session without frames, ConfigError for
    a setting that does not exist, that cannot have the value, or that does not affect the track.
    """
    reader = SessionReader(folder)
    config = reader.config()
    changes = dict(changes or {})
    check_changes(changes, config, detector=detector, solver=solver)
    both = _Both(config, is_kept=keep)
    counts, sha256 = None, None
    if detector or solver:
        begun_with = with_changes(config, changes)
        with open_rerun(
            reader, begun_with, with_detector=detector, with_solver=solver, on_frame=on_frame
        ) as (rerun, sha256):
            begun_with = both.go_through(reader, changes, rerun)
        counts = rerun.counts
    else:
        begun_with = both.go_through(reader, changes, None)
    if not len(both.recorded):
        raise SessionError(f"{folder} holds no frame that was followed: there is nothing to try on")
    return WhatIf(
        session=Path(folder),
        changes=changes,
        before={name: _value(config, name) for name in changes},
        recorded=both.recorded.figures(),
        what_if=both.changed.figures(),
        is_reproduced=both.is_reproduced,
        config=begun_with,
        frames=tuple(both.frames),
        log=tuple(both.log),
        is_kept=keep,
        rerun=counts,
        model_sha256=sha256,
    )


class _Both:
    """One pass through a log: replayed with the recorded settings, and rewritten with others."""

    def __init__(self, config: Config, *, is_kept: bool) -> None:
        self._config, self._is_kept = config, is_kept
        self.frames: list[ReplayedFrame] = []
        self.log: list[tuple[int, Record]] = []
        self.recorded, self.changed = FigureAccumulator(), FigureAccumulator()
        self.is_reproduced = True

    def go_through(
        self,
        reader: SessionReader,
        changes: Mapping[str, float | str],
        reduce_again: ReduceAgain | None,
    ) -> Config:
        """Read each record once; return the configuration with which the other log begins."""
        walk = ReplayState.begin(self._config)
        rewriter = LogRewriter(
            ReplayState.begin(self._config, changes, reduce_again),
            on_record=self._keep_record,
            on_frame=self._add_changed,
        )
        for _, t_utc_ns, record in reader.records():
            self._add_recorded(walk.receive(record))
            rewriter.receive(t_utc_ns, record)
        self._add_recorded(walk.close())
        rewriter.close()
        return rewriter.config

    def _add_recorded(self, closed: Iterable[ReducedFrame]) -> None:
        for each in closed:
            if isinstance(each, ReplayedFrame):
                self.is_reproduced = self.is_reproduced and each.is_alike
                add_replayed(self.recorded, each)

    def _add_changed(self, frame: ReplayedFrame) -> None:
        add_replayed(self.changed, frame)
        if self._is_kept:
            self.frames.append(frame)

    def _keep_record(self, t_utc_ns: int, record: Record) -> None:
        if self._is_kept:
            self.log.append((t_utc_ns, record))


def rewritten_log(what_if: WhatIf) -> Iterator[tuple[int, Record]]:
    """Yield (t_utc_ns, record) of the log of a what-if, as kept in it or replayed again.

    Raises ValueError where the log was not kept and frames would have to be reduced again.
    """
    if what_if.is_kept:
        yield from what_if.log
        return
    if what_if.rerun is not None:
        raise ValueError("frames were reduced again for it: its log must be kept")
    reader, rewritten = SessionReader(what_if.session), list[tuple[int, Record]]()
    rewriter = LogRewriter(
        ReplayState.begin(reader.config(), what_if.changes),
        on_record=lambda t_utc_ns, record: rewritten.append((t_utc_ns, record)),
        on_frame=lambda _: None,
    )
    for _, t_utc_ns, record in reader.records():
        rewriter.receive(t_utc_ns, record)
        yield from rewritten
        rewritten.clear()
    rewriter.close()
    yield from rewritten


def check_changes(
    changes: Mapping[str, float | str], config: Config, *, detector: bool, solver: bool
) -> None:
    """Raise ConfigError for changes that cannot be replayed, with the reason."""
    reduced = (("detector.", detector, "--detector"), ("solver.", solver, "--solver"))
    for name, value in changes.items():
        with_setting(config, name, value)
        if name.startswith(OF_THE_FOLD):
            continue
        for prefix, is_rerun, option in reduced:
            if name.startswith(prefix) and not is_rerun:
                raise ConfigError(f"{name} changes what frames show: {option} runs them again")
            if name.startswith(prefix):
                break
        else:
            raise ConfigError(f"{name} has no part in what is followed: there is nothing to try")
    preset = changes.get("filter.preset", config.filter.preset)
    for name, belongs_to in OF_A_PRESET.items():
        if name in changes and preset != belongs_to:
            raise ConfigError(
                f"{name} belongs to preset {belongs_to}: --preset {belongs_to} has it"
            )


def _value(config: Config, name: str) -> Any:
    section, _, key = name.partition(".")
    return config.model_dump(mode="json")[section][key]
