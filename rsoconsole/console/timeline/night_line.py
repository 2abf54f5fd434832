"""A night along its time: where its frames lie, its states, and what came to pass. Pure.

Places are numbers of the log (``seq``). A frame reaches from its ``FrameTaken`` to the record
before the next one: what a screen shows at its end is the whole frame.
"""

import re
from bisect import bisect_left, bisect_right
from dataclasses import dataclass, field
from datetime import UTC, date, datetime, timedelta
from datetime import time as time_of_day
from typing import Literal, NamedTuple

from rsoconsole.console.words.panels import refused_of
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
from rsoconsole.words import NS_PER_S, clock

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


SPEEDS = (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 30.0, 60.0, 120.0, 300.0, 600.0, 1000.0)
"""Paces of replay, as factors on the night's own."""
GAP_CADENCES = 10.0
"""A gap between frames longer than this many times the usual one is skipped."""


def speed_words(speed: float) -> str:
    """×30 or ×0.5."""
    return f"×{speed:g}"


@dataclass(slots=True)
class Player:
    """How fast, whether at all, and the frame clock of what is shown."""

    speed: float = SPEEDS[0]
    is_playing: bool = False
    _t_utc_ns: float = 0.0

    def settle(self, timeline: Timeline) -> None:
        """About a frame a second."""
        cadence_s = timeline.cadence_s()
        self.speed = min(SPEEDS, key=lambda speed: abs(speed - cadence_s))

    def change(self, by: int) -> None:
        """One step slower or faster."""
        at = SPEEDS.index(self.speed) + by
        self.speed = SPEEDS[min(max(at, 0), len(SPEEDS) - 1)]

    def begin(self, timeline: Timeline, seq: int) -> None:
        """Play from there on."""
        self.is_playing = True
        self._t_utc_ns = float(timeline.time_of(seq) or 0)

    def after(self, timeline: Timeline, seq: int, by_s: float) -> int:
        """The moment that is due when it has played for so long since the last call.

        At the end of a night that is over it stops; one that goes on is waited for.
        """
        following = timeline.step(seq, 1)
        if following is None or following == seq:
            self.is_playing = not timeline.is_closed and following is not None
            return seq
        ahead_ns = (timeline.time_of(following) or 0) - self._t_utc_ns
        self._t_utc_ns += by_s * self.speed * 1e9
        if ahead_ns > GAP_CADENCES * timeline.cadence_s() * 1e9:
            self._t_utc_ns = float(timeline.time_of(following) or 0)
        due = timeline.at_time(round(self._t_utc_ns))
        return seq if due is None else max(due, seq)


EXAMPLES = "128, 03:14, 03:14:22 or 2024-03-01T03:14"
_CLOCK = re.compile(r"(?:(\d{4}-\d\d-\d\d)[T ])?(\d\d?):(\d\d)(?::(\d\d))?Z?", re.IGNORECASE)


@dataclass(frozen=True, slots=True, kw_only=True)
class Typed:
    """What was meant: a frame's number, or a time of day with or without its date, UTC."""

    frame_id: int | None = None
    clock: time_of_day | None = None
    day: date | None = None


def understood(text: str) -> Typed:
    """What was typed. Raises ValueError in words for what is neither."""
    plain = text.strip()
    if plain.isdecimal():
        return Typed(frame_id=int(plain))
    found = _CLOCK.fullmatch(plain)
    if found is not None:
        day, hour, minute, second = found.groups()
        try:
            return Typed(
                clock=time_of_day(int(hour), int(minute), int(second or 0)),
                day=date.fromisoformat(day) if day else None,
            )
        except ValueError as error:
            raise ValueError(f"{plain!r} is no time: {error}") from error
    raise ValueError(f"{plain!r} is no frame and no UTC time: {EXAMPLES}")


def seq_of(typed: Typed, timeline: Timeline) -> int:
    """The moment that was meant: that frame's end, or what was newest then.

    Raises ValueError in words where the night has none.
    """
    if not timeline.frames:
        raise ValueError("the session has no frames")
    if typed.frame_id is not None:
        for index, mark in enumerate(timeline.frames):
            if mark.frame_id == typed.frame_id:
                return timeline.end_of(index)
        first, last = timeline.frames[0].frame_id, timeline.frames[-1].frame_id
        raise ValueError(f"there is no frame {typed.frame_id}: frames are {first} to {last}")
    t_utc_ns = _instant(typed, timeline)
    seq = None if t_utc_ns is None else timeline.at_time(t_utc_ns)
    if seq is None:
        first_utc_ns, last_utc_ns = timeline.first_utc_ns, timeline.last_utc_ns
        raise ValueError(f"the session goes from {clock(first_utc_ns)} to {clock(last_utc_ns)}")
    return seq


def _instant(typed: Typed, timeline: Timeline) -> int | None:
    """That time within the session; None where it has none. A minute that has begun counts."""
    first, last = timeline.first_utc_ns, timeline.last_utc_ns
    if first is None or last is None or typed.clock is None:
        return None
    begun = datetime.fromtimestamp(first // NS_PER_S, tz=UTC).date()
    ended = datetime.fromtimestamp(last // NS_PER_S, tz=UTC).date()
    days = [begun + timedelta(days=n) for n in range((ended - begun).days + 1)]
    for day in days if typed.day is None else [typed.day]:
        instant = datetime.combine(day, typed.clock, tzinfo=UTC)
        t_utc_ns = int(instant.timestamp()) * NS_PER_S
        if first - 60 * NS_PER_S <= t_utc_ns <= last + 60 * NS_PER_S:
            return t_utc_ns
    return None
