"""Comparison of candidates with the truth: matching, recall, false candidates, calibration."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from models.fields import Field, TrueStreak
from rsoconsole.vision import ByteArray, decode_candidates, keep_distinct

Float32Array = npt.NDArray[np.float32]
FloatArray = npt.NDArray[np.float64]
Answer = Callable[[ByteArray], Float32Array]
"""Function from a map (h, w) to the network's answers (6, h / 4, w / 4)."""


class MapStreak(NamedTuple):
    """One candidate of the network in cells of the map (0: left edge of the first cell)."""

    logit: float
    x_a: float
    y_a: float
    x_b: float
    y_b: float

    @property
    def middle(self) -> tuple[float, float]:
        """Column and row of the midpoint."""
        return (self.x_a + self.x_b) / 2, (self.y_a + self.y_b) / 2

    @property
    def length(self) -> float:
        """Length from end to end, cells."""
        return float(np.hypot(self.x_b - self.x_a, self.y_b - self.y_a))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Score:
    """Result of a detector on a set of fields with known truth."""

    true_logits: FloatArray
    """Logit of every streak that is expected to be found; -inf where it was missed."""
    true_snrs: FloatArray
    true_lengths: FloatArray
    middle_errors: FloatArray
    """Errors of the midpoints of the streaks found, in cells."""
    false_logits: FloatArray
    false_kinds: tuple[str, ...]
    cells: int
    """Area of all fields, in cells of the map."""

    def recall(
        self,
        logit: float,
        snr: tuple[float, float] = (0.0, np.inf),
        cells: tuple[float, float] = (0.0, np.inf),
    ) -> float:
        """Fraction of expected streaks found above a logit, in a range of peak SNR and of length.

        ``cells``: range of length. NaN where no streak is in these ranges.
        """
        chosen = (self.true_snrs >= snr[0]) & (self.true_snrs < snr[1])
        chosen &= (self.true_lengths >= cells[0]) & (self.true_lengths < cells[1])
        return float(np.mean(self.true_logits[chosen] > logit)) if chosen.any() else float("nan")

    def logit_for_false(self, count: int) -> float:
        """Logit above which ``count`` false candidates lie; -inf where there are no more."""
        ordered = np.sort(self.false_logits)[::-1]
        return float(ordered[count]) if count < len(ordered) else -np.inf


def logit_for_rate(false_logits: FloatArray, wanted: float, tail: int = 20) -> float:
    """Logit above which ``wanted`` false candidates are expected, by an exponential tail.

    The tail is fitted to the ``tail`` highest logits, so that a single outlier does not decide.
    """
    ordered = np.sort(false_logits)[::-1]
    count = min(tail, len(ordered) - 1)
    if count < 2:
        return -np.inf
    foot = ordered[count]
    scale = float(np.mean(ordered[:count] - foot))
    return float(foot + scale * np.log(count / wanted))


def fits(candidate: MapStreak, true: TrueStreak) -> bool:
    """True where a candidate matches a true streak.

    It must be near across the streak, overlap along it, and have about its direction.
    """
    length = max(true.length, 1e-6)
    cos, sin = (true.x_b - true.x_a) / length, (true.y_b - true.y_a) / length
    x, y = candidate.middle
    dx, dy = x - (true.x_a + true.x_b) / 2, y - (true.y_a + true.y_b) / 2
    along, across = abs(dx * cos + dy * sin), abs(dy * cos - dx * sin)
    cx = (candidate.x_b - candidate.x_a) / max(candidate.length, 1e-6)
    cy = (candidate.y_b - candidate.y_a) / max(candidate.length, 1e-6)
    is_parallel = abs(cx * cos + cy * sin) > np.cos(np.radians(20))
    return across < 3.0 and along < max(4.0, 0.3 * length) and is_parallel


def score(fields: Iterable[Field], answer: Answer, lowest_logit: float = -2.0) -> Score:
    """Compare a detector's answers on fields with the truth.

    Candidates below ``lowest_logit`` are dropped. Streaks that are not expected to be found count
    neither as found nor as false.
    """
    true_logits, snrs, lengths, errors = [], [], [], []
    false_logits, kinds, cells = [], [], 0
    for field in fields:
        found = keep_distinct(decode_candidates(answer(field.values), lowest_logit))
        cells += field.values.size
        free = [MapStreak(*each) for each in found.tolist()]
        for true in sorted(field.streaks, key=lambda s: -s.peak_snr):
            match = next((c for c in free if fits(c, true)), None)
            if match is not None:
                free.remove(match)
            if not true.is_asked:
                continue
            true_logits.append(-np.inf if match is None else match.logit)
            snrs.append(true.peak_snr)
            lengths.append(true.length)
            if match is not None:
                x, y = match.middle
                errors.append(
                    np.hypot(x - (true.x_a + true.x_b) / 2, y - (true.y_a + true.y_b) / 2)
                )
        for candidate in free:
            if any(_touches(candidate, true) for true in field.streaks):
                continue
            false_logits.append(candidate.logit)
            kinds.append(field.kind)
    return Score(
        true_logits=np.array(true_logits),
        true_snrs=np.array(snrs),
        true_lengths=np.array(lengths),
        middle_errors=np.array(errors),
        false_logits=np.array(false_logits),
        false_kinds=tuple(kinds),
        cells=cells,
    )


def _touches(candidate: MapStreak, true: TrueStreak) -> bool:
    """True for a second candidate on a true streak: a fault of position, not an invention."""
    x, y = candidate.middle
    length = max(true.length, 1e-6)
    cos, sin = (true.x_b - true.x_a) / length, (true.y_b - true.y_a) / length
    dx, dy = x - (true.x_a + true.x_b) / 2, y - (true.y_a + true.y_b) / 2
    return abs(dy * cos - dx * sin) < 5 and abs(dx * cos + dy * sin) < length / 2 + 5


def fit_platt(true_logits: FloatArray, false_logits: FloatArray) -> tuple[float, float]:
    """Slope and offset of the logistic curve through true and false candidates (Platt 1999)."""
    found = true_logits[np.isfinite(true_logits)]
    x = np.concatenate([found, false_logits])
    y = np.concatenate([np.ones(len(found)), np.zeros(len(false_logits))])
    slope, offset = 1.0, 0.0
    for _ in range(100):
        p = 1.0 / (1.0 + np.exp(-(slope * x + offset)))
        w = np.maximum(p * (1.0 - p), 1e-9)
        gradient = np.array([np.sum((p - y) * x) + 1e-3 * (slope - 1), np.sum(p - y)])
        cross = np.sum(w * x)
        hessian = np.array([[np.sum(w * x * x) + 1e-3, cross], [cross, np.sum(w) + 1e-3]])
        step = np.linalg.solve(hessian, gradient)
        slope, offset = slope - step[0], offset - step[1]
        if np.abs(step).max() < 1e-8:
            break
    return float(slope), float(offset)
