"""A dark and a flat give the sky back, and what they know nothing of does no harm."""

from dataclasses import replace

import numpy as np
import pytest

from rsoconsole.config import DetectorConfig
from rsoconsole.records import Frame
from rsoconsole.vision import (
    ConfidenceCurve,
    DarkAndFlat,
    Network,
    StreakDetector,
    Workers,
    find_stars,
)
from rsoconsole.vision.frame.dark_and_flat import normalised_flat
from tests.drawn.uneven_camera import STREAK, UnevenCamera

SHAPE = HEIGHT, WIDTH = 200, 260
OFFSET, SKY, SIGMA = 300.0, 1000.0, 20.0


def stored(values: np.ndarray) -> np.ndarray:
    return np.clip(np.rint(values), 0, 65535).astype(np.uint16)


def of(pixels: np.ndarray, **other) -> Frame:
    return Frame(frame_id=1, name="a", pixels=pixels, **other)


def sky(seed: int = 1, sigma: float = SIGMA, level: float = SKY) -> np.ndarray:
    return np.random.default_rng(seed).normal(level, sigma, SHAPE)


@pytest.fixture(scope="module")
def detector() -> StreakDetector:
    network = Network.load(None, 1)
    curve = ConfidenceCurve.from_card(network.card)
    return StreakDetector(network, DetectorConfig(threads=1), curve)


# -- what it is for ----------------------------------------------------------------------------


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_streak_that_an_uneven_camera_hides_is_found_and_nothing_else(detector, seed: int):
    camera = UnevenCamera.made(seed)
    frame = camera.frame()
    x, y = (STREAK[0] + STREAK[2]) / 2.0, (STREAK[1] + STREAK[3]) / 2.0

    def is_true(found) -> bool:
        return abs(found.x_px - x) < 4.0 and abs(found.y_px - y) < 4.0

    assert not any(map(is_true, detector.detect(frame).detections))
    dark, flat = camera.masters()
    found = detector.detect(
        DarkAndFlat(dark, flat.astype(np.float32)).calibrated_frame(frame)
    ).detections
    assert [is_true(each) for each in found] == [True]
    assert found[0].confidence > 0.9


def test_what_is_left_is_the_noise_of_light_and_readout():
    """The variance of a Poisson process over the response, and nothing of the pattern."""
    camera = UnevenCamera.made(7)
    sky_e = 6000.0
    values = camera.note_frame(sky_e)
    dark, flat = camera.masters()
    left = DarkAndFlat(dark, flat.astype(np.float32)).calibrated_frame(of(stored(values))).pixels
    quiet = camera.dark_e < 100.0
    response = camera.response / np.median(camera.response)
    # One frame over masters of 16: the frame's own variance and a little of theirs.
    by_law = np.sqrt((sky_e * camera.response + camera.dark_e + 25.0) * (1 + 1 / 16)) / response
    pulls = (left - np.median(left)) / by_law
    five_percent = 0.05
    assert np.std(pulls[quiet]) == pytest.approx(1.0, rel=five_percent)
    before = (values - np.median(values)) / by_law
    assert np.std(before[quiet]) > 5.0


# -- nothing where there is nothing ------------------------------------------------------------


@pytest.mark.parametrize("sigma", [0.7, 3.0, SIGMA])
@pytest.mark.parametrize("master_dtype", [np.uint16, np.float32])
@pytest.mark.parametrize("has_mosaic", [False, True])
def test_a_dark_of_nothing_and_a_flat_of_one_change_nothing(sigma, master_dtype, has_mosaic):
    pixels = stored(sky(sigma=sigma))
    pixels[50:53, 60:63] = 65535
    nothing, one = np.zeros(SHAPE, master_dtype), np.ones(SHAPE, master_dtype)
    for frame in (of(pixels), of(pixels.astype(np.float32))):
        ready = DarkAndFlat(nothing, one, has_mosaic=has_mosaic)
        same = ready.calibrated_frame(frame)
        assert same.pixels.dtype == frame.pixels.dtype
        assert np.array_equal(same.pixels, frame.pixels)
        assert replace(same, pixels=frame.pixels).saturation_adu == frame.saturation_adu


def test_the_detector_says_the_same_of_it(detector):
    frame = UnevenCamera.made(3).frame()
    shape = frame.pixels.shape
    same = DarkAndFlat(np.zeros(shape, np.uint16), np.ones(shape, np.float32)).calibrated_frame(
        frame
    )
    one, other = detector.analyse(frame), detector.analyse(same)
    assert one.detections.detections == other.detections.detections
    assert one.detections.rejected == other.detections.rejected
    assert np.array_equal(one.stars.flux, other.stars.flux)


@pytest.mark.parametrize("threads", [1, 3])
def test_threads_and_the_frame_given_change_nothing(threads: int):
    rng = np.random.default_rng(4)
    pixels, dark = stored(sky()), rng.normal(OFFSET, 5.0, SHAPE).astype(np.float32)
    flat = rng.uniform(0.5, 1.5, SHAPE).astype(np.float32)
    before = pixels.copy()
    pixels.flags.writeable = False
    found = DarkAndFlat(dark, flat).calibrated_frame(of(pixels), Workers(threads)).pixels
    level, light = np.rint(np.median(dark[::5, ::5])), flat / np.median(flat[::5, ::5])
    truth = (before - dark.astype(float)) / light + level
    # Half of a whole number, and a gain in 65,535 steps.
    assert np.abs(found - truth).max() < 0.51 + 1e-5 * truth.max()
    assert np.array_equal(pixels, before)


# -- numbers that hold it ----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("sigma", "dark_step", "dtype"),
    [(20.0, 0.25, np.uint16), (1.5, 0.25, np.float32), (1.5, 1.0, np.uint16)],
)
def test_pixels_stay_whole_numbers_where_that_costs_nothing(sigma, dark_step, dtype):
    dark = np.full(SHAPE, OFFSET, np.float32)
    dark[::2] += dark_step
    assert DarkAndFlat(dark).calibrated_frame(of(stored(sky(sigma=sigma)))).pixels.dtype == dtype
    floats = sky(sigma=sigma).astype(np.float32)
    assert DarkAndFlat(dark).calibrated_frame(of(floats)).pixels.dtype == np.float32


def test_the_noise_of_a_dark_sky_is_not_cut_off():
    dark = np.random.default_rng(5).normal(OFFSET, 3.0, SHAPE).astype(np.float32)
    pixels = stored(sky(level=OFFSET, sigma=8.0))
    left = DarkAndFlat(dark).calibrated_frame(of(pixels)).pixels.astype(float)
    assert left.mean() == pytest.approx(OFFSET, abs=0.5)
    assert left.std() == pytest.approx(np.hypot(8.0, 3.0), rel=0.03)


# -- what saturates ----------------------------------------------------------------------------


@pytest.mark.parametrize("full", [4095.0, 65535.0])
def test_a_saturated_star_is_still_known_as_one(full: float):
    rng = np.random.default_rng(6)
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    light = np.zeros(SHAPE)
    for column, flux in ((60, 9.0), (130, 0.5), (200, 0.4)):
        light += flux * full * np.exp(-((x - column) ** 2 + (y - 100) ** 2) / (2 * 1.4**2))
    # The middle of the field gets 1.6 times the median of the light.
    response = np.where((abs(y - 100) < 40) & (abs(x - 130) < 100), 1.6, 1.0)
    dark = rng.normal(OFFSET, 2.0, SHAPE).astype(np.float32)
    raw = np.minimum(np.rint(dark + response * (sky(level=200.0) + light)), full)
    frame = of(stored(raw), saturation_adu=full)
    even = DarkAndFlat(dark, response.astype(np.float32)).calibrated_frame(frame)
    assert even.saturation_adu == full
    stars = find_stars(even.pixels, saturation_adu=even.saturation_adu)
    is_saturated = dict(zip(np.rint(stars.x_px / 10) * 10, stars.is_saturated, strict=True))
    assert is_saturated == {60.0: True, 130.0: False, 200.0: False}


def test_a_hot_pixel_that_saturates_takes_its_neighbours_value():
    dark = np.full(SHAPE, OFFSET, np.float32)
    hot = [(20, 30), (0, 0), (199, 259), (80, 81), (80, 82), (81, 81)]
    for row, column in hot:
        dark[row, column] = 65535.0
    pixels = stored(sky() + OFFSET)
    for row, column in hot:
        pixels[row, column] = 65535
    ready = DarkAndFlat(dark)
    even = ready.calibrated_frame(of(pixels)).pixels.astype(float)
    assert ready.defect_count(65535.0) == len(hot)
    for row, column in hot:
        assert even[row, column] == pytest.approx(SKY + OFFSET, abs=4 * SIGMA)
    # A camera of 12 bits: the same pixels are full at less.
    assert DarkAndFlat(np.minimum(dark, 4000.0)).defect_count(4095.0) == len(hot)


# -- flats that cannot be divided by -----------------------------------------------------------


@pytest.mark.parametrize("light", [0.0, -0.3, 0.05, 1e-9])
def test_a_pixel_without_light_in_the_flat_takes_its_neighbours_value(light: float):
    flat = np.full(SHAPE, 20000.0, np.float32)
    flat[:, 100] = light * 20000.0
    flat[33, 44] = light * 20000.0
    pixels = stored(sky() + OFFSET)
    pixels[:, 100] = pixels[33, 44] = OFFSET
    even = DarkAndFlat(np.full(SHAPE, OFFSET, np.float32), flat).calibrated_frame(of(pixels)).pixels
    assert even[33, 44] == pytest.approx(SKY + OFFSET, abs=4 * SIGMA)
    column = even[:, 100].astype(float)
    # The median of eight neighbours has less noise than a pixel.
    assert column.mean() == pytest.approx(SKY + OFFSET, abs=0.5 * SIGMA)
    assert 0.2 * SIGMA < column.std() < SIGMA


def test_a_corner_without_light_is_never_raised_more_than_tenfold():
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    flat = (1.0 - np.clip(1.4 - np.hypot(x, y) / 60.0, 0.0, 1.0)).astype(np.float32)
    pixels = stored(OFFSET + flat * sky())
    even = DarkAndFlat(np.full(SHAPE, OFFSET, np.float32), flat).calibrated_frame(of(pixels)).pixels
    lit = flat > 0.1
    assert abs(even[lit].mean() - SKY - OFFSET) < 2.0
    assert even[~lit].max() < OFFSET + 1.2 * SKY
    steps = np.abs(np.diff(even[0].astype(float)))
    assert steps.max() < 12 * SIGMA  # no edge: it grows dark by and by


def test_a_flat_without_light_is_refused():
    with pytest.raises(ValueError, match="no light"):
        normalised_flat(np.zeros(SHAPE, np.float32))
    with pytest.raises(ValueError, match="does not fit"):
        DarkAndFlat(np.zeros(SHAPE, np.float32), np.ones((10, 10), np.float32))
    with pytest.raises(ValueError, match="do not fit"):
        DarkAndFlat(np.zeros(SHAPE, np.float32)).calibrated_frame(
            of(np.ones((300, 300), np.uint16))
        )


def test_the_colours_of_a_mosaic_keep_their_levels():
    """A warm lamp lights blue a twentieth: that is no dark pixel."""
    colours = np.ones(SHAPE, np.float32)
    colours[1::2, 1::2] = 0.05
    y, _ = np.mgrid[:HEIGHT, :WIDTH]
    vignette = 1.0 - 0.4 * y / HEIGHT
    pixels = stored(OFFSET + vignette * sky())
    dark = np.full(SHAPE, OFFSET, np.float32)
    ready = DarkAndFlat(dark, (20000.0 * colours * vignette).astype(np.float32), has_mosaic=True)
    even = ready.calibrated_frame(of(pixels)).pixels.astype(float) - OFFSET
    assert ready.defect_count(65535.0) == 0
    for row in (0, 1):
        rows = even[row::2, 1::2].mean(axis=1)
        assert rows[:20].mean() == pytest.approx(rows[-20:].mean(), rel=0.01)
    assert even[::2, ::2].mean() == pytest.approx(even[1::2, 1::2].mean(), rel=0.02)
