"""A line measured along itself: where it runs, where it ends, whose light it is."""

import math

import numpy as np
import pytest

from rsoconsole.vision import LineTrace, find_stars, local_background, trace_line
from tests.drawn.drawn_lines import (
    exposed,
    integrated_snr,
    line_of_light,
    random_ends,
    stars,
)

SHAPE = (600, 900)
SIGMA_PX = 1.2


def traced(light, ends, rng, sigma=SIGMA_PX, off_px=3.0) -> LineTrace | None:
    """From a proposal that is some pixels off at either end."""
    pixels = exposed(light, rng)
    sky = local_background(pixels)
    guess = tuple(np.array(ends) + rng.uniform(-off_px, off_px, 4))
    return trace_line(pixels, sky, guess, find_stars(pixels, sky), 2.3548 * sigma)


def errors(trace: LineTrace, ends) -> tuple[float, float, float, float]:
    """Across at the true middle (px), direction (deg), and both ends along (px)."""
    x_a, y_a, x_b, y_b = ends
    length = math.hypot(x_b - x_a, y_b - y_a)
    dx, dy = (x_b - x_a) / length, (y_b - y_a) / length
    places = [(trace.x_a_px, trace.y_a_px), (trace.x_b_px, trace.y_b_px)]
    along = [(x - x_a) * dx + (y - y_a) * dy for x, y in places]
    across = [(y - y_a) * dx - (x - x_a) * dy for x, y in places]
    slope = (across[1] - across[0]) / (along[1] - along[0])
    middle = across[0] + slope * (0.5 * length - along[0])
    first, last = sorted(along)
    return middle, math.degrees(math.atan(slope)), first, last - length


@pytest.mark.parametrize("seed", range(16))
def test_a_lines_place_and_ends_are_found_within_their_errors(seed):
    rng = np.random.default_rng(seed)
    ends = random_ends(rng, SHAPE, math.exp(rng.uniform(math.log(30), math.log(560))))
    light = line_of_light(SHAPE, ends, SIGMA_PX)
    snr = math.exp(rng.uniform(math.log(20), math.log(300)))
    light *= snr * 30.0 / integrated_snr(light, 1.0)
    trace = traced(light, ends, rng)
    assert trace is not None
    across, turn, first, last = errors(trace, ends)
    assert abs(across) < 4.5 * trace.sigma_across_px + 0.03
    assert abs(turn) < 4.5 * trace.sigma_angle_deg + 0.01
    assert abs(first) < 5.0 * max(trace.sigma_end_px) + 1.0
    assert abs(last) < 5.0 * max(trace.sigma_end_px) + 1.0
    assert trace.snr == pytest.approx(snr, rel=0.15, abs=3.0)
    assert trace.width_px == pytest.approx(2.3548 * SIGMA_PX, rel=0.05 + 4.0 / snr)
    assert trace.is_open == (False, False)


def test_a_light_that_comes_and_goes_in_one_period_is_as_much_a_line():
    rough, ends_off = [], []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        periods, phase = rng.uniform(2.0, 8.0), rng.uniform(0.0, 6.28)
        ends = random_ends(rng, SHAPE, rng.uniform(200.0, 500.0))
        light = line_of_light(
            SHAPE,
            ends,
            SIGMA_PX,
            lambda t, p=periods, f=phase: 1.0 + 0.9 * np.cos(2 * np.pi * p * t + f),
        )
        light *= 120.0 * 30.0 / integrated_snr(light, 1.0)
        trace = traced(light, ends, rng)
        assert trace is not None
        rough.append(trace.roughness)
        length = math.hypot(ends[2] - ends[0], ends[3] - ends[1])
        found = math.hypot(trace.x_b_px - trace.x_a_px, trace.y_b_px - trace.y_a_px)
        ends_off.append(abs(found - length) / (length / periods))
    assert np.median(rough) < 0.15
    # A line that ends while it is dark ends, for all that is seen, up to half a period earlier.
    assert np.median(ends_off) < 0.5


def test_stars_in_a_row_are_told_by_their_dark_parts_or_their_scatter():
    told = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        light = np.zeros(SHAPE)
        along = np.sort(rng.uniform(0.0, 200.0, 7))
        for u in along:
            x, y = 300.0 + u * 0.9, 250.0 + u * 0.436 + rng.normal(0.0, 0.4)
            yy, xx = np.mgrid[: SHAPE[0], : SHAPE[1]]
            disc = np.exp(-0.5 * ((xx - x) ** 2 + (yy - y) ** 2) / SIGMA_PX**2)
            light += rng.uniform(3.0, 15.0) * 30.0 * disc
        trace = traced(light, (300.0, 250.0, 480.0, 337.0), rng)
        is_dim = trace is None or trace.snr < 8.0 or trace.lower_quartile_snr < 0.3 * trace.snr
        told += is_dim or trace.roughness > 0.4
    assert told >= 19


@pytest.mark.parametrize(
    ("ends", "open_ends"),
    [((-40.0, 100.0, 150.0, 140.0), 1), ((-300.0, 200.0, 1300.0, 420.0), 2)],
)
def test_a_line_that_leaves_the_frame_is_open_there(ends, open_ends):
    rng = np.random.default_rng(2)
    light = line_of_light(SHAPE, ends, SIGMA_PX) * 30.0 * 15.0
    inside = (max(ends[0], 0.0), ends[1], min(ends[2], 899.0), ends[3])
    if open_ends == 2:
        slope = (ends[3] - ends[1]) / (ends[2] - ends[0])
        inside = (0.0, ends[1] - ends[0] * slope, 899.0, ends[1] + (899.0 - ends[0]) * slope)
    trace = traced(light, inside, rng, off_px=1.5)
    assert trace is not None
    assert sum(trace.is_open) == open_ends


def test_a_crossing_of_ridge_3_is_known_to_a_tenth_of_a_pixel_and_thousandths_of_a_degree():
    across, turns = [], []
    for seed in range(9):
        rng = np.random.default_rng(40 + seed)
        angle = rng.uniform(-0.5, 0.5)
        y = rng.uniform(250.0, 350.0)
        ends = (-100.0, y - 550.0 * math.tan(angle), 1000.0, y + 550.0 * math.tan(angle))
        light = line_of_light(SHAPE, ends, SIGMA_PX)
        light *= 3.0 * 30.0 / light.max()
        inside = (0.0, y - 450.0 * math.tan(angle), 899.0, y + 449.0 * math.tan(angle))
        trace = traced(light + stars(SHAPE, 100, SIGMA_PX, rng), inside, rng)
        assert trace is not None
        off, turn, *_ = errors(trace, ends)
        across.append(abs(off))
        turns.append(abs(turn))
    assert np.median(across) <= 0.1
    assert np.median(turns) <= 0.012


def test_where_nothing_is_nothing_is_traced_well():
    rng = np.random.default_rng(1)
    trace = traced(np.zeros(SHAPE), (200.0, 200.0, 400.0, 260.0), rng)
    assert trace is None or trace.snr < 8.0


def test_a_proposal_beside_or_beyond_the_frame_is_none():
    rng = np.random.default_rng(1)
    pixels = exposed(np.zeros(SHAPE), rng)
    sky = local_background(pixels)
    none = find_stars(pixels, sky)
    for ends in (
        (-90.0, -90.0, -20.0, -40.0),
        (10.0, 10.0, 11.0, 11.0),
        (1200.0, 5.0, 1300.0, 5.0),
    ):
        assert trace_line(pixels, sky, ends, none, 2.8) is None


@pytest.mark.parametrize("seed", range(6))
def test_a_line_fainter_than_its_noise_is_followed_to_both_ends(seed):
    """A ridge of a third of one pixel's noise: only the sum of hundreds of pixels shows it."""
    rng = np.random.default_rng(seed)
    shape = (400, 1600)
    ends = (120.0, 150.0 + 10 * seed, 1450.0, 240.0 - 10 * seed)
    light = line_of_light(shape, ends, SIGMA_PX)
    light *= 20.0 * 30.0 / integrated_snr(light, 1.0)
    x_a, y_a, x_b, y_b = ends
    part = (
        0.7 * x_a + 0.3 * x_b,
        0.7 * y_a + 0.3 * y_b,
        0.2 * x_a + 0.8 * x_b,
        0.2 * y_a + 0.8 * y_b,
    )
    pixels = exposed(light, rng)
    sky = local_background(pixels)
    trace = trace_line(pixels, sky, part, find_stars(pixels, sky), 2.3548 * SIGMA_PX)
    assert trace is not None
    across, _, first, last = errors(trace, ends)
    length = math.hypot(x_b - x_a, y_b - y_a)
    assert abs(across) < 1.5
    assert abs(first) < 0.2 * length
    assert abs(last) < 0.2 * length


def test_a_bright_star_on_a_short_line_turns_it_nowhere():
    """Where its mask leaves a star's wings, they say nothing of where the line runs."""
    turns, offs = [], []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        shape = (240, 240)
        ends = random_ends(rng, shape, 44.0, rim_px=60.0)
        light = line_of_light(shape, ends, 1.4)
        light *= 60.0 * 30.0 / integrated_snr(light, 1.0)
        x, y = 0.7 * ends[0] + 0.3 * ends[2], 0.7 * ends[1] + 0.3 * ends[3]
        yy, xx = np.mgrid[: shape[0], : shape[1]]
        far2 = (xx - x - rng.uniform(-1, 1)) ** 2 + (yy - y - rng.uniform(-1, 1)) ** 2
        light += 120.0 * 30.0 * (np.exp(-0.5 * far2 / 1.4**2) + 0.02 * np.exp(-0.5 * far2 / 25.0))
        pixels = exposed(light + stars(shape, 15, 1.4, rng), rng)
        sky = local_background(pixels)
        half = (0.5 * (ends[0] + ends[2]), 0.5 * (ends[1] + ends[3]), ends[2], ends[3])
        found = find_stars(pixels, sky)
        trace = trace_line(pixels, sky, half, found, 2.3548 * 1.4, off_px=4.5)
        assert trace is not None
        across, turn, _, _ = errors(trace, ends)
        turns.append(abs(turn))
        offs.append(abs(across))
    assert np.median(turns) < 0.5
    assert sum(turn < 3.0 for turn in turns) >= 10
    assert sum(off < 1.0 for off in offs) >= 10
