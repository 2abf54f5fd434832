"""Preset ``adaptive``: the track as the mixture of a bank of filters (``bank``). Pure.

The state on record is the mixture's mean and covariance, as of one filter; the bank itself is
attached in memory. A state read from a session has no bank: one is made from the record.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rsoconsole.config import FilterConfig
from rsoconsole.records import FloatArray, Measurement, Mixture, TrackState
from rsoconsole.tracking.filters import bank as banks
from rsoconsole.tracking.filters import bank_update, lqe
from rsoconsole.tracking.filters.agreement import streak_axis
from rsoconsole.tracking.filters.bank import Bank, BankMeasurement
from rsoconsole.tracking.filters.bank_update import BankInnovation
from rsoconsole.tracking.filters.factors import NO_FACTORS, NoiseFactors, noise_factors
from rsoconsole.tracking.filters.motions import MOTION_PRIORS, MOTIONS, unknown_bend_prior
from rsoconsole.tracking.filters.sky_path import ACCELERATION, TURN, VX, VY, TangentPlane
from rsoconsole.tracking.filters.streak_length import NO_ERRORS, StreakErrors

_TEMPERED = 0.65
"""Power of the likelihood by which intervals hold as stated (measured on SGP4's orbits)."""


def scatter_interval_s(bank: Bank, share: float = 0.9) -> tuple[float, float, float]:
    """Return median, low and high end, s, of a bank's timing scatter.

    The interval holds ``share`` of its probability. Between the scatters of the grid, the log
    density over the logarithm of the scatter is a parabola through the three likeliest ones, or
    straight lines where the likeliest is at an end of the grid.
    """
    log_s, each = np.log(bank.grid.scatters_s), bank.scatter_probabilities
    fine = np.linspace(log_s[0], log_s[-1], 40 * (len(log_s) - 1) + 1)
    logs, best = np.log(np.maximum(each, 1e-30)), int(np.argmax(each))
    fitted = np.interp(fine, log_s, logs)
    if 0 < best < len(log_s) - 1:
        before, after = log_s[best - 1] - log_s[best], log_s[best + 1] - log_s[best]
        down, up = (logs[best - 1] - logs[best]) / before, (logs[best + 1] - logs[best]) / after
        bend = (up - down) / (after - before)
        off = fine - log_s[best]
        fitted = logs[best] + off * (down - bend * before + bend * off)
    density = np.exp(_TEMPERED * (fitted - fitted.max()))
    summed = np.cumsum(density)
    summed = summed / summed[-1]
    cuts = [0.5, 0.5 - share / 2.0, 0.5 + share / 2.0]
    median, low, high = np.exp(np.interp(cuts, summed, fine))
    # At the known scatter the likelihood is flat towards none.
    return float(median), 0.0 if each[0] > 0.05 else float(low), float(high)


_WORTH_REPORTING = 1.5
_MAX_CORRELATED = 0.99999
_RECORD_ORDER = np.ix_([0, 2, 1, 3], [0, 2, 1, 3])
"""Swaps the order of a motion (both places, both rates) and that of a state on record."""

COMMON_ARCSEC = 0.2
"""Sigma on each axis of the error common to a night's directions, arcsec; not in the filters."""
Bend = tuple[FloatArray, FloatArray]
"""Bend of a path: mean (2,) and covariance (2, 2) of change of speed (arcsec/s^2) and turn."""


def initialise(
    first: Measurement,
    second: Measurement,
    settings: FilterConfig,
    *,
    track_id: int = 1,
    bend: Bend | None = None,
    along_arcsec: tuple[float, float] = (0.0, 0.0),
    is_shutter_known: bool = False,
) -> TrackState:
    """Initiate a track at the second of two measurements.

    ``bend``: possible bend of an orbit's path through the first. ``along_arcsec``: sigma along the
    motion that the length of each streak indicates. ``is_shutter_known``: see ``bank.initiate``.
    Raises ValueError when the second is not the later one.
    """
    dt_s = lqe.time_between_s(first, second)
    one = _position(first, StreakErrors(along_arcsec[0]))
    two = _position(second, StreakErrors(along_arcsec[1]))
    way = TangentPlane.at(one.ra_icrs_deg, one.dec_icrs_deg).project_arcsec(
        two.ra_icrs_deg, two.dec_icrs_deg
    )
    rate = (float(way[0]) / dt_s, float(way[1]) / dt_s)
    factors = noise_factors(settings)

    def begun(with_factors: NoiseFactors) -> Bank:
        return banks.initiate_bank(
            one, rate, bend, is_shutter_known=is_shutter_known, factors=with_factors
        )

    bank = begun(factors)
    if factors.is_held:
        bank = replace(bank, learning=begun(NO_FACTORS))
    bank = bank_update.update(banks.predict(bank, two.t_utc_ns, factors), two, factors).after
    return _state(bank, along_arcsec[1], **lqe.first_state_fields(first, second, track_id))


def predict(state: TrackState, t_utc_ns: int, settings: FilterConfig, frame_id: int) -> TrackState:
    """Predict the track to another instant, for the frame ``frame_id``."""
    known = None
    if isinstance(state.memory, _Memory) and state.memory.x == state.x and state.mixture:
        said = state.mixture  # no prediction changes what is believed of scatter
        known = (said.scatter_s, said.scatter_low_s, said.scatter_high_s)
    return _state(
        banks.predict(_bank_of(state), t_utc_ns, noise_factors(settings)),
        scatter_s=known,
        **lqe.next_state_fields(state, frame_id, misses=state.misses + 1),
    )


def predict_motion(
    state: TrackState, t_utc_ns: int
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the direction (ICRS, deg) and rate (arcsec/s) that `predict` has, in less time."""
    plane, mean = banks.predict_mean(_bank_of(state), t_utc_ns)
    x, y, *rate = mean[: VY + 1].tolist()
    return plane.direction_of(x, y), (rate[0], rate[1])


def innovations(
    predicted: TrackState,
    measured: Sequence[tuple[Measurement, StreakErrors]],
    settings: FilterConfig,
) -> list[BankInnovation]:
    """Return the innovations of measurements at the predicted instant, before any update.

    Each measurement comes with the errors that its streak's shape indicates. An update needs one of
    the results.
    """
    positions = [_position(m, errors) for m, errors in measured]
    return bank_update.bank_innovations(_bank_of(predicted), positions, noise_factors(settings))


def update_with_innovation(
    predicted: TrackState,
    measurement: Measurement,
    found: BankInnovation,
    along_arcsec: float = 0.0,
) -> TrackState:
    """Update the track with a measurement whose innovation is computed already.

    ``along_arcsec``: error along the streak that its length indicates, for the record.
    """
    said = bank_update.update_from_innovation(found)
    sigma = np.sqrt(np.diag(said.covariance))
    fields = lqe.updated_state_fields(predicted, measurement, said.nis, said.innovation, sigma)
    return _state(said.after, along_arcsec, said.covariance, **fields)


def restart_from_prediction(
    direction_deg: tuple[float, float],
    rate_arcsec_s: tuple[float, float],
    covariance: FloatArray,
    frame_id: int,
    failed: TrackState,
) -> TrackState:
    """Restart the bank from another prediction of the track, at the same instant.

    ``failed``: the track as the bank predicted it. ``covariance``: (4, 4) of east, its rate, north,
    its rate, in arcsec and arcsec/s. The learnt scatter and bend of the path stay.
    """
    before = _bank_of(failed)
    mean, spread = before.moments()
    bend = (mean[ACCELERATION:], spread[ACCELERATION:, ACCELERATION:])
    return _state(
        banks.restarted_bank(before, direction_deg, rate_arcsec_s, covariance, bend),
        **lqe.next_state_fields(failed, frame_id, foretold_by="orbit"),
    )


def with_coarse_bank(state: TrackState) -> TrackState:
    """Return the track with fewer filters in its bank, for less work; its record stays."""
    if not isinstance(state.memory, _Memory) or state.memory.x != state.x:
        return state
    return replace(state, memory=replace(state.memory, bank=banks.coarse_bank(state.memory.bank)))


def log_det_innovation(
    predicted: TrackState, measurement: Measurement, settings: FilterConfig
) -> float:
    """Return the natural log of the determinant of the innovation covariance (in arcsec^4)."""
    factors = noise_factors(settings)
    found = bank_update.bank_innovation(_bank_of(predicted), _position(measurement), factors)
    return float(np.linalg.slogdet(bank_update.innovation_covariance_of(found))[1])


def _position(measurement: Measurement, errors: StreakErrors = NO_ERRORS) -> BankMeasurement:
    noise = lqe.own_noise(measurement) * lqe.ARCSEC_PER_DEG**2
    # An ellipse whatever a file may claim: what is more than correlated has no density.
    most = _MAX_CORRELATED * math.sqrt(noise[0, 0] * noise[1, 1])
    noise[0, 1] = noise[1, 0] = min(max(noise[0, 1], -most), most)
    cos_dec = max(math.cos(math.radians(measurement.dec_icrs_deg)), 1e-3)
    to_sky = np.array([cos_dec, 1.0])
    covariance = noise * to_sky[:, None] * to_sky
    axis = streak_axis(measurement) if any(errors) else None
    if errors.across_arcsec and axis is not None:
        left = np.array([-axis[1], axis[0]])
        covariance += errors.across_arcsec**2 * np.outer(left, left)
    return BankMeasurement(
        t_utc_ns=measurement.t_mid_utc_ns,
        ra_icrs_deg=measurement.ra_icrs_deg,
        dec_icrs_deg=measurement.dec_icrs_deg,
        covariance=covariance,
        along_arcsec=errors.along_arcsec,
        axis=axis,
    )


def _bank_of(state: TrackState) -> Bank:
    if isinstance(state.memory, _Memory) and state.memory.x == state.x:
        return state.memory.bank
    return bank_from_record(state)


@dataclass(frozen=True, slots=True)
class _Memory:
    """Bank of a state, and that state itself: a state made in another way has none."""

    bank: Bank
    x: tuple[float, float, float, float]
    innovation_covariance: FloatArray | None = None
    """(2, 2) innovation covariance of the update that made it, arcsec^2."""


def bank_from_record(state: TrackState) -> Bank:
    """Make a bank that agrees with a recorded state."""
    cos_dec = max(math.cos(math.radians(state.x[2])), 1e-3)
    to_sky = np.array([cos_dec, 1.0, cos_dec, 1.0]) * lqe.ARCSEC_PER_DEG
    said = state.mixture
    motion = np.zeros(6)
    motion[VX], motion[VY] = state.x[1] * to_sky[2], state.x[3] * to_sky[3]
    covariance = np.zeros((6, 6))
    covariance[:4, :4] = np.array(state.P)[_RECORD_ORDER] * np.outer(to_sky, to_sky)
    own = covariance[:4, :4] - np.diag([COMMON_ARCSEC**2, COMMON_ARCSEC**2, 0.0, 0.0])
    if np.all(np.linalg.eigvalsh(own) > 0.0):  # another preset's knows nothing of what is common
        covariance[:4, :4] = own
    weights, scatter_s, variance_scale = list(MOTION_PRIORS), 0.0, 1.0
    if said is None:
        covariance[ACCELERATION:, ACCELERATION:] = unknown_bend_prior(
            math.hypot(*motion[VX : VY + 1])
        )[1]
    else:
        motion[ACCELERATION], motion[TURN] = said.acceleration_arcsec_s2, said.turn
        covariance[ACCELERATION, ACCELERATION] = said.acceleration_sigma_arcsec_s2**2
        covariance[TURN, TURN] = said.turn_sigma**2
        known = dict(said.motion_probabilities)
        weights = [known.get(name, 0.0) for name in MOTIONS]
        scatter_s, variance_scale = said.scatter_s, said.variance_scale
    plane = TangentPlane.at(state.x[0], state.x[2])
    return banks.bank_of_equal_filters(
        plane, state.t_utc_ns, motion, covariance, weights, scatter_s, variance_scale
    )


def innovation_covariance(updated: TrackState) -> FloatArray:
    """Return the innovation covariance (2, 2), arcsec^2 on the sky, of the update of a state.

    It is in memory only. Raises ValueError for a state that is not directly from an update.
    """
    memory = updated.memory
    if not isinstance(memory, _Memory) or memory.innovation_covariance is None:
        raise ValueError("only a state that an update of preset adaptive has just made tells that")
    return memory.innovation_covariance


def _state(
    bank: Bank,
    along_arcsec: float = 0.0,
    innovation_covariance: FloatArray | None = None,
    scatter_s: tuple[float, float, float] | None = None,
    **further: Any,
) -> TrackState:
    mean, covariance = bank.moments()
    ra, dec = bank.plane.direction_of(float(mean[0]), float(mean[1]))
    cos_dec = max(math.cos(math.radians(dec)), 1e-3)
    to_deg = np.array([1.0 / cos_dec, 1.0 / cos_dec, 1.0, 1.0]) / lqe.ARCSEC_PER_DEG
    on_sky = covariance[:4, :4].copy()
    on_sky[0, 0] += COMMON_ARCSEC**2
    on_sky[1, 1] += COMMON_ARCSEC**2
    P = on_sky[_RECORD_ORDER] * to_deg[:, None] * to_deg
    median, low, high = scatter_s or scatter_interval_s(bank)
    x = (ra, float(mean[VX] * to_deg[0]), dec, float(mean[VY] * to_deg[2]))
    return TrackState(
        t_utc_ns=bank.t_utc_ns,
        x=x,
        P=tuple(map(tuple, ((P + P.T) / 2.0).tolist())),
        mixture=Mixture(
            motion_probabilities=tuple(
                zip(MOTIONS, bank.motion_probabilities.tolist(), strict=True)
            ),
            acceleration_arcsec_s2=float(mean[ACCELERATION]),
            acceleration_sigma_arcsec_s2=math.sqrt(
                max(covariance[ACCELERATION, ACCELERATION], 0.0)
            ),
            turn=float(mean[TURN]),
            turn_sigma=math.sqrt(max(covariance[TURN, TURN], 0.0)),
            scatter_s=median,
            scatter_low_s=low,
            scatter_high_s=high,
            variance_scale=bank.variance_scale,
            along_arcsec=along_arcsec,
        ),
        memory=_Memory(bank, x, innovation_covariance),
        **further,
    )


def timing_scatter_words(state: TrackState, known_s: float) -> str | None:
    """Return the text of a track's learnt scatter along its motion; None: no bank.

    ``known_s``: timing scatter that the measurements' covariances contain already. The text calls
    the scatter a time only "if it is the shutter": a badly found end of a streak looks the same.
    """
    if state.mixture is None:
        return None
    said = state.mixture
    speed = math.hypot(*lqe.sky_rate_arcsec_s(state))
    every = (said.scatter_s, said.scatter_low_s, said.scatter_high_s)
    median, low, high = (math.hypot(each, known_s) for each in every)
    return (
        f"along-track scatter {median * speed:.1f} arcsec ({median:.2g} s if it is the shutter,"
        f" {low:.2g} to {high:.2g} s at 90 %)"
    )


def filter_summary_words(state: TrackState | None, known_s: float) -> str:
    """Text of the likeliest motion and timing scatter, short enough for a narrow screen.

    Empty where there is no bank. ``known_s``: as in `timing_scatter_words`.
    """
    if state is None or state.mixture is None:
        return ""
    name, share = max(state.mixture.motion_probabilities, key=lambda each: each[1])
    speed = math.hypot(*lqe.sky_rate_arcsec_s(state))
    scatter_s = math.hypot(state.mixture.scatter_s, known_s)
    wider = math.sqrt(state.mixture.variance_scale)
    errors = f", errors ×{wider:.1f}" if wider >= _WORTH_REPORTING else ""
    timing = f"timing ±{scatter_s:.2g} s = {scatter_s * speed:.1f}″"
    return f"motion {name} {share:.0%}, {timing}{errors}"


def with_learned_errors(
    taken: Sequence[Measurement], scatter_s: float, variance_scale: float = 1.0
) -> tuple[Measurement, ...]:
    """Return a track's measurements with the learnt errors in their covariances.

    ``scatter_s``: timing scatter, applied along the motion between each measurement and the nearest
    in time. ``variance_scale``: factor on the measurements' own variances.
    """
    if len(taken) < 2 or (scatter_s <= 0.0 and variance_scale == 1.0):
        return tuple(taken)
    last, errors = len(taken) - 1, (scatter_s, variance_scale)
    others = [
        _nearer(m, taken[max(n - 1, 0)], taken[min(n + 1, last)]) for n, m in enumerate(taken)
    ]
    return tuple(_scattered(*pair, errors) for pair in zip(taken, others, strict=True))


def _nearer(measurement: Measurement, before: Measurement, after: Measurement) -> Measurement:
    """Return the nearer of its two neighbours in time; at an end one of them is itself."""
    since_ns = measurement.t_mid_utc_ns - before.t_mid_utc_ns
    until_ns = after.t_mid_utc_ns - measurement.t_mid_utc_ns
    return after if since_ns <= 0 or 0 < until_ns < since_ns else before


def _scattered(
    measurement: Measurement, other: Measurement, learnt: tuple[float, float]
) -> Measurement:
    span_s = (other.t_mid_utc_ns - measurement.t_mid_utc_ns) / 1e9
    if span_s == 0.0:
        return measurement
    plane = TangentPlane.at(measurement.ra_icrs_deg, measurement.dec_icrs_deg)
    way = plane.project_arcsec(other.ra_icrs_deg, other.dec_icrs_deg) / span_s * learnt[0]
    east, north = float(way[0]), float(way[1])
    ee, en, nn = (learnt[1] * each for each in measurement.cov_sky_arcsec2)
    if not (ee > 0.0 and nn > 0.0 and ee * nn > en * en):
        return measurement  # what is no direction does not become one
    return replace(measurement, cov_sky_arcsec2=(ee + east**2, en + east * north, nn + north**2))
