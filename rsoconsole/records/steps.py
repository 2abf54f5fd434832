"""The common records: one for each step from frame to slew.

``Frame -> Detections -> Solution | NotSolved -> Measurement -> TrackState -> SlewCommand``. Every
record names the frame it came from. Units, everywhere inside the program: degrees for directions,
arcseconds for errors on the sky, degrees per second for rates, pixels with 0 at the centre of the
first pixel (x = column, y = row of the array as stored), UTC nanoseconds since 1970 for instants.
Directions are ICRS unless the name says otherwise.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias

from rsoconsole.records.field import ExpectedMembers, PairMotions
from rsoconsole.records.frames import (
    CameraMode,
    Closeup,
    Detections,
    NotSolved,
    ObjectClass,
    Solution,
    middle_utc_ns,
)
from rsoconsole.records.leaps import LeapDone, LowPass
from rsoconsole.records.photometry import Photometry
from rsoconsole.records.reasons import Cause, CommandResult, Missed, NotTaken, SlewRefusal

Source = Literal["network", "faint", "operator"]
"""Source of a measurement; "faint": a streak below tau that a track took with other frames."""
LoopState = Literal["IDLE", "SEARCH", "ACQUIRE", "TRACK", "COAST", "LOST", "MANUAL", "FAULT"]
FOLLOWING: frozenset[LoopState] = frozenset(("TRACK", "COAST"))
Topic = Literal[
    "",
    "limit",
    "machine",
    "clock",
    "engine ended",
    "approach",
    "kept",
    "predictor",
    "close predictor",
]
OFF_RECORD = "off the record"
"""Key in the metadata of fields that only the running program has: not in a session."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Measurement:
    """A direction on the sky at mid-exposure: the input of the filter."""

    measurement_id: str
    """Identifier, unique in the session: see ``measurement_id_of``."""
    frame_id: int
    t_mid_utc_ns: int
    ra_icrs_deg: float
    """Right ascension of the astrometric position, relative to catalogue stars."""
    dec_icrs_deg: float
    cov_sky_arcsec2: tuple[float, float, float]
    """Covariance of (d alpha cos delta, d delta): east-east, east-north, north-north, arcsec^2."""
    x_px: float
    y_px: float
    confidence: float
    source: Source
    ends_icrs_deg: tuple[tuple[float, float], tuple[float, float]] | None = None
    """RA and Dec of the streak's two ends, ICRS degrees, in no order of time."""
    is_crossing: bool = False
    """True where neither end is in the frame: the line is known, the position along it is not."""
    object_class: ObjectClass = "undetermined"
    """Class of the object, from this frame alone."""
    is_clipped: bool = False


def measurement_id_of(frame_id: int, candidate: int) -> str:
    """Return the identifier of the measurement of one candidate in a frame.

    ``candidate``: index from 0, of the frame's detections followed by its rejected candidates.
    """
    return f"{frame_id}-{candidate}"


def mark_id_of(frame_id: int, mark: int) -> str:
    """Return the identifier of a mark by hand; ``mark``: its index in the frame, from 0."""
    return f"{frame_id}-m{mark}"


def is_mark_id(measurement_id: str) -> bool:
    """True where the identifier is of a mark that the operator made by hand."""
    return measurement_id.partition("-")[2].startswith("m")


@dataclass(frozen=True, slots=True, kw_only=True)
class Ruling:
    """The operator's decision on a frame's measurements; the tracks are then computed again."""

    frame_id: int
    taken: Measurement | None = None
    """Measurement (or mark by hand) that the track takes, whatever the gates say."""
    refused: tuple[Measurement, ...] = ()
    dropped: tuple[int, ...] = ()
    """Numbers of tracks that end before this frame; their streaks begin no new track."""
    kept: tuple[int, ...] = ()
    """Numbers of tracks that, from this frame on, no miss ends while they may be in the field."""
    released: tuple[int, ...] = ()
    """Numbers of tracks whose keeping ends: misses may end them again."""
    by: str = "operator"


@dataclass(frozen=True, slots=True, kw_only=True)
class FollowedAgain:
    """Marker: the records after it replace the frame's earlier tracking records."""

    frame_id: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Mixture:
    """Result of preset ``adaptive`` for a track: motion probabilities and timing scatter."""

    motion_probabilities: tuple[tuple[str, float], ...]
    """Name and probability of each of ``MOTIONS`` (``tracking/filters/bank.py``)."""
    acceleration_arcsec_s2: float
    """Rate of change of the speed on the sky, arcsec/s^2."""
    acceleration_sigma_arcsec_s2: float
    turn: float
    """Turn of the path to the left, radians per radian of motion; 0 on a great circle."""
    turn_sigma: float
    scatter_s: float
    """Excess scatter along the motion over stated errors, as shutter delay, s: posterior median."""
    scatter_low_s: float
    """Lower end of the 90 % interval of ``scatter_s``; upper: ``scatter_high_s``."""
    scatter_high_s: float
    variance_scale: float = 1.0
    """Factor by which the variances stated by the measurements are multiplied."""
    along_arcsec: float = 0.0
    """Sigma along the motion, from the last streak's length, added to its own, arcsec."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackState:
    """A track's filter at one instant: x = [alpha, alpha rate, delta, delta rate], deg, deg/s."""

    track_id: int
    """Number of the track, from 1, in the order in which tracks began in the session."""
    kind: Literal["initial", "predicted", "updated"]
    frame_id: int
    t_utc_ns: int
    x: tuple[float, float, float, float]
    P: tuple[tuple[float, ...], ...]
    """Covariance of x, (4, 4), deg and deg/s."""
    nis: float | None = None
    """Normalised innovation squared of the update; None after a prediction alone."""
    innovation_arcsec: tuple[float, float] | None = None
    """Innovation (d alpha cos delta, d delta): measured minus predicted, arcsec."""
    sigma_innovation_arcsec: tuple[float, float] | None = None
    """One sigma of the innovation, arcsec: sqrt of the diagonal of S = C P- C' + R, on the sky."""
    misses: int = 0
    """Number of exposures without a measurement since the last one with a measurement."""
    q_scale: float = 1.0
    """Factor on the process noise, from the track's own innovations; preset ``tuned`` only."""
    innovations: int = 0
    """Number of measurements that updated the track, without the first two."""
    foretold_by: Literal["filter", "orbit"] = "filter"
    """Source of the prediction, also of the one updated: the orbit where the filter's failed."""
    measurement_id: str | None = None
    """The measurement that the track took; None after a prediction alone."""
    begun_with: tuple[str, str] | None = None
    """First and last of the measurements that the track began with; None later on."""
    begun_through: tuple[str, ...] = ()
    """Measurements between the two of ``begun_with``, in order of time; () for no chain."""
    is_lead: bool = True
    """True where the telescope follows this track."""
    mixture: Mixture | None = None
    """Probabilities of motions, and scatter; preset ``adaptive`` only."""
    is_kept: bool = False
    """True where the operator keeps the track: no miss ends it while it may be in the field."""
    replaces: int | None = None
    """Number of the lost track that this new track replaces; that one ended with it."""
    shared_with: int | None = None
    """Number of the track that took the same streak, where the frame could not resolve two."""
    filter_nis: float | None = None
    """Filter's own NIS, beyond the gate, where the orbit updated the track; else None."""
    memory: object | None = field(
        default=None, repr=False, compare=False, metadata={OFF_RECORD: True}
    )
    """State of the filter besides x and P, for its next step; never recorded."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SlewCommand:
    """Direction for the telescope, and the instant for which it was computed."""

    frame_id: int
    ra_icrs_deg: float
    dec_icrs_deg: float
    t_aim_utc_ns: int
    reason: str
    """Reason, in words for people."""
    track_id: int | None = None
    """Number of the track that the slew follows; None without a track, as while searching."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NotFollowed:
    """A measurement the track did not take, and why."""

    frame_id: int
    measurement: Measurement
    reason: NotTaken
    nis: float | None = None
    """Normalised innovation squared; None where there was no prediction."""
    track_id: int | None = None
    """Number of the track that did not take it; None where there was no track."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Miss:
    """A frame in which a track's object was not measured, and why."""

    frame_id: int
    reason: Missed
    track_id: int | None = None
    """Number of the track; None where there was no track."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OrbitEstimate:
    """Orbit of a track, through all of its measurements up to this frame."""

    frame_id: int
    track_id: int
    label: str
    """"free", "constrained by prior", "weak geometry" or "not observable": how well it is known."""
    prior: str
    """Name of the prior; "none" where no prior constrains the orbit."""
    reason: str
    """``label`` with its figures, in words."""
    observations: int
    arc_s: float
    epoch_utc_ns: int
    r_gcrs_km: tuple[float, float, float]
    v_gcrs_km_s: tuple[float, float, float]
    covariance: tuple[tuple[float, ...], ...]
    """Covariance of r and v, (6, 6), km and km/s."""
    a_km: float
    """Semi-major axis; all elements are osculating at the epoch, along GCRS axes."""
    e: float
    i_deg: float
    sigma_a_km: float
    rms_arcsec: float
    outliers: int
    nis: float | None = None
    """Normalised innovation squared of this frame's measurement; predicted by the last orbit."""
    innovation_arcsec: tuple[float, float] | None = None
    """Measured minus predicted by the orbit before it, arcsec: (d alpha cos delta, d delta)."""
    sigma_innovation_arcsec: tuple[float, float] | None = None
    is_guide: bool = False
    """True where the telescope follows this orbit's prediction instead of the filter's."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CatalogueMatch:
    """One catalogued object compared with a track; differences: measured minus predicted."""

    norad_id: int
    name: str
    separation_arcsec: float
    along_track_s: float
    """Along-track difference as a time, s; positive: the track is ahead of the prediction."""
    cross_track_arcsec: float
    rate_difference_percent: float | None
    tle_age_days: float
    score: float
    """Mahalanobis distance between track and prediction, in sigma."""
    probability: float


@dataclass(frozen=True, slots=True, kw_only=True)
class LedgerName:
    """An uncatalogued object of an earlier night, by its number and name in the ledger."""

    number: int
    name: str
    t_last_utc_ns: int
    """Time of the object's last measurement on an earlier night, UTC ns."""
    probability: float
    separation_arcsec: float
    """Separation between measured and predicted direction, arcsec."""
    is_sure: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class Identified:
    """Result of comparing a track's directions up to this frame with the catalogue."""

    frame_id: int
    track_id: int
    verdict: Literal["identified", "ambiguous", "unknown"]
    reason: str
    """``verdict`` with its figures, in words."""
    hint: str
    """Hint at a manoeuvre of the object, in words; empty for none."""
    observations: int
    catalogued: int
    """Number of catalogued objects that the track was compared with."""
    matches: tuple[CatalogueMatch, ...]
    """Matching objects, best first; the second is the runner-up."""
    not_catalogued: float | None = None
    """Probability that the object is in no catalogue."""
    named_with: int = 0
    """Number of other tracks identified with it: each object is at most one of them."""
    ledger: LedgerName | None = None
    """Object of an earlier night that this uncatalogued track is, or may be."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StateChange:
    """A change of the control loop's state, and its cause."""

    frame_id: int
    before: LoopState
    after: LoopState
    reason: Cause
    kept_track_id: int | None = None
    """Number of the track that can be followed again, 0 for none; None if a frame led to it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterChange:
    """A changed setting; in force from the next cycle."""

    name: str
    """Name of the setting, dotted as in the configuration."""
    before: float | str
    after: float | str
    by: str


@dataclass(frozen=True, slots=True, kw_only=True)
class OperatorAction:
    """A command that reached the engine, and its result."""

    verb: str
    arguments: Mapping[str, Any]
    outcome: CommandResult
    by: str


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameTaken:
    """Arrival of a frame, with the facts that the session records of it besides the pixels."""

    frame_id: int
    name: str
    t_start_utc_ns: int | None
    exposure_s: float | None
    width_px: int
    height_px: int
    pointing_ra_icrs_deg: float | None
    pointing_dec_icrs_deg: float | None
    blocked: SlewRefusal | None = None
    """Why the slew before this frame was refused; None where it was not."""
    camera: CameraMode | None = None

    @property
    def t_mid_utc_ns(self) -> int | None:
        """Mid-exposure, UTC ns; None when start or exposure time is unknown."""
        return middle_utc_ns(self.t_start_utc_ns, self.exposure_s)


@dataclass(frozen=True, slots=True, kw_only=True)
class CycleTiming:
    """Wall time of each stage of one cycle, ms."""

    frame_id: int
    stage_ms: Mapping[str, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Event:
    """A line of text for the operator in the log."""

    level: Literal["info", "warning", "alarm"]
    text: str
    frame_id: int | None = None
    topic: Topic = ""
    """Subject, for programs that act on events; empty for none."""


Record: TypeAlias = (
    FrameTaken
    | Detections
    | Solution
    | NotSolved
    | Measurement
    | NotFollowed
    | Miss
    | TrackState
    | SlewCommand
    | StateChange
    | ParameterChange
    | OperatorAction
    | CycleTiming
    | Closeup
    | Ruling
    | FollowedAgain
    | OrbitEstimate
    | Identified
    | PairMotions
    | ExpectedMembers
    | LeapDone
    | LowPass
    | Photometry
    | Event
)
"""Every record of a session's log."""

FoldInput: TypeAlias = Detections | Solution | NotSolved | Measurement
"""Records that the fold over the frames takes as its input."""
FoldRecord: TypeAlias = TrackState | NotFollowed | Miss | StateChange
"""Records that the fold over the frames makes."""
OrbitRecord: TypeAlias = OrbitEstimate | Identified | PairMotions | ExpectedMembers
"""Records made of the tracks outside the fold."""
BesideRecord: TypeAlias = (
    SlewCommand | LeapDone | LowPass | OperatorAction | Closeup | Photometry | Event
)
"""All other records made outside the fold."""
