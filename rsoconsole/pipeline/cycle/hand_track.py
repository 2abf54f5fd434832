"""A track made of the operator's word on frames that nobody followed. Pure but for its memory.

While autonomy does not have the mount, frames are looked at and not followed. What the operator
marks or chooses in two of them starts a track as two detections do; it is kept, and followed once
the mount is given back. Engine and replay keep one of these each: they come to the same track.
"""

from dataclasses import dataclass, replace

from rsoconsole.config import Config
from rsoconsole.pipeline.cycle.decisions import KEPT, Fold, LastFrames, Looked
from rsoconsole.pipeline.cycle.frame_fold import Folded, Shown, fold
from rsoconsole.pipeline.cycle.miss_reasons import StarHistory
from rsoconsole.pipeline.frame import HELD, shutter_mid_utc_ns
from rsoconsole.records import Measurement, Ruling, StateChange
from rsoconsole.tracking.association import Following


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
