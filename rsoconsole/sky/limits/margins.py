"""Margins of each limit for a tracked direction: by how much it is exceeded at N instants."""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rsoconsole.config import LimitsConfig, MountConfig
from rsoconsole.records import FloatArray, Site, SlewRefusal
from rsoconsole.sky.angles import wrap_180
from rsoconsole.sky.epoch import HourlySky
from rsoconsole.sky.frames import PierSide, altaz_of_hour_angle
from rsoconsole.sky.limits import refusals
from rsoconsole.sky.limits._sun_passage import distance_from_sun_deg, is_pole, polar_angle_deg
from rsoconsole.sky.limits.refusals import AngleLimit, LimitName, Refusal
from rsoconsole.sky.times import IntArray


def horizon_altitude_deg(
    mask: Sequence[tuple[float, float]], azimuth_deg: FloatArray
) -> FloatArray:
    """Altitude of a horizon mask, degrees, at azimuths of any shape.

    mask: (azimuth, altitude) in degrees, at least one point; linear between points, also across
    north.
    """
    azimuths_deg, altitudes_deg = zip(*mask, strict=True)
    return np.asarray(np.interp(azimuth_deg, azimuths_deg, altitudes_deg, period=360.0))


def level_horizon_deg(limits: LimitsConfig) -> float:
    """Altitude of the horizon without a mask: 0, or ``min_altitude_deg`` where that is lower."""
    return min(0.0, limits.min_altitude_deg)


def lowest_altitude_deg(limits: LimitsConfig, azimuth_deg: FloatArray) -> FloatArray:
    """Lowest altitude allowed at azimuths: the horizon mask, without one the level horizon."""
    if limits.horizon:
        return horizon_altitude_deg(limits.horizon, azimuth_deg)
    return np.full(azimuth_deg.shape, level_horizon_deg(limits))


SUN_HARMLESS_DEG = -6.0
"""Altitude of the Sun, deg, below which it is harmless: no tube above the horizon looks at it."""

PARKS_BELOW_DEG = 5.0
"""Depth below the horizon, deg, allowed while parking: a level mount may report a little less."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Margin:
    """Angle against one limit at N instants: value, bound and the excess over the bound, arrays
    (N,).

    An excess above 0 is a violation.
    """

    limit: AngleLimit
    value_deg: FloatArray
    bound_deg: FloatArray
    excess_deg: FloatArray
    azimuth_deg: FloatArray | None = None
    side: PierSide | None = None
    is_axis: bool = False
    """True where the value comes from the angle of the polar axis, not from an hour angle."""

    def waived_where(self, is_let_be: NDArray[np.bool_]) -> "Margin":
        """Return this margin with excess -inf, no violation, where ``is_let_be`` (N,) is True."""
        return replace(self, excess_deg=np.where(is_let_be, -np.inf, self.excess_deg))

    def refusal_at(self, index: int, later_s: float = 0.0) -> Refusal:
        """Return the refusal at the instant of this index, ``later_s`` seconds from now."""
        value_deg, bound_deg = float(self.value_deg[index]), float(self.bound_deg[index])
        if self.is_axis:
            return refusals.polar_axis_refusal(value_deg, bound_deg)
        reason = SlewRefusal.beyond(
            self.limit,
            value_deg,
            bound_deg,
            azimuth_deg=None if self.azimuth_deg is None else float(self.azimuth_deg[index]),
            side=self.side,
            later_s=later_s,
        )
        return Refusal(limit=self.limit, value_deg=value_deg, bound_deg=bound_deg, reason=reason)


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackedPose:
    """Direction of date that a mount tracks, and its side of the pier.

    ``side`` None: unknown, or a fork. ``epoch``: converts the direction to hour angles.
    """

    epoch: HourlySky
    ra_deg: float
    dec_deg: float
    side: PierSide | None


def hour_angle_deg(site: Site, track: TrackedPose, t_ns: IntArray) -> FloatArray:
    """Hour angle of date of a tracked direction, -180 to 180, at (N,) instants."""
    return wrap_180(track.epoch.sidereal_deg(site.longitude_deg, t_ns) - track.ra_deg)


def tracking_margins(
    site: Site,
    limits: LimitsConfig,
    mount: MountConfig,
    track: TrackedPose,
    t_ns: IntArray,
    *,
    lifted: Collection[LimitName],
    is_level_held: bool = True,
) -> Iterator[Margin]:
    """Yield the margin of each limit but twilight at (N,) instants, the gravest limit first.

    Limits in ``lifted`` are left out. ``is_level_held``: True checks the level horizon where
    "altitude" is lifted and the site has no horizon mask.
    """
    if "Sun" not in lifted:
        yield _of_track_from_sun(site, limits, track, t_ns)
    ha_deg = hour_angle_deg(site, track, t_ns)
    altitude_deg, azimuth_deg = altaz_of_hour_angle(
        site, ha_deg, np.full(ha_deg.shape, track.dec_deg)
    )
    if "altitude" not in lifted:
        yield least_angle_margin("altitude", altitude_deg, limits.min_altitude_deg)
    # The level horizon is never higher than the least altitude.
    is_held = bool(limits.horizon) or (is_level_held and "altitude" in lifted)
    if is_held and "horizon" not in lifted:
        bound_deg = lowest_altitude_deg(limits, azimuth_deg)
        yield least_angle_margin("horizon", altitude_deg, bound_deg, azimuth_deg)
    if is_pole(track.dec_deg):
        return
    if "hour angle" not in lifted:
        yield hour_angle_margin(limits, ha_deg)
    if mount.type == "german" and track.side is not None and "pier" not in lifted:
        past_deg = limits.past_meridian_deg if track.side == "west" else -limits.past_meridian_deg
        excess_deg = ha_deg - past_deg if track.side == "west" else past_deg - ha_deg
        yield Margin(
            limit="pier",
            value_deg=ha_deg,
            bound_deg=np.full(ha_deg.shape, past_deg),
            excess_deg=excess_deg,
            side=track.side,
        )


def slewing_margins(
    site: Site,
    limits: LimitsConfig,
    mount: MountConfig,
    track: TrackedPose,
    t_ns: IntArray,
    *,
    lifted: Collection[LimitName],
) -> Iterator[Margin]:
    """Yield the margins that hold during a slew: the Sun's cone, and the turn of the polar axis.

    A flip leads past the pole, where the hour angle may be anything. For a German mount the angle
    of the polar axis is limited: it may raise its counterweight above the horizontal by
    ``past_meridian_deg``. For a fork the hour angle is limited.
    """
    if "Sun" not in lifted:
        yield _of_track_from_sun(site, limits, track, t_ns)
    if is_pole(track.dec_deg):
        return
    ha_deg = hour_angle_deg(site, track, t_ns)
    if mount.type == "fork":
        if "hour angle" not in lifted:
            yield hour_angle_margin(limits, ha_deg)
    elif track.side is not None and "pier" not in lifted:
        axis_deg = np.array([polar_angle_deg(float(one), track.side) for one in ha_deg])
        yield polar_axis_margin(limits, axis_deg)


def sun_altitude_deg(site: Site, epoch: HourlySky, t_ns: IntArray) -> FloatArray:
    """Altitude of the Sun's centre at (N,) instants, without refraction."""
    ra_deg, dec_deg = epoch.sun_apparent_deg(t_ns)
    ha_deg = epoch.sidereal_deg(site.longitude_deg, t_ns) - ra_deg
    return np.asarray(altaz_of_hour_angle(site, ha_deg, dec_deg)[0])


def parking_margins(
    site: Site,
    limits: LimitsConfig,
    mount: MountConfig,
    track: TrackedPose,
    t_ns: IntArray,
    *,
    lifted: Collection[LimitName],
) -> Iterator[Margin]:
    """Yield the margins that apply on the path to a park position.

    They are those of ``slewing_margins``, and a horizon 5 deg below the level one: a park position
    may be level, or behind a wall.
    """
    yield from slewing_margins(site, limits, mount, track, t_ns, lifted=lifted)
    if "horizon" not in lifted:
        ha_deg = hour_angle_deg(site, track, t_ns)
        altitude_deg, azimuth_deg = altaz_of_hour_angle(
            site, ha_deg, np.full(ha_deg.shape, track.dec_deg)
        )
        lowest_deg = level_horizon_deg(limits) - PARKS_BELOW_DEG
        yield least_angle_margin("horizon", altitude_deg, lowest_deg, azimuth_deg)


def sun_cone_margin(  # noqa: PLR0917 -- one place, its two coordinates and their instants
    site: Site,
    limits: LimitsConfig,
    epoch: HourlySky,
    ra_deg: float | FloatArray,
    dec_deg: float | FloatArray,
    t_ns: IntArray,
) -> Margin:
    """Margin of the Sun's cone for a place of date, at (N,) instants.

    No violation while the Sun is more than 6 deg below the horizon.
    """
    sun_ra_deg, sun_dec_deg = epoch.sun_apparent_deg(t_ns)
    distance_deg = distance_from_sun_deg(ra_deg, dec_deg, sun_ra_deg, sun_dec_deg)
    margin = least_angle_margin("Sun", distance_deg, limits.sun_cone_deg)
    return margin.waived_where(sun_altitude_deg(site, epoch, t_ns) <= SUN_HARMLESS_DEG)


def _of_track_from_sun(
    site: Site, limits: LimitsConfig, track: TrackedPose, t_ns: IntArray
) -> Margin:
    return sun_cone_margin(site, limits, track.epoch, track.ra_deg, track.dec_deg, t_ns)


def polar_axis_margin(limits: LimitsConfig, axis_deg: FloatArray) -> Margin:
    """Margin of a German mount's polar axis: its counterweight's angle above the horizontal.

    ``axis_deg``: angles of the axis (N,) as ``polar_angle_deg`` gives them.
    """
    past_deg = np.maximum(axis_deg, -180.0 - axis_deg)
    bound_deg = np.full(axis_deg.shape, limits.past_meridian_deg)
    return Margin(
        limit="pier",
        value_deg=past_deg,
        bound_deg=bound_deg,
        excess_deg=past_deg - bound_deg,
        is_axis=True,
    )


def hour_angle_margin(limits: LimitsConfig, ha_deg: FloatArray) -> Margin:
    """Margin of hour angles (N,) to the largest one allowed, on either side of the meridian."""
    bound_deg = np.copysign(limits.max_hour_angle_deg, ha_deg)
    excess_deg = np.abs(ha_deg) - limits.max_hour_angle_deg
    return Margin(limit="hour angle", value_deg=ha_deg, bound_deg=bound_deg, excess_deg=excess_deg)


def least_angle_margin(
    limit: AngleLimit,
    value_deg: FloatArray,
    bound_deg: float | FloatArray,
    azimuth_deg: FloatArray | None = None,
) -> Margin:
    """Margin of angles (N,) that must not be smaller than ``bound_deg``."""
    bound = np.broadcast_to(bound_deg, value_deg.shape)
    return Margin(
        limit=limit,
        value_deg=value_deg,
        bound_deg=bound,
        excess_deg=bound - value_deg,
        azimuth_deg=azimuth_deg,
    )
