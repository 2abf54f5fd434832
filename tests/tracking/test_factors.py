"""The operator's factors on Q and R, by the law: filterpy's steps and scipy's Riccati equation."""

import functools
import itertools
from collections.abc import Iterator

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from scipy.linalg import solve_discrete_are

from rsoconsole.config import FACTORS, FilterConfig, Preset
from rsoconsole.records import FloatArray, Measurement, TrackState
from rsoconsole.tracking.filters import adaptive, bank, bank_update, estimator, lqe
from rsoconsole.tracking.filters.factors import noise_factors
from rsoconsole.tracking.filters.motions import ANY_ORBIT, motion_noise
from rsoconsole.tracking.filters.settled import Settled, TrackUpdate, settle
from rsoconsole.tracking.filters.sky_path import (
    ACCELERATION,
    plane_after,
    propagate_with_jacobian,
)
from tests.tracking.test_bank import ORBITS, measured

LEARNT, AFTER = 40, 60
CADENCE_S, SCATTER_S = 30.0, 0.03
DEC_DEG, RATE_ARCSEC_S = -5.0, 14.98
OWN = np.array([[0.05, 0.01], [0.01, 0.04]])
"""Covariance of each measurement without the shutter's scatter, arcsec^2."""
H = np.eye(2, 6)
HELD = FilterConfig(learning="off")


@functools.cache
def night(frames: int = LEARNT + AFTER) -> tuple[Measurement, ...]:
    """Constant rates in RA and Dec, as the likeliest motion of a slot has them."""
    random = np.random.default_rng(5)
    found = []
    for k in range(frames):
        late_s = random.normal(0.0, SCATTER_S)
        east, north = random.multivariate_normal(np.zeros(2), OWN)
        after_s = k * CADENCE_S + late_s
        cos_dec = np.cos(np.radians(DEC_DEG))
        found.append(
            Measurement(
                measurement_id=f"m{k}",
                frame_id=k,
                t_mid_utc_ns=round((1.8e9 + k * CADENCE_S) * 1e9),
                ra_icrs_deg=(40.0 + (RATE_ARCSEC_S * after_s + east) / 3600.0 / cos_dec) % 360.0,
                dec_icrs_deg=DEC_DEG + north / 3600.0,
                cov_sky_arcsec2=(OWN[0, 0], OWN[0, 1], OWN[1, 1]),
                x_px=0.0,
                y_px=0.0,
                confidence=0.9,
                source="network",
            )
        )
    return tuple(found)


def followed(
    before: FilterConfig,
    after: FilterConfig,
    frames: int = LEARNT + AFTER,
    places: tuple[Measurement, ...] = (),
) -> Iterator[TrackUpdate]:
    """Every update of a track whose settings change once it has learnt."""
    first, second, *others = places[:frames] or night(frames)
    state = estimator.initialise(first, second, before)
    for count, measurement in enumerate(others, 3):
        settings = before if count <= LEARNT else after
        predicted = estimator.predict(
            state, measurement.t_mid_utc_ns, settings, measurement.frame_id
        )
        state = estimator.update(predicted, measurement, settings)
        yield TrackUpdate(
            predicted=predicted, updated=state, measurement=measurement, settings=settings
        )


def last_of(before: FilterConfig, after: FilterConfig, frames: int = LEARNT + AFTER) -> TrackUpdate:
    return list(followed(before, after, frames))[-1]


@functools.cache
def learnt(preset: Preset = "adaptive") -> TrackUpdate:
    return list(followed(FilterConfig(preset=preset), FilterConfig(preset=preset), LEARNT))[-1]


def config(q: float = 1.0, r: float = 1.0, preset: Preset = "adaptive") -> FilterConfig:
    return FilterConfig(preset=preset, q_multiplier=q, r_multiplier=r)


def bank_of(state: TrackState) -> bank.Bank:
    return adaptive._bank_of(state)


def shown(last: TrackUpdate) -> FloatArray:
    """Sigmas of innovation and prediction (east, north), less what is common."""
    common = 0.0 if last.updated.mixture is None else adaptive.COMMON_ARCSEC
    place = np.diag(lqe.sky_covariance_arcsec2(last.predicted)) - common**2
    assert last.updated.sigma_innovation_arcsec is not None
    return np.array([*last.updated.sigma_innovation_arcsec, *np.sqrt(place)])


def forecast(settled: Settled) -> FloatArray:
    place = np.square(settled.sigma_predicted_arcsec) - adaptive.COMMON_ARCSEC**2
    return np.array([*settled.sigma_innovation_arcsec, *np.sqrt(np.maximum(place, 0.0))])


def one_step(last: TrackUpdate, settings: FilterConfig) -> tuple[bank.Bank, FloatArray, FloatArray]:
    """The bank predicted by a cadence, with F and Q of each filter as its motion has them."""
    now = bank_of(last.updated)
    t_utc_ns = now.t_utc_ns + round(CADENCE_S * 1e9)
    predicted = bank.predict(now, t_utc_ns, noise_factors(settings))
    onto = plane_after(now.plane, now.weights @ now.means, CADENCE_S)
    _, F = propagate_with_jacobian(now.plane, now.means, CADENCE_S, onto)
    Q = motion_noise(now.means, now.filter_motions, CADENCE_S, now.path_since_update_rad)
    return predicted, F, Q


@pytest.mark.parametrize(("q", "r"), [(1.0, 100.0), (100.0, 1.0), (0.01, 7.0), (1.0, 0.01)])
def test_every_member_steps_as_filterpy_does(q: float, r: float) -> None:
    settings, last = config(q, r), learnt()
    now = bank_of(last.updated)
    predicted, F, Q = one_step(last, settings)
    seen = bank.BankMeasurement(
        t_utc_ns=predicted.t_utc_ns,
        ra_icrs_deg=predicted.plane.direction_deg[0],
        dec_icrs_deg=predicted.plane.direction_deg[1],
        covariance=np.array([[0.09, 0.02], [0.02, 0.05]]),
    )
    found = bank_update.bank_innovation(predicted, seen, noise_factors(settings))
    each = bank_update.filter_updates(predicted.covariances, [found.with_length], [1.0])
    own = bank_update.expected_noise(predicted, seen)
    believed = np.flatnonzero(now.weights > 0.01)
    assert len(believed) >= 2
    for n in believed:
        kalman = KalmanFilter(dim_x=6, dim_z=2)
        kalman.H, kalman.P = H, now.covariances[n].copy()
        kalman.predict(F=F[n], Q=q * Q[n])
        sizes = np.outer(*2 * [np.sqrt(np.diag(kalman.P))])
        assert predicted.covariances[n] / sizes == pytest.approx(kalman.P / sizes, abs=1e-6)
        kalman.update(found.with_length.off[n], R=r * own[n])
        assert found.with_length.s[n] == pytest.approx(kalman.S, rel=1e-6)
        assert each.covariances[n] / sizes == pytest.approx(kalman.P / sizes, abs=1e-6)
        assert each.steps[n] == pytest.approx(kalman.x[:, 0], rel=1e-5, abs=1e-12)


@pytest.mark.parametrize(("q", "r"), [(100.0, 1.0), (1.0, 100.0), (1.0, 0.01), (0.01, 1.0)])
def test_bounds_move_as_the_riccati_equation_says(q: float, r: float) -> None:
    settings = config(q, r)
    plain, changed = last_of(config(), HELD), last_of(config(), settings)

    def law(last: TrackUpdate, factor_q: float, factor_r: float) -> FloatArray:
        likeliest = int(np.argmax(bank_of(last.updated).weights))
        predicted, F, Q = one_step(last, config())
        own = bank_update.expected_noise(predicted, adaptive._position(last.measurement))
        size = ACCELERATION if bank_of(last.updated).filter_motions[likeliest] < ANY_ORBIT else 6
        F, Q = F[likeliest, :size, :size], factor_q * Q[likeliest, :size, :size]
        R = factor_r * own[likeliest]
        P = solve_discrete_are(F.T, H[:, :size].T, Q, R)
        S = P[:2, :2] + R
        return np.sqrt(np.array([*np.diag(S), *np.diag(P)[:2], *np.diag(P[:2, :2] / S)]))

    moved = shown(changed) / shown(plain)
    expected = law(changed, q, r) / law(plain, 1.0, 1.0)
    assert noise_factors(settings).is_held
    assert moved == pytest.approx(expected[:4], rel=0.05)


@pytest.mark.parametrize("factor", [0.25, 9.0, 100.0])
def test_the_same_factor_on_both_scales_bounds_and_leaves_the_gain(factor: float) -> None:
    frames = LEARNT + 2 * AFTER
    plain = last_of(config(), HELD, frames)
    changed = last_of(config(), config(factor, factor), frames)
    assert shown(changed) == pytest.approx(np.sqrt(factor) * shown(plain), rel=0.01)

    def gain(last: TrackUpdate) -> FloatArray:
        after, before = (bank_of(state) for state in (last.updated, last.predicted))
        return after.covariances[0, :2, :2] / before.covariances[0, :2, :2]

    assert gain(changed) == pytest.approx(gain(plain), rel=0.01)


def test_what_was_learnt_of_the_noise_is_held_while_a_factor_is_not_1() -> None:
    before = bank_of(learnt().updated)
    after = bank_of(last_of(config(), config(r=0.01)).updated)
    assert after.variance_scale_probabilities == pytest.approx(
        before.variance_scale_probabilities, abs=1e-6
    )
    assert after.scatter_probabilities == pytest.approx(before.scatter_probabilities, abs=1e-6)
    freed = config(r=0.01).model_copy(update={"learning": "on"})
    widened = bank_of(last_of(config(), freed).updated)
    assert widened.variance_scale > 3.0 * before.variance_scale


def test_a_track_begun_with_factors_learns_the_noise_as_one_without() -> None:
    begun = last_of(config(4.0, 0.01), config(4.0, 0.01), bank.UPDATES_TO_LEARN)
    plain = last_of(config(), config(), bank.UPDATES_TO_LEARN)
    kinds = [bank_of(each.updated).weights.reshape(4, -1).sum(axis=0) for each in (begun, plain)]
    assert kinds[0] == pytest.approx(kinds[1], abs=1e-6)


PRESETS: tuple[Preset, ...] = ("adaptive", "tuned", "paper")
CASES = [
    (preset, q, r)
    for preset, (q, r) in itertools.product(
        PRESETS, [(0.01, 1.0), (100.0, 1.0), (1.0, 0.01), (1.0, 100.0), (10.0, 0.1)]
    )
]


@pytest.mark.parametrize(("preset", "q", "r"), CASES)
def test_bounds_settle_where_and_when_the_forecast_says(preset: Preset, q: float, r: float) -> None:
    settings = config(q, r, preset)
    said = settle(learnt(preset), settings, CADENCE_S)
    last = last_of(FilterConfig(preset=preset), settings, LEARNT + min(said.updates, 400))
    if preset != "adaptive":
        expected = np.array([*said.sigma_innovation_arcsec, *said.sigma_predicted_arcsec])
        assert shown(last) == pytest.approx(expected, rel=0.1)
        return
    leads = [bank_of(each.updated).motion_probabilities for each in (learnt(), last)]
    if leads[1][np.argmax(leads[0])] > 0.9:
        assert shown(last) == pytest.approx(forecast(said), rel=0.2)
    else:
        assert (q, r) in {(0.01, 1.0), (1.0, 0.01), (10.0, 0.1)}, "only what contradicts the sky"


def test_factors_are_all_multipliers_and_only_they() -> None:
    assert len(FACTORS) == 8
    for name in FACTORS:
        assert FilterConfig(**{name: 2.0}).is_noise_held
    assert not FilterConfig(sigma_arcsec=2.0, q_arcsec2_s3=1e-4).is_noise_held


@pytest.mark.nightly("random orbits, presets and factors")
def test_on_random_orbits_bounds_settle_where_the_forecast_says() -> None:
    """Places by SGP4; a motion that another one replaces under the factors does not count."""
    random, flips, draws = np.random.default_rng(1), 0, 20
    for _ in range(draws):
        preset = PRESETS[int(random.integers(len(PRESETS)))]
        q, r = (10.0 ** random.uniform(-2.0, 2.0, 2)).tolist()
        scatter_s, seed = float(10.0 ** random.uniform(-2.3, -1.0)), int(random.integers(10**6))
        places = tuple(measured(str(random.choice(list(ORBITS))), scatter_s, seed, 240))
        before, after = FilterConfig(preset=preset), config(q, r, preset)
        last = list(followed(before, after, LEARNT, places))[-1]
        said = settle(last, after, CADENCE_S)
        end = list(followed(before, after, min(LEARNT + said.updates, 240), places))[-1]
        if preset == "adaptive":
            leads = [bank_of(each.updated).motion_probabilities for each in (last, end)]
            if leads[1][np.argmax(leads[0])] < 0.9:
                flips += 1
                continue
        near = 0.2 if preset == "adaptive" else 0.1
        assert end.updated.sigma_innovation_arcsec == pytest.approx(
            said.sigma_innovation_arcsec, rel=near
        ), f"{preset}, Q x {q:.3g}, R x {r:.3g}, seed {seed}"
    assert flips < draws / 4
