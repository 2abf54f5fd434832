"""Motion about a point mass against the paper's propagation, Runge-Kutta 4, and the real Earth."""

from dataclasses import replace

import numpy as np
import pytest

from rsoconsole.orbits import TwoBodyPropagator, determine_orbit, predict
from rsoconsole.sky import iso_to_utc_ns
from tests.truth.orbit_cases import state_of
from tests.truth.orbit_truth import DAYTONA, geostationary, off_arcsec, seen_with_noise
from tests.truth.stepped_motion import SteppedPointMass

T0 = iso_to_utc_ns("2023-06-22T03:00:00Z")

GEO = state_of(42_166.0, 3e-4, 0.01, (1.0, 2.0, 3.0))
LEO = state_of(6_900.0, 0.01, 1.7, (1.0, 2.0, 3.0))
TIMES_S = np.array([0.0, 3.0, 10.0, 1234.5, -777.0, 5400.0, 5400.0, -0.001])
ONE_METRE_KM, ONE_MILLIMETRE_KM = 1e-3, 1e-6


@pytest.mark.parametrize("state", [GEO, LEO], ids=["GEO", "LEO"])
def test_the_papers_steps_follow_the_exact_motion_for_an_hour_and_a_half(state) -> None:
    r, v = TwoBodyPropagator().states(*state, TIMES_S)
    r_steps, v_steps = SteppedPointMass().states(*state, TIMES_S)
    np.testing.assert_allclose(r_steps, r, atol=ONE_METRE_KM)
    np.testing.assert_allclose(v_steps, v, atol=ONE_METRE_KM / 100.0)


def test_halving_the_step_lessens_the_error_by_its_fourth_power() -> None:
    exact, _ = TwoBodyPropagator().states(*LEO, np.array([6000.0]))
    errors = [
        float(
            np.linalg.norm(SteppedPointMass(step_s=h).states(*LEO, np.array([6000.0]))[0] - exact)
        )
        for h in (120.0, 60.0, 30.0)
    ]
    assert errors[0] > 0.3  # km: steps of two minutes are far too long there
    assert 12.0 < errors[0] / errors[1] < 36.0
    assert 12.0 < errors[1] / errors[2] < 36.0


def test_forwards_and_back_again_is_home() -> None:
    motion = TwoBodyPropagator()
    r, v = motion.states(*GEO, np.array([3605.0]))
    home, _ = motion.states(r[0], v[0], np.array([-3605.0]))
    np.testing.assert_allclose(home[0], GEO[0], atol=ONE_MILLIMETRE_KM)


def test_a_day_moved_as_in_the_paper_is_a_minute_of_arc_off() -> None:
    flight = geostationary(np.random.default_rng(1), 1, t0_utc_ns=T0, i_deg=2.0, e=np.array([3e-4]))
    night_s = np.arange(0.0, 2.0 * 3600.0 + 1.0, 240.0)
    both_s = np.concatenate([night_s, 86_400.0 + night_s])
    seen = seen_with_noise(np.random.default_rng(2), DAYTONA, flight.places(both_s)[0], 1.0)
    later = flight.places(np.array([both_s[-1] + 86_400.0]))[0]
    orbit = determine_orbit(seen)
    assert orbit is not None
    paper = replace(orbit, forces=SteppedPointMass())
    exact = replace(orbit, forces=TwoBodyPropagator())
    real_arcsec, paper_arcsec, exact_arcsec = (
        float(np.linalg.norm(off_arcsec(predict(each, DAYTONA, later.t_utc_ns).places, later)))
        for each in (orbit, paper, exact)
    )
    assert real_arcsec < 5.0
    assert paper_arcsec > 60.0
    assert paper_arcsec == pytest.approx(exact_arcsec, abs=0.1)
