"""The operator's decisions on frames already folded, which are then folded again, in order.

Engine and replay each keep the last frames in such an object, and so arrive at the same track.
"""

import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Generic, TypeVar

from rsoconsole.config import Config
from rsoconsole.pipeline.cycle.frame_fold import (
    FoldedFrame,
    FrameObservations,
    ReducedFrame,
    fold_frame,
)
from rsoconsole.pipeline.cycle.miss_reasons import StarHistory
from rsoconsole.pipeline.frame.marked_frames import HELD
from rsoconsole.pipeline.frame.measurement import mid_exposure_utc_ns
from rsoconsole.records import FollowedAgain, Measurement, Record, Ruling, StateChange
from rsoconsole.tracking import Following

KEPT = 12
TAKEN_BACK = 60
"""Number of further frames for which a decision on a held frame can be taken back."""


def decision_records(
    decision: Ruling, again: Sequence[tuple[int, tuple[Record, ...]]]
) -> tuple[Record, ...]:
    """Return the records of a decision and of the frames folded again, in log order.

    ``again``: (number of the frame, its records) for each frame folded again.
    """
    records: list[Record] = [decision]
    if decision.taken is not None and decision.taken.source == "operator":
        records.append(decision.taken)
    for frame_id, folded in again:
        records += [FollowedAgain(frame_id=frame_id), *folded]
    return tuple(records)


OfFrame = TypeVar("OfFrame", bound=ReducedFrame)


class LastFrames(Generic[OfFrame]):
    """The last frames, on which the operator may decide, and older ones held for a decision."""

    DONE: ClassVar[str]
    """Past participle for these frames in messages: "followed" or "looked at"."""

    def __init__(self, after_word: int) -> None:
        """``after_word``: number of further frames that a held frame stays after its decision."""
        self._frames: tuple[OfFrame, ...] = ()
        self._held: Mapping[int, int] = {}
        """Held frames, each with the number of further frames that it stays."""
        # Both are replaced as a whole, never changed: other threads look in.
        self._after_word = after_word
        self._lock = threading.Lock()

    def hold_frame(self, frame_id: int) -> None:
        """Hold a frame for a decision; may be called from any thread.

        The frame is one of the last frames or still to come; another number has no effect.
        """
        with self._lock:
            self._held = {**self._held, frame_id: HELD}

    def release_frame(self, frame_id: int) -> None:
        """Release a held frame; may be called from any thread.

        A frame with a decision stays for as long as the decision may be taken back.
        """
        with self._lock:
            if any(each.frame_id == frame_id for each in self.decisions()):
                self._hold_ruled(frame_id)
            else:
                self._held = {n: left for n, left in self._held.items() if n != frame_id}

    def shown(self, frame_id: int) -> FrameObservations:
        """Observations of a frame. Raises ValueError where no decision on it is possible."""
        frames = self._open()
        return frames[self._place(frames, frame_id)].observations

    def newest_observations(self) -> FrameObservations:
        """Observations of the last frame. Raises ValueError where there is none."""
        frames = self._frames
        if not frames:
            raise ValueError(f"no frame has been {self.DONE} yet that a word could be said on")
        return frames[-1].observations

    def decisions(self) -> tuple[Ruling, ...]:
        """The operator's decisions on these frames, oldest first."""
        return tuple(
            f.observations.decision for f in self._open() if f.observations.decision is not None
        )

    def last_decided_frame_id(self) -> int | None:
        """Return the number of the newest frame with a decision; None where there is none."""
        said = self.decisions()
        return said[-1].frame_id if said else None

    def frame_ids(self) -> tuple[int, ...]:
        """Numbers of the frames on which a decision is possible, oldest first."""
        return tuple(each.frame_id for each in self._open())

    def _hold_ruled(self, frame_id: int) -> None:
        """Hold a decided frame for as long as its decision may be taken back."""
        if frame_id in self._held:
            self._held = {**self._held, frame_id: self._after_word}

    def _count_frame(self) -> None:
        self._held = {n: left - 1 for n, left in self._held.items() if left > 1}

    def _open(self) -> tuple[OfFrame, ...]:
        """Return the frames on which a decision is still possible."""
        return self._frames

    def _within_reach(self, frames: tuple[OfFrame, ...]) -> tuple[OfFrame, ...]:
        """Return the last frames and the held ones."""
        first = len(frames) - KEPT
        return tuple(
            each for n, each in enumerate(frames) if n >= first or each.frame_id in self._held
        )

    def _place(self, frames: tuple[OfFrame, ...], frame_id: int) -> int:
        for number, each in enumerate(frames):
            if each.frame_id == frame_id:
                return number
        raise ValueError(self._why_not(frames, frame_id))

    def _why_not(self, frames: tuple[OfFrame, ...], frame_id: int) -> str:
        """Return the message why no decision on a frame is possible."""
        raise NotImplementedError


class FollowedFrames(LastFrames[FoldedFrame]):
    """The last tracked frames, since the last event from outside that changed the track.

    While a frame is held (the operator is marking in it), all later frames are kept too, because a
    decision on the held frame folds them again. A decision is possible on held frames and on the
    last ``KEPT`` frames alone.
    """

    DONE = "followed"

    def __init__(self) -> None:
        super().__init__(TAKEN_BACK)

    def add(self, folded: FoldedFrame) -> None:
        """Add a folded frame, and drop frames that no decision needs any longer."""
        with self._lock:
            self._count_frame()
            frames = (*self._frames, folded)
            oldest = self._within_reach(frames)[0].frame_id
            self._frames = frames[self._place(frames, oldest) :]

    def forget(self) -> None:
        """Forget all frames, because an event from outside has changed the track."""
        with self._lock:
            self._frames = ()
            self._held = {}

    def accepted_measurement(self, frame_id: int) -> Measurement | None:
        """Return the measurement that the track accepted in a frame; None where it accepted none.

        Raises ValueError where no decision on the frame is possible.
        """
        frames = self._open()
        taken = frames[self._place(frames, frame_id)].following.lead_measured
        return taken if taken is not None and taken.frame_id == frame_id else None

    def apply(self, decision: Ruling) -> tuple[FoldedFrame, ...]:
        """Fold the frame of a decision and all later frames again; return them in order.

        Raises ValueError where no decision on the frame is possible.
        """
        place = self._place(self._frames, decision.frame_id)
        before = self._frames[place].before
        again: list[FoldedFrame] = []
        for old in self._frames[place:]:
            observed = old.observations
            if not again:
                observed = _decided(observed, decision)
            again.append(fold_frame(before, old.stars_before, observed, old.config))
            before = again[-1].following
        self._frames = (*self._frames[:place], *again)
        with self._lock:
            self._hold_ruled(decision.frame_id)
        return tuple(again)

    def _open(self) -> tuple[FoldedFrame, ...]:
        return self._within_reach(self._frames)

    def _why_not(self, frames: tuple[FoldedFrame, ...], frame_id: int) -> str:
        known = [each.frame_id for each in frames[-KEPT:]]
        reach = f", only on frames {known[0]} to {known[-1]}" if known else " until the next one"
        return f"nothing can be said on frame {frame_id} any more{reach}"


@dataclass(frozen=True, slots=True, kw_only=True)
class _Made:
    """State after the marks so far."""

    kept: Following | None
    candidates: tuple[Measurement, ...] = ()
    last_track_id: int


class UntrackedFrames(LastFrames[ReducedFrame]):
    """The last frames that belong to no track, in which an object may be marked by hand."""

    DONE = "looked at"

    def __init__(self) -> None:
        super().__init__(HELD)  # the second mark of a track may take as long as the first
        self._base: _Made | None = None
        """State before the first decision; None while there was none."""

    def add(self, observed: FrameObservations, config: Config) -> None:
        """Add a frame; a frame without a time is ignored, as it cannot be part of a track."""
        if mid_exposure_utc_ns(observed.taken, config.exposure) is not None:
            plain = replace(observed, orbits={}, decision=None, decisions=0)
            with self._lock:
                self._count_frame()
                looked = (*self._frames, ReducedFrame(observations=plain, config=config))
                self._frames = self._within_reach(looked)

    def forget(self) -> None:
        """Forget all decisions, because control has changed; the track made by them stays."""
        self._base = None
        with self._lock:
            self._held = {}
            self._frames = tuple(
                replace(each, observations=replace(each.observations, decision=None))
                for each in self._frames
            )[-KEPT:]

    def accepted_measurement(self, frame_id: int) -> Measurement | None:
        """Return the measurement that the operator marked in a frame; None where there is none.

        Raises ValueError where no decision on the frame is possible.
        """
        decision = self.shown(frame_id).decision
        return None if decision is None else decision.taken

    def apply(
        self, decision: Ruling, kept: Following | None, last_track_id: int
    ) -> tuple[Following | None, list[tuple[int, tuple[Record, ...]]]]:
        """Apply the operator's decision on a frame; return the track and the frames folded again.

        ``kept``: track before the first decision; ``last_track_id``: last id given in the session.
        Each folded frame is returned as (number, records). Raises ValueError where no decision on
        the frame is possible.
        """
        place = self._place(self._frames, decision.frame_id)
        old = self._frames[place]
        decided = replace(old, observations=_decided(old.observations, decision))
        self._frames = (*self._frames[:place], decided, *self._frames[place + 1 :])
        with self._lock:
            self._hold_ruled(decision.frame_id)
        if self._base is None:
            self._base = _Made(kept=kept, last_track_id=last_track_id)
        made, again = self._base, list[tuple[int, tuple[Record, ...]]]()
        for number, each in enumerate(self._frames):
            if each.observations.decision is None:
                continue
            made, records = _with(made, each)
            if number >= place:
                again.append((each.frame_id, records))
        return made.kept, again

    def _why_not(self, _frames: tuple[ReducedFrame, ...], frame_id: int) -> str:
        return f"frame {frame_id} is none of those looked at since nobody follows: mark a newer one"


def _decided(observed: FrameObservations, decision: Ruling) -> FrameObservations:
    return replace(observed, decision=decision, decisions=observed.decisions + 1)


def _with(made: _Made, marked: ReducedFrame) -> tuple[_Made, tuple[Record, ...]]:
    """Add one marked frame: the second of a track, one of a kept track, or a first."""
    decision = marked.observations.decision
    if decision is None or decision.taken is None:
        return made, ()
    if made.candidates:
        following, records = _folded(_waiting(made), marked)
        if following.track is not None:
            return _begun(following), records
        if not _goes_on(made, marked):
            return replace(made, candidates=following.candidates), records
    if made.kept is not None and _goes_on(made, marked):
        before = replace(made.kept, state="COAST", candidates=())
        following, records = _folded(before, marked)
        if following.track_id == made.kept.track_id:
            return _begun(following), records
    following, records = _folded(_waiting(replace(made, candidates=())), marked)
    return replace(made, candidates=following.candidates), records


def _goes_on(made: _Made, marked: ReducedFrame) -> bool:
    """True where a frame is later than the whole kept track."""
    if made.kept is None or made.kept.track is None:
        return False
    t_mid_ns = mid_exposure_utc_ns(marked.observations.taken, marked.config.exposure)
    return t_mid_ns is not None and t_mid_ns > made.kept.track.t_utc_ns


def _waiting(made: _Made) -> Following:
    return Following(
        state="ACQUIRE" if made.candidates else "SEARCH",
        candidates=made.candidates,
        last_track_id=made.last_track_id,
    )


def _begun(following: Following) -> _Made:
    return _Made(kept=following, last_track_id=following.last_track_id)


def _folded(before: Following, marked: ReducedFrame) -> tuple[Following, tuple[Record, ...]]:
    """Fold a frame with the operator's mark alone; changes of state are left out of the records."""
    found = replace(marked.observations.detections, rejected=())
    observed = replace(marked.observations, measurements=(), detections=found)
    folded = fold_frame(before, StarHistory(), observed, marked.config)
    kept = tuple(each for each in folded.records if not isinstance(each, StateChange))
    return folded.following, kept
