"""Sky level and noise: truth is what the frame was made of."""

import numpy as np
import pytest

from rsoconsole.vision import local_background, resample


def _noisy(height: int, width: int, level: float = 800.0, sigma: float = 40.0) -> np.ndarray:
    rng = np.random.default_rng(3)
    return rng.normal(level, sigma, size=(height, width)).astype(np.float32)


@pytest.mark.parametrize("shape", [(64, 64), (65, 203), (512, 512), (880, 1164)])
def test_level_and_noise_of_a_flat_sky_are_found(shape):
    sky = local_background(_noisy(*shape))
    five_percent = 0.05 * 40.0
    assert np.abs(sky.level - 800.0).max() < 4 * 40.0 / 16
    assert np.abs(sky.noise - 40.0).max() < 3 * five_percent
    assert abs(float(np.median(sky.noise)) - 40.0) < five_percent


def test_sixteen_bits_and_floats_agree():
    pixels = np.rint(_noisy(1200, 1600)).astype(np.uint16)
    whole, real = local_background(pixels), local_background(pixels.astype(np.float32))
    one_unit = 1.0
    assert np.abs(whole.level - real.level).max() < one_unit
    assert np.abs(whole.noise - real.noise).max() < one_unit


def test_level_follows_a_gradient_and_noise_does_not_feel_it():
    slope = np.linspace(0.0, 600.0, 640, dtype=np.float32)
    sky = local_background(_noisy(512, 640) + slope)
    expected = 800.0 + slope.reshape(-1, 16).mean(axis=1)
    inside = np.abs(sky.level - expected)[:, 2:-2]
    half_a_sigma = 20.0
    assert inside.max() < half_a_sigma
    assert np.median(sky.noise) == pytest.approx(40.0, rel=0.05)


def test_a_bright_streak_and_stars_do_not_lift_the_level():
    pixels = _noisy(512, 512)
    pixels[250:253, 100:220] += 3000.0
    rng = np.random.default_rng(4)
    pixels[rng.integers(0, 512, 200), rng.integers(0, 512, 200)] += 50000.0
    sky = local_background(pixels)
    half_a_sigma = 20.0
    assert np.abs(sky.level - 800.0).max() < half_a_sigma
    assert np.median(sky.noise) == pytest.approx(40.0, rel=0.05)


def test_coarse_digitisation_leaves_a_noise_of_its_own_size():
    rng = np.random.default_rng(5)
    pixels = (np.rint(rng.normal(50.0, 0.6, size=(256, 256))) * 16).astype(np.uint16)
    true_sigma = 16 * np.sqrt(0.36 + 1 / 12)
    assert np.median(local_background(pixels).noise) == pytest.approx(true_sigma, rel=0.15)


def test_a_dead_frame_has_a_positive_noise():
    sky = local_background(np.full((128, 128), 7, dtype=np.uint16))
    assert (sky.noise > 0).all()
    assert np.allclose(sky.level, 7.0)


@pytest.mark.parametrize("shape", [(64, 64), (65, 203), (250, 100)])
def test_expanded_maps_have_the_frames_size_and_its_values(shape):
    slope = np.linspace(0.0, 300.0, shape[1], dtype=np.float32)
    pixels = np.tile(slope, (shape[0], 1))
    sky = local_background(pixels)
    full = resample(sky.level, sky.cell_px, *shape)
    assert full.shape == shape
    middle = shape[1] // 2
    assert full[shape[0] // 2, middle] == pytest.approx(slope[middle], abs=300.0 * 16 / shape[1])
    assert sky.at(sky.level, -5.0, 1e9) == sky.level[-1, 0]


def test_a_level_is_not_rounded_where_the_noise_is_one_unit():
    rng = np.random.default_rng(6)
    pixels = np.rint(rng.normal(100.3, 1.0, size=(1024, 1100))).astype(np.uint16)
    level = local_background(pixels).level
    a_fiftieth_of_sigma = 0.02
    assert abs(float(level.mean()) - 100.3) < a_fiftieth_of_sigma


def test_the_noise_of_a_sky_without_any_is_that_of_sixteen_bits():
    pixels = np.zeros((256, 256), np.float32)
    pixels[100:103, 20:200] = 3000.0
    expected = 3000.0 / 65536.0 / np.sqrt(12.0)
    assert np.median(local_background(pixels).noise) == pytest.approx(expected, rel=1e-3)
