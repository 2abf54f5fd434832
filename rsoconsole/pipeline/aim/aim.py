"""Aim point of the next exposure: search patterns before lock, the prediction after it. Pure."""

import math
from dataclasses import dataclass

from rsoconsole.config import AimConfig, FilterConfig, MountConfig, SearchConfig, TargetConfig
from rsoconsole.records import Site, SlewCommand, SlewRefusal, TrackState
from rsoconsole.sky import (
    PierSide,
    geo_belt_declination_deg,
    geo_slot_direction_deg,
    hour_angle_icrs_deg,
    hour_angle_jnow_deg,
    icrs_of_hour_angle,
    icrs_to_jnow,
    pier_side,
    separation_deg,
    wrap_360,
)
from rsoconsole.tracking import predict_motion

SPIRAL_FIELDS = 25
"""Number of fields in a spiral search: two rings around its centre."""
_MIN_COSINE = 0.05
"""Lowest cosine of declination in steps of hour angle, which grow without bound at the pole."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchBase:
    """Direction that a search starts from, as hour angle and declination: fixed over the ground."""

    hour_angle_deg: float
    """Hour angle of date, west positive."""
    declination_deg: float | None
    """Declination of date; None: at each hour angle that of the geostationary belt."""
    comes_before_targets: bool = False
    """True where a track was lost here: this place is searched before the listed targets."""
    widens: bool = False
    """True where a track was lost here: the search is a spiral round it, whatever the pattern."""


def search_base(
    search: SearchConfig, site: Site, ra_icrs_deg: float, dec_icrs_deg: float, t_utc_ns: int
) -> SearchBase:
    """Return the configured base of a search; missing values are those of the given direction.

    The direction (ICRS, degrees) gives a missing hour angle and, with pattern ``stay``, a missing
    declination. With other patterns a missing declination is None: the geostationary belt's.
    """
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
    widens: bool = False,
) -> SearchBase:
    """Return the base of a search around the given direction (ICRS, degrees).

    ``comes_before_targets`` and ``widens``: as in ``SearchBase``, for a direction at which a track
    was lost.
    """
    ra_jnow_deg, dec_jnow_deg = icrs_to_jnow(ra_icrs_deg, dec_icrs_deg, t_utc_ns)
    return SearchBase(
        hour_angle_deg=hour_angle_jnow_deg(site, ra_jnow_deg, t_utc_ns),
        declination_deg=dec_jnow_deg,
        comes_before_targets=comes_before_targets,
        widens=widens,
    )


def fields_in_round(base: SearchBase, search: SearchConfig) -> int:
    """Number of fields in one round of a search, after which it begins again with the first."""
    if base.widens:
        return SPIRAL_FIELDS
    if search.pattern == "belt":
        return search.belt_fields
    if search.pattern == "targets":
        return len(search.targets) + base.comes_before_targets
    return 1


def field_number(base: SearchBase, search: SearchConfig, exposure_number: int) -> int:
    """Return the number of the field, from 0, that an exposure of a search shows.

    ``exposure_number``: counted from 0. Each field has ``search.frames_per_field`` exposures; after
    the last field the search comes back to the first.
    """
    return exposure_number // search.frames_per_field % fields_in_round(base, search)


def search_target(
    base: SearchBase, search: SearchConfig, exposure_number: int
) -> TargetConfig | None:
    """Listed target that an exposure of a search shows; None where it shows no listed target.

    ``exposure_number``: counted from 0.
    """
    if base.widens:
        return None
    number = field_number(base, search, exposure_number) - base.comes_before_targets
    return search.targets[number] if search.pattern == "targets" and number >= 0 else None


def search_direction(
    base: SearchBase,
    search: SearchConfig,
    site: Site,
    *,
    field_deg: tuple[float, float],
    exposure_number: int,
    t_utc_ns: int,
) -> tuple[float, float]:
    """Return the direction (RA, Dec), ICRS degrees, of an exposure of a search at an instant.

    ``exposure_number``: counted from 0; ``field_deg``: width and height of the field. The hour
    angle is constant during a field's exposures, so that a geostationary satellite stays in place
    while the stars pass. Only a target given by its right ascension is fixed among the stars.
    """
    target = search_target(base, search, exposure_number)
    if target is not None:
        return target_direction(target, site, t_utc_ns)
    visited = field_number(base, search, exposure_number)
    if base.widens and base.declination_deg is not None:
        right, up = spiral_cell(visited)
        dec_deg = base.declination_deg + up * search.belt_step_fields * field_deg[1]
        dec_deg = min(max(dec_deg, -90.0), 90.0)
        step_deg = search.belt_step_fields * field_deg[0]
        step_deg /= max(math.cos(math.radians(dec_deg)), _MIN_COSINE)
        return direction_of_hour_angle(
            site, base.hour_angle_deg - right * step_deg, dec_deg, t_utc_ns
        )
    field = 0
    if search.pattern == "belt":
        field = (visited + 1) // 2 * (1 if visited % 2 else -1)
    hour_angle_deg = base.hour_angle_deg - field * search.belt_step_fields * field_deg[0]
    return direction_of_hour_angle(site, hour_angle_deg, base.declination_deg, t_utc_ns)


def spiral_cell(number: int) -> tuple[int, int]:
    """Return (column, row) of a cell of a square spiral: 0 is (0, 0), 1-8 the first ring."""
    if number == 0:
        return 0, 0
    ring = math.ceil((math.sqrt(number + 1) - 1.0) / 2.0)
    side, along = divmod(number - (2 * ring - 1) ** 2, 2 * ring)
    corners = ((ring, 1 - ring), (ring - 1, ring), (-ring, ring - 1), (1 - ring, -ring))
    steps = ((0, 1), (-1, 0), (0, -1), (1, 0))
    (column, row), (right, up) = corners[side], steps[side]
    return column + along * right, row + along * up


def target_direction(target: TargetConfig, site: Site, t_utc_ns: int) -> tuple[float, float]:
    """ICRS direction (RA, Dec) in degrees of a listed target at an instant.

    A declination given with a right ascension is ICRS; one given with an hour angle or a slot is of
    date. Where none is given, it is that of the geostationary belt.
    """
    if target.ra_icrs_deg is not None and target.declination_deg is not None:
        return target.ra_icrs_deg, target.declination_deg
    if target.slot_longitude_deg is not None:
        hour_angle_deg, declination_deg = geo_slot_direction_deg(site, target.slot_longitude_deg)
        if target.declination_deg is not None:
            declination_deg = target.declination_deg
        return direction_of_hour_angle(site, hour_angle_deg, declination_deg, t_utc_ns)
    assert target.hour_angle_deg is not None, "a target says one place"
    return direction_of_hour_angle(site, target.hour_angle_deg, target.declination_deg, t_utc_ns)


def direction_of_hour_angle(
    site: Site, hour_angle_deg: float, declination_deg: float | None, t_utc_ns: int
) -> tuple[float, float]:
    """ICRS direction (RA, Dec) in degrees of an hour angle and declination of date.

    ``declination_deg``: None for the declination of the geostationary belt at that hour angle.
    """
    if declination_deg is None:
        declination_deg = geo_belt_declination_deg(site, hour_angle_deg)
    return icrs_of_hour_angle(site, hour_angle_deg, declination_deg, t_utc_ns)


def pier_side_after_slew(
    site: Site,
    mount: MountConfig,
    direction_icrs_deg: tuple[float, float],
    t_utc_ns: int,
    present: PierSide | None,
) -> PierSide | None:
    """Return the side of the pier after a slew; None where the mount does not report its side.

    ``present``: the side before. A German mount changes sides only for a direction more than
    ``mount.flip_hysteresis_deg`` from the meridian.
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
) -> SlewRefusal | None:
    """Refusal of a slew that changes the side of the pier, where ``mount.meridian`` is "hold".

    None where the side stays, or where the setting allows the change. ``present``: the side now.
    """
    if mount.meridian != "hold":
        return None
    after = pier_side_after_slew(site, mount, direction_icrs_deg, t_utc_ns, present)
    if after == present:
        return None
    hour_angle_deg = hour_angle_icrs_deg(site, *direction_icrs_deg, t_utc_ns)
    return SlewRefusal.by_policy(hour_angle_deg, after)


def follow_direction(
    track: TrackState, t_mid_utc_ns: int, settings: FilterConfig, aim: AimConfig | None = None
) -> tuple[float, float]:
    """Aim point of a track at the next mid-exposure, ICRS degrees, with the offsets of ``aim``."""
    aim = aim or AimConfig()
    led_ns = t_mid_utc_ns + round(aim.lead_s * 1e9)
    return with_aim_offsets(*predict_motion(track, led_ns, settings), aim)


def with_aim_offsets(
    direction_icrs_deg: tuple[float, float], rate_arcsec_s: tuple[float, float], aim: AimConfig
) -> tuple[float, float]:
    """Return a direction (ICRS, degrees) shifted by the offsets of ``aim``.

    The offsets are along the motion, and across it, positive to its left. ``rate_arcsec_s``: rate
    of the motion east and north.
    """
    ra_deg, dec_deg = direction_icrs_deg
    dec_deg = min(max(dec_deg, -90.0), 90.0)
    if aim.along_arcmin == 0.0 and aim.across_arcmin == 0.0:
        return ra_deg, dec_deg
    east, north = rate_arcsec_s
    rate = math.hypot(east, north) or 1.0
    east, north = east / rate, north / rate
    # East is left of north on the sky: to the left of the motion is (-north, east).
    offset_east = (aim.along_arcmin * east - aim.across_arcmin * north) / 60.0
    offset_north = (aim.along_arcmin * north + aim.across_arcmin * east) / 60.0
    dec_after = min(max(dec_deg + offset_north, -90.0), 90.0)
    cos_dec = max(math.cos(math.radians(dec_after)), _MIN_COSINE)
    return float(wrap_360(ra_deg + offset_east / cos_dec)), dec_after


def needs_recentre(
    search: SearchConfig,
    field_deg: tuple[float, float],
    centre_icrs_deg: tuple[float, float] | None,
    target_icrs_deg: tuple[float, float],
) -> bool:
    """Return True if the telescope must move to bring a target near the field's centre.

    True with ``search.recentre`` "every", where the field's centre is not known (None), and where
    the target is farther from it than ``search.recentre_fraction`` of the field's shorter side.
    """
    if search.recentre == "every" or centre_icrs_deg is None:
        return True
    return separation_deg(*centre_icrs_deg, *target_icrs_deg) > search.recentre_fraction * min(
        field_deg
    )


def slew_command(
    frame_id: int,
    direction: tuple[float, float],
    t_aim_utc_ns: int,
    reason: str,
    track_id: int | None = None,
) -> SlewCommand:
    """Return the record of a slew to ``direction`` (ICRS, degrees), aimed for ``t_aim_utc_ns``."""
    return SlewCommand(
        frame_id=frame_id,
        ra_icrs_deg=direction[0],
        dec_icrs_deg=direction[1],
        t_aim_utc_ns=t_aim_utc_ns,
        reason=reason,
        track_id=track_id,
    )
