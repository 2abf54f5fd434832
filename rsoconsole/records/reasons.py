"""Causes and results: a kind with its figures each; ``words`` makes the sentence.

Programs look at kinds and figures alone. A ``detail`` is for people: nothing is decided by it.
"""

from dataclasses import dataclass
from typing import Literal, TypeAlias


@dataclass(frozen=True, slots=True, kw_only=True)
class BelowTau:
    """A candidate that passed every gate, but has too low a confidence."""

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
    """The gate at which a candidate failed."""

    kind: NotAStreakKind
    value: float | None = None
    """Measured value: a signal to noise, a width or length in pixels, a share, a count."""
    limit: float | None = None
    """Limit of the gate, in the unit of ``value``."""


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
    """Difference of kind "direction", deg; measured length of kind "length", arcsec; both rounded
    to whole ones."""
    expected: float | None = None
    """Expected length of kind "length", arcsec."""

    @classmethod
    def of_direction(cls, off_deg: float) -> "MotionMismatch":
        """Return a mismatch of direction."""
        return cls(kind="direction", value=float(round(off_deg)))

    @classmethod
    def of_length(cls, length_arcsec: float, expected_arcsec: float) -> "MotionMismatch":
        """Return a mismatch of length."""
        whole = float(round(length_arcsec)), float(round(expected_arcsec))
        return cls(kind="length", value=whole[0], expected=whole[1])


@dataclass(frozen=True, slots=True, kw_only=True)
class NotTaken:
    """Reason why a track did not take a measurement."""

    kind: NotTakenKind
    nis: float | None = None
    """Normalised innovation squared of kind "NIS", and in ``limit`` the gate's, to one decimal."""
    limit: float | None = None
    mismatch: MotionMismatch | None = None
    """Mismatch of kind "moves otherwise"; of kind "no second frame", with the nearest candidate for
    one."""
    missed: "Missed | None" = None
    """Miss of the second frame, of kind "no second frame" where that frame showed nothing."""
    away_arcsec: float | None = None
    """Distance from the prediction, arcsec, of kind "clipped and far", and in ``allowed_arcsec``
    its limit; both whole."""
    allowed_arcsec: float | None = None
    object_class: str = ""
    """Class of the streak's object, of kind "class"."""

    @classmethod
    def clipped_and_far(cls, away_arcsec: float, allowed_arcsec: float) -> "NotTaken":
        """Return a refusal of a streak whose visible part is not where the track's may be."""
        return cls(
            kind="clipped and far",
            away_arcsec=float(round(away_arcsec)),
            allowed_arcsec=float(round(allowed_arcsec)),
        )

    @classmethod
    def by_gate(cls, nis: float, limit: float) -> "NotTaken":
        """Return a refusal of an innovation that is too large."""
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
    """Reason why the telescope must not go or stay somewhere; figures as they are shown."""

    kind: SlewRefusalKind
    """Kind of limit; "Sun": there; "past the Sun" and "nearer to the Sun": on the way there."""
    value_deg: float | None = None
    """Angle compared with a limit, deg, to one decimal."""
    bound_deg: float | None = None
    by_deg: float | None = None
    """Excess beyond the bound, deg: to one decimal, below 0.1 to three; 0 below 0.001."""
    azimuth_deg: float | None = None
    """Azimuth of kind "horizon", deg, to the whole one."""
    side: Literal["east", "west"] | None = None
    """Side of the pier; of kind "pier" the present one, of "meridian policy" the one after a
    change."""
    later_s: float | None = None
    """Time until then, s, to the whole one; None where it is now."""
    ago_min: float | None = None
    """Age of an instant of kind "aimed before", min."""
    ahead_h: float | None = None
    """Time ahead of kinds "aimed ahead" and "ends ahead", h, to one decimal."""
    detail: str = ""
    """Impossible value of kinds "direction" and "clock", in words."""

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
        """Return a refusal of an angle beyond its bound."""
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
        """Return a refusal as the mount would change sides while a track is followed."""
        return cls(kind="meridian policy", value_deg=_tenths(hour_angle_deg), side=side)

    @classmethod
    def by_instant(cls, kind: SlewRefusalKind, ahead_s: float = 0.0) -> "SlewRefusal":
        """Return a refusal of an instant too far from now."""
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
    """Cause of a frame without a measurement; figures as they are shown."""

    kind: HiddenKind
    """Kind of cause. Cloud: "fewer stars" and "fainter stars" than before, or "few stars" where
    nothing is known of before; eclipse: "shadow" and "penumbra"."""
    refusal: SlewRefusal | None = None
    """Refusal of the slew to the track, of kind "slew refused"."""
    stars: int | None = None
    """Number of stars, of kinds "fewer stars" and "few stars"."""
    usual_stars: int | None = None
    """Number of stars before, of kind "fewer stars"."""
    fainter_mag: float | None = None
    """Dimming of the stars, mag, of kind "fainter stars", to one decimal."""
    sun_percent: float | None = None
    """Part of the Sun that is left, percent, of kind "penumbra", to the whole one."""

    @classmethod
    def by_faint_stars(cls, fainter_mag: float) -> "HiddenBy":
        """Return the cause of cloud that dims the stars."""
        return cls(kind="fainter stars", fainter_mag=_tenths(fainter_mag))

    @classmethod
    def by_penumbra(cls, lit: float) -> "HiddenBy":
        """Return the cause of the Earth before part of the Sun; ``lit``: the share that is left."""
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
    """Three sigma of the prediction, arcmin, of the first two kinds, to the whole one."""
    coasted_min: float | None = None
    """Time coasted, min, of kind "coasted", to the whole one."""
    unseen_frames: int | None = None
    """Number of frames that should have shown it, of kind "seen too seldom"."""

    @classmethod
    def by_bounds(cls, three_sigma_arcmin: float, *, fits_field: bool) -> "TrackLost":
        """Return the end of a track whose prediction is too uncertain."""
        kind: Literal["too wide", "wider than the field"]
        kind = "too wide" if fits_field else "wider than the field"
        return cls(kind=kind, three_sigma_arcmin=_whole(three_sigma_arcmin))

    @classmethod
    def by_time(cls, coasted_s: float) -> "TrackLost":
        """Return the end of a track that has coasted for too long."""
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
    """Kind of miss; "instrument": it failed, and there was nothing to fold."""
    detail: str = ""
    """Message of kinds "not solved" and "instrument", for people."""
    hidden_by: tuple[HiddenBy, ...] = ()
    """Likely causes: a refused slew, cloud, eclipse; most certain first."""
    lost: TrackLost | None = None
    """End of the track with this miss; None where it goes on."""


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
    """Reason for a change of the loop's state."""

    kind: CauseKind
    by: str = ""
    """Name of the sender of the order."""
    detail: str = ""
    """Details in words for people."""
    step_s: float | None = None
    """Step by which the clock was set, s."""
    detections: int | None = None
    """Number of detections that wait for a second frame."""
    missed: Missed | None = None


FROM_OUTSIDE: frozenset[CauseKind] = frozenset(
    ("limit met", "looked for again", "resumed", "clock set")
)
"""Causes that change the state of a search or track from outside its frames."""

ResultKind: TypeAlias = Literal[
    "accepted", "done", "ruled", "answered", "measured", "refused", "dropped", "failed"
]
StopOutcome: TypeAlias = Literal["stands", "tracks", "moves", "unknown"]
"""Outcome of a STOP, by the directions that the mount reports since."""
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
    """Kind of result; "accepted": it waits, and its result is recorded too; of a STOP: "answered"
    by the mount's driver, or "failed" to be, then "measured"."""
    detail: str = ""
    """How it was done, where of interest; or why it was not, or is not known."""
    dropped_by: DroppedBy | None = None
    """Alarm that came before the waiting command."""
    stop_ms: float | None = None
    """Time until a STOP was answered, or measured, ms, and in ``stop_path`` its way to the
    mount."""
    stop_path: str = ""
    stop_ordered_ms: float | None = None
    """Time until ABORT was on its way to the mount, ms; None: not known, or never."""
    stop_outcome: StopOutcome | None = None
    rate_deg_s: float | None = None
    """Rate of the faster axis of a mount that moves on, deg/s."""
    ruled: RuledKind | None = None
    """Result of the operator's decision on a frame."""
    frame_id: int | None = None
    left_alone: int = 0
    """Number of measurements of that frame and those after it that the track did not take."""
    sigma_arcsec: tuple[float, float] | None = None
    """One sigma of a used mark by hand in RA cos Dec and in Dec, arcsec."""
    off_arcsec: float | None = None
    """Distance from the mark to the automatic measurement that it replaces, arcsec; None: there is
    none."""

    @classmethod
    def refused(cls, why: object) -> "CommandResult":
        """Return the result of a refused command."""
        return cls(kind="refused", detail=str(why))


ACCEPTED, DONE = CommandResult(kind="accepted"), CommandResult(kind="done")


def done(detail: str) -> CommandResult:
    """Return the result of a finished command, in words for people."""
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
