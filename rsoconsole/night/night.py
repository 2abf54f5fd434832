"""What a session says of its night so far: a fold over its records, to be shown."""

from dataclasses import replace
from pathlib import Path
from typing import Any, assert_never

from rsoconsole.config import Config
from rsoconsole.night import is_without_detection, looked_elsewhere
from rsoconsole.night.chunks import Chunks, in_chunks
from rsoconsole.night.frame_rows import FrameDetail, FrameRow
from rsoconsole.night.frames_seen import FramesSeen
from rsoconsole.night.last_measured import last_measured
from rsoconsole.night.log_lines import LogLine, is_put_down_to_cloud, left_out, line_of
from rsoconsole.night.log_merging import append_line
from rsoconsole.night.night_view import (
    KeptNight,
    NightView,
    Now,
    Pointing,
    above_horizon,
    is_same_name,
)
from rsoconsole.night.track_fold import (
    pairs_after,
    predicted_sigma_arcsec,
    tracks_after,
    with_track,
)
from rsoconsole.reason_text import text
from rsoconsole.records import (
    Closeup,
    CycleTiming,
    Detections,
    Event,
    ExpectedMembers,
    FollowedAgain,
    FrameTaken,
    Identified,
    LeapDone,
    LoopState,
    LowPass,
    Measurement,
    Miss,
    NotFollowed,
    NotSolved,
    OperatorAction,
    OrbitEstimate,
    PairMotions,
    ParameterChange,
    Record,
    Ruling,
    SlewCommand,
    Solution,
    StateChange,
    TrackState,
)

UNSOUGHT: frozenset[LoopState | None] = frozenset(("IDLE", "MANUAL", "FAULT"))
"""States in which nobody looks for anything."""
ELSEWHERE = "not pointed at it"
"""Why a frame that looked somewhere else shows nothing of the track."""


class Night:
    """Takes a session's records in order; gives views of what they add up to."""

    def __init__(self, folder: Path, about: dict[str, Any], config: Config | None) -> None:
        self._about = NightView(
            folder=folder,
            title=str(about.get("title") or ""),
            is_simulated=about.get("is_simulated") is True,
            config=config,
        )
        """What no record changes."""
        self._now = Now(
            is_closed=about.get("is_closed") is True,
            tau=config.detector.tau if config is not None else 0.1,
        )
        self._site = config.site.to_site() if config is not None else None
        self._frames = FramesSeen()
        self._log: list[LogLine] = []
        self._kept_log: Chunks[LogLine] = ()

    def view(self) -> NightView:
        """What has been taken so far."""
        self._frames.are_seen()
        self._see_horizon()
        now = self._now
        return replace(
            self._about,
            **now.shown(),
            measured=last_measured(self._frames.details.items(), self._frames.rows),
            tracks=now.tracks_now.in_order(),
            dropped=now.tracks_now.can_be_taken_back(
                0 if now.frame is None else now.frame.frame_id
            ),
            rows=tuple(self._frames.rows.values()),
            log=tuple(self._log),
        )

    def keep(self) -> KeptNight:
        """The night as it is now, to come back to."""
        rows, details = self._frames.keep()
        self._kept_log = in_chunks(self._log, self._kept_log)
        return KeptNight(
            now=replace(self._now),
            rows=rows,
            details=details,
            log=self._kept_log,
        )

    def go_back(self, kept: KeptNight) -> None:
        """As it was when that was kept, by this fold or by another one of the same night."""
        self._now = replace(kept.now)
        self._frames.go_back(kept.rows, kept.details)
        self._log = [line for chunk in kept.log for line in chunk]

    def forget_log(self) -> None:
        """The lines so far are not shown: they leave out much of what came with them."""
        self._log.clear()

    @property
    def seq(self) -> int:
        """Place in the log of the last record that has been taken."""
        return self._now.seq

    @property
    def is_closed(self) -> bool:
        """Whether nothing more will come."""
        return self._now.is_closed

    @property
    def is_read(self) -> bool:
        """Whether the past is known."""
        return self._now.is_read

    def row(self, frame_id: int) -> FrameRow | None:
        """What the plots show of that frame; None for one that has not been taken."""
        self._frames.are_seen()
        return self._frames.rows.get(frame_id)

    @property
    def log(self) -> tuple[LogLine, ...]:
        """Oldest first."""
        return tuple(self._log)

    def detail(self, frame_id: int) -> FrameDetail:
        """What that frame showed; empty for one long past."""
        self._frames.are_seen()
        return self._frames.detail(frame_id)

    def newest_frames(self) -> tuple[int, ...]:
        """The last frames, newest first."""
        return tuple(reversed(self._frames.details))

    def has_been_read(self) -> None:
        """The past is known: what is taken from now on is news."""
        self._now.is_read = True

    def close(self) -> None:
        """The session is closed: nothing more will come."""
        self._now.is_closed = True

    def take(self, t_utc_ns: int, record: Record, seq: int | None = None) -> None:
        """One record of the log, in order; ``seq``: its place there, None: the next one."""
        now = self._now
        # A record that could not be written leaves an alarm at instant 0 in its place.
        now.last_utc_ns = max(t_utc_ns, now.last_utc_ns or 0) or None
        now.seq = now.seq + 1 if seq is None else seq
        named = now.identifications.get(record.track_id) if isinstance(record, Identified) else None
        self._fold(record, t_utc_ns)
        detail = self._frames.detail(getattr(record, "frame_id", None) or 0)
        is_one_of_several = len(now.tracks_now.tracks) > 1
        now.tracks_now = tracks_after(
            now.tracks_now, record, t_utc_ns, detail.all_measured, detail.detections
        )
        line = line_of(record, t_utc_ns, self._beside(record), is_one_of_several=is_one_of_several)
        if (
            line is not None
            and self._looked_elsewhere(record)
            and not isinstance(record, StateChange)
        ):
            said = f"no miss: frame {line.frame_id:04d} was {ELSEWHERE}"
            line = replace(line, level="info", text=said, words=said, missed=None)
        is_news = not (isinstance(record, Identified) and is_same_name(named, record))
        if line is not None and is_news:
            append_line(self._log, replace(line, seq=now.seq))

    def _fold(self, record: Record, t_utc_ns: int) -> None:  # noqa: PLR0912 -- one case a kind
        match record:
            case FrameTaken():
                self._frame_taken(record, t_utc_ns)
            case Detections():
                self._detections(record, t_utc_ns)
            case Solution():
                self._solution(record, t_utc_ns)
            case NotSolved():
                self._not_solved(record, t_utc_ns)
            case Measurement():
                self._measurement(record, t_utc_ns)
            case NotFollowed():
                self._not_followed(record, t_utc_ns)
            case Ruling():
                self._decision(record, t_utc_ns)
            case FollowedAgain():
                self._followed_again(record, t_utc_ns)
            case Closeup():
                self._closeup(record, t_utc_ns)
            case TrackState():
                self._track_state(record, t_utc_ns)
            case OrbitEstimate():
                self._orbit_estimate(record, t_utc_ns)
            case Identified():
                self._identified(record, t_utc_ns)
            case PairMotions():
                self._now.pairs = pairs_after(self._now.pairs, record)
            case ExpectedMembers():
                self._now.expected = record
            case Miss():
                self._miss(record, t_utc_ns)
            case StateChange():
                self._state_change(record, t_utc_ns)
            case ParameterChange():
                self._parameter_change(record, t_utc_ns)
            case CycleTiming():
                self._cycle_timing(record, t_utc_ns)
            case SlewCommand():
                self._slew_command(record, t_utc_ns)
            case Event(topic="engine ended"):
                self._now.has_ended = True
            case OperatorAction() | Event() | LeapDone() | LowPass():
                pass  # they change nothing but the log
            case _:
                assert_never(record)

    def _frame_taken(self, record: FrameTaken, t_utc_ns: int) -> None:
        self._now.frame = record
        ra, dec = record.pointing_ra_icrs_deg, record.pointing_dec_icrs_deg
        if ra is not None and dec is not None:
            self._look(record.t_start_utc_ns or t_utc_ns, ra, dec)
        row = FrameRow(
            frame_id=record.frame_id,
            t_utc_ns=record.t_start_utc_ns or t_utc_ns,
            was_sought=self._now.state not in UNSOUGHT,
            mount_icrs_deg=None if ra is None or dec is None else (ra, dec),
        )
        self._frames.begin(row, record)

    def _detections(self, record: Detections, _t_utc_ns: int) -> None:
        best = max((d.confidence for d in record.detections), default=None)
        rejected = max(record.rejected, key=lambda r: r.detection.confidence, default=None)
        refused = (
            None if rejected is None else (rejected.detection.confidence, text(rejected.reason))
        )
        self._frames.change(
            record.frame_id,
            confidence=best,
            is_reduced=True,
            settings=self._now.changed,
            refused=refused,
            fwhm_px=record.star_fwhm_px,
            star_count=record.star_count,
            background_adu=record.background_adu,
            zero_point_mag=record.zero_point_mag,
        )
        self._frames.change_detail(record.frame_id, detections=record)

    def _solution(self, record: Solution, t_utc_ns: int) -> None:
        taken = self._frames.detail(record.frame_id).taken
        t_ns = taken.t_start_utc_ns if taken is not None else None
        self._look(t_ns or t_utc_ns, record.ra_icrs_deg, record.dec_icrs_deg)
        self._frames.change(
            record.frame_id,
            is_solved=True,
            plate_icrs_deg=(record.ra_icrs_deg, record.dec_icrs_deg),
            rotation_deg=record.rotation_deg,
        )
        self._frames.change_detail(record.frame_id, solution=record)

    def _not_solved(self, record: NotSolved, _t_utc_ns: int) -> None:
        self._frames.change(record.frame_id, is_solved=False)
        self._frames.change_detail(record.frame_id, solution=record)

    def _measurement(self, record: Measurement, _t_utc_ns: int) -> None:
        if record.frame_id in self._frames.details:
            before = self._frames.details[record.frame_id].measurements
            self._frames.change_detail(record.frame_id, measurements=(*before, record))

    def _not_followed(self, record: NotFollowed, _t_utc_ns: int) -> None:
        row = self._frames.rows.get(record.frame_id)
        confidence = record.measurement.confidence
        if row is not None and (row.refused is None or row.refused[0] < confidence):
            self._frames.change(record.frame_id, refused=(confidence, text(record.reason)))
        if record.frame_id in self._frames.details:
            before = self._frames.details[record.frame_id].not_followed
            self._frames.change_detail(record.frame_id, not_followed=(*before, record))

    def _decision(self, record: Ruling, _t_utc_ns: int) -> None:
        if record.frame_id in self._frames.details:
            # Marks before this one count no more.
            found = self._frames.details[record.frame_id].measurements
            kept = tuple(m for m in found if m.source != "operator")
            self._frames.change_detail(record.frame_id, decision=record, measurements=kept)

    def _followed_again(self, record: FollowedAgain, _t_utc_ns: int) -> None:
        blank = {"miss": None, "residual_arcsec": None, "sigma_arcsec": None, "nis": None}
        no = {"is_followed": False, "is_cloudy": False, "is_by_orbit": False}
        self._frames.change(record.frame_id, **no, **blank)
        self._frames.change_detail(
            record.frame_id, predicted=None, updated=None, not_followed=(), tracks=()
        )
        now = self._now
        # Until the next one is on record the orbit of before is the best there is.
        of_frame = (n for n, each in now.orbits.items() if each.frame_id == record.frame_id)
        now.being_fitted_again |= frozenset(of_frame)

    def _closeup(self, record: Closeup, _t_utc_ns: int) -> None:
        self._frames.change_detail(record.frame_id, closeup=record)

    def _track_state(self, record: TrackState, _t_utc_ns: int) -> None:
        detail = self._frames.detail(record.frame_id)
        self._frames.change_detail(record.frame_id, tracks=with_track(detail.tracks, record))
        if not record.is_lead:
            others = {n: t for n, t in self._now.beside.items() if n != record.replaces}
            self._now.beside = {**others, record.track_id: record}
            return
        before = self._now.track
        # The lead's come first: what stands beside it is told behind them.
        self._now.track, self._now.beside = record, {}
        if before is not None and before.track_id != record.track_id:
            self._another_leads(record.track_id)
        if record.kind == "initial":
            self._now.track_frame_id = record.frame_id
            self._now.track_since_utc_ns = record.t_utc_ns
        if record.kind == "predicted":
            self._frames.change(record.frame_id, sigma_arcsec=predicted_sigma_arcsec(record))
            self._frames.change_detail(record.frame_id, predicted=record)
            return
        self._frames.change_detail(record.frame_id, updated=record)
        self._frames.change(record.frame_id, is_followed=True)
        if record.innovation_arcsec is not None:
            self._frames.change(
                record.frame_id,
                residual_arcsec=record.innovation_arcsec,
                sigma_arcsec=record.sigma_innovation_arcsec,
                nis=record.nis,
                is_by_orbit=record.foretold_by == "orbit",
            )

    def _another_leads(self, track_id: int) -> None:
        """What is known of it from when it was no lead."""
        now, known = self._now, self._now.tracks_now.tracks.get(track_id)
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

    def _identified(self, record: Identified, _t_utc_ns: int) -> None:
        now = self._now
        now.identifications = {**now.identifications, record.track_id: record}
        if record.track_id in now.beside:
            return
        now.identified = record
        if now.orbit is not None and now.orbit.track_id != record.track_id:
            now.orbit = now.orbit_utc_ns = None  # of what was followed before

    def _miss(self, record: Miss, _t_utc_ns: int) -> None:
        if record.track_id in self._now.beside:
            return
        if self._looked_elsewhere(record):
            self._frames.change(record.frame_id, miss=ELSEWHERE, is_reduced=True, was_sought=False)
        else:
            self._frames.change(
                record.frame_id,
                miss=text(record.reason),
                is_reduced=True,
                is_cloudy=is_put_down_to_cloud(record),
            )

    def _looked_elsewhere(self, record: Record) -> bool:
        """Whether the lead was missed in a frame whose field it was not in by the prediction."""
        if not is_without_detection(record):
            return False
        detail = self._frames.detail(getattr(record, "frame_id", 0))
        return looked_elsewhere(detail.predicted, detail.solution, detail.taken)

    def _beside(self, record: Record) -> str:
        """Why a streak that somebody sees in the picture was none for the track."""
        if not isinstance(record, Miss | StateChange) or not is_without_detection(record):
            return ""
        return left_out(self._frames.detail(record.frame_id).detections, self._now.tau)

    def _state_change(self, record: StateChange, t_utc_ns: int) -> None:
        now = self._now
        if record.after in {"TRACK", "COAST"}:
            # What was followed before the operator ended it is followed again.
            now.track, now.kept_track = now.track or now.kept_track, None
        else:
            if now.track is not None:
                now.kept_track = None if record.after == "LOST" else now.track
            now.track, now.beside = None, {}
        now.state, now.state_since_utc_ns = record.after, t_utc_ns
        if record.before in {"IDLE", "FAULT"}:
            now.slew = None  # where it was sent before it was armed again says nothing of now

    def _parameter_change(self, record: ParameterChange, _t_utc_ns: int) -> None:
        # A new mapping: views that were given away keep theirs.
        self._now.changed = {**self._now.changed, record.name: record.after}
        if record.name == "detector.tau" and not isinstance(record.after, str):
            self._now.tau = float(record.after)

    def _cycle_timing(self, record: CycleTiming, _t_utc_ns: int) -> None:
        self._now.timing = record

    def _slew_command(self, record: SlewCommand, _t_utc_ns: int) -> None:
        self._now.slew = record
        self._look(record.t_aim_utc_ns, record.ra_icrs_deg, record.dec_icrs_deg, is_ordered=True)

    def _look(self, t_utc_ns: int, ra: float, dec: float, *, is_ordered: bool = False) -> None:
        self._now.pointing = Pointing(
            t_utc_ns=t_utc_ns, ra_icrs_deg=ra % 360.0, dec_icrs_deg=dec, is_ordered=is_ordered
        )

    def _see_horizon(self) -> None:
        """Altitude and azimuth of the pointing, once it is looked at."""
        if self._now.pointing is not None and self._site is not None:
            self._now.pointing = above_horizon(self._now.pointing, self._site)
