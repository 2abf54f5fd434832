"""The track once more, from what is on record alone: the same fold over the same inputs. Pure.

What-if, review and tests run this. With the session's own configuration it gives every record of
the fold again, bit for bit. Inputs are, in the order of the log: the frames that were reduced
(``FrameTaken``, ``Detections``, the plate, the measurements), changes of parameters, and the
changes of state that came from outside the fold. A frame without ``Detections`` was never reduced
(its reduction failed, or somebody cut it short) and is no miss; one that was taken while the
operator had the mount was looked at, not folded.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal, TypeAlias, assert_never

from rsoconsole.config import Config, ExposureConfig, with_changes, with_setting
from rsoconsole.night import FOLDED, is_from_outside, is_instruments
from rsoconsole.pipeline.cycle.decisions import Fold, Folds, HandTrack
from rsoconsole.pipeline.cycle.frame_fold import Shown, are_alike, fold, star_history_without_fold
from rsoconsole.pipeline.cycle.miss_reasons import StarHistory
from rsoconsole.pipeline.cycle.track_assignment import KeptOnRecord
from rsoconsole.pipeline.frame.held_frames import BEGIN_MARK
from rsoconsole.pipeline.frame.measurement import (
    at_its_row,
    measure,
    shutter_mid_utc_ns,
    shutter_time,
)
from rsoconsole.records import (
    BelowTau,
    BesideRecord,
    CycleTiming,
    Detections,
    Event,
    FoldInput,
    FoldRecord,
    FollowedAgain,
    FrameTaken,
    LoopState,
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


def at_instant(shown: Shown, t_mid_utc_ns: int, exposure: ExposureConfig) -> Shown:
    """The same measurements at the frame's mid-exposure: another where its latency is tried."""
    shutter = shutter_time(shown.taken, exposure)
    moved = tuple(at_its_row(m, t_mid_utc_ns, shutter) for m in shown.measurements)
    return shown if moved == shown.measurements else replace(shown, measurements=moved)


def at_tau(shown: Shown, config: Config) -> Shown:
    """What the frame would have shown at the configured tau, most confident first.

    The detector keeps what passed its gates and lay below tau, so nothing is guessed; without a
    plate solution a candidate is detected and not measured, as ever.
    """
    tau = config.detector.tau
    found = shown.detections
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
    measurements = [m for m in shown.measurements if m.source == "operator" or m.confidence > tau]
    if isinstance(shown.solution, Solution):
        made = (
            measure(
                detection,
                shown.solution,
                shown.taken,
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
        shown,
        detections=replace(found, detections=tuple(detections), rejected=tuple(rejected)),
        measurements=tuple(sorted(measurements, key=lambda m: -m.confidence)),
    )


TAU = "detector.tau"


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayedFrame:
    """One folded frame."""

    taken: FrameTaken
    shown: Shown
    """What was folded; other than recorded only where another tau or header latency is tried."""
    config: Config
    """In force for this frame."""
    after: Following
    """What is followed after it."""
    records: tuple[Record, ...]
    """What the fold makes of it now: TrackState, NotFollowed, Miss, StateChange, in order."""
    recorded: tuple[Record, ...]
    """What it made of it then."""

    @property
    def state(self) -> LoopState:
        """After it."""
        return self.after.state

    @property
    def solution(self) -> Solution | NotSolved | None:
        """Of its stars."""
        return self.shown.solution

    @property
    def is_as_recorded(self) -> bool:
        """Whether both are the same, bit for bit; a session that was cut off may lack its end."""
        return self.records == self.recorded

    @property
    def is_alike(self) -> bool:
        """Whether both are the same but for the rounding of another processor."""
        return are_alike(self.records, self.recorded)


@dataclass(frozen=True, slots=True, kw_only=True)
class LookedAt:
    """A frame that was reduced and not folded: the operator had the mount, or it has no time."""

    shown: Shown


ReduceAgain: TypeAlias = Callable[[Shown, Config], Shown]
"""What a frame shows when it is reduced once more: its record and the configuration in force."""
Part: TypeAlias = Literal["input", "folded", "other"]
"""What a record is to the fold: what goes in, what comes out, neither."""


def replay(
    records: Iterable[Record],
    config: Config,
    *,
    changes: Mapping[str, float | str] | None = None,
) -> Iterator[ReplayedFrame]:
    """Every frame that the session folded, in order, each as soon as its records are complete.

    ``records``: a session's log in its order, of all kinds. ``config``: that of the session's
    beginning; recorded changes are made as they come. ``changes``: settings by dotted name that
    hold from the start, whatever the record says of them (what-if); a tried tau admits or leaves
    out candidates by their recorded confidence, a tried header latency moves all instants;
    everything else that made the measurements is taken as it was. Where the telescope looked is
    never another than recorded.

    Raises ConfigError for a setting that there is not, or a value that it cannot have.
    """
    walk = Walk.begin(config, changes)
    for record in records:
        yield from _folded(walk.receive(record))
    yield from _folded(walk.close())


def _folded(closed: Iterable[ReplayedFrame | LookedAt]) -> Iterator[ReplayedFrame]:
    return (each for each in closed if isinstance(each, ReplayedFrame))


@dataclass(slots=True, kw_only=True)
class _Open:
    """A reduced frame whose records still come in."""

    taken: FrameTaken
    detections: Detections
    solution: Solution | NotSolved | None = None
    measurements: list[Measurement] = field(default_factory=list)
    recorded: list[Record] = field(default_factory=list)
    orbits: Mapping[int, OrbitEstimate] = field(default_factory=dict)

    def shown(self) -> Shown:
        return Shown(
            taken=self.taken,
            detections=self.detections,
            solution=self.solution,
            measurements=tuple(self.measurements),
            orbits=self.orbits,
        )


@dataclass(slots=True, kw_only=True)
class Walk:
    """Where a replay stands in the log."""

    config: Config
    held: frozenset[str]
    reduce_again: ReduceAgain | None = None
    following: Following = field(default_factory=Following)
    kept: KeptOnRecord = field(default_factory=KeptOnRecord)
    """The track that ended last by somebody's word: it may be followed again."""
    stars: StarHistory = field(default_factory=StarHistory)
    taken: FrameTaken | None = None
    orbits: Mapping[int, OrbitEstimate] = field(default_factory=dict)
    """The last one of each track, by track id; never changed, frames keep theirs."""
    is_another_night: bool = False
    """A frame came out otherwise than recorded: the orbits behind it are of another track."""
    open: _Open | None = None
    folds: Folds = field(default_factory=Folds)
    hand: HandTrack = field(default_factory=HandTrack)
    is_by_hand: bool = False
    """The last decision was on a frame that nobody followed."""
    again: dict[int, Fold] = field(default_factory=dict)
    """Frames that a decision has had followed again, by number."""
    open_again: tuple[Fold, list[Record]] | None = None
    """One of them whose records still come in."""
    is_ruled: bool = False
    """A decision has come, and none of the frames that it has followed again."""
    part: Part = "other"
    """What the record heard last is to the fold."""

    @classmethod
    def begin(
        cls,
        config: Config,
        changes: Mapping[str, float | str] | None = None,
        reduce_again: ReduceAgain | None = None,
    ) -> "Walk":
        """At the beginning of a log. Raises ConfigError as ``replay`` does."""
        changes = changes or {}
        return cls(
            config=with_changes(config, changes),
            held=frozenset(changes),
            reduce_again=reduce_again,
        )

    def receive(self, record: Record) -> Iterator[ReplayedFrame | LookedAt]:  # noqa: PLR0912 -- one case a kind
        """One record; gives the frame that it shows to be complete."""
        self.part = "other"
        match record:
            case FrameTaken():
                yield from self.close()
                self.taken = record
            case Detections():
                if self.taken is not None:
                    self.part = "input"
                    self.open = _Open(taken=self.taken, detections=record, orbits=self.orbits)
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
            case StateChange() if is_from_outside(record):
                yield from self.close()
                self._pass(record)
            case OrbitEstimate():
                if not self.is_another_night:
                    self.orbits = {**self.orbits, record.track_id: record}
            case _ if isinstance(record, (FoldInput, FoldRecord)):
                self.part = self._receive_of_frame(record)
            case Event() if record.topic == "kept":
                yield from self.close()
                self.kept.given_up()
            case OperatorAction() if record.verb == BEGIN_MARK:
                self._hold(record)
            case _ if isinstance(record, (OrbitRecord, BesideRecord)):
                pass  # led to by what is followed, or beside it
            case _:
                assert_never(record)

    def _hold(self, begun: OperatorAction) -> None:
        """A frame is kept to be marked in, or no longer, where nobody can know it by a decision."""
        frame_id = begun.arguments.get("frame")
        if begun.outcome.kind != "done" or not isinstance(frame_id, int):
            return
        frames = self.folds if self.following.state in FOLDED else self.hand
        if begun.arguments.get("on", True):
            frames.hold(frame_id)
        else:
            frames.let_go(frame_id)

    def _receive_of_frame(self, record: FoldRecord | Solution | NotSolved | Measurement) -> Part:
        """What was seen in a frame, or what the fold made of it."""
        is_folds = isinstance(record, FoldRecord) and not self._is_loops_own(record)
        if self.open_again is not None:
            if is_folds:
                self.open_again[1].append(record)
            return "folded" if is_folds else "other"
        if self.open is None:
            return "other"
        if is_folds:
            self.open.recorded.append(record)
            return "folded"
        match record:
            case Solution() | NotSolved():
                self.open.solution = record
            case Measurement():
                self.open.measurements.append(record)
            case _ if isinstance(record, FoldRecord):
                return "other"
            case _:
                assert_never(record)
        return "input"

    def _is_loops_own(self, record: Record) -> bool:
        """An instrument that failed, or what a decision came to in words: nothing of the fold's."""
        if isinstance(record, Miss):
            return is_instruments(record)
        return isinstance(record, StateChange) and self.is_ruled

    def close(self) -> Iterator[ReplayedFrame | LookedAt]:
        """Fold the open frame, if there is one."""
        if self.open_again is not None:
            fold_, recorded_again = self.open_again
            self.open_again = None
            yield self._compared(_replayed(fold_, tuple(recorded_again)))
        if self.open is None:
            return
        shown, recorded = self.open.shown(), tuple(self.open.recorded)
        self.open = self.taken = None
        if TAU in self.held:
            shown = at_tau(shown, self.config)
        if self.reduce_again is not None:
            shown = self.reduce_again(shown, self.config)
        t_mid_ns = shutter_mid_utc_ns(shown.taken, self.config.exposure)
        if t_mid_ns is not None:
            shown = at_instant(shown, t_mid_ns, self.config.exposure)
        if self.following.state not in FOLDED or t_mid_ns is None:
            self.stars = star_history_without_fold(self.stars, shown)
            self.hand.add(shown, self.config)
            yield LookedAt(shown=shown)
            return
        folded = fold(self.following, self.stars, shown, self.config)
        done = Fold(
            before=self.following,
            stars_before=self.stars,
            shown=shown,
            config=self.config,
            folded=folded,
        )
        self.folds.add(done)
        self.following, self.stars = folded.following, folded.stars
        self.kept.folded(self.following)
        if folded.following.track is None:
            self.hand.add(shown, self.config)
        yield self._compared(_replayed(done, recorded))

    def _compared(self, frame: ReplayedFrame) -> ReplayedFrame:
        if not frame.is_alike:
            # Those of the frames before are of what is followed here, too.
            orbits = self.orbits if self.is_another_night else frame.shown.orbits
            self.is_another_night, self.orbits = True, orbits
        return frame

    def _receive_decision(self, record: Ruling | FollowedAgain) -> None:
        """The operator's word: what is followed is what it leads to."""
        if isinstance(record, FollowedAgain):
            done = self.again.pop(record.frame_id, None)
            self.open_again = None if done is None else (done, [])
            return
        self.is_by_hand = self.following.state not in FOLDED
        try:
            if self.is_by_hand:
                self._rule_by_hand(record)
                return
            again = self.folds.rule(record)
        except ValueError:  # under what is tried the frame was not followed
            return
        self.again = {each.shown.taken.frame_id: each for each in again}
        self.following = again[-1].folded.following

    def _rule_by_hand(self, record: Ruling) -> None:
        self.again = {}
        kept, _ = self.hand.rule(record, self.kept.following, self.following.last_track_id)
        self.kept.made(kept)
        if kept is not None:
            last_track_id = max(kept.last_track_id, self.following.last_track_id)
            self.following = replace(self.following, last_track_id=last_track_id)

    def _pass(self, change: StateChange) -> None:
        """The operator, a limit, a fault or the end of the night: what is followed after it."""
        self.folds.forget()
        self.hand.forget()
        if change.reason.kind == "clock set":
            self.orbits = {}
            self.following = replace(self.following, dropped=())
        before, kept = self.following, self.kept.following
        self.kept.passed(change, before)
        if change.after != "COAST":
            self.following = before.without_track(change.after)
        elif kept is not None:
            last_track_id = max(kept.last_track_id, before.last_track_id)
            self.following = replace(
                kept, state="COAST", candidates=(), last_track_id=last_track_id
            )
        else:
            self.following = before.without_track("SEARCH")


def _replayed(done: Fold, recorded: tuple[Record, ...]) -> ReplayedFrame:
    return ReplayedFrame(
        taken=done.shown.taken,
        shown=done.shown,
        config=done.config,
        after=done.folded.following,
        records=done.folded.records,
        recorded=recorded,
    )
