"""Whether filter or orbit has predicted a track's last measurements better. Pure."""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import fmean

WINDOW = 8
_LEAST = 5
"""Measurements that both must have predicted."""
_AHEAD = 0.5
"""By so much better on the mean before the guide changes, so that it does not change for chance."""
_CLOSE = 0.1
"""A turn between two that promise the same but for such a share is no news."""
_BELIEVED = 0.999
"""An orbit whose NIS are this unlikely is not believed, however the filter fares."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Score:
    """Score of one prediction of one measurement."""

    nis: float
    log_size: float
    """Logarithm of the determinant of the innovation's covariance, arcsec."""

    @property
    def width_arcsec(self) -> float:
        """One sigma that it had stated: the geometric mean of both axes."""
        return math.exp(self.log_size / 4.0)

    @property
    def score(self) -> float:
        """Smaller is better: minus twice the logarithm of the density, but for a constant."""
        return self.nis + self.log_size


class PredictorScores:
    """Scores of orbit and filter over the last measurements."""

    def __init__(self) -> None:
        self._scores: deque[tuple[Score, Score]] = deque(maxlen=WINDOW)
        self.is_orbit_ahead = False
        """Whether the orbit predicts better."""
        self._failed = ""
        """By how much the filter failed last; empty: not known."""

    def compare(self, by_orbit: Score, by_filter: Score) -> None:
        """Add the scores of one measurement that both predicted."""
        self._scores.append((by_orbit, by_filter))
        if len(self._scores) >= _LEAST:
            lead = fmean(theirs.score - ours.score for ours, theirs in self._scores)
            is_better = lead > (0.0 if self.is_orbit_ahead else _AHEAD)
            self.is_orbit_ahead = is_better and self._is_believed()

    def filter_failed(self, nis: float | None = None, gate_nis: float | None = None) -> None:
        """The orbit predicted what the filter did not: the NIS of the measurement by the latter."""
        self._scores.clear()
        self.is_orbit_ahead = True
        known = nis is not None and gate_nis is not None
        self._failed = f": NIS {nis:.1f} by that, gate {gate_nis:.1f}" if known else ""

    @property
    def is_close(self) -> bool:
        """Whether both state the same width: within a tenth, or as written."""
        if not self._scores:
            return False
        ours, theirs = (fmean(each[n].width_arcsec for each in self._scores) for n in (0, 1))
        return abs(ours - theirs) < _CLOSE * max(ours, theirs) or f"{ours:.1f}" == f"{theirs:.1f}"

    @property
    def words(self) -> str:
        """How both have predicted the last measurements."""
        if not self._scores:
            return f"what was seen does not fit the filter's prediction{self._failed}"
        ours, theirs = zip(*self._scores, strict=True)
        which = "it has predicted better" if self.is_orbit_ahead else "the orbit predicts no better"
        return f"{which} (orbit {_fared(ours)}, filter {_fared(theirs)})"

    def _is_believed(self) -> bool:
        from scipy.special import chdtr

        total = sum(ours.nis for ours, _ in self._scores)
        return bool(chdtr(2 * len(self._scores), total) < _BELIEVED)


def _fared(scores: Sequence[Score]) -> str:
    width = fmean(each.width_arcsec for each in scores)
    return f"±{width:.1f}″, NIS {fmean(each.nis for each in scores):.1f}"
