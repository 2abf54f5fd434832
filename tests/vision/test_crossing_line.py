"""What neither end of is in the frame is a line: its offset and direction with their errors."""

import math

import numpy as np
import pytest

from rsoconsole.vision import StreakFit, find_stars, fit_streak, local_background
from tests.drawn.drawn_light import SIZE, sky_with, streak


def fitted(x: float, y: float, angle_deg: float, length_px: float, snr: float, *, seed: int):
    """The fit of a line through (x, y), guessed where it is within the frame."""
    pixels = sky_with(streak(x, y, angle_deg, length_px, snr), seed=seed)
    sky = local_background(pixels)
    dx, dy = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    places = np.linspace(-0.5, 0.5, 4001) * length_px
    inside = [u for u in places if 0 <= x + u * dx <= SIZE - 1 and 0 <= y + u * dy <= SIZE - 1]
    a, b = inside[0], inside[-1]
    ends = x + a * dx, y + a * dy, x + b * dx, y + b * dy
    box = min(ends[::2]), min(ends[1::2]), max(ends[::2]), max(ends[1::2])
    return fit_streak(pixels, sky, box, stars=find_stars(pixels, sky), ends=ends)


@pytest.mark.parametrize("seed", range(6))
def test_a_line_through_the_whole_frame_is_a_crossing_with_its_covariance(seed):
    rng = np.random.default_rng(seed)
    angle = rng.uniform(0.0, 180.0)
    x, y = rng.uniform(0.4, 0.6, 2) * SIZE
    fit = fitted(x, y, angle, 900.0, rng.uniform(2.0, 20.0), seed=seed)
    assert isinstance(fit, StreakFit)
    assert (fit.is_clipped, fit.is_crossing) == (True, True)
    assert fit.sigma_angle_deg is not None
    assert 0.0 < fit.sigma_angle_deg < 0.1
    found = math.degrees(math.atan2(fit.y_b_px - fit.y_a_px, fit.x_b_px - fit.x_a_px))
    off_deg = abs((found - angle + 90.0) % 180.0 - 90.0)
    # The line's error: a pixel's own shape adds some hundredths of a pixel over its length.
    a_fiftieth_px_deg = math.degrees(0.02 / fit.length_px)
    assert off_deg < 4.5 * fit.sigma_angle_deg + a_fiftieth_px_deg
    turned = math.radians(angle)
    across = (fit.y_px - y) * math.cos(turned) - (fit.x_px - x) * math.sin(turned)
    assert abs(across) < 4.5 * fit.sigma_across_px + 0.02


def test_one_end_in_the_frame_is_no_crossing():
    fit = fitted(SIZE - 60.0, 200.0, 0.0, 300.0, 8.0, seed=1)
    assert isinstance(fit, StreakFit)
    assert (fit.is_clipped, fit.is_crossing) == (True, False)


def test_the_direction_of_a_whole_one_scatters_as_its_error_says():
    pulls = []
    for seed in range(40):
        rng = np.random.default_rng(100 + seed)
        angle, length = rng.uniform(0.0, 180.0), rng.uniform(60.0, 200.0)
        fit = fitted(200.0, 200.0, angle, length, rng.uniform(2.0, 12.0), seed=seed)
        assert isinstance(fit, StreakFit)
        found = math.degrees(math.atan2(fit.y_b_px - fit.y_a_px, fit.x_b_px - fit.x_a_px))
        off_deg = (found - angle + 90.0) % 180.0 - 90.0
        pulls.append(off_deg / fit.sigma_angle_deg)
        assert not fit.is_crossing
    assert 0.6 < float(np.std(pulls)) < 1.5
