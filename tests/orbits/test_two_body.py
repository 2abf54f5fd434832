"""Motion about a point mass, against numerical integration and the conservation laws."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from rsoconsole.orbits import osculating_elements, period_s, propagate
from rsoconsole.orbits.motion.two_body import propagate_with_slopes

MU = 398600.4418
R = np.array([7000.0, -1200.0, 3000.0])


@pytest.mark.parametrize("speed", [0.2, 5.0, 7.3, 9.0, 10.2, 10.6, 14.0])
@pytest.mark.parametrize("dt_s", [-20_000.0, -3.0, 1e-6, 60.0, 5_000.0, 200_000.0])
def test_any_conic_lands_where_an_integrator_lands(speed: float, dt_s: float) -> None:
    across = np.cross([0.2, 0.9, 0.4], R)
    v = speed * (across / np.linalg.norm(across) + 0.15 * R / np.linalg.norm(R))
    if speed < 6.0 and abs(dt_s) > 1000.0:
        dt_s = float(np.sign(dt_s)) * 600.0  # it falls through the centre: no integrator follows
    r1, v1 = propagate(R, v, dt_s, MU)
    solved = solve_ivp(
        lambda _, y: np.concatenate([y[3:], -MU / np.linalg.norm(y[:3]) ** 3 * y[:3]]),
        (0.0, dt_s),
        np.concatenate([R, v]),
        method="DOP853",
        rtol=1e-13,
        atol=1e-12,
    )
    scale = 1.0 + abs(dt_s) / 100.0  # an integrator's own error grows
    assert np.linalg.norm(r1 - solved.y[:3, -1]) < 1e-7 * scale
    assert np.linalg.norm(v1 - solved.y[3:, -1]) < 1e-10 * scale


def test_a_hyperbola_flung_round_the_centre_ends_where_keplers_equation_says() -> None:
    """Steep falls at 10 to 70 km/s, past the centre and out again; the truth in extended digits."""
    random = np.random.default_rng(11)
    for _ in range(300):
        r = random.normal(size=3)
        r *= random.uniform(6600.0, 45000.0) / np.linalg.norm(r)
        v = -r / np.linalg.norm(r) * random.uniform(10.0, 70.0) + random.normal(0.0, 0.5, 3)
        if v @ v < 2.1 * MU / np.linalg.norm(r):
            continue
        dt_s = random.uniform(0.5, 3.0) * np.linalg.norm(r) / np.linalg.norm(v)
        one_centimetre_km = 1e-5
        truth = _on_hyperbola(r, v, dt_s)
        np.testing.assert_allclose(propagate(r, v, dt_s, MU)[0], truth, atol=one_centimetre_km)


def _on_hyperbola(r: np.ndarray, v: np.ndarray, dt_s: float) -> np.ndarray:
    """Place after a time by e sinh F - F = M, along the axes of the hyperbola."""
    wide = np.longdouble
    r, v, mu = r.astype(wide), v.astype(wide), wide(MU)
    radius, h = np.sqrt(r @ r), np.cross(r, v)
    apse = np.cross(v, h) / mu - r / radius
    e = np.sqrt(apse @ apse)
    apse, minor = apse / e, np.cross(h, apse) / (e * np.sqrt(h @ h))
    a = 1 / (v @ v / mu - 2 / radius)
    start = np.arcsinh((r @ minor) / (a * np.sqrt(e * e - 1)))
    mean = e * np.sinh(start) - start + np.sqrt(mu / a**3) * wide(dt_s)
    late = np.arcsinh(mean / e)
    for _ in range(60):
        late -= (e * np.sinh(late) - late - mean) / (e * np.cosh(late) - 1)
    place = a * ((e - np.cosh(late)) * apse + np.sqrt(e * e - 1) * np.sinh(late) * minor)
    return place.astype(float)


@pytest.mark.parametrize("part", [1e-15, 1e-12, 1e-9, 1e-6, 1e-3])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_near_the_speed_of_escape_there_and_back_is_home(part: float, sign: float) -> None:
    random = np.random.default_rng(3)
    r = random.normal(size=(500, 3))
    r *= (random.uniform(6600.0, 90_000.0, 500) / np.linalg.norm(r, axis=1))[:, None]
    v = random.normal(size=(500, 3))
    speed = np.sqrt(2.0 * MU / np.linalg.norm(r, axis=1)) * (1.0 + sign * part)
    v *= (speed / np.linalg.norm(v, axis=1))[:, None]
    dt_s = random.choice([-1.0, 1.0], 500) * 10 ** random.uniform(-3, 5, 500)
    back, _ = propagate(*propagate(r, v, dt_s, MU), -dt_s, MU)
    one_metre_km = 1e-3
    np.testing.assert_allclose(back, r, rtol=0.0, atol=one_metre_km)


@given(st.floats(4.0, 20.0), st.floats(-0.5, 0.5), st.floats(-1e5, 1e5), st.floats(-1e5, 1e5))
def test_two_steps_are_one_step_and_energy_stays(
    speed: float, radial: float, first_s: float, second_s: float
) -> None:
    v = speed * np.array([radial, 0.8, -0.3])
    middle = propagate(R, v, first_s, MU)
    twice = propagate(*middle, second_s, MU)
    once = propagate(R, v, first_s + second_s, MU)
    # The last digit of the energy shifts the phase with time.
    late_s = 1e-13 * (abs(first_s) + abs(second_s) + 1e4)
    assert np.linalg.norm(twice[0] - once[0]) < 100.0 * late_s * np.linalg.norm(once[1]) + 1e-7
    energy = [v @ v / 2 - MU / np.linalg.norm(r) for r, v in ((R, v), once)]
    assert energy[1] == pytest.approx(energy[0], rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("speed", [5.0, 7.3, 9.0, 10.2, 10.51, 14.0])
def test_slopes_are_what_small_changes_make(speed: float) -> None:
    across = np.cross([0.2, 0.9, 0.4], R)
    v = speed * (across / np.linalg.norm(across) + 0.15 * R / np.linalg.norm(R))
    times = np.array([-300.0, 0.5, 600.0]) if speed < 6.0 else np.array([-9e4, -60.0, 1.0, 2e5])
    _, _, slopes = propagate_with_slopes(R, v, times, MU)
    for n, step in enumerate([1e-2] * 3 + [1e-5] * 3):
        aside = np.zeros(6)
        aside[n] = step
        there = propagate(R + aside[:3], v + aside[3:], times, MU)[0]
        back = propagate(R - aside[:3], v - aside[3:], times, MU)[0]
        expected = (there - back) / (2.0 * step)
        scale = np.abs(expected).max(axis=1, keepdims=True)
        np.testing.assert_allclose(slopes[:, :, n] / scale, expected / scale, atol=1e-4)


def test_many_at_once_are_each_by_itself() -> None:
    speeds = np.array([7.0, 8.0, 11.5])
    v = speeds[:, None] * np.array([0.0, 0.9, -0.2])
    times = np.array([[10.0, 400.0, 90_000.0]]).T
    r_all, v_all = propagate(R, v, times, MU)
    assert r_all.shape == v_all.shape == (3, 3, 3)
    for row, dt_s in enumerate(times[:, 0]):
        for column in range(3):
            r, _ = propagate(R, v[column], dt_s, MU)
            np.testing.assert_allclose(r_all[row, column], r, rtol=1e-12)


def test_elements_of_a_textbook_state() -> None:
    """Vallado, Fundamentals of Astrodynamics, example 2-5."""
    r = np.array([6524.834, 6862.875, 6448.296])
    v = np.array([4.901327, 5.533756, -1.976341])
    found = osculating_elements(r, v, 398600.4418)
    assert found.a_km == pytest.approx(36127.343, abs=0.01)
    assert found.e == pytest.approx(0.832853, abs=1e-6)
    assert found.i_deg == pytest.approx(87.870, abs=1e-3)
    assert found.raan_deg == pytest.approx(227.898, abs=1e-3)
    assert found.argp_deg == pytest.approx(53.38, abs=5e-3)
    # True anomaly 92.335 deg, by Kepler's equation.
    assert found.m_deg == pytest.approx(7.6047, abs=2e-3)
    assert period_s(found.a_km) == pytest.approx(2 * np.pi * np.sqrt(36127.343**3 / MU), rel=1e-6)


@pytest.mark.parametrize("i_deg", [0.0, 180.0])
def test_a_circle_over_the_equator_has_elements_too(i_deg: float) -> None:
    turn = 1.0 if i_deg == 0.0 else -1.0
    angle = np.radians(40.0)
    r = 42164.0 * np.array([np.cos(angle), np.sin(angle), 0.0])
    v = turn * np.sqrt(MU / 42164.0) * np.array([-np.sin(angle), np.cos(angle), 0.0])
    found = osculating_elements(r, v, MU)
    assert found.i_deg == pytest.approx(i_deg, abs=1e-9)
    assert found.e == pytest.approx(0.0, abs=1e-12)
    assert (found.raan_deg + turn * (found.argp_deg + found.m_deg)) % 360.0 == pytest.approx(40.0)
