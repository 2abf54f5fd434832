"""Scores of filter and orbit as predictors of a track's last measurements. Pure."""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import fmean

WINDOW = 8
_LEAST = 5
"""Fewest measurements predicted by both."""
_AHEAD = 0.5
"""Least lead in mean score before the guide changes, so that chance does not change it."""
_CLOSE = 0.1
"""Share within which two predicted widths are equal, so that a turn between them is no news."""
_BELIEVED = 0.999
"""Probability of its NIS from which an orbit is not believed, whatever the filter's score."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Score:
    """Score of one prediction of one measurement."""

    nis: float
    log_size: float
    """Natural logarithm of the determinant, in arcsec^4, of the innovation's covariance."""

    @property
    def predicted_sigma_arcsec(self) -> float:
        """Sigma of the innovation as predicted, the geometric mean of both axes, arcsec."""
        return math.exp(self.log_size / 4.0)

    @property
    def score(self) -> float:
        """-2 log of the probability density predicted for the measurement, up to a constant.

        A smaller value is better.
        """
        return self.nis + self.log_size


class PredictorScores:
    """Compares orbit and filter as predictors, over the last measurements of a track."""

    def __init__(self) -> None:
        self._scores: deque[tuple[Score, Score]] = deque(maxlen=WINDOW)
        self.is_orbit_ahead = False
        self._failed = ""
        """Words on the filter's last failure; empty where its NIS is not known."""

    def add_scores(self, by_orbit: Score, by_filter: Score) -> None:
        """Add one measurement that both predicted, and decide which of them is better."""
        self._scores.append((by_orbit, by_filter))
        if len(self._scores) >= _LEAST:
            lead = fmean(theirs.score - ours.score for ours, theirs in self._scores)
            is_better = lead > (0.0 if self.is_orbit_ahead else _AHEAD)
            self.is_orbit_ahead = is_better and self._is_believed()

    def add_filter_failure(self, nis: float | None = None, gate_nis: float | None = None) -> None:
        """Prefer the orbit from now on: it predicted a measurement that the filter's gate excluded.

        ``nis``, ``gate_nis``: NIS of that measurement by the filter, and its gate; None: not known.
        """
        self._scores.clear()
        self.is_orbit_ahead = True
        known = nis is not None and gate_nis is not None
        self._failed = f": NIS {nis:.1f} by that, gate {gate_nis:.1f}" if known else ""

    @property
    def has_similar_sigmas(self) -> bool:
        """True where both mean predicted sigmas agree within 10 %, or as rounded to 0.1 arcsec."""
        if not self._scores:
            return False
        ours, theirs = (
            fmean(each[n].predicted_sigma_arcsec for each in self._scores) for n in (0, 1)
        )
        return abs(ours - theirs) < _CLOSE * max(ours, theirs) or f"{ours:.1f}" == f"{theirs:.1f}"

    @property
    def words(self) -> str:
        """Phrase for messages on how both have predicted the last measurements."""
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
    width = fmean(each.predicted_sigma_arcsec for each in scores)
    return f"±{width:.1f}″, NIS {fmean(each.nis for each in scores):.1f}"
