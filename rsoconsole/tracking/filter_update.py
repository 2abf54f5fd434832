"""What many Kalman filters make of one measurement, and two such answers as one. Pure.

Source: Bar-Shalom, Li & Kirubarajan 2001, 5.2 (the update, in Joseph's form) and 1.4.16 (the
moments of a mixture).
"""

import math
from dataclasses import dataclass

import numpy as np

from rsoconsole.records import FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Answer:
    """What each filter makes of a measurement with a given noise."""

    s: FloatArray
    """(N, 2, 2) covariance of the innovation."""
    nis: FloatArray
    log_likelihoods: FloatArray
    steps: FloatArray
    """(N, 6) by which the mean moves."""
    covariances: FloatArray


def merged(usual: Answer, other: Answer, share: float) -> Answer:
    """Two answers as one, of which the other is right with probability ``share``."""
    log_usual = math.log(1.0 - share) + usual.log_likelihoods
    log_other = math.log(share) + other.log_likelihoods
    log_likelihoods = np.logaddexp(log_usual, log_other)
    of_other = np.exp(log_other - log_likelihoods)[:, None]
    apart = np.sqrt(of_other * (1.0 - of_other)) * (usual.steps - other.steps)
    each = of_other[:, :, None]
    covariances = (1.0 - each) * usual.covariances + each * other.covariances
    return Answer(
        s=(1.0 - share) * usual.s + share * other.s,
        nis=-2.0
        * np.logaddexp(math.log(1.0 - share) - 0.5 * usual.nis, math.log(share) - 0.5 * other.nis),
        log_likelihoods=log_likelihoods,
        steps=(1.0 - of_other) * usual.steps + of_other * other.steps,
        covariances=covariances + apart[:, :, None] * apart[:, None, :],
    )


def log_sum(logs: FloatArray) -> float:
    """Logarithm of a sum of exponentials, also where all are small."""
    most = float(logs.max())
    if not math.isfinite(most):
        return -math.inf
    return most + math.log(float(np.exp(logs - most).sum()))


def answer(predicted: FloatArray, off: FloatArray, noise: FloatArray) -> Answer:
    """Of filters with covariances (N, 6, 6) to innovations (N, 2) with noise (N, 2, 2)."""
    s = predicted[:, :2, :2] + noise
    inverse = np.linalg.inv(s)
    nis = np.einsum("ni,nij,nj->n", off, inverse, off)
    gain = predicted[:, :, :2] @ inverse
    # Joseph's form keeps it positive.
    left = np.eye(6) - np.concatenate([gain, np.zeros((len(gain), 6, 4))], axis=2)
    covariances = left @ predicted @ np.swapaxes(left, -1, -2)
    covariances += gain @ noise @ np.swapaxes(gain, -1, -2)
    return Answer(
        s=s,
        nis=nis,
        log_likelihoods=-0.5 * (nis + np.log(np.linalg.det(s))) - math.log(2.0 * math.pi),
        steps=np.einsum("nij,nj->ni", gain, off),
        covariances=covariances,
    )
