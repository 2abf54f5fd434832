"""Reasons and results, each as a kind with its figures; ``words`` makes a sentence of it.

Programs decide by kinds and figures alone. A ``detail`` is text for people.
"""

from dataclasses import dataclass
from typing import Literal, TypeAlias


@dataclass(frozen=True, slots=True, kw_only=True)
class BelowTau:
    """A candidate that passed every gate, but whose confidence is below tau."""

    confidence: float
    tau: float


NotAStreakKind: TypeAlias = Literal[
    "fit broke",
    "same streak",
    "not measured",
    "unlike a streak",
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
    """The gate that a candidate failed."""

    kind: NotAStreakKind
    value: float | None = None
    """Measured value: signal to noise, width or length (px), fraction, or count."""
    limit: float | None = None
    """Limit of the gate, in the same unit as ``value``."""


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
    """Difference between a streak and the motion of a track."""

    kind: Literal["direction", "length", "order of time"]
    value: float | None = None
    """Kind "direction": difference, deg. Kind "length": measured length, arcsec. Whole."""
    expected: float | None = None
    """Kind "length": expected length, arcsec. Whole."""

    @classmethod
    def of_direction(cls, off_deg: float) -> "MotionMismatch":
        """Return a mismatch by ``off_deg``, the angle between streak and motion."""
        return cls(kind="direction", value=float(round(off_deg)))

    @classmethod
    def of_length(cls, length_arcsec: float, expected_arcsec: float) -> "MotionMismatch":
        """Return a mismatch between a measured and an expected length."""
        whole = float(round(length_arcsec)), float(round(expected_arcsec))
        return cls(kind="length", value=whole[0], expected=whole[1])


@dataclass(frozen=True, slots=True, kw_only=True)
class NotTaken:
    """Reason why a track did not take a measurement."""

    kind: NotTakenKind
    nis: float | None = None
    """Kind "NIS": normalised innovation squared, and ``limit``: the gate; to one decimal."""
    limit: float | None = None
    mismatch: MotionMismatch | None = None
    """Kinds "moves otherwise", and "no second frame" (with the nearest candidate there)."""
    missed: "Missed | None" = None
    """Kind "no second frame": why the second frame showed nothing."""
    away_arcsec: float | None = None
    """Kind "clipped and far": distance from the prediction; limit: ``allowed_arcsec``."""
    allowed_arcsec: float | None = None
    object_class: str = ""
    """Kind "class": class of the streak's object."""

    @classmethod
    def clipped_and_far(cls, away_arcsec: float, allowed_arcsec: float) -> "NotTaken":
        """Return the reason for a clipped streak that lies too far from the track's prediction."""
        return cls(
            kind="clipped and far",
            away_arcsec=float(round(away_arcsec)),
            allowed_arcsec=float(round(allowed_arcsec)),
        )

    @classmethod
    def by_gate(cls, nis: float, limit: float) -> "NotTaken":
        """Return the reason for an innovation beyond the gate."""
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
    """Reason why the telescope must not go to or stay at a place; figures as shown."""

    kind: SlewRefusalKind
    """Kind of limit; "Sun": there; "past the Sun" and "nearer to the Sun": on the way there."""
    value_deg: float | None = None
    """Angle that is beyond the limit, deg, to one decimal; ``bound_deg``: the limit."""
    bound_deg: float | None = None
    by_deg: float | None = None
    """Excess beyond the limit, deg: one decimal, below 0.1 three; 0 below 0.001."""
    azimuth_deg: float | None = None
    """Kind "horizon": azimuth, whole degrees."""
    side: Literal["east", "west"] | None = None
    """Side of the pier: of kind "pier" the present, of "meridian policy" the next one."""
    later_s: float | None = None
    """Time until the limit is met, whole seconds; None: it is met now."""
    ago_min: float | None = None
    """Kind "aimed before": how long the requested instant is past, whole minutes."""
    ahead_h: float | None = None
    """Kinds "aimed ahead", "ends ahead": how far ahead the instant is, h."""
    detail: str = ""
    """Kinds "direction" and "clock": the impossible value, in words."""

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
        """Return the refusal of an angle beyond its limit; ``later_s``: time until it is, s."""
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
        """Return the refusal of a change to pier side ``side`` while a track is followed."""
        return cls(kind="meridian policy", value_deg=_tenths(hour_angle_deg), side=side)

    @classmethod
    def by_instant(cls, kind: SlewRefusalKind, ahead_s: float = 0.0) -> "SlewRefusal":
        """Return the refusal of an instant too far from now; ``ahead_s``: instant minus now."""
        if kind == "aimed before":
            return cls(kind=kind, ago_min=_whole(-ahead_s / 60.0))
        return cls(kind=kind, ahead_h=_tenths(ahead_s / 3600.0))


def _rounded(distance_deg: float) -> float:
    """Round a distance from a bound to as many digits as it takes to show it."""
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
    """Likely cause of a frame without a measurement of a track; figures rounded as displayed."""

    kind: HiddenKind
    """Kind. Cloud: "fewer stars" and "fainter stars" than before, "few stars" where before is not
    known. Eclipse: "shadow" (full), "penumbra" (partial)."""
    refusal: SlewRefusal | None = None
    """Kind "slew refused": why the slew to the track was refused."""
    stars: int | None = None
    """Kinds "fewer stars" and "few stars": number of stars."""
    usual_stars: int | None = None
    """Kind "fewer stars": number of stars in the frames before."""
    fainter_mag: float | None = None
    """Kind "fainter stars": how much fainter the stars are, mag, to one decimal."""
    sun_percent: float | None = None
    """Kind "penumbra": part of the Sun's light that is left, whole percent."""

    @classmethod
    def by_faint_stars(cls, fainter_mag: float) -> "HiddenBy":
        """Return the cause "fainter stars": cloud dims the stars."""
        return cls(kind="fainter stars", fainter_mag=_tenths(fainter_mag))

    @classmethod
    def by_penumbra(cls, lit: float) -> "HiddenBy":
        """Return the cause "penumbra"; ``lit``: fraction of the Sun not covered by the Earth."""
        return cls(kind="penumbra", sun_percent=_whole(100.0 * lit))


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackLost:
    """Reason why a track ended; figures as shown."""

    kind: Literal[
        "too wide",
        "wider than the field",
        "coasted",
        "not confirmed",
        "seen too seldom",
        "left the field",
    ]
    three_sigma_arcmin: float | None = None
    """First two kinds: three sigma of the prediction, whole arcmin."""
    coasted_min: float | None = None
    """Kind "coasted": time without a measurement, whole minutes."""
    unseen_frames: int | None = None
    """Kind "seen too seldom": number of frames that should have shown the object."""

    @classmethod
    def by_uncertainty(cls, three_sigma_arcmin: float, *, fits_field: bool) -> "TrackLost":
        """Return the reason of a track that ends because its prediction is too uncertain.

        ``fits_field``: True where three sigma of the prediction are smaller than the field.
        """
        kind: Literal["too wide", "wider than the field"]
        kind = "too wide" if fits_field else "wider than the field"
        return cls(kind=kind, three_sigma_arcmin=_whole(three_sigma_arcmin))

    @classmethod
    def by_time(cls, coasted_s: float) -> "TrackLost":
        """Return the reason of a track that ends after ``coasted_s`` without a measurement."""
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
    """Reason why a frame gave no measurement to a track."""

    kind: MissKind
    """Kind of miss; "instrument": an instrument failed, and there was no frame."""
    detail: str = ""
    """Kinds "not solved" and "instrument": message for people."""
    hidden_by: tuple[HiddenBy, ...] = ()
    """Likely causes, most certain first: a refused slew, cloud, eclipse."""
    lost: TrackLost | None = None
    """Reason why the track ended with this miss; None where the track continues."""


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
    "faint frames agree",
    "measured again",
    "re-acquired",
    "waiting",
    "missed",
]


@dataclass(frozen=True, slots=True, kw_only=True)
class Cause:
    """Reason for a change of the loop's state."""

    kind: CauseKind
    by: str = ""
    """Name of the sender of the order."""
    detail: str = ""
    """Details, in words for people."""
    step_s: float | None = None
    """Kind "clock set": size of the step, s."""
    detections: int | None = None
    """Kind "waiting": number of detections that wait for a second frame."""
    frames: int | None = None
    """Kind "faint frames agree": number of frames together, each too faint to be sure alone."""
    probability: float | None = None
    """Kind "faint frames agree": probability of one object in all, two decimals, .99 at most."""
    missed: Missed | None = None


FROM_OUTSIDE: frozenset[CauseKind] = frozenset(
    ("limit met", "looked for again", "resumed", "clock set")
)
"""Causes that come from elsewhere than the frames of a search or track."""

ResultKind: TypeAlias = Literal[
    "accepted", "done", "ruled", "answered", "measured", "refused", "dropped", "failed"
]
StopOutcome: TypeAlias = Literal["stands", "tracks", "moves", "unknown"]
"""Outcome of a STOP, by the motion measured after it."""
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
    """Kind. "accepted": it waits; its result is recorded later. A STOP: "answered" by the mount's
    driver or "failed" to be, then "measured"."""
    detail: str = ""
    """How the command was done; or why it was not done, or is not known."""
    dropped_by: DroppedBy | None = None
    """What ended the waiting command before it was executed."""
    stop_ms: float | None = None
    """Time until a STOP was answered, or measured, ms; ``stop_path``: its path."""
    stop_path: str = ""
    stop_ordered_ms: float | None = None
    """Time until ABORT was sent to the mount, ms; None: never sent, or unknown."""
    stop_outcome: StopOutcome | None = None
    rate_deg_s: float | None = None
    """Rate of the faster axis of a mount that still moves, deg/s."""
    ruled: RuledKind | None = None
    """What the operator's decision on a frame led to."""
    frame_id: int | None = None
    left_alone: int = 0
    """Number of measurements, from that frame on, that the track did not take."""
    sigma_arcsec: tuple[float, float] | None = None
    """One sigma of a mark by hand, (RA cos Dec, Dec), arcsec."""
    off_arcsec: float | None = None
    """Distance from a mark by hand to the measurement it replaces; None: it replaces none."""

    @classmethod
    def refused(cls, why: object) -> "CommandResult":
        """Return the result of a refused command; ``why`` as text."""
        return cls(kind="refused", detail=str(why))


ACCEPTED, DONE = CommandResult(kind="accepted"), CommandResult(kind="done")


def done_result(detail: str) -> CommandResult:
    """Return the result of a command that was carried out; ``detail`` in words for people."""
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
