"""The filter against the published figures, against batch least squares and against itself."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rsoconsole.config import FilterConfig
from rsoconsole.records import Measurement, TrackState
from rsoconsole.tracking.filters import lqe

T0 = 1_687_406_400_000_000_000
CADENCE_S = 30.0
PAPER = FilterConfig(preset="paper")
TUNED = FilterConfig(preset="tuned")


def measurement(
    k: int, ra_deg: float, dec_deg: float, sigma_arcsec: float = 4.0, dt_s: float = CADENCE_S
) -> Measurement:
    return Measurement(
        measurement_id=f"{k}-0",
        frame_id=k,
        t_mid_utc_ns=T0 + round(k * dt_s * 1e9),
        ra_icrs_deg=ra_deg % 360.0,
        dec_icrs_deg=dec_deg,
        cov_sky_arcsec2=(sigma_arcsec**2, 0.0, sigma_arcsec**2),
        x_px=0.0,
        y_px=0.0,
        confidence=1.0,
        source="network",
    )


def straight(n: int, ra0_deg: float = 120.0, dec_deg: float = -5.0) -> list[Measurement]:
    rate = 15.04 / 3600
    return [measurement(k, ra0_deg + rate * CADENCE_S * k, dec_deg) for k in range(n)]


def run(
    measurements: list[Measurement], config: FilterConfig
) -> list[tuple[TrackState, TrackState]]:
    """(predicted, updated) for every measurement after the first two."""
    state = lqe.initialise(measurements[0], measurements[1], config)
    pairs = []
    for m in measurements[2:]:
        predicted = lqe.predict(state, m.t_mid_utc_ns, config, m.frame_id)
        state = lqe.update(predicted, m, config)
        pairs.append((predicted, state))
    return pairs


def three_sigma_arcsec(state: TrackState) -> tuple[float, float]:
    return 3 * 3600 * math.sqrt(state.P[0][0]), 3 * 3600 * math.sqrt(state.P[2][2])


def position_gain(
    predicted: TrackState, m: Measurement, config: FilterConfig
) -> tuple[float, float]:
    P, R = np.array(predicted.P), lqe.measurement_noise(m, config)
    S = lqe.C @ P @ lqe.C.T + R
    L = P @ lqe.C.T @ np.linalg.inv(S)
    return L[0, 0], L[2, 1]


def test_paper_preset_has_the_published_bounds_and_gain():
    measurements = straight(60)
    predicted, updated = run(measurements, PAPER)[-1]
    assert three_sigma_arcsec(updated) == pytest.approx((17.0, 12.0), abs=0.06)
    assert three_sigma_arcsec(predicted) == pytest.approx((8608, 1104), rel=1e-3)
    gain_ra, gain_dec = position_gain(predicted, measurements[-1], PAPER)
    assert 1 - gain_ra == pytest.approx(4e-6, abs=0.5e-6)
    assert gain_dec == pytest.approx(0.9999, abs=0.5e-4)


def test_paper_preset_starts_from_the_identity_and_its_q_is_as_written():
    state = lqe.initialise(*straight(2), PAPER)
    assert np.array_equal(state.P, np.eye(4))
    sigma = 4 / 3600
    expected = np.diag([500 * sigma, sigma / 100, sigma / 5, sigma / 100])
    assert lqe.process_noise(30.0, 40.0, PAPER) == pytest.approx(expected)
    assert lqe.measurement_noise(straight(1)[0], PAPER) == pytest.approx(
        np.diag([2 * sigma**2, sigma**2])
    )


def test_transition_is_the_matrix_exponential():
    from scipy.linalg import expm

    A = np.zeros((4, 4))
    A[0, 1] = A[2, 3] = 1.0
    assert lqe.transition_matrix(17.3) == pytest.approx(expm(A * 17.3))


def noisy_line(seed: int, n: int, sigma_arcsec: float, dec_deg: float = 35.0) -> list[Measurement]:
    """A satellite that stands on RA 0h in its fifth frame, so that noise falls on either side."""
    rng = np.random.default_rng(seed)
    noise = rng.normal(0, sigma_arcsec / 3600, (n, 2))
    cos_dec = math.cos(math.radians(dec_deg))
    return [
        measurement(
            k,
            15.04 / 3600 * CADENCE_S * (k - 4) + noise[k, 0] / cos_dec,
            dec_deg + noise[k, 1],
            sigma_arcsec,
        )
        for k in range(n)
    ]


def test_tuned_filter_without_process_noise_is_batch_least_squares():
    measurements = noisy_line(1, 25, 4.0)
    config = FilterConfig(q_arcsec2_s3=1e-12, q_multiplier=1e-6)
    _, last = run(measurements, config)[-1]
    t = np.array([(m.t_mid_utc_ns - last.t_utc_ns) / 1e9 for m in measurements])
    ra = np.unwrap([m.ra_icrs_deg for m in measurements], period=360.0)
    for i, angles in ((0, ra), (2, np.array([m.dec_icrs_deg for m in measurements]))):
        design = np.stack([np.ones_like(t), t], axis=1)
        fit = np.linalg.lstsq(design, angles, rcond=None)[0]
        milliarcsec = 1e-3 / 3600
        assert (last.x[i] - fit[0] + 180) % 360 - 180 == pytest.approx(0, abs=milliarcsec)
        assert last.x[i + 1] == pytest.approx(fit[1], abs=milliarcsec / 30)
        sigma = 4 / 3600 / (math.cos(math.radians(35)) if i == 0 else 1)
        cov = np.linalg.inv(design.T @ design) * sigma**2
        # The cosine is taken at each measured declination, so to a part in a thousand.
        assert np.array(last.P)[i : i + 2, i : i + 2] == pytest.approx(cov, rel=1e-3)


def test_tuned_filter_is_consistent_on_noise_it_was_told_of():
    nis = [
        state.nis
        for seed in range(12)
        for _, state in run(noisy_line(seed, 30, 1.0), FilterConfig(q_arcsec2_s3=1e-9))
    ]
    # 336 samples of mean 2, standard deviation 2: three standard errors are 0.33.
    assert np.mean(nis) == pytest.approx(2.0, abs=0.33)


def test_nis_tells_when_the_noise_is_larger_than_told():
    measurements = [
        measurement(m.frame_id, m.ra_icrs_deg, m.dec_icrs_deg, 1.0) for m in noisy_line(3, 60, 4.0)
    ]
    assert np.mean([state.nis for _, state in run(measurements, TUNED)]) > 5


@settings(max_examples=60, deadline=None)
@given(shift_deg=st.floats(-720, 720), dec_deg=st.floats(-80, 80), seed=st.integers(0, 50))
def test_shifting_right_ascension_changes_nothing_else(shift_deg, dec_deg, seed):
    plain = noisy_line(seed, 6, 4.0, dec_deg)
    shifted = [measurement(m.frame_id, m.ra_icrs_deg + shift_deg, m.dec_icrs_deg) for m in plain]
    for config in (TUNED, PAPER):
        for (_, a), (_, b) in zip(run(plain, config), run(shifted, config), strict=True):
            assert 0 <= b.x[0] < 360
            assert (b.x[0] - a.x[0] - shift_deg + 180) % 360 - 180 == pytest.approx(0, abs=1e-9)
            assert b.x[1:] == pytest.approx(a.x[1:], abs=1e-11)
            assert b.nis == pytest.approx(a.nis, rel=1e-5, abs=1e-9)
            assert b.innovation_arcsec == pytest.approx(a.innovation_arcsec, abs=1e-6)
            assert np.array(b.P) == pytest.approx(np.array(a.P))


@given(cut=st.floats(1, 59), dec_deg=st.floats(-80, 80))
@settings(max_examples=25, deadline=None)
def test_predicting_in_two_steps_is_predicting_in_one(cut, dec_deg):
    # Dec stands still: the noise in RA follows the declination at each step's start.
    state = lqe.initialise(*straight(2, dec_deg=dec_deg), TUNED)
    end = state.t_utc_ns + 60_000_000_000
    once = lqe.predict(state, end, TUNED, 2)
    half = lqe.predict(state, state.t_utc_ns + round(cut * 1e9), TUNED, 2)
    twice = lqe.predict(half, end, TUNED, 3)
    assert twice.x == pytest.approx(once.x, abs=1e-10)
    assert np.array(twice.P) == pytest.approx(np.array(once.P))


def test_misses_count_until_a_measurement_comes():
    measurements = straight(8)
    state = lqe.initialise(*measurements[:2], TUNED)
    for k in (2, 3, 4):
        state = lqe.predict(state, measurements[k].t_mid_utc_ns, TUNED, k)
        assert (state.kind, state.misses, state.nis) == ("predicted", k - 1, None)
    state = lqe.predict(state, measurements[5].t_mid_utc_ns, TUNED, 5)
    state = lqe.update(state, measurements[5], TUNED)
    assert (state.kind, state.misses) == ("updated", 0)


def test_coast_bounds_of_a_calm_target_grow_no_faster_than_with_a_fixed_noise():
    # With q fixed, measured: 0.4' after 3 min, 1.7' after 10, 7.6' after 30, 26' after 70.
    # What the filter has learnt of a calm target narrows the start of a coast, not its later part.
    _, state = run(straight(60), TUNED)[-1]
    for minutes, bound_arcmin in ((3, 0.4), (10, 1.7), (30, 7.6), (70, 26.0)):
        ahead = lqe.predict(state, state.t_utc_ns + minutes * 60 * 10**9, TUNED, 99)
        sigma = math.sqrt(lqe.sky_covariance_arcsec2(ahead)[1, 1])
        assert 0.5 * bound_arcmin < 3 * sigma / 60 < 1.05 * bound_arcmin


def test_one_missed_frame_forgets_nothing_and_a_long_coast_all():
    measurements = straight(30)
    _, state = run(measurements, TUNED)[-1]
    assert state.q_scale < 0.1
    assert state.innovations == 28

    def sigma_after(*steps_s: float) -> float:
        ahead, t = state, state.t_utc_ns
        for k, step_s in enumerate(steps_s):
            t += round(step_s * 1e9)
            ahead = lqe.predict(ahead, t, TUNED, 30 + k)
        return math.sqrt(lqe.sky_covariance_arcsec2(ahead)[1, 1])

    assert sigma_after(CADENCE_S, CADENCE_S) == pytest.approx(sigma_after(2 * CADENCE_S), rel=1e-3)
    full_q_arcsec = math.sqrt(1e-5 * 300**3 / 3)
    assert sigma_after(300.0) > full_q_arcsec
    assert sigma_after(*[CADENCE_S] * 10) > 0.8 * full_q_arcsec * (1 - 120 / 300) ** 1.5


def test_right_ascension_widens_with_declination_and_the_sky_does_not():
    low, high = (run(straight(30, dec_deg=dec), TUNED)[-1][1] for dec in (0.0, 60.0))
    assert high.P[0][0] == pytest.approx(4 * low.P[0][0], rel=1e-6)
    assert lqe.sky_covariance_arcsec2(high) == pytest.approx(lqe.sky_covariance_arcsec2(low))


def test_multipliers_scale_q_and_r_of_both_presets():
    m = straight(1)[0]
    for preset in ("paper", "tuned"):
        one = FilterConfig(preset=preset)
        more = FilterConfig(preset=preset, q_multiplier=5.0, r_multiplier=3.0)
        assert lqe.process_noise(30.0, 10.0, more) == pytest.approx(
            5 * lqe.process_noise(30.0, 10.0, one)
        )
        assert lqe.measurement_noise(m, more) == pytest.approx(3 * lqe.measurement_noise(m, one))


@pytest.mark.parametrize("preset", ["paper", "tuned"])
def test_a_term_of_the_diagonal_is_scaled_alone_and_leaves_correlations(preset):
    m = straight(1)[0]
    one = FilterConfig(preset=preset)
    names = ("q_ra", "q_ra_rate", "q_dec", "q_dec_rate")
    before = lqe.process_noise(30.0, 10.0, one)
    for term, name in enumerate(names):
        more = one.model_copy(update={f"{name}_multiplier": 4.0})
        after = lqe.process_noise(30.0, 10.0, more)
        expected = np.ones(4)
        expected[term] = 4.0
        assert np.diag(after) == pytest.approx(np.diag(before) * expected)
        assert np.linalg.eigvalsh(after).min() >= -1e-12 * np.trace(after)
        assert after == pytest.approx(after.T)
    wide = one.model_copy(update={"r_dec_multiplier": 9.0})
    ratio = np.diag(lqe.measurement_noise(m, wide)) / np.diag(lqe.measurement_noise(m, one))
    assert ratio == pytest.approx([1.0, 9.0])


def test_no_measurement_is_trusted_beyond_the_floor():
    R = lqe.measurement_noise(measurement(0, 10.0, 0.0, sigma_arcsec=0.01), TUNED)
    assert np.sqrt(np.diag(R)) * 3600 == pytest.approx([0.10, 0.10])


def test_gate_refuses_what_is_three_sigma_off_and_takes_what_is_two():
    assert lqe.is_gated_out(11.84, TUNED)
    assert not lqe.is_gated_out(11.82, TUNED)
    measurements = straight(20)
    state = lqe.initialise(*measurements[:2], TUNED)
    m = measurements[2]
    predicted = lqe.predict(state, m.t_mid_utc_ns, TUNED, 2)
    sigma = math.sqrt(lqe.sky_covariance_arcsec2(predicted)[1, 1] + m.cov_sky_arcsec2[2])
    near = lqe.update(predicted, measurement(2, m.ra_icrs_deg, -5 + 2 * sigma / 3600), TUNED)
    far = lqe.update(predicted, measurement(2, m.ra_icrs_deg, -5 + 4 * sigma / 3600), TUNED)
    assert not lqe.is_gated_out(near.nis, TUNED)
    assert lqe.is_gated_out(far.nis, TUNED)
    assert far.innovation_arcsec[1] == pytest.approx(4 * far.sigma_innovation_arcsec[1], rel=1e-6)


def test_two_points_at_one_instant_start_no_track():
    m = straight(1)[0]
    with pytest.raises(ValueError, match="after the first"):
        lqe.initialise(m, m, TUNED)


def test_an_update_needs_a_prediction_to_its_instant():
    measurements = straight(3)
    state = lqe.initialise(*measurements[:2], TUNED)
    with pytest.raises(ValueError, match="different instants"):
        lqe.update(state, measurements[2], TUNED)


def test_one_large_innovation_by_chance_does_not_undo_the_safe_start():
    measurements = straight(4)
    state = lqe.initialise(*measurements[:2], TUNED)
    third = measurements[2]
    predicted = lqe.predict(state, third.t_mid_utc_ns, TUNED, 2)
    sigma = math.sqrt(lqe.sky_covariance_arcsec2(predicted)[1, 1] + third.cov_sky_arcsec2[2])
    lucky = lqe.update(predicted, measurement(2, third.ra_icrs_deg, -5.0), TUNED)
    off = measurement(2, third.ra_icrs_deg, -5.0 + 2.0 * sigma / 3600)
    unlucky = lqe.update(predicted, off, TUNED)
    assert unlucky.nis == pytest.approx(4.0, rel=0.01)
    assert 1.0 < unlucky.q_scale < 2.5
    assert 0.1 < lucky.q_scale < 0.5


@pytest.mark.parametrize("sigma_across_arcsec", [1e6, 1e113, float("inf"), float("nan")])
def test_a_measurement_of_boundless_sigma_is_weighed_as_nothing(sigma_across_arcsec):
    """A fit that did not converge must neither stop the filter nor move the track."""
    measurements = straight(12)
    state = run(measurements[:-1], TUNED)[-1][1]
    last = measurements[-1]
    variance = sigma_across_arcsec**2 if sigma_across_arcsec < 1e100 else sigma_across_arcsec
    wild = replace(
        measurement(11, last.ra_icrs_deg, last.dec_icrs_deg + 0.01),
        cov_sky_arcsec2=(variance, -0.3 * variance, 0.1 * variance),
    )
    predicted = lqe.predict(state, wild.t_mid_utc_ns, TUNED, 11)
    after = lqe.update(predicted, wild, TUNED)
    assert np.all(np.isfinite(after.P))
    assert (after.x[2] - predicted.x[2]) * 3600 == pytest.approx(0.0, abs=0.01)
    assert math.isfinite(after.nis)


@given(
    seed=st.integers(0, 2**32 - 1),
    preset=st.sampled_from(["tuned", "paper"]),
    sigma_arcsec=st.floats(0.1, 10.0),
)
@settings(max_examples=30, deadline=None)
def test_the_papers_equations_come_to_the_same(seed, preset, sigma_arcsec):
    """Written down as they stand in its text, through ten measurements of a wandering target."""
    config = FilterConfig(preset=preset)
    shaken = np.random.default_rng(seed).normal(0.0, 3.0 / 3600.0, (12, 2))
    measurements = [
        measurement(k, 355.0 + 0.125 * k + east, -5.0 + north, sigma_arcsec)
        for k, (east, north) in enumerate(shaken)
    ]
    pairs = run(measurements, config)
    state = lqe.initialise(measurements[0], measurements[1], config)
    F, C = lqe.transition_matrix(CADENCE_S), lqe.C
    for (predicted, updated), m in zip(pairs, measurements[2:], strict=True):
        x, P = F @ np.array(state.x), F @ np.array(state.P) @ F.T
        P = P + state.q_scale * lqe.process_noise(CADENCE_S, state.x[2], config)
        assert predicted.x[2] == pytest.approx(x[2], abs=1e-12)
        assert np.array(predicted.P) == pytest.approx(P, rel=1e-9)
        y = np.array([m.ra_icrs_deg, m.dec_icrs_deg]) - C @ x
        y[0] -= 360.0 * round(y[0] / 360.0)
        R = lqe.measurement_noise(m, config)
        S = C @ P @ C.T + R
        L = P @ C.T @ np.linalg.inv(S)
        x = x + L @ y
        # Joseph's form of (I - L C) P.
        P = (np.eye(4) - L @ C) @ P @ (np.eye(4) - L @ C).T + L @ R @ L.T
        assert updated.x[0] == pytest.approx(x[0] % 360.0, abs=1e-10)
        assert updated.x[1:] == pytest.approx(x[1:], abs=1e-10)
        assert np.array(updated.P) == pytest.approx((P + P.T) / 2, rel=1e-6, abs=1e-20)
        assert updated.nis == pytest.approx(y @ np.linalg.inv(S) @ y, rel=1e-9)
        state = updated
