"""Short streaks among the lights that are too long for a star."""

import math

import cv2
import numpy as np
import pytest

from rsoconsole.records import Frame
from rsoconsole.sky import line_angle_deg
from rsoconsole.vision import find_stars, local_background
from rsoconsole.vision.lines.line_filter import CellLine
from rsoconsole.vision.lines.short_lines import MAX_SHORT, interleaved_lines, short_lines
from tests.campaign.streaks import detector
from tests.drawn.drawn_lines import exposed, line_of_light

SHAPE = (600, 900)
SIGMA_PX = 1.8
FWHM_PX = 2.3548 * SIGMA_PX


def sky_with_stars(rng, count: int = 60) -> np.ndarray:
    """Light of stars that are SIGMA_PX wide."""
    light = np.zeros(SHAPE)
    for x, y in rng.uniform((20, 20), (SHAPE[1] - 20, SHAPE[0] - 20), (count, 2)):
        light[int(y), int(x)] += math.exp(rng.uniform(8.5, 11.0))
    return cv2.GaussianBlur(light, (0, 0), SIGMA_PX)


def looked_at(light, rng):
    pixels = exposed(light, rng)
    return find_stars(pixels, local_background(pixels))


@pytest.mark.parametrize("seed", range(8))
def test_a_streak_of_a_few_widths_is_proposed_as_it_lies(seed):
    rng = np.random.default_rng(seed)
    angle, length_px = rng.uniform(0.0, math.pi), rng.uniform(2.5, 5.0) * FWHM_PX
    dx, dy = 0.5 * length_px * math.cos(angle), 0.5 * length_px * math.sin(angle)
    line = line_of_light(SHAPE, (450.0 - dx, 300.0 - dy, 450.0 + dx, 300.0 + dy), SIGMA_PX)
    light = sky_with_stars(rng)
    light[260:340, 410:490] = 0.0
    light += line * 400.0 / line.max()
    found = short_lines(looked_at(light, rng), [])
    near = [
        each
        for each in found
        if math.hypot(0.5 * (each.x_a + each.x_b) - 450, 0.5 * (each.y_a + each.y_b) - 300) < 10
    ]
    assert len(near) == 1
    one = near[0]
    direction = math.degrees(math.atan2(one.y_b - one.y_a, one.x_b - one.x_a)) % 180.0
    assert line_angle_deg(direction, math.degrees(angle) % 180.0) < 6.0


def test_round_stars_are_proposed_by_none():
    rng = np.random.default_rng(3)
    light = np.zeros(SHAPE)
    for row in range(40, 600, 80):
        for column in range(40, 900, 80):
            light[row, column] = math.exp(rng.uniform(8.5, 11.0))
    stars = looked_at(cv2.GaussianBlur(light, (0, 0), SIGMA_PX), rng)
    assert len(stars) > 50
    assert short_lines(stars, []) == []


def test_of_a_line_that_is_proposed_already_one_piece_is_and_in_all_so_many():
    rng = np.random.default_rng(4)
    light = sky_with_stars(rng) + 2000.0 * line_of_light(SHAPE, (100, 100, 500, 300), SIGMA_PX)
    for row in range(400, 600, 28):
        light += 2000.0 * line_of_light(SHAPE, (600, row, 616, row), SIGMA_PX)
        light += 2000.0 * line_of_light(SHAPE, (700, row, 716, row), SIGMA_PX)
    stars = looked_at(light, rng)
    alone = short_lines(stars, [])
    beside = short_lines(stars, [CellLine(x_a=100, y_a=100, x_b=500, y_b=300, snr=50.0)])
    assert len(alone) == len(beside) == MAX_SHORT

    def on_it(lines):
        return [each for each in lines if abs(each.y_a - (50 + 0.5 * each.x_a)) < 4.0]

    assert len(on_it(alone)) > 1
    assert len(on_it(beside)) == 1


def test_the_best_of_either_comes_first():
    def line(place: float) -> CellLine:
        return CellLine(x_a=place, y_a=0.0, x_b=place, y_b=9.0, snr=9.0)

    found, short = [line(1.0), line(2.0), line(3.0)], [line(10.0)]
    assert [each.x_a for each in interleaved_lines(found, short)] == [1.0, 10.0, 2.0, 3.0]


def test_among_drawn_out_stars_what_lies_otherwise_is_proposed():
    rng, half = np.random.default_rng(6), 9.0
    light = line_of_light(SHAPE, (430.0, 285.0, 470.0, 315.0), SIGMA_PX) * 1500.0
    for x, y in rng.uniform((30, 30), (SHAPE[1] - 30, SHAPE[0] - 30), (45, 2)):
        if abs(x - 450.0) > 60.0 or abs(y - 300.0) > 40.0:
            one = line_of_light(SHAPE, (x - half, y + 2.0, x + half, y - 2.0), SIGMA_PX)
            light += one * math.exp(rng.uniform(7.0, 8.5))
    stars = looked_at(light, rng)
    assert stars.trail is not None
    (one,) = (
        each
        for each in short_lines(stars, [])
        if math.hypot(0.5 * (each.x_a + each.x_b) - 450, 0.5 * (each.y_a + each.y_b) - 300) < 10
    )
    direction = math.degrees(math.atan2(one.y_b - one.y_a, one.x_b - one.x_a)) % 180.0
    assert line_angle_deg(direction, math.degrees(math.atan2(30.0, 40.0))) < 4.0


def found_at(light, rng, x: float, y: float):
    """What the program as it ships finds there, in a frame of the paper's scale."""
    frame = Frame(
        frame_id=1,
        name="drawn",
        pixels=exposed(light, rng),
        exposure_s=10.0,
        scale_arcsec_px=1.264,
        saturation_adu=65535.0,
    )
    found = detector().detect(frame, tau=0.10).detections
    return [d for d in found if math.hypot(d.x_px - x, d.y_px - y) < 8.0]


@pytest.mark.parametrize("length_fwhm", [3.5, 5.0])
def test_out_of_focus_a_bright_streak_of_a_few_widths_is_found(length_fwhm):
    sigma_px, hits = 4.0, 0
    for seed in range(4):
        rng = np.random.default_rng(seed)
        light = np.zeros((1200, 1600))
        for x, y in rng.uniform((30, 30), (1570, 1170), (90, 2)):
            light[int(y), int(x)] += math.exp(rng.uniform(9.5, 12.0))
        light = cv2.GaussianBlur(light, (0, 0), sigma_px)
        light[500:700, 700:900] = 0.0
        angle, half = rng.uniform(0.0, math.pi), 0.5 * length_fwhm * 2.3548 * sigma_px
        dx, dy = half * math.cos(angle), half * math.sin(angle)
        ends = (800.0 - dx, 600.0 - dy, 800.0 + dx, 600.0 + dy)
        light += 4000.0 * line_of_light(light.shape, ends, sigma_px)
        hits += len(found_at(light, rng, 800.0, 600.0)) == 1
    assert hits >= 3
