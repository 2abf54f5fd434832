"""Several motions weighed by their likelihood, and how much a night scatters. Pure.

One filter cannot fit a satellite that keeps its slot, one that turns ten times as fast, and a
shutter that opens when it likes. So as many filters as there are motions times scatters hear every
measurement, each with a motion of ``MOTIONS`` and an excess scatter along the motion; what each
gave to what was then measured weighs it (a bank of filters: Magill 1965; Bar-Shalom, Li &
Kirubarajan 2001, 11.6). Their mixture predicts. A motion is six numbers (``sky_path``): of the
``parallel`` and the ``great circle`` the last two are what their names say, of ``any orbit`` they
are open as far as the admissible region of orbits leaves them (``orbit.admissible``).

What the shutter is late by moves a streak along itself. How much it scatters is not known
beforehand: the share of each scatter is what the innovations make of it, and its interval is told.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rsoconsole.records import FloatArray
from rsoconsole.tracking.sky_path import (
    ARCSEC_RAD,
    GAIN,
    TURN,
    Plane,
    moved,
    parallel_of,
    plane_after,
    with_slopes,
)

MOTIONS = ("parallel", "great circle", "any orbit", "changing orbit")
PARALLEL, GREAT_CIRCLE, ANY_ORBIT, CHANGING = range(4)
SCATTERS = 14
WIDENINGS = np.array([1.0, 5.0, 25.0])
"""Of a measurement's own variances: wind, a plate of few stars and ends that cloud has moved make
errors larger than they say, across the motion as well as along it."""
PER_MOTION = len(WIDENINGS) * SCATTERS
MOST_SCATTER_S = 3.0
_LEAST_SCATTER_S = 0.005
_SCATTER_FALLS = 0.4
"""Before anything is measured a scatter is as likely as it is small, to this power."""
MOTION_SHARES = (0.3, 0.1, 0.4, 0.2)
_WIDENING_SHARES = (0.85, 0.12, 0.03)
_LEAST_SHARE = 1e-12
_TEMPERED = 0.65
"""The likelihood is too sharp, as no motion is quite what is followed: power that makes intervals
hold as often as they say (measured on SGP4's orbits)."""
_CALM_Q, _OPEN_Q = 3e-9, 1e-8
"""White acceleration, arcsec^2/s^3, at 15 arcsec/s; with the third power of the rate elsewhere."""
_CALM_RATE_ARCSEC_S = 15.0
_CHANGES, _OVER_RAD = np.array([0.006, 0.006, 0.5, 4.0]), 0.02
"""By how much a turn changes over a radian of path, of each motion: what an orbit seen from a
turning Earth does. From one measurement to the next it changes as at random over such lengths."""
_GOES_ON = np.array([0.0, 0.0, 1.5, 1.5])
"""By how much at least over a coast that is longer than that."""
_LONGEST_STEP_S, _MOST_STEPS = 120.0, 60
_WIDENED = 2.0
"""Of the variances that the admissible region leaves: it is no census."""
_OF_RATE = 0.5
"""Sigma of the first rate, in units of it: the places alone are to tell it."""


@dataclass(frozen=True, slots=True, eq=False)
class Bank:
    """All filters at one instant: by motion, widening, scatter, the last of them quickest."""

    plane: Plane
    t_utc_ns: int
    means: FloatArray
    """(N, 6)"""
    covariances: FloatArray
    """(N, 6, 6)"""
    log_shares: FloatArray
    """(N,)"""
    scatters_s: FloatArray
    """(SCATTERS,)"""
    unheard_rad: FloatArray
    """(N,) length of path since the last measurement."""

    @property
    def shares(self) -> FloatArray:
        """(N,) probabilities."""
        each = np.exp(self.log_shares - self.log_shares.max())
        return np.asarray(each / each.sum())

    @property
    def motion_shares(self) -> FloatArray:
        """(4,) of ``MOTIONS``."""
        return np.asarray(self.shares.reshape(-1, PER_MOTION).sum(axis=1))

    @property
    def scatter_shares(self) -> FloatArray:
        """(SCATTERS,)"""
        return np.asarray(self.shares.reshape(-1, SCATTERS).sum(axis=0))

    @property
    def widening_shares(self) -> FloatArray:
        """(3,) of ``WIDENINGS``."""
        return np.asarray(self.shares.reshape(-1, len(WIDENINGS), SCATTERS).sum(axis=(0, 2)))

    def moments(self) -> tuple[FloatArray, FloatArray]:
        """Mean (6,) and covariance (6, 6) of the mixture."""
        shares = self.shares
        mean = shares @ self.means
        off = self.means - mean
        spread = (off * shares[:, None]).T @ off
        return mean, np.einsum("n,nij->ij", shares, self.covariances) + spread


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sighted:
    """One measured direction as a bank hears it."""

    t_utc_ns: int
    ra_icrs_deg: float
    dec_icrs_deg: float
    covariance: FloatArray
    """(2, 2) arcsec^2, without the shutter's scatter."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Heard:
    """What a measurement says to a bank, before it is taken."""

    after: Bank
    nis: float
    """Minus twice the logarithm of the probability that a sound mixture shows more: with one
    filter alone its normalised innovation squared."""
    innovation: FloatArray
    """(2,) arcsec, measured minus the mixture's mean."""
    covariance: FloatArray
    """(2, 2) of the mixture's innovation."""
    log_likelihood: float
    """Logarithm of the density at the measurement, 1/arcsec^2."""


def scatters() -> FloatArray:
    """Those that are reckoned with, seconds, beyond what is known of the shutter."""
    return np.geomspace(_LEAST_SCATTER_S, MOST_SCATTER_S, SCATTERS)


def begun(
    first: Sighted,
    rate_arcsec_s: tuple[float, float],
    bend: tuple[FloatArray, FloatArray] | None,
    scatters_s: FloatArray,
    scatter_shares: FloatArray | None = None,
) -> Bank:
    """A bank at one direction, with a rate (east, north) that is hardly believed.

    ``bend``: mean (2,) and covariance (2, 2) of change of speed and turn of any orbit through it;
    None: unknown. ``scatter_shares``: what is believed of the scatters, where it is known.
    """
    plane = Plane.at(first.ra_icrs_deg, first.dec_icrs_deg)
    rate = np.array(rate_arcsec_s)
    speed = max(float(np.hypot(*rate)), 1e-3)
    ahead = rate / speed
    mean, spread = any_bend(speed) if bend is None else bend
    calm = parallel_of(first.dec_icrs_deg, rate)
    bends = (calm, np.zeros(2), mean, mean)
    means = np.array([[0.0, 0.0, *rate_arcsec_s, *each] for each in bends])
    covariances = np.zeros((len(MOTIONS), len(WIDENINGS), SCATTERS, 6, 6))
    along = np.outer(ahead, ahead) * speed**2
    covariances[..., :2, :2] = WIDENINGS[:, None, None, None] * first.covariance
    covariances[..., :2, :2] += scatters_s[:, None, None] ** 2 * along
    covariances[..., 2, 2] = covariances[..., 3, 3] = (_OF_RATE * speed) ** 2
    covariances[ANY_ORBIT:, ..., GAIN:, GAIN:] = _WIDENED * spread
    if scatter_shares is None:
        scatter_shares = scatters_s**-_SCATTER_FALLS
    shares = np.einsum(
        "m,w,s->mws", MOTION_SHARES, _WIDENING_SHARES, scatter_shares / scatter_shares.sum()
    )
    return Bank(
        plane=plane,
        t_utc_ns=first.t_utc_ns,
        means=np.repeat(means, PER_MOTION, axis=0),
        covariances=covariances.reshape(-1, 6, 6),
        log_shares=np.log(np.maximum(shares.ravel(), _LEAST_SHARE)),
        scatters_s=scatters_s,
        unheard_rad=np.zeros(len(MOTIONS) * PER_MOTION),
    )


def ahead(bank: Bank, t_utc_ns: int, roots: FloatArray | None = None) -> Bank:
    """The bank carried to another instant, also back.

    ``roots`` (6,): of the operator's factors of the process noise; None: all 1.
    """
    left_s = (t_utc_ns - bank.t_utc_ns) / 1e9
    steps = min(max(math.ceil(abs(left_s) / _LONGEST_STEP_S), 1), _MOST_STEPS)
    scale = np.ones((6, 6)) if roots is None else np.outer(roots, roots)
    for _ in range(steps if left_s else 0):
        bank = _stepped(bank, left_s / steps, scale)
    return replace(bank, t_utc_ns=t_utc_ns)


def _stepped(bank: Bank, dt_s: float, scale: FloatArray) -> Bank:
    means = bank.means.copy()
    calm = slice(PARALLEL * PER_MOTION, (PARALLEL + 1) * PER_MOTION)
    _, dec_deg = bank.plane.direction_deg
    means[calm, GAIN:] = parallel_of(dec_deg + means[calm, 1] / 3600.0, means[calm, 2:4])
    mean = bank.shares @ means
    onto = plane_after(bank.plane, mean, dt_s)
    after, slopes = with_slopes(bank.plane, means, dt_s, onto)
    covariances = slopes @ bank.covariances @ np.swapaxes(slopes, -1, -2)
    length = np.hypot(means[:, 2], means[:, 3]) * abs(dt_s) * ARCSEC_RAD
    covariances = covariances + scale * _noise(means, dt_s, bank.unheard_rad, length)
    return replace(
        bank,
        plane=onto,
        means=after,
        covariances=covariances,
        unheard_rad=bank.unheard_rad + length,
    )


def _noise(
    means: FloatArray, dt_s: float, unheard_rad: FloatArray, length_rad: FloatArray
) -> FloatArray:
    """(N, 6, 6); over a coast what changes goes on changing the same way."""
    span = abs(dt_s)
    speed = np.hypot(means[:, 2], means[:, 3])
    motion = np.arange(len(means)) // PER_MOTION
    is_open = motion >= ANY_ORBIT
    q = np.where(is_open, _OPEN_Q, _CALM_Q) * (speed / _CALM_RATE_ARCSEC_S) ** 3
    noise = np.zeros((len(means), 6, 6))
    for place, rate in ((0, 2), (1, 3)):
        noise[:, place, place] = q * span**3 / 3.0
        noise[:, place, rate] = noise[:, rate, place] = q * dt_s * span / 2.0
        noise[:, rate, rate] = q * span
    until = unheard_rad + length_rad
    at_random = _CHANGES[motion] ** 2 * np.minimum(length_rad, _OVER_RAD) * _OVER_RAD
    goes_on = np.maximum(_CHANGES, _GOES_ON)[motion] ** 2 * (until**2 - unheard_rad**2)
    turned = np.maximum(at_random, np.where(until > _OVER_RAD, goes_on, 0.0))
    noise[:, TURN, TURN] = turned
    noise[:, GAIN, GAIN] = turned * (speed**2 * ARCSEC_RAD) ** 2
    return noise


def heard(bank: Bank, seen: Sighted) -> Heard:
    """What a measurement at the bank's instant says, and the bank that has taken it."""
    place = bank.plane.place_of(seen.ra_icrs_deg, seen.dec_icrs_deg)
    off = place - bank.means[:, :2]
    noise = _measured_noise(bank, seen.covariance)
    s = bank.covariances[:, :2, :2] + noise
    inverse = np.linalg.inv(s)
    nis = np.einsum("ni,nij,nj->n", off, inverse, off)
    log_likelihoods = -0.5 * (nis + np.log(np.linalg.det(s))) - math.log(2.0 * math.pi)
    gain = bank.covariances[:, :, :2] @ inverse
    means = bank.means + np.einsum("nij,nj->ni", gain, off)
    # Joseph's form keeps it positive.
    left = np.eye(6) - np.concatenate([gain, np.zeros((len(gain), 6, 4))], axis=2)
    covariances = left @ bank.covariances @ np.swapaxes(left, -1, -2)
    covariances += gain @ noise @ np.swapaxes(gain, -1, -2)
    shares, log_shares = bank.shares, np.log(np.maximum(bank.shares, _LEAST_SHARE))
    total = log_shares + log_likelihoods
    most = float(total.max())
    log_likelihood = most + math.log(float(np.exp(total - most).sum()))
    mean = shares @ bank.means[:, :2]
    apart = bank.means[:, :2] - mean
    covariance = np.einsum("n,nij->ij", shares, s) + (apart * shares[:, None]).T @ apart
    taken = replace(
        bank,
        means=means,
        covariances=covariances,
        log_shares=np.maximum(total - log_likelihood, math.log(_LEAST_SHARE)),
        unheard_rad=np.zeros(len(means)),
    )
    calm = slice(0, ANY_ORBIT * PER_MOTION)
    taken.covariances[calm, GAIN:, :] = taken.covariances[calm, :, GAIN:] = 0.0
    taken.means[GREAT_CIRCLE * PER_MOTION : ANY_ORBIT * PER_MOTION, GAIN:] = 0.0
    return Heard(
        after=_centred(taken),
        nis=_nis_of(shares, nis),
        innovation=place - mean,
        covariance=covariance,
        log_likelihood=log_likelihood,
    )


def _centred(bank: Bank) -> Bank:
    """The same bank on the plane that touches the sky where its mixture is."""
    mean = bank.shares @ bank.means
    onto = plane_after(bank.plane, mean, 0.0)
    return replace(bank, plane=onto, means=moved(bank.plane, bank.means, 0.0, onto))


def _nis_of(shares: FloatArray, nis: FloatArray) -> float:
    """-2 log sum(shares exp(-nis / 2)), also where all are far off."""
    terms = np.log(np.maximum(shares, 1e-300)) - 0.5 * nis
    most = float(terms.max())
    if not math.isfinite(most):
        return math.inf
    return max(-2.0 * (most + math.log(float(np.exp(terms - most).sum()))), 0.0)


def _measured_noise(bank: Bank, covariance: FloatArray) -> FloatArray:
    """(N, 2, 2): the measurement's own, as much wider as each filter has it, and its scatter."""
    late_s = np.tile(bank.scatters_s, len(bank.means) // SCATTERS)
    widened = np.tile(np.repeat(WIDENINGS, SCATTERS), len(MOTIONS))
    shift = bank.means[:, 2:4] * late_s[:, None]
    own = widened[:, None, None] * covariance
    return np.asarray(own + shift[:, :, None] * shift[:, None, :])


def any_bend(speed_arcsec_s: float) -> tuple[FloatArray, FloatArray]:
    """Where no orbit passes, or none is asked for."""
    gain = speed_arcsec_s**2 * ARCSEC_RAD
    return np.zeros(2), np.diag([gain**2, 1.0])


def reseeded(
    bank: Bank,
    direction_deg: tuple[float, float],
    rate_arcsec_s: tuple[float, float],
    covariance: FloatArray,
    bend: tuple[FloatArray, FloatArray] | None,
) -> Bank:
    """All filters where another prediction puts the object, at the bank's instant.

    ``covariance`` (4, 4) of east, its rate, north, its rate: arcsec and arcsec/s. What is known of
    scatter stays.
    """
    plane = Plane.at(*direction_deg)
    speed = max(float(np.hypot(*rate_arcsec_s)), 1e-3)
    mean, spread = any_bend(speed) if bend is None else bend
    calm = parallel_of(direction_deg[1], np.array(rate_arcsec_s))
    bends = (calm, np.zeros(2), mean, mean)
    means = np.array([[0.0, 0.0, *rate_arcsec_s, *each] for each in bends])
    order = np.ix_([0, 2, 1, 3], [0, 2, 1, 3])
    covariances = np.zeros((len(MOTIONS), PER_MOTION, 6, 6))
    covariances[..., :4, :4] = np.asarray(covariance)[order]
    covariances[ANY_ORBIT:, :, GAIN:, GAIN:] = spread
    return replace(
        bank,
        plane=plane,
        means=np.repeat(means, PER_MOTION, axis=0),
        covariances=covariances.reshape(-1, 6, 6),
        unheard_rad=np.zeros(len(MOTIONS) * PER_MOTION),
    )


def of_one(  # noqa: PLR0917 -- all that one filter says
    plane: Plane,
    t_utc_ns: int,
    motion: FloatArray,
    covariance: FloatArray,
    motion_shares: Sequence[float],
    scatter_s: float,
    widening: float = 1.0,
) -> Bank:
    """A bank of which every filter has one motion (6,) and covariance (6, 6)."""
    every, known_s = len(MOTIONS) * PER_MOTION, scatters()
    nearest = int(np.argmin(np.abs(np.log(known_s / max(scatter_s, _LEAST_SCATTER_S)))))
    widest = int(np.argmin(np.abs(np.log(WIDENINGS / widening))))
    shares = np.full((len(MOTIONS), len(WIDENINGS), SCATTERS), _LEAST_SHARE)
    shares[:, widest, nearest] = np.maximum(motion_shares, _LEAST_SHARE)
    means, covariances = np.tile(motion, (every, 1)), np.tile(covariance, (every, 1, 1))
    calm = slice(0, ANY_ORBIT * PER_MOTION)
    means[calm, GAIN:] = covariances[calm, GAIN:, :] = covariances[calm, :, GAIN:] = 0.0
    return Bank(
        plane=plane,
        t_utc_ns=t_utc_ns,
        means=means,
        covariances=covariances,
        log_shares=np.log(shares.ravel()),
        scatters_s=known_s,
        unheard_rad=np.zeros(every),
    )


def scatter_interval_s(bank: Bank, share: float = 0.9) -> tuple[float, float, float]:
    """Median and both ends of the interval that holds so much of what is believed of the scatter.

    The shares are densities on a logarithmic scale: a parabola through the three likeliest,
    straight lines where the likeliest is at an end.
    """
    log_s, each = np.log(bank.scatters_s), bank.scatter_shares
    fine = np.linspace(log_s[0], log_s[-1], 40 * (SCATTERS - 1) + 1)
    logs, best = np.log(np.maximum(each, 1e-30)), int(np.argmax(each))
    told = np.interp(fine, log_s, logs)
    if 0 < best < SCATTERS - 1:
        near = slice(best - 1, best + 2)
        told = np.polyval(np.polyfit(log_s[near] - log_s[best], logs[near], 2), fine - log_s[best])
    density = np.exp(_TEMPERED * (told - told.max()))
    summed = np.cumsum(density)
    summed = summed / summed[-1]
    cuts = [0.5, 0.5 - share / 2.0, 0.5 + share / 2.0]
    median, low, high = np.exp(np.interp(cuts, summed, fine))
    # At the known scatter the likelihood is flat towards none.
    return float(median), 0.0 if each[0] > 0.05 else float(low), float(high)
