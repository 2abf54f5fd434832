"""A logistic curve of confidence, fitted to candidates of known truth for a stated population.

First the weights, which rank candidates, are fitted to all rows alike, so that aircraft and similar
trails count in full. Then slope and constant, which turn the rank into a probability, are fitted
with each row weighted by its frequency in the stated population of frames. The population's one
free parameter, the fraction of frames with a satellite, is lowered until no more false candidates
than allowed are expected above tau. Frames in which stars look alike (points, rings, trails) share
weights, slope and constant.
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
"""Fraction of each kind in all frames: the stated population."""
FRAMES_PER_SATELLITE = (2, 3, 5, 10, 20, 30, 50, 100, 200, 300, 400, 500, 1000)
"""Clear or cloudy frames per frame with satellites: the values to try, in order."""
ALTERED_PER_SATELLITE = 4
"""Altered frames per altered frame with a satellite.

Few: an observer who searches in wind or out of focus expects a satellite there, and twenty times
as many false candidates are allowed as in ordinary frames.
"""
FALSE_PER_ORDINARY, FALSE_PER_HARD = 0.5 / 1000.0, 1.3 / 100.0
"""Allowed expectation of false candidates above tau per ordinary frame and per hard frame.

Well below the stated limits, since the expectation comes from the rows of the fit itself.
"""
ORDINARY: tuple[Kind, ...] = ("empty", "satellites")
HARD_COUNTS = 0.3
"""Weight of a false candidate of a hard frame in ``fit_weights``; such a frame has dozens."""
_AT_TAU = math.log(TAU / (1.0 - TAU))
_FOR = ("verifier", "network")
_EITHER = ("constant", "blurred", "drifted")
_CONSTANTS = [FEATURES.index(f"{way}constant") for way in IMAGE_KINDS]
_MIN_TRUE = 12
"""Least number of satellites in frames that show stars in one way: fewer give no weights."""
_RIDGE, _HELD = 0.1, 1e-7


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Candidates:
    """The candidates of many frames, n in all; each array has one entry per candidate."""

    features: FloatArray
    """Features of the candidates, (n, features)."""
    is_true: BoolArray
    kind: tuple[Kind, ...]
    frame: npt.NDArray[np.int64]
    """Index, among the rows, of the frame of each candidate."""
    frames: Mapping[Kind, int]
    """Number of frames of each kind that were analysed."""

    def only(self, chosen: BoolArray, frames: Mapping[Kind, int]) -> "Candidates":
        """The candidates where ``chosen`` (n,) is True, with the number of their frames by kind."""
        return Candidates(
            features=self.features[chosen],
            is_true=self.is_true[chosen],
            kind=tuple(k for k, c in zip(self.kind, chosen, strict=True) if c),
            frame=self.frame[chosen],
            frames=frames,
        )

    def of_kind(self, *kinds: Kind) -> BoolArray:
        """Mask (n,): True for candidates from frames of these kinds."""
        return np.array([kind in kinds for kind in self.kind], dtype=bool)


def gathered(rows: Sequence[FrameRow]) -> Candidates:
    """All candidates of the rows on which confidence is fitted and judged (``counts``).

    Left out are candidates that a later step refuses, and an aircraft's steady light that the frame
    cuts at both ends: a real trail, which starts no track and whose class says what it is.
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
    """True where confidence is fitted and judged on a candidate of this row."""
    is_light = row["kind"] == "aircraft" and candidate["measured"].get("kind") == "crossing"
    return candidate["is_taken"] and not is_light


def population_weights(them: Candidates, frames_per_satellite: float) -> FloatArray:
    """Expected number of each candidate in one frame of the population, (n,): its weight."""
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
    """Weights of the features by maximum likelihood with a slight ridge penalty.

    ``counts``: weight of each row in the likelihood; None: all equal. Features with a known sense
    have weights of that sign alone.
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
    """Slope (at least 0) and constant of the logistic curve through weighted rows (Platt 1999).

    ``z``: (n,) the sum of features times weights.
    """
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
    """Value of z above which ``per_frame`` false candidates are expected in a frame of these kinds.

    ``z``: (n,) the sum of features times weights of each candidate.
    """
    frames = sum(them.frames.get(kind, 0) for kind in kinds)
    false_z = z[~them.is_true & them.of_kind(*kinds)]
    if not frames:
        return -math.inf
    # The tail alone, since the bulk would predict too many.
    tail = int(np.clip(len(false_z) // 5, 5, 20))
    return logit_for_rate(false_z, per_frame * frames, tail)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FittedCurve:
    """Weights of the logistic curve, and the population in which its values are probabilities."""

    weights: FloatArray
    frames_per_satellite: int
    keeps_ordinary: bool
    keeps_hard: bool
    """False: more false candidates than allowed are expected above tau in hard frames.

    ``keeps_ordinary``: the same for ordinary frames.
    """

    def confidence(self, features: FloatArray) -> FloatArray:
        """Probability (n,) for rows of features (n, features)."""
        return np.asarray(1.0 / (1.0 + np.exp(-np.clip(features @ self.weights, -30.0, 30.0))))


def fit_curve(them: Candidates, frames_per_satellite: int | None = None) -> FittedCurve:
    """The curve in a population with one frame with satellites in ``frames_per_satellite``.

    None: the highest prevalence at which the false candidates expected above tau stay within the
    allowance of ordinary and hard frames, or of ordinary frames alone; else the lowest prevalence.
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
    """Confidence (n,) of every candidate by a curve fitted without the candidate's frame."""
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
    """Table of reliability by bins of confidence.

    Each bin: number of candidates, weighted mean confidence, weighted fraction of true ones.
    """
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
