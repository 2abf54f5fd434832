"""What speaks against a fitted line: light beyond it, and gaps in it."""

import numpy as np
import pytest

from rsoconsole.vision import local_background
from rsoconsole.vision.streaks.broken_line import continues_beyond_end, is_broken_line
from tests.drawn.drawn_light import SIGMA_PX, sky_with, streak


@pytest.mark.parametrize("angle_deg", [0.0, 31.0, 118.0])
def test_light_that_goes_on_beyond_an_end_is_noticed_and_a_star_there_is_not(angle_deg):
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))

    def at(u: float) -> tuple[float, float]:
        return 200.0 + c * u, 200.0 + s * u

    sky = local_background(sky_with())
    star = tuple(np.array([each]) for each in (*at(75.0), 1e5))
    pixels = sky_with(streak(200.0, 200.0, angle_deg, 119.0, 2.0), star)
    half, whole = (*at(-59.5), *at(0.0)), (*at(-59.5), *at(59.5))
    assert continues_beyond_end(pixels, sky, half, SIGMA_PX)
    assert not continues_beyond_end(pixels, sky, whole, SIGMA_PX)
    assert not continues_beyond_end(pixels, sky, (*half[2:], *half[:2]), SIGMA_PX)


def test_the_noise_of_a_faint_streak_is_hardly_ever_a_gap():
    draw, sky = np.random.default_rng(20231), local_background(sky_with())
    broken = 0
    for seed in range(60):
        half = 0.5 * draw.uniform(60.0, 300.0)
        pixels = sky_with(streak(200.0, 200.0, 0.0, 2.0 * half, draw.uniform(0.8, 4.0)), seed=seed)
        broken += is_broken_line(pixels, sky, (200.0 - half, 200.0, 200.0 + half, 200.0), SIGMA_PX)
    assert broken <= 1


def test_dark_between_stars_and_between_two_streaks_is_a_gap():
    sky, ends = local_background(sky_with()), (140.0, 200.0, 260.0, 200.0)
    x = np.linspace(142.0, 258.0, 7)
    stars = sky_with((x, np.full(7, 200.0), np.full(7, 1500.0)))
    assert is_broken_line(stars, sky, ends, SIGMA_PX)
    two = sky_with(streak(168.0, 200.0, 0.0, 50.0, 3.0), streak(236.0, 200.0, 0.0, 50.0, 3.0))
    assert is_broken_line(two, sky, ends, SIGMA_PX)
