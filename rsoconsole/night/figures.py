"""How well a night was followed, in figures: as recorded, and as with other settings."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any, NamedTuple

from rsoconsole.night.frame import NightFrame, was_pointed_at
from rsoconsole.night.frames import NEWEST, NightFrames
from rsoconsole.night.quality import Quality, Update, quality_of, updates_of
from rsoconsole.records import (
    FrameTaken,
    LoopState,
    Miss,
    NotSolved,
    Record,
    Solution,
    StateChange,
    TrackState,
)
from rsoconsole.tracking import three_sigma_deg

CURVE_FRAMES = 40
"""Of the curve of what a setting changes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackFigures(Quality):
    """Of the frames looked at; None where there is nothing to go by."""

    frames: int
    """Folded ones: not those that were taken while the operator had the mount."""
    locked_after_frames: int | None
    """Number of the first frame in TRACK."""
    locked_after_s: float | None
    """From the middle of the first frame to the middle of that one."""
    lock_held: float | None
    """Share of the frames after that one that ended in TRACK."""
    misses: int
    losses: int
    """How often what was followed was given up as lost."""
    max_3sigma_arcmin: float | None
    """Of the predictions for a frame, the widest."""
    state: str
    """After the last frame."""
    carried_by_orbit: int = 0
    """Updates whose prediction was the orbit's, because the filter's had failed."""
    states: Mapping[str, int] = field(default_factory=dict)
    """How many frames ended in each."""
    nis_curve: tuple[float | None, ...] = ()
    """NIS of the lead in each of the last ``CURVE_FRAMES`` frames; None: not measured there."""


class _Frame(NamedTuple):
    """What figures need of a frame: a night of 50,000 has room."""

    frame_id: int
    t_mid_utc_ns: int | None
    state: LoopState
    is_chosen: bool
    updates: tuple[Update, ...]
    by_orbit: int
    """Those of them that the orbit predicted."""
    misses: int
    losses: int
    widest_3sigma_deg: float | None
    nis_of_lead: float | None


class FigureSum:
    """Figures of a night, frame by frame: nothing else of a frame is kept."""

    def __init__(self, *, of_lead: bool = False) -> None:
        """``of_lead`` as ``as_recorded``."""
        self._of_lead = of_lead
        self._frames: dict[int, _Frame] = {}

    def __len__(self) -> int:
        return len(self._frames)

    def add(
        self,
        taken: FrameTaken,
        folded: Sequence[Record],
        state: LoopState,
        solution: Solution | NotSolved | None,
    ) -> None:
        """One frame more, or one that was followed again: what counts in the end.

        ``folded``: what the fold made of it, TrackState, NotFollowed, Miss, StateChange, in order;
        ``state``: after it.
        """
        records = _of_lead(folded) if self._of_lead else folded
        tracks = [r for r in records if isinstance(r, TrackState)]
        sigmas_deg = [three_sigma_deg(r) for r in tracks if r.kind == "predicted"]
        self._frames[taken.frame_id] = _Frame(
            frame_id=taken.frame_id,
            t_mid_utc_ns=taken.t_mid_utc_ns,
            state=state,
            is_chosen=not self._of_lead or was_pointed_at(folded, solution, taken),
            updates=tuple(updates_of(tracks)),
            by_orbit=sum(r.foretold_by == "orbit" for r in tracks if r.innovation_arcsec),
            misses=sum(isinstance(record, Miss) for record in records),
            losses=sum(isinstance(r, StateChange) and r.after == "LOST" for r in records),
            widest_3sigma_deg=max(sigmas_deg, default=None),
            nis_of_lead=_nis_of_lead(folded),
        )

    def add_recorded(self, frame: NightFrame) -> None:
        """A frame as it is on record; one that was only looked at changes nothing."""
        if frame.taken is not None and frame.fold is not None:
            self.add(frame.taken, frame.fold.records, frame.fold.state, frame.solution)

    def figures(self, last: int | None = None) -> TrackFigures:
        """Of the ``last`` frames, of all with None."""
        every = [self._frames[number] for number in sorted(self._frames)]
        chosen = [each for each in every if each.is_chosen]
        chosen = chosen if last is None else chosen[max(len(chosen) - last, 0) :]
        widest = [f.widest_3sigma_deg for f in chosen if f.widest_3sigma_deg is not None]
        locked = next((n for n, each in enumerate(chosen) if each.state == "TRACK"), None)
        quality = quality_of([update for each in chosen for update in each.updates])
        return TrackFigures(
            **asdict(quality),
            frames=len(chosen),
            locked_after_frames=None if locked is None else chosen[locked].frame_id,
            locked_after_s=None if locked is None else _seconds_between(chosen[0], chosen[locked]),
            lock_held=None if locked is None else _share_in_track(chosen[locked + 1 :]),
            misses=sum(each.misses for each in chosen),
            losses=sum(each.losses for each in chosen),
            max_3sigma_arcmin=max(widest) * 60.0 if widest else None,
            carried_by_orbit=sum(each.by_orbit for each in chosen),
            state=every[-1].state if every else "",
            states=dict(Counter(each.state for each in chosen)),
            nis_curve=tuple(each.nis_of_lead for each in chosen[-CURVE_FRAMES:]),
        )


def as_recorded(
    records: Iterable[Record], last: int | None = None, *, of_lead: bool = False
) -> TrackFigures:
    """The night as it was, nothing computed again: of the ``last`` frames, of all with None.

    ``of_lead``: of the lead alone, without the frames in which it was missed because they looked
    elsewhere; else of all that is followed.
    """
    found = FigureSum(of_lead=of_lead)
    frames = NightFrames(newest=NEWEST, on_past=found.add_recorded).take_all(records)
    for each in frames.seen():
        found.add_recorded(each)
    return found.figures(last)


def _of_lead(records: Sequence[Record]) -> list[Record]:
    """Without what is said of other tracks."""
    beside = {r.track_id for r in records if isinstance(r, TrackState) and not r.is_lead}
    return [r for r in records if not (isinstance(r, TrackState | Miss) and r.track_id in beside)]


def _seconds_between(first: _Frame, later: _Frame) -> float | None:
    begin, end = first.t_mid_utc_ns, later.t_mid_utc_ns
    return None if begin is None or end is None else (end - begin) / 1e9


def _share_in_track(frames: Sequence[_Frame]) -> float | None:
    in_track = sum(each.state == "TRACK" for each in frames)
    return in_track / len(frames) if frames else None


def _nis_of_lead(records: Sequence[Record]) -> float | None:
    found = (
        r.nis for r in records if isinstance(r, TrackState) and r.is_lead and r.nis is not None
    )
    return next(found, None)


@dataclass(frozen=True, slots=True, kw_only=True)
class Spell:
    """For how long the loop was in one state."""

    state: str
    t_from_utc_ns: int
    t_to_utc_ns: int

    @property
    def seconds(self) -> float:
        """Its length."""
        return (self.t_to_utc_ns - self.t_from_utc_ns) / 1e9


@dataclass(frozen=True, slots=True, kw_only=True)
class Summary(Quality):
    """A night at a glance; None where there is nothing to go by."""

    frames: int
    followed: int
    """Frames in which the track took a measurement."""
    misses: int
    locked_after_frames: int | None
    """How many frames it took to TRACK; None where it never came to that."""


def summary_of(frames: Sequence[NightFrame]) -> Summary:
    """The figures of frames that have a time."""
    locked = (n for n, f in enumerate(frames, 1) if any(c.after == "TRACK" for c in f.changes))
    return Summary(
        **asdict(quality_of(updates_of(frame.updated for frame in frames))),
        frames=len(frames),
        followed=sum(frame.updated is not None for frame in frames),
        misses=sum(frame.miss is not None for frame in frames),
        locked_after_frames=next(locked, None),
    )


def spells_of(log: Sequence[tuple[int, int, Any]]) -> tuple[Spell, ...]:
    """The states one after another, from the first record to the last."""
    if not log:
        return ()
    t_last = max(t for _, t, _ in log)
    spells: list[Spell] = []
    for _, t_utc_ns, record in log:
        if not isinstance(record, StateChange):
            continue
        if spells:
            spells[-1] = replace(spells[-1], t_to_utc_ns=t_utc_ns)
        elif t_utc_ns > log[0][1]:
            before = Spell(state=record.before, t_from_utc_ns=log[0][1], t_to_utc_ns=t_utc_ns)
            spells.append(before)
        spells.append(Spell(state=record.after, t_from_utc_ns=t_utc_ns, t_to_utc_ns=t_last))
    return tuple(spells)
