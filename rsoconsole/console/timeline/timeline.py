"""The time line of a night: its frames, the loop's states, its events.

A place is the number (``seq``) of a record in the log. A frame reaches from its record
``FrameTaken`` to the record before the next one; at its last place the whole frame is shown.
"""

import re
from bisect import bisect_left, bisect_right
from dataclasses import dataclass, field
from datetime import UTC, date, datetime, timedelta
from datetime import time as time_of_day
from itertools import pairwise
from statistics import median_high
from typing import Literal, NamedTuple

from rsoconsole.console.words.panels import likeliest_refused_streak
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
from rsoconsole.words import NS_PER_S, utc_text

TimelineEventKind = Literal["miss", "rejection", "loss", "operator", "note", "alarm"]
KINDS: tuple[TimelineEventKind, ...] = ("miss", "rejection", "loss", "operator", "note", "alarm")
_OF_FRAMES: frozenset[TimelineEventKind] = frozenset(("miss", "rejection", "loss"))
"""Kinds of events whose moment is the end of their frame."""


class FrameStart(NamedTuple):
    """Start of a frame: its place in the log, its time, its number."""

    seq: int
    t_utc_ns: int
    frame_id: int


class StateStart(NamedTuple):
    """Start of a state of the loop: its place in the log, its time, the state."""

    seq: int
    t_utc_ns: int
    state: LoopState


class TimelineEvent(NamedTuple):
    """An event that the time line shows and that a review can jump to."""

    seq: int
    t_utc_ns: int
    kind: TimelineEventKind


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Timeline:
    """Time line of a night, as far as it is recorded; two are equal only if identical."""

    frames: tuple[FrameStart, ...] = ()
    states: tuple[StateStart, ...] = ()
    events: tuple[TimelineEvent, ...] = ()
    first_utc_ns: int | None = None
    last_utc_ns: int | None = None
    last_seq: int = 0
    read_seq: int = 0
    """Place up to which the log has been read: moments before are complete and shown at once."""
    is_closed: bool = False
    with_pixels: frozenset[int] = frozenset()
    """Numbers of the frames whose pixels are kept, so that they open at full resolution."""

    @property
    def is_whole(self) -> bool:
        """True where the log has been read up to its last known place."""
        return self.read_seq >= self.last_seq

    def frame_index(self, seq: int) -> int | None:
        """Return the index of the frame that contains a place; None: before the first frame."""
        index = bisect_right(self.frames, seq, key=lambda mark: mark.seq) - 1
        return index if index >= 0 else None

    def frame_end_seq(self, index: int) -> int:
        """Return the last place of the frame of that index."""
        after = index + 1
        return self.frames[after].seq - 1 if after < len(self.frames) else self.last_seq

    def frame_start_utc_ns(self, seq: int) -> int | None:
        """Return the start of the frame that contains a place, UTC ns.

        Before the first frame, the start of the night; None: the night has no records.
        """
        index = self.frame_index(seq)
        return self.first_utc_ns if index is None else self.frames[index].t_utc_ns

    def step(self, seq: int, by: int) -> int | None:
        """Return the last place of the frame ``by`` frames later, earlier for a negative number.

        From a place inside a frame, a step of 1 leads to the end of that frame. None: there are no
        frames.
        """
        if not self.frames:
            return None
        index = self.frame_index(seq)
        if index is None:
            wanted = by - 1
        elif by > 0 and seq < self.frame_end_seq(index):
            wanted = index + by - 1
        else:
            wanted = index + by
        return self.frame_end_seq(min(max(wanted, 0), len(self.frames) - 1))

    def frame_end_seq_at_time(self, t_utc_ns: int) -> int | None:
        """Return the last place of the newest frame begun by ``t_utc_ns``; None: no frames.

        For an instant before the first frame, the last place of that frame.
        """
        if not self.frames:
            return None
        index = bisect_right(self.frames, t_utc_ns, key=lambda mark: mark.t_utc_ns) - 1
        return self.frame_end_seq(max(index, 0))

    def moment_seq(self, event: TimelineEvent) -> int:
        """Return the place at which to show an event: its own, or the last place of its frame."""
        index = self.frame_index(event.seq)
        if event.kind not in _OF_FRAMES or index is None:
            return event.seq
        return self.frame_end_seq(index)

    def next_event(
        self, seq: int, kinds: tuple[TimelineEventKind, ...], *, is_on: bool
    ) -> TimelineEvent | None:
        """Return the next event of these kinds, by the place at which it is shown; None: none.

        ``is_on``: True for the first event after the place ``seq``, False for the last before
        it.
        """
        chosen = [each for each in self.events if each.kind in kinds]
        if is_on:
            at = bisect_right(chosen, seq, key=self.moment_seq)
            return chosen[at] if at < len(chosen) else None
        at = bisect_left(chosen, seq, key=self.moment_seq) - 1
        return chosen[at] if at >= 0 else None

    def event_kinds_at(self, moment: int) -> tuple[TimelineEventKind, ...]:
        """Return the kinds of the events that are shown at this place."""
        index = self.frame_index(moment)
        first = 0 if index is None else self.frames[index].seq
        near = [each for each in self.events if first <= each.seq <= moment]
        kinds = {each.kind for each in near if self.moment_seq(each) == moment}
        return tuple(kind for kind in KINDS if kind in kinds)

    def cadence_s(self) -> float:
        """Return the median time between frames in seconds; 1 where there are too few frames."""
        steps = (b.t_utc_ns - a.t_utc_ns for a, b in pairwise(self.frames))
        forward = [step for step in steps if step > 0]
        return median_high(forward) / 1e9 if forward else 1.0


@dataclass(slots=True)
class TimelineBuilder:
    """Folds records into a time line: in outline from their kinds, in full from the records."""

    _frames: list[FrameStart] = field(default_factory=list)
    _states: list[StateStart] = field(default_factory=list)
    _events: list[TimelineEvent] = field(default_factory=list)
    _refused: list[TimelineEvent] = field(default_factory=list)
    """Rejections, which are known only when a frame has been read to its end."""
    _first_utc_ns: int | None = None
    _last_utc_ns: int | None = None
    last_seq: int = 0

    def receive(
        self, seq: int, t_utc_ns: int, kind: str, frame_id: int | None, record: Record | None = None
    ) -> None:
        """Add the next record; ``record`` is needed only for the kinds in ``READ_IN_FULL``."""
        # An unreadable record stands at instant 0, and a clock that is set may go back.
        t = max(t_utc_ns, self._last_utc_ns or 0)
        if t:
            self._first_utc_ns = self._first_utc_ns or t
            self._last_utc_ns = t
        self.last_seq = max(self.last_seq, seq)
        if kind == FrameTaken.__name__ and frame_id is not None:
            self._frames.append(FrameStart(seq, t, frame_id))
        elif kind == Miss.__name__:
            self._events.append(TimelineEvent(seq, t, "miss"))
        elif record is not None:
            if isinstance(record, StateChange):
                self._states.append(StateStart(seq, t, record.after))
            found = _kind_of(record)
            if found is not None:
                self._events.append(TimelineEvent(seq, t, found))

    def receive_frame_outcome(self, row: FrameRow, mark: FrameStart) -> None:
        """Add the outcome of a frame whose records are all read; ``mark``: the frame's start."""
        if likeliest_refused_streak(row) is not None:
            self._refused.append(TimelineEvent(mark.seq, mark.t_utc_ns, "rejection"))

    def build_timeline(self, read_seq: int, *, is_closed: bool) -> Timeline:
        """Return the time line of the records folded so far.

        ``read_seq``: place up to which the log has been read.
        """
        return Timeline(
            frames=tuple(self._frames),
            states=tuple(self._states),
            events=tuple(sorted([*self._events, *self._refused])),
            first_utc_ns=self._first_utc_ns,
            last_utc_ns=self._last_utc_ns,
            last_seq=self.last_seq,
            read_seq=read_seq,
            is_closed=is_closed,
        )


READ_IN_FULL = (StateChange, OperatorAction, Event)
"""Kinds of records whose content decides which event they are, if any."""


def _kind_of(record: Record) -> TimelineEventKind | None:
    """Return the kind of event that a record is on the time line; None: it is no event."""
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
"""Speeds of replay, as factors on the night's own."""
GAP_CADENCES = 10.0
"""Factor on the usual time between frames from which on a longer gap is skipped."""


def speed_words(speed: float) -> str:
    """Return a speed in words: ×30 or ×0.5."""
    return f"×{speed:g}"


@dataclass(slots=True)
class Player:
    """The replay of a night: its speed, whether it runs, and its clock."""

    speed: float = SPEEDS[0]
    is_playing: bool = False
    _t_utc_ns: float = 0.0

    def settle(self, timeline: Timeline) -> None:
        """Set the speed to about one frame a second."""
        cadence_s = timeline.cadence_s()
        self.speed = min(SPEEDS, key=lambda speed: abs(speed - cadence_s))

    def change(self, by: int) -> None:
        """Raise the speed by ``by`` steps of ``SPEEDS``; a negative number lowers it."""
        at = SPEEDS.index(self.speed) + by
        self.speed = SPEEDS[min(max(at, 0), len(SPEEDS) - 1)]

    def begin(self, timeline: Timeline, seq: int) -> None:
        """Start to play from the frame that a place is in."""
        self.is_playing = True
        self._t_utc_ns = float(timeline.frame_start_utc_ns(seq) or 0)

    def after(self, timeline: Timeline, seq: int, by_s: float) -> int:
        """Return the place to show when ``by_s`` seconds have passed since the last call.

        ``seq``: the place shown now. At the end of a closed night playing stops; in a night that
        goes on it waits for frames.
        """
        following = timeline.step(seq, 1)
        if following is None or following == seq:
            self.is_playing = not timeline.is_closed and following is not None
            return seq
        ahead_ns = (timeline.frame_start_utc_ns(following) or 0) - self._t_utc_ns
        self._t_utc_ns += by_s * self.speed * 1e9
        if ahead_ns > GAP_CADENCES * timeline.cadence_s() * 1e9:
            self._t_utc_ns = float(timeline.frame_start_utc_ns(following) or 0)
        due = timeline.frame_end_seq_at_time(round(self._t_utc_ns))
        return seq if due is None else max(due, seq)


EXAMPLES = "128, 03:14, 03:14:22 or 2024-03-01T03:14"
_CLOCK = re.compile(r"(?:(\d{4}-\d\d-\d\d)[T ])?(\d\d?):(\d\d)(?::(\d\d))?Z?", re.IGNORECASE)


@dataclass(frozen=True, slots=True, kw_only=True)
class TypedPlace:
    """A place as typed: a frame's number, or a UTC time of day with or without its date."""

    frame_id: int | None = None
    clock: time_of_day | None = None
    day: date | None = None


def parse_place(text: str) -> TypedPlace:
    """Parse a frame's number or a UTC time. Raises ValueError, in words for the operator."""
    plain = text.strip()
    if plain.isdecimal():
        return TypedPlace(frame_id=int(plain))
    found = _CLOCK.fullmatch(plain)
    if found is not None:
        day, hour, minute, second = found.groups()
        try:
            return TypedPlace(
                clock=time_of_day(int(hour), int(minute), int(second or 0)),
                day=date.fromisoformat(day) if day else None,
            )
        except ValueError as error:
            raise ValueError(f"{plain!r} is no time: {error}") from error
    raise ValueError(f"{plain!r} is no frame and no UTC time: {EXAMPLES}")


def typed_place_seq(typed: TypedPlace, timeline: Timeline) -> int:
    """Return the last place of the typed frame, or of the newest begun by the typed time.

    Raises ValueError, in words for the operator, where the night has no such place.
    """
    if not timeline.frames:
        raise ValueError("the session has no frames")
    if typed.frame_id is not None:
        numbers = [mark.frame_id for mark in timeline.frames]
        if typed.frame_id in numbers:
            return timeline.frame_end_seq(numbers.index(typed.frame_id))
        bounds = f"{numbers[0]} to {numbers[-1]}"
        raise ValueError(f"there is no frame {typed.frame_id}: frames are {bounds}")
    t_utc_ns = _instant(typed, timeline)
    seq = None if t_utc_ns is None else timeline.frame_end_seq_at_time(t_utc_ns)
    if seq is None:
        first, last = utc_text(timeline.first_utc_ns), utc_text(timeline.last_utc_ns)
        raise ValueError(f"the session goes from {first} to {last}")
    return seq


def _instant(typed: TypedPlace, timeline: Timeline) -> int | None:
    """Return a typed time, UTC ns; None where it is over a minute outside the session."""
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
