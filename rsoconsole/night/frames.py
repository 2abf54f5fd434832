"""Frames of a session, built from its records: everything on record of each exposure."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from rsoconsole.config import Config
from rsoconsole.control import BeginMark
from rsoconsole.night.frame import FrameFold, FrameTrack, NightFrame
from rsoconsole.records import (
    FROM_OUTSIDE,
    Closeup,
    CycleTiming,
    Detections,
    FollowedAgain,
    FrameTaken,
    Identified,
    LoopState,
    Measurement,
    Miss,
    NotFollowed,
    NotSolved,
    OperatorAction,
    OrbitEstimate,
    ParameterChange,
    Photometry,
    Record,
    Ruling,
    Solution,
    StateChange,
    TrackState,
)

NEWEST = 16
"""Number of last frames kept whole in a long night; during a mark, all since its frame."""
MARKED_FOR = 600
"""Number of frames for which a frame with a mark under way is kept (``pipeline.frame.HELD``)."""
TAU = "detector.tau"
FOLDED: frozenset[LoopState] = frozenset(("SEARCH", "ACQUIRE", "TRACK", "COAST", "LOST"))
"""States of the loop in which frames are folded into tracks."""
_EMPTY = NightFrame()


@dataclass(slots=True, kw_only=True)
class _Reading:
    """Position of the fold in the log."""

    tau: float
    state: LoopState | None = None
    settings: Mapping[str, float | int | str] = field(default_factory=dict)
    fold_state: LoopState = "SEARCH"
    awaited: int | None = None
    """Frame that was taken and not yet reduced."""
    open: int | None = None
    before: LoopState = "SEARCH"
    records: list[Record] = field(default_factory=list)
    again: set[int] = field(default_factory=set)
    """Frames that a decision may have processed again: no change from outside came after them."""
    marked: Mapping[int, int] = field(default_factory=dict)
    """Last frame until which each frame with a mark under way is kept."""
    is_ruled: bool = False
    """True where a decision was read, and no frame yet that it had processed again."""
    is_first_again: bool = False
    """True where the next frame processed again is the decision's first."""

    def copy(self) -> "_Reading":
        """Return a copy at the same place."""
        return replace(self, again=set(self.again), records=list(self.records))


class NightFrames:
    """Builder of a session's frames from its records, given in order and of every kind.

    A ``NightFrame`` is changed in place until it is shared, although its class is frozen: copies at
    each of a dozen changes would be too slow for 50,000 frames.
    """

    def __init__(
        self,
        config: Config | None = None,
        *,
        newest: int | None = None,
        on_past: Callable[[NightFrame], None] = lambda _: None,
    ) -> None:
        """Start before the first record.

        ``config``: settings that the session began with; ``newest``: how many of the last frames
        are kept, None: all; ``on_past``: called with each frame that is no longer kept.
        """
        self._reading = _Reading(tau=0.1 if config is None else config.detector.tau)
        self._newest, self._on_past = newest, on_past
        self._frames: dict[int, NightFrame] = {}
        self._past = -1
        """Number of the last frame that was dropped."""
        self._own: dict[int, NightFrame] = {}
        """Frames that are not shared yet, by identity: they may change in place."""
        self.changed: set[int] = set()
        """Numbers of the frames changed since a caller emptied this set."""

    @property
    def tau(self) -> float:
        """Value of the setting ``detector.tau`` in force now."""
        return self._reading.tau

    @property
    def settings(self) -> Mapping[str, float | int | str]:
        """Settings changed since the session began, by dotted name."""
        return self._reading.settings

    @property
    def state(self) -> LoopState | None:
        """The loop's state; None before the first record of it."""
        return self._reading.state

    def fold_record(self, record: Record, t_utc_ns: int = 0) -> None:  # noqa: PLR0912
        """Fold the next record; ``t_utc_ns``: the time of the record in the log."""
        reading = self._reading
        match record:
            case FrameTaken():
                self._begin(record, t_utc_ns)
            case Detections():
                self._expect(record.frame_id)
                self._change(record.frame_id, detections=record, settings=reading.settings)
                if reading.awaited is not None:
                    self._open(reading.awaited, reading.fold_state)
            case Solution() | NotSolved():
                self._expect(record.frame_id)
                self._change(record.frame_id, solution=record)
            case Measurement():
                self._measurement(record)
            case Photometry() | Closeup():
                name = "closeup" if isinstance(record, Closeup) else "photometry"
                self._change(record.frame_id, **{name: record})
            case TrackState():
                self._expect(record.frame_id)
                self._track_state(record)
                self._fold(record)
            case NotFollowed():
                self._append("not_followed", record)
                self._fold(record)
            case Miss():
                self._expect(record.frame_id)
                self._append("misses", record)
                self._fold(record)
            case OrbitEstimate():
                self._append("orbits", record)
            case Identified():
                self._append("names", record)
            case Ruling():
                self.close()
                self._decision(record)
            case FollowedAgain():
                self.close()
                self._followed_again(record)
            case StateChange():
                self._state_change(record)
            case OperatorAction(verb=BeginMark.verb) if record.outcome.kind == "done":
                self._mark(record.arguments)
            case CycleTiming():
                self.close()
            case ParameterChange():
                self.close()
                reading.settings = {**reading.settings, record.name: record.after}
                if record.name == TAU and not isinstance(record.after, str):
                    reading.tau = float(record.after)

    def fold_all(self, records: Iterable[Record]) -> "NightFrames":
        """Fold all records of a log; return this object."""
        for record in records:
            self.fold_record(record)
        self.close()
        return self

    def frame_by_id(self, frame_id: int) -> NightFrame:
        """Return the frame as recorded so far; an empty frame where it is no longer kept.

        Use the result at once: the next record may change it in place.
        """
        return self._frames.get(frame_id, _EMPTY)

    def kept_frames(self) -> Iterator[NightFrame]:
        """Yield the kept frames in order of the log; later records do not change them."""
        self._own.clear()
        yield from self._frames.values()

    def checkpoint(self) -> tuple[Any, ...]:
        """Return a checkpoint of the present state, to return to later."""
        return self._reading.copy(), tuple(self.kept_frames()), self._past

    def restore(self, kept: tuple[Any, ...]) -> None:
        """Return to a checkpoint made by this object or by another one for the same night."""
        reading, frames, self._past = kept
        self._reading = reading.copy()
        self._own.clear()
        self.changed.clear()
        self._frames = {frame.frame_id: frame for frame in frames}

    def _begin(self, record: FrameTaken, t_utc_ns: int) -> None:
        self.close()
        self._own.clear()
        reading, frame_id = self._reading, record.frame_id
        self._frames.pop(frame_id, None)
        begun = self._frames[frame_id] = NightFrame(
            frame_id=frame_id,
            began_utc_ns=record.t_start_utc_ns or t_utc_ns,
            state_before=reading.state,
            tau=reading.tau,
            taken=record,
        )
        self._own[id(begun)] = begun
        self.changed.add(frame_id)
        reading.awaited = frame_id
        reading.marked = {n: last for n, last in reading.marked.items() if last >= frame_id}
        while self._newest is not None and len(self._frames) > self._newest:
            oldest = next(iter(self._frames))
            if oldest >= min(reading.marked, default=frame_id):
                break
            past = self._frames.pop(oldest)
            reading.again.discard(oldest)
            self._past = max(self._past, past.frame_id)
            self._on_past(past)

    def _mark(self, arguments: Mapping[str, Any]) -> None:
        """Keep a frame while a mark is made in it, and a little longer: that may be undone."""
        frame_id = arguments.get("frame")
        if isinstance(frame_id, int):
            frames = MARKED_FOR if arguments.get("on", True) else NEWEST
            last = max(self._frames, default=0) + frames
            self._reading.marked = {**self._reading.marked, frame_id: last}

    def _track_state(self, record: TrackState) -> None:
        frame = self.frame_by_id(record.frame_id)
        what = "predicted" if record.kind == "predicted" else "updated"
        of_track: dict[str, Any] = {what: record, "is_lead": record.is_lead}
        tracks = {each.track_id: each for each in frame.tracks}
        blank = FrameTrack(track_id=record.track_id, is_lead=record.is_lead)
        tracks[record.track_id] = replace(tracks.get(record.track_id, blank), **of_track)
        of_lead = {what: record} if record.is_lead else {}
        self._change(record.frame_id, tracks=tuple(tracks.values()), **of_lead)

    def _measurement(self, record: Measurement) -> None:
        before = self.frame_by_id(record.frame_id).measurements
        # The fold records a faint one with each track that takes it.
        known = {each.measurement_id for each in before}
        if record.source != "faint" or record.measurement_id not in known:
            self._append("measurements", record)

    def _decision(self, record: Ruling) -> None:
        # Marks before this one count no more.
        measured = self.frame_by_id(record.frame_id).measurements
        left = tuple(each for each in measured if each.source != "operator")
        self._change(record.frame_id, decision=record, measurements=left)
        self._reading.is_ruled = self._reading.is_first_again = True

    def _followed_again(self, record: FollowedAgain) -> None:
        reading, frame_id = self._reading, record.frame_id
        reading.is_ruled = False
        frame = self.frame_by_id(frame_id)
        nothing: dict[str, Any] = dict.fromkeys(
            ("tracks", "not_followed", "misses", "orbits", "names"), ()
        )
        self._own.pop(id(frame), None)
        # Of those below tau the fold records again what a track takes now.
        nothing["measurements"] = tuple(m for m in frame.measurements if m.source != "faint")
        self._change(frame_id, predicted=None, updated=None, first=frame, **nothing)
        if frame_id in reading.again and frame.fold is not None:
            is_first, reading.is_first_again = reading.is_first_again, False
            self._open(frame_id, frame.fold.before if is_first else reading.fold_state)

    def _state_change(self, record: StateChange) -> None:
        if is_external_change(record):
            self.close()
            self._reading.again, self._reading.marked = set(), {}
            self._reading.fold_state = record.after
        else:
            self._fold(record)
        self._reading.state = record.after
        self._append("changes", record)

    def _fold(self, record: Record) -> None:
        """Add to the open fold, unless the record is an instrument's or a decision's."""
        reading = self._reading
        if reading.open is None:
            return
        is_word = isinstance(record, StateChange) and reading.is_ruled
        if is_word or (isinstance(record, Miss) and is_instrument_miss(record)):
            return
        reading.records.append(record)

    def _open(self, frame_id: int, before: LoopState) -> None:
        reading = self._reading
        reading.open, reading.before, reading.records = frame_id, before, []

    def close(self) -> None:
        """Complete the frame whose records are being read, because no more of them follow."""
        reading = self._reading
        if reading.open is None:
            return
        frame_id, reading.open, reading.awaited = reading.open, None, None
        if reading.before not in FOLDED or not self.frame_by_id(frame_id).has_time:
            return
        reading.again.add(frame_id)
        fold = FrameFold(before=reading.before, records=tuple(reading.records))
        reading.fold_state = fold.state_after
        self._change(frame_id, fold=fold)

    def _expect(self, frame_id: int) -> None:
        """Make a frame of an exposure that failed, for the records of it."""
        if frame_id not in self._frames and frame_id > self._past:
            state = self._reading.state
            self._frames[frame_id] = NightFrame(frame_id=frame_id, state_before=state)

    def _append(
        self,
        name: str,
        record: Measurement | NotFollowed | Miss | OrbitEstimate | Identified | StateChange,
    ) -> None:
        before = getattr(self.frame_by_id(record.frame_id), name)
        self._change(record.frame_id, **{name: (*before, record)})

    def _change(self, frame_id: int, **changes: Any) -> None:
        frame = self._frames.get(frame_id)
        if frame is None:
            return  # long past, or of no frame
        self.changed.add(frame_id)
        if id(frame) in self._own:
            for name, value in changes.items():
                object.__setattr__(frame, name, value)
            return
        made = replace(frame, **changes)
        self._frames[frame_id] = self._own[id(made)] = made


def frames_of(records: Iterable[Record], config: Config | None = None) -> tuple[NightFrame, ...]:
    """Return the frames of a whole log; ``config``: the settings that the session began with."""
    return tuple(NightFrames(config).fold_all(records).kept_frames())


def is_external_change(change: StateChange) -> bool:
    """Return True if operator, instruments or limits changed the loop's state, not the fold."""
    is_between_folded = change.before in FOLDED and change.after in FOLDED
    return not is_between_folded or change.reason.kind in FROM_OUTSIDE


def is_instrument_miss(miss: Miss) -> bool:
    """Return True if a miss is an instrument's failure, so that there was no frame to fold."""
    return miss.reason.kind == "instrument"
