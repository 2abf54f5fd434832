"""A short light held against images of the frame's own stars, drawn here by NumPy alone."""

import math

import cv2
import numpy as np
import pytest

from rsoconsole.vision import StarList, find_stars, local_background
from rsoconsole.vision.lines.line_or_stars import StarImageComparer
from rsoconsole.vision.stars.star_image import median_star_image
from rsoconsole.vision.stars.star_list import StarTrail
from tests.drawn.drawn_lines import exposed, line_of_light
from tests.makers import straight_detection

SHAPE = (500, 700)
MIDDLE = (350.0, 250.0)
SEEING_PX = 1.3


def disc(sigma_px: float = 2.0) -> np.ndarray:
    line = cv2.getGaussianKernel(31, sigma_px)
    return line @ line.T


def ring(radius_px: float = 6.0) -> np.ndarray:
    """Out of focus behind a mirror whose middle is dark."""
    v, u = np.mgrid[-15:16, -15:16]
    away = np.hypot(u, v)
    lit = (away <= radius_px) & (away >= 0.4 * radius_px)
    return cv2.GaussianBlur(lit / lit.sum(), (0, 0), SEEING_PX)


def trail(length_px: float = 16.0, angle_deg: float = 30.0) -> np.ndarray:
    dx, dy = (0.5 * length_px * f(math.radians(angle_deg)) for f in (math.cos, math.sin))
    drawn = line_of_light((41, 41), (20 - dx, 20 - dy, 20 + dx, 20 + dy), SEEING_PX)
    return drawn / drawn.sum()


SHAPES = {"disc": disc(), "ring": ring()}


def field(shape: np.ndarray, rng, bare_px: float = 60.0) -> tuple[np.ndarray, np.ndarray]:
    """Points of light where stars are and the light they give; none near the middle."""
    places = rng.uniform((25, 25), (SHAPE[1] - 25, SHAPE[0] - 25), (70, 2))
    far = np.hypot(places[:, 0] - MIDDLE[0], places[:, 1] - MIDDLE[1]) > bare_px
    light = np.zeros(SHAPE)
    for x, y in places[far]:
        light[int(y), int(x)] += math.exp(rng.uniform(8.5, 10.5))
    return places[far], cv2.filter2D(light, -1, shape, borderType=cv2.BORDER_CONSTANT)


def along(length_px: float, angle: float) -> tuple[float, float, float, float]:
    dx, dy = 0.5 * length_px * math.cos(angle), 0.5 * length_px * math.sin(angle)
    return MIDDLE[0] - dx, MIDDLE[1] - dy, MIDDLE[0] + dx, MIDDLE[1] + dy


def held(light: np.ndarray, ends, stars_light: np.ndarray, rng, stars: StarList | None = None):
    pixels = exposed(stars_light + light, rng)
    sky = local_background(pixels)
    lights = StarImageComparer(pixels, sky, find_stars(pixels, sky) if stars is None else stars)
    x_a, y_a, x_b, y_b = ends
    found = straight_detection(
        x_px=0.5 * (x_a + x_b),
        y_px=0.5 * (y_a + y_b),
        length_px=math.hypot(x_b - x_a, y_b - y_a),
        angle_deg=math.degrees(math.atan2(y_b - y_a, x_b - x_a)),
    )
    return lights.compared(found)


def streak(shape: np.ndarray, ends, electrons: float) -> np.ndarray:
    line = line_of_light(SHAPE, ends, 0.4)
    return electrons * cv2.filter2D(line / line.sum(), -1, shape)


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("seed", range(6))
def test_a_streak_of_a_few_widths_is_one_line(name, seed):
    rng = np.random.default_rng(seed)
    _, stars = field(SHAPES[name], rng)
    ends = along(rng.uniform(20.0, 40.0), rng.uniform(0.0, math.pi))
    said = held(streak(SHAPES[name], ends, 3e4), ends, stars, rng)
    assert said is not None
    assert said.over_stars > 60.0
    assert said.left < 1.6


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("seed", range(6))
def test_two_or_three_stars_in_a_row_are_stars(name, seed):
    rng = np.random.default_rng(seed)
    _, stars = field(SHAPES[name], rng)
    angle, count = rng.uniform(0.0, math.pi), 2 + seed % 2
    ends = along(rng.uniform(18.0, 30.0), angle)
    light = np.zeros(SHAPE)
    for t in np.linspace(0.0, 1.0, count):
        x, y = ends[0] + t * (ends[2] - ends[0]), ends[1] + t * (ends[3] - ends[1])
        # Beside the line, and between the pixels.
        moved = np.array([[1.0, 0.0, x - 350.0], [0.0, 1.0, y - 250.0]])
        point = np.zeros(SHAPE)
        point[250, 350] = rng.uniform(0.5, 1.0) * 2e4
        blurred = cv2.filter2D(point, -1, SHAPES[name])
        light += cv2.warpAffine(blurred, moved, SHAPE[::-1], flags=cv2.INTER_CUBIC)
    said = held(light, ends, stars, rng)
    assert said is not None
    assert said.over_stars < 30.0


@pytest.mark.parametrize("seed", range(4))
def test_a_cosmic_ray_did_not_come_through_the_optics(seed):
    """As wide as the stars in the middle, but with the grain of a track."""
    rng = np.random.default_rng(seed)
    _, stars = field(disc(1.1), rng)
    ends = along(30.0, rng.uniform(0.0, math.pi))
    light = np.zeros(SHAPE)
    for t in np.linspace(0.0, 1.0, 90):
        x, y = ends[0] + t * (ends[2] - ends[0]), ends[1] + t * (ends[3] - ends[1])
        light[round(y), round(x)] += rng.gamma(2.0, 0.5) * 700.0
    ray = held(light, ends, stars, rng)
    line = held(streak(disc(1.1), ends, light.sum()), ends, stars, rng)
    assert ray is not None
    assert line is not None
    assert ray.left > 4.0
    assert line.left < 1.6


@pytest.mark.parametrize("turn_deg", [0.0, 40.0, 90.0])
def test_what_moved_otherwise_than_drawn_out_stars_is_a_line(turn_deg):
    rng = np.random.default_rng(7)
    places, light = field(trail(), rng)
    stars = StarList(
        x_px=places[:, 0].astype(int).astype(float),
        y_px=places[:, 1].astype(int).astype(float),
        flux=np.ones(len(places)),
        fwhm_px=np.full(len(places), 2.3548 * SEEING_PX),
        snr=np.full(len(places), 100.0),
        is_saturated=np.zeros(len(places), bool),
        median_fwhm_px=2.3548 * SEEING_PX,
        trail=StarTrail(length_px=16.0, angle_deg=30.0, fwhm_px=2.3548 * SEEING_PX),
    )
    ends = along(30.0, math.radians(30.0 + turn_deg))
    one = held(streak(disc(SEEING_PX), ends, 3e4), ends, light, rng, stars)
    assert one is not None
    assert one.over_stars > 60.0
    assert one.left < 1.6
    # One star's own trail is no line beside others.
    ends, point = along(16.0, math.radians(30.0)), np.zeros(SHAPE)
    point[round(MIDDLE[1]), round(MIDDLE[0])] = 1e4
    own = held(cv2.filter2D(point, -1, trail()), ends, light, rng, stars)
    assert own is not None
    assert own.over_stars < 30.0


def test_what_is_long_is_not_asked_and_nothing_is_said_without_stars():
    rng = np.random.default_rng(1)
    _, stars = field(disc(), rng)
    long = along(200.0, 0.3)
    assert held(streak(disc(), long, 1e5), long, stars, rng) is None
    ends = along(30.0, 0.3)
    assert held(streak(disc(), ends, 3e4), ends, np.zeros(SHAPE), rng) is None


@pytest.mark.parametrize("name", SHAPES)
def test_the_image_of_a_star_is_that_of_the_frames_stars(name):
    rng = np.random.default_rng(2)
    _, light = field(SHAPES[name], rng)
    pixels = exposed(light, rng)
    sky = local_background(pixels)
    image = median_star_image(pixels, sky, find_stars(pixels, sky))
    assert image is not None
    assert image.pixels.sum() == pytest.approx(1.0, abs=1e-3)
    reach = image.reach
    middle = SHAPES[name].shape[0] // 2
    room = min(reach, middle)
    seen = image.pixels[reach - room : reach + room + 1, reach - room : reach + room + 1]
    true = SHAPES[name][middle - room : middle + room + 1, middle - room : middle + room + 1]
    assert float((seen * true).sum() / np.linalg.norm(seen) / np.linalg.norm(true)) > 0.98
    column, row, moved = image.at(10.3, 7.6)
    y, x = np.mgrid[0 : moved.shape[0], 0 : moved.shape[1]]
    assert column + float((moved * x).sum() / moved.sum()) == pytest.approx(10.3, abs=0.05)
    assert row + float((moved * y).sum() / moved.sum()) == pytest.approx(7.6, abs=0.05)
