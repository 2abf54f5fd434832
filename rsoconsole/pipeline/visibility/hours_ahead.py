"""Outlook for a site over the next hours: limits, darkness, the Moon, eclipses. Pure."""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from rsoconsole.config import Config
from rsoconsole.pipeline.cycle.miss_reasons import (
    direction_at,
    is_geostationary_like,
    next_eclipse_utc_ns,
)
from rsoconsole.records import Site, TrackState
from rsoconsole.sky import (
    LimitName,
    Limits,
    Pose,
    Refusal,
    altaz_of_hour_angle,
    geo_slot_direction_deg,
    icrs_to_altaz,
    moon_icrs,
    moon_lit_fraction,
    night_span,
    separation_deg,
    sun_icrs,
    wrap_180,
)
from rsoconsole.words import NS_PER_S

AHEAD_S = 12 * 3600
_STEP_S = 600
_TO_S = 5
WAY_STEPS = 12
SEEN_DEG = 82.0
"""Largest difference in longitude between a site and a geostationary slot above its horizon."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SkyOutlook:
    """Sky over the site at one instant, with the next limits and eclipses; angles in degrees."""

    t_utc_ns: int
    sun_altitude_deg: float
    sun_azimuth_deg: float
    dark_utc_ns: tuple[int, int] | None
    """Begin and end of the present dark time or of the next; None where it does not get dark."""
    moon_altitude_deg: float
    moon_azimuth_deg: float
    moon_lit: float
    moon_away_deg: float | None = None
    margins_deg: tuple[tuple[LimitName, float], ...] = ()
    """Angle from the telescope's direction to each limit, nearest first; negative beyond it."""
    target_limit: tuple[int, Refusal] | None = None
    """Instant at which the track meets a limit, and that limit; None: not before dawn."""
    eclipse_utc_ns: int | None = None
    """Begin of the next eclipse of a geostationary-like track; None without one."""
    here_altaz_deg: tuple[float, float] | None = None
    way_altaz_deg: tuple[tuple[float, float], ...] = ()
    """Predicted (altitude, azimuth) of the track, now and every ten minutes for two hours."""
    belt_altaz_deg: tuple[tuple[float, float], ...] = ()
    """(altitude, azimuth) along the geostationary belt, as far as it is above the horizon."""


def sky_outlook(
    config: Config,
    t_utc_ns: int,
    direction_icrs_deg: tuple[float, float] | None = None,
    track: TrackState | None = None,
) -> SkyOutlook:
    """Compute the sky over the configured site, in about 50 ms.

    ``direction_icrs_deg``: the telescope's direction; ``track``: the track followed. None for
    either leaves the fields about it empty.
    """
    site = config.site.to_site()
    limits = Limits(site, config.limits, config.mount)
    moon = moon_icrs(site, t_utc_ns)
    moon_altitude_deg, moon_azimuth_deg = icrs_to_altaz(site, *moon, t_utc_ns)
    here = direction_icrs_deg
    margins = () if here is None else limits.margins_deg(_pose(here, t_utc_ns))
    dark_utc_ns = night_span(site, t_utc_ns, config.limits.twilight_deg)
    ahead_s = AHEAD_S
    if dark_utc_ns is not None:
        ahead_s = min(ahead_s, max(dark_utc_ns[1] - t_utc_ns, 0) // NS_PER_S)
    sun = icrs_to_altaz(site, *sun_icrs(t_utc_ns), t_utc_ns)
    return SkyOutlook(
        t_utc_ns=t_utc_ns,
        sun_altitude_deg=sun[0],
        sun_azimuth_deg=sun[1],
        dark_utc_ns=dark_utc_ns,
        moon_altitude_deg=moon_altitude_deg,
        moon_azimuth_deg=moon_azimuth_deg,
        moon_lit=moon_lit_fraction(t_utc_ns),
        moon_away_deg=None if here is None else separation_deg(*moon, *here),
        margins_deg=tuple(margin for margin in margins if math.isfinite(margin[1])),
        here_altaz_deg=None if here is None else icrs_to_altaz(site, *here, t_utc_ns),
        way_altaz_deg=() if track is None else _way_of(track, site, t_utc_ns),
        belt_altaz_deg=_belt_places(site),
        target_limit=None if track is None else _limit_of(track, limits, t_utc_ns, ahead_s),
        eclipse_utc_ns=(
            next_eclipse_utc_ns(direction_at(track, t_utc_ns), site, t_utc_ns)
            if track is not None and is_geostationary_like(track)
            else None
        ),
    )


def _way_of(track: TrackState, site: Site, t_utc_ns: int) -> tuple[tuple[float, float], ...]:
    instants = (t_utc_ns + step * _STEP_S * NS_PER_S for step in range(WAY_STEPS + 1))
    return tuple(icrs_to_altaz(site, *direction_at(track, at), at) for at in instants)


@lru_cache(maxsize=4)
def _belt_places(site: Site) -> tuple[tuple[float, float], ...]:
    """Altitude and azimuth of every fifth degree of the visible belt, fixed over the site."""
    places: list[tuple[float, float]] = []
    for slot in range(-180, 180, 5):
        hour_angle_deg, dec_deg = geo_slot_direction_deg(site, float(slot))
        altitude_deg, azimuth_deg = altaz_of_hour_angle(
            site, np.array([hour_angle_deg]), np.array([dec_deg])
        )
        if float(altitude_deg[0]) > 0.0 and abs(wrap_180(slot - site.longitude_deg)) < SEEN_DEG:
            places.append((float(altitude_deg[0]), float(azimuth_deg[0])))
    return tuple(places)


def _limit_of(
    track: TrackState, limits: Limits, t_utc_ns: int, ahead_s: int
) -> tuple[int, Refusal] | None:
    """Instant at which the track, at its constant rates, first meets a limit; to some seconds."""

    def refusal(since_s: int) -> Refusal | None:
        at_ns = t_utc_ns + since_s * NS_PER_S
        return limits.refuse_pose(_pose(direction_at(track, at_ns), at_ns), is_slewing=False)

    steps = ((at_s, refusal(at_s)) for at_s in range(0, ahead_s + _STEP_S, _STEP_S))
    after_s, met = next((step for step in steps if step[1] is not None), (0, None))
    before_s = max(after_s - _STEP_S, 0)
    while met is not None and after_s - before_s > _TO_S:
        middle_s = (before_s + after_s) // 2
        found = refusal(middle_s)
        if found is None:
            before_s = middle_s
        else:
            after_s, met = middle_s, found
    return None if met is None else (t_utc_ns + after_s * NS_PER_S, met)


def _pose(direction_icrs_deg: tuple[float, float], t_utc_ns: int) -> Pose:
    ra_deg, dec_deg = direction_icrs_deg
    return Pose(t_utc_ns=t_utc_ns, ra_icrs_deg=ra_deg, dec_icrs_deg=dec_deg, pier_side=None)
