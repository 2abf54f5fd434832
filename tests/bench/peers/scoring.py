"""One rule for every detector: what counts as found, and how well its candidates are ranked.

Places in pixels, 0 = centre of the first pixel; angles in degrees in the array, x towards y.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

NEAREST_PX = 10.0
NEAREST_LENGTHS = 0.3
AXIS_DEG = 15.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Line:
    """A streak from end to end."""

    x_a_px: float
    y_a_px: float
    x_b_px: float
    y_b_px: float

    @property
    def middle_px(self) -> tuple[float, float]:
        """Column and row of the midpoint."""
        return (self.x_a_px + self.x_b_px) / 2, (self.y_a_px + self.y_b_px) / 2

    @property
    def length_px(self) -> float:
        """From end to end."""
        return float(np.hypot(self.x_b_px - self.x_a_px, self.y_b_px - self.y_a_px))

    @property
    def angle_deg(self) -> float:
        """Direction modulo 180 deg."""
        dx, dy = self.x_b_px - self.x_a_px, self.y_b_px - self.y_a_px
        return float(np.degrees(np.arctan2(dy, dx)) % 180.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """What a detector says; a higher score is a stronger belief, of any scale."""

    line: Line
    score: float


@dataclass(frozen=True, slots=True, kw_only=True)
class TrueStreak:
    """What is in the frame."""

    line: Line
    snr: float
    """Ridge signal over the background's sigma, of one full-resolution pixel."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Judged:
    """The verdict on one frame."""

    found: tuple[tuple[TrueStreak, float | None, float | None], ...]
    """Every true streak with the score of its candidate and the midpoint's error in pixels."""
    false_scores: tuple[float, ...]


def turn_deg(one: float, other: float) -> float:
    """Between two axes, 0 to 90."""
    return abs((one - other + 90.0) % 180.0 - 90.0)


def miss_px(candidate: Line, true: Line) -> float:
    """From midpoint to midpoint."""
    (x, y), (u, v) = candidate.middle_px, true.middle_px
    return float(np.hypot(x - u, y - v))


def is_found(candidate: Line, true: Line) -> bool:
    """Midpoint within max(10 px, 0.3 lengths) and axis within 15 deg."""
    within_px = max(NEAREST_PX, NEAREST_LENGTHS * true.length_px)
    is_near = miss_px(candidate, true) <= within_px
    return is_near and turn_deg(candidate.angle_deg, true.angle_deg) <= AXIS_DEG


def touches(candidate: Line, true: Line) -> bool:
    """Whether the candidate's midpoint lies on the streak: misplaced or a second, no invention."""
    angle = np.radians(true.angle_deg)
    (x, y), (u, v) = candidate.middle_px, true.middle_px
    along = abs((x - u) * np.cos(angle) + (y - v) * np.sin(angle))
    across = abs((y - v) * np.cos(angle) - (x - u) * np.sin(angle))
    return bool(across <= NEAREST_PX and along <= true.length_px / 2 + NEAREST_PX)


def judge(
    candidates: Sequence[Candidate], truth: Sequence[TrueStreak], beside: Sequence[Line] = ()
) -> Judged:
    """Match by falling score, each streak once.

    What merely touches a streak, or one of the trails ``beside``, counts neither way.
    """
    lines = [*(each.line for each in truth), *beside]
    free = list(truth)
    taken: dict[int, tuple[float, float]] = {}
    false_scores: list[float] = []
    for candidate in sorted(candidates, key=lambda c: -c.score):
        fitting = [t for t in free if is_found(candidate.line, t.line)]
        if fitting:
            best = min(fitting, key=lambda t: miss_px(candidate.line, t.line))
            free.remove(best)
            taken[id(best)] = candidate.score, miss_px(candidate.line, best.line)
        elif not any(touches(candidate.line, line) for line in lines):
            false_scores.append(candidate.score)
    return Judged(
        found=tuple((t, *taken.get(id(t), (None, None))) for t in truth),
        false_scores=tuple(false_scores),
    )


def average_precision(true_scores: FloatArray, false_scores: FloatArray, asked: int) -> float:
    """Area under precision over recall, precision made monotonic; nan where nothing is asked.

    ``true_scores``: of the streaks found. Candidates of one score come together, in no order.
    Source: Everingham et al. 2010, with every point instead of eleven.
    """
    if asked == 0:
        return float("nan")
    marked = [(float(s), True) for s in true_scores] + [(float(s), False) for s in false_scores]
    marked.sort(key=lambda m: -m[0])
    right = wrong = 0
    recall, precision = [0.0], [1.0]
    for _, tied in groupby(marked, key=lambda m: m[0]):
        for _, is_true in tied:
            right, wrong = right + is_true, wrong + (not is_true)
        recall.append(right / asked)
        precision.append(right / (right + wrong))
    precision[0] = precision[1] if len(precision) > 1 else 0.0
    falling = np.maximum.accumulate(np.array(precision)[::-1])[::-1]
    return float(np.sum(np.diff(recall) * falling[1:]))


def threshold_at(false_scores: Sequence[float] | FloatArray, most_false: int) -> float:
    """The lowest that only ``most_false`` of these false candidates lie above."""
    ordered = np.sort(np.asarray(false_scores, dtype=np.float64))[::-1]
    return float(ordered[most_false]) if most_false < len(ordered) else -np.inf


def recall_at(
    true_scores: FloatArray, false_scores: FloatArray, asked: int, most_false: int
) -> float:
    """Share of the asked streaks above the lowest threshold that lets ``most_false`` through."""
    if asked == 0:
        return float("nan")
    above = threshold_at(false_scores, most_false)
    return float(np.count_nonzero(true_scores > above)) / asked


def summary(
    judged: Sequence[Judged], bins: Sequence[tuple[float, float]], false_per_frame: Sequence[float]
) -> dict[str, dict[str, float]]:
    """Figures of all streaks ("all") and of every range of SNR ("1.5-2"...).

    False candidates count against every range alike; streaks of the other ranges count neither
    way. ``centroid_px``: median midpoint error of those found.
    """
    false_scores = np.array([s for j in judged for s in j.false_scores], dtype=np.float64)
    report: dict[str, dict[str, float]] = {}
    for low, high in [(0.0, np.inf), *bins]:
        is_all = (low, high) == (0.0, np.inf)
        rows = [row for j in judged for row in j.found if is_all or low <= row[0].snr < high]
        scores = np.array([score for _, score, _ in rows if score is not None], dtype=np.float64)
        errors = [error for _, _, error in rows if error is not None]
        name = "all" if is_all else f"{low:g}-{high:g}"
        figures = {
            "asked": float(len(rows)),
            "average_precision": average_precision(scores, false_scores, len(rows)),
            "recall": len(scores) / len(rows) if rows else float("nan"),
            "centroid_px": float(np.median(errors)) if errors else float("nan"),
        }
        for rate in false_per_frame:
            most_false = int(rate * len(judged) + 1e-9)
            figures[f"recall_at_{rate:g}"] = recall_at(scores, false_scores, len(rows), most_false)
        report[name] = figures
    report["all"]["frames"] = float(len(judged))
    report["all"]["false_per_frame"] = len(false_scores) / max(len(judged), 1)
    return report
