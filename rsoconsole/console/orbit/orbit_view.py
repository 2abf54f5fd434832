"""What can be said of the orbit at one instant of a night."""

from dataclasses import dataclass

from rsoconsole.console.night import EngineView, OrbitAhead
from rsoconsole.console.tuning import TrackQuality, track_quality
from rsoconsole.console.words import present_utc_ns
from rsoconsole.night import NightView
from rsoconsole.records import Identified, OrbitEstimate
from rsoconsole.sky import NS_PER_S

LEAST_MEASUREMENTS = 3
AHEAD_GOOD_S = 300.0
"""What was computed from another instant is not shown beyond that."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OrbitShown:
    """Orbit, name and what lies ahead, as far as they are known."""

    estimate: OrbitEstimate | None = None
    identified: Identified | None = None
    ahead: OrbitAhead | None = None
    now_utc_ns: int | None = None
    last_utc_ns: int | None = None
    """When it was found, where it is of something that is followed no more."""
    is_past: bool = False
    since_word_s: float | None = None
    """Its age, where it is from before the operator's last word on a frame; else None."""
    absence: str = ""
    """Why there is no orbit; empty where there is one."""
    quality: TrackQuality | None = None
    """Of the lead's track; None where none is measured, or the orbit is of the past."""
    has_site: bool = True
    """Whether the session says from where one looks."""
    has_catalogue: bool = True
    """Whether there was any catalogue to name it by."""


def orbit_shown(night: NightView, engine: EngineView, ahead: OrbitAhead | None) -> OrbitShown:
    """What is known at that instant; ``ahead``: what was computed last, of whatever orbit."""
    now = present_utc_ns(night, engine)
    quality = track_quality(night)
    ahead = ahead if ahead is not None and _is_near(ahead, night, now) else None
    return OrbitShown(
        estimate=night.orbit,
        identified=night.identified,
        ahead=ahead if ahead is not None and _is_of(ahead, night) else None,
        now_utc_ns=now,
        last_utc_ns=night.orbit_utc_ns if night.is_orbit_past else None,
        is_past=night.is_orbit_past,
        quality=quality,
        since_word_s=_since_word_s(night, now),
        absence="" if night.orbit is not None else _absence(night, engine),
        has_site=night.config is not None,
        has_catalogue=night.config is None or bool(night.config.catalogue.tle_files),
    )


def _since_word_s(night: NightView, now: int | None) -> float | None:
    """Age of an orbit that is being fitted again after a word on a frame; None: it is not."""
    orbit, found_ns = night.orbit, night.orbit_utc_ns
    if orbit is None or found_ns is None or orbit.track_id not in night.being_fitted_again:
        return None
    return max(((now or found_ns) - found_ns) / NS_PER_S, 0.0)


def _is_near(ahead: OrbitAhead, night: NightView, now: int | None) -> bool:
    """Whether it was computed of this session, and of about this instant."""
    is_same = ahead.folder == night.folder
    return is_same and now is not None and abs(now - ahead.from_utc_ns) <= AHEAD_GOOD_S * NS_PER_S


def _is_of(ahead: OrbitAhead, night: NightView) -> bool:
    """Whether it is of the orbit on record, or until that is computed, of one just before it."""
    if night.orbit is None:
        return False
    if ahead.estimate == night.orbit:
        return True
    is_same_track = ahead.estimate.track_id == night.orbit.track_id
    is_before = ahead.estimate.frame_id < night.orbit.frame_id
    return not night.is_orbit_past and is_same_track and is_before


def _absence(night: NightView, engine: EngineView) -> str:
    count = _measured(night)
    if night.track is None:
        return "nothing is followed: there is no orbit"
    if count < LEAST_MEASUREMENTS:
        return f"an orbit needs {LEAST_MEASUREMENTS} measurements: {count} so far"
    if night.setting("orbit.online") is False:
        return "no orbit is computed: the setting orbit.online is off"
    if engine.reach == "recorded":
        return "no orbit is on record here: recorded without, or too little was measured"
    return "no orbit yet: the measurements so far tell none"


def _measured(night: NightView) -> int:
    """Measurements that the track has taken, as far as anybody needs to count."""
    count = 1 if night.track_frame_id else 0  # a track begins with its second one
    for row in reversed(night.rows):
        if count >= LEAST_MEASUREMENTS or row.frame_id < night.track_frame_id:
            break
        count += row.is_followed
    return count
