"""Figures of merit of a night, as recorded or with other settings."""

import itertools
import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from statistics import fmean, median
from typing import Any, NamedTuple

from rsoconsole.config import Config, with_setting
from rsoconsole.night.frame import NightFrame, predicted_sigma_arcsec, was_pointed_at_lead
from rsoconsole.night.frames import NEWEST, NightFrames
from rsoconsole.night.quality import FilterQuality, FilterUpdate, filter_quality, updates_of
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
from rsoconsole.tracking import TrackUpdate, three_sigma_deg

SIGMA_FRAMES, CADENCE_FRAMES = 120, 12
USUAL_OF = 5
"""Number of the newest updates of which the one with the median sigma is the usual one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackFigures(FilterQuality):
    """Figures of merit of the tracks over some frames; None where no frame gives a figure."""

    frames: int
    """Number of folded frames; frames taken while the operator had control are not folded."""
    locked_after_frames: int | None
    """Number of the first frame after which the loop was in TRACK; None: it never was."""
    locked_after_s: float | None
    """Seconds from mid-exposure of the first frame to that of the first frame in TRACK."""
    lock_held: float | None
    """Fraction of the frames after the first in TRACK that also ended in TRACK."""
    misses: int
    losses: int
    max_3sigma_arcmin: float | None
    """3 sigma of the most uncertain prediction, arcmin."""
    state: str
    carried_by_orbit: int = 0
    """Number of updates with a prediction from the orbit, because the filter's had failed."""
    states: Mapping[str, int] = field(default_factory=dict)
    lead_sigmas_arcsec: Mapping[int, tuple[float, float]] = field(default_factory=dict)
    """One sigma (east, north) of the lead's innovation or prediction, by frame, of the last ones"""


class _Frame(NamedTuple):
    """Part of a frame that the figures need: small, since a night may have 50,000."""

    frame_id: int
    t_mid_utc_ns: int | None
    state: LoopState
    is_chosen: bool
    updates: tuple[FilterUpdate, ...]
    by_orbit: int
    """Number of updates predicted by the orbit."""
    misses: int
    losses: int
    widest_3sigma_deg: float | None
    lead_sigma_arcsec: tuple[float, float] | None


class FigureAccumulator:
    """Accumulator of a night's figures of merit, to which frames are added one by one."""

    def __init__(self, *, of_lead: bool = False) -> None:
        """Start without frames; ``of_lead``: only the lead counts, as in ``recorded_figures``."""
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
        """Add a frame; a frame that was added before is replaced by its new result.

        ``folded``: records that the fold made of the frame, in order (TrackState, NotFollowed,
        Miss, StateChange); ``state``: the loop's state after the frame; ``solution``: its plate
        solution.
        """
        records = _of_lead(folded) if self._of_lead else folded
        tracks = [r for r in records if isinstance(r, TrackState)]
        leads = [r for r in folded if isinstance(r, TrackState) and r.is_lead]
        sigmas_deg = [three_sigma_deg(r) for r in tracks if r.kind == "predicted"]
        self._frames[taken.frame_id] = _Frame(
            frame_id=taken.frame_id,
            t_mid_utc_ns=taken.t_mid_utc_ns,
            state=state,
            is_chosen=not self._of_lead or was_pointed_at_lead(folded, solution, taken),
            updates=tuple(updates_of(tracks)),
            by_orbit=sum(r.foretold_by == "orbit" for r in tracks if r.innovation_arcsec),
            misses=sum(isinstance(record, Miss) for record in records),
            losses=sum(isinstance(r, StateChange) and r.after == "LOST" for r in records),
            widest_3sigma_deg=max(sigmas_deg, default=None),
            lead_sigma_arcsec=_newest_sigma_arcsec(leads),
        )

    def add_recorded(self, frame: NightFrame) -> None:
        """Add a recorded frame; a frame that was not folded is ignored."""
        if frame.taken is not None and frame.fold is not None:
            self.add(frame.taken, frame.fold.records, frame.fold.state_after, frame.solution)

    def figures(self, last: int | None = None) -> TrackFigures:
        """Return the figures of merit of the ``last`` frames; None: of all frames."""
        every = [self._frames[number] for number in sorted(self._frames)]
        chosen = [each for each in every if each.is_chosen]
        chosen = chosen if last is None else chosen[max(len(chosen) - last, 0) :]
        widest = [f.widest_3sigma_deg for f in chosen if f.widest_3sigma_deg is not None]
        locked = next((n for n, each in enumerate(chosen) if each.state == "TRACK"), None)
        after = [] if locked is None else chosen[locked + 1 :]
        quality = filter_quality([update for each in chosen for update in each.updates])
        return TrackFigures(
            **asdict(quality),
            frames=len(chosen),
            locked_after_frames=None if locked is None else chosen[locked].frame_id,
            locked_after_s=None if locked is None else _seconds_between(chosen[0], chosen[locked]),
            lock_held=fmean(each.state == "TRACK" for each in after) if after else None,
            misses=sum(each.misses for each in chosen),
            losses=sum(each.losses for each in chosen),
            max_3sigma_arcmin=max(widest) * 60.0 if widest else None,
            carried_by_orbit=sum(each.by_orbit for each in chosen),
            state=every[-1].state if every else "",
            states=dict(Counter(each.state for each in chosen)),
            lead_sigmas_arcsec={
                each.frame_id: each.lead_sigma_arcsec
                for each in chosen[-SIGMA_FRAMES:]
                if each.lead_sigma_arcsec is not None
            },
        )


def recorded_figures(
    records: Iterable[Record], last: int | None = None, *, of_lead: bool = False
) -> TrackFigures:
    """Return the figures of merit of a recorded night; ``last``: only of the last frames.

    ``of_lead``: True: of the lead track alone, without frames that missed it because the telescope
    pointed elsewhere; False: of all tracks.
    """
    return _folded(records, of_lead=of_lead)[0].figures(last)


class LeadUpdate(NamedTuple):
    """A usual one of the lead's newest updates, and the seconds from one frame to the next."""

    update: TrackUpdate
    cadence_s: float


def lead_figures(
    records: Iterable[Record], config: Config, last: int | None = None
) -> tuple[TrackFigures, LeadUpdate | None]:
    """Return the lead's figures as ``recorded_figures``, and its newest update if there is one.

    ``config``: of the session's beginning.
    """
    found, frames = _folded(records, of_lead=True)
    return found.figures(last), _lead_update(frames, config)


def _folded(
    records: Iterable[Record], *, of_lead: bool
) -> tuple[FigureAccumulator, Sequence[NightFrame]]:
    found = FigureAccumulator(of_lead=of_lead)
    frames = NightFrames(newest=NEWEST, on_past=found.add_recorded).fold_all(records)
    kept = tuple(frames.kept_frames())
    for each in kept:
        found.add_recorded(each)
    return found, kept


def _lead_update(frames: Sequence[NightFrame], config: Config) -> LeadUpdate | None:
    followed = [f for f in frames if f.predicted is not None and f.has_time][-CADENCE_FRAMES:]
    times = [f.t_mid_utc_ns for f in followed]
    steps_s = [(b - a) / 1e9 for a, b in itertools.pairwise(times) if b > a]
    updates: list[tuple[float, int, TrackUpdate]] = []
    for frame in followed if steps_s else ():
        measured, predicted, updated = frame.lead_measured, frame.predicted, frame.updated
        if not (measured and predicted and updated and updated.sigma_innovation_arcsec):
            continue
        settings = config
        for name, value in frame.settings.items():
            settings = with_setting(settings, name, value)
        update = TrackUpdate(
            predicted=predicted, updated=updated, measurement=measured, settings=settings.filter
        )
        updates.append((math.hypot(*updated.sigma_innovation_arcsec), len(updates), update))
    newest = sorted(updates[-USUAL_OF:])
    return LeadUpdate(newest[len(newest) // 2][-1], median(steps_s)) if newest else None


def _newest_sigma_arcsec(leads: Sequence[TrackState]) -> tuple[float, float] | None:
    """Return one sigma of the lead's innovation, else of its prediction; None without either."""
    for state in reversed(leads):
        if state.kind == "updated" and state.sigma_innovation_arcsec is not None:
            return state.sigma_innovation_arcsec
        if state.kind == "predicted":
            return predicted_sigma_arcsec(state)
    return None


def _of_lead(records: Sequence[Record]) -> list[Record]:
    """Return the records without those of other tracks than the lead."""
    beside = {r.track_id for r in records if isinstance(r, TrackState) and not r.is_lead}
    return [r for r in records if not (isinstance(r, TrackState | Miss) and r.track_id in beside)]


def _seconds_between(first: _Frame, later: _Frame) -> float | None:
    begin, end = first.t_mid_utc_ns, later.t_mid_utc_ns
    return None if begin is None or end is None else (end - begin) / 1e9


@dataclass(frozen=True, slots=True, kw_only=True)
class StateSpan:
    """A span of time that the loop spent in one state."""

    state: str
    t_from_utc_ns: int
    t_to_utc_ns: int

    @property
    def duration_s(self) -> float:
        """Duration of the span, s."""
        return (self.t_to_utc_ns - self.t_from_utc_ns) / 1e9


@dataclass(frozen=True, slots=True, kw_only=True)
class LeadSummary(FilterQuality):
    """Figures of merit of the lead track over a night; None where no frame gives a figure."""

    frames: int
    followed: int
    misses: int
    locked_after_frames: int | None
    """Number of frames until the loop reached TRACK, that frame included; None: it never did."""


def lead_summary(frames: Sequence[NightFrame]) -> LeadSummary:
    """Compute the lead track's figures of merit; ``frames``: in order of time, all with a time."""
    locked = (n for n, f in enumerate(frames, 1) if any(c.after == "TRACK" for c in f.changes))
    return LeadSummary(
        **asdict(filter_quality(updates_of(frame.updated for frame in frames))),
        frames=len(frames),
        followed=sum(frame.updated is not None for frame in frames),
        misses=sum(frame.lead_miss is not None for frame in frames),
        locked_after_frames=next(locked, None),
    )


def state_spans(log: Sequence[tuple[int, int, Any]]) -> tuple[StateSpan, ...]:
    """Return the spans of the loop's states, in order, from the first record to the last.

    ``log``: (seq, UTC nanoseconds, record) in order.
    """
    if not log:
        return ()
    t_last = max(t for _, t, _ in log)
    spells: list[StateSpan] = []
    for _, t_utc_ns, record in log:
        if not isinstance(record, StateChange):
            continue
        if spells:
            spells[-1] = replace(spells[-1], t_to_utc_ns=t_utc_ns)
        elif t_utc_ns > log[0][1]:
            before = StateSpan(state=record.before, t_from_utc_ns=log[0][1], t_to_utc_ns=t_utc_ns)
            spells.append(before)
        spells.append(StateSpan(state=record.after, t_from_utc_ns=t_utc_ns, t_to_utc_ns=t_last))
    return tuple(spells)
