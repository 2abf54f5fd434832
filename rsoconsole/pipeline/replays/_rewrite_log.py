"""Log of a session as it would have been with other settings. Pure.

The inputs of tracking stay in their order; its recorded results are replaced by those of the
replay. Without changed settings the rewritten log equals the original. Replayed with the changed
configuration, it gives its own records again (on another processor: but for the last digits).
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from typing import assert_never

from rsoconsole.config import Config
from rsoconsole.night import FOLDED, is_external_change
from rsoconsole.pipeline.cycle.frame_fold import FrameObservations, ReducedFrame
from rsoconsole.pipeline.frame.measurement import frame_timing, mid_exposure_utc_ns, with_row_time
from rsoconsole.pipeline.replays.record_equality import are_nearly_equal
from rsoconsole.pipeline.replays.refold import RecordRole, ReplayedFrame, ReplayState
from rsoconsole.records import (
    BesideRecord,
    Cause,
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
    NotFollowed,
    NotSolved,
    OrbitRecord,
    ParameterChange,
    Record,
    Ruling,
    Solution,
    StateChange,
    TrackState,
)


class LogRewriter:
    """Rewrites a log record by record, so that a long night need not be held in memory."""

    def __init__(
        self,
        walk: ReplayState,
        *,
        on_record: Callable[[int, Record], None],
        on_frame: Callable[[ReplayedFrame], None],
    ) -> None:
        """``on_record``: called with each (t_utc_ns, record) of the rewritten log, in order.

        ``on_frame``: called with each folded frame as soon as it is complete.
        """
        self.config = walk.config
        self._on_record = on_record
        self._on_frame = on_frame
        self._walk = walk
        self._held: list[tuple[int, Record, RecordRole]] = []
        """Records since the open frame was reduced, or began to be folded again."""
        self._t_open_ns = 0
        self._is_again = False
        self._is_another_night = False
        """True once a frame was folded differently: later orbits belong to no track here."""
        self._is_void = False
        """True after a frame that is not folded again here: its consequences are left out."""
        self._ruled: tuple[int, Ruling, LoopState, LoopState] | None = None
        """Decision whose change of state has not been written, and the states before and after."""

    def receive(self, t_utc_ns: int, record: Record) -> None:
        """Process the next record of the recorded log."""
        walk = self._walk
        if _closes(record):
            self.close()
        before = walk.following.state
        for each in walk.receive(record):
            self._write_frame(each)
        if walk.open is not None or walk.open_again is not None:
            if isinstance(record, FollowedAgain):
                self._begin_again(t_utc_ns, record)
            else:
                self._held.append((t_utc_ns, record, walk.part))
            return
        self._write_other(t_utc_ns, record, before)

    def close(self) -> None:
        """Write the frame that is still open, as at the end of the log."""
        for each in self._walk.close():
            self._write_frame(each)
        self._is_void = False

    def _begin_again(self, t_utc_ns: int, record: FollowedAgain) -> None:
        self._write_ruled()
        self._on_record(t_utc_ns, record)
        self._t_open_ns, self._is_again = t_utc_ns, True

    def _write_other(self, t_utc_ns: int, record: Record, before: LoopState) -> None:
        """Write a record that belongs to no open frame."""
        match record:
            case FollowedAgain():
                self._write_ruled()
                # What marks by hand led to stands as it was told.
                self._is_void = not self._walk.is_by_hand
            case Ruling():
                self._ruled = (t_utc_ns, record, before, self._walk.following.state)
            case StateChange():
                self._write_change(t_utc_ns, record, before)
                return
            case TrackState() | NotFollowed() | Miss() | Measurement(source="faint"):
                if self._is_void:
                    return
                record = self._at_instant(record) if isinstance(record, Measurement) else record
            case _ if isinstance(record, OrbitRecord):
                if self._is_void or self._is_another_night:
                    return
            case ParameterChange():
                if record.name in self._walk.held:
                    record = _without_force(record, self._walk.config)
            case Measurement():
                record = self._at_instant(record)
            case _ if isinstance(
                record, (FrameTaken, Detections, Solution, NotSolved, CycleTiming, BesideRecord)
            ):
                pass  # told as it was
            case _:
                assert_never(record)
        self._on_record(t_utc_ns, record)

    def _write_change(self, t_utc_ns: int, record: StateChange, before: LoopState) -> None:
        """Write a change of state that belongs to no open frame."""
        if is_external_change(record):
            change = _passage(record, before, self._walk.following.state)
            self._on_record(t_utc_ns, change)
        elif self._walk.is_ruled:
            self._write_ruled(record)
        elif not self._is_void:
            self._on_record(t_utc_ns, record)

    def _write_ruled(self, recorded: StateChange | None = None) -> None:
        """Write the change of state caused by a decision, if there is one."""
        if self._ruled is None:
            return
        t_utc_ns, decision, before, after = self._ruled
        self._ruled = None
        if before == after:
            return
        again = Cause(kind="operator's word", detail="followed again by the operator's word")
        reason = again if recorded is None else recorded.reason
        change = StateChange(frame_id=decision.frame_id, before=before, after=after, reason=reason)
        self._on_record(t_utc_ns, change)

    def _at_instant(self, measurement: Measurement) -> Measurement:
        """Return the operator's mark at its frame's instant."""
        again = self._walk.again.get(measurement.frame_id)
        if again is None:
            return measurement
        taken, exposure = again.observations.taken, again.config.exposure
        t_mid_ns = mid_exposure_utc_ns(taken, exposure)
        if t_mid_ns is None:
            return measurement
        return with_row_time(measurement, t_mid_ns, frame_timing(taken, exposure))

    def _write_frame(self, closed: ReducedFrame) -> None:
        """Write a complete frame: its inputs, the fold's records, and the others with it."""
        held, self._held = self._held, []
        is_again, self._is_again = self._is_again, False
        inputs = () if is_again else _inputs(closed.observations)
        folded: tuple[Record, ...] = ()
        if isinstance(closed, ReplayedFrame):
            self._on_frame(closed)
            folded = closed.records
        is_same = inputs == tuple(r for _, r, part in held if part == "input") and are_nearly_equal(
            folded, tuple(r for _, r, part in held if part == "folded")
        )
        self._is_another_night = self._is_another_night or not is_same
        if is_same and not self._is_another_night:
            for t_utc_ns, record, _ in held:
                self._on_record(t_utc_ns, record)
            return
        held = list(_without_orbits(held))
        t_inputs_ns = next((t for t, _, part in held if part == "input"), self._t_open_ns)
        t_folded_ns = next((t for t, _, part in held if part == "folded"), t_inputs_ns)
        others = [(t, record) for t, record, part in held if part == "other"]
        rewritten = [
            *((t_inputs_ns, r) for r in inputs),
            *((t_folded_ns, r) for r in folded),
            *others,
        ]
        for t_utc_ns, record in rewritten:
            self._on_record(t_utc_ns, record)


def _without_orbits(
    held: Iterable[tuple[int, Record, RecordRole]],
) -> Iterator[tuple[int, Record, RecordRole]]:
    """Yield the records without orbits and names, and the events about them."""
    is_theirs = False
    for each in held:
        is_theirs = isinstance(each[1], OrbitRecord) or (is_theirs and isinstance(each[1], Event))
        if not is_theirs:
            yield each


def _inputs(observed: FrameObservations) -> tuple[Record, ...]:
    solution = () if observed.solution is None else (observed.solution,)
    return (observed.detections, *solution, *observed.measurements)


def _closes(record: Record) -> bool:
    """True where no record after it belongs to the frame before."""
    match record:
        case FrameTaken() | CycleTiming() | Ruling() | FollowedAgain() | ParameterChange():
            return True
        case StateChange():
            return is_external_change(record)
        case Event():
            return record.topic == "kept"
        case _ if isinstance(record, (FoldInput, FoldRecord, OrbitRecord, BesideRecord)):
            return False
        case _:
            assert_never(record)


def _passage(change: StateChange, before: LoopState, after: LoopState) -> StateChange:
    """Return a change from outside between the states of this replay."""
    if change.before not in FOLDED or before not in FOLDED:
        before = change.before
    if change.after not in FOLDED or after not in FOLDED:
        after = change.after
    return replace(change, before=before, after=after)


def _without_force(change: ParameterChange, config: Config) -> Event:
    """Return the event that replaces the change of a setting which is changed here throughout."""
    section, _, key = change.name.partition(".")
    value = getattr(getattr(config, section), key)
    return Event(
        level="info",
        text=f"{change.name} was set from {change.before} to {change.after}: here it is {value}",
    )
