"""What is said of a track that coasts: when it was last seen, how long, and when it is given up."""

import math

from rsoconsole.night import ELSEWHERE, NightView
from rsoconsole.records import TrackState
from rsoconsole.sky import NS_PER_S
from rsoconsole.words import clock, left

FRAMES_COUNTED = 60
"""Where it is given up later than after this number of frames, the instant is shown instead."""


def coast_words(night: NightView, now_utc_ns: int | None) -> str:
    """Last seen 05:39:40Z, 60 s ago · coasted 2 · given up after 6 more; empty: no coast."""
    track = night.track
    if track is None or not track.misses:
        return ""
    seen_ns = night.last_seen_utc_ns
    parts = []
    if seen_ns is not None:
        ago = "" if now_utc_ns is None else f", {left((now_utc_ns - seen_ns) / NS_PER_S)} ago"
        parts.append(f"last seen {clock(seen_ns)}{ago}")
    elsewhere = _looked_elsewhere(night, track.misses)
    parts.append(f"coasted {track.misses}{f', {elsewhere} not pointed at it' if elsewhere else ''}")
    parts.append(_end_words(night, track, seen_ns))
    return " · ".join(part for part in parts if part)


def _looked_elsewhere(night: NightView, last: int) -> int:
    """Of the last frames, in how many it could not be seen: they are no misses."""
    reduced = [row for row in night.rows if row.is_reduced][-last:]
    return sum(row.miss == ELSEWHERE for row in reduced)


def _end_words(night: NightView, track: TrackState, seen_ns: int | None) -> str:
    """By which frame, or when, it is lost at the latest; empty where the session cannot say."""
    config = night.config
    if config is None:
        return ""
    cadence_s = float(night.setting("exposure.cadence_s") or 0.0)
    since_ns = track.t_utc_ns if seen_ns is None else seen_ns
    last_ns = since_ns + round(float(night.setting("filter.max_coast_s")) * NS_PER_S)
    if cadence_s <= 0.0:
        return f"given up at {clock(last_ns)}"
    for more in range(1, FRAMES_COUNTED + 1):
        ahead_s = more * cadence_s
        is_late = track.t_utc_ns + ahead_s * NS_PER_S > last_ns
        if is_late or _is_unsure(night, track, ahead_s):
            return f"given up after {more} more"
    return f"given up by {clock(last_ns)}"


def _is_unsure(night: NightView, track: TrackState, ahead_s: float) -> bool:
    """Whether its place is known too badly by then; process noise is left out, which is less."""
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
    """The longer side of its 3-sigma box, half, so much later at its own rates."""
    covariance, dt = track.P, ahead_s
    cos_dec = math.cos(math.radians(track.x[2]))
    ra, dec = (
        covariance[at][at]
        + 2.0 * covariance[at][at + 1] * dt
        + covariance[at + 1][at + 1] * dt * dt
        for at in (0, 2)
    )
    return 3.0 * max(math.sqrt(max(ra, 0.0)) * cos_dec, math.sqrt(max(dec, 0.0)))
