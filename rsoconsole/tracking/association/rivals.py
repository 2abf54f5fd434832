"""Whether a track is where its prediction says, or is what does not fit the prediction. Pure.

A track may be wrong from its first pair on, or its satellite has made a manoeuvre: then streaks
that fit nothing agree with one another, frame after frame. They may as well be another satellite,
while the tracked one is hidden. Both hypotheses are weighed: that the prediction is wrong and the
object reappears at this distance, against another object that comes by and the frames in which the
tracked one was not detected although nothing hid it. From ``SURE_ODDS`` on the track is initiated
again with them. A known neighbour never takes over.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

from rsoconsole.records import Measurement, TrackState
from rsoconsole.tracking.filters import lqe, motion_between

SURE_ODDS = 100.0
"""To one, from which on what does not fit takes over."""
LEAST = 3
"""Frames in which it must have been seen."""
BREAKS = 0.002
"""Chance that a prediction breaks, of one frame: a manoeuvre."""
WRONG_PAIR = 0.05
"""Chance that the two streaks that began a track are not one object, while nothing has met it."""
UNDETECTED = 0.1
"""Chance that what is in the field and hidden by nothing is not detected."""
OTHERS_A_DEG2 = 0.04
"""Other objects in a square degree that move as much alike: a crowded part of the belt has them."""
_BROKEN_ARCSEC = 60.0
"""Scale of the distance to where it reappears; far away it falls with the cube."""
_MOST = 8
_MOST_MISSED = 6
"""More frames without it say no more: what hides it may last."""
_KEPT_S = 130.0
"""Without another streak of it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Rival:
    """Streaks that do not fit what is followed but each other."""

    measurements: tuple[Measurement, ...]
    track: TrackState | None = None
    """Through them, from the second on."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RivalFilter:
    """How rivals are followed: the very functions that a track is followed with."""

    start: Callable[[Measurement, Measurement], TrackState | None]
    """None where the two do not agree on one motion."""
    predict: Callable[[TrackState], TrackState]
    """To the frame's instant."""
    update: Callable[[TrackState, Measurement], TrackState | None]
    """From there; None where the measurement does not fit."""


def after_miss(
    before: tuple[Rival, ...], unfit: tuple[Measurement, ...], t_utc_ns: int, by: RivalFilter
) -> tuple[Rival, ...]:
    """The rivals after a frame in which what is followed was not seen; the longest first."""
    left, found = list(unfit), list[Rival]()
    for rival in sorted(before, key=lambda each: -len(each.measurements)):
        longer = _longer(rival, left, by)
        if longer is not None:
            left.remove(longer.measurements[-1])
            found.append(longer)
        elif (t_utc_ns - rival.measurements[-1].t_mid_utc_ns) / 1e9 <= _KEPT_S:
            found.append(rival)
    found += [Rival(measurements=(each,)) for each in left]
    return tuple(sorted(found, key=lambda each: -len(each.measurements)))[:_MOST]


def _longer(rival: Rival, left: list[Measurement], by: RivalFilter) -> Rival | None:
    fits: list[tuple[float, Measurement, TrackState]] = []
    predicted = None if rival.track is None or not left else by.predict(rival.track)
    for each in left:
        if predicted is None:
            track = by.start(rival.measurements[-1], each)
        else:
            track = by.update(predicted, each)
        if track is not None:
            fits.append((track.nis or 0.0, each, track))
    if not fits:
        return None
    _, taken, track = min(fits, key=lambda fit: fit[0])
    return Rival(measurements=(*rival.measurements, taken), track=track)


def odds(rival: Rival, predicted: TrackState, unexplained: int) -> float:
    """Of its being what is followed, to its being another object.

    ``predicted``: where what is followed should be now; ``unexplained``: frames in which it was
    not detected although nothing hid it.
    """
    if len(rival.measurements) < LEAST:
        return 0.0
    last = rival.measurements[-1]
    away = motion_between(
        *lqe.direction_icrs_deg(predicted), last.ra_icrs_deg, last.dec_icrs_deg
    ).length_arcsec
    spread = lqe.sky_covariance_arcsec2(predicted)
    scale2 = _BROKEN_ARCSEC**2 + math.sqrt(max(float(spread[0, 0] * spread[1, 1]), 0.0))
    # Cauchy's density in two dimensions.
    reappears = (1.0 + away**2 / scale2) ** -1.5 / (2.0 * math.pi * scale2)
    another = OTHERS_A_DEG2 / 3600.0**2
    missed = min(unexplained, _MOST_MISSED)
    breaks = WRONG_PAIR if predicted.innovations == 0 else BREAKS
    return float(breaks * reappears / another * UNDETECTED**-missed)
