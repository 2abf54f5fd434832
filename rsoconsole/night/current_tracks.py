"""Tracks followed at one record of a log: state, last measurement, rows of plots. Pure."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from rsoconsole.night.frame import (
    FrameRow,
    NightFrame,
    is_measurement_of,
    predicted_sigma_arcsec,
    track_number_text,
    without_steps,
)
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
    Photometry,
    Record,
    Ruling,
    StateChange,
    StreakLight,
    TrackState,
)
from rsoconsole.tracking import ON_TRIAL
from rsoconsole.words import text

MAX_ROWS = 400
"""Largest number of a track's last frames that its plots show."""
PAIRS_KEPT_NS = 3_600_000_000_000
"""Age beyond which a pair's relative motion is left out, ns: its tracks have ended."""
TAKEN_BACK_FRAMES = 12
"""Frames after which a decision is no longer reversed, as in ``pipeline.cycle.decisions``."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FollowedTrack:
    """A followed track, as of its last frame."""

    state: TrackState
    is_lead: bool
    began_frame_id: int
    since_utc_ns: int
    """Mid-exposure of the frame in which the track began, UTC nanoseconds."""
    measured_frame_id: int | None = None
    measured_utc_ns: int | None = None
    """Mid-exposure of its last measurement, UTC nanoseconds."""
    measured_px: tuple[float, float] | None = None
    """Column and row of its last measurement, pixels; None where that is not on record."""
    residual_arcsec: tuple[float, float] | None = None
    """Innovation of its last update (RA on the sky, Dec), arcsec."""
    nis: float | None = None
    snr: float | None = None
    """Integrated SNR of the last streak measured; None where its light was not measured."""
    light: StreakLight | None = None
    """Brightness of its last measurement, without steps; None where it is not on record.

    Until the photometry of that frame is on record, that of the measurement before.
    """
    rows: tuple[FrameRow, ...] = ()
    """Rows of its frames, oldest first, at most ``MAX_ROWS``: residual, NIS, miss, brightness."""

    @property
    def track_id(self) -> int:
        """Id of the track, its number in the session."""
        return self.state.track_id

    @property
    def number_text(self) -> str:
        """Number of the track as shown on screens; the lead's has a star."""
        return track_number_text(self.track_id, is_lead=self.is_lead)

    @property
    def is_tentative(self) -> bool:
        """True while the track is not confirmed: its next miss ends it."""
        return not self.is_lead and self.state.innovations < ON_TRIAL


@dataclass(frozen=True, slots=True, kw_only=True)
class CurrentTracks:
    """The tracks of a session after one record of its log."""

    tracks: Mapping[int, FollowedTrack] = field(default_factory=dict)
    in_frame: tuple[int, ...] = ()
    """Ids of the tracks with a record in the frame being read, in the order of the records."""
    set_aside: Mapping[int, FollowedTrack] = field(default_factory=dict)
    """Tracks ended by a command, which a command may resume, by track id."""
    dropped: Mapping[int, FollowedTrack] = field(default_factory=dict)
    """Tracks as they were when the operator dropped them, by track id, the latest last."""
    dropped_in: Mapping[int, int] = field(default_factory=dict)
    """Number of the frame from which on each dropped track is dropped, by track id."""

    def restorable_track_ids(self, frame_id: int) -> tuple[int, ...]:
        """Return the ids of dropped tracks that may still be resumed, the latest last.

        ``frame_id``: number of the newest frame.
        """
        return tuple(n for n, at in self.dropped_in.items() if at > frame_id - TAKEN_BACK_FRAMES)

    def tracks_by_number(self) -> tuple[FollowedTrack, ...]:
        """Return the followed tracks by number; if the lead has just ended, another is the lead."""
        lead = next((n for n, each in self.tracks.items() if each.is_lead), None)
        if lead is None:
            lead = next((n for n in self.in_frame if n in self.tracks), None)
        return tuple(
            replace(each, is_lead=number == lead)
            for number, each in sorted(self.tracks.items(), key=lambda pair: pair[0])
        )


def tracks_after(  # noqa: PLR0911 -- one case a kind
    now: CurrentTracks,
    record: Record,
    t_utc_ns: int,
    frame: NightFrame,
) -> CurrentTracks:
    """Fold one record into the tracks; return the tracks after it.

    ``t_utc_ns``: time of the record; ``frame``: the record's frame with the record in it.
    """
    match record:
        case FrameTaken():
            return _settled(now)
        case CycleTiming():
            return _settled(_with_light(now, frame))
        case Photometry():
            return _with_light(now, frame)
        case FollowedAgain():
            return _before(_settled(now), record.frame_id)
        case TrackState():
            return _with_state(now, record, t_utc_ns, frame)
        case Miss():
            return _with_miss(now, record)
        case StateChange():
            return _with_change(now, record)
        case Ruling():
            return _with_decision(now, record)
    return now


def _with_decision(now: CurrentTracks, record: Ruling) -> CurrentTracks:
    """Drop the tracks of the operator's decision; resume those that it no longer drops."""
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


def latest_pair_motions(
    before: tuple[PairMotion, ...], record: PairMotions
) -> tuple[PairMotion, ...]:
    """Return the latest motion of each pair: those known before, and those of a new record.

    One record holds only some of many pairs. Motions older than ``PAIRS_KEPT_NS`` are left out.
    """
    newest = max((each.t_utc_ns for each in record.pairs), default=0)
    found = {(p.track_id, p.other_track_id): p for p in (*before, *record.pairs)}
    return tuple(each for each in found.values() if newest - each.t_utc_ns < PAIRS_KEPT_NS)


def _settled(now: CurrentTracks) -> CurrentTracks:
    """End the tracks without a record in a frame whose records are complete."""
    if not now.in_frame:
        return now
    left = {n: each for n, each in now.tracks.items() if n in now.in_frame}
    return replace(now, tracks=left, in_frame=())


def _before(now: CurrentTracks, frame_id: int) -> CurrentTracks:
    """Drop the first results of a frame that is processed again, and of those behind it."""
    left = {
        number: replace(each, rows=tuple(row for row in each.rows if row.frame_id < frame_id))
        for number, each in now.tracks.items()
        if each.began_frame_id < frame_id
    }
    return replace(now, tracks=left)


def _with_state(
    now: CurrentTracks, record: TrackState, t_utc_ns: int, frame: NightFrame
) -> CurrentTracks:
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
    row = FrameRow(
        frame_id=record.frame_id,
        is_followed=is_measured,
        residual_arcsec=record.innovation_arcsec,
        sigma_arcsec=record.sigma_innovation_arcsec or predicted_sigma_arcsec(record),
        nis=record.nis,
        measurement_id=record.measurement_id if is_measured else None,
        light=without_steps(frame.light_of(record.measurement_id)) if is_measured else None,
    )
    rows = (*_without(known.rows, record.frame_id), row)[-MAX_ROWS:]
    track = replace(known, state=record, is_lead=record.is_lead, rows=rows)
    if is_measured:
        named = record.measurement_id
        taken = next((m for m in frame.all_measurements if m.measurement_id == named), None)
        track = replace(
            track,
            measured_frame_id=record.frame_id,
            measured_utc_ns=record.t_utc_ns,
            measured_px=None if taken is None else (taken.x_px, taken.y_px),
            residual_arcsec=record.innovation_arcsec,
            nis=record.nis,
            snr=None if taken is None else _snr_of(taken, frame.detections),
            light=known.light if frame.photometry is None else row.light,
        )
    others = {n: each for n, each in now.tracks.items() if n != record.replaces}
    if record.is_lead:  # one alone
        others = {n: replace(each, is_lead=False) for n, each in others.items()}
    in_frame = now.in_frame if number in now.in_frame else (*now.in_frame, number)
    return replace(now, tracks={**others, number: track}, in_frame=in_frame)


def _with_light(now: CurrentTracks, frame: NightFrame) -> CurrentTracks:
    """Enter a frame's photometry, which comes behind its tracks; without one, that there is none.

    ``frame``: with all its records, or with its photometry.
    """
    tracks = {number: _lit(each, frame) for number, each in now.tracks.items()}
    return replace(now, tracks=tracks)


def _lit(track: FollowedTrack, frame: NightFrame) -> FollowedTrack:
    """Return a track with the brightness of its streak in a frame, if it took one there."""
    row = next((r for r in reversed(track.rows) if r.frame_id == frame.frame_id), None)
    if row is None or row.measurement_id is None:
        return track
    light = without_steps(frame.light_of(row.measurement_id))
    last = light if track.measured_frame_id == frame.frame_id else track.light
    if (light, last) == (row.light, track.light):
        return track
    rows = tuple(replace(each, light=light) if each is row else each for each in track.rows)
    return replace(track, rows=rows, light=last)


def _without(rows: tuple[FrameRow, ...], frame_id: int) -> tuple[FrameRow, ...]:
    """Return the rows without that frame's, which is the last one if any."""
    if rows and rows[-1].frame_id == frame_id:
        rows = rows[:-1]
    if not rows or rows[-1].frame_id < frame_id:
        return rows
    return tuple(each for each in rows if each.frame_id != frame_id)


def _snr_of(taken: Measurement, found: Detections | None) -> float | None:
    """Return the SNR of the measured streak; None where its light was not measured."""
    streaks = () if found is None else (*found.detections, *(r.detection for r in found.rejected))
    return next((each.snr or None for each in streaks if is_measurement_of(each, taken)), None)


def _with_miss(now: CurrentTracks, record: Miss) -> CurrentTracks:
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


def _with_change(now: CurrentTracks, record: StateChange) -> CurrentTracks:
    if record.after in FOLLOWING:
        return replace(now, tracks=now.tracks or now.set_aside, set_aside={})
    if not now.tracks and record.after != "LOST":
        return replace(now, in_frame=())
    aside = {} if record.after == "LOST" else now.tracks
    return CurrentTracks(set_aside=aside, dropped=now.dropped, dropped_in=now.dropped_in)
