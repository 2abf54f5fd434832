"""A night along its time: where its frames lie, its states, and what came to pass. Pure.

Places are numbers of the log (``seq``). A frame reaches from its ``FrameTaken`` to the record
before the next one: what a screen shows at its end is the whole frame.
"""

from bisect import bisect_left, bisect_right
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

from rsoconsole.console.words import refused_of
from rsoconsole.control import BeginMark, Note
from rsoconsole.night import FrameRow
from rsoconsole.records import (
    FOLLOWING,
    Event,
    FrameTaken,
    LoopState,
    Miss,
    OperatorAction,
    Record,
    StateChange,
)

TimelineEventKind = Literal["miss", "rejection", "loss", "operator", "note", "alarm"]
KINDS: tuple[TimelineEventKind, ...] = ("miss", "rejection", "loss", "operator", "note", "alarm")
_OF_FRAMES: frozenset[TimelineEventKind] = frozenset(("miss", "rejection", "loss"))
"""Kinds that are seen whole only when their frame's last record is there."""


class FrameMark(NamedTuple):
    """Where a frame begins."""

    seq: int
    t_utc_ns: int
    frame_id: int


class StateMark(NamedTuple):
    """Where a state begins."""

    seq: int
    t_utc_ns: int
    state: LoopState


class TimelineEvent(NamedTuple):
    """Something worth a jump."""

    seq: int
    t_utc_ns: int
    kind: TimelineEventKind


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Timeline:
    """A night along its time, as far as it has been recorded; each is only itself."""

    frames: tuple[FrameMark, ...] = ()
    states: tuple[StateMark, ...] = ()
    events: tuple[TimelineEvent, ...] = ()
    """In order of the log."""
    first_utc_ns: int | None = None
    last_utc_ns: int | None = None
    last_seq: int = 0
    read_seq: int = 0
    """How far it has been read, so that any moment before is shown at once and whole."""
    is_closed: bool = False
    with_pixels: frozenset[int] = frozenset()
    """Numbers of the frames whose pixels are there: those can be opened at full resolution."""

    @property
    def is_whole(self) -> bool:
        """Whether all of it has been read."""
        return self.read_seq >= self.last_seq

    def index_of(self, seq: int) -> int | None:
        """Which frame a place of the log lies in, counted from 0; None before the first."""
        index = bisect_right(self.frames, seq, key=lambda mark: mark.seq) - 1
        return index if index >= 0 else None

    def end_of(self, index: int) -> int:
        """The last place of that frame."""
        after = index + 1
        return self.frames[after].seq - 1 if after < len(self.frames) else self.last_seq

    def time_of(self, seq: int) -> int | None:
        """When the frame began in which a place lies; the night's beginning before the first."""
        index = self.index_of(seq)
        return self.first_utc_ns if index is None else self.frames[index].t_utc_ns

    def step(self, seq: int, by: int) -> int | None:
        """The end of the frame ``by`` on (or back, below 0); None where there is none at all.

        From a place within a frame, one on is that frame's own end.
        """
        if not self.frames:
            return None
        index = self.index_of(seq)
        if index is None:
            wanted = by - 1
        elif by > 0 and seq < self.end_of(index):
            wanted = index + by - 1
        else:
            wanted = index + by
        return self.end_of(min(max(wanted, 0), len(self.frames) - 1))

    def at_time(self, t_utc_ns: int) -> int | None:
        """The end of the last frame that began by then; of the first one before that."""
        if not self.frames:
            return None
        index = bisect_right(self.frames, t_utc_ns, key=lambda mark: mark.t_utc_ns) - 1
        return self.end_of(max(index, 0))

    def moment_of(self, event: TimelineEvent) -> int:
        """The place from which that is best seen."""
        index = self.index_of(event.seq)
        if event.kind not in _OF_FRAMES or index is None:
            return event.seq
        return self.end_of(index)

    def jump(
        self, seq: int, kinds: tuple[TimelineEventKind, ...], *, is_on: bool
    ) -> TimelineEvent | None:
        """The next happening of these kinds whose moment lies after (or before) a place."""
        chosen = [each for each in self.events if each.kind in kinds]
        if is_on:
            at = bisect_right(chosen, seq, key=self.moment_of)
            return chosen[at] if at < len(chosen) else None
        at = bisect_left(chosen, seq, key=self.moment_of) - 1
        return chosen[at] if at >= 0 else None

    def kinds_at(self, moment: int) -> tuple[TimelineEventKind, ...]:
        """Everything that is best seen from that place."""
        index = self.index_of(moment)
        first = 0 if index is None else self.frames[index].seq
        near = [each for each in self.events if first <= each.seq <= moment]
        kinds = {each.kind for each in near if self.moment_of(each) == moment}
        return tuple(kind for kind in KINDS if kind in kinds)

    def cadence_s(self) -> float:
        """The usual time from frame to frame; 1 where there are too few to tell."""
        steps = [
            b.t_utc_ns - a.t_utc_ns for a, b in zip(self.frames, self.frames[1:], strict=False)
        ]
        usual = sorted(step for step in steps if step > 0)
        return usual[len(usual) // 2] / 1e9 if usual else 1.0


@dataclass(slots=True)
class TimelineFold:
    """Makes the time line of a night: at once from its outline, in full as it is read."""

    _frames: list[FrameMark] = field(default_factory=list)
    _states: list[StateMark] = field(default_factory=list)
    _events: list[TimelineEvent] = field(default_factory=list)
    _refused: list[TimelineEvent] = field(default_factory=list)
    """Rejections: known only when a frame has been read."""
    _first_utc_ns: int | None = None
    _last_utc_ns: int | None = None
    _last_seq: int = 0

    @property
    def last_seq(self) -> int:
        """The last place of the log that is known."""
        return self._last_seq

    def receive(
        self,
        seq: int,
        t_utc_ns: int,
        kind: str,
        frame_id: int | None,
        record: Record | None = None,
    ) -> None:
        """One record, in order; ``record`` is needed of the kinds in ``READ_IN_FULL`` only."""
        # An unreadable record stands at instant 0, and a clock that is set may go back.
        t = max(t_utc_ns, self._last_utc_ns or 0)
        if t:
            self._first_utc_ns = self._first_utc_ns or t
            self._last_utc_ns = t
        self._last_seq = max(self._last_seq, seq)
        if kind == FrameTaken.__name__ and frame_id is not None:
            self._frames.append(FrameMark(seq, t, frame_id))
        elif kind == Miss.__name__:
            self._events.append(TimelineEvent(seq, t, "miss"))
        elif record is not None:
            if isinstance(record, StateChange):
                self._states.append(StateMark(seq, t, record.after))
            found = _kind_of(record)
            if found is not None:
                self._events.append(TimelineEvent(seq, t, found))

    def receive_row(self, row: FrameRow, mark: FrameMark) -> None:
        """What became of a frame that has been read to its end."""
        if refused_of(row) is not None:
            self._refused.append(TimelineEvent(mark.seq, mark.t_utc_ns, "rejection"))

    def so_far(self, read_seq: int, *, is_closed: bool) -> Timeline:
        """What is known."""
        return Timeline(
            frames=tuple(self._frames),
            states=tuple(self._states),
            events=tuple(sorted([*self._events, *self._refused])),
            first_utc_ns=self._first_utc_ns,
            last_utc_ns=self._last_utc_ns,
            last_seq=self._last_seq,
            read_seq=read_seq,
            is_closed=is_closed,
        )


READ_IN_FULL = (StateChange, OperatorAction, Event)
"""Kinds of which the outline alone does not say what came to pass."""


def _kind_of(record: Record) -> TimelineEventKind | None:
    """What a record is on the time line, beside its frame and misses; None: nothing."""
    match record:
        case StateChange():
            if record.after == "FAULT":
                return "alarm"
            is_given_up = record.before in FOLLOWING and record.after == "SEARCH"
            return "loss" if is_given_up or record.after == "LOST" else None
        case OperatorAction(verb=Note.verb):
            return "note"
        case OperatorAction():
            # Of what waits, and of a mark that begins, the log has later what came of it.
            is_to_come = record.outcome.kind == "accepted" or record.verb == BeginMark.verb
            return None if is_to_come else "operator"
        case Event():
            return "alarm" if record.level == "alarm" else None
        case _:
            return None
