"""The words that every part speaks: one record for each step from frame to slew.

``Frame -> Detections -> Solution | NotSolved -> Measurement -> TrackState -> SlewCommand``.
Every record names the frame it came from. Units, everywhere inside the program: degrees for
directions, arcseconds for errors on the sky, degrees per second for rates, pixels with 0 at the
centre of the first pixel (x = column, y = row of the array as stored), UTC nanoseconds since
1970 for instants. Directions are ICRS unless the name says otherwise.
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
"""In a field's metadata: of the running program alone, no session carries it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Measurement:
    """A direction on the sky at mid-exposure: what the filter is fed."""

    measurement_id: str
    """Unique in the session: the frame's number and the candidate's, as ``measurement_id_of``."""
    frame_id: int
    t_mid_utc_ns: int
    ra_icrs_deg: float
    """Astrometric place, as relative to catalogue stars."""
    dec_icrs_deg: float
    cov_sky_arcsec2: tuple[float, float, float]
    """East-east, east-north, north-north of (d alpha cos delta, d delta)."""
    x_px: float
    y_px: float
    confidence: float
    source: Source
    ends_icrs_deg: tuple[tuple[float, float], tuple[float, float]] | None = None
    """RA, Dec of the streak's two ends, order unknown."""
    is_crossing: bool = False
    """Neither end is in the frame: it is somewhere on a line, at a time nobody knows."""
    object_class: ObjectClass = "undetermined"
    """Class of the object by the streak's own frame."""
    is_clipped: bool = False


def measurement_id_of(frame_id: int, candidate: int) -> str:
    """The id of what is measured of a frame's candidate.

    ``candidate``: its place among the detections and, behind them, the rejected ones, from 0.
    """
    return f"{frame_id}-{candidate}"


def mark_id_of(frame_id: int, mark: int) -> str:
    """The id of what the operator has marked by hand in a frame, from 0."""
    return f"{frame_id}-m{mark}"


def is_mark_id(measurement_id: str) -> bool:
    """Whether that is the id of a mark by hand."""
    return measurement_id.partition("-")[2].startswith("m")


@dataclass(frozen=True, slots=True, kw_only=True)
class Ruling:
    """The operator's word on a frame's measurements: the frame is followed again by it."""

    frame_id: int
    taken: Measurement | None = None
    """Followed whatever the gates say; also one that the operator made."""
    refused: tuple[Measurement, ...] = ()
    dropped: tuple[int, ...] = ()
    """Tracks that end before this frame, by their numbers; their streaks begin none."""
    kept: tuple[int, ...] = ()
    """Tracks that no miss ends while they may be in the field, from this frame on."""
    released: tuple[int, ...] = ()
    """Tracks that were so and are no more."""
    by: str = "operator"


@dataclass(frozen=True, slots=True, kw_only=True)
class FollowedAgain:
    """The records behind this one replace those that the frame's measurements first led to."""

    frame_id: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Mixture:
    """What preset ``adaptive`` makes of a track: the motions it believes, how a night scatters."""

    motion_probabilities: tuple[tuple[str, float], ...]
    """Each of ``MOTIONS`` (``tracking/filters/bank.py``) with its probability."""
    acceleration_arcsec_s2: float
    """By which the speed on the sky changes."""
    acceleration_sigma_arcsec_s2: float
    turn: float
    """Of the path to the left, radians for each radian that it goes on; a great circle has 0."""
    turn_sigma: float
    scatter_s: float
    """Excess scatter along the motion beyond the measurements' own errors, as the time that a
    shutter would be late: the median of what is believed."""
    scatter_low_s: float
    """The interval of 90 %."""
    scatter_high_s: float
    variance_scale: float = 1.0
    """Of the variances that measurements claim: how much larger they are taken to be."""
    along_arcsec: float = 0.0
    """Sigma along the motion that the length of the streak taken last adds to its own."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackState:
    """The filter at one instant: x = [alpha, alpha rate, delta, delta rate], deg and deg/s."""

    track_id: int
    """From 1, in the order in which the session's tracks began."""
    kind: Literal["initial", "predicted", "updated"]
    frame_id: int
    t_utc_ns: int
    x: tuple[float, float, float, float]
    P: tuple[tuple[float, ...], ...]
    """(4, 4), deg and deg/s."""
    nis: float | None = None
    """Normalised innovation squared of the update that made it; None after a mere prediction."""
    innovation_arcsec: tuple[float, float] | None = None
    """(d alpha cos delta, d delta), measured minus predicted."""
    sigma_innovation_arcsec: tuple[float, float] | None = None
    """sqrt of the diagonal of S = C P- C' + R, on the sky."""
    misses: int = 0
    """Exposures since the last measurement."""
    q_scale: float = 1.0
    """What the track's own innovations have made of the process noise; preset ``tuned`` only."""
    innovations: int = 0
    """Measurements that have updated the track since its two first ones."""
    foretold_by: Literal["filter", "orbit"] = "filter"
    """Whose prediction it is, or was updated: the orbit's where the filter's has failed."""
    measurement_id: str | None = None
    """The measurement that the track took; None after a mere prediction."""
    begun_with: tuple[str, str] | None = None
    """The first and the last measurement that a track began with; None later on."""
    begun_through: tuple[str, ...] = ()
    """Those between the two, in order of time, where it began with a chain of them."""
    is_lead: bool = True
    """Whether the telescope follows this one of the frame's tracks."""
    mixture: Mixture | None = None
    """Preset ``adaptive`` only."""
    is_kept: bool = False
    """Whether the operator's word keeps it: no miss ends it while it may be in the field."""
    replaces: int | None = None
    """Of a track that began as what another one had lost: that other track's number, which ended
    with it."""
    shared_with: int | None = None
    """The track that took the same streak: the frame could not show both apart."""
    filter_nis: float | None = None
    """Where it was updated by the orbit's prediction: NIS by the filter's own, which the gate had
    refused; None elsewhere, and where another reason refused it."""
    memory: object | None = field(
        default=None, repr=False, compare=False, metadata={OFF_RECORD: True}
    )
    """What the filter knows beyond these numbers, for its next step; never on record."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SlewCommand:
    """Where the telescope is to look, and for which instant that was computed."""

    frame_id: int
    ra_icrs_deg: float
    dec_icrs_deg: float
    t_aim_utc_ns: int
    reason: str
    """A description; which track it leads to is told by ``track_id``."""
    track_id: int | None = None
    """The track that it leads to; None where it leads to none, as while searching."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NotFollowed:
    """A measurement the track did not take, and why."""

    frame_id: int
    measurement: Measurement
    reason: NotTaken
    nis: float | None = None
    """Its normalised innovation squared, where there was a prediction to compare with."""
    track_id: int | None = None
    """The track that did not take it; None where there was none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Miss:
    """A frame in which the followed object was not measured, and why."""

    frame_id: int
    reason: Missed
    track_id: int | None = None
    """The track that misses it; None where there was none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OrbitEstimate:
    """The orbit of what is followed, through everything measured of it up to this frame."""

    frame_id: int
    track_id: int
    label: str
    """"free", "constrained by prior", "weak geometry" or "not observable"."""
    prior: str
    """By name; "none" for a free orbit."""
    reason: str
    """A description, which adds figures to ``label``."""
    observations: int
    arc_s: float
    epoch_utc_ns: int
    r_gcrs_km: tuple[float, float, float]
    v_gcrs_km_s: tuple[float, float, float]
    covariance: tuple[tuple[float, ...], ...]
    """(6, 6), km and km/s."""
    a_km: float
    """Elements at the epoch, osculating, along GCRS axes."""
    e: float
    i_deg: float
    sigma_a_km: float
    rms_arcsec: float
    outliers: int
    nis: float | None = None
    """Normalised innovation squared of this frame's measurement against the orbit before it."""
    innovation_arcsec: tuple[float, float] | None = None
    """(d alpha cos delta, d delta), measured minus what the orbit before it predicted."""
    sigma_innovation_arcsec: tuple[float, float] | None = None
    is_guide: bool = False
    """Whether the telescope goes where this orbit says, not where the filter does."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CatalogueMatch:
    """One catalogued object beside what is followed; measured minus predicted."""

    norad_id: int
    name: str
    separation_arcsec: float
    along_track_s: float
    """Positive: ahead of its prediction."""
    cross_track_arcsec: float
    rate_difference_percent: float | None
    tle_age_days: float
    score: float
    """Mahalanobis distance, sigma."""
    probability: float


@dataclass(frozen=True, slots=True, kw_only=True)
class LedgerName:
    """An uncatalogued object that was seen on an earlier night, as the ledger calls it."""

    number: int
    name: str
    t_last_utc_ns: int
    """When it was seen last before."""
    probability: float
    separation_arcsec: float
    """Measured minus predicted."""
    is_sure: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class Identified:
    """Which catalogued object what is followed is, by its directions up to this frame."""

    frame_id: int
    track_id: int
    verdict: Literal["identified", "ambiguous", "unknown"]
    reason: str
    """A description, which adds figures to ``verdict``."""
    hint: str
    """A hint of a manoeuvre; empty for none."""
    observations: int
    catalogued: int
    """Objects it was compared with."""
    matches: tuple[CatalogueMatch, ...]
    """Best first; the second is the runner-up."""
    not_catalogued: float | None = None
    """Probability that no catalogue knows it."""
    named_with: int = 0
    """Other tracks with which it was named: one catalogued object is one of them at most."""
    ledger: LedgerName | None = None
    """Of what no catalogue knows: an object of an earlier night that it is, or may be."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StateChange:
    """The loop passed from one state to another."""

    frame_id: int
    before: LoopState
    after: LoopState
    reason: Cause
    kept_track_id: int | None = None
    """The track that can be followed again from here on, 0 where there is none; None for a change
    that a frame led to."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterChange:
    """A tunable took a new value; in force from the next cycle."""

    name: str
    """Dotted, as in the configuration."""
    before: float | str
    after: float | str
    by: str


@dataclass(frozen=True, slots=True, kw_only=True)
class OperatorAction:
    """A command that reached the engine, and what came of it."""

    verb: str
    arguments: Mapping[str, Any]
    outcome: CommandResult
    by: str


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameTaken:
    """A frame arrived: what the session keeps of it beside the pixels."""

    frame_id: int
    name: str
    t_start_utc_ns: int | None
    exposure_s: float | None
    width_px: int
    height_px: int
    pointing_ra_icrs_deg: float | None
    pointing_dec_icrs_deg: float | None
    blocked: SlewRefusal | None = None
    """Why the slew to what is followed was refused before it; None where nothing was."""
    camera: CameraMode | None = None

    @property
    def t_mid_utc_ns(self) -> int | None:
        """Middle of the exposure, or None when start or length is unknown."""
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
    """Its subject, where programs must know it."""


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
