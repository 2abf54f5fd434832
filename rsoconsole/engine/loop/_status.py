"""The engine's status at one instant, for scripts, tmux and consoles."""

from collections.abc import Mapping

from rsoconsole.control import NextAim, Status, TrackStatus, sort_by_separation
from rsoconsole.engine.aim.states import Authority
from rsoconsole.engine.tasks.field_tracks import kept_name
from rsoconsole.engine.tasks.watch import Watch
from rsoconsole.pipeline import Orbits
from rsoconsole.records import Photometry


def status_of(
    authority: Authority,
    watch: Watch,
    *,
    frame_id: int,
    now_utc_ns: int,
    faults: tuple[str, ...],
    exposing_until_utc_ns: int | None,
    next_start_utc_ns: int | None,
    names: Mapping[int, str],
    kept_until_utc_ns: int | None,
    slew_left_s: float | None,
    simulated_speed: float | None,
    markable_frames: tuple[int, ...],
    tracks: tuple[TrackStatus, ...],
    next_aim: NextAim | None,
    orbits: Orbits,
    light: Photometry | None,
) -> Status:
    """Return the engine's status now; may be called from any thread.

    ``names``: names of identified tracks, by track id; ``orbits``: source of the tracks' relative
    motion and of missing objects; ``light``: photometry of the last frame.
    """
    last_pairs = orbits.pairs.last if authority.following.tracks else ()
    expected = orbits.expected
    track = authority.following.track
    limit = watch.next_limit
    report = watch.last_report
    motion = None if report is None else report.motion
    return Status(
        state=authority.state,
        holder=authority.holder,
        is_held=authority.is_held,
        resumes_when_clear=authority.resumes_when_clear,
        frame_id=frame_id,
        target=names.get(authority.following.track_id or 0),
        kept=kept_name(authority.kept, names),
        kept_until_utc_ns=None if authority.kept is None else kept_until_utc_ns,
        is_resumable=authority.is_resumable
        or (authority.is_autonomous and authority.kept is not None),
        ra_icrs_deg=None if track is None else track.x[0] % 360.0,
        dec_icrs_deg=None if track is None else track.x[2],
        t_utc_ns=None if track is None else track.t_utc_ns,
        mount_ra_icrs_deg=None if report is None else report.ra_icrs_deg,
        mount_dec_icrs_deg=None if report is None else report.dec_icrs_deg,
        mount_t_utc_ns=None if report is None else report.t_utc_ns,
        slew_left_s=slew_left_s,
        is_parked=None if report is None else report.is_parked,
        now_utc_ns=now_utc_ns,
        simulated_speed=simulated_speed,
        markable_frames=markable_frames,
        zero_point_mag=None if light is None else light.zero_point_mag,
        limiting_mag=None if light is None else light.limiting_mag,
        tracks=tracks,
        next_aim=next_aim,
        pairs=sort_by_separation(last_pairs),
        unseen=() if expected.last is None else expected.last.unseen,
        uncatalogued=expected.uncatalogued,
        next_limit=None if limit is None else limit[1].limit,
        next_limit_utc_ns=None if limit is None else limit[0],
        lifted=tuple(sorted(watch.lifted)),
        faults=faults,
        is_slewing=None if report is None else report.is_slewing,
        is_tracking=None if report is None else report.is_tracking,
        is_parking=None if report is None else report.is_parking,
        mount_motion=None if motion is None else motion.kind,
        mount_rate_deg_s=None if motion is None or motion.kind == "unknown" else motion.rate_deg_s,
        pier_side=None if report is None else report.pier_side,
        exposing_until_utc_ns=exposing_until_utc_ns,
        next_start_utc_ns=next_start_utc_ns,
    )
