"""Error of a streak's middle, judged by the streak's length. Pure.

The middle lies between two ends, each with an error of its own: of wind that blew while the shutter
opened, of cloud, of a star upon it. The sum of both errors is the streak's excess over the length
of its motion in one exposure; half their difference shifts the middle. Independent ends make sum
and difference equally large, so the scatter of the excess from frame to frame gives the error along
the motion, whatever the fit claims (half of it; Bar-Shalom, Li & Kirubarajan 2001, 3.4: sums and
differences of independent errors). An excess that is the same in every frame (blur, a drift of the
stars) moves no middle; but a streak that is always too short, as of a satellite that flashes, may
lie anywhere in its full length: half of that is assumed.

A satellite that flashes about as often as the shutter opens shows a part of its path in streak
after streak, and the part's place within the whole creeps from frame to frame. The errors of such a
run are one error, which no averaging takes away and which looks like a rate. The k-th streak of a
run therefore counts as the k-th part of one (a mean of k values with one error in common is no
better than one of them). A streak of full length among them has both its ends and counts whole.
"""

import itertools
import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from rsoconsole.records import Measurement
from rsoconsole.tracking.filters.agreement import (
    SHORTEST_WITH_DIRECTION_ARCSEC,
    Motion,
    streak_motion,
)

REMEMBERED = 30
"""Number of a track's last streaks whose excess and end offset are remembered."""
_NONE_AT_FIRST = (0.0, 0.0)
"""Excesses of two streaks of full length, assumed before the first: the centre does not follow the
first alone."""
_MIN_FOR_SCATTER = 4
_OFF_SIGMAS = 2.5
"""Sigmas beyond which an excess speaks for itself."""
_MAD_TO_SIGMA = 1.4826
_ALONE = 0.85
"""Share of the excess's scatter from ends that err independently: haze moves both alike."""
_PART_SHARE = 0.15
"""Share of its length that a streak lacks, from which it shows a part: more than blur and haze
take."""
_MIN_PARTS = 3
"""Number of parts in a row from which they are a run."""
_FLASHING_SHARE = 0.3
"""Share of remembered streaks that show a part, from which the object flashes rather than meets
clouds."""
_HARMLESS_SHARE = 0.02
"""Share of its length that every streak may lack at both ends alike, as its light fades into the
sky."""


class StreakErrors(NamedTuple):
    """Errors of a streak's middle beyond what its measurement states: one sigma, arcsec."""

    along_arcsec: float = 0.0
    """Error along the streak, from its length."""
    across_arcsec: float = 0.0
    """Error across the streak, from its direction and length (``end_offset_arcsec``).

    It becomes part of the measurement's covariance, so that a bank scales it with the rest.
    """


NO_ERRORS = StreakErrors()


@dataclass(frozen=True, slots=True, kw_only=True)
class StreakHistory:
    """Shapes of a track's last streaks, by which the errors of the next one are judged; arcsec."""

    excesses_arcsec: tuple[float, ...] = ()
    """Excesses of the streaks' lengths over the motion in one exposure."""
    half_turns_arcsec: tuple[float, ...] = ()
    """Offsets of the streaks' ends from the line of the motion through the streaks' middles."""


NO_STREAKS = StreakHistory()


def excess_arcsec(measurement: Measurement, expected: Motion) -> float | None:
    """Excess of a streak's length over its motion in one exposure; None: it has no length."""
    streak = streak_motion(measurement)
    if streak is None or measurement.is_clipped or measurement.is_crossing:
        return None
    if not math.isfinite(streak.length_arcsec):
        return None
    return streak.length_arcsec - expected.length_arcsec


def along_error_arcsec(
    measurement: Measurement, expected: Motion, before: Sequence[float] = ()
) -> float:
    """Sigma along the motion beyond the measurement's own, from the excess of its streak.

    ``before``: excesses of the track's earlier streaks, arcsec. Streaks in a row that show a part
    of their length have one error in common; the first of them may lie anywhere in its full length.
    """
    excess, length = excess_arcsec(measurement, expected), expected.length_arcsec
    if excess is None or length == 0.0:
        return 0.0
    ahead = np.array([expected.east_arcsec, expected.north_arcsec]) / length
    ee, en, nn = measurement.cov_sky_arcsec2
    own2 = max(float(ahead @ np.array([[ee, en], [en, nn]]) @ ahead), 0.0)
    parts = _parts_in_a_row(before, length)
    if parts >= _MIN_PARTS:
        lacks = max(-excess - _HARMLESS_SHARE * length, 0.0)
        over = max(excess, 0.0)
        return math.sqrt(max((1 + parts) * lacks**2 / 12.0 + over**2 / 4.0 - own2, 0.0))
    centre = statistics.median((*before, *_NONE_AT_FIRST))
    scatter = 0.0
    if len(before) >= _MIN_FOR_SCATTER:
        scatter = _ALONE * _MAD_TO_SIGMA * statistics.median(abs(each - centre) for each in before)
    away = abs(excess - centre)
    if away <= _OFF_SIGMAS * max(scatter, 2.0 * math.sqrt(own2)):
        away = scatter
    slack = max(-centre - _HARMLESS_SHARE * length, 0.0)
    variance = away**2 / 4.0 + slack**2 / 24.0
    if excess < -_PART_SHARE * length:
        variance = max(variance, (1 + parts) * excess**2 / 12.0)
    return math.sqrt(max(variance - own2, 0.0))


def with_part_error(
    measurement: Measurement, expected: Motion, before: Sequence[float]
) -> Measurement:
    """Widen, along the motion, the covariance of a streak shorter than ``expected``.

    Which part of the motion it shows is not known; a streak of full length is returned unchanged.
    ``before``: length minus expected length of the track's earlier streaks, arcsec; each short one
    directly before this widens it further.
    """
    excess, length = excess_arcsec(measurement, expected), expected.length_arcsec
    if excess is None or excess >= -_PART_SHARE * length:
        return measurement
    variance = (1 + _parts_in_a_row(before, length)) * excess**2 / 12.0
    east, north = expected.east_arcsec / length, expected.north_arcsec / length
    ee, en, nn = measurement.cov_sky_arcsec2
    wider = (ee + variance * east**2, en + variance * east * north, nn + variance * north**2)
    return replace(measurement, cov_sky_arcsec2=wider)


def flashes_by_lengths(excesses_arcsec: Sequence[float], length_arcsec: float) -> bool:
    """True where enough of a track's streaks show only a part of their length: it flashes."""
    parts = sum(1 for each in excesses_arcsec if each < -_PART_SHARE * length_arcsec)
    return parts >= max(_MIN_PARTS, _FLASHING_SHARE * len(excesses_arcsec))


def _parts_in_a_row(before: Sequence[float], length_arcsec: float) -> int:
    """Number of the last streaks in a row that showed a part of their length alone."""
    of_parts = itertools.takewhile(
        lambda excess: excess < -_PART_SHARE * length_arcsec, reversed(before)
    )
    return sum(1 for _ in of_parts)


def excesses_with(
    before: Sequence[float], measurement: Measurement, expected: Motion
) -> tuple[float, ...]:
    """Excesses of a track's last streaks, with that of one more measurement, arcsec."""
    excess = excess_arcsec(measurement, expected)
    every = before if excess is None else (*before, excess)
    return tuple(every)[-REMEMBERED:]


_OF_TURN, _OF_EXCESS = 0.22, 0.021
"""Sigma of the middle across, over half the turn of an end and over the excess of the length: the
likeliest of those nights, by Student's law with ten degrees of freedom."""


def end_offset_arcsec(measurement: Measurement, expected: Motion) -> float | None:
    """Offset of a streak's end from the line of the motion through the streak's middle.

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
    """Sigma across the motion beyond the measurement's own, from its streak's shape.

    ``turns_arcsec``: end offsets of the track's earlier streaks. ``excesses_arcsec``: excesses of
    their lengths.
    """
    if not turns_arcsec or not excesses_arcsec:
        return 0.0
    half, excess = end_offset_arcsec(measurement, expected), excess_arcsec(measurement, expected)
    if half is None or excess is None:
        return 0.0
    half -= statistics.median(turns_arcsec)
    if _parts_in_a_row(excesses_arcsec, expected.length_arcsec) >= _MIN_PARTS:
        excess = 0.0  # nothing has moved its ends: they are dark
    else:
        excess -= statistics.median(excesses_arcsec)
    return math.hypot(_OF_TURN * half, _OF_EXCESS * excess)


def end_offsets_with(
    before: Sequence[float], measurement: Measurement, expected: Motion
) -> tuple[float, ...]:
    """End offsets of a track's last streaks, with that of one more measurement, arcsec."""
    half = end_offset_arcsec(measurement, expected)
    every = before if half is None else (*before, half)
    return tuple(every)[-REMEMBERED:]
