"""The matched line filter: faint and long lines are proposed, stars are not."""

import math

import numpy as np
import pytest
from scipy import ndimage

from rsoconsole.vision import find_stars, local_background
from rsoconsole.vision.frame.bins import bin_frame
from rsoconsole.vision.lines.line_filter import CellLine, cell_side_px, find_lines, propose_lines
from rsoconsole.vision.stars.stars import STAR_BLOCK_PX
from tests.drawn.drawn_lines import exposed, integrated_snr, line_of_light, random_ends, stars

SHAPE = (600, 800)
CHANCE_SNR = 7.5
"""The best of some billions of lines in mere noise stays below (one frame in a thousand)."""


def looked_at(pixels, side: int):
    """Squares, sky and stars of a frame."""
    bins = bin_frame(pixels, {STAR_BLOCK_PX}, square_px=side)
    sky = local_background(pixels, bins=bins)
    return bins.squares, sky, find_stars(pixels, sky, bins=bins)


def proposed(pixels) -> list[CellLine]:
    side = cell_side_px(*pixels.shape)
    squares, sky, seen = looked_at(pixels, side)
    return propose_lines(sky, squares, side, seen)


def is_of(line: CellLine, ends: tuple[float, float, float, float]) -> bool:
    """Whether a proposal lies on a segment: near it across and along, alike in direction."""
    x_a, y_a, x_b, y_b = ends
    length = math.hypot(x_b - x_a, y_b - y_a)
    dx, dy = (x_b - x_a) / length, (y_b - y_a) / length
    off_x, off_y = (
        0.5 * (line.x_a + line.x_b - x_a - x_b),
        0.5 * (line.y_a + line.y_b - y_a - y_b),
    )
    along, across = off_x * dx + off_y * dy, off_y * dx - off_x * dy
    turn = abs((line.x_b - line.x_a) * dy - (line.y_b - line.y_a) * dx)
    turn /= math.hypot(line.x_b - line.x_a, line.y_b - line.y_a)
    return abs(across) < 6.0 and abs(along) < 0.3 * length and turn < 0.1 + 10.0 / length


@pytest.mark.parametrize("seed", range(24))
def test_lines_of_any_length_and_direction_are_proposed_among_stars(seed):
    rng = np.random.default_rng(seed)
    sigma, length = rng.uniform(0.8, 2.0), math.exp(rng.uniform(math.log(40), math.log(560)))
    ends = random_ends(rng, SHAPE, length)
    light = line_of_light(SHAPE, ends, sigma)
    light *= math.exp(rng.uniform(math.log(22.0), math.log(300.0))) / integrated_snr(light, 1.0)
    frame = exposed(light * 30.0 + stars(SHAPE, 120, sigma, rng), rng)
    assert any(is_of(line, ends) for line in proposed(frame))


def test_stars_and_noise_propose_little_and_nothing_that_stands_out():
    """A judge has to look at all that is proposed, and takes chance for light from here on."""
    for seed in range(8):
        rng = np.random.default_rng(100 + seed)
        number = 200 if seed % 2 else 0
        lines = proposed(exposed(stars(SHAPE, number, 1.2, rng), rng))
        assert len(lines) <= 20
        assert max((line.snr for line in lines), default=0.0) < CHANCE_SNR


@pytest.mark.parametrize("length", [40.0, 80.0, 160.0, 320.0])
def test_nearly_all_light_of_a_faint_line_counts(length):
    """Signal to noise of the line itself, matched to its profile, against what is found of it."""
    shares = []
    for seed in range(12):
        rng = np.random.default_rng([seed, int(length)])
        ends = random_ends(rng, SHAPE, length)
        light = line_of_light(SHAPE, ends, 1.0)
        light *= 14.0 * 30.0 / integrated_snr(light, 1.0)
        squares, sky, seen = looked_at(exposed(light, rng), 2)
        lines = [line for line in propose_lines(sky, squares, 2, seen) if is_of(line, ends)]
        shares.append(max((line.snr for line in lines), default=0.0) / 14.0)
    assert np.median(shares) > 0.8
    assert sum(share > 0.0 for share in shares) >= 11


def test_a_bright_trail_right_through_blinds_nothing_beside_it():
    rng = np.random.default_rng(5)
    crossing = line_of_light(SHAPE, (-200.0, 100.0, 1000.0, 420.0), 1.2) * 30.0 * 60.0
    faint = line_of_light(SHAPE, (150.0, 420.0, 320.0, 470.0), 1.2)
    faint *= 25.0 * 30.0 / integrated_snr(faint, 1.0)
    lines = proposed(exposed(crossing + faint, rng))
    assert any(is_of(line, (150.0, 420.0, 320.0, 470.0)) for line in lines)
    longest = max(lines, key=lambda line: math.hypot(line.x_b - line.x_a, line.y_b - line.y_a))
    assert math.hypot(longest.x_b - longest.x_a, longest.y_b - longest.y_a) > 700.0
    assert sum(line.snr > CHANCE_SNR for line in lines) == 2


def test_bad_columns_take_no_streak_its_turn():
    rng = np.random.default_rng(11)
    ends = (120.0, 480.0, 420.0, 180.0)
    faint = line_of_light(SHAPE, ends, 1.2)
    light = faint * 60.0 * 30.0 / integrated_snr(faint, 1.0)
    for column in rng.choice(np.arange(10, 790), 40, replace=False):
        top = int(rng.integers(0, 300))
        light[top : top + int(rng.integers(150, 300)), column] += rng.uniform(200.0, 2000.0)
    assert any(is_of(line, ends) for line in proposed(exposed(light, rng)))


def test_every_direction_is_summed_alike():
    """A line of signal to noise 15 in each of 36 directions, in plain noise."""
    found = []
    for turn in range(36):
        rng = np.random.default_rng(turn)
        angle = math.pi * turn / 36.0
        cells = rng.normal(0.0, 1.0, (200, 240)).astype(np.float32)
        dx, dy = math.cos(angle), math.sin(angle)
        light = line_of_light(
            cells.shape, (120 - 60 * dx, 100 - 60 * dy, 120 + 60 * dx, 100 + 60 * dy), 0.5
        )
        cells += (15.0 * light / integrated_snr(light, 1.0)).astype(np.float32)
        lines = find_lines(cells)
        found.append(max((line.snr for line in lines), default=0.0))
    assert sum(snr > 0.0 for snr in found) >= 34
    assert max(found) < 2.0 * float(np.median(found))


@pytest.mark.parametrize(("height", "width"), [(64, 64), (480, 640), (65, 900)])
def test_small_and_slim_frames_are_no_trouble(height, width):
    rng = np.random.default_rng(1)
    lines = proposed(exposed(np.zeros((height, width)), rng))
    assert all(line.snr < CHANCE_SNR for line in lines)


def test_the_cells_are_as_fine_as_their_number_allows():
    assert [cell_side_px(*shape) for shape in ((480, 640), (1760, 2328), (3520, 4656))] == [4, 4, 8]
    assert cell_side_px(6388, 9576) == 16
    assert [cell_side_px(*shape, finest_px=2) for shape in ((480, 640), (1760, 2328))] == [2, 4]


def test_a_band_that_vibration_drew_out_as_it_did_the_stars_is_proposed():
    """A streak and all stars, 16 px wide along one direction: the band is many cells wide."""
    found = 0
    for seed in range(6):
        rng = np.random.default_rng(seed)
        ends = (300.0, 300.0, 430.0, 310.0)
        image = line_of_light(SHAPE, ends, 1.2)
        image *= 140.0 * 30.0 / integrated_snr(image, 1.0)
        image += 4.0 * stars(SHAPE, 120, 1.2, rng)
        steps = np.linspace(-8.0, 8.0, 33)
        angle = math.radians(70.0 + 20.0 * seed)
        image = np.mean(
            [
                ndimage.shift(image, (s * math.sin(angle), s * math.cos(angle)), order=1)
                for s in steps
            ],
            axis=0,
        )
        found += any(is_of(line, ends) for line in proposed(exposed(image, rng)))
    assert found >= 5
