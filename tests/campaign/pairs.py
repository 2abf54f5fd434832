"""Two detectors on the same frames at equal false positives: which satellites each of them found.

A detector's threshold is the lowest that lets as many false candidates through, on the frames
that both looked at, as the operating point allows.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from tests.bench.peers.scoring import threshold_at

SIGNIFICANT = 0.05
Key = tuple[str, int]
"""Family and number of a frame."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Look:
    """What one detector said of one frame."""

    score: float | None
    """Of the candidate on the satellite; None where there is none."""
    off_px: float | None
    """Its midpoint from the true one."""
    false: tuple[float, ...]
    """Scores of candidates where nothing is, the highest first; the lowest of many left out."""
    false_count: int
    cpu_s: float | None
    """Of the processor: other work on the machine lengthens the wall's, hardly this."""
    error: str
    """Why there is no answer; empty where there is one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Pairs:
    """Satellites in frames that two detectors looked at."""

    frames: int
    both: int
    ours_alone: int
    theirs_alone: int

    @property
    def ours(self) -> float:
        """Recall."""
        return (self.both + self.ours_alone) / self.frames if self.frames else float("nan")

    @property
    def theirs(self) -> float:
        """Recall."""
        return (self.both + self.theirs_alone) / self.frames if self.frames else float("nan")

    @property
    def p_value(self) -> float:
        """Two-sided, of as much difference by chance: McNemar's test, exact (binomial)."""
        from scipy.stats import binomtest

        differ = self.ours_alone + self.theirs_alone
        return float(binomtest(self.ours_alone, differ).pvalue) if differ else 1.0

    @property
    def is_ours_lower(self) -> bool:
        """Significantly, each comparison by itself: nothing is taken off for making many."""
        return self.theirs_alone > self.ours_alone and self.p_value < SIGNIFICANT


def false_above(looks: Mapping[Key, Look], threshold: float) -> int:
    """False candidates above a threshold."""
    return sum(score > threshold for look in looks.values() for score in look.false)


def found_above(looks: Mapping[Key, Look], most_false: int) -> set[Key]:
    """The frames whose satellite has a candidate above the threshold of so many false ones."""
    above = threshold_at([s for look in looks.values() for s in look.false], most_false)
    return {k for k, look in looks.items() if look.score is not None and look.score > above}


def paired(
    ours: Mapping[Key, Look], theirs: Mapping[Key, Look], *, tau: float | None, rate: float = 0.0
) -> dict[str, Pairs]:
    """By family, and "" for all together.

    ``tau``: ours runs with it, theirs with as many false candidates; None: both with ``rate``
    false candidates a frame.
    """
    keys = ours.keys() & theirs.keys()
    ours, theirs = ({key: looks[key] for key in keys} for looks in (ours, theirs))
    most_false = int(rate * len(keys) + 1e-9)
    if tau is None:
        by_us = found_above(ours, most_false)
    else:
        most_false = false_above(ours, tau)
        by_us = {k for k, look in ours.items() if look.score is not None and look.score > tau}
    by_them = found_above(theirs, most_false)
    families = sorted({family for family, _ in keys})
    return {
        family: _count([key for key in keys if family in ("", key[0])], by_us, by_them)
        for family in ("", *families)
    }


def _count(keys: Sequence[Key], by_us: set[Key], by_them: set[Key]) -> Pairs:
    return Pairs(
        frames=len(keys),
        both=sum(key in by_us and key in by_them for key in keys),
        ours_alone=sum(key in by_us and key not in by_them for key in keys),
        theirs_alone=sum(key not in by_us and key in by_them for key in keys),
    )
