"""What many Kalman filters make of one measurement, and two such answers as one. Pure.

Source: Bar-Shalom, Li & Kirubarajan 2001, 5.2 (the update, in Joseph's form) and 1.4.16 (the
moments of a mixture).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rsoconsole.records import FloatArray

_LEAST_SHARE = 1e-14
"""Of the product of both variances, that a determinant keeps."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Innovations:
    """How far each of N filters is off a measurement with a given noise, before any takes it."""

    off: FloatArray
    """(N, 2) innovations."""
    noise: FloatArray
    """(N, 2, 2)"""
    s: FloatArray
    """(N, 2, 2) covariance of the innovation."""
    inverse: FloatArray
    """(N, 2, 2) of ``s``."""
    nis: FloatArray
    log_det: FloatArray
    """(N,) logarithm of the determinant of ``s``."""


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
        nis=merged_nis(usual.nis, other.nis, share),
        log_likelihoods=log_likelihoods,
        steps=(1.0 - of_other) * usual.steps + of_other * other.steps,
        covariances=covariances + apart[:, :, None] * apart[:, None, :],
    )


def merged_nis(usual: FloatArray, other: FloatArray, share: float) -> FloatArray:
    """(N,) of two, of which the other is right with probability ``share``."""
    return np.asarray(
        -2.0 * np.logaddexp(math.log(1.0 - share) - 0.5 * usual, math.log(share) - 0.5 * other)
    )


def log_sum(logs: FloatArray) -> float:
    """Logarithm of a sum of exponentials, also where all are small."""
    most = float(logs.max())
    if not math.isfinite(most):
        return -math.inf
    return most + math.log(float(np.exp(logs - most).sum()))


def innovations(
    predicted: FloatArray, off: Sequence[FloatArray], noise: Sequence[FloatArray]
) -> list[Innovations]:
    """Of filters with covariances (N, 6, 6), for each innovation (N, 2) and its noise (N, 2, 2)."""
    every, number = np.concatenate(noise), len(predicted)
    s = every + np.tile(predicted[:, :2, :2], (len(noise), 1, 1))
    inverse, log_det = inverted(s)
    x, y = np.concatenate(off).T
    nis = inverse[:, 0, 0] * x * x + 2.0 * inverse[:, 0, 1] * x * y + inverse[:, 1, 1] * y * y
    parts = [slice(k * number, (k + 1) * number) for k in range(len(noise))]
    return [
        Innovations(
            off=o, noise=each, s=s[at], inverse=inverse[at], nis=nis[at], log_det=log_det[at]
        )
        for o, each, at in zip(off, noise, parts, strict=True)
    ]


def inverted(s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Inverses (..., 2, 2) of covariances and logarithms (...) of their determinants.

    Written out: for two rows a library's decomposition takes five times as long.
    """
    xx, xy, yy = s[..., 0, 0], s[..., 0, 1], s[..., 1, 1]
    # What is sure in one direction and all but unknown in the other has no digits left for it.
    det = np.maximum(xx * yy - xy * xy, _LEAST_SHARE * xx * yy)
    inverse = np.empty_like(s)
    inverse[..., 0, 0], inverse[..., 1, 1] = yy / det, xx / det
    inverse[..., 0, 1] = inverse[..., 1, 0] = -xy / det
    return inverse, np.log(det)


def answer(predicted: FloatArray, found: Innovations) -> Answer:
    """Of the filters with covariances (N, 6, 6) whose innovations those are."""
    gain = predicted[:, :, :2] @ found.inverse
    # Joseph's form keeps it positive; only two columns are measured.
    half = predicted - gain @ predicted[:, :2]
    across = np.swapaxes(gain, -1, -2)
    covariances = half - half[:, :, :2] @ across + gain @ found.noise @ across
    return Answer(
        s=found.s,
        nis=found.nis,
        log_likelihoods=-0.5 * (found.nis + found.log_det) - math.log(2.0 * math.pi),
        steps=(gain @ found.off[:, :, None])[:, :, 0],
        covariances=covariances,
    )
