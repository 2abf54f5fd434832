"""A streak's middle where the image shook: nearer than that of its ends, and as near as it says."""

import numpy as np
import pytest
from scipy.signal import lfilter

from rsoconsole.records import FloatArray, PixelArray
from rsoconsole.vision import StarList, detection_in_original_pixels, local_background
from rsoconsole.vision.stars.star_moments import FWHM_PER_SIGMA
from rsoconsole.vision.streaks.streak_middle import StreakMiddle, find_middle, with_middle_by_light
from tests.makers import straight_detection

SKY, NOISE, FWHM_PX = 400.0, 12.0, 3.0
SIZE = (160, 240)
"""Height, width."""
A, B = (75.0, 70.0), (150.0, 98.0)
LENGTH = float(np.hypot(B[0] - A[0], B[1] - A[1]))
AHEAD = np.subtract(B, A) / LENGTH
STEPS = 800


def wander(rng: np.random.Generator, sigma_px: float, lasts: float) -> FloatArray:
    """(2, STEPS) of zero mean: an Ornstein-Uhlenbeck process."""
    kept = np.exp(-1.0 / (STEPS * lasts))
    fresh = rng.normal(size=(2, STEPS)) * np.sqrt(1.0 - kept**2)
    fresh[:, 0] /= np.sqrt(1.0 - kept**2)
    path = lfilter([1.0], [1.0, -kept], fresh)
    return sigma_px * (path - path.mean(axis=1, keepdims=True))


def shaken(
    rng: np.random.Generator,
    sigma_px: float,
    *,
    peak: float = 80.0,
    steady: FloatArray | None = None,
    stars: int = 0,
) -> PixelArray:
    """A frame with a streak from A to B in the mean, its image shaken by so much."""
    share = (np.arange(STEPS) + 0.5) / STEPS
    path = wander(rng, sigma_px, 0.15)
    x = A[0] + share * (B[0] - A[0]) + path[0]
    y = A[1] + share * (B[1] - A[1]) + path[1]
    light = np.ones(STEPS) if steady is None else steady
    s = FWHM_PX / FWHM_PER_SIGMA
    # As bright as a steady streak with such a ridge, over its length.
    total = peak * LENGTH * np.sqrt(2.0 * np.pi) * s
    image = np.full(SIZE, SKY)
    across_y = np.exp(-0.5 * ((np.arange(SIZE[0])[:, None] - y) / s) ** 2)
    across_x = np.exp(-0.5 * ((np.arange(SIZE[1])[:, None] - x) / s) ** 2)
    image += (across_y * light) @ across_x.T * total / STEPS / (2.0 * np.pi * s**2)
    for _ in range(stars):
        at = rng.uniform((60.0, 60.0), (165.0, 108.0))
        flux = rng.exponential(30.0)
        image += flux * np.outer(
            np.exp(-0.5 * ((np.arange(SIZE[0]) - at[1]) / s) ** 2),
            np.exp(-0.5 * ((np.arange(SIZE[1]) - at[0]) / s) ** 2),
        )
    return (image + rng.normal(0.0, NOISE, SIZE)).astype(np.float32)


def as_wide_as_wind(sigma_px: float) -> float:
    """Width of stars in such wind: they are drawn all the while."""
    return FWHM_PER_SIGMA * float(np.hypot(FWHM_PX / FWHM_PER_SIGMA, sigma_px))


def no_stars(sigma_px: float = 0.0) -> StarList:
    """None that is listed."""
    none = np.zeros(0)
    return StarList(
        x_px=none,
        y_px=none,
        flux=none,
        fwhm_px=none,
        snr=none,
        is_saturated=none > 0.0,
        median_fwhm_px=as_wide_as_wind(sigma_px),
    )


def measured(
    frame: PixelArray, sigma_px: float = 0.0, off_px: tuple[float, float] = (0.0, 0.0)
) -> StreakMiddle | None:
    """With ends that are off along the streak."""
    a, b = np.array(A) + off_px[0] * AHEAD, np.array(B) + off_px[1] * AHEAD
    ends = float(a[0]), float(a[1]), float(b[0]), float(b[1])
    width_px = as_wide_as_wind(sigma_px)
    return find_middle(frame, local_background(frame), ends, no_stars(sigma_px), width_px)


def errors(sigma_px: float, count: int = 30, **more: object) -> tuple[FloatArray, FloatArray]:
    """(N,) error of the middle, px, and what was stated of it."""
    found = []
    for seed in range(count):
        rng = np.random.default_rng(seed)
        off = float(rng.normal(0.0, 1.0)), float(rng.normal(0.0, 1.0))
        middle = measured(shaken(rng, sigma_px, **more), sigma_px, off)  # type: ignore[arg-type]
        if middle is not None:
            found.append((middle.offset_px + 0.5 * sum(off), middle.sigma_px))
    assert len(found) > 0.7 * count
    error, stated = np.array(found).T
    return error, stated


@pytest.mark.parametrize("sigma_px", [0.0, 1.0, 2.0])
def test_the_middle_is_as_near_as_it_says(sigma_px: float) -> None:
    error, stated = errors(sigma_px)
    scatter = 1.4826 * float(np.median(np.abs(error / stated)))
    assert 0.5 < scatter < 1.5
    assert np.mean(np.abs(error) > 3.0 * stated) <= 0.08


def test_it_is_nearer_than_two_ends_in_wind_could_be() -> None:
    """Ends that are found without error are off by the image's place at two instants."""
    error, _ = errors(2.0)
    assert np.sqrt(np.mean(error**2)) < 0.6 * 2.0 / np.sqrt(2.0)


def test_without_wind_it_is_where_the_ends_are() -> None:
    error, stated = errors(0.0)
    assert np.sqrt(np.mean(error**2)) < 0.25
    assert np.median(stated) < 0.25


def test_faint_stars_beside_it_make_its_error_larger() -> None:
    _, clear = errors(1.0, 20)
    error, crowded = errors(1.0, 30, stars=60)
    assert np.median(crowded) > 1.3 * np.median(clear)
    assert 1.4826 * np.median(np.abs(error / crowded)) < 1.6


def test_a_star_that_is_much_of_its_light_is_no_measure() -> None:
    frame = shaken(np.random.default_rng(1), 1.0)
    rows, columns = np.mgrid[0 : SIZE[0], 0 : SIZE[1]]
    s = FWHM_PX / FWHM_PER_SIGMA
    star = 2500.0 * np.exp(-0.5 * ((columns - 140.0) ** 2 + (rows - 94.0) ** 2) / s**2)
    assert measured(frame, 1.0) is not None
    assert measured((frame + star).astype(np.float32), 1.0) is None


def test_the_length_is_that_of_the_even_motion() -> None:
    lengths = []
    for seed in range(20):
        middle = measured(shaken(np.random.default_rng(seed), 0.0))
        assert middle is not None
        lengths.append((middle.length_px - LENGTH) / middle.sigma_length_px)
    assert np.sqrt(np.mean(np.square(lengths))) < 2.0


def test_a_whole_streak_alone_has_one() -> None:
    frame = shaken(np.random.default_rng(3), 0.5)
    sky = local_background(frame)
    ends = {"x_a_px": A[0], "y_a_px": A[1], "x_b_px": B[0], "y_b_px": B[1]}
    whole = straight_detection(**ends)
    told = with_middle_by_light(frame, sky, no_stars(0.5), whole)
    assert told.light_offset_px is not None
    assert told.light_length_px == pytest.approx(LENGTH, abs=3.0)
    assert told == whole  # an older night's streak, measured again, is the same one
    for other in ({"is_clipped": True}, {"method": "box"}):
        detection = straight_detection(**ends, **other)
        assert with_middle_by_light(frame, sky, no_stars(0.5), detection).light_offset_px is None


def test_in_a_frame_of_joined_pixels_it_is_in_those_of_the_original() -> None:
    joined = straight_detection(light_offset_px=0.5, light_sigma_px=0.25, light_length_px=118.0)
    told = detection_in_original_pixels(joined, 2)
    assert (told.light_offset_px, told.light_sigma_px, told.light_length_px) == (1.0, 0.5, 236.0)
    assert told.light_length_sigma_px is None
