"""Positions of a moving mount until it can be stopped, and the limits along that path.

The end of a motion that another program has ordered is unknown. Both axes are taken to go on at
constant rates, the declination axis beyond a pole too.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from rsoconsole.config import LimitsConfig, MountConfig
from rsoconsole.records import FloatArray, Site
from rsoconsole.sky.frames import altaz_of_hour_angle
from rsoconsole.sky.limits._sun_passage import (
    SlewPath,
    declination_axis_deg,
    is_pole,
    polar_angle_deg,
)
from rsoconsole.sky.limits.margins import (
    Margin,
    TrackedPose,
    hour_angle_deg,
    hour_angle_margin,
    least_angle_margin,
    lowest_altitude_deg,
    polar_axis_margin,
    sun_cone_margin,
)
from rsoconsole.sky.limits.refusals import LimitName

SIDEREAL_DEG_S = 15.041067 / 3600.0
POLE_ROOM_DEG = 10.0
"""Distance from a pole, deg, within which right ascension and polar axis differ in rate."""
FLIP_ROOM_DEG = 45.0
"""Distance from the elevated pole, deg, within which a flip may lead through any hour angle."""
BESIDE_DEG = 3.0
"""Distance from its way, or its end, deg, up to which a mount is on it."""
PAUSE_DEG_S = 0.05
"""Rate below which an axis counts as still, deg/s."""
_STEP_DEG = 0.5
_MAX_DEG = 90.0


@dataclass(frozen=True, slots=True, kw_only=True)
class MountRates:
    """Rates of right ascension and declination."""

    ra_deg_s: float
    """Rate of the coordinate, deg/s, not times cos declination; 0 where the mount tracks."""
    dec_deg_s: float

    def fastest_deg_s(self, dec_deg: float) -> float:
        """Return the rate of the faster axis, deg/s, not negative.

        Near a pole the rate in right ascension is multiplied by the cosine of the declination.
        """
        near_pole = abs(dec_deg) > 90.0 - POLE_ROOM_DEG
        polar_deg_s = self.ra_deg_s * (np.cos(np.radians(dec_deg)) if near_pole else 1.0)
        return float(max(abs(polar_deg_s), abs(self.dec_deg_s)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PathAhead:
    """Positions that a moving mount will have at N delays from now; the first delay is 0."""

    track: TrackedPose
    t_utc_ns: int
    later_s: FloatArray
    hour_angle_deg: FloatArray
    """Hour angle, not wrapped."""
    declination_deg: FloatArray
    """Declination; beyond 90 deg where the path leads over a pole."""


def extrapolate_path(
    site: Site, track: TrackedPose, t_utc_ns: int, rates: MountRates, ahead_s: float
) -> PathAhead:
    """Extrapolate a mount's position at constant rates for ``ahead_s`` seconds.

    In steps of at most half a degree on either axis, and over at most 90 deg.
    """
    fastest_deg_s = rates.fastest_deg_s(track.dec_deg)
    if fastest_deg_s > 0.0:
        ahead_s = min(ahead_s, _MAX_DEG / fastest_deg_s)
    steps = max(1, int(np.ceil(fastest_deg_s * ahead_s / _STEP_DEG)))
    later_s = np.linspace(0.0, max(ahead_s, 0.0), steps + 1)
    start_deg = float(hour_angle_deg(site, track, np.array([t_utc_ns]))[0])
    return PathAhead(
        track=track,
        t_utc_ns=t_utc_ns,
        later_s=later_s,
        hour_angle_deg=start_deg + (SIDEREAL_DEG_S - rates.ra_deg_s) * later_s,
        declination_deg=track.dec_deg + rates.dec_deg_s * later_s,
    )


def path_ahead_margins(
    site: Site,
    limits: LimitsConfig,
    mount: MountConfig,
    way: PathAhead,
    *,
    lifted: Iterable[LimitName],
) -> Iterator[Margin]:
    """Yield the margin of every limit but twilight along an extrapolated path, the gravest first.

    Limits in ``lifted`` are left out. The hour angle of a German mount counts only far from the
    elevated pole: near it a flip may lead through any hour angle.
    """
    track, held = way.track, frozenset(lifted)
    t_ns = np.full(way.later_s.shape, way.t_utc_ns)
    if "Sun" not in held:
        ra_deg = track.epoch.sidereal_deg(site.longitude_deg, t_ns) - way.hour_angle_deg
        yield sun_cone_margin(site, limits, track.epoch, ra_deg, way.declination_deg, t_ns)
    altitude_deg, azimuth_deg = altaz_of_hour_angle(site, way.hour_angle_deg, way.declination_deg)
    if "altitude" not in held:
        yield least_angle_margin("altitude", altitude_deg, limits.min_altitude_deg)
    if "horizon" not in held:
        bound_deg = lowest_altitude_deg(limits, azimuth_deg)
        yield least_angle_margin("horizon", altitude_deg, bound_deg, azimuth_deg)
    if is_pole(track.dec_deg):
        return
    dec_deg = np.degrees(np.arcsin(np.sin(np.radians(way.declination_deg))))
    if "hour angle" not in held:
        yield _hours_ahead(site, limits, mount, way, dec_deg)
    if mount.type == "german" and track.side is not None and "pier" not in held:
        turned_deg = way.hour_angle_deg - way.hour_angle_deg[0]
        axis_deg = polar_angle_deg(float(way.hour_angle_deg[0]), track.side) + turned_deg
        yield _where_known(polar_axis_margin(limits, axis_deg), dec_deg)


def _hours_ahead(
    site: Site, limits: LimitsConfig, mount: MountConfig, way: PathAhead, dec_deg: FloatArray
) -> Margin:
    wrapped_deg = (way.hour_angle_deg + 180.0) % 360.0 - 180.0
    beyond_pole = np.cos(np.radians(way.declination_deg)) < 0.0
    ha_deg = np.where(beyond_pole, wrapped_deg % 360.0 - 180.0, wrapped_deg)
    margin = hour_angle_margin(limits, ha_deg)
    if mount.type == "fork":
        return _where_known(margin, dec_deg)
    from_pole_deg = 90.0 - (dec_deg if site.latitude_deg >= 0 else -dec_deg)
    return margin.waived_where(from_pole_deg < FLIP_ROOM_DEG)


def _where_known(margin: Margin, dec_deg: FloatArray) -> Margin:
    """Return the margin without violations near a pole, except at the first place.

    The first is reported; expected places there say nothing of the polar axis.
    """
    is_unknown = np.abs(dec_deg) > 90.0 - POLE_ROOM_DEG
    is_unknown[0] = False
    return margin.waived_where(is_unknown)


def keeps_to_slew_path(
    way: SlewPath,
    place: TrackedPose,
    hour_angle_deg: float,
    rates: MountRates | None,
    latitude_deg: float,
) -> bool:
    """True where a mount is on a slew's path, and does not turn away from its end.

    On the path are all positions with both axes between start and end, since either may run ahead.

    - place: where the mount is
    - hour_angle_deg: hour angle of that place at the instant when the slew began
    - rates: None where they are not known; then only the place is checked
    """
    near_pole = abs(place.dec_deg) > 90.0 - POLE_ROOM_DEG
    for side in ("west", "east"):
        # A driver may tell either side in the midst of a flip; a fork is always on the west one.
        at_deg = declination_axis_deg(place.dec_deg, side, latitude_deg)
        dec_deg_s = 0.0 if rates is None else rates.dec_deg_s * (1.0 if side == "west" else -1.0)
        if not _closes_in(way.declination_from_deg, way.declination_to_deg, at_deg, dec_deg_s):
            continue
        turned_deg = polar_angle_deg(hour_angle_deg, side)
        polar_deg_s = 0.0 if rates is None else -rates.ra_deg_s
        # A fork counts its turns otherwise.
        for at_deg in (turned_deg - 360.0, turned_deg, turned_deg + 360.0):
            if near_pole or _closes_in(way.polar_from_deg, way.polar_to_deg, at_deg, polar_deg_s):
                return True
    return False


def _closes_in(from_deg: float, to_deg: float, at_deg: float, rate_deg_s: float) -> bool:
    """True where an axis is between start and end, and does not turn away from its end."""
    low_deg, high_deg = min(from_deg, to_deg) - BESIDE_DEG, max(from_deg, to_deg) + BESIDE_DEG
    left_deg = to_deg - at_deg
    is_turning_away = abs(rate_deg_s) > PAUSE_DEG_S and rate_deg_s * left_deg < 0.0
    return low_deg <= at_deg <= high_deg and (not is_turning_away or abs(left_deg) <= BESIDE_DEG)


UNLEARNED_DEG = 5.0
UNLEARNED_S = 5.0
"""Longest distance, deg, and longest time, s, to stop for a mount without a recorded stop."""
MIN_DEG, MAX_DEG = 0.5, 15.0
SLOW_DEG_S = 0.02
"""Rate below which no stop is recorded, deg/s."""
FASTER = 2.0
"""A recorded stop is used for rates up to this many times its own."""


class StoppingDistance:
    """Distance that a mount moves on after an order to stop, from recorded stops."""

    def __init__(self) -> None:
        self._seen: list[tuple[float, float]] = []

    def learn(self, way_deg: float, rate_deg_s: float) -> None:
        """Record a stop: the rate when it was ordered, and the distance moved after that."""
        if rate_deg_s > SLOW_DEG_S:
            self._seen.append((rate_deg_s, min(max(way_deg, MIN_DEG), MAX_DEG)))

    @property
    def is_learned(self) -> bool:
        """True once a stop of this mount is recorded."""
        return bool(self._seen)

    def at(self, rate_deg_s: float) -> float:
        """Return how far the faster axis may move on after an order to stop at this rate, deg.

        The longest of the recorded stops, each scaled: in proportion to a lower rate, with the
        square of a higher one. Without a usable stop: 5 s at this rate, 5 deg at most.
        """
        known = [
            way_deg * (share if (share := rate_deg_s / seen_deg_s) <= 1.0 else share * share)
            for seen_deg_s, way_deg in self._seen
            if rate_deg_s <= FASTER * seen_deg_s
        ]
        if not known:
            return min(UNLEARNED_DEG, UNLEARNED_S * rate_deg_s)
        return min(max(MIN_DEG, *known), MAX_DEG)
