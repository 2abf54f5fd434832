"""Error of a streak's middle, judged by the streak's length. Pure.

Each end of a streak has its own error, by wind while the shutter opened, by cloud, or by a star
upon it. The sum of both errors is the streak's excess over the length of its motion in one
exposure; half their difference shifts the middle. For independent ends sum and difference scatter
alike, so half of the scatter of the excess from frame to frame is the error along the motion,
whatever the fit claims (Bar-Shalom, Li & Kirubarajan 2001, 3.4: sums and differences of independent
errors). An excess that is the same in every frame (blur, a drift of the stars) moves no middle. But
a streak that is always too short, as of a satellite that flashes, may lie anywhere in its full
length: half of that is assumed.

A satellite that flashes about as often as the shutter opens shows a part of its path in streak
after streak, and that part's place in the whole path changes slowly. The errors of such a run are
one error, which no averaging removes and which looks like a rate. The k-th streak of a run
therefore counts as the k-th part of one (a mean of k values with a common error is no better than
one value). A streak of full length among them counts whole.
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
"""Excesses of two streaks of full length, assumed before the first."""
_MIN_FOR_SCATTER = 4
_OFF_SIGMAS = 2.5
"""Sigmas beyond which an excess speaks for itself."""
_MAD_TO_SIGMA = 1.4826
_ALONE = 0.85
"""Share of the excess's scatter from ends that err independently: haze moves both alike."""
_PART_SHARE = 0.15
"""Share of its length that a streak lacks, from which it shows a part."""
_MIN_PARTS = 3
"""Number of parts in a row from which they are a run."""
_FLASHING_SHARE = 0.3
"""Share of remembered streaks that show a part, from which the object flashes."""
_HARMLESS_SHARE = 0.02
"""Share of its length that every streak may lack at both ends alike."""


class StreakErrors(NamedTuple):
    """Errors of a streak's middle in addition to its measurement's own: one sigma, arcsec."""

    along_arcsec: float = 0.0
    """Error along the streak, from its length."""
    across_arcsec: float = 0.0
    """Error across the streak, arcsec, from its direction and length (``end_offset_arcsec``)."""


NO_ERRORS = StreakErrors()


@dataclass(frozen=True, slots=True, kw_only=True)
class StreakHistory:
    """Shapes of a track's last streaks, arcsec, by which the next one's errors are judged."""

    excesses_arcsec: tuple[float, ...] = ()
    """Excesses of the streaks' lengths over the motion in one exposure."""
    half_turns_arcsec: tuple[float, ...] = ()
    """Offsets of the streaks' ends from the line of the motion through the streaks' middles."""


NO_STREAKS = StreakHistory()


def length_excess_arcsec(measurement: Measurement, expected: Motion) -> float | None:
    """Return a streak's length minus that of its expected motion in one exposure, arcsec.

    None where the streak has no measured length.
    """
    streak = streak_motion(measurement)
    if streak is None or measurement.is_clipped or measurement.is_crossing:
        return None
    if not math.isfinite(streak.length_arcsec):
        return None
    return streak.length_arcsec - expected.length_arcsec


def along_error_arcsec(
    measurement: Measurement, expected: Motion, before: Sequence[float] = ()
) -> float:
    """Return the sigma along the motion that a streak's length excess adds, arcsec.

    ``before``: excesses of the track's earlier streaks, arcsec. Streaks in a row that show a part
    of their length have one error in common; the first of them may lie anywhere in its full
    length.
    """
    excess, length = length_excess_arcsec(measurement, expected), expected.length_arcsec
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


def widened_for_short_streak(
    measurement: Measurement, expected: Motion, before: Sequence[float]
) -> Measurement:
    """Widen the covariance, along the motion, of a streak shorter than ``expected``.

    It is not known which part of the motion such a streak shows; one of full length is returned
    unchanged. ``before``: excesses of the track's earlier streaks, arcsec; each short one directly
    before this streak widens it further.
    """
    excess, length = length_excess_arcsec(measurement, expected), expected.length_arcsec
    if excess is None or excess >= -_PART_SHARE * length:
        return measurement
    variance = (1 + _parts_in_a_row(before, length)) * excess**2 / 12.0
    east, north = expected.east_arcsec / length, expected.north_arcsec / length
    ee, en, nn = measurement.cov_sky_arcsec2
    wider = (ee + variance * east**2, en + variance * east * north, nn + variance * north**2)
    return replace(measurement, cov_sky_arcsec2=wider)


def is_flashing_by_lengths(excesses_arcsec: Sequence[float], length_arcsec: float) -> bool:
    """Return True where a track's object flashes: enough of its streaks are too short."""
    parts = sum(1 for each in excesses_arcsec if each < -_PART_SHARE * length_arcsec)
    return parts >= max(_MIN_PARTS, _FLASHING_SHARE * len(excesses_arcsec))


def _parts_in_a_row(before: Sequence[float], length_arcsec: float) -> int:
    """Number of the last streaks in a row that showed a part of their length alone."""
    of_parts = itertools.takewhile(
        lambda excess: excess < -_PART_SHARE * length_arcsec, reversed(before)
    )
    return sum(1 for _ in of_parts)


def append_length_excess(
    before: Sequence[float], measurement: Measurement, expected: Motion
) -> tuple[float, ...]:
    """Append a measurement's length excess to those of a track's last streaks, arcsec."""
    excess = length_excess_arcsec(measurement, expected)
    every = before if excess is None else (*before, excess)
    return tuple(every)[-REMEMBERED:]


_OF_TURN, _OF_EXCESS = 0.22, 0.021
"""Sigma of the middle across, over half the turn of an end and over the excess of the length: the
likeliest of those nights, by Student's law with ten degrees of freedom."""


def end_offset_arcsec(measurement: Measurement, expected: Motion) -> float | None:
    """Return the offset of a streak's later end from the line of its expected motion, arcsec.

    The line passes through the streak's middle. Offsets are positive to the left of the motion on a
    plane with east to the right and north up. None where the streak has no direction.
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
    """Return the sigma across the motion that a streak's shape adds, arcsec.

    ``turns_arcsec``, ``excesses_arcsec``: end offsets and length excesses of the track's earlier
    streaks.
    """
    if not turns_arcsec or not excesses_arcsec:
        return 0.0
    half, excess = (
        end_offset_arcsec(measurement, expected),
        length_excess_arcsec(measurement, expected),
    )
    if half is None or excess is None:
        return 0.0
    half -= statistics.median(turns_arcsec)
    if _parts_in_a_row(excesses_arcsec, expected.length_arcsec) >= _MIN_PARTS:
        excess = 0.0  # nothing has moved its ends: they are dark
    else:
        excess -= statistics.median(excesses_arcsec)
    return math.hypot(_OF_TURN * half, _OF_EXCESS * excess)


def append_end_offset(
    before: Sequence[float], measurement: Measurement, expected: Motion
) -> tuple[float, ...]:
    """Append a measurement's end offset to those of a track's last streaks, arcsec."""
    half = end_offset_arcsec(measurement, expected)
    every = before if half is None else (*before, half)
    return tuple(every)[-REMEMBERED:]
