"""The operator's word on frames already followed: they are followed again by it, in order.

Pure but for its memory of the last frames. Engine and replay keep one each, and so come to the
same track.
"""

import threading
from dataclasses import dataclass, replace
from typing import ClassVar, Generic, TypeVar

from rsoconsole.config import Config
from rsoconsole.pipeline.cycle.frame_fold import Folded, Shown, fold
from rsoconsole.pipeline.cycle.miss_reasons import StarHistory
from rsoconsole.pipeline.frame.held_frames import HELD, HeldFrames
from rsoconsole.pipeline.frame.measurement import shutter_mid_utc_ns
from rsoconsole.records import FollowedAgain, Measurement, Record, Ruling, StateChange
from rsoconsole.tracking import Following

KEPT = 12
"""Frames that a word may still be said on: some minutes."""
TAKEN_BACK = 60
"""Frames within which a word on a frame that was held for it can be taken back."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Looked:
    """One frame that was looked at."""

    shown: Shown
    config: Config


@dataclass(frozen=True, slots=True, kw_only=True)
class Fold(Looked):
    """One frame that was followed: what went in and what came out."""

    before: Following
    stars_before: StarHistory
    folded: Folded


def on_record_again(decision: Ruling, again: tuple[Fold, ...]) -> tuple[Record, ...]:
    """A decision and all that it leads to, in the order of the record."""
    records: list[Record] = [decision]
    if decision.taken is not None and decision.taken.source == "operator":
        records.append(decision.taken)
    for each in again:
        records.append(FollowedAgain(frame_id=each.shown.taken.frame_id))
        records.extend(each.folded.records)
    return tuple(records)


OfFrame = TypeVar("OfFrame", bound=Looked)


class LastFrames(Generic[OfFrame]):
    """The last frames on which something may be said, those that are held among them."""

    DONE: ClassVar[str]
    """What was done with them, in words."""

    def __init__(self, after_word: int) -> None:
        """``after_word``: for how many frames one is held once a word has been said on it."""
        self._frames: tuple[OfFrame, ...] = ()
        # Replaced as a whole, never changed: other threads look in.
        self._held = HeldFrames(after_word)
        self._lock = threading.Lock()

    def hold(self, frame_id: int) -> None:
        """Keep a frame to be ruled on, if it is there still or comes (any thread)."""
        with self._lock:
            self._held.hold(frame_id)

    def let_go(self, frame_id: int) -> None:
        """It need not be kept any more (any thread)."""
        with self._lock:
            is_ruled = any(each.frame_id == frame_id for each in self.decisions())
            (self._held.ruled if is_ruled else self._held.let_go)(frame_id)

    def shown(self, frame_id: int) -> Shown:
        """What a frame showed. Raises ValueError where nothing can be said on it any more."""
        frames = self._open()
        return frames[self._place(frames, frame_id)].shown

    def newest(self) -> Shown:
        """The last frame. Raises ValueError where there is none."""
        frames = self._frames
        if not frames:
            raise ValueError(f"no frame has been {self.DONE} yet that a word could be said on")
        return frames[-1].shown

    def decisions(self) -> tuple[Ruling, ...]:
        """The operator's words on these frames, oldest first."""
        return tuple(f.shown.decision for f in self._open() if f.shown.decision is not None)

    def said_last(self) -> int | None:
        """The newest frame that a word was said on; None where there is none."""
        said = self.decisions()
        return said[-1].frame_id if said else None

    def frame_ids(self) -> tuple[int, ...]:
        """The frames on which something can still be said, oldest first."""
        return tuple(each.shown.taken.frame_id for each in self._open())

    def _open(self) -> tuple[OfFrame, ...]:
        """Those on which something can still be said."""
        return self._frames

    def _within_reach(self, frames: tuple[OfFrame, ...]) -> tuple[OfFrame, ...]:
        """The last ones and those that are held."""
        first = len(frames) - KEPT
        return tuple(
            each
            for n, each in enumerate(frames)
            if n >= first or each.shown.taken.frame_id in self._held
        )

    def _place(self, frames: tuple[OfFrame, ...], frame_id: int) -> int:
        for number, each in enumerate(frames):
            if each.shown.taken.frame_id == frame_id:
                return number
        raise ValueError(self._why_not(frames, frame_id))

    def _why_not(self, frames: tuple[OfFrame, ...], frame_id: int) -> str:
        """In words, why nothing can be said on a frame."""
        raise NotImplementedError


class Folds(LastFrames[Fold]):
    """The last frames followed without anything from outside between them.

    Where one is held (somebody is marking in it), all since then are kept, to be followed again by
    the word on it; what is kept between is not to be said on.
    """

    DONE = "followed"

    def __init__(self) -> None:
        super().__init__(TAKEN_BACK)

    def add(self, fold_: Fold) -> None:
        """One more frame."""
        with self._lock:
            self._held.count()
            frames = (*self._frames, fold_)
            oldest = self._within_reach(frames)[0].shown.taken.frame_id
            self._frames = frames[self._place(frames, oldest) :]

    def forget(self) -> None:
        """Something from outside has changed what is followed: these do not lead there."""
        with self._lock:
            self._frames = ()
            self._held.forget()

    def taken(self, frame_id: int) -> Measurement | None:
        """What the track took of a frame. Raises ValueError as ``shown`` does."""
        frames = self._open()
        taken = frames[self._place(frames, frame_id)].folded.following.taken
        return taken if taken is not None and taken.frame_id == frame_id else None

    def rule(self, decision: Ruling) -> tuple[Fold, ...]:
        """The frame and those after it, followed again. Raises ValueError as ``shown`` does."""
        place = self._place(self._frames, decision.frame_id)
        before = self._frames[place].before
        again: list[Fold] = []
        for old in self._frames[place:]:
            shown = old.shown
            if not again:
                shown = replace(shown, decision=decision, decisions=shown.decisions + 1)
            folded = fold(before, old.stars_before, shown, old.config)
            again.append(replace(old, before=before, shown=shown, folded=folded))
            before = folded.following
        self._frames = (*self._frames[:place], *again)
        with self._lock:
            self._held.ruled(decision.frame_id)
        return tuple(again)

    def _open(self) -> tuple[Fold, ...]:
        return self._within_reach(self._frames)

    def _why_not(self, frames: tuple[Fold, ...], frame_id: int) -> str:
        known = [each.shown.taken.frame_id for each in frames[-KEPT:]]
        reach = f", only on frames {known[0]} to {known[-1]}" if known else " until the next one"
        return f"nothing can be said on frame {frame_id} any more{reach}"


@dataclass(frozen=True, slots=True, kw_only=True)
class _Made:
    """What the marks so far come to."""

    kept: Following | None
    candidates: tuple[Measurement, ...] = ()
    last_track_id: int


class HandTrack(LastFrames[Looked]):
    """The last frames that were looked at, and what the operator said of them."""

    DONE = "looked at"

    def __init__(self) -> None:
        super().__init__(HELD)  # the second mark of a track may take as long as the first
        self._base: _Made | None = None
        """Before the first word; None while none was said."""

    def add(self, shown: Shown, config: Config) -> None:
        """One more frame; one without a time can be no part of a track."""
        if shutter_mid_utc_ns(shown.taken, config.exposure) is not None:
            plain = replace(shown, orbits={}, decision=None, decisions=0)
            with self._lock:
                self._held.count()
                looked = (*self._frames, Looked(shown=plain, config=config))
                self._frames = self._within_reach(looked)

    def forget(self) -> None:
        """Somebody else has the mount: what was said led to what is kept, and to no more."""
        self._base = None
        with self._lock:
            self._held.forget()
            self._frames = tuple(
                replace(each, shown=replace(each.shown, decision=None)) for each in self._frames
            )[-KEPT:]

    def taken(self, frame_id: int) -> Measurement | None:
        """What the operator gave of a frame. Raises ValueError as ``shown`` does."""
        decision = self.shown(frame_id).decision
        return None if decision is None else decision.taken

    def rule(
        self, decision: Ruling, kept: Following | None, last_track_id: int
    ) -> tuple[Following | None, tuple[Fold, ...]]:
        """The operator's word on a frame: (the track that is kept now, frames followed by it).

        ``kept``: what was kept before the first word; ``last_track_id``: of the session. Raises
        ValueError as ``shown`` does.
        """
        place = self._place(self._frames, decision.frame_id)
        old = self._frames[place]
        shown = replace(old.shown, decision=decision, decisions=old.shown.decisions + 1)
        self._frames = (
            *self._frames[:place],
            replace(old, shown=shown),
            *self._frames[place + 1 :],
        )
        with self._lock:
            self._held.ruled(decision.frame_id)
        if self._base is None:
            self._base = _Made(kept=kept, last_track_id=last_track_id)
        made, again = self._base, list[Fold]()
        for number, looked in enumerate(self._frames):
            if looked.shown.decision is None:
                continue
            before = made
            made, folded = _with(made, looked)
            if number >= place:
                again.append(_fold_of(before, looked, folded))
        return made.kept, tuple(again)

    def _why_not(self, _frames: tuple[Looked, ...], frame_id: int) -> str:
        return f"frame {frame_id} is none of those looked at since nobody follows: mark a newer one"


def _with(made: _Made, looked: Looked) -> tuple[_Made, Folded]:
    """One marked frame more: the second of a track, one of a track that is kept, or a first."""
    decision = looked.shown.decision
    nothing = Folded(following=Following(state="MANUAL"), stars=StarHistory(), records=())
    if decision is None or decision.taken is None:
        return made, nothing
    if made.candidates:
        folded = _folded(_waiting(made), looked)
        if folded.following.track is not None:
            return _begun(folded), folded
        if not _goes_on(made, looked):
            return replace(made, candidates=folded.following.candidates), folded
    if made.kept is not None and _goes_on(made, looked):
        before = replace(made.kept, state="COAST", candidates=())
        folded = _folded(before, looked)
        if folded.following.track_id == made.kept.track_id:
            return _begun(folded), folded
    folded = _folded(_waiting(replace(made, candidates=())), looked)
    return replace(made, candidates=folded.following.candidates), folded


def _goes_on(made: _Made, looked: Looked) -> bool:
    """Whether a frame comes after all that the kept track has."""
    if made.kept is None or made.kept.track is None:
        return False
    t_mid_ns = shutter_mid_utc_ns(looked.shown.taken, looked.config.exposure)
    return t_mid_ns is not None and t_mid_ns > made.kept.track.t_utc_ns


def _waiting(made: _Made) -> Following:
    state = "ACQUIRE" if made.candidates else "SEARCH"
    return Following(
        state=state,  # type: ignore[arg-type]
        candidates=made.candidates,
        last_track_id=made.last_track_id,
    )


def _begun(folded: Folded) -> _Made:
    return _Made(kept=folded.following, last_track_id=folded.following.last_track_id)


def _folded(before: Following, looked: Looked) -> Folded:
    """By what the operator gave alone; who has the mount does not change by it."""
    folded = fold(before, StarHistory(), replace(looked.shown, measurements=()), looked.config)
    kept = tuple(each for each in folded.records if not isinstance(each, StateChange))
    return replace(folded, records=kept)


def _fold_of(before: _Made, looked: Looked, folded: Folded) -> Fold:
    return Fold(
        before=before.kept or _waiting(before),
        stars_before=StarHistory(),
        shown=looked.shown,
        config=looked.config,
        folded=folded,
    )
