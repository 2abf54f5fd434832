"""Bank of filters: motions weighed by likelihood, and a night's timing scatter. Pure.

One filter cannot fit a satellite that keeps its slot, one whose path turns ten times as fast, and a
shutter that opens late at random. So there is a filter for each combination of ``MOTIONS``, of
``VARIANCE_SCALES`` of the measurements' errors and of ``SCATTERS_S`` along the motion. Every
measurement updates all of them; a filter's weight is its likelihood (a bank of filters: Magill
1965; Bar-Shalom, Li & Kirubarajan 2001, 11.6). The prediction is their mixture. A motion is six
numbers (``sky_path``): for the ``parallel`` and the ``great circle`` the last two follow from the
name; for ``any orbit`` they are as uncertain as the admissible region of orbits leaves them
(``orbits/first/population.py``).

Whether the length of a streak indicates its error rightly, or too large an error, are two more
hypotheses, weighed in the same way. A late shutter moves a streak along itself. Its scatter is not
known in advance: the innovations give each timing scatter its probability.
"""

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from rsoconsole.records import FloatArray
from rsoconsole.tracking.filters.factors import NO_FACTORS, NoiseFactors
from rsoconsole.tracking.filters.filter_grid import (
    COARSE,
    FINE,
    MIN_SCATTER_S,
    SCATTERS_S,
    VARIANCE_SCALES,
    FilterGrid,
)
from rsoconsole.tracking.filters.motions import (
    ANY_ORBIT,
    MOTION_PRIORS,
    MOTIONS,
    PARALLEL,
    motion_noise,
    unknown_bend_prior,
)
from rsoconsole.tracking.filters.sky_path import (
    ACCELERATION,
    ARCSEC_RAD,
    TangentPlane,
    constant_rate_bend,
    plane_after,
    propagate_onto_plane,
    propagate_with_jacobian,
)

_SCATTER_FALLS, _SCATTER_FALLS_KNOWN = 0.1, 0.5
"""Powers with which the prior of a scatter falls; the second where the shutter's is calibrated."""
_VARIANCE_SCALE_PRIORS = (0.04, 0.24, 0.2, 0.18, 0.16, 0.12, 0.06)
MIN_WEIGHT = 1e-12
_LONGEST_STEP_S, _MAX_STEPS = 120.0, 60
_WIDENED = 2.0
"""Factor on the variances that the admissible region leaves: it is no census."""
_MOST = np.array([60.0 * 3600.0, 60.0 * 3600.0, 10.0 * 3600.0, 10.0 * 3600.0])
"""Limits of a place, arcsec, and rate, arcsec/s, and of their sigmas: beyond, it ran away."""
_WIDEST = 0.99
"""Share of these limits to which a filter is brought back."""
_BELIEVED = 1e-9
"""Least weight of a filter that counts in the mixture."""
_OF_RATE = 0.5
"""Relative sigma of the first rate: the places alone should determine it."""


UPDATES_TO_LEARN = 30
"""Updates of a track after which what it has learnt of the measured noise can be held."""


@dataclass(frozen=True, eq=False)
class Bank:
    """Filters at one instant, ordered by motion, variance scale and timing scatter (fastest)."""

    plane: TangentPlane
    t_utc_ns: int
    means: FloatArray
    """(N, 6) mean motions of the filters, as in ``sky_path``."""
    covariances: FloatArray
    """(N, 6, 6) covariances of the filters."""
    log_weights: FloatArray
    """(N,) logarithms of the filters' weights."""
    path_since_update_rad: FloatArray
    """(N,) length of each filter's path since the last measurement, rad."""
    length_log_odds: float = 0.0
    """Logarithm of the odds that streak lengths indicate their error rightly, not too large."""
    grid: FilterGrid = FINE
    updates: int = 0
    """Number of measurements since the bank was started."""
    learning: "Bank | None" = None
    """Bank of the same track without factors, from which a young held one takes its noise."""

    @functools.cached_property
    def weights(self) -> FloatArray:
        """(N,) probabilities of the filters."""
        each = np.exp(self.log_weights - self.log_weights.max())
        return np.asarray(each / each.sum())

    @property
    def filter_motions(self) -> npt.NDArray[np.intp]:
        """(N,) index of each filter's motion in ``MOTIONS``."""
        return self.grid.filter_motions

    @property
    def motion_probabilities(self) -> FloatArray:
        """(4,) probabilities of the motions in ``MOTIONS``."""
        return np.asarray(self.weights.reshape(len(MOTIONS), -1).sum(axis=1))

    @property
    def scatter_probabilities(self) -> FloatArray:
        """(S,) probabilities of the timing scatters of the grid."""
        return np.asarray(self.weights.reshape(-1, len(self.grid.scatters_s)).sum(axis=0))

    @property
    def variance_scale_probabilities(self) -> FloatArray:
        """(V,) probabilities of the variance scales of the grid."""
        shape = (len(MOTIONS), -1, len(self.grid.scatters_s))
        return np.asarray(self.weights.reshape(shape).sum(axis=(0, 2)))

    @property
    def variance_scale(self) -> float:
        """Mean variance scale over all filters."""
        return float(self.variance_scale_probabilities @ self.grid.variance_scales)

    def moments(self) -> tuple[FloatArray, FloatArray]:
        """Return the mean (6,) and covariance (6, 6) of the mixture of all filters."""
        weights = self.weights
        mean = weights @ self.means
        off = self.means - mean
        spread = (off * weights[:, None]).T @ off
        return mean, np.einsum("n,nij->ij", weights, self.covariances) + spread


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BankMeasurement:
    """One measured direction as input to a bank."""

    t_utc_ns: int
    ra_icrs_deg: float
    dec_icrs_deg: float
    covariance: FloatArray
    """(2, 2) covariance, arcsec^2, without the shutter's timing scatter."""
    along_arcsec: float = 0.0
    """Further sigma along the streak, which the streak's length indicates."""
    axis: FloatArray | None = None
    """(2,) unit vector along the streak, turned by drift and wind; None: along the motion."""

    def length_error_covariance(self, ahead: FloatArray) -> FloatArray:
        """Return the covariance (..., 2, 2) by the error from the streak's length, arcsec^2.

        ``ahead`` (..., 2): unit vector of the motion, used where the streak has no axis.
        """
        axis = ahead if self.axis is None else self.axis
        return np.asarray(self.along_arcsec**2 * axis[..., :, None] * axis[..., None, :])


def initiate_bank(
    first: BankMeasurement,
    rate_arcsec_s: tuple[float, float],
    bend: tuple[FloatArray, FloatArray] | None,
    *,
    is_shutter_known: bool = False,
    factors: NoiseFactors = NO_FACTORS,
) -> Bank:
    """Start a bank at one direction, with a rate (east, north) of large uncertainty.

    ``bend``: mean (2,) and covariance (2, 2) of the path's change of speed (arcsec/s^2) and turn;
    None: unknown. ``is_shutter_known``: True where the covariance of ``first`` contains the
    shutter's calibrated scatter, so that further scatter is less likely.
    """
    plane = TangentPlane.at(first.ra_icrs_deg, first.dec_icrs_deg)
    rate = np.array(rate_arcsec_s)
    speed = max(float(np.hypot(*rate)), 1e-3)
    ahead = rate / speed
    mean, spread = unknown_bend_prior(speed) if bend is None else bend
    calm = constant_rate_bend(first.dec_icrs_deg, rate)
    bends = (calm, np.zeros(2), mean, mean)
    means = np.array([[0.0, 0.0, *rate_arcsec_s, *each] for each in bends])
    covariances = np.zeros((len(MOTIONS), len(VARIANCE_SCALES), len(SCATTERS_S), 6, 6))
    along = np.outer(ahead, ahead) * speed**2
    covariances[..., :2, :2] = VARIANCE_SCALES[:, None, None, None] * first.covariance
    covariances[..., :2, :2] += (SCATTERS_S**2)[
        :, None, None
    ] * along + first.length_error_covariance(ahead)
    covariances[..., :2, :2] = factors.of_measured(covariances[..., :2, :2])
    covariances[..., 2, 2] = covariances[..., 3, 3] = (_OF_RATE * speed) ** 2
    covariances[ANY_ORBIT:, ..., ACCELERATION:, ACCELERATION:] = _WIDENED * spread
    likely = SCATTERS_S ** -(_SCATTER_FALLS_KNOWN if is_shutter_known else _SCATTER_FALLS)
    weights = np.einsum("m,w,s->mws", MOTION_PRIORS, _VARIANCE_SCALE_PRIORS, likely / likely.sum())
    return Bank(
        plane=plane,
        t_utc_ns=first.t_utc_ns,
        means=np.repeat(means, FINE.filters_per_motion, axis=0),
        covariances=covariances.reshape(-1, 6, 6),
        log_weights=np.log(np.maximum(weights.ravel(), MIN_WEIGHT)),
        path_since_update_rad=np.zeros(len(covariances.reshape(-1, 6, 6))),
    )


def predict(bank: Bank, t_utc_ns: int, factors: NoiseFactors = NO_FACTORS) -> Bank:
    """Predict the bank to another instant, later or earlier."""
    learning = None
    if factors.is_held and bank.updates < UPDATES_TO_LEARN:
        learning = predict(bank.learning or bank, t_utc_ns)
    for dt_s in _steps_s(bank, t_utc_ns):
        bank = _stepped(bank, dt_s, factors)
    return replace(bank, t_utc_ns=t_utc_ns, learning=learning)


def predict_mean(bank: Bank, t_utc_ns: int) -> tuple[TangentPlane, FloatArray]:
    """Return the mixture's mean (6,) at another instant, and the plane it is on.

    As by `predict`, without the covariances, which take most of the time. (So a filter of no
    weight whose covariance alone has run away stays in it, with that weight.)
    """
    plane, means = bank.plane, bank.means
    for dt_s in _steps_s(bank, t_utc_ns):
        means = _with_constant_rates(means, plane, bank.grid)
        onto = plane_after(plane, bank.weights @ means, dt_s)
        plane, means = onto, propagate_onto_plane(plane, means, dt_s, onto)
        if not (np.abs(means[:, :4]) < _MOST).all():
            ahead = predict(bank, t_utc_ns)
            return ahead.plane, ahead.moments()[0]
    return plane, bank.weights @ means


def _steps_s(bank: Bank, t_utc_ns: int) -> list[float]:
    """Steps, s, in which a bank is predicted to an instant."""
    left_s = (t_utc_ns - bank.t_utc_ns) / 1e9
    steps = min(math.ceil(abs(left_s) / _LONGEST_STEP_S), _MAX_STEPS)
    return [left_s / steps] * steps if steps else []


def _with_constant_rates(means: FloatArray, plane: TangentPlane, grid: FilterGrid) -> FloatArray:
    """Means (N, 6) with the bend that constant rates have where each parallel is."""
    means, own = means.copy(), slice(PARALLEL, PARALLEL + grid.filters_per_motion)
    _, dec_deg = plane.direction_deg
    means[own, ACCELERATION:] = constant_rate_bend(
        dec_deg + means[own, 1] / 3600.0, means[own, 2:4]
    )
    return means


def _stepped(bank: Bank, dt_s: float, factors: NoiseFactors) -> Bank:
    means = _with_constant_rates(bank.means, bank.plane, bank.grid)
    onto = plane_after(bank.plane, bank.weights @ means, dt_s)
    after, slopes = propagate_with_jacobian(bank.plane, means, dt_s, onto)
    covariances = slopes @ bank.covariances @ np.swapaxes(slopes, -1, -2)
    noise = motion_noise(means, bank.filter_motions, dt_s, bank.path_since_update_rad)
    length = np.hypot(means[:, 2], means[:, 3]) * abs(dt_s) * ARCSEC_RAD
    return _sound(
        replace(
            bank,
            plane=onto,
            means=after,
            covariances=covariances + factors.of_process(noise),
            path_since_update_rad=bank.path_since_update_rad + length,
        )
    )


def _sound(bank: Bank) -> Bank:
    """Bring filters whose numbers are of no place on the sky back to it.

    Over a pole, or a long way of a low orbit, a filter of no weight may grow without end; even at
    1e-12, the least weight, it then dominates the mixture. Such a filter begins again from the
    likeliest of its motion that is sound, or of all. One that is believed, as after a long coast,
    keeps its weight and is as wide as a filter may be: the mixture stays as unsure as it is.
    """
    if _are_sound(bank):
        return bank
    is_sound = _which_are_sound(bank)
    is_believed = bank.weights > _BELIEVED
    means, covariances = bank.means.copy(), bank.covariances.copy()
    for n in np.flatnonzero(~is_sound & is_believed):
        means[n], covariances[n] = _as_wide_as_may_be(means[n], covariances[n])
    log_weights, path = bank.log_weights.copy(), bank.path_since_update_rad.copy()
    usable = is_sound | is_believed
    likely = np.where(usable, log_weights, -np.inf)
    for motion, first in enumerate(range(0, len(means), bank.grid.filters_per_motion)):
        own = np.arange(first, first + bank.grid.filters_per_motion)
        among = own if usable[own].any() else np.arange(len(means))
        best, astray = among[np.argmax(likely[among])], own[~usable[own]]
        means[astray], covariances[astray] = means[best], covariances[best]
        if motion < ANY_ORBIT:
            means[astray, ACCELERATION:] = 0.0
            covariances[astray, ACCELERATION:, :] = 0.0
            covariances[astray, :, ACCELERATION:] = 0.0
        path[astray], log_weights[astray] = path[best], math.log(MIN_WEIGHT)
    return replace(
        bank,
        means=means,
        covariances=covariances,
        log_weights=log_weights,
        path_since_update_rad=path,
    )


def _as_wide_as_may_be(mean: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Limit a filter's moments to a place and a rate on the sky, and to the largest error."""
    spread = np.diagonal(covariance)[:4]
    if np.isfinite(mean).all() and np.isfinite(covariance).all() and (spread > 0.0).all():
        shrunk = min(1.0, float(np.min(_WIDEST * _MOST**2 / spread)))
        within = np.concatenate([np.clip(mean[:4], -_MOST * _WIDEST, _MOST * _WIDEST), mean[4:]])
        return within, covariance * shrunk
    return np.zeros(6), np.diag([*(_WIDEST * _MOST**2), 0.0, 0.0])


def _are_sound(bank: Bank) -> bool:
    """True where all filters are sound, in less time than ``_which_are_sound``."""
    spread = np.diagonal(bank.covariances, axis1=1, axis2=2)[:, :4]
    least, most, farthest = spread.min(), spread.max(axis=0), np.abs(bank.means).max(axis=0)
    is_small = bool((most < _MOST**2).all() and (farthest[:4] < _MOST).all())
    return is_small and least >= 0.0 and bool(np.isfinite(farthest).all())


def _which_are_sound(bank: Bank) -> npt.NDArray[np.bool_]:
    """(N,) True for filters whose numbers are of a place and a rate on the sky."""
    size = np.abs(bank.means[:, :4])
    spread = np.diagonal(bank.covariances, axis1=1, axis2=2)[:, :4]
    # Every comparison with what is no number is false.
    is_small = (size < _MOST) & (spread >= 0.0) & (spread < _MOST**2)
    return np.asarray(is_small.all(axis=1) & np.isfinite(bank.means[:, ACCELERATION:]).all(axis=1))


def restarted_bank(
    bank: Bank,
    direction_deg: tuple[float, float],
    rate_arcsec_s: tuple[float, float],
    covariance: FloatArray,
    bend: tuple[FloatArray, FloatArray],
) -> Bank:
    """Restart all filters from another prediction of the object, at the bank's instant.

    ``covariance`` (4, 4) of east, its rate, north, its rate: arcsec and arcsec/s. ``bend``: mean
    (2,) and covariance (2, 2) of the path's change of speed and turn. The weights of the filters
    stay.
    """
    plane = TangentPlane.at(*direction_deg)
    mean, spread = bend
    calm = constant_rate_bend(direction_deg[1], np.array(rate_arcsec_s))
    bends = (calm, np.zeros(2), mean, mean)
    means = np.array([[0.0, 0.0, *rate_arcsec_s, *each] for each in bends])
    order = np.ix_([0, 2, 1, 3], [0, 2, 1, 3])
    per_motion = bank.grid.filters_per_motion
    covariances = np.zeros((len(MOTIONS), per_motion, 6, 6))
    covariances[..., :4, :4] = np.asarray(covariance)[order]
    covariances[ANY_ORBIT:, :, ACCELERATION:, ACCELERATION:] = spread
    return replace(
        bank,
        plane=plane,
        means=np.repeat(means, per_motion, axis=0),
        covariances=covariances.reshape(-1, 6, 6),
        path_since_update_rad=np.zeros(len(MOTIONS) * per_motion),
        learning=bank.learning
        and restarted_bank(bank.learning, direction_deg, rate_arcsec_s, covariance, bend),
    )


def coarse_bank(bank: Bank) -> Bank:
    """Return the bank merged onto the ``COARSE`` grid; a coarse bank is returned as it is.

    Each new filter has the summed weight, the mean and the covariance of the filters merged into
    it.
    """
    if bank.grid is COARSE:
        return bank
    scale = _nearest(COARSE.variance_scales, bank.grid.variance_scales)
    scatter = _nearest(COARSE.scatters_s, bank.grid.scatters_s)
    of_motion = (scale[:, None] * len(COARSE.scatters_s) + scatter).ravel()
    onto = np.arange(len(MOTIONS))[:, None] * COARSE.filters_per_motion + of_motion
    belongs = np.zeros((len(MOTIONS) * COARSE.filters_per_motion, len(bank.means)))
    belongs[onto.ravel(), np.arange(len(bank.means))] = np.maximum(bank.weights, MIN_WEIGHT)
    weights = belongs.sum(axis=1)
    share = belongs / weights[:, None]
    means = share @ bank.means
    off = bank.means - means[onto.ravel()]
    spread = bank.covariances + off[:, :, None] * off[:, None, :]
    return replace(
        bank,
        means=means,
        covariances=(share @ spread.reshape(-1, 36)).reshape(-1, 6, 6),
        log_weights=np.log(weights),
        path_since_update_rad=share @ bank.path_since_update_rad,
        grid=COARSE,
        learning=bank.learning and coarse_bank(bank.learning),
    )


def _nearest(few: FloatArray, many: FloatArray) -> npt.NDArray[np.intp]:
    """Index of the nearest of the few for each of the many, by their ratio."""
    return np.asarray(np.argmin(np.abs(np.log(many[:, None] / few)), axis=1))


def bank_of_equal_filters(  # noqa: PLR0917 -- all that one filter says
    plane: TangentPlane,
    t_utc_ns: int,
    motion: FloatArray,
    covariance: FloatArray,
    motion_probabilities: Sequence[float],
    scatter_s: float,
    variance_scale: float = 1.0,
) -> Bank:
    """Make a bank in which every filter has the same motion (6,) and covariance (6, 6).

    Only for ``any orbit``: the other motions have 0 for change of speed and turn, and no variance
    of them. ``motion_probabilities`` are the weights of the filters nearest to ``scatter_s`` and
    ``variance_scale``; all others have the least weight.
    """
    every = len(MOTIONS) * FINE.filters_per_motion
    nearest = int(np.argmin(np.abs(np.log(SCATTERS_S / max(scatter_s, MIN_SCATTER_S)))))
    widest = int(np.argmin(np.abs(np.log(VARIANCE_SCALES / variance_scale))))
    weights = np.full((len(MOTIONS), len(VARIANCE_SCALES), len(SCATTERS_S)), MIN_WEIGHT)
    weights[:, widest, nearest] = np.maximum(motion_probabilities, MIN_WEIGHT)
    means, covariances = np.tile(motion, (every, 1)), np.tile(covariance, (every, 1, 1))
    calm = slice(0, ANY_ORBIT * FINE.filters_per_motion)
    means[calm, ACCELERATION:] = covariances[calm, ACCELERATION:, :] = covariances[
        calm, :, ACCELERATION:
    ] = 0.0
    return Bank(
        plane=plane,
        t_utc_ns=t_utc_ns,
        means=means,
        covariances=covariances,
        log_weights=np.log(weights.ravel()),
        path_since_update_rad=np.zeros(every),
        updates=UPDATES_TO_LEARN,
    )
