"""What speaks against a fitted line: light beyond it, gaps, and a cosmic ray's lumps and bends."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rsoconsole.vision.background import local_background
from rsoconsole.vision.streak_doubts import goes_on_beyond, is_broken, is_patchy
from tests.drawn_light import SIGMA_PX, sky_with, streak


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


def matched(length_px: float, ridge_snr: float) -> float:
    """Signal to noise of a whole line."""
    return ridge_snr * float(np.sqrt(length_px * np.sqrt(np.pi) * SIGMA_PX))


def ends_of(x: float, y: float, angle_deg: float, length_px: float):
    dx, dy = (0.5 * length_px * f(np.radians(angle_deg)) for f in (np.cos, np.sin))
    return x - dx, y - dy, x + dx, y + dy


@pytest.mark.parametrize(("ridge_snr", "most"), [(2.0, 3), (5.0, 1), (30.0, 1)])
def test_a_short_even_streak_is_hardly_ever_patchy_or_bent(ridge_snr, most):
    rng, sky = np.random.default_rng(21), local_background(sky_with())
    refused = 0
    for _ in range(60):
        x, y = 200.0 + rng.uniform(-0.5, 0.5, 2)
        line = x, y, rng.uniform(0.0, 180.0), rng.uniform(18.0, 60.0)
        pixels = sky_with(streak(*line, ridge_snr), seed=int(rng.integers(1_000_000)))
        snr = matched(line[3], ridge_snr)
        refused += is_patchy(pixels, sky, ends_of(*line), SIGMA_PX, snr)
    assert refused <= most


@pytest.mark.parametrize("seed", range(8))
def test_a_rays_charge_comes_in_lumps(seed):
    x, y, flux = streak(200.0, 200.0, 33.0, 40.0, 8.0)
    # The energy lost on a way of some 5 px scatters by itself: a gamma law of shape 1.
    lumps = np.repeat(np.random.default_rng(seed).gamma(1.0, 1.0, flux.size // 20), 20)
    pixels = sky_with((x, y, flux * lumps / lumps.mean()), seed=seed)
    ends, sky = ends_of(200.0, 200.0, 33.0, 40.0), local_background(sky_with())
    assert is_patchy(pixels, sky, ends, SIGMA_PX, matched(40.0, 8.0))


@pytest.mark.parametrize("angle_deg", [0.0, 45.0, 100.0])
def test_an_electrons_way_is_bent(angle_deg):
    x, y, flux = streak(0.0, 0.0, 0.0, 40.0, 8.0)
    y = 3.0 * (x / 20.0) ** 2 - 1.0
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    pixels = sky_with((200.0 + c * x - s * y, 200.0 + s * x + c * y, flux))
    ends, sky = ends_of(200.0, 200.0, angle_deg, 40.0), local_background(sky_with())
    assert is_patchy(pixels, sky, ends, SIGMA_PX, matched(40.0, 8.0))
