"""Estimation of linear unknowns together with the variances of several kinds of errors. Pure.

Restricted maximum likelihood (Patterson & Thompson 1971) by Fisher's scoring. Errors are correlated
within blocks alone, so that thousands of measurements cost little.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rsoconsole.records import FloatArray

_STEPS = 40
_CLOSE = 1e-4
_MIN_BLOCKS = 8
_FACTOR = 5.0
"""Factor by which a variance may change in a step."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Block:
    """Block of N measurements with correlated errors."""

    z: FloatArray
    """Measurements (N,)"""
    x: FloatArray
    """Slopes (N, unknowns) of the measurements by the unknowns."""
    parts: Mapping[int, FloatArray]
    """Contributions (N, N) to their covariance, by number of a variance; a missing one is zero."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PriorKnowledge:
    """Prior knowledge of the unknowns and of the variances.

    The unknowns have a prior with mean 0 and ``precisions``. Each variance has a starting value
    (``start``), a lower bound (``least``), and a Gaussian prior (``means``, ``sigmas``; an infinite
    sigma: no prior).
    """

    precisions: FloatArray
    start: FloatArray
    least: FloatArray
    means: FloatArray
    sigmas: FloatArray
    is_widened: FloatArray
    """Mask, 1 where errors count one sigma more of a variance that few measurements determine."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VarianceFit:
    """Most likely unknowns and variances, found together."""

    unknowns: FloatArray
    covariance: FloatArray
    variances: FloatArray
    variance_sigmas: FloatArray
    covariance_by_blocks: FloatArray | None
    """Covariance by how the blocks differ (jackknife: Efron 1982); None where they are too few."""


def fit_variances(blocks: Sequence[Block], known: PriorKnowledge) -> VarianceFit:
    """Find the most likely unknowns and variances together."""
    belief = known.sigmas**-2.0
    variances = known.start
    for _ in range(_STEPS):
        _, _, score, information = _scored(blocks, variances, known.precisions)
        score = score - (variances - known.means) * belief
        step = np.linalg.solve(information + np.diag(belief), score)
        low = np.maximum(known.least, variances / _FACTOR)
        after = np.clip(variances + step, low, variances * _FACTOR)
        is_close = np.all(np.abs(after - variances) <= _CLOSE * variances + 1e-12)
        variances = after
        if is_close:
            break
    unknowns, _, _, information = _scored(blocks, variances, known.precisions)
    sigmas = np.sqrt(np.diag(np.linalg.inv(information + np.diag(belief))))
    wide = variances + known.is_widened * sigmas
    _, covariance, _, _ = _scored(blocks, wide, known.precisions)
    return VarianceFit(
        unknowns=unknowns,
        covariance=covariance,
        variances=variances,
        variance_sigmas=sigmas,
        covariance_by_blocks=_by_blocks(blocks, wide, known.precisions),
    )


def _by_blocks(
    blocks: Sequence[Block], variances: FloatArray, prior: FloatArray
) -> FloatArray | None:
    """Covariance of the unknowns by leaving out each block in turn."""
    if len(blocks) < _MIN_BLOCKS:
        return None
    normals, rights = [], []
    for block in blocks:
        inverse = np.linalg.inv(sum(variances[j] * part for j, part in block.parts.items()))
        normals.append(block.x.T @ inverse @ block.x)
        rights.append(block.x.T @ inverse @ block.z)
    normal, right = np.diag(prior) + sum(normals), sum(rights)
    without = np.array(
        [np.linalg.solve(normal - n, right - r) for n, r in zip(normals, rights, strict=True)]
    )
    off = without - without.mean(axis=0)
    return np.asarray((len(blocks) - 1) / len(blocks) * (off.T @ off))


def _scored(
    blocks: Sequence[Block], variances: FloatArray, prior: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Unknowns and their covariance; score and information of the variances."""
    normal, right = np.diag(prior), np.zeros(len(prior))
    inverses = []
    for block in blocks:
        inverse = np.linalg.inv(sum(variances[j] * part for j, part in block.parts.items()))
        inverses.append(inverse)
        normal = normal + block.x.T @ inverse @ block.x
        right = right + block.x.T @ inverse @ block.z
    covariance = np.linalg.inv(normal)
    unknowns = covariance @ right
    count = len(variances)
    score, information = np.zeros(count), np.zeros((count, count))
    for block, inverse in zip(blocks, inverses, strict=True):
        left = inverse @ (block.z - block.x @ unknowns)
        through = inverse @ block.x
        turned = {j: inverse @ part for j, part in block.parts.items()}
        for j, part in block.parts.items():
            lost = np.sum(covariance * (through.T @ part @ through))
            score[j] += 0.5 * (left @ part @ left - np.trace(turned[j]) + lost)
            for k, other in turned.items():
                information[j, k] += 0.5 * np.sum(turned[j] * other.T)
    # A variance without measurements has neither.
    information += np.diag(np.where(np.diag(information) == 0.0, 1.0, 0.0))
    return np.asarray(unknowns), np.asarray(covariance), score, information
