"""Why something came to pass: a kind with its figures; ``reason_text`` makes the sentence.

Programs look at kinds and figures alone. Where a record's reason may also be plain text, that
text is for people: nothing is decided by it.
"""

from dataclasses import dataclass
from typing import Literal, TypeAlias


@dataclass(frozen=True, slots=True, kw_only=True)
class BelowTau:
    """A candidate that passed every gate, and is not likely enough."""

    confidence: float
    tau: float


NotTakenKind: TypeAlias = Literal[
    "NIS",
    "cannot be told apart",
    "refused",
    "not chosen",
    "another taken",
    "another leads",
    "clipped at start",
    "neighbour",
]


@dataclass(frozen=True, slots=True, kw_only=True)
class NotTaken:
    """Why a track did not take a measurement."""

    kind: NotTakenKind
    nis: float | None = None
    """Normalised innovation squared of kind "NIS", and the gate's limit, to one decimal."""
    limit: float | None = None

    @classmethod
    def by_gate(cls, nis: float, limit: float) -> "NotTaken":
        """The innovation is too large."""
        return cls(kind="NIS", nis=_tenths(nis), limit=_tenths(limit))


def _tenths(value: float) -> float:
    return float(f"{value:.1f}")


MissKind: TypeAlias = Literal[
    "no detection",
    "nothing fits",
    "cannot be told apart",
    "not solved",
    "no time",
    "not measured",
    "instrument",
]


@dataclass(frozen=True, slots=True, kw_only=True)
class Missed:
    """Why a frame gave no measurement to what is followed."""

    kind: MissKind
    """"instrument": it failed, and there was nothing to fold."""
    detail: str = ""
    """Of kinds "not solved" and "instrument": what was said."""
    hidden_by: str = ""
    """What it is put down to: a refused slew, cloud, eclipse; most certain first."""
    lost: str = ""
    """Why the track ends with it; empty where it goes on."""


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
    "waiting",
    "missed",
]


@dataclass(frozen=True, slots=True, kw_only=True)
class Cause:
    """Why the loop passed from one state to another."""

    kind: CauseKind
    by: str = ""
    """Who wanted it."""
    detail: str = ""
    """What was said of it."""
    step_s: float | None = None
    """By how much the clock was set."""
    detections: int | None = None
    """How many wait for a second frame."""
    missed: Missed | str | None = None


FROM_OUTSIDE: frozenset[CauseKind] = frozenset(("limit met", "looked for again", "clock set"))
"""What leads from one state of a search or track to another without a frame's doing."""
Reason: TypeAlias = BelowTau | NotTaken | Missed | Cause
