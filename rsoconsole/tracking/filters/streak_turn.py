"""What the direction of a streak says of the error of its middle across its motion. Pure.

A star, another streak or a cloud upon one end moves that end across the motion and turns the
streak; the fit to its light knows nothing of it and claims tenths of an arcsec. In 4,500 streaks of
thirty nights of drawn worlds the error across grows with the turn and with the excess of the length
(``streak_length``), far beyond what was claimed: one in fifteen lay beyond three of its sigmas, one
in fifty by what is added here. Stars that drift while the shutter is open turn every streak alike
and move no middle, so the turn counts from the middle of those before it.
"""

import math
import statistics
from collections.abc import Sequence

from rsoconsole.records import Measurement
from rsoconsole.tracking.filters.agreement import (
    SHORTEST_WITH_DIRECTION_ARCSEC,
    Motion,
    streak_motion,
)
from rsoconsole.tracking.filters.streak_length import (
    REMEMBERED,
    excess_arcsec,
    is_run_of_parts,
)

_OF_TURN, _OF_EXCESS = 0.22, 0.021
"""Sigma of the middle across, in half the way that the turn moves an end and in the excess of the
length: the likeliest of those nights, by Student's law with ten degrees of freedom."""


def half_turn_arcsec(measurement: Measurement, expected: Motion) -> float | None:
    """By how much an end lies off the line that the motion has through the middle.

    To the left of the motion, seen from the earlier end; None: the streak has no direction.
    """
    streak = streak_motion(measurement)
    length = expected.length_arcsec
    if streak is None or measurement.is_clipped or measurement.is_crossing or length == 0.0:
        return None
    if not streak.length_arcsec > SHORTEST_WITH_DIRECTION_ARCSEC:
        return None
    east, north = expected.east_arcsec / length, expected.north_arcsec / length
    ahead = streak.east_arcsec * east + streak.north_arcsec * north
    left = streak.north_arcsec * east - streak.east_arcsec * north
    return left / 2.0 if ahead >= 0.0 else -left / 2.0


def across_error_arcsec(
    measurement: Measurement,
    expected: Motion,
    turns_arcsec: Sequence[float] = (),
    excesses_arcsec: Sequence[float] = (),
) -> float:
    """Sigma across the motion beyond the measurement's own, from its streak's turn and excess.

    ``turns_arcsec``, ``excesses_arcsec``: of the streaks before it.
    """
    if not turns_arcsec or not excesses_arcsec:
        return 0.0
    half, excess = half_turn_arcsec(measurement, expected), excess_arcsec(measurement, expected)
    if half is None or excess is None:
        return 0.0
    half -= statistics.median(turns_arcsec)
    if is_run_of_parts(excesses_arcsec, expected.length_arcsec):
        excess = 0.0  # nothing has moved its ends: they are dark
    else:
        excess -= statistics.median(excesses_arcsec)
    return math.hypot(_OF_TURN * half, _OF_EXCESS * excess)


def turns_with(
    before: Sequence[float], measurement: Measurement, expected: Motion
) -> tuple[float, ...]:
    """Half the turns of the streaks up to this one, arcsec."""
    half = half_turn_arcsec(measurement, expected)
    every = before if half is None else (*before, half)
    return tuple(every)[-REMEMBERED:]
