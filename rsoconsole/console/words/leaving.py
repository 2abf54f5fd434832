"""Words on the end of a track: when it leaves the field, how it coasts, how long it is kept."""

import math
from collections.abc import Mapping

from rsoconsole.console.commands.keymap import first_key
from rsoconsole.console.night.engine_view import EngineView
from rsoconsole.console.words.words import cos_deg
from rsoconsole.night import ELSEWHERE, FrameRow, NightView
from rsoconsole.records import TrackState
from rsoconsole.sky import separation_deg, wrap_180
from rsoconsole.words import NS_PER_S, time_left_words, utc_text

SAME_FIELD_DEG = 0.1
"""Largest difference of two reported directions of a mount that has not moved away."""
MAX_S = 3600.0
"""Seconds ahead beyond which it is not said that a track leaves the field."""


def leaving_words(
    night: NightView,
    engine: EngineView,
    now_utc_ns: int | None,
    keymap: Mapping[str, str] | None = None,
) -> str:
    """Return when the target leaves the field: "INTELSAT 21 leaves the field in 4 min".

    For a track that the mount does not follow: autonomy is held, or the operator has control while
    the track is kept. Empty where the mount follows the track, or the time is not known.
    """
    is_by_hand = engine.is_attached and engine.state == "MANUAL" and engine.kept is not None
    is_held = engine.is_attached and engine.is_held and engine.holder == "autonomy"
    track = night.track if is_held else night.kept_track if is_by_hand else None
    row = _looked_at(night, is_held=is_held)
    if track is None or row is None or now_utc_ns is None:
        return ""
    if engine.is_slewing or engine.is_tracking is False:
        return ""
    left_s = time_left_in_field_s(night, track, row, now_utc_ns)
    if left_s is None or left_s > MAX_S:
        return ""
    name = (engine.target or "the satellite") if is_held else engine.kept
    if left_s <= 0.0 and is_held:
        key = first_key("hold_or_resume", keymap)
        return f"{name} is outside the field: {key} follows it again"
    if left_s <= 0.0:
        return f"{name} is out of the field"
    return f"{name} leaves the field in {time_left_words(left_s)}"


def time_left_in_field_s(
    night: NightView, track: TrackState, row: FrameRow, now_utc_ns: int
) -> float | None:
    """Return the time until a track leaves the field of a solved frame, s; 0: it is outside.

    It is assumed that the field stays among the stars and that the track keeps its rates. None: the
    track does not move in the field, or the field is not known.
    """
    if night.config is None or night.frame is None or row.plate_icrs_deg is None:
        return None
    scale = night.config.optics.scale_arcsec_px
    halves = [0.5 * scale * px for px in (night.frame.width_px, night.frame.height_px)]
    ra, ra_rate, dec, dec_rate = track.x
    since_s = (now_utc_ns - track.t_utc_ns) / NS_PER_S
    east = wrap_180(ra + ra_rate * since_s - row.plate_icrs_deg[0])
    north = dec + dec_rate * since_s - row.plate_icrs_deg[1]
    turn = math.radians(row.rotation_deg or 0.0)
    # Columns run along (cos, -sin), rows along (sin, cos) of (east, north): mirrored or not.
    axes = ((math.cos(turn), -math.sin(turn)), (math.sin(turn), math.cos(turn)))
    ends = []
    for half, (along_east, along_north) in zip(halves, axes, strict=True):
        at = 3600.0 * (along_east * east * cos_deg(dec) + along_north * north)
        rate = 3600.0 * (along_east * ra_rate * cos_deg(dec) + along_north * dec_rate)
        if abs(at) >= half:
            return 0.0
        if rate:
            ends.append((math.copysign(half, rate) - at) / rate)
    return min(ends, default=None)


def _looked_at(night: NightView, *, is_held: bool) -> FrameRow | None:
    """Return the last solved frame of where the mount points; None: there is none.

    With the operator in control only frames since then count. None too where a slew has been
    ordered since, or where a later frame was taken of another place.
    """
    since_ns = 0 if is_held else night.state_since_utc_ns
    if night.pointing is not None and night.pointing.is_ordered:
        return None
    newest = next((row for row in reversed(night.rows) if row.mount_icrs_deg is not None), None)
    for row in reversed(night.rows):
        if since_ns is None or row.t_utc_ns is None or row.t_utc_ns < since_ns:
            return None
        if row.is_solved and row.plate_icrs_deg is not None:
            return row if newest is None or _points_alike(row, newest) else None
    return None


def _points_alike(one: FrameRow, other: FrameRow) -> bool:
    """Return False where the mount reported two different directions for two frames."""
    a, b = one.mount_icrs_deg, other.mount_icrs_deg
    return a is None or b is None or separation_deg(*a, *b) < SAME_FIELD_DEG


FRAMES_COUNTED = 60
"""Frames ahead up to which the end of a coasting track is given in frames, beyond as a time."""


def coast_words(night: NightView, now_utc_ns: int | None) -> str:
    """Return how a track coasts, in words; empty: it does not coast.

    E.g. "coasted 2 · given up after 6 more · last seen 05:39:40Z, 60 s ago". ``now_utc_ns``: the
    frame clock.
    """
    track = night.track
    if track is None or not track.misses:
        return ""
    seen_ns = night.last_measured_utc_ns
    reduced = [row for row in night.rows if row.is_reduced][-track.misses :]
    elsewhere = sum(row.miss == ELSEWHERE for row in reduced)
    parts = [f"coasted {track.misses}{f', {elsewhere} not pointed at it' if elsewhere else ''}"]
    parts.append(_end_words(night, track, seen_ns))
    if seen_ns is not None:
        ago = (
            ""
            if now_utc_ns is None
            else f", {time_left_words((now_utc_ns - seen_ns) / NS_PER_S)} ago"
        )
        parts.append(f"last seen {utc_text(seen_ns)}{ago}")
    return " · ".join(part for part in parts if part)


def _end_words(night: NightView, track: TrackState, seen_ns: int | None) -> str:
    """Return the frame or time of the track's end; empty where the settings are not known."""
    if night.config is None:
        return ""
    cadence_s = float(night.setting("exposure.cadence_s") or 0.0)
    since_ns = track.t_utc_ns if seen_ns is None else seen_ns
    last_ns = since_ns + round(float(night.setting("filter.max_coast_s")) * NS_PER_S)
    if cadence_s <= 0.0:
        return f"given up at {utc_text(last_ns)}"
    for more in range(1, FRAMES_COUNTED + 1):
        ahead_s = more * cadence_s
        is_late = track.t_utc_ns + ahead_s * NS_PER_S > last_ns
        if is_late or _is_unsure(night, track, ahead_s):
            return f"given up after {more} more"
    return f"given up by {utc_text(last_ns)}"


def _is_unsure(night: NightView, track: TrackState, ahead_s: float) -> bool:
    """Return True if the position is too uncertain ``ahead_s`` later, process noise left out."""
    config, frame = night.config, night.frame
    if config is None or frame is None or config.filter.preset == "paper":
        return False
    half_field_px = min(frame.width_px, frame.height_px) / 2.0
    most_deg = min(
        float(night.setting("filter.max_3sigma_arcmin")) / 60.0,
        half_field_px * config.optics.scale_arcsec_px / 3600.0,
    )
    return _bound_deg(track, ahead_s) > most_deg


def _bound_deg(track: TrackState, ahead_s: float) -> float:
    """Return 3 sigma of the less certain axis, degrees, after a time at the track's rates."""
    covariance, dt = track.P, ahead_s
    ra, dec = (
        covariance[at][at]
        + 2.0 * covariance[at][at + 1] * dt
        + covariance[at + 1][at + 1] * dt * dt
        for at in (0, 2)
    )
    east, north = math.sqrt(max(ra, 0.0)) * cos_deg(track.x[2]), math.sqrt(max(dec, 0.0))
    return 3.0 * max(east, north)


def kept_words(
    engine: EngineView,
    keymap: Mapping[str, str],
    now_utc_ns: int | None = None,
    *,
    is_asked_for: bool = False,
) -> tuple[str, ...]:
    """Return wordings of which ended track is kept, the longest first; empty: none is kept.

    ``now_utc_ns``: the frame clock, from which the remaining time is counted.
    ``is_asked_for``: True where the key to follow it again was pressed, and the engine has not
        answered yet.
    """
    if not engine.is_attached:
        return ()
    undo = first_key("undo", keymap)
    if engine.kept is not None and is_asked_for:
        return f"{engine.kept} is being followed again", "being followed again"
    if engine.kept is not None:
        kept = f"{engine.kept} kept"
        timed, brief = kept, kept
        if engine.kept_until_utc_ns is not None and now_utc_ns is not None:
            more = time_left_words((engine.kept_until_utc_ns - now_utc_ns) / NS_PER_S)
            timed, brief = f"{kept} for {more} more", f"{kept} {more}"
        return (
            f"{timed}: {undo} follows it again",
            f"{brief}: {undo} follows it",
            f"{brief}: {undo}",
            f"{kept}: {undo}",
            kept,
        )
    if engine.state != "MANUAL" or engine.target or engine.ra_icrs_deg is not None:
        return ()
    resume, arm = (first_key(name, keymap) for name in ("hold_or_resume", "arm_or_disarm"))
    after = f"{resume} searches again" if engine.is_resumable else f"{arm} hands it over"
    return f"nothing kept: {after}", "nothing kept"
