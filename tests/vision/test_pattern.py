"""Row and column offsets are found as they are, and nothing is touched where there are none."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from rsoconsole.config import DetectorConfig
from rsoconsole.instruments import read_frame
from rsoconsole.vision import ConfidenceCurve, Network, StreakDetector, find_row_column_pattern

SIZE = (900, 1200)
SIGMA = 12.0
SIMULATED = Path(__file__).resolve().parents[3] / "shared" / "data" / "simulated"


def noise(seed: int = 1, sigma: float = SIGMA) -> np.ndarray:
    """A sky of 700 ADU with a gradient, 600 stars and a trail, float64."""
    random = np.random.default_rng(seed)
    sky = 700.0 + random.normal(0.0, sigma, SIZE)
    sky += np.linspace(0.0, 300.0, SIZE[0])[:, None] + np.linspace(-80.0, 80.0, SIZE[1])
    y, x = random.integers(3, SIZE[0] - 3, 600), random.integers(3, SIZE[1] - 3, 600)
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            sky[y + dy, x + dx] += random.exponential(500.0, 600)
    sky[400:403, 300:700] += 5.0 * sigma  # along the rows, a third of them long
    return sky


def stored(sky: np.ndarray) -> np.ndarray:
    return np.clip(np.rint(sky), 0, 65535).astype(np.uint16)


@pytest.mark.parametrize("rows", [0.0, 0.5, 2.0])
@pytest.mark.parametrize("columns", [0.0, 0.5, 2.0])
def test_offsets_are_found_to_a_fifth_of_a_pixel_s_noise(rows: float, columns: float):
    random = np.random.default_rng(2)
    by_row = rows * SIGMA * random.standard_normal(SIZE[0])
    by_column = columns * SIGMA * random.standard_normal(SIZE[1])
    sky = noise()
    pixels = stored(sky + by_row[:, None] + by_column)
    pattern = find_row_column_pattern(pixels)
    if rows == columns == 0.0:
        assert pattern is None
        return
    assert pattern is not None
    assert pattern.noise_adu == pytest.approx(SIGMA, rel=0.15)
    for found, true in ((pattern.rows, by_row), (pattern.columns, by_column)):
        if not np.any(true):
            assert found is None
            continue
        assert found is not None
        assert np.std(found - true) < 0.2 * SIGMA + 0.1 * np.std(true)
    left = pattern.removed(pixels).astype(float) - sky
    assert pattern.removed(pixels).dtype == np.uint16
    assert np.std(left) < 0.3 * SIGMA + 0.12 * np.std(by_row[:, None] + by_column)


def test_a_trail_along_the_rows_keeps_its_light():
    random = np.random.default_rng(3)
    pixels = stored(noise() + SIGMA * random.standard_normal(SIZE[0])[:, None])
    pattern = find_row_column_pattern(pixels)
    assert pattern is not None
    cleaned = pattern.removed(pixels).astype(float)
    trail = np.median(cleaned[401, 300:700]) - np.median(cleaned[396:399, 300:700])
    assert trail == pytest.approx(5.0 * SIGMA, rel=0.15)


@pytest.mark.parametrize("sigma", [1.0, 4.0])
def test_faint_steps_are_kept_as_they_are_in_numbers_that_hold_them(sigma: float):
    offsets = sigma * np.random.default_rng(4).standard_normal(SIZE[0])
    pixels = stored(noise(sigma=sigma) + offsets[:, None])
    pattern = find_row_column_pattern(pixels)
    assert pattern is not None
    assert pattern.removed(pixels).dtype == np.float32


def test_a_mosaic_is_no_pattern():
    sky = noise()
    sky[::2, ::2] *= 0.8
    sky[1::2, 1::2] *= 0.7
    assert find_row_column_pattern(stored(sky)) is None


def test_a_frame_without_noise_has_none():
    assert find_row_column_pattern(np.full(SIZE, 700, np.uint16)) is None


@pytest.mark.shared_data
@pytest.mark.skipif(not SIMULATED.exists(), reason=f"{SIMULATED} is not here")
@pytest.mark.parametrize(
    "most", [1, pytest.param(3, marks=pytest.mark.nightly("looks at every frame"))]
)
@pytest.mark.nightly("many independent frames")
def test_independent_frames_are_untouched_and_when_striped_their_streaks_are_found_still(most):
    """Of five with row and column noise of 1.5 and 0.7 sigma none was found before."""
    network = Network.load(None, 1)
    curve = ConfidenceCurve.from_card(network.card)
    detector = StreakDetector(network, DetectorConfig(threads=1), curve)
    random = np.random.default_rng(5)
    for sequence, files in (("geo_single", 3), ("geo_pair_dim", 2)):
        truth = json.loads((SIMULATED / sequence / "truth.json").read_text())
        assert len(truth["frames"]) == files
        for number, told in enumerate(truth["frames"][:most]):
            frame = read_frame(SIMULATED / sequence / told["file"], number)
            assert find_row_column_pattern(frame.pixels) is None
            steps = frame.pixels[::50, 2:].astype(float) - frame.pixels[::50, :-2]
            sigma = 1.4826 * float(np.median(np.abs(steps))) / math.sqrt(2.0)
            height, width = frame.pixels.shape
            striped = frame.pixels + 1.5 * sigma * random.standard_normal(height)[:, None]
            striped += 0.7 * sigma * random.standard_normal(width)
            pixels = stored(striped)
            found = detector.detect(_with(frame, pixels)).detections
            asked = [each for each in told["objects"] if each["snr_peak_pixel"] >= 3.0]
            assert len(found) == len(asked)
            for true in asked:
                off = [math.hypot(d.x_px - true["x"], d.y_px - true["y"]) for d in found]
                assert min(off) < 3.0


def _with(frame, pixels):
    import dataclasses

    return dataclasses.replace(frame, pixels=pixels)


@pytest.mark.parametrize(("sigma", "rows"), [(35.0, 60.0), (35.0, 16.0), (12.0, 6.0), (7.0, 4.0)])
def test_what_is_left_of_a_row_is_too_little_for_a_line(sigma, rows):
    """A converter of steps of 16, half a sigma each to two: four sigmas of what is left along a
    whole row stay below what a line filter takes for light. Short exposures have so little noise.
    """
    random = np.random.default_rng(3)
    by_row = random.normal(0.0, rows, 700)
    sky = random.normal(1003.0, sigma, (700, 4656)) + by_row[:, None]
    pixels = (np.round(sky / 16.0) * 16.0).astype(np.uint16)
    pattern = find_row_column_pattern(pixels)
    assert pattern is not None
    assert pattern.rows is not None
    assert pattern.noise_adu == pytest.approx(math.hypot(sigma, 16.0 / math.sqrt(12.0)), rel=0.1)
    # From row to row: what changes slowly is the sky's to any local background.
    left = pattern.removed(pixels).mean(axis=1)
    assert np.std(np.diff(left)) / math.sqrt(2.0) < 0.07 * sigma


def test_coarse_steps_alone_are_no_stripes():
    random = np.random.default_rng(4)
    for sigma in (5.0, 7.0, 12.0, 35.0):
        sky = random.normal(1003.0, sigma, (700, 4656))
        assert find_row_column_pattern((np.round(sky / 16.0) * 16.0).astype(np.uint16)) is None
