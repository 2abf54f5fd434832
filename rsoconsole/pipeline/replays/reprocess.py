"""New reduction of a recorded frame with another tau or map, beside the recorded result.

It needs the frame's pixels in the session; without them a replay can still apply another tau to the
recorded candidates. Nothing is written.
"""

import logging
import time
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

from rsoconsole.base import FrameError, RsoconsoleError, SessionError
from rsoconsole.config import Config, with_setting
from rsoconsole.instruments import PlateSolver, read_frame
from rsoconsole.night import NightFrame, NightFrames
from rsoconsole.pipeline.comparison.fixed_light import RecordedComparison
from rsoconsole.pipeline.frame.calibration import Calibration
from rsoconsole.pipeline.frame.frame_cautions import calibration_warnings
from rsoconsole.pipeline.frame.plate import FixedPlateSource, PlateFinder
from rsoconsole.pipeline.frame.reduce import FrameReducer, Reduction
from rsoconsole.pipeline.replays.what_if_log import with_recorded_time_and_pointing
from rsoconsole.records import (
    Detection,
    Detections,
    Frame,
    FrameTaken,
    MapMode,
    Measurement,
    NotSolved,
    ParameterChange,
    Solution,
)
from rsoconsole.session import SessionReader
from rsoconsole.vision import (
    ConfidenceCurve,
    FrameMap,
    Network,
    choose_blocks,
    is_same_streak,
    make_map,
)
from rsoconsole.words import text

log = logging.getLogger(__name__)

TAU, MAP_MODE = "detector.tau", "detector.map_mode"
ROUNDED_NS = 100_000_000
"""Largest difference between the start in a file's header and the recorded start, ns."""
UNWRITTEN = "its pixels are not in the session: not written yet, or removed since"
SAME_PX, SAME_CONFIDENCE = 0.05, 0.01
"""Differences, in px and confidence, within which a candidate is as recorded."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedFrame:
    """Records of one frame in a session, with the file of its pixels."""

    taken: FrameTaken
    seen: NightFrame
    config: Config
    path: Path | None
    """File with the frame's pixels; None where they were not kept."""
    not_kept_because: str
    """Reason why its pixels were not kept; empty where they were."""
    model_sha256: str | None
    """SHA-256 of the network that examined the frame; None where the session does not name it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JudgedCandidate:
    """Candidate streak with the detector's decision on it."""

    detection: Detection
    is_taken: bool
    reason: str
    """Reason why it was rejected; empty where it was accepted."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ComparedCandidate:
    """Candidate streak as recorded and as found now; None where it was not found."""

    was: JudgedCandidate | None
    now: JudgedCandidate | None

    @property
    def latest_detection(self) -> Detection:
        """The detection as found now, else as recorded."""
        judged = self.now or self.was
        assert judged is not None
        return judged.detection

    @property
    def is_as_recorded(self) -> bool:
        """True where it was found both times, at one place and with the same decision."""
        was, now = self.was, self.now
        if was is None or now is None or was.is_taken is not now.is_taken:
            return False
        less_sure = abs(was.detection.confidence - now.detection.confidence)
        return _away_px(was, now) < SAME_PX and less_sure < SAME_CONFIDENCE


@dataclass(frozen=True, slots=True, kw_only=True)
class ReprocessedFrame:
    """Result of reducing a frame with other settings, beside the recorded one."""

    tau: float
    map_mode: MapMode
    is_solved_again: bool
    """True where the plate was solved now, False where the recorded solution was used."""
    is_same_network: bool | None
    """True where the network is the recorded one; None where the session does not name it."""
    was: NightFrame
    now: Reduction
    candidates: tuple[ComparedCandidate, ...]
    stage_ms: dict[str, float] = field(default_factory=dict)
    """Times of the detector's stages, of ``solve``, and of all as ``total``, ms."""


def read_frame_records(
    reader: SessionReader, frame_id: int, config: Config | None = None
) -> RecordedFrame:
    """Read the records of a frame.

    ``config``: configuration at the session's beginning; None: as recorded. Recorded changes before
    the frame are applied to it. Raises SessionError where the session has no such frame, and where
    its recorded configuration is needed and cannot be read by this version.
    """
    kinds = (FrameTaken, Detections, Solution, NotSolved, Measurement)
    log = list(reader.records(kinds=kinds, frame_id=frame_id))
    frame = NightFrames().fold_all(record for _, _, record in log).frame_by_id(frame_id)
    if frame.taken is None:
        raise SessionError(f"{reader.folder} holds no frame {frame_id}")
    seq_of_frame = max(seq for seq, _, record in log if isinstance(record, FrameTaken | Detections))
    path = reader.frame_path(frame_id)
    sha256 = reader.read_meta().get("model_sha256")
    return RecordedFrame(
        taken=frame.taken,
        seen=frame,
        config=_in_force(reader, config or reader.config(), seq_of_frame),
        path=path,
        not_kept_because="" if path else reader.missing_pixels_reason(frame_id) or UNWRITTEN,
        model_sha256=sha256 if isinstance(sha256, str) else None,
    )


def _in_force(reader: SessionReader, config: Config, seq_of_frame: int) -> Config:
    for seq, _, record in reader.records(kinds=(ParameterChange,)):
        if seq > seq_of_frame:
            break
        if isinstance(record, ParameterChange):
            config = with_setting(config, record.name, record.after)
    return config


def read_recorded_frame(recorded: RecordedFrame) -> Frame:
    """Read the frame as the camera gave it.

    Raises FrameError where it was not kept (with the reason), where its file is damaged, and where
    the file holds another exposure than the recorded one.
    """
    taken = recorded.taken
    if recorded.path is None:
        raise FrameError(f"frame {taken.frame_id} was not kept: {recorded.not_kept_because}")
    frame = read_frame(recorded.path, taken.frame_id)
    if (frame.width_px, frame.height_px) != (taken.width_px, taken.height_px):
        raise FrameError(
            f"{recorded.path.name} is {frame.width_px} x {frame.height_px} px, but frame"
            f" {taken.frame_id} was {taken.width_px} x {taken.height_px}: it is another's file"
        )
    then_ns, read_ns = taken.t_start_utc_ns, frame.t_start_utc_ns
    if then_ns is not None and read_ns is not None and abs(read_ns - then_ns) > ROUNDED_NS:
        raise FrameError(
            f"{recorded.path.name} began at another instant than frame {taken.frame_id}:"
            " it is another's file"
        )
    return replace(with_recorded_time_and_pointing(frame, taken), camera=taken.camera)


class Reprocessor:
    """Reduces a frame; loads network and plate solver when first needed. For one thread."""

    def __init__(self, recorded: RecordedFrame, frame: Frame) -> None:
        self._recorded = recorded
        self._frame = frame
        self._solver: PlateSolver | None = None

    @cached_property
    def _network(self) -> Network:
        settings = self._recorded.config.detector
        return Network.load(settings.model, settings.threads)

    @cached_property
    def _calibration(self) -> Calibration:
        return Calibration(self._recorded.config)

    def close(self) -> None:
        """End the solver's process."""
        if self._solver is not None:
            self._solver.close()
            self._solver = None

    def run(
        self,
        tau: float | None = None,
        map_mode: MapMode | None = None,
        *,
        solves_again: bool = False,
    ) -> ReprocessedFrame:
        """Reduce the frame with other settings; for None the recorded setting stays.

        ``solves_again``: solve the plate from the frame's stars; False: use the recorded solution.
        Raises ConfigError for a value that is not allowed, ModelError without a network.
        """
        config, recorded = self._recorded.config, self._recorded
        changes = {TAU: tau, MAP_MODE: map_mode}
        for name, value in changes.items():
            if value is not None:
                config = with_setting(config, name, value)
        network = self._network
        curve = ConfidenceCurve.from_card(network.card)
        plate = self._plate(config) if solves_again else _given(recorded.seen.solution)
        began_s = time.perf_counter()
        comparison = RecordedComparison(recorded.seen.detections)
        reducer = FrameReducer(
            network, curve, plate, config, calibration=self._calibration, comparison=comparison
        )
        reduction = reducer.reduce(self._frame)
        for words in calibration_warnings(reduction.cautions):
            log.warning("%s", words)
        stage_ms = dict(reduction.detections.stage_ms)
        if solves_again:
            stage_ms["solve"] = reduction.stage_ms.get("solve", 0.0)
        stage_ms["total"] = (time.perf_counter() - began_s) * 1e3
        sha256 = recorded.model_sha256
        return ReprocessedFrame(
            tau=config.detector.tau,
            map_mode=config.detector.map_mode,
            is_solved_again=solves_again,
            is_same_network=None if sha256 is None else sha256 == network.card["sha256"],
            was=recorded.seen,
            now=reduction,
            candidates=pair_candidates(recorded.seen.detections, reduction.detections),
            stage_ms=stage_ms,
        )

    def network_maps(self, map_mode: MapMode) -> tuple[FrameMap, ...]:
        """Return the maps of the frame for the network: several where its scale is unknown."""
        frame, _ = self._calibration.prepare(self._frame)
        blocks = choose_blocks(
            frame.width_px, frame.height_px, frame.scale_arcsec_px, frame.exposure_s
        )
        return tuple(make_map(frame.pixels, map_mode, block) for block in blocks)

    def _plate(self, config: Config) -> FixedPlateSource:
        try:
            if self._solver is None:
                self._solver = PlateSolver(config.solver.index_dirs, start_s=config.waits.process_s)
        except RsoconsoleError as error:
            log.warning("%s", error)
            return _given(NotSolved(frame_id=self._frame.frame_id, reason=str(error), ms=0.0))
        return PlateFinder(self._solver, config)


def _given(solution: Solution | NotSolved | None) -> FixedPlateSource:
    plate = FixedPlateSource()
    plate.solution = solution
    return plate


def pair_candidates(
    was: Detections | None, now: Detections | None
) -> tuple[ComparedCandidate, ...]:
    """Pair the recorded and the new candidates that are one streak; the most confident first."""
    left = list(judged_candidates(was))
    pairs: list[ComparedCandidate] = []
    for judged in judged_candidates(now):
        same = [other for other in left if is_same_streak(judged.detection, other.detection)]
        nearest = min(same, key=lambda other: _away_px(judged, other), default=None)
        if nearest is not None:
            left.remove(nearest)
        pairs.append(ComparedCandidate(was=nearest, now=judged))
    pairs += [ComparedCandidate(was=judged, now=None) for judged in left]
    return tuple(sorted(pairs, key=lambda pair: -_highest(pair)))


def judged_candidates(found: Detections | None) -> Iterable[JudgedCandidate]:
    """Yield all candidates of a frame, accepted and rejected, with the detector's decisions."""
    if found is None:
        return
    for each in found.detections:
        yield JudgedCandidate(detection=each, is_taken=True, reason="")
    for one in found.rejected:
        yield JudgedCandidate(detection=one.detection, is_taken=False, reason=text(one.reason))


def _away_px(one: JudgedCandidate, other: JudgedCandidate) -> float:
    a, b = one.detection, other.detection
    return max(abs(a.x_px - b.x_px), abs(a.y_px - b.y_px))


def _highest(pair: ComparedCandidate) -> float:
    return max(each.detection.confidence for each in (pair.was, pair.now) if each is not None)
