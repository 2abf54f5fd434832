"""Replay of a session's tracking from its records alone. Pure.

What-if, review and tests use this module. With the session's own configuration it gives every
tracking record again, bit for bit. The inputs are, in the order of the log:
- the reduced frames (``FrameTaken``, ``Detections``, plate solution, measurements),
- changes of settings,
- changes of state that do not come from frames, such as the operator's.

A frame without ``Detections`` was never reduced (its reduction failed or was stopped) and does not
count as a miss. A frame taken while the operator had control was reduced but not tracked.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal, TypeAlias, assert_never

from rsoconsole.config import Config, ExposureConfig, with_changes, with_setting
from rsoconsole.night import FOLDED, is_external_change, is_instrument_miss
from rsoconsole.pipeline.cycle.decisions import FollowedFrames, UntrackedFrames
from rsoconsole.pipeline.cycle.frame_fold import (
    FoldedFrame,
    FrameObservations,
    ReducedFrame,
    fold_frame,
    star_history_without_fold,
)
from rsoconsole.pipeline.cycle.miss_reasons import StarHistory
from rsoconsole.pipeline.cycle.track_assignment import resumable_state_after
from rsoconsole.pipeline.frame.marked_frames import BEGIN_MARK
from rsoconsole.pipeline.frame.measurement import (
    frame_timing,
    measure,
    mid_exposure_utc_ns,
    with_row_time,
)
from rsoconsole.pipeline.replays.record_equality import are_nearly_equal
from rsoconsole.records import (
    FOLLOWING,
    BelowTau,
    BesideRecord,
    CycleTiming,
    Detections,
    Event,
    FoldInput,
    FoldRecord,
    FollowedAgain,
    FrameTaken,
    Measurement,
    Miss,
    NotSolved,
    OperatorAction,
    OrbitEstimate,
    OrbitRecord,
    ParameterChange,
    Record,
    Rejection,
    Ruling,
    Solution,
    StateChange,
    measurement_id_of,
)
from rsoconsole.tracking import Following


def with_mid_exposure(
    observed: FrameObservations, t_mid_utc_ns: int, exposure: ExposureConfig
) -> FrameObservations:
    """Return a frame's observations with their measurements at another mid-exposure.

    ``t_mid_utc_ns``: mid-exposure of the first row, which depends on the header latency.
    """
    shutter = frame_timing(observed.taken, exposure)
    moved = tuple(with_row_time(m, t_mid_utc_ns, shutter) for m in observed.measurements)
    return observed if moved == observed.measurements else replace(observed, measurements=moved)


def with_tau(observed: FrameObservations, config: Config) -> FrameObservations:
    """Return a frame's observations as they would be with the tau of ``config``.

    Recorded candidates that passed all other gates become detections, or detections become
    rejected. Detections and measurements are in order of confidence. Without a plate solution
    nothing is measured, as in the reduction.
    """
    tau = config.detector.tau
    found = observed.detections
    numbered = {
        number: r.detection
        for number, r in enumerate(found.rejected, start=len(found.detections))
        if isinstance(r.reason, BelowTau) and r.detection.confidence > tau
    }
    admitted = list(numbered.values())
    kept = [d for d in found.detections if d.confidence > tau]
    too_faint = [
        Rejection(detection=d, reason=BelowTau(confidence=d.confidence, tau=tau))
        for d in found.detections
        if d.confidence <= tau
    ]
    measurements = [
        m for m in observed.measurements if m.source == "operator" or m.confidence > tau
    ]
    if isinstance(observed.solution, Solution):
        made = (
            measure(
                detection,
                observed.solution,
                observed.taken,
                config.exposure,
                measurement_id=measurement_id_of(found.frame_id, number),
            )
            for number, detection in numbered.items()
        )
        measurements += [m for m in made if m is not None]
    # Sorting is stable: what was measured keeps its order.
    detections = sorted((*kept, *admitted), key=lambda d: -d.confidence)
    rejected = [r for r in found.rejected if r.detection not in admitted]
    rejected = sorted((*rejected, *too_faint), key=lambda r: -r.detection.confidence)
    return replace(
        observed,
        detections=replace(found, detections=tuple(detections), rejected=tuple(rejected)),
        measurements=tuple(sorted(measurements, key=lambda m: -m.confidence)),
    )


TAU = "detector.tau"


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayedFrame(ReducedFrame):
    """Frame with its tracking records, as replayed and as recorded.

    Its observations are the recorded ones unless tau or header latency is changed, or it is reduced
    again.
    """

    after: Following
    records: tuple[Record, ...]
    """Records of the fold now: TrackState, NotFollowed, Miss, StateChange, in order."""
    recorded: tuple[Record, ...]

    @property
    def taken(self) -> FrameTaken:
        """Record of the frame as the camera gave it."""
        return self.observations.taken

    @property
    def is_as_recorded(self) -> bool:
        """True where the replayed tracking records equal the recorded ones, bit for bit.

        False for the last frame of a session that was cut off before all its records were
        written.
        """
        return self.records == self.recorded

    @property
    def is_alike(self) -> bool:
        """True where the fold's records are the recorded ones, but for a processor's rounding."""
        return are_nearly_equal(self.records, self.recorded)


ReduceAgain: TypeAlias = Callable[[FrameObservations, Config], FrameObservations]
"""Function that reduces a frame again, from its record and the configuration in force."""
RecordRole: TypeAlias = Literal["input", "folded", "other"]
"""Role of a record for the fold: input, output (``folded``), or neither."""


def replay(
    records: Iterable[Record], config: Config, *, changes: Mapping[str, float | str] | None = None
) -> Iterator[ReplayedFrame]:
    """Yield every tracked frame of a session in order, each once its records are complete.

    - ``records``: all records of the session's log, in order.
    - ``config``: at the session's beginning; recorded changes are applied as they come.
    - ``changes``: settings by dotted name, valid from the start in place of recorded values.

    Another tau admits or rejects candidates by their recorded confidence; another header latency
    shifts all times. Everything else in the measurements, and the telescope's pointing, stays as
    recorded. Raises ConfigError for an unknown setting or a value that is not allowed.
    """
    walk = ReplayState.begin(config, changes)
    for record in records:
        yield from _folded(walk.receive(record))
    yield from _folded(walk.close())


def _folded(closed: Iterable[ReducedFrame]) -> Iterator[ReplayedFrame]:
    return (each for each in closed if isinstance(each, ReplayedFrame))


@dataclass(slots=True, kw_only=True)
class ReplayState:
    """State of a replay after the records so far."""

    config: Config
    held: frozenset[str]
    reduce_again: ReduceAgain | None = None
    following: Following = field(default_factory=Following)
    kept: Following | None = None
    """Track last ended by a command, which may be followed again; None without one."""
    stars: StarHistory = field(default_factory=StarHistory)
    taken: FrameTaken | None = None
    orbits: Mapping[int, OrbitEstimate] = field(default_factory=dict)
    """Last orbit of each track, by track id; replaced as a whole, because frames hold it."""
    is_another_night: bool = False
    """True once a frame differs from its record: orbits recorded later are not of this track."""
    open: FrameObservations | None = None
    """Frame that was reduced and whose records still come in; None between frames."""
    recorded: list[Record] = field(default_factory=list)
    folds: FollowedFrames = field(default_factory=FollowedFrames)
    hand: UntrackedFrames = field(default_factory=UntrackedFrames)
    is_by_hand: bool = False
    """True where the operator's last decision was on a frame that belongs to no track."""
    again: dict[int, FoldedFrame] = field(default_factory=dict)
    """Frames that the operator's last decision has had folded again, by number."""
    open_again: tuple[FoldedFrame, list[Record]] | None = None
    """Frame folded again whose records still come in, with the recorded ones so far."""
    is_ruled: bool = False
    """True between a decision and the records of the first frame folded again by it."""
    part: RecordRole = "other"
    """Role that the last record had for the fold."""

    @classmethod
    def begin(
        cls,
        config: Config,
        changes: Mapping[str, float | str] | None = None,
        reduce_again: ReduceAgain | None = None,
    ) -> "ReplayState":
        """Return the state at the beginning of a log. Raises ConfigError as ``replay`` does."""
        changes = changes or {}
        return cls(
            config=with_changes(config, changes), held=frozenset(changes), reduce_again=reduce_again
        )

    def receive(self, record: Record) -> Iterator[ReducedFrame]:  # noqa: PLR0912 -- one case a kind
        """Process the next record; yield the frame that it completes."""
        self.part = "other"
        match record:
            case FrameTaken():
                yield from self.close()
                self.taken = record
            case Detections():
                if self.taken is not None:
                    self.part = "input"
                    self.recorded = []
                    self.open = FrameObservations(
                        taken=self.taken,
                        detections=record,
                        solution=None,
                        measurements=(),
                        orbits=self.orbits,
                    )
            case CycleTiming():
                yield from self.close()
            case Ruling() | FollowedAgain():
                yield from self.close()
                self.is_ruled = isinstance(record, Ruling)
                self._receive_decision(record)
            case ParameterChange():
                yield from self.close()
                if record.name not in self.held:
                    self.config = with_setting(self.config, record.name, record.after)
            case StateChange() if is_external_change(record):
                yield from self.close()
                self._pass(record)
            case OrbitEstimate():
                if not self.is_another_night:
                    self.orbits = {**self.orbits, record.track_id: record}
            case _ if isinstance(record, (FoldInput, FoldRecord)):
                self.part = self._receive_of_frame(record)
            case Event() if record.topic == "kept":
                yield from self.close()
                self.kept = None
            case OperatorAction() if record.verb == BEGIN_MARK:
                self._hold(record)
            case _ if isinstance(record, (OrbitRecord, BesideRecord)):
                pass  # led to by what is followed, or beside it
            case _:
                assert_never(record)

    def _hold(self, begun: OperatorAction) -> None:
        """Hold or release a frame for a mark, of which no decision need be on record."""
        frame_id = begun.arguments.get("frame")
        if begun.outcome.kind != "done" or not isinstance(frame_id, int):
            return
        frames = self.folds if self.following.state in FOLDED else self.hand
        if begun.arguments.get("on", True):
            frames.hold_frame(frame_id)
        else:
            frames.release_frame(frame_id)

    def _receive_of_frame(
        self, record: FoldRecord | Solution | NotSolved | Measurement
    ) -> RecordRole:
        """Add a record of a frame, input or output of the fold; return its role."""
        # The fold records those candidates below tau that a track takes.
        is_faint = isinstance(record, Measurement) and record.source == "faint"
        is_folds = is_faint or (isinstance(record, FoldRecord) and not self._is_loops_own(record))
        if self.open_again is not None:
            if is_folds:
                self.open_again[1].append(record)
            return "folded" if is_folds else "other"
        if self.open is None:
            return "other"
        if is_folds:
            self.recorded.append(record)
            return "folded"
        match record:
            case Solution() | NotSolved():
                self.open = replace(self.open, solution=record)
            case Measurement():
                measurements = (*self.open.measurements, record)
                self.open = replace(self.open, measurements=measurements)
            case _ if isinstance(record, FoldRecord):
                return "other"
            case _:
                assert_never(record)
        return "input"

    def _is_loops_own(self, record: Record) -> bool:
        """True for a failed instrument's miss, or a decision's change of state: not the fold's."""
        if isinstance(record, Miss):
            return is_instrument_miss(record)
        return isinstance(record, StateChange) and self.is_ruled

    def close(self) -> Iterator[ReducedFrame]:
        """Fold the open frame, if there is one."""
        if self.open_again is not None:
            again, self.open_again = self.open_again, None
            yield self._compared(*again)
        if self.open is None:
            return
        observed, config = self.open, self.config
        self.open = self.taken = None
        if TAU in self.held:
            observed = with_tau(observed, config)
        if self.reduce_again is not None:
            observed = self.reduce_again(observed, config)
        t_mid_ns = mid_exposure_utc_ns(observed.taken, config.exposure)
        if t_mid_ns is not None:
            observed = with_mid_exposure(observed, t_mid_ns, config.exposure)
        if self.following.state not in FOLDED or t_mid_ns is None:
            self.stars = star_history_without_fold(self.stars, observed)
            self.hand.add(observed, config)
            yield ReducedFrame(observations=observed, config=config)
            return
        folded = fold_frame(self.following, self.stars, observed, config)
        self.folds.add(folded)
        self.following, self.stars = folded.following, folded.stars
        if self.following.state in FOLLOWING:
            self.kept = None
        if folded.following.track is None:
            self.hand.add(observed, config)
        yield self._compared(folded, self.recorded)

    def _compared(self, folded: FoldedFrame, recorded: list[Record]) -> ReplayedFrame:
        frame = ReplayedFrame(
            observations=folded.observations,
            config=folded.config,
            after=folded.following,
            records=folded.records,
            recorded=tuple(recorded),
        )
        if not frame.is_alike:
            # Those of the frames before are of what is followed here, too.
            orbits = self.orbits if self.is_another_night else frame.observations.orbits
            self.is_another_night, self.orbits = True, orbits
        return frame

    def _receive_decision(self, record: Ruling | FollowedAgain) -> None:
        """Apply the operator's decision to the state."""
        if isinstance(record, FollowedAgain):
            done = self.again.pop(record.frame_id, None)
            self.open_again = None if done is None else (done, [])
            return
        self.is_by_hand = self.following.state not in FOLDED
        try:
            if self.is_by_hand:
                self._rule_by_hand(record)
                return
            again = self.folds.apply(record)
        except ValueError:  # under what is tried the frame was not followed
            return
        self.again = {each.frame_id: each for each in again}
        self.following = again[-1].following

    def _rule_by_hand(self, record: Ruling) -> None:
        self.again = {}
        self.kept, _ = self.hand.apply(record, self.kept, self.following.last_track_id)
        if self.kept is not None:
            last_track_id = max(self.kept.last_track_id, self.following.last_track_id)
            self.following = replace(self.following, last_track_id=last_track_id)

    def _pass(self, change: StateChange) -> None:
        """Apply a change of state by the operator, a limit, a fault or the end of the night."""
        self.folds.forget()
        self.hand.forget()
        if change.reason.kind == "clock set":
            self.orbits = {}
            self.following = replace(self.following, dropped=())
        before, kept = self.following, self.kept
        self.kept = resumable_state_after(change, before, kept)
        if change.after != "COAST":
            self.following = before.without_track(change.after)
        elif kept is not None:
            last_track_id = max(kept.last_track_id, before.last_track_id)
            self.following = replace(
                kept, state="COAST", candidates=(), last_track_id=last_track_id
            )
        else:
            self.following = before.without_track("SEARCH")
