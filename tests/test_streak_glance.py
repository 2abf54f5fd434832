"""The glance that decides what is worth a fit: unbroken light passes, stars in a row do not."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rsoconsole.simulator.psf import add_points
from rsoconsole.vision.background import local_background
from rsoconsole.vision.streak_glance import goes_on_beyond, is_broken, line_signal

NOISE, SIGMA_PX, SIZE = 20.0, 1.3, 400
DOUBTED = 0.001


def sky_with(*lights, seed: int = 1) -> np.ndarray:
    """Sky of 700 ADU with points of light: (x, y, flux) arrays."""
    light = np.zeros((SIZE, SIZE), dtype=np.float32)
    for x, y, flux in lights:
        add_points(light, x, y, flux, sigma_px=SIGMA_PX, faintest_e=0.01)
    noise = np.random.default_rng(seed).normal(0.0, NOISE, light.shape)
    return np.clip(np.rint(700.0 + light + noise), 0, 65535).astype(np.uint16)


def streak(x: float, y: float, angle_deg: float, length_px: float, ridge_snr: float):
    """Points of light so dense that they are a line; ridge_snr is per pixel on the ridge."""
    along = np.linspace(-0.5, 0.5, 4 * int(length_px)) * length_px
    per_px = ridge_snr * NOISE * np.sqrt(2.0 * np.pi) * SIGMA_PX
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    return x + c * along, y + s * along, np.full(along.size, per_px * length_px / along.size)


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


@pytest.mark.parametrize("angle_deg", [0.0, 31.0, 118.0])
def test_light_that_goes_on_beyond_an_end_is_noticed_and_a_star_there_is_not(angle_deg):
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))

    def at(u: float) -> tuple[float, float]:
        return 200.0 + c * u, 200.0 + s * u

    sky = local_background(sky_with())
    star = tuple(np.array([each]) for each in (*at(75.0), 1e5))
    pixels = sky_with(streak(200.0, 200.0, angle_deg, 119.0, 2.0), star)
    half, whole = (*at(-59.5), *at(0.0)), (*at(-59.5), *at(59.5))
    assert goes_on_beyond(pixels, sky, half, SIGMA_PX)
    assert not goes_on_beyond(pixels, sky, whole, SIGMA_PX)
    assert not goes_on_beyond(pixels, sky, (*half[2:], *half[:2]), SIGMA_PX)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10_000), ridge_snr=st.floats(0.8, 4.0), length_px=st.floats(60, 300))
def test_the_noise_of_a_faint_streak_is_no_gap(seed, ridge_snr, length_px):
    pixels = sky_with(streak(200.0, 200.0, 0.0, length_px, ridge_snr), seed=seed)
    half = 0.5 * length_px
    assert not is_broken(
        pixels, local_background(sky_with()), (200.0 - half, 200.0, 200.0 + half, 200.0), SIGMA_PX
    )


def test_dark_between_stars_and_between_two_streaks_is_a_gap():
    sky, ends = local_background(sky_with()), (140.0, 200.0, 260.0, 200.0)
    x = np.linspace(142.0, 258.0, 7)
    stars = sky_with((x, np.full(7, 200.0), np.full(7, 1500.0)))
    assert is_broken(stars, sky, ends, SIGMA_PX)
    two = sky_with(streak(168.0, 200.0, 0.0, 50.0, 3.0), streak(236.0, 200.0, 0.0, 50.0, 3.0))
    assert is_broken(two, sky, ends, SIGMA_PX)
