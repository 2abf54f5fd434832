"""Streaks measured against truth: ends, midpoint, honest sigmas, and each gate."""

import json
from pathlib import Path

import numpy as np
import pytest

from rsoconsole.instruments import read_frame
from rsoconsole.simulator.camera.psf import add_points
from rsoconsole.vision import StreakFit, find_stars, fit_streak, local_background
from rsoconsole.vision.streaks.streak_fit import NoStreak
from rsoconsole.words import text
from tests.tiers import plain_first

SHARED = Path(__file__).resolve().parents[3] / "shared" / "data"
NOISE_ADU, ADU_PER_ELECTRON = 38.0, 3.3
FWHM_PX = 2.2
SIZE = 320
FULL = pytest.mark.nightly("one more frame of full size")
MANY = pytest.mark.nightly("statistics over many streaks")
Point = tuple[float, float]


def draw(
    rng: np.random.Generator,
    streaks: list[tuple[Point, Point, float]],
    *,
    brightness: list[float] | None = None,
    stars: int = 0,
    fwhm: float = FWHM_PX,
) -> np.ndarray:
    """A 12-bit crop; each streak is (start, end, signal to noise of its brightest pixel)."""
    light = np.zeros((SIZE, SIZE), dtype=np.float32)
    sigma = fwhm / 2.3548
    for a, b, peak_snr in streaks:
        length = float(np.hypot(b[0] - a[0], b[1] - a[1]))
        t = (np.arange(600) + 0.5) / 600
        per_px = peak_snr * NOISE_ADU * np.sqrt(2 * np.pi) * np.hypot(sigma, 0.29)
        flux = np.full(600, per_px * length / 600)
        if brightness is not None:
            flux *= np.interp(t, np.linspace(0, 1, len(brightness)), brightness)
        points(light, a[0] + (b[0] - a[0]) * t, a[1] + (b[1] - a[1]) * t, flux, sigma)
    if stars:
        flux = NOISE_ADU * 10 ** rng.uniform(1, 3, stars)
        points(light, rng.uniform(0, SIZE, stars), rng.uniform(0, SIZE, stars), flux, sigma)
    noise = np.sqrt(NOISE_ADU**2 + ADU_PER_ELECTRON * light)
    image = light + 730 + rng.normal(size=light.shape) * noise
    return np.clip(np.rint(image / 16) * 16, 0, 65520).astype(np.uint16)


def points(light: np.ndarray, x: np.ndarray, y: np.ndarray, flux: np.ndarray, s: float) -> None:
    add_points(light, x, y, flux.astype(np.float32), sigma_px=s, faintest_e=0.01)


def box_of(a: Point, b: Point, rng: np.random.Generator) -> tuple[float, float, float, float]:
    """A box with the errors that a network makes."""
    e = rng.uniform(-6, 6, 4)
    return (
        min(a[0], b[0]) + e[0],
        min(a[1], b[1]) + e[1],
        max(a[0], b[0]) + e[2],
        max(a[1], b[1]) + e[3],
    )


def normalised_errors(
    peak_snr: float, count: int, seed: int, **kwargs: object
) -> tuple[np.ndarray, np.ndarray]:
    """Errors of the midpoint (along, across), in pixels and in sigmas: two arrays (n, 2)."""
    rng = np.random.default_rng(seed)
    errors, sigmas = [], []
    for _ in range(count):
        angle, middle = rng.uniform(0, np.pi), rng.uniform(140, 180, 2)
        d = np.array([np.cos(angle), np.sin(angle)])
        a, b = tuple(middle - 59.5 * d), tuple(middle + 59.5 * d)
        image = draw(rng, [(a, b, peak_snr)], **kwargs)  # type: ignore[arg-type]
        sky = local_background(image)
        stars = find_stars(image, sky) if kwargs.get("stars") else None
        fwhm = None if stars is not None else FWHM_PX * 1.05
        fit = fit_streak(image, sky, box_of(a, b, rng), stars=stars, psf_fwhm_px=fwhm)
        if isinstance(fit, NoStreak):
            continue
        off = np.array([fit.x_px, fit.y_px]) - middle
        errors.append([off @ d, off @ np.array([-d[1], d[0]])])
        sigmas.append([fit.sigma_along_px, fit.sigma_across_px])
    return np.array(errors), np.array(errors) / np.array(sigmas)


@pytest.mark.parametrize("count", [40, pytest.param(100, marks=MANY)])
@pytest.mark.parametrize("peak_snr", plain_first(1, [3.0, 2.0, 8.0, 30.0]))
def test_sigmas_of_the_midpoint_are_honest(peak_snr: float, count: int) -> None:
    errors, normalised = normalised_errors(peak_snr, count, seed=1)
    assert len(errors) >= count - 1
    variance = np.mean(normalised**2, axis=0)
    # The variance of 100 unit normals scatters by 0.14.
    assert 0.6 < variance[0] < 1.5
    assert 0.35 < variance[1] < 1.5
    half_a_pixel, third_of_a_pixel = 0.5, 0.3
    if peak_snr >= 3:
        assert errors[:, 0].std() < half_a_pixel
        assert errors[:, 1].std() < third_of_a_pixel


def test_stars_in_the_way_cost_little() -> None:
    errors, normalised = normalised_errors(8.0, 40, seed=2, stars=60)
    assert len(errors) == 40
    # One of them ends in a star.
    assert (np.abs(errors).max(axis=1) < 0.5).sum() >= 39
    assert np.abs(errors).max() < 1.5
    assert np.mean(normalised[:, 0] ** 2) < 2.0


@pytest.mark.parametrize(
    "brightness", [[1, 0.3, 1, 0.5, 1], [0.6] * 9 + [4] + [0.6] * 5, [0.4, 1.0]]
)
def test_tumbling_glints_and_cloud_do_not_move_the_midpoint(brightness: list[float]) -> None:
    errors, _ = normalised_errors(8.0, 25, seed=3, brightness=brightness)
    assert len(errors) == 25
    # Weighted by flux the last one's midpoint would lie 8 px off.
    assert np.abs(errors[:, 0]).max() < 1.0
    assert np.abs(errors[:, 0].mean()) < 0.2


def test_direction_is_found_from_a_box_on_either_diagonal() -> None:
    rng = np.random.default_rng(4)
    for a, b in (((110.0, 110.0), (200.0, 190.0)), ((110.0, 190.0), (200.0, 110.0))):
        image = draw(rng, [(a, b, 5.0)])
        fit = fit_streak(image, local_background(image), (108, 108, 203, 193), psf_fwhm_px=2.3)
        assert isinstance(fit, StreakFit)
        ends = {(round(fit.x_a_px), round(fit.y_a_px)), (round(fit.x_b_px), round(fit.y_b_px))}
        for x, y in (a, b):
            assert min(np.hypot(x - ex, y - ey) for ex, ey in ends) < 2


def test_a_streak_longer_than_its_box_is_followed_to_its_ends() -> None:
    image = draw(np.random.default_rng(5), [((30.0, 150.0), (290.0, 175.0), 5.0)])
    fit = fit_streak(image, local_background(image), (120, 155, 190, 170), psf_fwhm_px=2.3)
    assert isinstance(fit, StreakFit)
    assert fit.length_px == pytest.approx(261.2, abs=2)


def test_half_a_streak_that_was_proposed_is_followed_to_the_whole() -> None:
    a, b = (60.0, 140.0), (260.0, 160.0)
    for seed in range(4):
        image = draw(np.random.default_rng(seed), [(a, b, 1.8)], stars=20)
        fit = fit_streak(image, local_background(image), (60, 138, 150, 152), psf_fwhm_px=2.3)
        if isinstance(fit, StreakFit):
            assert fit.length_px == pytest.approx(201.0, abs=8.0)


def test_two_in_a_row_with_a_gap_between_are_not_made_one() -> None:
    first, second = ((40.0, 150.0), (130.0, 150.0)), ((150.0, 150.0), (280.0, 150.0))
    image = draw(np.random.default_rng(3), [(*first, 5.0), (*second, 5.0)])
    fit = fit_streak(image, local_background(image), (38, 146, 132, 154), psf_fwhm_px=2.3)
    assert isinstance(fit, StreakFit)
    assert fit.length_px == pytest.approx(90.0, abs=2.0)
    assert fit.x_px == pytest.approx(85.0, abs=1.0)


def test_a_clipped_streak_is_known_across_alone() -> None:
    a, b = (-60.0, 100.0), (59.0, 110.0)
    image = draw(np.random.default_rng(6), [(a, b, 5.0)])
    fit = fit_streak(image, local_background(image), (0, 98, 62, 113), psf_fwhm_px=2.3)
    assert isinstance(fit, StreakFit)
    assert fit.is_clipped
    assert fit.sigma_along_px >= 100
    slope = (b[1] - a[1]) / (b[0] - a[0])
    assert fit.y_px == pytest.approx(a[1] + slope * (fit.x_px - a[0]), abs=0.3)
    assert min(fit.x_a_px, fit.x_b_px) == pytest.approx(-0.5)


def reason_of(image: np.ndarray, box: tuple[float, float, float, float]) -> str:
    fit = fit_streak(image, local_background(image), box, psf_fwhm_px=2.3)
    assert isinstance(fit, NoStreak)
    return text(fit.reason)


def test_plain_sky_and_faint_streaks_are_refused() -> None:
    rng = np.random.default_rng(7)
    assert "no ends found" in reason_of(draw(rng, []), (100, 100, 200, 180))
    reasons = [
        reason_of(draw(rng, [((120.0, 150.0), (132.0, 155.0), 0.5)]), (118, 148, 134, 157))
        for _ in range(12)
    ]
    assert any("too faint" in reason for reason in reasons)


def test_a_star_is_too_short() -> None:
    image = draw(np.random.default_rng(8), [((150.0, 150.0), (151.0, 150.0), 30.0)])
    assert "too short" in reason_of(image, (140, 140, 162, 160))


def test_a_cosmic_ray_is_narrower_than_a_star() -> None:
    image = draw(np.random.default_rng(9), []).astype(np.float64)
    for i in range(30):
        image[150 + i // 3, 120 + i] += 1500
    assert "cosmic ray" in reason_of(image.astype(np.uint16), (118, 147, 152, 163))


def test_an_aircraft_is_wider_than_a_star() -> None:
    image = draw(np.random.default_rng(10), [((60.0, 150.0), (260.0, 170.0), 6.0)], fwhm=9.0)
    assert "wider" in reason_of(image, (55, 145, 265, 175))


@pytest.mark.nightly("real and independent frames")
@pytest.mark.shared_data
@pytest.mark.skipif(not SHARED.exists(), reason="../shared/data is not here")
@pytest.mark.parametrize("name", ["geo_single_02", "geo_pair_dim_02"])
def test_independently_rendered_satellites_are_measured_to_half_a_pixel(name: str) -> None:
    folder = SHARED / "simulated" / name[:-3]
    frame = read_frame(folder / f"{name}.fits.bz2", 1)
    sky = local_background(frame.pixels)
    stars = find_stars(frame.pixels, sky, saturation_adu=frame.saturation_adu)
    truth = json.loads((folder / "truth.json").read_text())["frames"]
    rng = np.random.default_rng(11)
    for satellite in next(f for f in truth if f["file"].startswith(name))["objects"]:
        a = satellite["x_start"], satellite["y_start"]
        b = satellite["x_end"], satellite["y_end"]
        fit = fit_streak(frame.pixels, sky, box_of(a, b, rng), stars=stars)
        assert isinstance(fit, StreakFit)
        middle = (a[0] + b[0]) / 2, (a[1] + b[1]) / 2
        assert np.hypot(fit.x_px - middle[0], fit.y_px - middle[1]) < 0.5
        assert fit.length_px == pytest.approx(np.hypot(a[0] - b[0], a[1] - b[1]), abs=1.5)


@pytest.mark.shared_data
@pytest.mark.skipif(not SHARED.exists(), reason="../shared/data is not here")
def test_the_real_streaks_ends_agree_with_the_eye() -> None:
    frame = read_frame(SHARED / "real" / "astride_long.fits", 1)
    sky = local_background(frame.pixels)
    fit = fit_streak(frame.pixels, sky, (20, 305, 342, 340), stars=find_stars(frame.pixels, sky))
    assert isinstance(fit, StreakFit)
    two_pixels = 2.0
    (x_a, y_a), (x_b, y_b) = sorted([(fit.x_a_px, fit.y_a_px), (fit.x_b_px, fit.y_b_px)])
    assert np.hypot(x_a - 22, y_a - 338) < two_pixels
    assert np.hypot(x_b - 340, y_b - 308) < two_pixels


def test_a_star_just_beyond_an_end_is_not_part_of_the_streak() -> None:
    rng = np.random.default_rng(12)
    a, b = (100.0, 150.0), (219.0, 142.0)
    d = np.array([b[0] - a[0], b[1] - a[1]]) / np.hypot(b[0] - a[0], b[1] - a[1])
    for _ in range(8):
        star = np.array(a) - 7.5 * d + np.array([d[1], -d[0]])
        image = draw(rng, [(a, b, 3.5), (tuple(star), tuple(star + 0.5), 20.0)])
        fit = fit_streak(image, local_background(image), box_of(a, b, rng), psf_fwhm_px=2.3)
        assert isinstance(fit, StreakFit)
        # Taken for part of the streak it would move the midpoint by 4 px.
        assert np.hypot(fit.x_px - 159.5, fit.y_px - 146.0) < 1.5


def test_stars_in_a_row_are_no_streak() -> None:
    for seed in range(5):
        rng = np.random.default_rng(seed)
        at = np.cumsum(rng.uniform(5, 12, 11)) + 95
        row = [((x, 150.0), (x + 0.3, 150.0), rng.uniform(30, 90)) for x in at]
        reason = reason_of(draw(rng, row), (at[0] - 4, 144, at[-1] + 4, 156))
        assert "stars in a row" in reason


def test_whatever_is_proposed_the_answer_is_finite_or_a_reason() -> None:
    rng = np.random.default_rng(14)
    image = draw(rng, [((40.0, 60.0), (200.0, 220.0), 40.0)], stars=400)
    image[100:110, 200:230] = 65520
    sky, stars = local_background(image), find_stars(image)
    for _ in range(80):
        x, y = rng.uniform(-20, SIZE - 10, 2)
        w, h = rng.uniform(1, 150, 2)
        fit = fit_streak(image, sky, (x, y, x + w, y + h), stars=stars)
        if isinstance(fit, NoStreak):
            assert fit.reason
            continue
        values = [fit.x_px, fit.y_px, fit.length_px, fit.snr]
        assert np.all(np.isfinite([*values, fit.sigma_along_px, fit.sigma_across_px]))
        assert fit.sigma_along_px > 0
        assert fit.sigma_across_px > 0


def test_an_end_hidden_by_a_masked_star_is_known_only_as_well_as_the_mask_is_wide() -> None:
    a, b = (100.0, 150.0), (219.0, 142.0)
    image = draw(
        np.random.default_rng(15), [(a, b, 15.0), ((222.0, 142.0), (222.5, 142.0), 900.0)], stars=30
    )
    sky = local_background(image)
    stars = find_stars(image, sky)
    assert np.hypot(stars.x_px - 222.25, stars.y_px - 142).min() < 1
    fit = fit_streak(image, sky, (96, 138, 223, 154), stars=stars)
    assert isinstance(fit, StreakFit)
    error_px = np.hypot(fit.x_px - 159.5, fit.y_px - 146.0)
    # Of one end somewhere in the mask, halved by the midpoint: no more and no less.
    assert 0.4 < fit.sigma_along_px < 3.0
    assert error_px < 3 * fit.sigma_along_px


@pytest.mark.parametrize("count", [24, pytest.param(60, marks=MANY)])
def test_a_bright_star_near_an_end_costs_no_streak_and_no_honesty(count: int) -> None:
    rng = np.random.default_rng(7)
    errors, normalised = [], []
    for _ in range(count):
        peak_snr, beyond_px = float(rng.choice([5.0, 8.0, 15.0])), rng.uniform(-8.0, 12.0)
        angle = rng.uniform(0.0, np.pi)
        along = np.array([np.cos(angle), np.sin(angle)])
        middle = 160.0 + rng.uniform(-0.5, 0.5, 2)
        a, b = middle - 59.5 * along, middle + 59.5 * along
        star = b - beyond_px * along + rng.uniform(-2.0, 2.0) * np.array([-along[1], along[0]])
        lights = [(tuple(a), tuple(b), peak_snr)]
        lights += [
            (tuple(star - 0.25 * along), tuple(star + 0.25 * along), 10 ** rng.uniform(2, 3.7))
        ]
        image = draw(rng, lights, stars=30)
        sky = local_background(image)
        box = box_of(tuple(np.minimum(a, b)), tuple(np.maximum(a, b)), rng)
        fit = fit_streak(image, sky, box, stars=find_stars(image, sky))
        assert isinstance(fit, StreakFit), fit.reason
        errors.append(float(np.dot((fit.x_px, fit.y_px) - middle, along)))
        normalised.append(errors[-1] / fit.sigma_along_px)
    # Half of what an end off by a star's mask makes of the midpoint.
    assert np.percentile(np.abs(errors), 95) < 2.5
    assert np.mean(np.abs(normalised) < 3.0) > 0.95


@pytest.mark.parametrize("beyond_px", [-8.0, 8.0])
def test_a_faint_end_in_the_open_is_left_where_the_fit_has_it(beyond_px: float) -> None:
    errors = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        angle = rng.uniform(0.0, np.pi)
        along = np.array([np.cos(angle), np.sin(angle)])
        a, b = 160.0 - 59.5 * along, 160.0 + 59.5 * along
        star = b - beyond_px * along
        lights = [(tuple(a), tuple(b), 2.0), (tuple(star), tuple(star + 0.5 * along), 900.0)]
        image = draw(rng, lights, stars=30)
        sky = local_background(image)
        box = (*(np.minimum(a, b) - 4), *(np.maximum(a, b) + 4))
        fit = fit_streak(image, sky, box, stars=find_stars(image, sky))
        assert isinstance(fit, StreakFit), fit.reason
        errors.append(float(np.dot((fit.x_px - 160.0, fit.y_px - 160.0), along)))
    assert np.median(np.abs(errors)) < 1.0
    assert np.sort(np.abs(errors))[-2] < 3.5


@pytest.mark.parametrize("beyond_px", [9.0, 17.0])
def test_an_end_that_comes_out_behind_a_bright_star_is_found_where_it_is(beyond_px: float) -> None:
    a, b = (100.0, 150.0), (219.0, 142.0)
    along = np.array([b[0] - a[0], b[1] - a[1]]) / np.hypot(b[0] - a[0], b[1] - a[1])
    star = np.array(b) - beyond_px * along
    lights = [(a, b, 5.0), (tuple(star), tuple(star + 0.5 * along), 900.0)]
    image = draw(np.random.default_rng(16), lights, stars=30)
    sky = local_background(image)
    stars = find_stars(image, sky)
    assert np.hypot(stars.x_px - star[0], stars.y_px - star[1]).min() < 1
    fit = fit_streak(image, sky, (96, 138, 223, 154), stars=stars)
    assert isinstance(fit, StreakFit)
    end = max((fit.x_a_px, fit.y_a_px), (fit.x_b_px, fit.y_b_px))
    assert np.hypot(end[0] - b[0], end[1] - b[1]) < 0.6
    assert abs(fit.x_px - 159.5) < 3 * fit.sigma_along_px < 1.5
