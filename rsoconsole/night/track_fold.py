"""What the record says of each track: its state, what it took last, the rows of its plots. Pure."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from rsoconsole.night.frame import is_of_streak, numbered, predicted_sigma_arcsec
from rsoconsole.records import (
    FOLLOWING,
    CycleTiming,
    Detections,
    FollowedAgain,
    FrameTaken,
    Measurement,
    Miss,
    PairMotion,
    PairMotions,
    Record,
    Ruling,
    StateChange,
    TrackState,
)
from rsoconsole.tracking import ON_TRIAL
from rsoconsole.words import text

MAX_ROWS = 400
"""Last frames of a track that are kept for its plots."""
PAIRS_KEPT_NS = 3_600_000_000_000
"""A pair that was not looked at for longer is of tracks that have ended."""
TAKEN_BACK_FRAMES = 12
"""Frames within which the engine takes a word back (``pipeline.cycle.decisions``)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackRow:
    """One frame of one track, as its plots show it."""

    frame_id: int
    is_measured: bool = False
    residual_arcsec: tuple[float, float] | None = None
    """(d alpha cos delta, d delta), measured minus predicted; None where nothing was taken."""
    sigma_arcsec: tuple[float, float] | None = None
    """One sigma of the residual; of the prediction where nothing was taken."""
    nis: float | None = None
    miss: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class FollowedTrack:
    """One track as of its last frame."""

    state: TrackState
    is_lead: bool
    began_frame_id: int
    since_utc_ns: int
    """When it began."""
    measured_frame_id: int | None = None
    """The frame that it has been measured in last."""
    measured_utc_ns: int | None = None
    """When that was, mid-exposure."""
    measured_px: tuple[float, float] | None = None
    """Where in that frame."""
    residual_arcsec: tuple[float, float] | None = None
    """Of its last update, as in ``TrackRow``."""
    nis: float | None = None
    snr: float | None = None
    """Integrated, of the streak that it took last; None where that was not measured."""
    rows: tuple[TrackRow, ...] = ()
    """Oldest first; ``MAX_ROWS`` at most."""

    @property
    def track_id(self) -> int:
        """Its number in the session."""
        return self.state.track_id

    @property
    def number(self) -> str:
        """As picture, list and plots call it."""
        return numbered(self.track_id, is_lead=self.is_lead)

    @property
    def is_on_trial(self) -> bool:
        """Whether its next miss ends it."""
        return not self.is_lead and self.state.innovations < ON_TRIAL


@dataclass(frozen=True, slots=True, kw_only=True)
class TracksNow:
    """What the records add up to so far."""

    tracks: Mapping[int, FollowedTrack] = field(default_factory=dict)
    """Those that are followed, by track id."""
    in_frame: tuple[int, ...] = ()
    """Those that the frame under way has spoken of, in its order."""
    set_aside: Mapping[int, FollowedTrack] = field(default_factory=dict)
    """Those that ended by somebody's word: they may be followed again."""
    dropped: Mapping[int, FollowedTrack] = field(default_factory=dict)
    """Those that the operator has dropped, as they were then, the last one last."""
    dropped_in: Mapping[int, int] = field(default_factory=dict)
    """The frame from which on each of them is so, by track id."""

    def can_be_taken_back(self, frame_id: int) -> tuple[int, ...]:
        """Dropped tracks of which that may still be undone after a frame, the last one last."""
        return tuple(n for n, at in self.dropped_in.items() if at > frame_id - TAKEN_BACK_FRAMES)

    def in_order(self) -> tuple[FollowedTrack, ...]:
        """By their numbers; where the lead has just ended, the next one leads."""
        lead = next((n for n, each in self.tracks.items() if each.is_lead), None)
        if lead is None:
            lead = next((n for n in self.in_frame if n in self.tracks), None)
        return tuple(
            replace(each, is_lead=number == lead)
            for number, each in sorted(self.tracks.items(), key=lambda pair: pair[0])
        )


def tracks_after(  # noqa: PLR0911 -- one case a kind
    now: TracksNow,
    record: Record,
    t_utc_ns: int,
    measurements: tuple[Measurement, ...],
    found: Detections | None,
) -> TracksNow:
    """The tracks after one more record; measurements and detections are those of its frame."""
    match record:
        case FrameTaken() | CycleTiming():
            return _settled(now)
        case FollowedAgain():
            return _before(_settled(now), record.frame_id)
        case TrackState():
            return _with_state(now, record, t_utc_ns, measurements, found)
        case Miss():
            return _with_miss(now, record)
        case StateChange():
            return _with_change(now, record)
        case Ruling():
            return _with_word(now, record)
    return now


def _with_word(now: TracksNow, record: Ruling) -> TracksNow:
    """Those that the operator has dropped with a frame are none of the list's any more."""
    now = _settled(now)
    before = {n: at for n, at in now.dropped_in.items() if at != record.frame_id}
    again = [n for n in now.dropped_in if n not in before and n not in record.dropped]
    gone = {n: now.tracks[n] for n in record.dropped if n in now.tracks}
    dropped = {n: each for n, each in now.dropped.items() if n not in again}
    back = {n: now.dropped[n] for n in again if n in now.dropped}
    left = {n: each for n, each in now.tracks.items() if n not in record.dropped}
    return replace(
        now,
        tracks={**left, **back},
        dropped={**dropped, **gone},
        dropped_in={**before, **dict.fromkeys(record.dropped, record.frame_id)},
    )


def pairs_after(before: tuple[PairMotion, ...], record: PairMotions) -> tuple[PairMotion, ...]:
    """The last of each pair: of many some are looked at in each frame."""
    newest = max((each.t_utc_ns for each in record.pairs), default=0)
    found = {(p.track_id, p.other_track_id): p for p in (*before, *record.pairs)}
    return tuple(each for each in found.values() if newest - each.t_utc_ns < PAIRS_KEPT_NS)


def _settled(now: TracksNow) -> TracksNow:
    """After a frame whose records are all there: what it does not speak of has ended."""
    if not now.in_frame:
        return now
    left = {n: each for n, each in now.tracks.items() if n in now.in_frame}
    return replace(now, tracks=left, in_frame=())


def _before(now: TracksNow, frame_id: int) -> TracksNow:
    """Without what a frame that is followed again, and those behind it, first came to."""
    left = {
        number: replace(each, rows=tuple(row for row in each.rows if row.frame_id < frame_id))
        for number, each in now.tracks.items()
        if each.began_frame_id < frame_id
    }
    return replace(now, tracks=left)


def _with_state(
    now: TracksNow,
    record: TrackState,
    t_utc_ns: int,
    measurements: tuple[Measurement, ...],
    found: Detections | None,
) -> TracksNow:
    number = record.track_id
    known = now.tracks.get(number)
    if known is None or record.kind == "initial":
        known = FollowedTrack(
            state=record,
            is_lead=record.is_lead,
            began_frame_id=record.frame_id,
            since_utc_ns=record.t_utc_ns or t_utc_ns,
        )
    is_measured = record.kind != "predicted"
    row = TrackRow(
        frame_id=record.frame_id,
        is_measured=is_measured,
        residual_arcsec=record.innovation_arcsec,
        sigma_arcsec=record.sigma_innovation_arcsec or predicted_sigma_arcsec(record),
        nis=record.nis,
    )
    rows = (*_without(known.rows, record.frame_id), row)[-MAX_ROWS:]
    if not is_measured:
        track = replace(known, state=record, is_lead=record.is_lead, rows=rows)
    else:
        taken = next((m for m in measurements if m.measurement_id == record.measurement_id), None)
        track = replace(
            known,
            state=record,
            is_lead=record.is_lead,
            rows=rows,
            measured_frame_id=record.frame_id,
            measured_utc_ns=record.t_utc_ns,
            measured_px=None if taken is None else (taken.x_px, taken.y_px),
            residual_arcsec=record.innovation_arcsec,
            nis=record.nis,
            snr=None if taken is None else _snr_of(taken, found),
        )
    others = {n: each for n, each in now.tracks.items() if n != record.replaces}
    if record.is_lead:  # one alone
        others = {n: replace(each, is_lead=False) for n, each in others.items()}
    in_frame = now.in_frame if number in now.in_frame else (*now.in_frame, number)
    return replace(now, tracks={**others, number: track}, in_frame=in_frame)


def _without(rows: tuple[TrackRow, ...], frame_id: int) -> tuple[TrackRow, ...]:
    """Without that frame's: mostly it has none yet, or the last."""
    if rows and rows[-1].frame_id == frame_id:
        rows = rows[:-1]
    if not rows or rows[-1].frame_id < frame_id:
        return rows
    return tuple(each for each in rows if each.frame_id != frame_id)


def _snr_of(taken: Measurement, found: Detections | None) -> float | None:
    """Of the streak that was measured; None where its light was not."""
    streaks = () if found is None else (*found.detections, *(r.detection for r in found.rejected))
    for each in streaks:
        if is_of_streak(each, taken):
            return each.snr or None
    return None


def _with_miss(now: TracksNow, record: Miss) -> TracksNow:
    number = record.track_id
    known = None if number is None else now.tracks.get(number)
    if known is None or number is None:
        return now
    if record.reason.lost is not None:
        return replace(now, tracks={n: each for n, each in now.tracks.items() if n != number})
    why = text(record.reason)
    rows = tuple(
        replace(row, miss=why) if row.frame_id == record.frame_id else row for row in known.rows
    )
    return replace(now, tracks={**now.tracks, number: replace(known, rows=rows)})


def _with_change(now: TracksNow, record: StateChange) -> TracksNow:
    if record.after in FOLLOWING:
        return replace(now, tracks=now.tracks or now.set_aside, set_aside={})
    if not now.tracks and record.after != "LOST":
        return replace(now, in_frame=())
    aside = {} if record.after == "LOST" else now.tracks
    return TracksNow(set_aside=aside, dropped=now.dropped, dropped_in=now.dropped_in)
