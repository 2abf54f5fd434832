"""One line or a few stars in a row: told by the light along it, drawn here with NumPy alone."""

import numpy as np
import pytest

from rsoconsole.vision.lines.line_or_points import line_over_points_chi2, trail_along_line_px
from rsoconsole.vision.lines.line_strip import LineProfile

SIGMA_PX = 1.7
FWHM_PX = 2.3548 * SIGMA_PX
FIRST_PX = 40.0


def profile(light, rng, error=1.0) -> LineProfile:
    """Light along a line with noise of so many units a pixel."""
    noisy = light + rng.normal(0.0, error, light.size)
    return LineProfile(light=noisy, error=np.full(light.size, error), sigma=SIGMA_PX)


def blurred(light) -> np.ndarray:
    """As the telescope shows it."""
    u = np.arange(-12, 13)
    kernel = np.exp(-0.5 * (u / SIGMA_PX) ** 2)
    return np.convolve(light, kernel / kernel.sum(), mode="same")


def line(length_px: float, light, size: int = 160) -> np.ndarray:
    """Light as a function of the place along it, 0 to 1, between two ends."""
    t = (np.arange(size) - FIRST_PX) / length_px
    return blurred(np.where((t >= 0.0) & (t <= 1.0), light(t), 0.0))


def points(places_px, lights, size: int = 160, length_px: float = 0.0) -> np.ndarray:
    """Stars, or what drift has drawn them out to."""
    u = np.arange(size)
    light = np.zeros(size)
    for place, each in zip(places_px, lights, strict=True):
        near = np.abs(u - place) <= max(0.5 * length_px, 0.5)
        light[near] += each / near.sum()
    return blurred(light)


def preferred(light, length_px: float, rng, drawn_px: float = 0.0) -> float:
    return line_over_points_chi2(
        profile(light, rng), (FIRST_PX, FIRST_PX + length_px), 1.0, drawn_px=drawn_px
    )


@pytest.mark.parametrize("length_fwhm", [3.0, 5.0, 10.0, 20.0])
def test_an_even_line_is_one_line(length_fwhm):
    for seed in range(10):
        rng, length_px = np.random.default_rng(seed), length_fwhm * FWHM_PX
        assert preferred(line(length_px, lambda t: 12.0 + 0.0 * t), length_px, rng) > 10.0


@pytest.mark.parametrize("gap_fwhm", [2.0, 3.0, 5.0])
@pytest.mark.parametrize("ratio", [1.0, 0.5])
def test_two_stars_are_two_stars(gap_fwhm, ratio):
    for seed in range(10):
        rng, gap_px = np.random.default_rng(seed), gap_fwhm * FWHM_PX
        light = points([FIRST_PX + FWHM_PX / 2, FIRST_PX + FWHM_PX / 2 + gap_px], [90, 90 * ratio])
        assert preferred(light, gap_px + FWHM_PX, rng) < 0.0


def test_three_stars_at_uneven_distances_are_three_stars():
    told = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        places = FIRST_PX + np.cumsum(rng.uniform(1.8, 3.5, 3)) * FWHM_PX - FWHM_PX
        light = points(places, rng.uniform(60.0, 150.0, 3))
        told += preferred(light, float(places[-1] - FIRST_PX) + 0.5 * FWHM_PX, rng) < 10.0
    assert told >= 18


@pytest.mark.parametrize("periods", [2.0, 3.0])
def test_a_tumbling_satellite_is_one_line(periods):
    length_px = 5.0 * periods * FWHM_PX
    for seed in range(10):
        rng = np.random.default_rng(seed)
        phase = rng.uniform(0.0, 2.0 * np.pi)
        light = line(
            length_px, lambda t, f=phase: 12.0 * (1 + 0.8 * np.cos(6.28 * periods * t + f))
        )
        assert preferred(light, length_px, rng) > 20.0


def test_stars_that_drift_has_drawn_out_are_no_line_and_a_longer_line_is_one():
    drawn_px = 5.0 * FWHM_PX
    for seed in range(10):
        rng = np.random.default_rng(seed)
        two = points([52.0, 58.0 + drawn_px], [260.0, 200.0], length_px=drawn_px)
        assert preferred(two, 2.0 * drawn_px + 8.0, rng, drawn_px) < 5.0
        one = points([60.0], [300.0], length_px=drawn_px)
        assert preferred(one, drawn_px, rng, drawn_px) < 5.0
        longer = line(8.0 * FWHM_PX, lambda t: 12.0 + 0.0 * t)
        assert preferred(longer, 8.0 * FWHM_PX, rng, drawn_px) > 20.0


def test_what_is_long_or_hardly_seen_is_not_asked_about():
    rng = np.random.default_rng(1)
    even = line(120.0, lambda t: 12.0 + 0.0 * t, size=400)
    assert preferred(even, 31.0 * FWHM_PX, rng) == 0.0
    hidden = LineProfile(light=even, error=np.full(even.size, np.inf), sigma=SIGMA_PX)
    assert line_over_points_chi2(hidden, (FIRST_PX, FIRST_PX + 20.0), 1.0) == 0.0


def test_a_trail_crosses_a_line_for_a_part_of_its_length():
    assert trail_along_line_px(30.0, 0.0, 4.0) == pytest.approx(30.0)
    assert trail_along_line_px(30.0, 90.0, 4.0) == pytest.approx(0.0, abs=0.01)
    assert trail_along_line_px(30.0, 30.0, 4.0) == pytest.approx(12.0)
