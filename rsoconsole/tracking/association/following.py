"""Input and state of tracking: the measurements of a frame, and the tracks. Pure."""

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
from rsoconsole.tracking.association.pattern import NO_PATTERN, TrackPattern
from rsoconsole.tracking.filters import lqe
from rsoconsole.tracking.filters.adaptive import Bend
from rsoconsole.tracking.filters.agreement import Motion
from rsoconsole.tracking.filters.streak_length import NO_STREAKS, StreakHistory


@dataclass(frozen=True, slots=True, kw_only=True)
class Rival:
    """Streaks that fit each other but not the track, and so may be the tracked object."""

    measurements: tuple[Measurement, ...]
    track: TrackState | None = None
    """Track through these streaks; None while there is only one."""


Choice = Literal["nearest", "most confident"]
NO_DETECTION = Missed(kind="no detection")
ONLY_CROSSING = Missed(kind="crossing")
TRACKABLE_CLASSES = ("satellite", "undetermined")
"""Classes of streaks that may initiate a track; any other needs the operator's choice."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameInput:
    """Input of one frame to tracking: measurements, field, and the operator's decisions."""

    frame_id: int
    t_mid_utc_ns: int
    exposure_s: float
    measurements: tuple[Measurement, ...]
    absence: Missed | Callable[[], Missed] = NO_DETECTION
    """Reason recorded for a miss in this frame; a function is called only where there is one."""
    field: Field | None = None
    """Field of the frame; None where it is unknown."""
    star_width_arcsec: float | None = None
    """Full width of its stars at half maximum; None where it was not measured."""
    chosen: Measurement | None = None
    """Measurement that the operator wants followed; one of ``measurements``."""
    faint: tuple[Measurement, ...] = ()
    """Candidates below tau, each with its probability; none of ``measurements``."""
    refused: tuple[Measurement, ...] = ()
    """Measurements that the operator rejects; none of ``measurements``."""
    dropped: tuple[int, ...] = ()
    """Numbers of the tracks that the operator drops from this frame on."""
    kept: tuple[int, ...] = ()
    """Numbers of the tracks that the operator keeps: from this frame on no miss ends them."""
    released: tuple[int, ...] = ()
    """Numbers of kept tracks that the operator releases: misses may end them again."""
    by_orbit: Callable[[TrackState], TrackState | None] | None = None
    """Orbit's prediction in place of one that failed, None where it has none."""

    @property
    def miss_reason(self) -> Missed:
        """Reason to record where this frame does not show the tracked object."""
        return self.absence if isinstance(self.absence, Missed) else self.absence()


@dataclass(frozen=True, slots=True, kw_only=True)
class FollowSettings:
    """Settings of tracking."""

    filter: FilterConfig
    half_field_deg: float
    """Distance from the centre to the nearest edge of the usable field."""
    choice: Choice = "nearest"
    bend: Callable[[int, tuple[float, float], tuple[float, float]], Bend | None] | None = None
    """Possible bend of an orbit by instant, direction, rate (e, n, arcsec/s); None: unknown."""
    is_shutter_known: bool = False
    """True where the frame's camera mode is calibrated: its scatter is in every measurement."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LiveTrack:
    """State of one track between two frames."""

    track: TrackState
    """Last state of the filter: updated, or predicted to a frame that missed the track."""
    taken: Measurement | None = None
    neighbours: tuple[Neighbour, ...] = ()
    rivals: tuple[Rival, ...] = ()
    """Streaks since the track's last update that fit only each other; preset ``adaptive`` only."""
    unexplained: int = 0
    """Number of frames since its last update that missed the object although nothing hid it."""
    streaks: StreakHistory = NO_STREAKS
    ambiguous: int = 0
    """Number of frames in a row that could not separate its streak from another track's."""
    is_kept: bool = False
    """True where the operator keeps the track: no miss ends it while it may be in the field."""
    since_utc_ns: int = 0
    """Instant of the last measurement that initiated it; 0: unknown."""
    trial: int = 1
    """Measurements after its second that it needs to outlive a miss where it does not lead."""

    @property
    def is_on_trial(self) -> bool:
        """True while the track may be a chance alignment: the next frame has to show its object."""
        return self.track.innovations < self.trial


@dataclass(frozen=True, slots=True, kw_only=True)
class Following:
    """State of tracking between two frames: all tracks, and candidates for new ones."""

    state: LoopState = "SEARCH"
    candidates: tuple[Measurement, ...] = ()
    earlier: tuple[Measurement, ...] = ()
    """Measurements of earlier frames that may still initiate a track with later ones."""
    faint: tuple[Measurement, ...] = ()
    """Streaks below tau of the last frames, this one included, that may initiate a track."""
    tracks: tuple[LiveTrack, ...] = ()
    """Tracks, the lead first; empty where there is none."""
    pattern: TrackPattern = NO_PATTERN
    last_track_id: int = 0
    """Number of the last track initiated in the session; 0 before the first."""
    dropped: tuple[LiveTrack, ...] = ()
    """Tracks that the operator has dropped, maybe in the field: their streaks initiate none."""

    @property
    def track(self) -> TrackState | None:
        """Last state of the lead track's filter; None where there is no track."""
        return self.tracks[0].track if self.tracks else None

    @property
    def lead_measured(self) -> Measurement | None:
        """Last measurement that the lead track accepted; None where there is none."""
        return self.tracks[0].taken if self.tracks else None

    @property
    def track_id(self) -> int | None:
        """Number of the lead track; None where there is none."""
        return self.tracks[0].track.track_id if self.tracks else None

    def without_track(
        self,
        state: LoopState,
        candidates: tuple[Measurement, ...] = (),
        earlier: tuple[Measurement, ...] = (),
    ) -> "Following":
        """Return a state without tracks; new tracks are numbered on from ``last_track_id``."""
        return Following(
            state=state,
            candidates=candidates,
            earlier=earlier,
            last_track_id=self.last_track_id,
            dropped=self.dropped,
        )


def not_followed_record(
    measurement: Measurement, reason: NotTaken, nis: float | None = None
) -> NotFollowed:
    return NotFollowed(
        frame_id=measurement.frame_id, measurement=measurement, reason=reason, nis=nis
    )


def with_track_id(records: tuple[FoldRecord, ...], track_id: int | None) -> tuple[FoldRecord, ...]:
    """Return the records, with the track's number in misses and rejected measurements."""
    return tuple(
        replace(each, track_id=track_id) if isinstance(each, NotFollowed | Miss) else each
        for each in records
    )


def expected_motion(track: TrackState, exposure_s: float) -> Motion:
    """Motion on the sky during one exposure, at a track's rates."""
    east_arcsec_s, north_arcsec_s = lqe.sky_rate_arcsec_s(track)
    return Motion(east_arcsec_s * exposure_s, north_arcsec_s * exposure_s)


def three_sigma_deg(track: TrackState) -> float:
    """Three sigma of a track's position on the sky, deg, in its more uncertain coordinate."""
    cos_dec = math.cos(math.radians(track.x[2]))
    return 3.0 * max(math.sqrt(track.P[0][0]) * cos_dec, math.sqrt(track.P[2][2]))
