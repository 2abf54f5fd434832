"""Where the telescope looks next: search patterns before lock, the prediction after it. Pure."""

from dataclasses import dataclass

from rsoconsole.config import FilterConfig, MountConfig, SearchConfig, TargetConfig
from rsoconsole.records import Site, SlewCommand, TrackState
from rsoconsole.sky.angles import separation_deg
from rsoconsole.sky.belt import belt_declination_deg, slot_direction
from rsoconsole.sky.frames import (
    PierSide,
    hour_angle_icrs_deg,
    hour_angle_jnow_deg,
    icrs_of_hour_angle,
    icrs_to_jnow,
    pier_side,
)
from rsoconsole.tracking.lqe import direction_icrs_deg, predict


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchBase:
    """The direction a search starts from, fixed to the ground."""

    hour_angle_deg: float
    """Of date, west positive."""
    declination_deg: float | None
    """Of date; None: the geostationary belt's at each hour angle."""
    comes_before_targets: bool = False
    """Whether a list of targets is preceded by this place: something was lost here."""


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
    site: Site,
    ra_icrs_deg: float,
    dec_icrs_deg: float,
    t_utc_ns: int,
    *,
    comes_before_targets: bool = False,
) -> SearchBase:
    """Around this direction, on its own declination: where something was lost."""
    ra_jnow_deg, dec_jnow_deg = icrs_to_jnow(ra_icrs_deg, dec_icrs_deg, t_utc_ns)
    return SearchBase(
        hour_angle_deg=hour_angle_jnow_deg(site, ra_jnow_deg, t_utc_ns),
        declination_deg=dec_jnow_deg,
        comes_before_targets=comes_before_targets,
    )


def fields_in_round(base: SearchBase, search: SearchConfig) -> int:
    """How many fields a search visits before it comes back to its first."""
    if search.pattern == "belt":
        return search.belt_fields
    if search.pattern == "targets":
        return len(search.targets) + base.comes_before_targets
    return 1


def field_number(base: SearchBase, search: SearchConfig, exposure_number: int) -> int:
    """Which field of the round the n-th exposure of a search belongs to, from 0."""
    return exposure_number // search.frames_per_field % fields_in_round(base, search)


def search_target(
    base: SearchBase, search: SearchConfig, exposure_number: int
) -> TargetConfig | None:
    """The listed target of the n-th exposure; None where it is of no list."""
    number = field_number(base, search, exposure_number) - base.comes_before_targets
    return search.targets[number] if search.pattern == "targets" and number >= 0 else None


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
    where it is in the field while the stars pass. Only a target given by its right ascension
    stands still among the stars.
    """
    target = search_target(base, search, exposure_number)
    if target is not None:
        return target_direction(target, site, t_utc_ns)
    field = 0
    if search.pattern == "belt":
        visited = field_number(base, search, exposure_number)
        field = (visited + 1) // 2 * (1 if visited % 2 else -1)
    hour_angle_deg = base.hour_angle_deg - field * search.belt_step_fields * field_width_deg
    return fixed_direction(site, hour_angle_deg, base.declination_deg, t_utc_ns)


def target_direction(target: TargetConfig, site: Site, t_utc_ns: int) -> tuple[float, float]:
    """ICRS direction of a listed target at an instant.

    Its declination is ICRS beside a right ascension, else of date; where it is not given, the
    geostationary belt's.
    """
    if target.ra_icrs_deg is not None and target.declination_deg is not None:
        return target.ra_icrs_deg, target.declination_deg
    if target.slot_longitude_deg is not None:
        hour_angle_deg, declination_deg = slot_direction(site, target.slot_longitude_deg)
        if target.declination_deg is not None:
            declination_deg = target.declination_deg
        return fixed_direction(site, hour_angle_deg, declination_deg, t_utc_ns)
    assert target.hour_angle_deg is not None, "a target says one place"
    return fixed_direction(site, target.hour_angle_deg, target.declination_deg, t_utc_ns)


def fixed_direction(
    site: Site, hour_angle_deg: float, declination_deg: float | None, t_utc_ns: int
) -> tuple[float, float]:
    """ICRS direction of a place over the ground, of date; None: on the geostationary belt."""
    if declination_deg is None:
        declination_deg = belt_declination_deg(site, hour_angle_deg)
    return icrs_of_hour_angle(site, hour_angle_deg, declination_deg, t_utc_ns)


def side_at_arrival(
    site: Site,
    mount: MountConfig,
    direction_icrs_deg: tuple[float, float],
    t_utc_ns: int,
    present: PierSide | None,
) -> PierSide | None:
    """The side of the pier the telescope will be on after a slew; None where the mount is mute.

    A German mount changes sides where the direction is far enough past the meridian, not before.
    """
    if present is None or mount.type != "german":
        return present
    hour_angle_deg = hour_angle_icrs_deg(site, *direction_icrs_deg, t_utc_ns)
    if abs(hour_angle_deg) < mount.flip_hysteresis_deg:
        return present
    return pier_side(hour_angle_deg)


def flip_refusal(
    site: Site,
    mount: MountConfig,
    direction_icrs_deg: tuple[float, float],
    t_utc_ns: int,
    present: PierSide | None,
) -> str | None:
    """Why the meridian policy forbids this slew while a track is followed; None when it may be."""
    after = side_at_arrival(site, mount, direction_icrs_deg, t_utc_ns, present)
    if mount.meridian != "hold" or after == present:
        return None
    hour_angle_deg = hour_angle_icrs_deg(site, *direction_icrs_deg, t_utc_ns)
    return (
        f"hour angle {hour_angle_deg:+.1f} deg: the mount would change to the {after} side of its"
        " pier, and mount.meridian is hold"
    )


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
