"""The two axes of an equatorial mount and the ways a slew may turn them.

Angles of date. The polar axis is counted in hour angle: what a telescope west of the pier looks
at. East of the pier the same axis looks at the opposite hour angle, and the declination axis has
gone over the elevated pole. While it slews the mount turns with the sky, so that a way is a line
in hour angles of the instant at which it begins.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

from rsoconsole.config import LimitsConfig, MountConfig
from rsoconsole.sky import PierSide, wrap_360

POLE_DEG = 0.5
"""So near to a pole the hour angle tells nothing."""
PARKED_DEG = 0.02
"""So near to a pole the reported hour angle is noise: the mount is taken to be parked there."""
POLE_PLACES = 9
"""Of the polar axis, evenly over its range; the middle one is where mounts are parked: a German
mount with its counterweight down, a fork at the meridian."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Way:
    """One slew as the axes go it."""

    polar_from_deg: float
    polar_to_deg: float
    declination_from_deg: float
    """Beyond the elevated pole where the telescope is east of the pier."""
    declination_to_deg: float

    @property
    def travel_deg(self) -> tuple[float, float]:
        """What either axis has to go, not negative."""
        return (
            abs(self.polar_to_deg - self.polar_from_deg),
            abs(self.declination_to_deg - self.declination_from_deg),
        )


def polar_deg(hour_angle_deg: float, side: PierSide) -> float:
    """Where the polar axis of a German mount stands, -270 to 90: with the counterweight low."""
    turned_deg = hour_angle_deg if side == "west" else hour_angle_deg - 180.0
    return wrap_360(turned_deg - 90.0) - 270.0


def declination_axis_deg(dec_deg: float, side: PierSide, latitude_deg: float) -> float:
    """Where the declination axis stands: over the pole that is up when east of the pier."""
    if side == "west":
        return dec_deg
    return (180.0 if latitude_deg >= 0 else -180.0) - dec_deg


def is_pole(declination_axis_deg: float, within_deg: float = POLE_DEG) -> bool:
    """Whether the declination axis, or a declination, is so near to a pole of date."""
    return abs(declination_axis_deg % 180.0 - 90.0) < within_deg


def side_after(
    hour_angle_deg: float, present: PierSide | None, flip_hysteresis_deg: float
) -> PierSide | None:
    """Side of the pier a German mount chooses for a target; None where that cannot be told."""
    if abs(hour_angle_deg) < flip_hysteresis_deg:
        return present
    return "west" if hour_angle_deg < 0 else "east"


def ways(
    mount: MountConfig,
    limits: LimitsConfig,
    latitude_deg: float,
    start: tuple[float, float, PierSide | None],
    target: tuple[float, float],
) -> Iterator[tuple[Way, PierSide | None]]:
    """Every way a slew may take, with the side of the pier at its end (None: a fork).

    start: hour angle, declination of date and side of the pier; target: hour angle and
    declination. At a pole the hour angle tells little of the polar axis: a mount that stands there
    is tried from where it says and from where it would be parked, one that goes there to places
    all over the range. An unknown side of the pier (also: at a pole as the target) means both.
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
        chosen = side_after(target[0], side, mount.flip_hysteresis_deg) or side
        here = (polar_deg(start[0], side), declination_axis_deg(start[1], side, latitude_deg))
        for arrival in both if is_pole(target[1]) else (chosen,):
            there = (
                polar_deg(target[0], arrival),
                declination_axis_deg(target[1], arrival, latitude_deg),
            )
            for way in _polar_ways(here, there, reach):
                yield way, arrival


def _polar_ways(
    here: tuple[float, float], there: tuple[float, float], reach_deg: tuple[float, float]
) -> Iterator[Way]:
    """From and to (polar, declination) axis angles, with what a pole leaves open."""
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
            yield Way(
                polar_from_deg=from_deg,
                polar_to_deg=to_deg,
                declination_from_deg=here[1],
                declination_to_deg=there[1],
            )
