"""Model of a German equatorial mount: slews, settling, tracking, flips, pointing errors.

All coordinates are epoch of date, as in the mount's own software. The axes are described in
coordinates that turn with the sky: ``primary`` is the right ascension to which the polar axis is
turned, ``secondary`` the declination, beyond the elevated pole when the telescope is east of the
pier (looking west). The true boresight is the reported direction plus pointing errors, which are
mostly systematic (polar axis, cone, flexure, a jump at the flip).
"""

from dataclasses import dataclass, field, replace
from math import cos, exp, hypot, pi, radians, sin, sqrt
from typing import Literal

import numpy as np

from rsoconsole.records import FloatArray
from rsoconsole.simulator.camera.rendering import frame_rng
from rsoconsole.sky import lst_deg, wrap_180, wrap_360

NS = 1_000_000_000
_STREAM = 36


@dataclass(frozen=True, slots=True)
class MountCreepAndJumps:
    """Pointing offsets of a mount that creeps after slews and jumps, as a function of time."""

    seed: int
    t_night_utc_ns: int
    settle_s: float = 0.0
    settle_arcsec: float = 0.0
    jump_arcsec: float = 0.0
    jump_every_s: float = 600.0
    _jumps: list[tuple[float, float, float]] = field(default_factory=list)
    """Jump of each interval so far: instant in seconds of the night, degrees east and north."""

    @property
    def is_zero(self) -> bool:
        """True where the mount neither creeps nor jumps: all offsets are 0."""
        return self.settle_s == self.jump_arcsec == 0.0

    def offset_deg(
        self, t_utc_ns: int, since_arrival_s: float, way_deg: tuple[float, float]
    ) -> tuple[float, float]:
        """Return the pointing offset (east, north) due to creep and jumps at an instant.

        ``since_arrival_s``: seconds since the last slew ended. ``way_deg``: displacement (east,
        north) in that slew.
        """
        east_deg, north_deg = self._jumped_deg((t_utc_ns - self.t_night_utc_ns) / NS)
        length_deg = hypot(*way_deg)
        if length_deg > 0.0 and 0.0 <= since_arrival_s < self.settle_s:
            left_deg = self.settle_arcsec / 3600.0 * (1.0 - since_arrival_s / self.settle_s)
            east_deg -= left_deg * way_deg[0] / length_deg
            north_deg -= left_deg * way_deg[1] / length_deg
        return east_deg, north_deg

    def _jumped_deg(self, t_s: float) -> tuple[float, float]:
        """The sum of all jumps until then: one at a random instant of each interval."""
        if self.jump_arcsec == 0.0 or t_s < 0.0:
            return 0.0, 0.0
        while len(self._jumps) <= t_s / self.jump_every_s:
            number = len(self._jumps)
            rng = frame_rng(self.seed, number, _STREAM)
            at_s = (number + rng.random()) * self.jump_every_s
            angle = rng.uniform(0.0, 2.0 * pi)
            size_deg = self.jump_arcsec / 3600.0
            self._jumps.append((at_s, size_deg * cos(angle), size_deg * sin(angle)))
        past = np.array([jump[1:] for jump in self._jumps if jump[0] <= t_s])
        east_deg, north_deg = past.sum(axis=0) if len(past) else (0.0, 0.0)
        return float(east_deg), float(north_deg)


SIDEREAL_DEG_S = 360.98564736629 / 86400.0
_KEPT_MOTIONS = 64
_PATH_STEPS = 401

PierSide = Literal["east", "west"]


@dataclass(frozen=True, slots=True, kw_only=True)
class MountTraits:
    """Motion and pointing errors of the mount; the default errors add up to about 0.1 deg."""

    max_rate_deg_s: float = 4.0
    acceleration_deg_s2: float = 2.0
    settle_amplitude_arcsec: float = 20.0
    settle_tau_s: float = 0.35
    """Decay time of the swing after a slew; after 1.5 s about 0.3 arcsec are left."""
    polar_azimuth_deg: float = 0.070
    polar_altitude_deg: float = -0.050
    cone_deg: float = 0.030
    tube_flexure_deg: float = 0.025
    flip_jump_east_deg: float = 0.040
    flip_jump_north_deg: float = -0.030
    random_arcsec: float = 15.0
    """One sigma of the radial pointing error, drawn once per slew."""
    flip_hysteresis_deg: float = 0.5
    """How far past the meridian a target lies before a slew changes the side of the pier."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportedMountState:
    """State that the mount reports at one instant, without pointing errors; epoch of date."""

    t_utc_ns: int
    ra_date_deg: float
    dec_date_deg: float
    hour_angle_deg: float
    is_slewing: bool
    is_parked: bool
    is_tracking: bool
    pier_side: PierSide
    """Side of the pier on which the telescope is; on the west side it looks east."""


@dataclass(frozen=True, slots=True)
class _Motion:
    """Motion of the axes from one command to the next."""

    t0_utc_ns: int
    primary_deg: float
    secondary_deg: float
    travel_primary_deg: float = 0.0
    travel_secondary_deg: float = 0.0
    is_tracking: bool = True
    tracks_on_arrival: bool = True
    parks_on_arrival: bool = False
    random_east_deg: float = 0.0
    random_north_deg: float = 0.0
    swing_deg: float = 0.0


def travel_s(distance_deg: float, max_rate_deg_s: float, acceleration_deg_s2: float) -> float:
    """Time in which an axis travels a distance, with a trapezoidal rate."""
    distance = abs(distance_deg)
    if distance < max_rate_deg_s**2 / acceleration_deg_s2:
        return 2.0 * sqrt(distance / acceleration_deg_s2)
    return distance / max_rate_deg_s + max_rate_deg_s / acceleration_deg_s2


def travelled_deg(
    distance_deg: float, elapsed_s: float, max_rate_deg_s: float, acceleration_deg_s2: float
) -> float:
    """Signed distance that an axis has travelled after ``elapsed_s``, with a trapezoidal rate."""
    total_s = travel_s(distance_deg, max_rate_deg_s, acceleration_deg_s2)
    if elapsed_s >= total_s:
        return distance_deg
    ramp_s = min(max_rate_deg_s / acceleration_deg_s2, total_s / 2.0)
    left_s = total_s - elapsed_s
    if elapsed_s < ramp_s:
        done = acceleration_deg_s2 * elapsed_s**2 / 2.0
    elif left_s < ramp_s:
        done = abs(distance_deg) - acceleration_deg_s2 * left_s**2 / 2.0
    else:
        done = acceleration_deg_s2 * ramp_s * (elapsed_s - ramp_s / 2.0)
    return done if distance_deg >= 0 else -done


class MountModel:
    """Mount whose commands and queries carry their instant; it reads no clock and does no I/O.

    The last motions are kept, so that the pointing during an exposure can be queried after a later
    slew has begun. Angles in degrees, epoch of date.
    """

    def __init__(
        self,
        *,
        latitude_deg: float,
        longitude_deg: float,
        seed: int,
        t_utc_ns: int,
        ra_date_deg: float,
        dec_date_deg: float,
        traits: MountTraits | None = None,
        unrest: MountCreepAndJumps | None = None,
    ) -> None:
        self.unrest = unrest or MountCreepAndJumps(seed, t_utc_ns)
        self.latitude_deg = latitude_deg
        self.longitude_deg = longitude_deg
        self.traits = traits or MountTraits()
        self._rng = np.random.default_rng([seed, 0x6D6F756E])
        hour_angle_deg = wrap_180(float(lst_deg(longitude_deg, t_utc_ns)) - ra_date_deg)
        side: PierSide = "west" if hour_angle_deg < 0 else "east"
        primary_deg, secondary_deg = self._axes(ra_date_deg, dec_date_deg, side)
        east_deg, north_deg = self._draw_random()
        self._motions = [
            _Motion(
                t_utc_ns,
                primary_deg,
                secondary_deg,
                random_east_deg=east_deg,
                random_north_deg=north_deg,
            )
        ]

    def slew(self, ra_date_deg: float, dec_date_deg: float, t_utc_ns: int) -> float:
        """Slew to a direction and track; returns the duration of the slew, s."""
        now = self.instant(t_utc_ns)
        sidereal_deg = float(lst_deg(self.longitude_deg, t_utc_ns))
        hour_angle_deg = wrap_180(sidereal_deg - ra_date_deg)
        side = self._side_for(hour_angle_deg, now.pier_side)
        return self._go(ra_date_deg, dec_date_deg, side, t_utc_ns)

    def park(self, t_utc_ns: int) -> float:
        """Slew to the pole, counterweight down, and stop; returns the duration of the slew, s."""
        sidereal_deg = float(lst_deg(self.longitude_deg, t_utc_ns))
        pole_deg = 90.0 if self.latitude_deg >= 0 else -90.0
        duration_s = self._go(wrap_360(sidereal_deg + 90.0), pole_deg, "west", t_utc_ns)
        self._motions[-1] = replace(
            self._motions[-1], tracks_on_arrival=False, parks_on_arrival=True
        )
        return duration_s

    def unpark(self, t_utc_ns: int) -> None:
        """End the parked state; the mount stays where it is and does not track."""
        if self.instant(t_utc_ns).is_parked:
            self._rest(t_utc_ns, is_tracking=False)

    def abort(self, t_utc_ns: int) -> None:
        """Stop the slew under way at the axes' present position; tracking stays on or off."""
        now = self.instant(t_utc_ns)
        if now.is_slewing:
            self._rest(t_utc_ns, is_tracking=self._motion_at(t_utc_ns).is_tracking)

    def set_tracking(self, is_on: bool, t_utc_ns: int) -> None:
        """Turn sidereal tracking on or off; during a slew it takes effect at the slew's end."""
        now = self.instant(t_utc_ns)
        if now.is_slewing:
            self._motions[-1] = replace(
                self._motions[-1], is_tracking=is_on, tracks_on_arrival=is_on
            )
        elif now.is_tracking != is_on:
            self._rest(t_utc_ns, is_tracking=is_on)

    def instant(self, t_utc_ns: int) -> ReportedMountState:
        """Return the reported state at an instant, no earlier than the oldest kept motion."""
        motion = self._motion_at(t_utc_ns)
        elapsed_s = (t_utc_ns - motion.t0_utc_ns) / NS
        primary_deg, secondary_deg = self._axes_at(motion, elapsed_s)
        ra_deg, dec_deg, side = _direction(primary_deg, secondary_deg)
        is_slewing = elapsed_s < self._duration_s(motion)
        sidereal_deg = float(lst_deg(self.longitude_deg, t_utc_ns))
        return ReportedMountState(
            t_utc_ns=t_utc_ns,
            ra_date_deg=ra_deg,
            dec_date_deg=dec_deg,
            hour_angle_deg=wrap_180(sidereal_deg - ra_deg),
            is_slewing=is_slewing,
            is_parked=motion.parks_on_arrival and not is_slewing,
            is_tracking=motion.is_tracking if is_slewing else motion.tracks_on_arrival,
            pier_side=side,
        )

    def boresight_date_deg(self, t_utc_ns: int) -> tuple[float, float]:
        """True direction of the telescope: the reported one plus every pointing error."""
        motion = self._motion_at(t_utc_ns)
        now = self.instant(t_utc_ns)
        east_deg, north_deg = systematic_error_deg(
            now.hour_angle_deg, now.dec_date_deg, now.pier_side, self.latitude_deg, self.traits
        )
        east_deg += motion.random_east_deg
        north_deg += motion.random_north_deg
        since_arrival_s = (t_utc_ns - motion.t0_utc_ns) / NS - self._duration_s(motion)
        if motion.swing_deg and since_arrival_s >= 0:
            swing_deg = motion.swing_deg * exp(-since_arrival_s / self.traits.settle_tau_s)
            east_deg += swing_deg * cos(2 * pi * 1.3 * since_arrival_s)
            north_deg += 0.5 * swing_deg * sin(2 * pi * 1.3 * since_arrival_s)
        restless = self.creep_and_jump_offset_deg(t_utc_ns)
        east_deg, north_deg = east_deg + restless[0], north_deg + restless[1]
        dec_deg = max(-90.0, min(90.0, now.dec_date_deg + north_deg))
        cos_dec = max(cos(radians(dec_deg)), 1e-3)
        return wrap_360(now.ra_date_deg + east_deg / cos_dec), dec_deg

    def creep_and_jump_offset_deg(self, t_utc_ns: int) -> tuple[float, float]:
        """Return the pointing offset (east, north), deg, due to creep and jumps at an instant."""
        motion = self._motion_at(t_utc_ns)
        since_arrival_s = (t_utc_ns - motion.t0_utc_ns) / NS - self._duration_s(motion)
        sign = 1.0 if abs(motion.secondary_deg) <= 90.0 else -1.0
        way_deg = (motion.travel_primary_deg, sign * motion.travel_secondary_deg)
        return self.unrest.offset_deg(t_utc_ns, since_arrival_s, way_deg)

    def creep_and_jump_path_arcsec(self, t_first_utc_ns: int, t_last_utc_ns: int) -> FloatArray:
        """Return the path (2, k) of the pointing by creep and jumps, k odd.

        Rows: east, north, arcsec, at k equally spaced instants from the first to the last given,
        relative to the pointing halfway between both.
        """
        instants = np.linspace(t_first_utc_ns, t_last_utc_ns, _PATH_STEPS)
        path = np.array([self.creep_and_jump_offset_deg(round(t)) for t in instants]).T * 3600.0
        return np.asarray(path - path[:, [_PATH_STEPS // 2]], dtype=np.float64)

    def _go(self, ra_date_deg: float, dec_date_deg: float, side: PierSide, t_utc_ns: int) -> float:
        motion = self._motion_at(t_utc_ns)
        primary_deg, secondary_deg = self._axes_at(motion, (t_utc_ns - motion.t0_utc_ns) / NS)
        to_primary_deg, to_secondary_deg = self._axes(ra_date_deg, dec_date_deg, side)
        sidereal_deg = float(lst_deg(self.longitude_deg, t_utc_ns))
        # The polar axis turns with the counterweight low, never through the upper half.
        travel_deg = _axis_angle(sidereal_deg, primary_deg) - _axis_angle(
            sidereal_deg, to_primary_deg
        )
        east_deg, north_deg = self._draw_random()
        distance_deg = hypot(travel_deg, to_secondary_deg - secondary_deg)
        motion = _Motion(
            t_utc_ns,
            primary_deg,
            secondary_deg,
            travel_primary_deg=travel_deg,
            travel_secondary_deg=to_secondary_deg - secondary_deg,
            random_east_deg=east_deg,
            random_north_deg=north_deg,
            swing_deg=self.traits.settle_amplitude_arcsec / 3600.0 * min(1.0, distance_deg),
        )
        self._add(motion)
        return self._duration_s(motion)

    def _rest(self, t_utc_ns: int, *, is_tracking: bool) -> None:
        motion = self._motion_at(t_utc_ns)
        primary_deg, secondary_deg = self._axes_at(motion, (t_utc_ns - motion.t0_utc_ns) / NS)
        self._add(
            _Motion(
                t_utc_ns,
                primary_deg,
                secondary_deg,
                is_tracking=is_tracking,
                tracks_on_arrival=is_tracking,
                random_east_deg=motion.random_east_deg,
                random_north_deg=motion.random_north_deg,
            )
        )

    def _add(self, motion: _Motion) -> None:
        self._motions.append(motion)
        del self._motions[:-_KEPT_MOTIONS]

    def _motion_at(self, t_utc_ns: int) -> _Motion:
        for motion in reversed(self._motions):
            if motion.t0_utc_ns <= t_utc_ns:
                return motion
        return self._motions[0]

    def _duration_s(self, motion: _Motion) -> float:
        rate, acceleration = self.traits.max_rate_deg_s, self.traits.acceleration_deg_s2
        return max(
            travel_s(motion.travel_primary_deg, rate, acceleration),
            travel_s(motion.travel_secondary_deg, rate, acceleration),
        )

    def _axes_at(self, motion: _Motion, elapsed_s: float) -> tuple[float, float]:
        rate, acceleration = self.traits.max_rate_deg_s, self.traits.acceleration_deg_s2
        primary_deg = motion.primary_deg + travelled_deg(
            motion.travel_primary_deg, elapsed_s, rate, acceleration
        )
        secondary_deg = motion.secondary_deg + travelled_deg(
            motion.travel_secondary_deg, elapsed_s, rate, acceleration
        )
        standing_s = max(0.0, elapsed_s - self._duration_s(motion))
        if not motion.tracks_on_arrival:
            primary_deg += SIDEREAL_DEG_S * standing_s
        return primary_deg, secondary_deg

    def _axes(self, ra_deg: float, dec_deg: float, side: PierSide) -> tuple[float, float]:
        if side == "west":
            return ra_deg, dec_deg
        return ra_deg + 180.0, (180.0 if self.latitude_deg >= 0 else -180.0) - dec_deg

    def _side_for(self, hour_angle_deg: float, present: PierSide) -> PierSide:
        if abs(hour_angle_deg) < self.traits.flip_hysteresis_deg:
            return present
        return "west" if hour_angle_deg < 0 else "east"

    def _draw_random(self) -> tuple[float, float]:
        sigma_deg = self.traits.random_arcsec / 3600.0 / sqrt(2.0)
        east_deg, north_deg = self._rng.normal(0.0, sigma_deg, 2)
        return float(east_deg), float(north_deg)


def systematic_error_deg(
    hour_angle_deg: float, dec_deg: float, side: PierSide, latitude_deg: float, traits: MountTraits
) -> tuple[float, float]:
    """Return the systematic error (east on the sky, north) of the boresight, deg.

    Source of the terms (ME, MA, CH, TF): Wallace 1994, TPOINT; the signs of the cone and polar-axis
    terms change with the side of the pier.
    """
    h, d, phi = radians(hour_angle_deg), radians(dec_deg), radians(latitude_deg)
    sign = 1.0 if side == "west" else -1.0
    me, ma = traits.polar_altitude_deg, traits.polar_azimuth_deg
    east_deg = -(me * sin(h) * sin(d) - ma * cos(h) * sin(d)) - sign * traits.cone_deg
    north_deg = me * cos(h) + ma * sin(h)
    east_deg -= traits.tube_flexure_deg * cos(phi) * sin(h)
    north_deg += traits.tube_flexure_deg * (cos(phi) * cos(h) * sin(d) - sin(phi) * cos(d))
    if side == "east":
        east_deg += traits.flip_jump_east_deg
        north_deg += traits.flip_jump_north_deg
    return east_deg, north_deg


def _axis_angle(sidereal_deg: float, primary_deg: float) -> float:
    """Angle of the polar axis, -270 to 90; 0: west of the pier, looking at the meridian."""
    return wrap_360(sidereal_deg - primary_deg - 90.0) - 270.0


def _direction(primary_deg: float, secondary_deg: float) -> tuple[float, float, PierSide]:
    if abs(secondary_deg) > 90.0:
        over_deg = 180.0 if secondary_deg > 0.0 else -180.0
        return wrap_360(primary_deg - 180.0), over_deg - secondary_deg, "east"
    return wrap_360(primary_deg), secondary_deg, "west"
