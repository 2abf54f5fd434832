"""Light of streaks among stars, against frames drawn with another law than the one fitted."""

import math

import numpy as np
import pytest

from rsoconsole.records import FloatArray, PixelArray
from rsoconsole.vision import (
    StreakFlux,
    find_stars,
    fit_star_image,
    local_background,
    star_fluxes,
    streak_flux,
)
from tests.drawn.drawn_moffat import LEVEL_ADU, MoffatSky, flux_of_snr, streak_points

Ends = tuple[float, float, float, float]
SATURATION_ADU = 65535.0
ENDS: Ends = (300.0, 250.0, 420.0, 330.0)
LENGTH = math.hypot(120.0, 80.0)


def off_the_line(places: FloatArray, ends: Ends, fwhm_px: float) -> FloatArray:
    """Places that are not on a streak."""
    x_a, y_a, x_b, y_b = ends
    length = math.hypot(x_b - x_a, y_b - y_a)
    dx, dy = (x_b - x_a) / length, (y_b - y_a) / length
    along = (places[:, 0] - x_a) * dx + (places[:, 1] - y_a) * dy
    beside = np.abs((places[:, 1] - y_a) * dx - (places[:, 0] - x_a) * dy)
    return places[(beside > 1.2 * fwhm_px) | (along < -20.0) | (along > length + 20.0)]


def measured(
    pixels: PixelArray,
    ends: Ends = ENDS,
    *,
    before: FloatArray | None = None,
    is_known: bool = True,
) -> tuple[StreakFlux, float]:
    """A streak's flux, and the median over the stars of measured over listed light.

    ``before``: places of light in the frame before; ``is_known``: there was such a frame.
    """
    sky, stars = local_background(pixels), find_stars(pixels)
    image = fit_star_image(pixels, sky, stars, SATURATION_ADU)
    earlier = np.zeros((0, 2)) if before is None else before

    def was_there(x_px: float, y_px: float) -> bool | None:
        near = np.hypot(earlier[:, 0] - x_px, earlier[:, 1] - y_px) < stars.median_fwhm_px
        return bool(near.any()) if is_known else None

    places = off_the_line(np.stack([stars.x_px, stars.y_px], axis=1), ends, stars.median_fwhm_px)
    found = streak_flux(
        pixels,
        sky,
        image,
        ends,
        stars_px=places,
        was_there=was_there,
        saturation_adu=SATURATION_ADU,
    )
    assert found is not None
    return found, stars.median_fwhm_px


def star_ratio(pixels: PixelArray, sky_drawn: MoffatSky) -> float:
    """Measured over true light of the brighter stars, their median."""
    sky, stars = local_background(pixels), find_stars(pixels)
    image = fit_star_image(pixels, sky, stars, SATURATION_ADU)
    places = np.stack([stars.x_px, stars.y_px], axis=1)[:100]
    found = star_fluxes(
        pixels,
        sky,
        image,
        places,
        saturation_adu=SATURATION_ADU,
        fwhm_px=stars.median_fwhm_px,
    )
    apart = np.hypot(*(places[:, None] - sky_drawn.places_px[None]).transpose(2, 0, 1))
    nearest = apart.argmin(axis=1)
    is_one = (apart.min(axis=1) < 1.0) & ~found.is_saturated & (found.flux_adu > 5000.0)
    return float(np.nanmedian(found.flux_adu[is_one] / sky_drawn.flux_adu[nearest[is_one]]))


@pytest.mark.parametrize("seed", range(6))
def test_a_streak_among_stars_has_the_stars_own_scale_of_light(seed: int) -> None:
    """Within 0.05 mag, and within three of its sigmas, at an SNR of 100."""
    rng = np.random.default_rng(seed)
    sky = MoffatSky.of(rng)
    flux = flux_of_snr(100.0, LENGTH, sky.fwhm_px)
    pixels = sky.drawn(rng, streak_points(ENDS, flux))
    found, _ = measured(pixels, before=sky.places_px)
    ratio = found.flux_adu / flux / star_ratio(pixels, sky)
    assert abs(2.5 * math.log10(ratio)) < 0.05
    assert abs(ratio - 1.0) < 3.0 * math.hypot(found.sigma_adu / flux, 0.01)


def test_errors_are_neither_too_small_nor_too_large_for_faint_streaks() -> None:
    pulls = []
    for seed in range(24):
        rng = np.random.default_rng(100 + seed)
        sky = MoffatSky.of(rng, (400, 600))
        flux = flux_of_snr(30.0, LENGTH, sky.fwhm_px)
        found, _ = measured(sky.drawn(rng, streak_points(ENDS, flux)), before=sky.places_px)
        pulls.append((found.flux_adu - flux) / found.sigma_adu)
    rms = float(np.sqrt(np.mean(np.square(pulls))))
    assert 0.5 < rms < 1.6


def test_a_flash_is_the_streaks_own_and_a_star_of_the_frame_before_is_not() -> None:
    rng = np.random.default_rng(7)
    sky = MoffatSky.of(rng)
    flux = flux_of_snr(120.0, LENGTH, sky.fwhm_px)
    point = np.array([[360.0, 290.0, 0.4 * flux]])
    pixels = sky.drawn(rng, streak_points(ENDS, flux), point)
    as_flash, _ = measured(pixels, before=sky.places_px)
    as_star, _ = measured(pixels, before=np.concatenate([sky.places_px, point[:, :2]]))
    assert as_flash.flux_adu == pytest.approx(1.4 * flux, rel=0.06)
    assert as_star.flux_adu == pytest.approx(flux, rel=0.06)
    assert as_star.is_blended
    assert not as_flash.is_blended


def test_steps_follow_light_that_halves_midway() -> None:
    rng = np.random.default_rng(11)
    sky = MoffatSky.of(rng)
    flux = flux_of_snr(150.0, LENGTH, sky.fwhm_px)
    points = streak_points(ENDS, flux, lambda t: np.where(t < 0.5, 2.0, 1.0))
    found, fwhm = measured(sky.drawn(rng, points), before=sky.places_px)
    first = found.step_adu_px[found.step_px < 0.5 * LENGTH - fwhm]
    second = found.step_adu_px[found.step_px > 0.5 * LENGTH + fwhm]
    assert len(first) + len(second) > 20
    assert np.median(first) / np.median(second) == pytest.approx(2.0, rel=0.08)
    assert found.flux_adu == pytest.approx(flux, rel=0.04)


def test_a_saturated_streak_is_said_to_be() -> None:
    rng = np.random.default_rng(13)
    sky = MoffatSky.of(rng)
    found, _ = measured(sky.drawn(rng, streak_points(ENDS, 6e7)))
    assert found.is_saturated


def test_a_cut_streak_has_the_light_of_what_is_in_the_frame() -> None:
    rng = np.random.default_rng(17)
    sky = MoffatSky.of(rng)
    whole = (700.0, 200.0, 900.0, 200.0)
    flux = flux_of_snr(200.0, 200.0, sky.fwhm_px)
    seen: Ends = (700.0, 200.0, 799.0, 200.0)
    found, _ = measured(sky.drawn(rng, streak_points(whole, flux)), seen, before=sky.places_px)
    assert found.flux_adu == pytest.approx(0.5 * flux, rel=0.06)


def test_a_streak_outside_the_frame_has_no_light() -> None:
    pixels = np.full((200, 300), int(LEVEL_ADU), np.uint16)
    sky, stars = local_background(pixels), find_stars(pixels)
    found = streak_flux(
        pixels,
        sky,
        fit_star_image(pixels, sky, stars, SATURATION_ADU),
        (400.0, 50.0, 450.0, 60.0),
        stars_px=np.zeros((0, 2)),
        was_there=lambda *_: None,
        saturation_adu=SATURATION_ADU,
    )
    assert found is None
