"""Every followed frame as it is on record: what the fold made of it then, without folding again.

Figures of the night as it was need no filter: none is loaded.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import assert_never

from rsoconsole.pipeline.replay.refold import FOLDED, is_from_outside, is_instruments
from rsoconsole.records import (
    Closeup,
    CycleTiming,
    Detections,
    Event,
    ExpectedMembers,
    FollowedAgain,
    FrameTaken,
    Identified,
    LeapDone,
    LoopState,
    LowPass,
    Measurement,
    Miss,
    NotFollowed,
    NotSolved,
    OperatorAction,
    OrbitEstimate,
    PairMotions,
    ParameterChange,
    Record,
    Ruling,
    SlewCommand,
    Solution,
    StateChange,
    TrackState,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedFold:
    """One folded frame."""

    taken: FrameTaken
    records: tuple[Record, ...]
    """TrackState, NotFollowed, Miss, StateChange, in order."""
    state: LoopState
    """After it."""
    solution: Solution | NotSolved | None = None
    """Of its stars."""


def recorded_frames(records: Iterable[Record]) -> Iterator[RecordedFold]:
    """Every frame that the session folded, in order; one that was followed again comes again.

    ``records``: a session's log in its order, of all kinds.
    """
    walk = _Walk()
    for record in records:
        yield from walk.receive(record)
    yield from walk.close()


@dataclass(slots=True, kw_only=True)
class _Open:
    taken: FrameTaken
    before: LoopState
    solution: Solution | NotSolved | None = None
    records: list[Record] = field(default_factory=list)

    def closed(self) -> RecordedFold:
        changes = [each.after for each in self.records if isinstance(each, StateChange)]
        return RecordedFold(
            taken=self.taken,
            records=tuple(self.records),
            state=changes[-1] if changes else self.before,
            solution=self.solution,
        )


@dataclass(slots=True, kw_only=True)
class _Walk:
    """Where the reading stands in the log."""

    state: LoopState = "SEARCH"
    taken: FrameTaken | None = None
    open: _Open | None = None
    followed: dict[int, _Open] = field(default_factory=dict)
    """Frames without anything from outside after them, which a decision may have followed again."""
    is_ruled: bool = False
    """A decision has come, and none of the frames that it has followed again."""
    is_first_again: bool = False

    def receive(self, record: Record) -> Iterator[RecordedFold]:
        """One record; gives the frame that it shows to be complete."""
        match record:
            case FrameTaken():
                yield from self.close()
                self.taken = record
            case Detections():
                if self.taken is not None:
                    self.open = _Open(taken=self.taken, before=self.state)
            case CycleTiming() | ParameterChange():
                yield from self.close()
            case Ruling():
                yield from self.close()
                self.is_ruled = self.is_first_again = True
            case FollowedAgain():
                yield from self.close()
                self._follow_again(record)
            case StateChange() if is_from_outside(record):
                yield from self.close()
                self.followed.clear()
                self.state = record.after
            case TrackState() | NotFollowed() | Miss() | StateChange():
                if self.open is not None and not self._is_loops_own(record):
                    self.open.records.append(record)
            case Solution() | NotSolved():
                self._see_plate(record)
            case (
                Measurement()
                | SlewCommand()
                | OrbitEstimate()
                | Identified()
                | PairMotions()
                | ExpectedMembers()
                | LeapDone()
                | LowPass()
                | OperatorAction()
                | Closeup()
                | Event()
            ):
                pass
            case _:
                assert_never(record)

    def _see_plate(self, record: Solution | NotSolved) -> None:
        if self.open is not None:
            self.open.solution = record

    def close(self) -> Iterator[RecordedFold]:
        """The open frame, if there is one that was followed."""
        done = self.open
        if done is None:
            return
        self.open = self.taken = None
        if done.before not in FOLDED or done.taken.t_mid_utc_ns is None:
            return
        self.followed[done.taken.frame_id] = done
        closed = done.closed()
        self.state = closed.state
        yield closed

    def _follow_again(self, record: FollowedAgain) -> None:
        """A frame whose records come once more: those before it stand."""
        self.is_ruled = False
        old = self.followed.get(record.frame_id)
        if old is None:
            return
        before = old.before if self.is_first_again else self.state
        self.is_first_again = False
        self.open = _Open(taken=old.taken, before=before, solution=old.solution)

    def _is_loops_own(self, record: Record) -> bool:
        """An instrument that failed, or what a decision came to in words: nothing of the fold's."""
        if isinstance(record, Miss):
            return is_instruments(record)
        return isinstance(record, StateChange) and self.is_ruled
