"""When what was followed leaves a field that goes with the stars, in the operator's words. Pure."""

import math
from collections.abc import Mapping

from rsoconsole.console.commands import first_key
from rsoconsole.console.night import EngineView
from rsoconsole.console.words.words import cos_deg
from rsoconsole.night import FrameRow, NightView
from rsoconsole.records import TrackState
from rsoconsole.sky import NS_PER_S, wrap_180
from rsoconsole.words import left

MOST_S = 3600.0
"""Later than that is not said."""


def leaving_words(
    night: NightView,
    engine: EngineView,
    now_utc_ns: int | None,
    keymap: Mapping[str, str] | None = None,
) -> str:
    """INTELSAT 21 leaves the field in 4 min; empty: the mount follows, or nobody can say.

    Where autonomy is held the mount stays with the stars as well, and one key ends that.
    """
    is_by_hand = engine.is_attached and engine.state == "MANUAL" and engine.kept is not None
    is_held = engine.is_attached and engine.is_held and engine.holder == "autonomy"
    track = night.track if is_held else night.kept_track if is_by_hand else None
    row = _looked_at(night, is_held=is_held)
    if track is None or row is None or now_utc_ns is None:
        return ""
    if engine.is_slewing or engine.is_tracking is False:
        return ""
    left_s = left_in_field_s(night, track, row, now_utc_ns)
    if left_s is None or left_s > MOST_S:
        return ""
    name = (engine.target or "the satellite") if is_held else engine.kept
    if left_s <= 0.0 and is_held:
        key = first_key("hold_or_resume", keymap)
        return f"{name} is outside the field: {key} follows it again"
    if left_s <= 0.0:
        return f"{name} is out of the field"
    return f"{name} leaves the field in {left(left_s)}"


def left_in_field_s(
    night: NightView, track: TrackState, row: FrameRow, now_utc_ns: int
) -> float | None:
    """Until its place leaves the field of that solved frame, in seconds; None: it stays there.

    0 where it is outside. The field stands among the stars, the track goes on at its rates.
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
    """The last solved frame, of those since the operator has had the mount.

    While autonomy is held, of all, unless a slew has been ordered since.
    """
    since_ns = night.state_since_utc_ns
    if is_held:
        since_ns = 0
        if night.pointing is not None and night.pointing.is_ordered:
            return None
    for row in reversed(night.rows):
        if since_ns is None or row.t_utc_ns is None or row.t_utc_ns < since_ns:
            return None
        if row.is_solved and row.plate_icrs_deg is not None:
            return row
    return None
