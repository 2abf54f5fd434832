"""The images of lines that the verifier looks at: one size, one direction, one unit of noise."""

import math

import numpy as np
import pytest

from rsoconsole.vision import find_stars, local_background
from rsoconsole.vision.lines.line_images import COLUMNS, ROWS, line_images
from rsoconsole.vision.stars.point_image import PointImage
from tests.drawn.drawn_lines import exposed, integrated_snr, line_of_light, random_ends, stars

SHAPE = (600, 800)
SIGMA = 1.1
FOCUS = PointImage(fwhm_px=2.3548 * SIGMA)


def images_of(frame, lines, focus: PointImage = FOCUS):
    sky = local_background(frame)
    lines = np.array(lines, dtype=np.float64).reshape(-1, 4)
    return line_images(frame, sky, find_stars(frame, sky), focus, lines)


@pytest.mark.parametrize("length", [30.0, 120.0, 480.0])
@pytest.mark.parametrize("seed", range(3))
def test_a_streak_lies_along_the_middle_between_its_drawn_ends(length, seed):
    rng = np.random.default_rng([seed, int(length)])
    ends = random_ends(rng, SHAPE, length)
    light = line_of_light(SHAPE, ends, SIGMA)
    frame = exposed(light * 60.0 * 30.0 / integrated_snr(light, 1.0), rng)
    made = images_of(frame, [ends])
    limited, drawn = made.images[0, 0], made.images[0, 3]
    across = limited[:, drawn.max(axis=0) > 0.5].mean(axis=1)
    assert abs(int(np.argmax(across)) - (ROWS - 1) / 2) <= 1.0
    along = limited[ROWS // 2 - 1 : ROWS // 2 + 1].mean(axis=0)
    inside = drawn.max(axis=0) > 0.5
    assert along[inside].mean() > 4.0 * abs(along[~inside].mean())
    assert np.corrcoef(limited.ravel(), drawn.ravel())[0, 1] > 0.6


@pytest.mark.parametrize("length", [40.0, 150.0, 500.0])
@pytest.mark.parametrize("fwhm_px", [1.5, 2.5, 5.0])
def test_noise_scatters_by_one_unit_whatever_length_and_width(length, fwhm_px):
    rng = np.random.default_rng(2)
    frame = exposed(np.zeros(SHAPE), rng)
    lines = [random_ends(rng, SHAPE, length) for _ in range(20)]
    made = images_of(frame, lines, PointImage(fwhm_px=fwhm_px))
    inside = made.images[:, 2] > -0.5
    assert 0.6 < 4.0 * made.images[:, 0][inside].std() < 1.15
    assert abs(4.0 * made.images[:, 0][inside].mean()) < 0.1


def test_gain_and_level_change_nothing():
    rng = np.random.default_rng(4)
    ends = random_ends(rng, SHAPE, 100.0)
    light = line_of_light(SHAPE, ends, SIGMA)
    frame = exposed(light * 40.0 * 30.0 / integrated_snr(light, 1.0), rng)
    one = images_of(frame, [ends])
    other = images_of(frame.astype(np.float32) * 1.7 + 900.0, [ends])
    assert np.abs(one.images - other.images).max() < 0.1
    assert np.abs(one.figures - other.figures).max() < 1e-6


def test_listed_stars_and_what_lies_outside_are_in_a_channel_of_their_own():
    rng = np.random.default_rng(5)
    frame = exposed(4.0 * stars(SHAPE, 150, SIGMA, rng), rng)
    sky = local_background(frame)
    found = find_stars(frame, sky)
    x, y = float(found.x_px[0]), float(found.y_px[0])
    made = images_of(frame, [(x - 60.0, y, x + 60.0, y), (-40.0, 300.0, 60.0, 300.0)])
    at = np.unravel_index(int(np.argmax(made.images[0, 2])), (ROWS, COLUMNS))
    assert abs(at[0] - (ROWS - 1) / 2) <= 1.0
    assert abs(at[1] - (COLUMNS - 1) / 2) <= 1.5
    margin, column_px, _ = made.scales[1]
    outside = math.floor((40.0 + margin) / column_px) - 1
    assert np.all(made.images[1, 2, :, :outside] < -0.9)
    assert np.all(made.images[1, 0, :, :outside] == 0.0)


def test_a_line_wholly_outside_is_no_trouble():
    frame = exposed(np.zeros(SHAPE), np.random.default_rng(6))
    made = images_of(frame, [(-900.0, -900.0, -800.0, -880.0)])
    assert np.all(made.images[0, 2] == -1.0)
