"""Bounds and gain to which a filter settles on a steady track, by its settings. Pure.

The covariance of a linear filter does not depend on what is measured. So it is run forward from the
state on record, at the present cadence, until bounds and gain no longer change: to the solution of
the discrete algebraic Riccati equation (Bar-Shalom, Li & Kirubarajan 2001, 5.2.5). Of preset
``adaptive`` each motion that counts is run forward, with the noise of the mixture.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from rsoconsole.config import FilterConfig
from rsoconsole.records import FloatArray, Measurement, TrackState
from rsoconsole.tracking.filters import adaptive, lqe
from rsoconsole.tracking.filters.factors import noise_factors
from rsoconsole.tracking.filters.motions import ANY_ORBIT, motion_noise
from rsoconsole.tracking.filters.sky_path import (
    ACCELERATION,
    plane_after,
    propagate_with_jacobian,
)

MAX_UPDATES = 2000
WITHIN = 0.05
"""Share within which bounds and gain count as settled."""
_STEADY = 1e-7
_COUNTS = 0.01
"""Least probability of a motion that is run forward."""
_LEAST_SHARE = 0.05
"""Least share of an innovation's variance that is put down to the measurement."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Settled:
    """Bounds and gain of a filter on a steady track."""

    sigma_innovation_arcsec: tuple[float, float]
    """One sigma of the innovation (east, north), of which the plots show three."""
    sigma_predicted_arcsec: tuple[float, float]
    """One sigma of the predicted place (east, north)."""
    gain: tuple[float, float]
    """Share of an innovation (east, north) by which an update moves the place."""
    updates: int
    """Number of updates until all of these stay within ``WITHIN`` of their last value."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrackUpdate:
    """One update of a track on record, and the settings that were in force."""

    predicted: TrackState
    updated: TrackState
    measurement: Measurement
    settings: FilterConfig


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Linear:
    """M linear filters with probabilities; two coordinates of n are measured, in arcsec."""

    weights: FloatArray
    P: FloatArray
    F: FloatArray
    Q: FloatArray
    R: FloatArray
    H: FloatArray
    is_estimated: FloatArray
    """(M, n) 0 for coordinates that follow from others, which an update makes certain."""
    common_arcsec: float

    def figures(self) -> Iterator[FloatArray]:
        """Yield, for one update after the other, sigma of innovation and prediction, and gain."""
        P, H, transposed = self.P, self.H, np.swapaxes(self.F, -1, -2)
        one = np.eye(P.shape[-1])
        kept = self.is_estimated[:, :, None] * self.is_estimated[:, None, :]
        while True:
            P = self.F @ P @ transposed + self.Q
            place = H @ P @ H.T
            S = place + self.R
            K = P @ H.T @ np.linalg.inv(S)
            left = one - K @ H
            P = (left @ P @ np.swapaxes(left, -1, -2) + K @ self.R @ np.swapaxes(K, -1, -2)) * kept
            mixed = [np.einsum("m,mii->i", self.weights, each) for each in (S, place, H @ K)]
            predicted = np.sqrt(mixed[1] + self.common_arcsec**2)
            yield np.concatenate([np.sqrt(mixed[0]), predicted, mixed[2]])


def settle(last: TrackUpdate, settings: FilterConfig, cadence_s: float) -> Settled:
    """Return bounds and gain of a track once ``settings`` have been in force for long.

    ``last``: the newest update on record. What has been learnt of the noise is held.
    """
    of_preset = _bank if settings.uses_filter_bank else _one_filter
    linear = of_preset(last, settings, cadence_s)
    history: list[FloatArray] = []
    for figures in linear.figures():
        history.append(figures)
        if len(history) == MAX_UPDATES or (
            len(history) > 1 and np.all(np.abs(figures / history[-2] - 1.0) < _STEADY)
        ):
            break
    final = history[-1]
    is_off = np.any(np.abs(np.array(history) / final - 1.0) > WITHIN, axis=1)
    sigma_east, sigma_north, east, north, gain_east, gain_north = final.tolist()
    return Settled(
        sigma_innovation_arcsec=(sigma_east, sigma_north),
        sigma_predicted_arcsec=(east, north),
        gain=(gain_east, gain_north),
        updates=int(np.max(np.flatnonzero(is_off), initial=-1)) + 2,
    )


def _one_filter(last: TrackUpdate, settings: FilterConfig, cadence_s: float) -> _Linear:
    state = last.updated
    dec_deg = state.x[2]
    cos_dec = np.cos(np.radians(dec_deg))
    to_sky = np.array([cos_dec, cos_dec, 1.0, 1.0]) * lqe.ARCSEC_PER_DEG
    scale = np.outer(to_sky, to_sky)
    Q = state.q_scale * lqe.process_noise(cadence_s, dec_deg, settings)
    R = lqe.measurement_noise(last.measurement, settings) * scale[::2, ::2]
    return _Linear(
        weights=np.ones(1),
        P=np.array(state.P)[None] * scale,
        F=lqe.transition_matrix(cadence_s)[None],
        Q=Q[None] * scale,
        R=R[None],
        H=lqe.C,
        is_estimated=np.ones((1, 4)),
        common_arcsec=0.0,
    )


def _bank(last: TrackUpdate, settings: FilterConfig, cadence_s: float) -> _Linear:
    state, factors = last.updated, noise_factors(settings)
    bank = adaptive.bank_from_record(state)
    per_motion = bank.grid.filters_per_motion
    motion = np.flatnonzero(bank.motion_probabilities > _COUNTS)
    means, P = bank.means[motion * per_motion], bank.covariances[motion * per_motion]
    weights = bank.motion_probabilities[motion] / bank.motion_probabilities[motion].sum()
    onto = plane_after(bank.plane, weights @ means, cadence_s)
    _, F = propagate_with_jacobian(bank.plane, means, cadence_s, onto)
    noise = motion_noise(means, motion, cadence_s, np.zeros(len(motion)))
    is_estimated = np.ones((len(motion), means.shape[1]))
    is_estimated[motion < ANY_ORBIT, ACCELERATION:] = 0.0
    return _Linear(
        weights=weights,
        P=P,
        F=F,
        Q=factors.of_process(noise),
        R=np.tile(factors.of_measured(_mixture_noise(last)), (len(motion), 1, 1)),
        H=np.eye(2, means.shape[1]),
        is_estimated=is_estimated,
        common_arcsec=adaptive.COMMON_ARCSEC,
    )


def _mixture_noise(last: TrackUpdate) -> FloatArray:
    """Measured noise (2, 2) of the last update without the operator's factors, arcsec^2.

    What an innovation's variance has beyond the prediction's, with the correlation that the
    measurement and the scatter along the motion have together.
    """
    state, measurement = last.updated, last.measurement
    ee, en, nn = measurement.cov_sky_arcsec2
    said = state.mixture
    if said is None or state.sigma_innovation_arcsec is None:
        return np.array([[ee, en], [en, nn]])
    scatter = np.array(lqe.sky_rate_arcsec_s(state)) * said.scatter_s
    likely = said.variance_scale * np.array([[ee, en], [en, nn]]) + np.outer(scatter, scatter)
    total = np.square(state.sigma_innovation_arcsec)
    place = np.diag(lqe.sky_covariance_arcsec2(last.predicted)) - adaptive.COMMON_ARCSEC**2
    own = np.maximum(total - place, _LEAST_SHARE * total)
    own = own / np.square(noise_factors(last.settings).measured_roots)
    roots = np.sqrt(own / np.diag(likely))
    return np.asarray(likely * np.outer(roots, roots))
