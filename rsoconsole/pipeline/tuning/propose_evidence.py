"""What a proposal of Q and R says, and what it rests on."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, TypeAlias

Verdict: TypeAlias = Literal["not enough to say", "no change is called for", "change"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Proposed:
    """One parameter and what the data say of it."""

    label: str
    names: tuple[str, ...]
    """Settings that take its value."""
    recorded: float
    proposed: float
    """As recorded where no change of it is called for."""
    likeliest: float
    interval_68: tuple[float, float]
    """Within which the profile of log L falls by 0.5 at most; by 2 for preset tuned, whose log L is
    too sharp (``propose_inquiry.WIDENED``)."""
    is_on_bound: bool
    """The likeliest value lies where the search ended."""
    is_flat: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Term:
    """A term of its own that was tried beside Q and R as wholes."""

    label: str
    gain: float
    """In log L."""
    needed: float
    is_taken: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Soundness:
    """What the innovations say of one filter."""

    log_likelihood: float
    nis_mean: float
    nis_band: tuple[float, float]
    autocorrelation_east: float
    autocorrelation_north: float

    @property
    def is_nis_in_band(self) -> bool:
        """Whether the mean NIS is that of a sound filter."""
        return self.nis_band[0] <= self.nis_mean <= self.nis_band[1]


@dataclass(frozen=True, slots=True, kw_only=True)
class HoldOut:
    """Fitted to the first half of the innovations, held against the second."""

    innovations: int
    """In the second half."""
    gain: float
    """In log L of the second half, over the recorded settings; below 0 it does not carry over."""
    nis_mean_before: float
    nis_mean_after: float
    nis_band: tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Proposal:
    """Q and R by maximum likelihood, and why."""

    sessions: tuple[Path, ...]
    preset: str
    verdict: Verdict
    words: str
    """The verdict in a sentence."""
    changes: Mapping[str, float] = field(default_factory=dict)
    """Settings that are proposed, by dotted name; empty where none is."""
    innovations: int
    tracks: int
    gain: float | None = None
    """In log L, of the likeliest Q and R over the recorded ones; None where none were sought."""
    needed: float | None = None
    parameters: tuple[Proposed, ...] = ()
    terms: tuple[Term, ...] = ()
    before: Soundness | None = None
    after: Soundness | None = None
    """As ``before`` where no change is called for."""
    autocorrelation_bound: float | None = None
    """Within which that of white innovations lies, 95 times in 100."""
    hold_out: HoldOut | None = None
    rounds: int = 0
    evaluations: int = 0
    warnings: tuple[str, ...] = ()
