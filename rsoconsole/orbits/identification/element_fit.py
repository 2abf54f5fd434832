"""Factors of the assumed errors of elements, fitted to one's own nights. Pure.

Each kind of orbit has three factors (``ErrorFactors``), found by maximum a posteriori. A row is of
an undisturbed object, of a manoeuvred one, or of neither (a wrong identification, a storm), for
which there is a wide tail. The widths for manoeuvred objects and for the tail are assumed, because
an object that was moved far is seldom identified with certainty. For the same reason the share of
manoeuvred objects is lower among the rows than among all objects; it is fitted with the factors.
The prior of a factor is 1, within a factor of 2 (log-normal).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from rsoconsole.orbits.identification.element_errors import (
    ASSUMED,
    ErrorFactors,
    ErrorSpread,
    Regime,
    manoeuvred_probabilities,
    position_sigmas_km,
)
from rsoconsole.orbits.identification.element_rows import ElementErrorRow, rows_by_shared_error
from rsoconsole.records import FloatArray

PRIOR_SIGMA = 0.7
"""Prior sigma of the logarithm of a factor."""
_ALIKE = 0.3
"""Correlation of one object's errors in different nights, by different elements; assumed."""
_MOVED_LOG, _MOVED_LOG_SIGMA = math.log(0.5), 1.0
"""Mean and sigma of ln(share of moved objects in surely named rows / share in all objects)."""
_LEAST = 1e-300
_TAIL = 0.03
_TAIL_TIMES = 2.0
"""Width of the tail over that of a manoeuvre; assumed."""
_MOST = math.log(50.0)
_STARTS = (0.0, 0.8, -0.8)
_STEP = 0.25
"""Step in the logarithms for the finite differences of the curvature."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FittedFactors:
    """Factors fitted to the rows of one kind of orbit, with their sigmas."""

    regime: Regime
    factors: ErrorFactors
    sigmas: ErrorFactors
    rows: int
    objects: int
    counted: float
    """Number of independent rows that all the rows are worth."""
    oldest_days: float
    t_last_utc_ns: int


def fit_factors(rows: Sequence[ElementErrorRow]) -> tuple[FittedFactors, ...]:
    """Fit the factors of each kind of orbit that occurs in the rows."""
    regimes = dict.fromkeys(each.regime for each in rows)
    return tuple(
        _fitted(regime, [each for each in rows if each.regime == regime])
        for regime in sorted(regimes)
    )


def row_weights(rows: Sequence[ElementErrorRow]) -> FloatArray:
    """Weights (N,) of the rows, lower for rows that share an error.

    Rows of one object in one night, or by the same elements, form a group, which counts as one row;
    G groups of one object count as G / (1 + 0.3 (G - 1)), at most 3.3.
    """
    weights = np.zeros(len(rows))
    groups = rows_by_shared_error(rows)
    of_object: dict[int, int] = {}
    for group in groups:
        norad_id = rows[group[0]].norad_id
        of_object[norad_id] = of_object.get(norad_id, 0) + 1
    for group in groups:
        count = of_object[rows[group[0]].norad_id]
        weights[group] = 1.0 / (1.0 + _ALIKE * (count - 1)) / len(group)
    return weights


def _fitted(regime: Regime, rows: Sequence[ElementErrorRow]) -> FittedFactors:
    from scipy.optimize import minimize

    posterior = _Posterior(regime, rows)
    bounds = [(-_MOST, _MOST)] * 3 + [(-_MOST, 0.0)]
    tries = [
        minimize(
            posterior, np.array([start, start, start, _MOVED_LOG]), method="L-BFGS-B", bounds=bounds
        )
        for start in _STARTS
    ]
    best = np.asarray(min(tries, key=lambda each: float(each.fun)).x)
    values = np.exp(best)
    size, axes = np.linalg.eigh(posterior.curvature(best))
    # A factor is nowhere less certain than before any row.
    inverse = (axes / np.maximum(size, PRIOR_SIGMA**-2)) @ axes.T
    sigmas = values * np.sqrt(np.diag(inverse))
    return FittedFactors(
        regime=regime,
        factors=_factors(values),
        sigmas=_factors(sigmas),
        rows=len(rows),
        objects=len({each.norad_id for each in rows}),
        counted=float(posterior.weights.sum()),
        oldest_days=max(abs(each.age_days) for each in rows),
        t_last_utc_ns=max(each.t_utc_ns for each in rows),
    )


def _factors(values: FloatArray) -> ErrorFactors:
    return ErrorFactors(
        along_at_epoch=float(values[0]), along_by_age=float(values[1]), across=float(values[2])
    )


@dataclass(eq=False)
class _Posterior:
    """Posterior: minus its logarithm, by the logarithms of the factors and of the share of the
    moved.
    """

    regime: Regime
    rows: Sequence[ElementErrorRow]
    weights: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        rows = self.rows
        self.weights = row_weights(rows)
        self._age = np.array([abs(each.age_days) for each in rows])
        self._off = np.array([[each.along_km, each.across_km] for each in rows])
        self._by = np.array([[each.along_by, each.across_by] for each in rows])
        measured = np.array([[each.sigma_along_km, each.sigma_across_km] for each in rows])
        self._measured = measured[:, :, None] ** 2 * np.eye(2)
        self._moved = manoeuvred_probabilities(self.regime, self._age)
        assumed = self._covariance(ASSUMED.spread_for(self.regime, is_moved=True))
        squared, log_size = self._distance(_TAIL_TIMES**2 * assumed)
        # Student's distribution of two degrees of freedom, in two dimensions.
        self._log_tail = np.log(_TAIL) - log_size - 2.0 * np.log1p(squared / 2.0)

    def __call__(self, logs: FloatArray) -> float:
        errors = ASSUMED.scaled({self.regime: _factors(np.exp(logs[:3]))})
        moved = self._moved * np.exp(logs[3])
        parts = [self._log_tail]
        for case, share in enumerate((1.0 - moved, moved)):
            spread = errors.spread_for(self.regime, is_moved=case == 1)
            squared, log_size = self._distance(self._covariance(spread))
            log_share = np.log(np.maximum(share, _LEAST)) + np.log1p(-_TAIL)
            parts.append(log_share - log_size - squared / 2.0)
        fit = self.weights @ np.logaddexp.reduce(parts)
        prior = np.sum(logs[:3] ** 2) / PRIOR_SIGMA**2
        prior += ((logs[3] - _MOVED_LOG) / _MOVED_LOG_SIGMA) ** 2
        return float(prior / 2.0 - fit)

    def curvature(self, logs: FloatArray) -> FloatArray:
        """Second derivatives (4, 4)."""
        steps = _STEP * np.eye(4)
        found = np.zeros((4, 4))
        for a in range(4):
            for b in range(a + 1):
                corners = [
                    sa * sb * self(logs + sa * steps[a] + sb * steps[b])
                    for sa in (-1.0, 1.0)
                    for sb in (-1.0, 1.0)
                ]
                found[a, b] = found[b, a] = sum(corners) / (4.0 * _STEP**2)
        return found

    def _covariance(self, spread: ErrorSpread) -> FloatArray:
        """Covariances (N, 2, 2) of along and across: elements and measurement."""
        sigmas = np.stack(position_sigmas_km(spread, self._age), axis=-1)
        return np.asarray(
            self._measured + np.einsum("nik,nk,njk->nij", self._by, sigmas**2, self._by)
        )

    def _distance(self, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Squared Mahalanobis distances (N,), and logarithms of the size of a normal density."""
        along, both, across = covariance[:, 0, 0], covariance[:, 0, 1], covariance[:, 1, 1]
        x, y = self._off.T
        size = along * across - both**2
        squared = (across * x**2 - 2.0 * both * x * y + along * y**2) / size
        return squared, np.log(2.0 * np.pi) + np.log(size) / 2.0
