"""Likelihood of tracks being objects whose elements have errors in common. Pure.

Satellites of one slot are kept there by one operator, and have elements of one epoch from one
network: much of the error of their elements is common to all and leaves relative places correct.
How much is common is not published, so three cases are weighted by how well they fit the offsets:

- no error is common;
- most of the errors of undisturbed elements are common;
- the errors by manoeuvres are common.

The common error, six numbers in the frame of the orbit (``element_errors.covariance_rtn``), is
integrated out about its most probable value.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rsoconsole.orbits.identification._assignments import Assignment
from rsoconsole.orbits.identification._catalogue_residuals import CatalogueResiduals
from rsoconsole.orbits.identification.element_errors import (
    covariance_rtn,
    manoeuvred_probability,
    orbit_regime,
)
from rsoconsole.records import FloatArray
from rsoconsole.words import NS_PER_DAY

_ROUNDS = 5
_LEAST = 1e-300


@dataclass(frozen=True, slots=True, kw_only=True)
class ErrorCase:
    """One assumption of how much of the elements' errors is common to all objects.

    All but the probability are factors on the variances of ``element_errors``.
    """

    probability: float
    shared_undisturbed: float = 0.0
    shared_moved: float = 0.0
    own_undisturbed: float = 1.0
    own_moved: float = 1.0


CASES = (
    ErrorCase(probability=0.5),
    ErrorCase(probability=0.25, shared_undisturbed=0.75, own_undisturbed=0.25),
    ErrorCase(probability=0.25, shared_moved=1.0, own_undisturbed=0.25, own_moved=0.5),
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ObjectPair:
    """One track compared with one catalogued object; D as in ``CatalogueResiduals``."""

    offset: FloatArray
    """Offset (D,) of the track, measured minus predicted."""
    measured: FloatArray
    """Covariance (D, D) of the measured offset."""
    slopes: FloatArray
    """Slopes (D, 6) of the offset by the errors of the elements."""
    undisturbed: FloatArray
    """Covariance (6, 6) of the elements' errors if the object was not moved."""
    moved: FloatArray
    moved_probability: float


def make_pair(found: CatalogueResiduals, n: int, t_utc_ns: int) -> ObjectPair:
    """Return the pair of a track and the ``n``-th object in its comparison with the catalogue.

    ``t_utc_ns``: instant of the track, which gives the age of the elements.
    """
    entry = found.entries[n]
    regime = orbit_regime(entry.revolutions_a_day, entry.eccentricity)
    age_days = (t_utc_ns - entry.epoch_utc_ns) / NS_PER_DAY
    motion = float(found.mean_motion_rad_s[n])
    kept, moved = (found.errors.spread_for(regime, is_moved=each) for each in (False, True))
    return ObjectPair(
        offset=found.offsets[n],
        measured=found.covariance[n],
        slopes=found.by_errors[n],
        undisturbed=covariance_rtn(kept, age_days, motion),
        moved=covariance_rtn(moved, age_days, motion),
        moved_probability=manoeuvred_probability(regime, age_days),
    )


class SharedErrorModel:
    """Densities of the pairs of T tracks and N objects under one assumption of common errors.

    ``pairs[t][n]``: None where the track cannot be the object. ``unknown`` (T,): logarithm of the
    density of objects that no catalogue knows.
    """

    def __init__(
        self, case: ErrorCase, pairs: Sequence[Sequence[ObjectPair | None]], unknown: FloatArray
    ) -> None:
        self._unknown = unknown
        self._log_probability = float(np.log(case.probability))
        rows, columns = len(pairs), len(pairs[0])
        known = [each for row in pairs for each in row if each is not None]
        root = _root(case, known)
        self._is_shared = bool(np.any(root))
        # ln N(offset; J root z, C) = level + pull z - z stiffness z / 2
        shape = (rows, columns + 1, 2)
        self._level = np.full(shape, -np.inf)
        self._pull = np.zeros((*shape, 6))
        self._stiffness = np.zeros((*shape, 6, 6))
        for t, row in enumerate(pairs):
            self._level[t, columns, 0] = unknown[t]
            for n, pair in enumerate(row):
                if pair is not None:
                    self._put(t, n, pair, case, root)

    def _put(self, t: int, n: int, pair: ObjectPair, case: ErrorCase, root: FloatArray) -> None:
        share = pair.moved_probability
        parts = (
            (np.log1p(-share), case.own_undisturbed * pair.undisturbed),
            (np.log(max(share, _LEAST)), case.own_moved * pair.moved),
        )
        slopes = pair.slopes @ root
        for k, (log_share, own) in enumerate(parts):
            covariance = pair.measured + pair.slopes @ own @ pair.slopes.T
            inverse = np.linalg.inv(covariance)
            size = float(np.linalg.slogdet(2.0 * np.pi * covariance)[1]) / 2.0
            self._level[t, n, k] = log_share - pair.offset @ inverse @ pair.offset / 2.0 - size
            self._pull[t, n, k] = slopes.T @ inverse @ pair.offset
            self._stiffness[t, n, k] = slopes.T @ inverse @ slopes

    def log_densities(self, common: FloatArray) -> FloatArray:
        """Return the log densities (T, N + 1) of the pairs, given a common error (6,) in sigmas.

        The last column is for objects that no catalogue knows.
        """
        parts = self._level + self._pull @ common
        parts = parts - np.einsum("...ij,i,j->...", self._stiffness, common, common) / 2.0
        return np.asarray(np.logaddexp(parts[..., 0], parts[..., 1]))

    def trial_common_errors(self, tracks: Sequence[int]) -> list[FloatArray]:
        """Return common errors (6,), in sigmas, from which to start a search.

        They are zero and, where errors are common, the most probable errors of single pairs of
        these tracks.
        """
        found = [np.zeros(6)]
        if not self._is_shared:
            return found
        for t in tracks:
            for n in np.flatnonzero(np.isfinite(self._level[t, :-1, 0])):
                found.append(_settled(self._pull[t, n, 0], self._stiffness[t, n, 0]))
        return found

    def log_evidence(self, assignments: Sequence[Assignment]) -> tuple[FloatArray, FloatArray]:
        """Return the log evidence (K,) of assignments and their best common errors (K, 6).

        The evidence is integrated over the common error, about that value.
        """
        chosen = np.array(assignments)
        rows = np.arange(chosen.shape[1])
        level, pull = self._level[rows, chosen], self._pull[rows, chosen]
        stiffness = self._stiffness[rows, chosen]
        # From the narrow errors alone and from both: a mixture may have two summits.
        narrow = np.zeros(level.shape)
        narrow[..., 0] = 1.0
        ends = [
            _summit(level, pull, stiffness, start)
            for start in (narrow, _shares(level, pull, stiffness, np.zeros((len(chosen), 6))))
        ]
        heights = np.stack([height for height, _ in ends])
        places = np.stack([place for _, place in ends])
        best = np.argmax(heights, axis=0)
        at = np.arange(len(chosen))
        return heights[best, at] + self._log_probability, places[best, at]


def _root(case: ErrorCase, known: Sequence[ObjectPair]) -> FloatArray:
    """Root (6, 6) of the common error's covariance: by the middlemost of the objects."""
    if not known or case.shared_undisturbed + case.shared_moved == 0.0:
        return np.zeros((6, 6))
    middle = sorted(known, key=lambda each: float(each.undisturbed[1, 1]))[len(known) // 2]
    shared = case.shared_undisturbed * middle.undisturbed + case.shared_moved * middle.moved
    return np.asarray(np.linalg.cholesky(shared))


def _settled(pull: FloatArray, stiffness: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.solve(np.eye(6) + stiffness, pull[..., None])[..., 0])


def _densities(
    level: FloatArray, pull: FloatArray, stiffness: FloatArray, common: FloatArray
) -> FloatArray:
    """Logarithms (K, T, 2) of the densities of the offsets."""
    linear = np.einsum("ktci,ki->ktc", pull, common)
    return np.asarray(
        level + linear - np.einsum("ktcij,ki,kj->ktc", stiffness, common, common) / 2.0
    )


def _shares(
    level: FloatArray, pull: FloatArray, stiffness: FloatArray, common: FloatArray
) -> FloatArray:
    """Probabilities (K, T, 2) that an offset is of the one or the other error."""
    parts = _densities(level, pull, stiffness, common)
    total = np.logaddexp(parts[..., 0], parts[..., 1])
    return np.asarray(np.exp(parts - total[..., None]))


def _summit(
    level: FloatArray, pull: FloatArray, stiffness: FloatArray, shares: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Logarithms (K,) of the integrals by Laplace's method, and the maxima (K, 6)."""
    for _ in range(_ROUNDS):
        whole = np.einsum("ktc,ktcij->kij", shares, stiffness)
        common = _settled(np.einsum("ktc,ktci->ki", shares, pull), whole)
        shares = _shares(level, pull, stiffness, common)
    parts = _densities(level, pull, stiffness, common)
    height = np.sum(np.logaddexp(parts[..., 0], parts[..., 1]), axis=1)
    height = height - np.sum(common**2, axis=1) / 2.0
    return height - np.linalg.slogdet(np.eye(6) + whole)[1] / 2.0, common
