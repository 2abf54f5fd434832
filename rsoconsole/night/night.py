"""A session's night, built from its records, that can be viewed at any moment."""

from dataclasses import replace
from pathlib import Path
from typing import Any

from rsoconsole.config import Config
from rsoconsole.night.current_tracks import CurrentTracks, latest_pair_motions, tracks_after
from rsoconsole.night.frame import (
    ELSEWHERE,
    FrameRow,
    NightFrame,
    frame_row,
    is_without_detection,
    mount_icrs_deg,
)
from rsoconsole.night.frames import NEWEST, NightFrames
from rsoconsole.night.log_lines import LogLine, append_line, line_of, rejected_words
from rsoconsole.night.night_view import (
    Chunks,
    NightCheckpoint,
    NightView,
    Pointing,
    in_chunks,
    is_same_identification,
    recent_measurements,
    with_altaz,
)
from rsoconsole.records import (
    FOLLOWING,
    CycleTiming,
    Event,
    ExpectedMembers,
    FollowedAgain,
    FrameTaken,
    Identified,
    Miss,
    OrbitEstimate,
    PairMotions,
    Record,
    SlewCommand,
    Solution,
    StateChange,
    TrackState,
)


class Night:
    """State of a session's night, updated record by record; it gives views of the night."""

    def __init__(
        self,
        folder: Path,
        about: dict[str, Any],
        config: Config | None,
        *,
        newest: int | None = NEWEST,
    ) -> None:
        """Start before the first record.

        ``about``: metadata of the session; ``newest``: how many of the last frames are kept whole;
        None: all.
        """
        self._now = NightView(
            folder=folder,
            title=str(about.get("title") or ""),
            is_closed=about.get("is_closed") is True,
            is_simulated=about.get("is_simulated") is True,
            config=config,
        )
        """The view without frames, tracks and log lines, which ``view`` adds."""
        self._tracks = CurrentTracks()
        self._site = config.site.to_site() if config is not None else None
        self.frames = NightFrames(config, newest=newest, on_past=self._keep_row)
        """The exposures; only the last are kept whole."""
        self._rows: dict[int, FrameRow] = {}
        self._kept_rows: Chunks[FrameRow] = ()
        self._log: list[LogLine] = []
        self._kept_log: Chunks[LogLine] = ()

    def view(self) -> NightView:
        """Return the night as of the last folded record."""
        rows = self._all_rows()
        if self._now.pointing is not None and self._site is not None:
            self._now.pointing = with_altaz(self._now.pointing, self._site)
        frame = self._now.frame
        return replace(
            self._now,
            tau=self.frames.tau,
            changed=self.frames.settings,
            measured=recent_measurements(self.frames.kept_frames(), rows),
            tracks=self._tracks.tracks_by_number(),
            dropped=self._tracks.restorable_track_ids(0 if frame is None else frame.frame_id),
            rows=tuple(rows.values()),
            log=tuple(self._log),
        )

    def checkpoint(self) -> NightCheckpoint:
        """Return a checkpoint of the night as it is now, to return to later."""
        self._kept_rows = in_chunks([*self._all_rows().values()], self._kept_rows)
        self._kept_log = in_chunks(self._log, self._kept_log)
        return NightCheckpoint(
            now=replace(self._now),
            tracks=self._tracks,
            rows=self._kept_rows,
            frames=self.frames.checkpoint(),
            log=self._kept_log,
        )

    def restore(self, kept: NightCheckpoint) -> None:
        """Return to a checkpoint made by this object or by another one for the same night."""
        self._now, self._tracks = replace(kept.now), kept.tracks
        self.frames.restore(kept.frames)
        self._rows = {row.frame_id: row for chunk in kept.rows for row in chunk}
        self._log = [line for chunk in kept.log for line in chunk]

    def forget_log(self) -> None:
        """Discard the log lines so far, as they are incomplete where the log was read in part."""
        self._log.clear()

    @property
    def seq(self) -> int:
        """Place in the log of the last folded record."""
        return self._now.seq

    @property
    def last_slew(self) -> SlewCommand | None:
        """Last slew command; None before the first, and once the mount has been armed again."""
        return self._now.slew

    @property
    def is_closed(self) -> bool:
        """True where the session is closed: no record follows."""
        return self._now.is_closed

    @property
    def is_past_read(self) -> bool:
        """True where the session's past has been read to its end."""
        return self._now.is_read

    def row(self, frame_id: int) -> FrameRow | None:
        """Return a frame's values for the plots; None for a frame that has not been taken."""
        return self._all_rows().get(frame_id)

    @property
    def log(self) -> tuple[LogLine, ...]:
        """The log lines, oldest first."""
        return tuple(self._log)

    def frame(self, frame_id: int) -> NightFrame:
        """Return everything on record of a frame; an empty frame where it is no longer kept."""
        return next((f for f in self.frames.kept_frames() if f.frame_id == frame_id), NightFrame())

    def newest_frame_ids(self) -> tuple[int, ...]:
        """Return the numbers of the kept frames that the camera gave, newest first."""
        taken = [each.frame_id for each in self.frames.kept_frames() if each.taken is not None]
        return tuple(reversed(taken))

    def mark_past_read(self) -> None:
        """Mark the session's past as read: every further record is news."""
        self._now.is_read = True

    def close(self) -> None:
        """Mark the session as closed: no record follows."""
        self._now.is_closed = True

    def fold_record(self, t_utc_ns: int, record: Record, seq: int | None = None) -> None:
        """Fold the next record; ``t_utc_ns``: time of the record.

        ``seq``: place of the record in the log; None: the next place.
        """
        now = self._now
        # A record that could not be written leaves an alarm at instant 0 in its place.
        now.last_utc_ns = max(t_utc_ns, now.last_utc_ns or 0) or None
        now.seq = now.seq + 1 if seq is None else seq
        named = now.identifications.get(record.track_id) if isinstance(record, Identified) else None
        self.frames.fold_record(record, t_utc_ns)
        self._fold(record, t_utc_ns)
        frame = self.frames.frame_by_id(getattr(record, "frame_id", None) or 0)
        is_one_of_several = len(self._tracks.tracks) > 1
        self._tracks = tracks_after(self._tracks, record, t_utc_ns, frame)
        is_blank = is_without_detection(record)
        beside = rejected_words(frame.detections, self.frames.tau) if is_blank else ""
        line = line_of(record, t_utc_ns, beside, is_one_of_several=is_one_of_several)
        is_no_miss = is_blank and isinstance(record, Miss) and frame.is_lead_outside_field
        if line is not None and is_no_miss:
            said = f"no miss: frame {frame.frame_id:04d} was {ELSEWHERE}"
            line = replace(line, level="info", text=said, words=said, missed=None)
        is_news = not (isinstance(record, Identified) and is_same_identification(named, record))
        if line is not None and is_news:
            append_line(self._log, replace(line, seq=now.seq))

    def _keep_row(self, past: NightFrame) -> None:
        self._rows[past.frame_id] = frame_row(past)
        self.frames.changed.discard(past.frame_id)

    def _all_rows(self) -> dict[int, FrameRow]:
        if self.frames.changed:
            for frame in self.frames.kept_frames():
                if frame.frame_id in self.frames.changed:
                    self._rows[frame.frame_id] = frame_row(frame)
            self.frames.changed.clear()
        return self._rows

    def _fold(self, record: Record, t_utc_ns: int) -> None:  # noqa: PLR0912 -- one case a kind
        """Fold the record into the view; the frame is folded elsewhere."""
        now = self._now
        match record:
            case FrameTaken():
                now.frame = record
                if (mount := mount_icrs_deg(record)) is not None:
                    self._look(record.t_start_utc_ns or t_utc_ns, *mount)
            case Solution():
                t_ns = self.frames.frame_by_id(record.frame_id).began_utc_ns
                self._look(t_ns or t_utc_ns, record.ra_icrs_deg, record.dec_icrs_deg)
            case FollowedAgain():
                # Until the next one is on record the orbit of before is the best there is.
                of_frame = (n for n, o in now.orbits.items() if o.frame_id == record.frame_id)
                now.being_fitted_again |= frozenset(of_frame)
            case TrackState():
                self._track_state(record)
            case OrbitEstimate():
                self._orbit_estimate(record, t_utc_ns)
            case Identified():
                self._identified(record)
            case PairMotions():
                now.pairs = latest_pair_motions(now.pairs, record)
            case ExpectedMembers():
                now.expected = record
            case StateChange():
                self._state_change(record, t_utc_ns)
            case CycleTiming():
                now.timing = record
            case SlewCommand():
                now.slew = record
                place = (record.ra_icrs_deg, record.dec_icrs_deg)
                self._look(record.t_aim_utc_ns, *place, is_ordered=True)
            case Event(topic="engine ended"):
                now.has_ended = True

    def _track_state(self, record: TrackState) -> None:
        now = self._now
        if not record.is_lead:
            others = {n: t for n, t in now.beside.items() if n != record.replaces}
            now.beside = {**others, record.track_id: record}
            return
        before = now.track
        # The lead's come first: what stands beside it is told behind them.
        now.track, now.beside = record, {}
        if before is not None and before.track_id != record.track_id:
            self._another_leads(record.track_id)
        if record.kind == "initial":
            now.track_frame_id, now.track_since_utc_ns = record.frame_id, record.t_utc_ns

    def _another_leads(self, track_id: int) -> None:
        """Take over the record of a new lead from its time as another track."""
        now, known = self._now, self._tracks.tracks.get(track_id)
        if known is None:
            return
        now.track_frame_id, now.track_since_utc_ns = known.began_frame_id, known.since_utc_ns
        if track_id in now.orbits:
            now.orbit, now.orbit_utc_ns = now.orbits[track_id], known.state.t_utc_ns
        if track_id in now.identifications:
            now.identified = now.identifications[track_id]

    def _orbit_estimate(self, record: OrbitEstimate, t_utc_ns: int) -> None:
        now = self._now
        now.orbits = {**now.orbits, record.track_id: record}
        now.being_fitted_again -= {record.track_id}
        if record.track_id in now.beside:
            return
        now.orbit, now.orbit_utc_ns = record, t_utc_ns
        if now.identified is not None and now.identified.track_id != record.track_id:
            now.identified = None  # of what was followed before

    def _identified(self, record: Identified) -> None:
        now = self._now
        now.identifications = {**now.identifications, record.track_id: record}
        if record.track_id in now.beside:
            return
        now.identified = record
        if now.orbit is not None and now.orbit.track_id != record.track_id:
            now.orbit = now.orbit_utc_ns = None  # of what was followed before

    def _state_change(self, record: StateChange, t_utc_ns: int) -> None:
        now = self._now
        if record.after in FOLLOWING:
            # What was followed before the operator ended it is followed again.
            now.track, now.kept_track = now.track or now.kept_track, None
        else:
            if now.track is not None:
                now.kept_track = None if record.after == "LOST" else now.track
            now.track, now.beside = None, {}
        now.state, now.state_since_utc_ns = record.after, t_utc_ns
        if record.before in {"IDLE", "FAULT"}:
            now.slew = None  # where it was sent before it was armed again says nothing of now

    def _look(self, t_utc_ns: int, ra: float, dec: float, *, is_ordered: bool = False) -> None:
        self._now.pointing = Pointing(
            t_utc_ns=t_utc_ns, ra_icrs_deg=ra % 360.0, dec_icrs_deg=dec, is_ordered=is_ordered
        )
