"""How well a night was followed, in figures: as recorded, and as with other settings."""

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol, TypeVar

from rsoconsole.config import Config
from rsoconsole.night import was_pointed_at
from rsoconsole.pipeline.replay.recorded_frames import recorded_frames
from rsoconsole.pipeline.replay.refold import replay
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
from rsoconsole.tracking.association import three_sigma_deg
from rsoconsole.tracking.filters import mean_band

CURVE_FRAMES = 40
"""Of the curve of what a setting changes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackFigures:
    """Of the frames looked at; None where there is nothing to go by.

    Residuals are measured minus predicted, of every measurement that the track took.
    """

    frames: int
    """Folded ones: not those that were taken while the operator had the mount."""
    locked_after_frames: int | None
    """Number of the first frame in TRACK."""
    locked_after_s: float | None
    """From the middle of the first frame to the middle of that one."""
    lock_held: float | None
    """Share of the frames after that one that ended in TRACK."""
    updates: int
    misses: int
    losses: int
    """How often what was followed was given up as lost."""
    residual_rms_arcsec: float | None
    """Both axes together."""
    residual_east_rms_arcsec: float | None
    residual_north_rms_arcsec: float | None
    nis_mean: float | None
    """2 for a sound filter."""
    nis_band: tuple[float, float] | None
    """Within which that mean lies for a sound filter, 95 times in 100."""
    inside_3sigma: float | None
    """Share of updates whose residual lies within 3 sigma on both axes; 0.995 for a sound one."""
    max_3sigma_arcmin: float | None
    """Of the predictions for a frame, the widest."""
    state: str
    """After the last frame."""
    carried_by_orbit: int = 0
    """Updates whose prediction was the orbit's, because the filter's had failed."""
    states: Mapping[str, int] = field(default_factory=dict)
    """How many frames ended in each."""
    log_likelihood_mean: float | None = None
    """Of an update's innovation in arcsec under its own sigmas; the larger, the likelier. The
    correlation of the two axes counts in the NIS alone."""

    nis_curve: tuple[float | None, ...] = ()
    """NIS of the lead in each of the last ``CURVE_FRAMES`` frames; None: not measured there."""

    @property
    def is_nis_sound(self) -> bool | None:
        """Whether the mean NIS lies in its band."""
        if self.nis_mean is None or self.nis_band is None:
            return None
        return self.nis_band[0] <= self.nis_mean <= self.nis_band[1]


class FollowedFrame(Protocol):
    """One folded frame, as recorded or as replayed."""

    @property
    def taken(self) -> FrameTaken:
        """Of what it was."""
        ...

    @property
    def records(self) -> tuple[Record, ...]:
        """TrackState, NotFollowed, Miss, StateChange, in order."""
        ...

    @property
    def state(self) -> LoopState:
        """After it."""
        ...

    @property
    def solution(self) -> Solution | NotSolved | None:
        """Of its stars."""
        ...


_Followed = TypeVar("_Followed", bound=FollowedFrame)


def once_each(frames: Iterable[_Followed]) -> list[_Followed]:
    """In order of their numbers; of a frame that was followed again, what counts in the end."""
    by_number = {each.taken.frame_id: each for each in frames}
    return [by_number[number] for number in sorted(by_number)]


def figures_of(
    frames: Iterable[FollowedFrame], last: int | None = None, *, of_lead: bool = False
) -> TrackFigures:
    """Figures of the ``last`` frames, of all with None; a frame followed again counts once.

    ``of_lead``: of the lead alone, without the frames in which it was missed because they looked
    elsewhere; else of all that is followed.
    """
    found = FigureSum(of_lead=of_lead)
    for each in frames:
        found.add(each)
    return found.figures(last)


class _Update(NamedTuple):
    """What figures need of a measurement that a track took."""

    residual_arcsec: tuple[float, float]
    nis: float | None
    is_inside: bool
    is_by_orbit: bool
    log_likelihood: float | None


class _Frame(NamedTuple):
    """What figures need of a frame: a night of 50,000 has room."""

    frame_id: int
    t_mid_utc_ns: int | None
    state: LoopState
    is_chosen: bool
    updates: tuple[_Update, ...]
    misses: int
    losses: int
    widest_3sigma_deg: float | None
    nis_of_lead: float | None


class FigureSum:
    """Figures of a night, frame by frame: nothing else of a frame is kept."""

    def __init__(self, *, of_lead: bool = False) -> None:
        """``of_lead`` as ``figures_of``."""
        self._of_lead = of_lead
        self._frames: dict[int, _Frame] = {}

    def __len__(self) -> int:
        return len(self._frames)

    def add(self, each: FollowedFrame) -> None:
        """One frame more, or one that was followed again: what counts in the end."""
        records = _of_lead(each.records) if self._of_lead else each.records
        tracks = [r for r in records if isinstance(r, TrackState)]
        sigmas_deg = [three_sigma_deg(r) for r in tracks if r.kind == "predicted"]
        taken = each.taken
        self._frames[taken.frame_id] = _Frame(
            frame_id=taken.frame_id,
            t_mid_utc_ns=taken.t_mid_utc_ns,
            state=each.state,
            is_chosen=not self._of_lead or was_pointed_at(each.records, each.solution, taken),
            updates=tuple(_update_of(r) for r in tracks if r.innovation_arcsec is not None),
            misses=sum(isinstance(record, Miss) for record in records),
            losses=sum(isinstance(r, StateChange) and r.after == "LOST" for r in records),
            widest_3sigma_deg=max(sigmas_deg, default=None),
            nis_of_lead=_nis_of_lead(each.records),
        )

    def figures(self, last: int | None = None) -> TrackFigures:
        """Of the ``last`` frames, of all with None."""
        every = [self._frames[number] for number in sorted(self._frames)]
        chosen = [each for each in every if each.is_chosen]
        chosen = chosen if last is None else chosen[max(len(chosen) - last, 0) :]
        updates = [update for each in chosen for update in each.updates]
        east = _mean_square([update.residual_arcsec[0] for update in updates])
        north = _mean_square([update.residual_arcsec[1] for update in updates])
        nis = [u.nis for u in updates if u.nis is not None]
        terms = [u.log_likelihood for u in updates if u.log_likelihood is not None]
        widest = [f.widest_3sigma_deg for f in chosen if f.widest_3sigma_deg is not None]
        locked = next((n for n, each in enumerate(chosen) if each.state == "TRACK"), None)
        return TrackFigures(
            frames=len(chosen),
            locked_after_frames=None if locked is None else chosen[locked].frame_id,
            locked_after_s=None if locked is None else _seconds_between(chosen[0], chosen[locked]),
            lock_held=None if locked is None else _share_in_track(chosen[locked + 1 :]),
            updates=len(updates),
            misses=sum(each.misses for each in chosen),
            losses=sum(each.losses for each in chosen),
            residual_rms_arcsec=None if east is None or north is None else math.sqrt(east + north),
            residual_east_rms_arcsec=None if east is None else math.sqrt(east),
            residual_north_rms_arcsec=None if north is None else math.sqrt(north),
            nis_mean=sum(nis) / len(nis) if nis else None,
            nis_band=mean_band(len(nis)) if nis else None,
            inside_3sigma=sum(u.is_inside for u in updates) / len(updates) if updates else None,
            max_3sigma_arcmin=max(widest) * 60.0 if widest else None,
            carried_by_orbit=sum(update.is_by_orbit for update in updates),
            state=every[-1].state if every else "",
            states=dict(Counter(each.state for each in chosen)),
            log_likelihood_mean=sum(terms) / len(terms) if terms else None,
            nis_curve=tuple(each.nis_of_lead for each in chosen[-CURVE_FRAMES:]),
        )


def as_recorded(
    records: Iterable[Record], last: int | None = None, *, of_lead: bool = False
) -> TrackFigures:
    """The night as it was: nothing is computed again."""
    return figures_of(recorded_frames(records), last, of_lead=of_lead)


def what_if(
    records: Iterable[Record],
    config: Config,
    changes: Mapping[str, float | str],
    last: int | None = None,
    *,
    of_lead: bool = False,
) -> TrackFigures:
    """The same night with other settings. Raises ConfigError for one that cannot be."""
    return figures_of(replay(records, config, changes=changes), last, of_lead=of_lead)


def _of_lead(records: Sequence[Record]) -> list[Record]:
    """Without what is said of other tracks."""
    beside = {r.track_id for r in records if isinstance(r, TrackState) and not r.is_lead}
    return [r for r in records if not (isinstance(r, TrackState | Miss) and r.track_id in beside)]


def _mean_square(values: Sequence[float]) -> float | None:
    return sum(value**2 for value in values) / len(values) if values else None


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


def _update_of(update: TrackState) -> _Update:
    residual = update.innovation_arcsec
    assert residual is not None
    return _Update(
        residual_arcsec=residual,
        nis=update.nis,
        is_inside=_is_inside(update),
        is_by_orbit=update.foretold_by == "orbit",
        log_likelihood=_log_likelihood(update),
    )


def _log_likelihood(update: TrackState) -> float | None:
    """Of one update. Source: Bar-Shalom et al. 2001, ch. 5.4."""
    sigma = update.sigma_innovation_arcsec
    if sigma is None or update.nis is None or min(sigma) <= 0.0:
        return None
    return -math.log(2.0 * math.pi * sigma[0] * sigma[1]) - 0.5 * update.nis


def _is_inside(update: TrackState) -> bool:
    residual, sigma = update.innovation_arcsec, update.sigma_innovation_arcsec
    assert residual is not None
    if sigma is None:
        return False
    return all(abs(r) <= 3.0 * s for r, s in zip(residual, sigma, strict=True))
