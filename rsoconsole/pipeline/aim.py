"""Where the telescope looks next: search patterns before lock, the prediction after it. Pure."""

from dataclasses import dataclass

from rsoconsole.config import FilterConfig, SearchConfig
from rsoconsole.records import Site, SlewCommand, TrackState
from rsoconsole.sky.angles import separation_deg
from rsoconsole.sky.belt import belt_declination_deg
from rsoconsole.sky.frames import hour_angle_jnow_deg, icrs_of_hour_angle, icrs_to_jnow
from rsoconsole.tracking.lqe import direction_icrs_deg, predict


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchBase:
    """The direction a search starts from, fixed to the ground."""

    hour_angle_deg: float
    """Of date, west positive."""
    declination_deg: float | None
    """Of date; None: the geostationary belt's at each hour angle."""


def search_base(
    search: SearchConfig, site: Site, ra_icrs_deg: float, dec_icrs_deg: float, t_utc_ns: int
) -> SearchBase:
    """As configured; where the configuration is silent, where the telescope points now."""
    here = search_base_at(site, ra_icrs_deg, dec_icrs_deg, t_utc_ns)
    hour_angle_deg = search.hour_angle_deg
    declination_deg = search.declination_deg
    if declination_deg is None and search.pattern == "stay":
        declination_deg = here.declination_deg
    return SearchBase(
        hour_angle_deg=here.hour_angle_deg if hour_angle_deg is None else hour_angle_deg,
        declination_deg=declination_deg,
    )


def search_base_at(
    site: Site, ra_icrs_deg: float, dec_icrs_deg: float, t_utc_ns: int
) -> SearchBase:
    """Around this direction, on its own declination: where something was lost."""
    ra_jnow_deg, dec_jnow_deg = icrs_to_jnow(ra_icrs_deg, dec_icrs_deg, t_utc_ns)
    return SearchBase(
        hour_angle_deg=hour_angle_jnow_deg(site, ra_jnow_deg, t_utc_ns),
        declination_deg=dec_jnow_deg,
    )


def search_direction(
    base: SearchBase,
    search: SearchConfig,
    site: Site,
    *,
    field_width_deg: float,
    exposure_number: int,
    t_utc_ns: int,
) -> tuple[float, float]:
    """ICRS direction of the n-th exposure of a search at the instant ``t_utc_ns``.

    The hour angle stands still during a field's exposures: a geostationary satellite then stays
    where it is in the field while the stars pass.
    """
    field = 0
    if search.pattern == "belt":
        visited = (exposure_number // search.frames_per_field) % search.belt_fields
        field = (visited + 1) // 2 * (1 if visited % 2 else -1)
    hour_angle_deg = base.hour_angle_deg - field * search.belt_step_fields * field_width_deg
    declination_deg = base.declination_deg
    if declination_deg is None:
        declination_deg = belt_declination_deg(site, hour_angle_deg)
    return icrs_of_hour_angle(site, hour_angle_deg, declination_deg, t_utc_ns)


def follow_direction(
    track: TrackState, t_mid_utc_ns: int, settings: FilterConfig
) -> tuple[float, float]:
    """Where the track will be at the middle of the next exposure, ICRS."""
    ahead = predict(track, t_mid_utc_ns, settings, track.frame_id)
    ra_deg, dec_deg = direction_icrs_deg(ahead)
    return ra_deg, min(max(dec_deg, -90.0), 90.0)


def needs_recentre(
    search: SearchConfig,
    field_deg: tuple[float, float],
    centre_icrs_deg: tuple[float, float] | None,
    target_icrs_deg: tuple[float, float],
) -> bool:
    """Whether the telescope must move for this target: always, or out of the central part."""
    if search.recentre == "every" or centre_icrs_deg is None:
        return True
    return separation_deg(*centre_icrs_deg, *target_icrs_deg) > search.recentre_fraction * min(
        field_deg
    )


def slew_to(
    frame_id: int, direction: tuple[float, float], t_aim_utc_ns: int, reason: str
) -> SlewCommand:
    """The command for the record."""
    return SlewCommand(
        frame_id=frame_id,
        ra_icrs_deg=direction[0],
        dec_icrs_deg=direction[1],
        t_aim_utc_ns=t_aim_utc_ns,
        reason=reason,
    )
