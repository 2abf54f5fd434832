"""Check of a slew's path against the Sun's cone, in steps finer than the cone.

Both axes are assumed to start together at the same rate; the axis with the shorter way ends first.
A real mount is a little different: either axis may also run ahead of the other by half a second at
full speed and by 5 % in rate. These extreme paths enclose all others; paths between them are added
where the cone is narrow, so that the gaps are smaller than the cone.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from rsoconsole.config import LimitsConfig, MountConfig
from rsoconsole.records import FloatArray
from rsoconsole.sky.angles import wrap_360
from rsoconsole.sky.frames import PierSide

POLE_DEG = 0.5
"""Distance from a pole, deg, within which the hour angle has no meaning."""
PARKED_DEG = 0.02
"""Distance from a pole, deg, within which a mount counts as parked: its hour angle is noise."""
POLE_PLACES = 9
"""Number of places of the polar axis, evenly over its range; a parked mount is at the middle."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SlewPath:
    """Path of one slew: start and end angles of both axes, degrees."""

    polar_from_deg: float
    polar_to_deg: float
    declination_from_deg: float
    """Start of the declination axis, deg, as ``declination_axis_deg`` gives it."""
    declination_to_deg: float

    @property
    def travel_deg(self) -> tuple[float, float]:
        """Travel of the polar and the declination axis, degrees, not negative."""
        return (
            abs(self.polar_to_deg - self.polar_from_deg),
            abs(self.declination_to_deg - self.declination_from_deg),
        )


def polar_angle_deg(hour_angle_deg: float, side: PierSide) -> float:
    """Angle of a German mount's polar axis, -270 to 90 deg; at -90 its counterweight is lowest."""
    turned_deg = hour_angle_deg if side == "west" else hour_angle_deg - 180.0
    return wrap_360(turned_deg - 90.0) - 270.0


def declination_axis_deg(dec_deg: float, side: PierSide, latitude_deg: float) -> float:
    """Angle of the declination axis, degrees.

    With the telescope west of the pier it is the declination. East of it the axis is beyond the
    elevated pole: 180 minus the declination in the north, -180 minus the declination in the
    south.
    """
    if side == "west":
        return dec_deg
    return (180.0 if latitude_deg >= 0 else -180.0) - dec_deg


def is_pole(declination_axis_deg: float, within_deg: float = POLE_DEG) -> bool:
    """True where a declination, or an angle of the declination axis, is near a pole of date.

    ``within_deg``: what counts as near.
    """
    return abs(declination_axis_deg % 180.0 - 90.0) < within_deg


def pier_side_after_slew(
    hour_angle_deg: float, present: PierSide | None, flip_hysteresis_deg: float
) -> PierSide | None:
    """Return the side of the pier on which a German mount ends a slew to this hour angle.

    Within ``flip_hysteresis_deg`` of the meridian it keeps the side ``present``. None where that is
    unknown.
    """
    if abs(hour_angle_deg) < flip_hysteresis_deg:
        return present
    return "west" if hour_angle_deg < 0 else "east"


def slew_paths(
    mount: MountConfig,
    limits: LimitsConfig,
    latitude_deg: float,
    start: tuple[float, float, PierSide | None],
    target: tuple[float, float],
) -> Iterator[tuple[SlewPath, PierSide | None]]:
    """Yield each path that a slew may take, and the side of the pier after it (None: fork).

    - start: hour angle, declination of date and side of the pier (None: unknown, both are tried)
    - target: hour angle and declination; at a pole both sides are tried

    At a pole the hour angle does not determine the polar axis. A mount that starts there is taken
    to be at the reported angle or parked; one that ends there may end anywhere in the axis'
    range.
    """
    if mount.type == "fork":
        reach_deg = limits.max_hour_angle_deg
        for way in _polar_ways(start[:2], target, (-reach_deg, reach_deg)):
            yield way, None
            turn_deg = way.polar_to_deg - way.polar_from_deg
            if abs(turn_deg) > 180.0:  # Some drivers turn the shorter way round.
                round_deg = way.polar_to_deg - (360.0 if turn_deg > 0 else -360.0)
                yield replace(way, polar_to_deg=round_deg), None
        return
    both: tuple[PierSide, ...] = ("west", "east")
    reach = (-180.0 - limits.past_meridian_deg, limits.past_meridian_deg)
    for side in both if start[2] is None else (start[2],):
        chosen = pier_side_after_slew(target[0], side, mount.flip_hysteresis_deg) or side
        here = (polar_angle_deg(start[0], side), declination_axis_deg(start[1], side, latitude_deg))
        for arrival in both if is_pole(target[1]) else (chosen,):
            there = (
                polar_angle_deg(target[0], arrival),
                declination_axis_deg(target[1], arrival, latitude_deg),
            )
            for way in _polar_ways(here, there, reach):
                yield way, arrival


def _polar_ways(
    here: tuple[float, float], there: tuple[float, float], reach_deg: tuple[float, float]
) -> Iterator[SlewPath]:
    """Yield ways between (polar, declination) axis angles, with all that a pole leaves open."""
    first_deg, last_deg = reach_deg
    step_deg = (last_deg - first_deg) / (POLE_PLACES - 1)
    anywhere = [first_deg + step_deg * place for place in range(POLE_PLACES)]
    starts, ends = [here[0]], [there[0]]
    if is_pole(here[1]):
        parked_deg = anywhere[POLE_PLACES // 2]
        starts = [parked_deg] if is_pole(here[1], PARKED_DEG) else [parked_deg, here[0]]
    if is_pole(there[1]):
        stays = is_pole(here[1]) and abs(there[1] - here[1]) < 2.0 * POLE_DEG
        ends = [] if stays else anywhere
    for from_deg in starts:
        for to_deg in ends or [from_deg]:
            yield SlewPath(
                polar_from_deg=from_deg,
                polar_to_deg=to_deg,
                declination_from_deg=here[1],
                declination_to_deg=there[1],
            )


LAG_S = 0.5
"""Lag of one axis behind the other, s: ramps that differ by a second make half a second."""
RATE_SPREAD = 0.05
NEARER_DEG = 0.05
"""Largest further approach to the Sun, deg, allowed to a path that begins inside the cone."""
_COARSE_STEPS_DEG = (4.0, 0.5)
_FINE_DEG = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class SunPassage:
    """Point of a slew's path that violates the Sun's cone most."""

    from_sun_deg: float
    kept_deg: float
    """Distance from the Sun, deg, that the path must keep at this point."""
    is_way_out: bool
    """True where the path began inside the cone and comes nearer to the Sun than it was."""


def sun_passage(
    way: SlewPath,
    sun_hour_angle_deg: float,
    sun_dec_deg: float,
    cone_deg: float,
    slew_rate_deg_s: float,
) -> SunPassage | None:
    """Find the point of a slew's path that violates the Sun's cone most; None if none does.

    - A path that begins outside the cone must not enter it, however the axes run.
    - A path that begins inside must not come nearer to the Sun than it has been (by more than
      ``NEARER_DEG``) until it is out; both axes are taken to run at one pace.

    The path is sampled in steps of 4 deg (both axes together), then of 0.5 and 0.05 deg where the
    result is in doubt: at most 0.025 deg of the cone are missed.
    """
    if cone_deg <= 0.0:
        return None
    paces = _paces(way, cone_deg, slew_rate_deg_s)
    lag_deg = LAG_S * slew_rate_deg_s
    sun = (sun_hour_angle_deg, sun_dec_deg)
    start_deg = cone_deg
    for step_deg in _COARSE_STEPS_DEG:
        coarse_deg = _along(way, paces, lag_deg, step_deg, sun)
        start_deg = float(coarse_deg[0, 0])
        if np.min(coarse_deg) - step_deg / 2.0 >= cone_deg:
            return None
    is_way_out = start_deg < cone_deg
    if is_way_out:
        paces = np.zeros(1)
    fine_deg = _along(way, paces, lag_deg, _FINE_DEG, sun)
    kept_deg = np.full(fine_deg.shape, cone_deg)
    if is_way_out:
        kept_deg = np.minimum(cone_deg, np.maximum.accumulate(fine_deg, axis=1) - NEARER_DEG)
    worst = np.unravel_index(np.argmin(fine_deg - kept_deg), fine_deg.shape)
    if fine_deg[worst] >= kept_deg[worst]:
        return None
    return SunPassage(
        from_sun_deg=float(fine_deg[worst]), kept_deg=float(kept_deg[worst]), is_way_out=is_way_out
    )


def _paces(way: SlewPath, cone_deg: float, slew_rate_deg_s: float) -> FloatArray:
    """Paces from -1 (declination axis ahead) to 1 (polar axis); gaps narrower than the cone."""
    width_deg = LAG_S * slew_rate_deg_s + RATE_SPREAD * min(way.travel_deg)
    between = int(np.ceil(width_deg / max(cone_deg, 1.0)))
    return np.linspace(-1.0, 1.0, 2 * between + 1)


def _along(
    way: SlewPath, paces: FloatArray, lag_deg: float, step_deg: float, sun: tuple[float, float]
) -> FloatArray:
    """Distances (paces, N) from the Sun, in steps of at most ``step_deg`` of both axes together."""
    polar_travel_deg, dec_travel_deg = way.travel_deg
    rate = 1.0 - RATE_SPREAD * np.abs(paces)[:, None]
    delay_deg = lag_deg * np.abs(paces)[:, None]
    longest_deg = max(polar_travel_deg, dec_travel_deg) / (1.0 - RATE_SPREAD) + lag_deg
    even_deg = np.linspace(0.0, longest_deg, int(np.ceil(longest_deg / (step_deg / 2.0))) + 1)
    travels_deg = np.array(way.travel_deg)
    # Where an axis starts or ends the way has a corner, and a corner may be the nearest place.
    corners_deg = np.hstack([delay_deg, travels_deg + 0.0 * rate, delay_deg + travels_deg / rate])
    ahead_deg = np.sort(
        np.hstack([np.broadcast_to(even_deg, (paces.size, even_deg.size)), corners_deg]), axis=1
    )
    behind_deg = np.maximum(ahead_deg - delay_deg, 0.0) * rate
    is_polar_ahead = paces[:, None] > 0.0
    polar_gone_deg = np.minimum(np.where(is_polar_ahead, ahead_deg, behind_deg), polar_travel_deg)
    dec_gone_deg = np.minimum(np.where(is_polar_ahead, behind_deg, ahead_deg), dec_travel_deg)
    polar_sign = np.sign(way.polar_to_deg - way.polar_from_deg)
    dec_sign = np.sign(way.declination_to_deg - way.declination_from_deg)
    return distance_from_sun_deg(
        way.polar_from_deg + polar_sign * polar_gone_deg,
        way.declination_from_deg + dec_sign * dec_gone_deg,
        *sun,
    )


def distance_from_sun_deg(
    polar: float | FloatArray,
    declination: float | FloatArray,
    sun_hour_angle_deg: float | FloatArray,
    sun_dec_deg: float | FloatArray,
) -> FloatArray:
    """Angle between a place and the Sun, degrees; good to 1e-6 deg.

    ``polar`` and ``sun_hour_angle_deg``: both hour angles, or both right ascensions.
    ``declination`` may lie beyond a pole, as an angle of the declination axis.
    """
    dec, sun_dec = np.radians(declination), np.radians(sun_dec_deg)
    cosine = np.sin(dec) * np.sin(sun_dec) + np.cos(dec) * np.cos(sun_dec) * np.cos(
        np.radians(np.asarray(polar) - sun_hour_angle_deg)
    )
    return np.asarray(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))
