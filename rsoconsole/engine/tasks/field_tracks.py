"""The present tracks as the status shows them, and the aim of a later exposure at them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from rsoconsole.config import Config, FilterConfig
from rsoconsole.control import NextAim, TrackStatus
from rsoconsole.engine.aim.states import Authority
from rsoconsole.engine.tasks.frame_lights import FrameLights
from rsoconsole.pipeline import FrameObservations, kept_until_utc_ns, tracks_inside
from rsoconsole.records import Measurement
from rsoconsole.tracking import ON_TRIAL, Following
from rsoconsole.words import NS_PER_S


@dataclass(frozen=True, slots=True, kw_only=True)
class AimAhead:
    """Where the telescope looks in the exposure after the next one, and the tracks in its field."""

    aim: NextAim
    inside: frozenset[int]


def aim_ahead(
    ahead: tuple[NextAim, tuple[float, float]] | None, following: Following, config: Config
) -> AimAhead | None:
    """Return the aim of a later exposure, with the tracks in its field.

    ``ahead``: that aim, and the lead track's direction then, ICRS degrees; None gives None.
    """
    if ahead is None:
        return None
    aim, lead = ahead
    states = [each.track for each in following.tracks]
    inside = tracks_inside(
        states,
        lead,
        (aim.ra_icrs_deg, aim.dec_icrs_deg),
        aim.t_utc_ns,
        field_deg=config.optics.field_deg,
        exposure_s=config.exposure.exposure_s,
        settings=config.filter,
    )
    known = zip(states, inside, strict=True)
    return AimAhead(aim=aim, inside=frozenset(t.track_id for t, is_in in known if is_in))


def tracks_now(
    following: Following,
    names: Mapping[int, str],
    shown_of: Callable[[int], FrameObservations],
    now_utc_ns: int,
    ahead: AimAhead | None,
    *,
    lights: FrameLights,
) -> tuple[TrackStatus, ...]:
    """Return all tracks as they are after their last frames, in the order of their numbers.

    ``names``: names of identified tracks, by track id. ``shown_of``: returns the observations of a
    frame by its number, and raises ValueError for a frame that is not kept. ``ahead``: the next
    aim. ``lights``: brightness of what the tracks took last.
    """
    found = []
    for each in sorted(following.tracks, key=lambda one: one.track.track_id):
        track, taken = each.track, each.taken
        is_on_trial = not track.is_lead and track.innovations < ON_TRIAL
        residual = None if track.misses else track.innovation_arcsec
        light = None if taken is None else lights.light_of(taken.measurement_id)
        now = TrackStatus(
            track_id=track.track_id,
            name=names.get(track.track_id),
            is_lead=track.is_lead,
            state="COAST" if track.misses else "trial" if is_on_trial else "TRACK",
            misses=track.misses,
            is_kept=each.is_kept,
            age_s=max(now_utc_ns - each.since_utc_ns, 0) / NS_PER_S if each.since_utc_ns else None,
            residual_east_arcsec=None if residual is None else residual[0],
            residual_north_arcsec=None if residual is None else residual[1],
            nis=None if track.misses else track.nis,
            snr=None if taken is None else _snr_of(taken, shown_of),
            mag=None if light is None else light.mag,
            mag_sigma=None if light is None else light.mag_sigma,
            band=None if light is None else light.band,
            is_saturated=light is not None and light.is_saturated,
            is_in_next_field=None if ahead is None else track.track_id in ahead.inside,
        )
        found.append(now)
    return tuple(found)


def _snr_of(taken: Measurement, shown_of: Callable[[int], FrameObservations]) -> float | None:
    """Return the SNR of the measured streak.

    None where its light was not measured, or its frame is not kept any more.
    """
    try:
        found = shown_of(taken.frame_id).detections
    except ValueError:
        return None
    streaks = (*found.detections, *(each.detection for each in found.rejected))
    at = (taken.x_px, taken.y_px)
    return next((s.snr or None for s in streaks if (s.x_px, s.y_px) == at), None)


class KeptTrack:
    """Remembers until when the ended track that is kept can still be followed again."""

    def __init__(self) -> None:
        self._following: Following | None = None
        self.until_utc_ns: int | None = None
        """Time until which the kept track can be followed again, UTC ns; None without one."""

    def see(self, authority: Authority, settings: FilterConfig, now_utc_ns: int) -> None:
        """Note the loop's state, and set the time when another track is kept.

        While the operator has control, the track is kept for as long as it would be coasted.
        """
        kept = authority.kept
        if kept is None:
            self._following = self.until_utc_ns = None
            return
        if kept is self._following and authority.state != "MANUAL":
            return
        self._following = kept
        is_lent = authority.state == "MANUAL" and authority.is_resumable
        self.until_utc_ns = kept_until_utc_ns(kept, settings, now_utc_ns, is_lent=is_lent)

    def is_over(self, now_utc_ns: int) -> bool:
        """True where the kept track is too old to be followed again."""
        return self.until_utc_ns is not None and now_utc_ns >= self.until_utc_ns


def kept_name(following: Following | None, names: Mapping[int, str]) -> str | None:
    """Return a track's name, else its number in words; None without a track.

    ``names``: names of identified tracks, by track id.
    """
    if following is None or following.track_id is None:
        return None
    return names.get(following.track_id, f"track {following.track_id}")
