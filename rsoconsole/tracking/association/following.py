"""What the fold over frames goes by: what one frame showed, and what is tracked. Pure."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

from rsoconsole.config import FilterConfig
from rsoconsole.records import (
    FoldRecord,
    LoopState,
    Measurement,
    Miss,
    Missed,
    NotFollowed,
    NotTaken,
    TrackState,
)
from rsoconsole.tracking.association.neighbours import Field, Neighbour
from rsoconsole.tracking.association.pattern import NO_PATTERN, Pattern
from rsoconsole.tracking.filters import lqe
from rsoconsole.tracking.filters.adaptive import Bend
from rsoconsole.tracking.filters.agreement import Motion, motion_between

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
_MAX_MISSED = 6
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
    missed = min(unexplained, _MAX_MISSED)
    breaks = WRONG_PAIR if predicted.innovations == 0 else BREAKS
    return float(breaks * reappears / another * UNDETECTED**-missed)


Choice = Literal["nearest", "most confident"]


NOTHING_SEEN = Missed(kind="no detection")


CROSSED = Missed(kind="crossing")


MAY_BE_FOLLOWED = ("satellite", "undetermined")
"""Classes of streaks that start a track; any other is told so, unless the operator chose it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Seen:
    """What one frame showed."""

    frame_id: int
    t_mid_utc_ns: int
    exposure_s: float
    measurements: tuple[Measurement, ...]
    """Most confident first."""
    absence: Missed | Callable[[], Missed] = NOTHING_SEEN
    """What a miss of this frame is put down to; a function is asked only where there is one."""
    field: Field | None = None
    """What the frame could show; None where that is not known."""
    star_width_arcsec: float | None = None
    """Full width of its stars at half maximum; None where nobody measured it."""
    chosen: Measurement | None = None
    """The measurement that the operator wants followed; one of ``measurements``."""
    refused: tuple[Measurement, ...] = ()
    """Those that the operator wants left alone; none of ``measurements``."""
    dropped: tuple[int, ...] = ()
    """Tracks that the operator wants followed no more from this frame on, by their numbers."""
    kept: tuple[int, ...] = ()
    """Those that no miss is to end from this frame on."""
    released: tuple[int, ...] = ()
    """Those of which that holds no longer."""
    by_orbit: Callable[[TrackState], TrackState | None] | None = None
    """What the orbit predicts in the place of a prediction that failed; None where it does not.
    Asked only where nothing fits."""

    @property
    def why_absent(self) -> Missed:
        """What a miss of this frame is put down to."""
        return self.absence if isinstance(self.absence, Missed) else self.absence()


@dataclass(frozen=True, slots=True, kw_only=True)
class FollowSettings:
    """What the fold depends on beside its inputs."""

    filter: FilterConfig
    half_field_deg: float
    """Distance from the centre to the nearest edge of the usable field."""
    choice: Choice = "nearest"
    bend: Callable[[int, tuple[float, float], tuple[float, float]], Bend | None] | None = None
    """How an orbit through a direction with a rate (east, north, arcsec/s) may bend at an instant;
    None: nobody knows."""
    is_shutter_known: bool = False
    """Whether the frame's camera mode is calibrated: its scatter is in every measurement."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Tracked:
    """One track between two frames."""

    track: TrackState
    """Last state of the filter: updated, or predicted to the frame that missed."""
    taken: Measurement | None = None
    """The last measurement the track took."""
    neighbours: tuple[Neighbour, ...] = ()
    """What moves alike beside it."""
    rivals: tuple[Rival, ...] = ()
    """What has fitted nothing since, but each other; preset ``adaptive`` only."""
    unexplained: int = 0
    """Frames since then in which nothing hid it, and it was not there."""
    excesses_arcsec: tuple[float, ...] = ()
    """By how much its last streaks were longer than it moves in one exposure."""
    half_turns_arcsec: tuple[float, ...] = ()
    """By how much their ends lay off the line of its motion through their middles."""
    ambiguous: int = 0
    """Frames in a row that could not tell it from another track."""
    is_kept: bool = False
    """Whether the operator's word keeps it: no miss ends it while it may be in the field."""
    since_utc_ns: int = 0
    """When it began, with its second measurement; 0: not known."""
    trial: int = 1
    """Measurements after its second that it needs to outlive a miss where it does not lead."""

    @property
    def is_on_trial(self) -> bool:
        """Whether chance may have made it: the next frame has to show it."""
        return self.track.innovations < self.trial


@dataclass(frozen=True, slots=True, kw_only=True)
class Following:
    """The loop between two frames."""

    state: LoopState = "SEARCH"
    candidates: tuple[Measurement, ...] = ()
    """Measurements of the last frame, each of which may start a track."""
    earlier: tuple[Measurement, ...] = ()
    """Those of the frames before it that may still start one, with later frames that agree."""
    tracks: tuple[Tracked, ...] = ()
    """The lead first; empty where nothing is followed."""
    pattern: Pattern = NO_PATTERN
    """Where the tracks stand to each other."""
    last_track_id: int = 0
    """Of the session's last track that has begun; 0 before the first."""
    dropped: tuple[Tracked, ...] = ()
    """What the operator has dropped and may still be in the field: its streaks begin no track."""

    @property
    def track(self) -> TrackState | None:
        """The lead's last state of the filter."""
        return self.tracks[0].track if self.tracks else None

    @property
    def taken(self) -> Measurement | None:
        """The last measurement the lead took."""
        return self.tracks[0].taken if self.tracks else None

    @property
    def track_id(self) -> int | None:
        """Of the lead; None where there is none."""
        return self.tracks[0].track.track_id if self.tracks else None

    def without_track(
        self,
        state: LoopState,
        candidates: tuple[Measurement, ...] = (),
        earlier: tuple[Measurement, ...] = (),
    ) -> "Following":
        """Nothing is followed any more; the next track is another one."""
        return Following(
            state=state,
            candidates=candidates,
            earlier=earlier,
            last_track_id=self.last_track_id,
            dropped=self.dropped,
        )


def not_followed(
    measurement: Measurement, reason: NotTaken, nis: float | None = None
) -> NotFollowed:
    return NotFollowed(
        frame_id=measurement.frame_id, measurement=measurement, reason=reason, nis=nis
    )


def of_track(records: tuple[FoldRecord, ...], track_id: int | None) -> tuple[FoldRecord, ...]:
    """What was not taken and what was missed, each with its track."""
    return tuple(
        replace(each, track_id=track_id) if isinstance(each, NotFollowed | Miss) else each
        for each in records
    )


def expected_motion(track: TrackState, exposure_s: float) -> Motion:
    """Motion on the sky during one exposure at the track's rates."""
    east_arcsec_s, north_arcsec_s = lqe.sky_rate_arcsec_s(track)
    return Motion(east_arcsec_s * exposure_s, north_arcsec_s * exposure_s)


def three_sigma_deg(track: TrackState) -> float:
    """Half length of the longer side of the 3-sigma box of the state's position on the sky."""
    cos_dec = math.cos(math.radians(track.x[2]))
    return 3.0 * max(math.sqrt(track.P[0][0]) * cos_dec, math.sqrt(track.P[2][2]))
