"""A short streak is even and straight, a cosmic ray is not; a star in the way says nothing."""

import numpy as np
import pytest

from rsoconsole.records import NotAStreak
from rsoconsole.vision import StreakFit, find_stars, fit_streak, local_background
from rsoconsole.vision.lines.streak_search import cut_out
from rsoconsole.vision.streaks.streak_evenness import lumpiness_and_bend
from rsoconsole.vision.streaks.streak_fit import NoStreak
from tests.drawn.drawn_light import SIGMA_PX, sky_with, streak


def matched(length_px: float, ridge_snr: float) -> float:
    """Signal to noise of a whole line."""
    return ridge_snr * float(np.sqrt(length_px * np.sqrt(np.pi) * SIGMA_PX))


def ends_of(x: float, y: float, angle_deg: float, length_px: float):
    dx, dy = (0.5 * length_px * f(np.radians(angle_deg)) for f in (np.cos, np.sin))
    return x - dx, y - dy, x + dx, y + dy


def uneven(pixels: np.ndarray, line: tuple[float, float, float, float], ridge_snr: float) -> float:
    ends = ends_of(*line)
    box = min(ends[::2]), min(ends[1::2]), max(ends[::2]), max(ends[1::2])
    cutout = cut_out(pixels, local_background(sky_with()), box, 16.0, None)
    return max(lumpiness_and_bend(cutout, ends, SIGMA_PX, matched(line[3], ridge_snr)))


@pytest.mark.parametrize("ridge_snr", [2.0, 5.0, 30.0])
def test_nothing_but_noise_is_no_unevenness(ridge_snr):
    rng = np.random.default_rng(21)
    for _ in range(60):
        x, y = 200.0 + rng.uniform(-0.5, 0.5, 2)
        line = x, y, rng.uniform(0.0, 180.0), rng.uniform(18.0, 60.0)
        pixels = sky_with(streak(*line, ridge_snr), seed=int(rng.integers(1_000_000)))
        assert uneven(pixels, line, ridge_snr) < 0.5


@pytest.mark.parametrize("seed", range(8))
def test_a_rays_charge_comes_in_lumps(seed):
    x, y, flux = streak(200.0, 200.0, 33.0, 40.0, 8.0)
    # The energy lost on a way of some 5 px scatters by itself: a gamma law of shape 1.
    lumps = np.repeat(np.random.default_rng(seed).gamma(1.0, 1.0, flux.size // 20), 20)
    pixels = sky_with((x, y, flux * lumps / lumps.mean()), seed=seed)
    assert uneven(pixels, (200.0, 200.0, 33.0, 40.0), 8.0) > 1.0


@pytest.mark.parametrize("angle_deg", [0.0, 45.0, 100.0])
def test_an_electrons_way_is_bent(angle_deg):
    x, y, flux = streak(0.0, 0.0, 0.0, 40.0, 8.0)
    y = 3.0 * (x / 20.0) ** 2 - 1.0
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    pixels = sky_with((200.0 + c * x - s * y, 200.0 + s * x + c * y, flux))
    assert uneven(pixels, (200.0, 200.0, angle_deg, 40.0), 8.0) > 1.0


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("along_px", [0.0, 10.0, 20.0])
def test_a_short_streak_with_a_star_in_its_way_is_still_a_streak(along_px, seed):
    angle_deg, length_px = 33.0 + 40.0 * seed, 40.0
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    star = (np.array([200.0 + along_px * c]), np.array([200.0 + along_px * s]), np.array([3e4]))
    others = np.random.default_rng(seed).uniform(20.0, 380.0, (2, 20))
    away = np.hypot(others[0] - 200.0, others[1] - 200.0) > 50.0
    field = (*others[:, away], np.full(int(away.sum()), 2e4))
    pixels = sky_with(streak(200.0, 200.0, angle_deg, length_px, 8.0), star, field, seed=seed)
    sky = local_background(pixels)
    ends = ends_of(200.0, 200.0, angle_deg, length_px)
    box = min(ends[::2]) - 3, min(ends[1::2]) - 3, max(ends[::2]) + 3, max(ends[1::2]) + 3
    fit = fit_streak(pixels, sky, box, stars=find_stars(pixels, sky), ends=ends)
    assert isinstance(fit, StreakFit), fit.reason
    assert fit.unevenness < 0.3


def test_a_bright_star_that_the_rim_cuts_is_no_short_streak():
    x = np.linspace(190.0, 212.0, 3)
    pixels = sky_with((x, np.array([1.0, 3.0, 5.0]), np.array([4e5, 2e4, 5e4])))
    assert uneven(pixels, (200.0, 2.5, 10.0, 32.0), 20.0) > 1.0


@pytest.mark.parametrize("y", [1.0, 4.0, 397.0])
def test_at_the_rim_too_nothing_but_noise_is_no_unevenness(y):
    line = (200.0, y, 0.0, 40.0)
    assert uneven(sky_with(streak(*line, 6.0)), line, 6.0) < 0.3


def test_a_bent_short_line_is_refused_in_words():
    x, y, flux = streak(200.0, 200.0, 0.0, 40.0, 12.0)
    y = y + 3.0 * ((x - 200.0) / 20.0) ** 2 - 1.0
    pixels = sky_with((x, y, flux))
    sky = local_background(pixels)
    fit = fit_streak(pixels, sky, (178.0, 195.0, 222.0, 206.0), psf_fwhm_px=2.3548 * SIGMA_PX)
    assert isinstance(fit, NoStreak)
    assert fit.reason == NotAStreak(kind="patchy")
