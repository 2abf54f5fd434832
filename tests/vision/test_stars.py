"""Stars: centroids against synthetic truth, and what must not be taken for one."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.special import erf

from rsoconsole.instruments import read_frame
from rsoconsole.vision import StarList, find_stars

SHARED = Path(__file__).resolve().parents[3] / "shared" / "data"
SKY_ADU, NOISE_ADU = 700.0, 20.0


def add_star(image: np.ndarray, x: float, y: float, fwhm: float, peak_adu: float) -> None:
    """A Gaussian star integrated over each pixel."""
    s = fwhm / 2.3548 * np.sqrt(2)
    ix, iy, n = round(x), round(y), np.arange(-16, 17)
    fx = erf((ix + n + 0.5 - x) / s) - erf((ix + n - 0.5 - x) / s)
    fy = erf((iy + n + 0.5 - y) / s) - erf((iy + n - 0.5 - y) / s)
    image[iy - 16 : iy + 17, ix - 16 : ix + 17] += peak_adu * np.outer(fy, fx) / fx.max() / fy.max()


def star_field(fwhm: float, peak_snr: float, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    image = rng.normal(SKY_ADU, NOISE_ADU, (800, 1000))
    grid = np.stack(np.meshgrid(np.arange(40, 980, 60), np.arange(40, 780, 60)), -1).reshape(-1, 2)
    truth = grid + rng.uniform(-9, 9, grid.shape)
    for x, y in truth:
        add_star(image, x, y, fwhm, peak_snr * NOISE_ADU)
    return to_adu(image), truth


def to_adu(image: np.ndarray) -> np.ndarray:
    return np.clip(np.rint(image), 0, 65535).astype(np.uint16)


def errors_px(stars: StarList, truth: np.ndarray) -> np.ndarray:
    found = np.stack([stars.x_px, stars.y_px], axis=-1)
    nearest = np.argmin(np.linalg.norm(found[:, None] - truth, axis=-1), axis=1)
    return found - truth[nearest]


@pytest.mark.parametrize("fwhm", [1.6, 2.2, 3.5, 6.0])
def test_centroids_are_unbiased_and_good_to_five_hundredths_of_a_pixel(fwhm: float) -> None:
    image, truth = star_field(fwhm, peak_snr=20)
    stars = find_stars(image)
    assert len(stars) > 0.95 * len(truth)
    errors = errors_px(stars, truth)
    assert np.abs(errors.mean(axis=0)).max() < 0.01
    assert errors.std(axis=0).max() < 0.05
    # The pixel itself widens a star of 1.6 px to 1.75.
    assert stars.median_fwhm_px == pytest.approx(np.hypot(fwhm, 0.68), rel=0.04)


def test_bright_stars_are_centred_to_a_hundredth_wherever_they_fall_in_a_pixel() -> None:
    image, truth = star_field(2.2, peak_snr=400)
    assert np.abs(errors_px(find_stars(image), truth)).max() < 0.02


def test_stars_come_brightest_first_and_from_every_part_of_the_field() -> None:
    rng = np.random.default_rng(5)
    image = rng.normal(SKY_ADU, NOISE_ADU, (800, 1000))
    for x, y in rng.uniform((520, 30), (970, 770), (400, 2)):
        add_star(image, x, y, 2.2, 4000)
    for x, y in rng.uniform((30, 30), (480, 770), (60, 2)):
        add_star(image, x, y, 2.2, 400)
    stars = find_stars(to_adu(image), max_stars=100)
    assert len(stars) == 100
    assert np.all(np.diff(stars.flux) <= 0)
    assert 35 <= np.count_nonzero(stars.x_px < 500) <= 60


def test_stars_centred_beyond_the_rim_are_kept_like_others() -> None:
    rng = np.random.default_rng(8)
    image = rng.normal(SKY_ADU, NOISE_ADU, (864, 1064))
    rim = [(x, 31.8) for x in range(60, 1000, 40)] + [(31.7, y) for y in range(60, 800, 40)]
    for x, y in rim:
        add_star(image, x, y, 2.6, 1500)
    stars = find_stars(to_adu(image[32:-32, 32:-32]))
    assert len(stars) > 0.9 * len(rim)
    assert (stars.x_px < 0).any()
    assert (stars.y_px < 0).any()


def test_streaks_hot_pixels_and_cosmic_rays_are_no_stars() -> None:
    image, truth = star_field(2.4, peak_snr=30)
    streak = np.stack([np.linspace(100, 220, 600), np.linspace(95, 130, 600)], -1)
    clean = image.astype(np.float64)
    for x, y in streak:
        add_star(clean, x, y, 2.4, 100)
    spots = [(310, 70), (430, 250), (550, 430), (670, 610)]
    for x, y in spots:
        clean[y, x] += 3000
        clean[y + 60, x] += 2000
        clean[y + 60, x + 1] += 1500
    stars = find_stars(to_adu(clean))
    assert len(stars) > 0.9 * len(truth)
    away_px = np.abs(errors_px(stars, truth)).max(axis=1)
    # A star under the streak may be lost or blended; none may be made of it or of a hot pixel.
    assert np.count_nonzero(away_px > 1.0) == 0


def test_a_saturated_star_is_kept_and_flagged() -> None:
    image, _truth = star_field(2.4, peak_snr=30)
    bright = image.astype(np.float64)
    add_star(bright, 505.3, 405.2, 2.4, 200_000)
    stars = find_stars(to_adu(np.minimum(bright, 65520)), saturation_adu=65520)
    assert stars.is_saturated[0]
    assert np.count_nonzero(stars.is_saturated) == 1
    assert np.hypot(stars.x_px[0] - 505.3, stars.y_px[0] - 405.2) < 0.3


def test_an_empty_sky_has_no_stars() -> None:
    sky = np.random.default_rng(3).normal(SKY_ADU, NOISE_ADU, (640, 640))
    stars = find_stars(to_adu(sky))
    assert len(stars) == 0
    assert stars.median_fwhm_px > 0


def test_stars_are_found_on_a_sloping_sky_of_real_numbers() -> None:
    image, truth = star_field(2.2, peak_snr=40)
    slope = np.linspace(0, 900, image.shape[1])
    stars = find_stars((image + slope - 2000.0).astype(np.float32))
    assert len(stars) > 0.95 * len(truth)
    assert np.abs(errors_px(stars, truth)).max() < 0.15


@pytest.mark.nightly("many independent frames")
@pytest.mark.shared_data
@pytest.mark.skipif(not SHARED.exists(), reason="../shared/data is not here")
def test_the_satellite_of_an_independent_renderer_is_not_among_the_stars() -> None:
    folder = SHARED / "simulated" / "geo_single"
    frame = read_frame(folder / "geo_single_01.fits.bz2", 1)
    stars = find_stars(frame.pixels, saturation_adu=frame.saturation_adu)
    assert len(stars) == 400
    satellite = json.loads((folder / "truth.json").read_text())["frames"][0]["objects"][0]
    x = np.linspace(satellite["x_start"], satellite["x_end"], 200)[:, None]
    y = np.linspace(satellite["y_start"], satellite["y_end"], 200)[:, None]
    on_streak = np.hypot(stars.x_px - x, stars.y_px - y).min(axis=0) < 2.0
    assert np.count_nonzero(on_streak & (stars.snr < 100)) == 0


@pytest.mark.parametrize("drawn_px", [0.0, 2.2])
def test_a_light_is_too_long_by_the_frames_own_stars(drawn_px: float) -> None:
    """Guiding may draw every star out a little: none of them is a streak for that."""
    rng = np.random.default_rng(9)
    image = rng.normal(SKY_ADU, NOISE_ADU, (600, 800))
    for y in range(50, 560, 60):
        for x in range(50, 760, 60):
            for t in np.linspace(-0.5, 0.5, 9):
                add_star(image, x + t * drawn_px, y + 0.3, 2.6, 30.0 * NOISE_ADU / 9.0)
    for t in np.linspace(-0.5, 0.5, 30):
        add_star(image, 320.0 + 10.0 * t, 320.0 + 4.0 * t, 2.6, 4.0 * NOISE_ADU)
    oblong = find_stars(to_adu(image)).oblong
    assert oblong is not None
    assert np.hypot(oblong.x_px - 320.0, oblong.y_px - 320.0).min() < 6.0
    assert len(oblong.x_px) <= 3


def test_where_pixels_were_joined_stars_close_together_are_all_found() -> None:
    rng = np.random.default_rng(10)
    image = rng.normal(SKY_ADU, NOISE_ADU, (400, 400))
    truth = [(60.0 + 12.0 * i, 60.0 + 40.0 * j) for i in range(18) for j in range(8)]
    for x, y in truth:
        add_star(image, x, y, 3.0, rng.uniform(20.0, 60.0) * NOISE_ADU)
    usual, dense = (len(find_stars(to_adu(image), block_px=px)) for px in (8, 4))
    assert dense > 0.95 * len(truth)
    assert usual < 0.8 * len(truth)


@pytest.mark.parametrize("value", [0, 1000])
def test_a_frame_of_one_value_has_no_stars(value: int):
    assert len(find_stars(np.full((2048, 2400), value, np.uint16))) == 0
