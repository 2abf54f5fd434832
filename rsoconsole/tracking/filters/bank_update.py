"""Update of a bank of filters with a measurement. Pure.

An innovation costs a fraction of an update, and most pairs of a track and a measurement in a
crowded field need only that. A measurement has three hypotheses: its streak's length indicates the
error rightly; it indicates too large an error; the measurement is wrong (one in a hundred). Each
filter is updated with their mixture. While the noise is held each filter is a plain Kalman filter
with the noise expected of a sound measurement, and only motions are weighed against each other.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rsoconsole.records import FloatArray
from rsoconsole.tracking.filters.bank import (
    MIN_WEIGHT,
    UPDATES_TO_LEARN,
    Bank,
    BankMeasurement,
)
from rsoconsole.tracking.filters.factors import NO_FACTORS, NoiseFactors
from rsoconsole.tracking.filters.filter_grid import VARIANCE_SCALES
from rsoconsole.tracking.filters.motions import ANY_ORBIT, GREAT_CIRCLE, MOTIONS
from rsoconsole.tracking.filters.sky_path import ACCELERATION, TangentPlane, propagate_onto_plane

_MIN_SHARE = 1e-14
"""Least determinant, as a share of the product of both variances."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FilterInnovations:
    """Innovations of N filters for one measurement, under one assumed noise."""

    off: FloatArray
    """(N, 2) innovations, arcsec."""
    noise: FloatArray
    """(N, 2, 2) covariance of the measurement, arcsec^2."""
    s: FloatArray
    """(N, 2, 2) covariance of the innovation."""
    inverse: FloatArray
    """(N, 2, 2) inverse of ``s``."""
    nis: FloatArray
    log_det: FloatArray
    """(N,) logarithm of the determinant of ``s``."""

    @property
    def log_likelihoods(self) -> FloatArray:
        """(N,) logarithms of the measurement's density by each filter."""
        return np.asarray(-0.5 * (self.nis + self.log_det) - math.log(2.0 * math.pi))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FilterUpdates:
    """Updates of N filters with one measurement."""

    log_likelihoods: FloatArray
    steps: FloatArray
    """(N, 6) changes of the means."""
    covariances: FloatArray


def merged_nis(usual: FloatArray, other: FloatArray, share: float) -> FloatArray:
    """Merge the NIS (N,) of two updates; ``other`` is right with probability ``share``."""
    return np.asarray(
        -2.0 * np.logaddexp(math.log(1.0 - share) - 0.5 * usual, math.log(share) - 0.5 * other)
    )


def log_sum_exp(logs: FloatArray) -> float:
    """Return the logarithm of the sum of exp(``logs``), without underflow."""
    most = float(logs.max())
    if not math.isfinite(most):
        return -math.inf
    return most + math.log(float(np.exp(logs - most).sum()))


def filter_innovations(
    predicted: FloatArray, off: Sequence[FloatArray], noise: Sequence[FloatArray]
) -> list[FilterInnovations]:
    """Compute the innovations of N filters for several measurements.

    ``predicted`` (N, 6, 6): covariances of the filters. For each measurement: ``off`` (N, 2), its
    offsets from the filters' means, arcsec, and ``noise`` (N, 2, 2), its covariance.
    """
    every, number = np.concatenate(noise), len(predicted)
    s = every + np.tile(predicted[:, :2, :2], (len(noise), 1, 1))
    inverse, log_det = inverses_and_log_dets(s)
    x, y = np.concatenate(off).T
    nis = inverse[:, 0, 0] * x * x + 2.0 * inverse[:, 0, 1] * x * y + inverse[:, 1, 1] * y * y
    parts = [slice(k * number, (k + 1) * number) for k in range(len(noise))]
    return [
        FilterInnovations(
            off=o, noise=each, s=s[at], inverse=inverse[at], nis=nis[at], log_det=log_det[at]
        )
        for o, each, at in zip(off, noise, parts, strict=True)
    ]


def inverses_and_log_dets(s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return inverses (..., 2, 2) and log determinants (...) of covariances.

    In closed form: for 2 x 2 a library's decomposition takes five times as long.
    """
    xx, xy, yy = s[..., 0, 0], s[..., 0, 1], s[..., 1, 1]
    # What is sure in one direction and all but unknown in the other has no digits left for it.
    det = np.maximum(xx * yy - xy * xy, _MIN_SHARE * xx * yy)
    inverse = np.empty_like(s)
    inverse[..., 0, 0], inverse[..., 1, 1] = yy / det, xx / det
    inverse[..., 0, 1] = inverse[..., 1, 0] = -xy / det
    return inverse, np.log(det)


def filter_updates(
    predicted: FloatArray, alternatives: Sequence[FilterInnovations], shares: Sequence[float]
) -> FilterUpdates:
    """Compute the updates of N filters with covariances (N, 6, 6) from their innovations.

    ``alternatives``: one of them is right, each with the probability in ``shares``; the updates are
    merged over them.
    """

    # Filters last: numpy then works along them.
    def parts(of_each: Sequence[FloatArray]) -> FloatArray:
        return np.ascontiguousarray(np.moveaxis(np.array(of_each), (0, 1), (-2, -1)))

    places = np.ascontiguousarray(predicted[:, :, :2].T)
    gain = np.einsum("ain,abhn->bihn", places, parts([each.inverse for each in alternatives]))
    steps = np.einsum("aihn,ahn->ihn", gain, parts([each.off for each in alternatives]))
    logs = np.array([each.log_likelihoods for each in alternatives]) + np.log(shares)[:, None]
    log_likelihoods = np.logaddexp.reduce(logs, axis=0)
    weights = np.exp(logs - log_likelihoods)
    step = (weights * steps).sum(axis=1)
    apart = (steps - step[:, None])[None]
    # Joseph's form keeps it positive; only two columns are measured.
    short = np.einsum("aihn,abhn->bihn", gain, parts([each.s for each in alternatives]))
    left = weights * np.concatenate([short - places[:, :, None], apart])
    right = np.concatenate([gain, apart])
    spread = _by_filter(left) @ np.swapaxes(_by_filter(right), -1, -2)
    taken = _by_filter((weights * gain).sum(axis=2, keepdims=True)) @ predicted[:, :2]
    return FilterUpdates(
        log_likelihoods=log_likelihoods,
        steps=step.T,
        covariances=predicted - taken + spread,
    )


def _by_filter(parts: FloatArray) -> FloatArray:
    """Rows (N, 6, ...) of parts (k, 6, H, N)."""
    return np.ascontiguousarray(parts.transpose(3, 1, 0, 2)).reshape(parts.shape[-1], 6, -1)


RARE, _RARE_SCATTER_S = 0.01, 0.8
"""Share of measurements that are late or wrong by far more than usual, and their scatter, s."""
_LENGTH_SAYS_TOO_MUCH = 0.15
"""Share of the indicated error that is real where both ends err alike."""
_MAX_LOG_ODDS = 3.0
"""Largest size of the log-odds, so that a night that changes is believed again soon."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BankInnovation:
    """Innovation of a bank for one measurement, the first part of an update."""

    bank: Bank
    place: FloatArray
    """(2,) place of the measurement on the bank's plane, arcsec."""
    with_length: FilterInnovations
    without_length: FilterInnovations | None
    """Innovations if the streak's length indicates too large an error; None: no such hypothesis."""
    rare: FilterInnovations | None
    """Innovations if the measurement has gone wrong; None: the noise is held."""
    nis: float
    """NIS as in ``BankUpdate``."""
    learning: "BankInnovation | None" = None
    """Innovation of the bank from which a young held one takes its noise; None: there is none."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BankUpdate:
    """A bank updated with a measurement, and the mixture's innovation."""

    after: Bank
    nis: float
    """Minus twice the log of the probability that a sound mixture shows more; one filter: NIS."""
    innovation: FloatArray
    """(2,) measured minus the mixture's mean, arcsec."""
    covariance: FloatArray
    """(2, 2) covariance of the mixture's innovation, arcsec^2."""


def bank_innovation(
    bank: Bank, seen: BankMeasurement, factors: NoiseFactors = NO_FACTORS
) -> BankInnovation:
    """Compute the innovation of a measurement at the bank's instant, without the update."""
    return bank_innovations(bank, (seen,), factors)[0]


def bank_innovations(
    bank: Bank, seen: Sequence[BankMeasurement], factors: NoiseFactors = NO_FACTORS
) -> list[BankInnovation]:
    """Compute the innovations of several measurements at the bank's instant."""
    if factors.is_held:
        return _held_innovations(bank, seen, factors)
    places = [bank.plane.project_arcsec(each.ra_icrs_deg, each.dec_icrs_deg) for each in seen]
    off = [place - bank.means[:, :2] for place in places]
    # Where its length says something, also as if it said too much.
    less = {
        n: replace(each, along_arcsec=_LENGTH_SAYS_TOO_MUCH * each.along_arcsec)
        for n, each in enumerate(seen)
        if each.along_arcsec != 0.0
    }
    noise = [_measured_noise(bank, each) for each in (*seen, *less.values())]
    noise += [_rare_noise(bank, each) for each in seen]
    noise = [factors.of_measured(each) for each in noise]
    found = filter_innovations(bank.covariances, [*off, *(off[n] for n in less), *off], noise)
    with_length, rare = found[: len(seen)], found[-len(seen) :]
    without_length = dict(zip(less, found[len(seen) :], strict=False))
    log_weights, each_of = _log_weights(bank), []
    for n, place in enumerate(places):
        plain_nis = with_length[n].nis
        if n in without_length:
            plain_nis = merged_nis(plain_nis, without_length[n].nis, _says_too_much(bank))
        nis = merged_nis(plain_nis, rare[n].nis, RARE)
        each_of.append(
            BankInnovation(
                bank=bank,
                place=place,
                with_length=with_length[n],
                without_length=without_length.get(n),
                rare=rare[n],
                nis=_mixture_nis(log_weights, nis),
            )
        )
    return each_of


def _held_innovations(
    bank: Bank, seen: Sequence[BankMeasurement], factors: NoiseFactors
) -> list[BankInnovation]:
    places = [bank.plane.project_arcsec(each.ra_icrs_deg, each.dec_icrs_deg) for each in seen]
    off = [place - bank.means[:, :2] for place in places]
    noise = [factors.of_measured(expected_noise(bank, each)) for each in seen]
    found = filter_innovations(bank.covariances, off, noise)
    log_weights = _log_weights(bank)
    learning: Sequence[BankInnovation | None] = [None] * len(seen)
    if bank.learning is not None:
        learning = bank_innovations(bank.learning, seen)
    return [
        BankInnovation(
            bank=bank,
            place=place,
            with_length=each,
            without_length=None,
            rare=None,
            nis=_mixture_nis(log_weights, each.nis),
            learning=taught_by,
        )
        for place, each, taught_by in zip(places, found, learning, strict=True)
    ]


def _mixture_nis(log_weights: FloatArray, nis: FloatArray) -> float:
    return -2.0 * min(log_sum_exp(log_weights - 0.5 * nis), 0.0)


def update(bank: Bank, seen: BankMeasurement, factors: NoiseFactors = NO_FACTORS) -> BankUpdate:
    """Update a bank with a measurement at its instant."""
    return update_from_innovation(bank_innovation(bank, seen, factors))


def update_from_innovation(found: BankInnovation) -> BankUpdate:
    """Complete the update of a bank with a measurement, from its innovation."""
    bank, log_weights = found.bank, _log_weights(found.bank)
    learning, length_log_odds = None, bank.length_log_odds
    alternatives, shares = _alternatives(found)
    each = filter_updates(bank.covariances, alternatives, shares)
    updated = log_weights + each.log_likelihoods
    if found.rare is None:
        if found.learning is not None:
            learning = update_from_innovation(found.learning).after
            length_log_odds = learning.length_log_odds
        updated = _held_log_weights(updated, learning or bank)
    else:
        length_log_odds = _updated_length_log_odds(found, log_weights)
        updated -= log_sum_exp(updated)
    means, covariances = bank.means + each.steps, each.covariances
    every = bank.grid.filters_per_motion
    covariances[: ANY_ORBIT * every, ACCELERATION:, :] = 0.0
    covariances[: ANY_ORBIT * every, :, ACCELERATION:] = 0.0
    means[GREAT_CIRCLE * every : ANY_ORBIT * every, ACCELERATION:] = 0.0
    after = replace(
        bank,
        means=means,
        covariances=covariances,
        log_weights=np.maximum(updated, math.log(MIN_WEIGHT)),
        path_since_update_rad=np.zeros(len(log_weights)),
        length_log_odds=length_log_odds,
        updates=bank.updates + 1,
        learning=learning if bank.updates + 1 < UPDATES_TO_LEARN else None,
    )
    return BankUpdate(
        after=_centred(after),
        nis=found.nis,
        innovation=found.place - bank.weights @ bank.means[:, :2],
        covariance=innovation_covariance_of(found),
    )


def _held_log_weights(updated: FloatArray, believed: Bank) -> FloatArray:
    """Return logarithms of weights (N,) with the probabilities of noise that a bank believes.

    ``updated`` (N,): the weights as likelihoods have made them; only the shares of the motions in
    each kind of noise stay.
    """
    by_noise = updated.reshape(len(MOTIONS), -1)
    most = by_noise.max(axis=0)
    shares = by_noise - most - np.log(np.exp(by_noise - most).sum(axis=0))
    known = believed.weights.reshape(len(MOTIONS), -1).sum(axis=0)
    return np.asarray((shares + np.log(np.maximum(known, MIN_WEIGHT))).ravel())


def innovation_covariance_of(found: BankInnovation) -> FloatArray:
    """(2, 2) covariance of the mixture's innovation, arcsec^2."""
    bank, weights, s = found.bank, found.bank.weights, found.with_length.s
    if found.without_length is not None:
        share = _says_too_much(bank)
        s = (1.0 - share) * s + share * found.without_length.s
    mean = weights @ bank.means[:, :2]
    apart = bank.means[:, :2] - mean
    spread = (apart * weights[:, None]).T @ apart
    return np.asarray(np.einsum("n,nij->ij", weights, s) + spread)


def _log_weights(bank: Bank) -> FloatArray:
    return np.log(np.maximum(bank.weights, MIN_WEIGHT))


def _says_too_much(bank: Bank) -> float:
    """Probability that a streak's length indicates too large an error."""
    return 1.0 / (1.0 + math.exp(bank.length_log_odds))


def _alternatives(found: BankInnovation) -> tuple[list[FilterInnovations], list[float]]:
    """Return what the measurement may be, and the probability of each."""
    alternatives, shares = [found.with_length], [1.0]
    if found.without_length is not None:
        too_much = _says_too_much(found.bank)
        alternatives, shares = [*alternatives, found.without_length], [1.0 - too_much, too_much]
    if found.rare is not None:
        alternatives = [*alternatives, found.rare]
        shares = [*((1.0 - RARE) * each for each in shares), RARE]
    return alternatives, shares


def _updated_length_log_odds(found: BankInnovation, log_weights: FloatArray) -> float:
    if found.without_length is None:
        return found.bank.length_log_odds
    odds = log_sum_exp(log_weights + found.with_length.log_likelihoods)
    odds -= log_sum_exp(log_weights + found.without_length.log_likelihoods)
    return min(max(found.bank.length_log_odds + odds, -_MAX_LOG_ODDS), _MAX_LOG_ODDS)


def _centred(bank: Bank) -> Bank:
    """Return the same bank on the plane that touches the sky at its mixture."""
    x, y = bank.weights @ bank.means[:, :2]
    onto = TangentPlane.at(*bank.plane.direction_of(float(x), float(y)))
    return replace(bank, plane=onto, means=propagate_onto_plane(bank.plane, bank.means, 0.0, onto))


def expected_noise(bank: Bank, seen: BankMeasurement) -> FloatArray:
    """Return the noise (N, 2, 2) of a sound measurement by each filter, arcsec^2.

    The error that the streak's length indicates is the mean of both hypotheses of it.
    """
    too_much = _says_too_much(bank)
    share = math.sqrt(1.0 - too_much + too_much * _LENGTH_SAYS_TOO_MUCH**2)
    return _measured_noise(bank, replace(seen, along_arcsec=share * seen.along_arcsec))


def _measured_noise(bank: Bank, seen: BankMeasurement) -> FloatArray:
    """(N, 2, 2) measured covariance, widened by each filter's factor, and its timing scatter."""
    shift = bank.means[:, 2:4] * bank.grid.filter_timing_scatters_s[:, None]
    own = bank.grid.filter_variance_scales[:, None, None] * seen.covariance
    noise = own + shift[:, :, None] * shift[:, None, :]
    return np.asarray(_with_length_error(noise, bank, seen))


def _rare_noise(bank: Bank, seen: BankMeasurement) -> FloatArray:
    """(N, 2, 2) covariance of a measurement that has gone wrong."""
    shift = bank.means[:, 2:4] * _RARE_SCATTER_S
    noise = VARIANCE_SCALES[-1] * seen.covariance + shift[:, :, None] * shift[:, None, :]
    return np.asarray(_with_length_error(noise, bank, seen))


def _with_length_error(noise: FloatArray, bank: Bank, seen: BankMeasurement) -> FloatArray:
    if seen.along_arcsec == 0.0:
        return noise
    speed = np.maximum(np.hypot(bank.means[:, 2], bank.means[:, 3]), 1e-3)
    return noise + seen.length_error_covariance(bank.means[:, 2:4] / speed[:, None])
