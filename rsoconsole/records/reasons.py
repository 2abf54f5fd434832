"""Why something came to pass: a kind with its figures; ``words`` makes the sentence.

Programs look at kinds and figures alone. A ``detail`` is for people: nothing is decided by it.
"""

from dataclasses import dataclass
from typing import Literal, TypeAlias


@dataclass(frozen=True, slots=True, kw_only=True)
class BelowTau:
    """A candidate that passed every gate, and is not likely enough."""

    confidence: float
    tau: float


NotAStreakKind: TypeAlias = Literal[
    "fit broke",
    "same streak",
    "not measured",
    "no light",
    "below tau",
    "trailed stars",
    "stars' trails",
    "row or column",
    "longer trail",
    "patchy",
    "dark in between",
    "no line",
    "outside the frame",
    "nothing stands out",
    "runs on far",
    "runs on",
    "darker than the sky",
    "too faint",
    "too narrow",
    "too wide",
    "too short",
    "no ends",
    "unlit",
    "uneven",
    "fixed in the sky",
    "fixed on the sensor",
    "catalogue stars",
]


@dataclass(frozen=True, slots=True, kw_only=True)
class NotAStreak:
    """The gate that a candidate did not pass."""

    kind: NotAStreakKind
    value: float | None = None
    """The measured value: a signal to noise, a width or length in pixels, a share, a count."""
    limit: float | None = None
    """The limit of the gate, in the same unit."""


NotTakenKind: TypeAlias = Literal[
    "NIS",
    "cannot be told apart",
    "refused",
    "dropped",
    "not chosen",
    "another taken",
    "another leads",
    "clipped at start",
    "crossing",
    "class",
    "neighbour",
    "moves otherwise",
    "clipped and far",
    "no second frame",
]


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionMismatch:
    """Mismatch between a streak and a motion."""

    kind: Literal["direction", "length", "order of time"]
    value: float | None = None
    """Of "direction" how many degrees it is off, of "length" its arcseconds, to the whole one."""
    expected: float | None = None
    """Of "length"."""

    @classmethod
    def of_direction(cls, off_deg: float) -> "MotionMismatch":
        """A streak in another direction."""
        return cls(kind="direction", value=float(round(off_deg)))

    @classmethod
    def of_length(cls, length_arcsec: float, expected_arcsec: float) -> "MotionMismatch":
        """A streak of another length."""
        whole = float(round(length_arcsec)), float(round(expected_arcsec))
        return cls(kind="length", value=whole[0], expected=whole[1])


@dataclass(frozen=True, slots=True, kw_only=True)
class NotTaken:
    """Why a track did not take a measurement."""

    kind: NotTakenKind
    nis: float | None = None
    """Normalised innovation squared of kind "NIS", and the gate's limit, to one decimal."""
    limit: float | None = None
    mismatch: MotionMismatch | None = None
    """Of kind "moves otherwise"; of "no second frame", with what came nearest to being one."""
    missed: "Missed | None" = None
    """Of kind "no second frame", where the second frame showed nothing."""
    away_arcsec: float | None = None
    """Of kind "clipped and far", from the prediction, and how far it may be, to the whole one."""
    allowed_arcsec: float | None = None
    object_class: str = ""
    """Of kind "class", what its streak shows it to be."""

    @classmethod
    def clipped_and_far(cls, away_arcsec: float, allowed_arcsec: float) -> "NotTaken":
        """The visible part of a streak does not lie where the track's may."""
        return cls(
            kind="clipped and far",
            away_arcsec=float(round(away_arcsec)),
            allowed_arcsec=float(round(allowed_arcsec)),
        )

    @classmethod
    def by_gate(cls, nis: float, limit: float) -> "NotTaken":
        """The innovation is too large."""
        return cls(kind="NIS", nis=_tenths(nis), limit=_tenths(limit))


def _tenths(value: float) -> float:
    return float(f"{value:.1f}")


def _whole(value: float) -> float:
    return float(f"{value:.0f}")


SlewRefusalKind: TypeAlias = Literal[
    "altitude",
    "horizon",
    "hour angle",
    "pier",
    "polar axis",
    "Sun",
    "past the Sun",
    "nearer to the Sun",
    "twilight",
    "meridian policy",
    "direction",
    "clock",
    "aimed before",
    "aimed ahead",
    "ends before",
    "ends ahead",
]


@dataclass(frozen=True, slots=True, kw_only=True)
class SlewRefusal:
    """Why the telescope must not go or stay somewhere; figures as they are told."""

    kind: SlewRefusalKind
    """"Sun": there; "past the Sun" and "nearer to the Sun": on the way there."""
    value_deg: float | None = None
    """The angle that is held against a limit, to one decimal."""
    bound_deg: float | None = None
    by_deg: float | None = None
    """How far beyond its bound it is: to one decimal, below 0.1 to three; 0 below 0.001."""
    azimuth_deg: float | None = None
    """Of "horizon", to the whole one."""
    side: Literal["east", "west"] | None = None
    """Of "pier": the side it is on; of "meridian policy": the one it would change to."""
    later_s: float | None = None
    """How far ahead that will be, to the whole one; None where it is now."""
    ago_min: float | None = None
    """Of "aimed before"."""
    ahead_h: float | None = None
    """Of "aimed ahead" and "ends ahead", to one decimal."""
    detail: str = ""
    """Of "direction" and "clock": what cannot be meant."""

    @classmethod
    def beyond(
        cls,
        kind: SlewRefusalKind,
        value_deg: float,
        bound_deg: float,
        *,
        azimuth_deg: float | None = None,
        side: Literal["east", "west"] | None = None,
        later_s: float = 0.0,
    ) -> "SlewRefusal":
        """An angle beyond its bound."""
        return cls(
            kind=kind,
            value_deg=_tenths(value_deg),
            bound_deg=_tenths(bound_deg),
            by_deg=_rounded(abs(value_deg - bound_deg)),
            azimuth_deg=None if azimuth_deg is None else _whole(azimuth_deg),
            side=side,
            later_s=_whole(later_s) if later_s >= 1.0 else None,
        )

    @classmethod
    def by_policy(
        cls, hour_angle_deg: float, side: Literal["east", "west"] | None
    ) -> "SlewRefusal":
        """The mount would change sides while a track is followed."""
        return cls(kind="meridian policy", value_deg=_tenths(hour_angle_deg), side=side)

    @classmethod
    def by_instant(cls, kind: SlewRefusalKind, ahead_s: float = 0.0) -> "SlewRefusal":
        """An instant too far from now."""
        if kind == "aimed before":
            return cls(kind=kind, ago_min=_whole(-ahead_s / 60.0))
        return cls(kind=kind, ahead_h=_tenths(ahead_s / 3600.0))


def _rounded(distance_deg: float) -> float:
    """A distance from a bound with as many digits as it takes to show it."""
    if distance_deg < 0.001:
        return 0.0
    if distance_deg >= 0.1:
        return _tenths(distance_deg)
    # What rounds up to 0.100 is still told to three decimals.
    return min(float(f"{distance_deg:.3f}"), 0.0999)


HiddenKind: TypeAlias = Literal[
    "slew refused", "fewer stars", "fainter stars", "few stars", "shadow", "penumbra"
]
CLOUD: frozenset[HiddenKind] = frozenset(("fewer stars", "fainter stars", "few stars"))


@dataclass(frozen=True, slots=True, kw_only=True)
class HiddenBy:
    """Cause of a frame without a measurement; figures as they are shown."""

    kind: HiddenKind
    """Cloud is "fewer stars" and "fainter stars" than before, and, where nothing is known of
    before, "few stars"; eclipse is "shadow" and "penumbra"."""
    refusal: SlewRefusal | None = None
    """Of "slew refused": why the slew to the track was."""
    stars: int | None = None
    """Of "fewer stars" and "few stars"."""
    usual_stars: int | None = None
    """Of "fewer stars": how many there were before."""
    fainter_mag: float | None = None
    """Of "fainter stars", to one decimal."""
    sun_percent: float | None = None
    """Of "penumbra": how much of the Sun is left, to the whole one."""

    @classmethod
    def by_faint_stars(cls, fainter_mag: float) -> "HiddenBy":
        """Cloud that dims."""
        return cls(kind="fainter stars", fainter_mag=_tenths(fainter_mag))

    @classmethod
    def by_penumbra(cls, lit: float) -> "HiddenBy":
        """The Earth before some of the Sun, of which this share is left."""
        return cls(kind="penumbra", sun_percent=_whole(100.0 * lit))


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackLost:
    """Cause of the end of a track; figures as they are shown."""

    kind: Literal[
        "too wide",
        "wider than the field",
        "coasted",
        "not confirmed",
        "seen too seldom",
        "left the field",
    ]
    three_sigma_arcmin: float | None = None
    """Of the first two, to the whole one."""
    coasted_min: float | None = None
    """Of "coasted", to the whole one."""
    unseen_frames: int | None = None
    """Of "seen too seldom": those that should have shown it."""

    @classmethod
    def by_bounds(cls, three_sigma_arcmin: float, *, fits_field: bool) -> "TrackLost":
        """Its place is no longer known well enough."""
        kind: Literal["too wide", "wider than the field"]
        kind = "too wide" if fits_field else "wider than the field"
        return cls(kind=kind, three_sigma_arcmin=_whole(three_sigma_arcmin))

    @classmethod
    def by_time(cls, coasted_s: float) -> "TrackLost":
        """The end of a track that has coasted for too long."""
        return cls(kind="coasted", coasted_min=_whole(coasted_s / 60.0))


MissKind: TypeAlias = Literal[
    "no detection",
    "nothing fits",
    "cannot be told apart",
    "not solved",
    "no time",
    "not measured",
    "crossing",
    "instrument",
]


@dataclass(frozen=True, slots=True, kw_only=True)
class Missed:
    """Why a frame gave no measurement to what is followed."""

    kind: MissKind
    """"instrument": it failed, and there was nothing to fold."""
    detail: str = ""
    """Of kinds "not solved" and "instrument": what was said, for people."""
    hidden_by: tuple[HiddenBy, ...] = ()
    """What it is put down to: a refused slew, cloud, eclipse; most certain first."""
    lost: TrackLost | None = None
    """Why the track ends with it; None where it goes on."""


CauseKind: TypeAlias = Literal[
    "armed",
    "disarmed",
    "STOP",
    "moved by hand",
    "resumed",
    "looked for again",
    "limit met",
    "too many limits",
    "clock set",
    "night ended",
    "not pointing",
    "instrument",
    "engine ended",
    "operator's word",
    "two frames agree",
    "measured again",
    "re-acquired",
    "waiting",
    "missed",
]


@dataclass(frozen=True, slots=True, kw_only=True)
class Cause:
    """Why the loop passed from one state to another."""

    kind: CauseKind
    by: str = ""
    """Who ordered it."""
    detail: str = ""
    """Its detail in words for people."""
    step_s: float | None = None
    """By how much the clock was set."""
    detections: int | None = None
    """How many wait for a second frame."""
    missed: Missed | None = None


FROM_OUTSIDE: frozenset[CauseKind] = frozenset(
    ("limit met", "looked for again", "resumed", "clock set")
)
"""What leads from one state of a search or track to another without a frame's doing."""

ResultKind: TypeAlias = Literal[
    "accepted", "done", "ruled", "answered", "measured", "refused", "dropped", "failed"
]
StopOutcome: TypeAlias = Literal["stands", "tracks", "moves", "unknown"]
"""What a STOP has come to, by the directions that the mount reports since."""
RuledKind: TypeAlias = Literal[
    "rejected",
    "taken",
    "taken by hand",
    "taken back",
    "first of a track",
    "second of a track",
    "leads",
    "dropped",
    "taken up again",
    "kept",
    "released",
]
DroppedBy: TypeAlias = Literal["STOP", "limit met", "night ended", "engine ended"]


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandResult:
    """The result of a command."""

    kind: ResultKind
    """"accepted": it waits, and what comes of it is on record too; of a STOP: "answered" by the
    mount's driver, or "failed" to be, then "measured"."""
    detail: str = ""
    """How it was done, where that is worth saying; or why it was not, or is not known."""
    dropped_by: DroppedBy | None = None
    """What overtook the command while it waited."""
    stop_ms: float | None = None
    """Time until a STOP was answered, or measured, and its way to the mount."""
    stop_path: str = ""
    stop_ordered_ms: float | None = None
    """Time until ABORT was on its way to the mount; None: not known, or never."""
    stop_outcome: StopOutcome | None = None
    rate_deg_s: float | None = None
    """Of a mount that moves on: of its faster axis."""
    ruled: RuledKind | None = None
    """What the operator's word on a frame came to."""
    frame_id: int | None = None
    left_alone: int = 0
    """Measurements of that frame and those after it that the track did not take."""
    sigma_arcsec: tuple[float, float] | None = None
    """Of a mark by hand that is used: one sigma in RA cos Dec and in Dec."""
    off_arcsec: float | None = None
    """From it to the automatic measurement that it takes the place of; None: there is none."""

    @classmethod
    def refused(cls, why: object) -> "CommandResult":
        """A command that is refused."""
        return cls(kind="refused", detail=str(why))


ACCEPTED, DONE = CommandResult(kind="accepted"), CommandResult(kind="done")


def done(detail: str) -> CommandResult:
    """A command that is done, with its result in words for people."""
    return CommandResult(kind="done", detail=detail)


Reason: TypeAlias = (
    BelowTau
    | NotAStreak
    | NotTaken
    | Missed
    | HiddenBy
    | SlewRefusal
    | TrackLost
    | Cause
    | CommandResult
)
