"""The operator's word on frames already followed: they are followed again by it, in order.

Pure but for its memory of the last frames. Engine and replay keep one each, and so come to the
same track.
"""

import threading
from dataclasses import dataclass, replace

from rsoconsole.config import Config
from rsoconsole.pipeline.cycle.frame_fold import Folded, Shown, fold
from rsoconsole.pipeline.cycle.miss_reasons import StarHistory
from rsoconsole.pipeline.frame import HeldFrames
from rsoconsole.records import FollowedAgain, Measurement, Record, Ruling
from rsoconsole.tracking.association import Following

KEPT = 12
"""Frames that a word may still be said on: some minutes."""
TAKEN_BACK = 60
"""Frames within which a word on a frame that was held for it can be taken back."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Fold:
    """One frame that was followed: what went in and what came out."""

    before: Following
    stars_before: StarHistory
    shown: Shown
    config: Config
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


class Folds:
    """The last frames followed without anything from outside between them.

    Where one is held (somebody is marking in it), all since then are kept: they are followed
    again by the word on it.
    """

    def __init__(self) -> None:
        self._folds: tuple[Fold, ...] = ()
        # Replaced as a whole, never changed: other threads look in.
        self._held = HeldFrames(TAKEN_BACK)
        self._lock = threading.Lock()

    def add(self, fold_: Fold) -> None:
        """One more frame."""
        with self._lock:
            self._held.count()
            folds = (*self._folds, fold_)
            first = max(len(folds) - KEPT, 0)
            self._folds = folds[min((first, *self._held_places(folds))) :]

    def _held_places(self, folds: tuple[Fold, ...]) -> list[int]:
        return [n for n, each in enumerate(folds) if each.shown.taken.frame_id in self._held]

    def hold(self, frame_id: int) -> None:
        """Keep a frame to be ruled on, if it is there still or comes (any thread)."""
        with self._lock:
            self._held.hold(frame_id)

    def let_go(self, frame_id: int) -> None:
        """It need not be kept any more (any thread)."""
        with self._lock:
            is_ruled = any(r.frame_id == frame_id for r in self.decisions())
            (self._held.ruled if is_ruled else self._held.let_go)(frame_id)

    def forget(self) -> None:
        """Something from outside has changed what is followed: these do not lead there."""
        with self._lock:
            self._folds = ()
            self._held.forget()

    def shown(self, frame_id: int) -> Shown:
        """What a frame showed. Raises ValueError where nothing can be said on it any more."""
        return self._fold(frame_id).shown

    def taken(self, frame_id: int) -> Measurement | None:
        """What the track took of a frame. Raises ValueError as ``shown`` does."""
        taken = self._fold(frame_id).folded.following.taken
        return taken if taken is not None and taken.frame_id == frame_id else None

    def said_last(self) -> int | None:
        """The newest frame that a word was said on; None where there is none."""
        said = [f.shown.taken.frame_id for f in self._open() if f.shown.decision is not None]
        return said[-1] if said else None

    def decisions(self) -> tuple[Ruling, ...]:
        """The operator's words on these frames, oldest first."""
        return tuple(f.shown.decision for f in self._open() if f.shown.decision is not None)

    def newest(self) -> Shown:
        """The last frame. Raises ValueError where there is none."""
        folds = self._folds
        if not folds:
            raise ValueError("no frame has been followed yet that a word could be said on")
        return folds[-1].shown

    def frame_ids(self) -> tuple[int, ...]:
        """The frames on which something can still be said, oldest first."""
        return tuple(each.shown.taken.frame_id for each in self._open())

    def _open(self) -> tuple[Fold, ...]:
        """The last ones and those that are held; what is kept between them is not to be said on."""
        folds = self._folds  # another thread may put others in their place meanwhile
        first = len(folds) - KEPT
        return tuple(
            each
            for n, each in enumerate(folds)
            if n >= first or each.shown.taken.frame_id in self._held
        )

    def rule(self, decision: Ruling) -> tuple[Fold, ...]:
        """The frame and those after it, followed again. Raises ValueError as ``shown`` does."""
        place = _place(self._folds, decision.frame_id)
        before = self._folds[place].before
        again: list[Fold] = []
        for old in self._folds[place:]:
            shown = old.shown
            if not again:
                shown = replace(shown, decision=decision, decisions=shown.decisions + 1)
            folded = fold(before, old.stars_before, shown, old.config)
            again.append(replace(old, before=before, shown=shown, folded=folded))
            before = folded.following
        self._folds = (*self._folds[:place], *again)
        with self._lock:
            self._held.ruled(decision.frame_id)
        return tuple(again)

    def _fold(self, frame_id: int) -> Fold:
        folds = self._open()
        return folds[_place(folds, frame_id)]


def _place(folds: tuple[Fold, ...], frame_id: int) -> int:
    for number, each in enumerate(folds):
        if each.shown.taken.frame_id == frame_id:
            return number
    known = [each.shown.taken.frame_id for each in folds[-KEPT:]]
    reach = f", only on frames {known[0]} to {known[-1]}" if known else " until the next one"
    raise ValueError(f"nothing can be said on frame {frame_id} any more{reach}")
