"""Light of stars whose image differs from star to star, and of points that move."""

import math

import numpy as np
import pytest

from rsoconsole.vision import StarImage, drawn_out_share, local_background, star_fluxes
from rsoconsole.vision.stars.star_moments import FWHM_PER_SIGMA

FWHM_PX = 3.4
SIGMA_PX = FWHM_PX / FWHM_PER_SIGMA
SKY_ADU, NOISE_ADU = 400.0, 5.0
IMAGE = StarImage(shares=np.ones(1), sigmas_px=np.array([SIGMA_PX]))
SIZE_PX = 400


def frame(places: np.ndarray, flux: np.ndarray, widths: np.ndarray, seed: int = 1) -> np.ndarray:
    """Round Gaussians of these widths, in units of the image's."""
    ys, xs = np.mgrid[0:SIZE_PX, 0:SIZE_PX].astype(np.float64)
    light = np.random.default_rng(seed).normal(SKY_ADU, NOISE_ADU, xs.shape)
    for (x, y), adu, wide in zip(places, flux, widths, strict=True):
        s = SIGMA_PX * wide
        light += adu / (2 * math.pi * s * s) * np.exp(-0.5 * ((xs - x) ** 2 + (ys - y) ** 2) / s**2)
    return np.rint(light).astype(np.uint16)


def grid(count: int, seed: int = 3) -> np.ndarray:
    """Places well apart from each other."""
    x, y = np.meshgrid(np.arange(40.0, 380.0, 60.0), np.arange(40.0, 380.0, 60.0))
    off = np.random.default_rng(seed).uniform(-0.5, 0.5, (x.size, 2))
    return (np.stack([x.ravel(), y.ravel()], axis=1) + off)[:count]


def light_of(pixels: np.ndarray, places: np.ndarray, *, fits: bool) -> np.ndarray:
    found = star_fluxes(
        pixels,
        local_background(pixels),
        IMAGE,
        places,
        saturation_adu=65535.0,
        fwhm_px=FWHM_PX,
        fits_shapes=fits,
    )
    return found.flux_adu


def test_stars_wider_and_narrower_than_the_image_have_their_light() -> None:
    places = grid(25)
    widths = np.random.default_rng(5).normal(1.0, 0.1, 25).clip(0.75, 1.3)
    flux = np.full(25, 40_000.0)
    pixels = frame(places, flux, widths)
    plain = light_of(pixels, places, fits=False) / flux - 1.0
    own = light_of(pixels, places, fits=True) / flux - 1.0
    assert np.std(plain) > 0.06
    assert np.std(own) < 0.01


def test_widths_that_are_all_alike_add_no_noise() -> None:
    places, flux = grid(25), np.full(25, 3_000.0)
    pixels = frame(places, flux, np.ones(25))
    plain, own = (light_of(pixels, places, fits=fits) for fits in (False, True))
    assert np.std(own) < 1.1 * np.std(plain)


def test_one_star_with_an_image_of_its_own_does_not_make_the_others_doubtful() -> None:
    places, flux, widths = grid(12), np.full(12, 30_000.0), np.ones(12)
    widths[4] = 0.75
    found = light_of(frame(places, flux, widths), places, fits=True) / flux - 1.0
    assert np.abs(found).max() < 0.02


@pytest.mark.parametrize("way_px", [(0.0, 0.0), (2.2, 0.0), (3.0, 4.0)])
def test_light_of_a_moving_point_is_made_good(way_px: tuple[float, float]) -> None:
    places = np.array([[200.2, 199.7]])
    steps = (np.arange(41) + 0.5) / 41 - 0.5
    path = places + steps[:, None] * way_px
    pixels = frame(path, np.full(41, 50_000.0 / 41), np.ones(41))
    found = light_of(pixels, places, fits=False)[0]
    share = drawn_out_share(IMAGE, FWHM_PX, 1.0, way_px)
    assert share <= 1.0 + 1e-9
    one_percent = 0.01
    assert found / share == pytest.approx(50_000.0, rel=one_percent)
