"""The glance that decides what is worth a fit: unbroken light passes, stars in a row do not."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rsoconsole.vision import local_background
from rsoconsole.vision.streaks.streak_glance import line_signal
from tests.drawn.drawn_light import SIGMA_PX, sky_with, streak

DOUBTED = 0.001


def glance(pixels: np.ndarray, x: float, y: float, angle_deg: float, length_px: float):
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    dx, dy = 0.5 * length_px * c, 0.5 * length_px * s
    ends = (x - dx, y - dy, x + dx, y + dy)
    return line_signal(pixels, local_background(pixels), ends, SIGMA_PX)


def is_worth_a_fit(signal) -> bool:
    return signal.is_worth_a_fit(DOUBTED)


@pytest.mark.parametrize("angle_deg", [0.0, 31.0, 90.0, 147.0])
def test_a_faint_streak_near_a_poor_proposal_is_worth_a_fit(angle_deg):
    pixels = sky_with(streak(200.0, 200.0, angle_deg, 119.0, ridge_snr=1.8))
    for off_px, turn_deg in ((0.0, 0.0), (7.0, 3.0), (-7.0, -3.0)):
        assert is_worth_a_fit(glance(pixels, 200 + off_px, 200.0, angle_deg + turn_deg, 105.0))


def test_a_short_bright_streak_is_worth_a_fit():
    assert is_worth_a_fit(glance(sky_with(streak(200, 200, 20, 32, 6.0)), 202, 199, 25, 36))


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10_000), length_px=st.floats(20, 300), angle_deg=st.floats(0, 180))
def test_plain_sky_is_not(seed, length_px, angle_deg):
    assert not is_worth_a_fit(glance(sky_with(seed=seed), 200, 200, angle_deg, length_px))


def test_a_few_stars_in_a_row_are_not_however_bright():
    x = np.array([150.0, 171.0, 214.0, 248.0])
    pixels = sky_with((x, np.full(4, 200.0), np.array([3e3, 9e4, 2e4, 4e5])))
    assert not is_worth_a_fit(glance(pixels, 200.0, 200.0, 0.0, 110.0))


def test_light_twice_as_long_counts_as_noise_adds_up():
    pixels = sky_with(streak(200, 200, 0, 260, 2.0))
    once, twice = (glance(pixels, 200.0, 200.0, 0.0, length).value for length in (120.0, 240.0))
    assert twice == pytest.approx(np.sqrt(2.0) * once, rel=0.12)


def test_a_streak_that_the_edge_cuts_is_judged_by_what_is_seen_of_it():
    pixels = sky_with(streak(10.0, 200.0, 0.0, 119.0, 4.0))
    assert is_worth_a_fit(glance(pixels, 10.0, 200.0, 0.0, 119.0))


@pytest.mark.parametrize(
    ("y", "angle_deg"), [(-300.0, 0.0), (-22.0, 0.0), (-5.0, 0.0), (-6.0, 8.0)]
)
def test_outside_the_frame_and_along_its_rim_plain_sky_is_not_worth_a_fit(y, angle_deg):
    for seed in range(5):
        assert not is_worth_a_fit(glance(sky_with(seed=seed), 200.0, y, angle_deg, 100.0))
