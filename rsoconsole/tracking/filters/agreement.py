"""Agreement of measurements with a track's motion, and of two that may initiate a track.

Position alone does not distinguish neighbours: rate, streak direction and streak length are
compared too. A streak does not show which end came first, so directions are compared modulo 180
degrees. Before there is a track, the displacement between two frames must match the streaks; with a
track, the streak is compared with the track's rates and its position with the track's bounds. The
displacement from the last measurement would add nothing: inside bounds of even 8 arcmin, after a
coast of half an hour, it always agrees with the track's rate to 2 per cent.
"""

import math
from dataclasses import dataclass

import numpy as np

from rsoconsole.records import FloatArray, Measurement, MotionMismatch
from rsoconsole.sky import wrap_180

DIRECTION_TOLERANCE_DEG = 12.0
LENGTH_TOLERANCE = 0.25
SHORTEST_WITH_DIRECTION_ARCSEC = 20.0
BENT_TOLERANCE_DEG = 20.0
"""Tolerance, deg, of the direction of a streak as long as the motion at the expected place."""
SHORTER_TOLERANCE = 0.4
"""Fraction of its expected length by which a rival's streak may be too short."""
PART_TOLERANCE, LONGER_TOLERANCE = 0.48, 1.0
"""Shares of its length that a track's streak may lack or have too much (``streak_length``)."""
FLASHING_TOLERANCE = 0.65
"""Fraction of its expected length by which the streak of a flashing satellite may be too short."""


@dataclass(frozen=True, slots=True)
class Motion:
    """Displacement on the sky."""

    east_arcsec: float
    north_arcsec: float

    @property
    def length_arcsec(self) -> float:
        """Length of the displacement."""
        return math.hypot(self.east_arcsec, self.north_arcsec)

    @property
    def axis_deg(self) -> float:
        """Position angle of the displacement, whatever its sense: 0 to 180 deg."""
        return math.degrees(math.atan2(self.east_arcsec, self.north_arcsec)) % 180.0


def motion_between(ra_a_deg: float, dec_a_deg: float, ra_b_deg: float, dec_b_deg: float) -> Motion:
    """Displacement from a to b on the sky; for small angles, safe across RA 0h."""
    cos_dec = math.cos(math.radians((dec_a_deg + dec_b_deg) / 2.0))
    return Motion(
        float(wrap_180(ra_b_deg - ra_a_deg)) * cos_dec * 3600.0, (dec_b_deg - dec_a_deg) * 3600.0
    )


def measurement_displacement(one: Measurement, other: Measurement) -> Motion:
    """Displacement from one measurement to another."""
    return motion_between(one.ra_icrs_deg, one.dec_icrs_deg, other.ra_icrs_deg, other.dec_icrs_deg)


def streak_motion(measurement: Measurement) -> Motion | None:
    """Displacement from end to end of a streak, sense unknown; None: its ends are unknown."""
    if measurement.ends_icrs_deg is None:
        return None
    (ra_a, dec_a), (ra_b, dec_b) = measurement.ends_icrs_deg
    return motion_between(ra_a, dec_a, ra_b, dec_b)


def streak_axis(measurement: Measurement) -> FloatArray | None:
    """(2,) unit vector (east, north) along a streak, sense unknown; None: it has no ends."""
    streak = streak_motion(measurement)
    if streak is None or streak.length_arcsec <= 0.0:
        return None
    return np.array([streak.east_arcsec, streak.north_arcsec]) / streak.length_arcsec


def axis_difference_deg(a_deg: float, b_deg: float) -> float:
    """Angle between two undirected axes, 0 to 90."""
    difference = abs(a_deg - b_deg) % 180.0
    return min(difference, 180.0 - difference)


def motion_mismatch(
    measurement: Measurement,
    expected: Motion,
    shorter: float = LENGTH_TOLERANCE,
    longer: float = LENGTH_TOLERANCE,
    bent_deg: float = DIRECTION_TOLERANCE_DEG,
) -> MotionMismatch | None:
    """Reason why the streak cannot be this motion during the exposure; None when it can.

    ``expected``: the motion in one exposure. ``shorter``, ``longer``: fractions of its length by
    which the streak may be too short or too long. ``bent_deg``: largest difference of direction for
    a streak of about the right length. A clipped streak is compared in direction only, a short one
    in length only.
    """
    streak = streak_motion(measurement)
    if streak is None:
        return None
    if min(streak.length_arcsec, expected.length_arcsec) > SHORTEST_WITH_DIRECTION_ARCSEC:
        off_deg = axis_difference_deg(streak.axis_deg, expected.axis_deg)
        off_arcsec = abs(streak.length_arcsec - expected.length_arcsec)
        is_whole = off_arcsec <= LENGTH_TOLERANCE * expected.length_arcsec
        if off_deg > (bent_deg if is_whole else DIRECTION_TOLERANCE_DEG):
            return MotionMismatch.of_direction(off_deg)
    if measurement.is_clipped:
        return None
    share = shorter if streak.length_arcsec < expected.length_arcsec else longer
    allowed_arcsec = max(share * expected.length_arcsec, 10.0)
    if abs(streak.length_arcsec - expected.length_arcsec) > allowed_arcsec:
        return MotionMismatch.of_length(streak.length_arcsec, expected.length_arcsec)
    return None


def pair_motion_mismatch(
    first: Measurement, second: Measurement, exposure_s: float
) -> MotionMismatch | None:
    """Reason why two measurements of successive frames cannot be one object; None when they can.

    Their displacement, scaled to the exposure, must match the streaks in length and axis.
    """
    in_exposure = motion_in_exposure(first, second, exposure_s)
    if in_exposure is None:
        return MotionMismatch(kind="order of time")
    for measurement in (first, second):
        reason = motion_mismatch(measurement, in_exposure)
        if reason is not None:
            return reason
    return None


def pair_misfit_arcsec(first: Measurement, second: Measurement, exposure_s: float) -> float:
    """Return how far the displacement of a pair is from its streaks, in either sense, arcsec.

    Where neighbours are as close as one of them moves, several pairs agree within the tolerances:
    the pair with the least value is the one object. 0 where no ends are known.
    """
    moved = motion_in_exposure(first, second, exposure_s)
    if moved is None:
        return math.inf
    misfits = [0.0]
    for streak in (streak_motion(first), streak_motion(second)):
        if streak is not None:
            misfits.append(
                min(
                    math.hypot(
                        moved.east_arcsec - sense * streak.east_arcsec,
                        moved.north_arcsec - sense * streak.north_arcsec,
                    )
                    for sense in (1.0, -1.0)
                )
            )
    return max(misfits)


def motion_in_exposure(first: Measurement, second: Measurement, exposure_s: float) -> Motion | None:
    """Displacement between two measurements, scaled to one exposure; None: not in order of time."""
    dt_s = (second.t_mid_utc_ns - first.t_mid_utc_ns) / 1e9
    if dt_s <= 0:
        return None
    moved, share = measurement_displacement(first, second), exposure_s / dt_s
    return Motion(moved.east_arcsec * share, moved.north_arcsec * share)
