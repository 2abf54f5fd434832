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
from rsoconsole.records.reasons import Cause, CommandResult, Missed, NotTaken, SlewRefusal

Source = Literal["network", "operator"]
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
"""Key in the metadata of fields that only the running program has: no session carries them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Measurement:
    """A direction on the sky at mid-exposure: the input of the filter."""

    measurement_id: str
    """Identifier, unique in the session: the frame's number and the candidate's, as
    ``measurement_id_of``."""
    frame_id: int
    t_mid_utc_ns: int
    ra_icrs_deg: float
    """Right ascension of the astrometric place, relative to catalogue stars."""
    dec_icrs_deg: float
    cov_sky_arcsec2: tuple[float, float, float]
    """Covariance of (d alpha cos delta, d delta): east-east, east-north, north-north, arcsec^2."""
    x_px: float
    y_px: float
    confidence: float
    source: Source
    ends_icrs_deg: tuple[tuple[float, float], tuple[float, float]] | None = None
    """RA, Dec of the streak's two ends, ICRS degrees, order unknown."""
    is_crossing: bool = False
    """True where neither end is in the frame: it is somewhere on a line, at an unknown time."""
    object_class: ObjectClass = "undetermined"
    """Class of the object by the streak's own frame."""
    is_clipped: bool = False


def measurement_id_of(frame_id: int, candidate: int) -> str:
    """Return the identifier of the measurement of a frame's candidate.

    ``candidate``: its place among the detections and, behind them, the rejected ones, from 0.
    """
    return f"{frame_id}-{candidate}"


def mark_id_of(frame_id: int, mark: int) -> str:
    """Return the identifier of a frame's mark by hand; ``mark``: its number, from 0."""
    return f"{frame_id}-m{mark}"


def is_mark_id(measurement_id: str) -> bool:
    """True for the identifier of a mark by hand."""
    return measurement_id.partition("-")[2].startswith("m")


@dataclass(frozen=True, slots=True, kw_only=True)
class Ruling:
    """The operator's decision on a frame's measurements: the frame is followed again by it."""

    frame_id: int
    taken: Measurement | None = None
    """Measurement that is followed whatever the gates say; also a mark by hand."""
    refused: tuple[Measurement, ...] = ()
    dropped: tuple[int, ...] = ()
    """Tracks that end before this frame, by number; their streaks begin none."""
    kept: tuple[int, ...] = ()
    """Tracks that no miss ends while they may be in the field, from this frame on."""
    released: tuple[int, ...] = ()
    """Tracks that were kept and no longer are."""
    by: str = "operator"


@dataclass(frozen=True, slots=True, kw_only=True)
class FollowedAgain:
    """Separator: the records behind it replace those that the frame's measurements first led to."""

    frame_id: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Mixture:
    """Result of preset ``adaptive`` for a track: motions with probabilities, and the night's
    scatter."""

    motion_probabilities: tuple[tuple[str, float], ...]
    """Probability of each of ``MOTIONS`` (``tracking/filters/bank.py``)."""
    acceleration_arcsec_s2: float
    """Rate at which the speed on the sky changes, arcsec/s^2."""
    acceleration_sigma_arcsec_s2: float
    turn: float
    """Turn of the path to the left, radians for each radian of motion; a great circle has 0."""
    turn_sigma: float
    scatter_s: float
    """Excess scatter along the motion beyond the measurements' own errors, as a delay of the
    shutter, s: the posterior median."""
    scatter_low_s: float
    """Lower end of the interval of 90 %, s; the upper one is ``scatter_high_s``."""
    scatter_high_s: float
    variance_scale: float = 1.0
    """Factor on the variances that measurements claim."""
    along_arcsec: float = 0.0
    """Sigma along the motion that the last streak's length adds to its own, arcsec."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackState:
    """The filter at one instant: x = [alpha, alpha rate, delta, delta rate], deg and deg/s."""

    track_id: int
    """Number of the track, from 1, in the order in which the session's tracks began."""
    kind: Literal["initial", "predicted", "updated"]
    frame_id: int
    t_utc_ns: int
    x: tuple[float, float, float, float]
    P: tuple[tuple[float, ...], ...]
    """Covariance of x, (4, 4), deg and deg/s."""
    nis: float | None = None
    """Normalised innovation squared of the update that made it; None after a mere prediction."""
    innovation_arcsec: tuple[float, float] | None = None
    """Innovation (d alpha cos delta, d delta): measured minus predicted, arcsec."""
    sigma_innovation_arcsec: tuple[float, float] | None = None
    """One sigma of the innovation, arcsec: sqrt of the diagonal of S = C P- C' + R, on the sky."""
    misses: int = 0
    """Number of exposures since the last measurement."""
    q_scale: float = 1.0
    """Factor on the process noise from the track's own innovations; preset ``tuned`` only."""
    innovations: int = 0
    """Number of measurements that have updated the track since its two first ones."""
    foretold_by: Literal["filter", "orbit"] = "filter"
    """Source of the prediction, also of the one updated: the orbit where the filter's has
    failed."""
    measurement_id: str | None = None
    """The measurement that the track took; None after a mere prediction."""
    begun_with: tuple[str, str] | None = None
    """First and last measurement that the track began with; None later on."""
    begun_through: tuple[str, ...] = ()
    """Measurements between those two, in order of time, where it began with a chain of them."""
    is_lead: bool = True
    """True where the telescope follows this one of the frame's tracks."""
    mixture: Mixture | None = None
    """Motions and scatter; preset ``adaptive`` only."""
    is_kept: bool = False
    """True where the operator keeps it: no miss ends it while it may be in the field."""
    replaces: int | None = None
    """Number of the lost track that this new one replaces, and which ended with it."""
    shared_with: int | None = None
    """Number of the track that took the same streak: the frame could not show both apart."""
    filter_nis: float | None = None
    """Filter's own NIS where the track was updated by the orbit's prediction, beyond the gate; None
    in other cases, also where another reason refused it."""
    memory: object | None = field(
        default=None, repr=False, compare=False, metadata={OFF_RECORD: True}
    )
    """Further state of the filter for its next step; never on record."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SlewCommand:
    """Direction for the telescope, and the instant for which it was computed."""

    frame_id: int
    ra_icrs_deg: float
    dec_icrs_deg: float
    t_aim_utc_ns: int
    reason: str
    """Description for people; ``track_id`` has the track it leads to."""
    track_id: int | None = None
    """Number of the track it leads to; None without one, as while searching."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NotFollowed:
    """A measurement the track did not take, and why."""

    frame_id: int
    measurement: Measurement
    reason: NotTaken
    nis: float | None = None
    """Normalised innovation squared; None where there was no prediction to compare with."""
    track_id: int | None = None
    """Number of the track that did not take it; None where there was none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Miss:
    """A frame in which the track's object was not measured, and why."""

    frame_id: int
    reason: Missed
    track_id: int | None = None
    """Number of the track that misses it; None where there was none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OrbitEstimate:
    """Orbit of a track, through all of its measurements up to this frame."""

    frame_id: int
    track_id: int
    label: str
    """Label: "free", "constrained by prior", "weak geometry" or "not observable"."""
    prior: str
    """Name of the prior; "none" for a free orbit."""
    reason: str
    """Description, which adds figures to ``label``."""
    observations: int
    arc_s: float
    epoch_utc_ns: int
    r_gcrs_km: tuple[float, float, float]
    v_gcrs_km_s: tuple[float, float, float]
    covariance: tuple[tuple[float, ...], ...]
    """Covariance of r and v, (6, 6), km and km/s."""
    a_km: float
    """Semi-major axis; like the elements below osculating at the epoch, along GCRS axes."""
    e: float
    i_deg: float
    sigma_a_km: float
    rms_arcsec: float
    outliers: int
    nis: float | None = None
    """Normalised innovation squared of this frame's measurement against the orbit before it."""
    innovation_arcsec: tuple[float, float] | None = None
    """Innovation (d alpha cos delta, d delta): measured minus predicted by the orbit before it,
    arcsec."""
    sigma_innovation_arcsec: tuple[float, float] | None = None
    is_guide: bool = False
    """True where the telescope follows this orbit's prediction, not the filter's."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CatalogueMatch:
    """One catalogued object compared with a track; differences are measured minus predicted."""

    norad_id: int
    name: str
    separation_arcsec: float
    along_track_s: float
    """Along-track difference as a time, s; positive: ahead of its prediction."""
    cross_track_arcsec: float
    rate_difference_percent: float | None
    tle_age_days: float
    score: float
    """Mahalanobis distance, sigma."""
    probability: float


@dataclass(frozen=True, slots=True, kw_only=True)
class LedgerName:
    """An uncatalogued object that was seen on an earlier night, by its name in the ledger."""

    number: int
    name: str
    t_last_utc_ns: int
    """Time of its last measurement before, UTC ns."""
    probability: float
    separation_arcsec: float
    """Separation, measured minus predicted, arcsec."""
    is_sure: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class Identified:
    """Identification of a track with a catalogued object, by its directions up to this frame."""

    frame_id: int
    track_id: int
    verdict: Literal["identified", "ambiguous", "unknown"]
    reason: str
    """Description, which adds figures to ``verdict``."""
    hint: str
    """Hint of a manoeuvre; empty for none."""
    observations: int
    catalogued: int
    """Number of objects it was compared with."""
    matches: tuple[CatalogueMatch, ...]
    """Matches, best first; the second is the runner-up."""
    not_catalogued: float | None = None
    """Probability that no catalogue has it."""
    named_with: int = 0
    """Number of other tracks identified together with it: each catalogued object is at most one of
    them."""
    ledger: LedgerName | None = None
    """Object of an earlier night that an uncatalogued track is, or may be."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StateChange:
    """A change of the loop's state."""

    frame_id: int
    before: LoopState
    after: LoopState
    reason: Cause
    kept_track_id: int | None = None
    """Number of the track that can be followed again from here on, 0 where there is none; None for
    a change that a frame led to."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterChange:
    """A change of a tunable; in force from the next cycle."""

    name: str
    """Dotted name, as in the configuration."""
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
    """A frame's arrival: the facts that the session keeps beside the pixels."""

    frame_id: int
    name: str
    t_start_utc_ns: int | None
    exposure_s: float | None
    width_px: int
    height_px: int
    pointing_ra_icrs_deg: float | None
    pointing_dec_icrs_deg: float | None
    blocked: SlewRefusal | None = None
    """Refusal of the slew to the track before it; None where nothing was refused."""
    camera: CameraMode | None = None

    @property
    def t_mid_utc_ns(self) -> int | None:
        """Mid-exposure, UTC ns; None when start or length is unknown."""
        return middle_utc_ns(self.t_start_utc_ns, self.exposure_s)


@dataclass(frozen=True, slots=True, kw_only=True)
class CycleTiming:
    """Wall time of each stage of one cycle."""

    frame_id: int
    stage_ms: Mapping[str, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Event:
    """A line of the log in the operator's words."""

    level: Literal["info", "warning", "alarm"]
    text: str
    frame_id: int | None = None
    topic: Topic = ""
    """Subject, where programs must know it."""


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
    | Event
)
"""Every record of a session's log."""

FoldInput: TypeAlias = Detections | Solution | NotSolved | Measurement
"""The records that the fold over the frames takes."""
FoldRecord: TypeAlias = TrackState | NotFollowed | Miss | StateChange
"""The records that the fold over the frames makes."""
OrbitRecord: TypeAlias = OrbitEstimate | Identified | PairMotions | ExpectedMembers
"""The records made of the tracks, beside the fold."""
BesideRecord: TypeAlias = SlewCommand | LeapDone | LowPass | OperatorAction | Closeup | Event
"""All other records beside the fold."""
