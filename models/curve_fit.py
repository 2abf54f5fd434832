"""A logistic curve through candidates of known truth, and what prevalence makes of it.

Two steps. First the weights: which candidates are likelier than which, from all rows alike, so that
aircraft and the like count in full. Then slope and constant: how likely, with every row weighed as
often as it comes in the stated population of frames. The population's one free number, how many
frames hold a satellite, is lowered until tau keeps the false alarms that are allowed. Each way in
which a frame shows its stars has weights, slope and constant of its own.
"""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize

from models.frames import HARD, Kind
from models.judging import CandidateRow, FrameRow, features_of
from models.scoring import logit_for_rate
from rsoconsole.vision import FEATURE_NAMES, FEATURES, IMAGE_KINDS

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

TAU = 0.10
SHARES: Mapping[str, float] = {
    "clear": 0.82,
    "clouds": 0.10,
    "altered": 0.05,
    "aircraft": 0.01,
    "jitter": 0.01,
    "rays": 0.01,
}
"""Shares of the kinds in all frames, the stated population."""
FRAMES_PER_SATELLITE = (2, 3, 5, 10, 20, 30, 50, 100, 200, 300, 400, 500, 1000)
"""Clear or cloudy frames for each that holds one to three satellites: the numbers to try."""
ALTERED_PER_SATELLITE = 4
"""Altered frames of which one holds a satellite: who looks for one through wind or out of focus
knows that it is there, and twenty times as many false ones are allowed as in ordinary frames."""
FALSE_PER_ORDINARY, FALSE_PER_HARD = 0.5 / 1000.0, 1.3 / 100.0
"""Expected above tau: well below what is promised, since the rows of the fit predict it."""
ORDINARY: tuple[Kind, ...] = ("empty", "satellites")
HARD_COUNTS = 0.3
"""Weight of a false candidate of a hard frame in the fit of the weights: there are dozens each."""
_AT_TAU = math.log(TAU / (1.0 - TAU))
_FOR = ("network", "log_snr", "steady", "extent", "one_line", "like_line")
_EITHER = ("constant", "blurred", "drifted")
_CONSTANTS = [FEATURES.index(f"{way}constant") for way in IMAGE_KINDS]
_MIN_TRUE = 12
"""Least number of satellites in frames that show stars in one way: fewer give no weights."""
_RIDGE, _HELD = 0.1, 1e-7


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Candidates:
    """The candidates of many frames; one entry each."""

    features: FloatArray
    """Features of the candidates, (n, features)."""
    is_true: BoolArray
    kind: tuple[Kind, ...]
    frame: npt.NDArray[np.int64]
    """Index of the frame among the rows."""
    frames: Mapping[Kind, int]
    """Number of frames of each kind that were looked at."""

    def only(self, chosen: BoolArray, frames: Mapping[Kind, int]) -> "Candidates":
        """Subset of the candidates, and the number of frames that they are from."""
        return Candidates(
            features=self.features[chosen],
            is_true=self.is_true[chosen],
            kind=tuple(k for k, c in zip(self.kind, chosen, strict=True) if c),
            frame=self.frame[chosen],
            frames=frames,
        )

    def of_kind(self, *kinds: Kind) -> BoolArray:
        """Mask of the candidates from frames of these kinds."""
        return np.array([kind in kinds for kind in self.kind], dtype=bool)


def gathered(rows: Sequence[FrameRow]) -> Candidates:
    """All candidates that a confidence counts for: those not refused after it.

    A steady light of an aircraft that the frame cuts at both ends counts neither way: it is a trail
    of the sky, starts no track, and its class says what it is.
    """
    features, is_true, kinds, frames = [], [], [], []
    for number, row in enumerate(rows):
        for each, seen in zip(row["candidates"], features_of(row), strict=True):
            if counts(row, each):
                features.append(seen)
                is_true.append(each["trail"] is not None)
                kinds.append(row["kind"])
                frames.append(number)
    return Candidates(
        features=np.array(features, dtype=np.float64).reshape(-1, len(FEATURES)),
        is_true=np.array(is_true, dtype=bool),
        kind=tuple(kinds),
        frame=np.array(frames, dtype=np.int64),
        frames=Counter(row["kind"] for row in rows),
    )


def counts(row: FrameRow, candidate: CandidateRow) -> bool:
    """True where confidence is fitted and judged on a candidate."""
    is_light = row["kind"] == "aircraft" and candidate["measured"].get("kind") == "crossing"
    return candidate["is_taken"] and not is_light


def population_weights(them: Candidates, frames_per_satellite: float) -> FloatArray:
    """Number of each row in one frame of the population, (n,)."""
    frames = them.frames
    clear = max(frames.get("empty", 0) + frames.get("satellites", 0), 1)
    weights = np.zeros(len(them.is_true))
    for index, (kind, is_true) in enumerate(zip(them.kind, them.is_true, strict=True)):
        share = SHARES["clear" if kind in ORDINARY else kind]
        if is_true:
            per_satellite = min(
                frames_per_satellite, ALTERED_PER_SATELLITE if kind == "altered" else math.inf
            )
            weights[index] = share / frames[kind] / per_satellite
        else:
            weights[index] = share / (clear if kind in ORDINARY else frames[kind])
    return weights


def fit_weights(
    features: FloatArray, is_true: BoolArray, counts: FloatArray | None = None
) -> FloatArray:
    """Weights by maximum likelihood, a little held back to zero, each of the sign it must have.

    ``counts``: how much each row counts; alike by default.
    """
    times = np.ones(len(is_true)) if counts is None else counts
    sign = np.where(is_true, 1.0, -1.0)
    held = np.ones(len(FEATURES))
    held[_CONSTANTS] = 0.0

    def cost(weights: FloatArray) -> tuple[float, FloatArray]:
        margin = sign * (features @ weights)
        loss = times @ np.logaddexp(0.0, -margin) + _RIDGE * (held @ weights**2)
        gradient = -(features * (times * sign / (1.0 + np.exp(margin)))[:, None]).sum(axis=0)
        gradient += 2.0 * _RIDGE * held * weights
        return float(loss), gradient

    bounds = [_bounds(name.rpartition(" ")[2]) for name in FEATURES]
    start = np.zeros(features.shape[1])
    return np.asarray(minimize(cost, start, jac=True, bounds=bounds, method="L-BFGS-B").x)


def _bounds(name: str) -> tuple[float | None, float | None]:
    """Bounds of a weight by the sign that it may have."""
    return (0.0, None) if name in _FOR else (None, None) if name in _EITHER else (None, 0.0)


def fit_scale(z: FloatArray, is_true: BoolArray, weights: FloatArray) -> tuple[float, float]:
    """Slope (at least 0) and constant of the logistic curve through weighed rows (Platt 1999)."""
    sign, total = np.where(is_true, 1.0, -1.0), max(float(weights.sum()), 1e-12)

    def cost(line: FloatArray) -> tuple[float, FloatArray]:
        margin = sign * (line[0] * z + line[1])
        pull = weights * sign / (1.0 + np.exp(np.clip(margin, -500.0, 500.0))) / total
        loss = float((weights * np.logaddexp(0.0, -margin)).sum() / total)
        held = _HELD * (line[0] - 1.0)
        return loss + 0.5 * _HELD * (line[0] - 1.0) ** 2, np.array(
            [-(pull * z).sum() + held, -pull.sum()]
        )

    bounds = [(0.0, None), (None, None)]
    best = minimize(cost, np.array([1.0, 0.0]), jac=True, bounds=bounds, method="L-BFGS-B").x
    return float(best[0]), float(best[1])


def lowest_for(them: Candidates, z: FloatArray, kinds: Sequence[Kind], per_frame: float) -> float:
    """z above which this number of false candidates is expected in a frame of these kinds."""
    frames = sum(them.frames.get(kind, 0) for kind in kinds)
    false_z = z[~them.is_true & them.of_kind(*kinds)]
    if not frames:
        return -math.inf
    # The tail alone, since the bulk would predict too many.
    tail = int(np.clip(len(false_z) // 5, 5, 20))
    return logit_for_rate(false_z, per_frame * frames, tail)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FittedCurve:
    """Weights of the logistic curve, and the population in which its answers are probabilities."""

    weights: FloatArray
    frames_per_satellite: int
    keeps_ordinary: bool
    keeps_hard: bool
    """False: more false ones than allowed are expected above tau."""

    def confidence(self, features: FloatArray) -> FloatArray:
        """Probability of each row of features, (n,)."""
        return np.asarray(1.0 / (1.0 + np.exp(-np.clip(features @ self.weights, -30.0, 30.0))))


def fit_curve(them: Candidates, frames_per_satellite: int | None = None) -> FittedCurve:
    """The curve in a population with this prevalence, or with the highest that serves.

    That is the first one at which tau keeps ordinary and hard frames alike, or else the ordinary
    ones; where none does, the lowest.
    """
    is_easy = them.is_true | ~them.of_kind(*HARD)
    weights = fit_weights(them.features, them.is_true, np.where(is_easy, 1.0, HARD_COUNTS))
    per_satellite = (
        FRAMES_PER_SATELLITE if frames_per_satellite is None else (frames_per_satellite,)
    )
    curves = []
    for frames in per_satellite:
        scaled = _scaled(them, weights, population_weights(them, frames))
        z = them.features @ scaled
        curves.append(
            FittedCurve(
                weights=scaled,
                frames_per_satellite=frames,
                keeps_ordinary=lowest_for(them, z, ORDINARY, FALSE_PER_ORDINARY) <= _AT_TAU,
                keeps_hard=lowest_for(them, z, HARD, FALSE_PER_HARD) <= _AT_TAU,
            )
        )
    best = max(curves, key=lambda curve: (curve.keeps_ordinary, curve.keeps_hard))
    return best if best.keeps_ordinary else curves[-1]


def _scaled(them: Candidates, weights: FloatArray, population: FloatArray) -> FloatArray:
    """Weights that say how likely, each way of showing stars by itself."""
    scaled, z, count = weights.copy(), them.features @ weights, len(FEATURE_NAMES)
    for first in _CONSTANTS:
        chosen = them.features[:, first] > 0.0
        own = slice(first, first + count)
        if np.count_nonzero(chosen & them.is_true) < _MIN_TRUE:
            scaled[own] = scaled[:count]
            continue
        slope, constant = fit_scale(z[chosen], them.is_true[chosen], population[chosen])
        scaled[own] = slope * weights[own]
        scaled[first] += constant
    return scaled


def out_of_fold(rows: Sequence[FrameRow], frames_per_satellite: int, folds: int = 5) -> FloatArray:
    """Confidence of every candidate by a curve fitted on other frames than its own, (n,)."""
    them = gathered(rows)
    confidence = np.zeros(len(them.is_true))
    for fold in range(folds):
        is_left_out = them.frame % folds == fold
        kept = [row["kind"] for number, row in enumerate(rows) if number % folds != fold]
        curve = fit_curve(them.only(~is_left_out, Counter(kept)), frames_per_satellite)
        confidence[is_left_out] = curve.confidence(them.features[is_left_out])
    return confidence


def reliability(
    confidence: FloatArray, is_true: BoolArray, weights: FloatArray, bins: int = 10
) -> list[dict[str, Any]]:
    """Rows by bins of confidence: number, mean confidence and share of true ones, both weighed."""
    table = []
    inner = np.minimum((confidence * bins).astype(int), bins - 1)
    for index in range(bins):
        inside = inner == index
        if inside.any():
            weight = weights[inside]
            table.append(
                {
                    "from": index / bins,
                    "to": (index + 1) / bins,
                    "candidates": int(inside.sum()),
                    "true": int(is_true[inside].sum()),
                    "said": round(float(np.average(confidence[inside], weights=weight)), 4),
                    "share": round(float(np.average(is_true[inside], weights=weight)), 4),
                }
            )
    return table
