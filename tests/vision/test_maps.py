"""The map the network sees: by brute force, and cell by cell against pixels."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rsoconsole.vision import (
    CODES_PER_SIGMA,
    LOWEST_SIGMA,
    FrameMap,
    bin_side_px,
    choose_blocks,
    make_map,
)
from rsoconsole.vision.frame.bins import bin_frame
from rsoconsole.vision.frame.maps import LINE_GAIN, LINE_SHIFT, to_map_bytes


def _frame(height: int, width: int, dtype: type = np.uint16) -> np.ndarray:
    rng = np.random.default_rng(11)
    return np.rint(rng.normal(800.0, 40.0, size=(height, width))).astype(dtype)


@pytest.mark.parametrize("block", [2, 4, 8, 16])
@pytest.mark.parametrize("dtype", [np.uint16, np.float32])
def test_fast_map_is_the_brightest_line_over_the_noise(block, dtype):
    pixels = _frame(256, 320, dtype)
    frame_map = make_map(pixels, "fast", block)
    lines = bin_frame(pixels.astype(np.float32), line_blocks=(block,)).lines[block]
    sigmas = LINE_GAIN * (lines - 800.0) / (40.0 / bin_side_px(block)) + LINE_SHIFT
    expected = (np.clip(sigmas, -2.0, 14.0) - LOWEST_SIGMA) * CODES_PER_SIGMA
    # The sky itself is measured: a tenth of a sigma of level, a few per cent of noise.
    half_a_sigma = 0.5 * CODES_PER_SIGMA
    assert np.abs(frame_map.values - expected).max() < half_a_sigma
    assert np.abs(frame_map.values - expected).mean() < 0.2 * half_a_sigma


@pytest.mark.parametrize("block", [4, 8, 16])
def test_plain_sky_of_a_fast_map_looks_as_the_brightest_of_its_bins_would(block):
    pixels = _frame(1024, 1024)
    k, b = block // bin_side_px(block), bin_side_px(block)
    bins = pixels.astype(float).reshape(1024 // b, b, 1024 // b, b).mean(axis=(1, 3))
    brightest = bins.reshape(1024 // block, k, 1024 // block, k).max(axis=(1, 3))
    as_bins = ((brightest - 800.0) / (40.0 / b) - LOWEST_SIGMA) * CODES_PER_SIGMA
    values = make_map(pixels, "fast", block).values
    assert abs(float(np.median(values)) - float(np.median(as_bins))) < 0.5 * CODES_PER_SIGMA
    assert np.std(values) == pytest.approx(np.std(as_bins), rel=0.5)


@pytest.mark.parametrize(("height", "width"), [(64, 64), (77, 131), (512, 517)])
@pytest.mark.parametrize("block", [2, 4, 8])
def test_a_bright_pixel_lights_the_cell_that_holds_it_even_in_a_ragged_rim(height, width, block):
    for x, y in [(0, 0), (width - 1, height - 1), (width // 2 + 1, height // 3)]:
        pixels = _frame(height, width)
        pixels[max(y - 1, 0) : y + 2, max(x - 1, 0) : x + 2] = 60000
        frame_map = make_map(pixels, "paper", block)
        assert frame_map.values.shape == (-(-height // block), -(-width // block))
        row, column = int(frame_map.to_cells(y)), int(frame_map.to_cells(x))
        assert frame_map.values[row, column] == 255


@pytest.mark.parametrize(("height", "width"), [(64, 64), (77, 131), (512, 517)])
@pytest.mark.parametrize("block", [2, 4, 8])
def test_a_line_lights_the_cells_along_it_even_in_a_ragged_rim_and_a_star_does_not(
    height, width, block
):
    for line in (np.s_[-3:, :40], np.s_[:3, :40], np.s_[:40, :3], np.s_[:40, -3:]):
        pixels = _frame(height, width)
        pixels[line] = 60000
        pixels[height // 3 : height // 3 + 3, width // 2 : width // 2 + 3] = 60000
        values = make_map(pixels, "fast", block).values
        assert values.shape == (-(-height // block), -(-width // block))
        along = np.arange(2 * block, 32, block)
        rows, columns = np.arange(height)[line[0]], np.arange(width)[line[1]]
        on_line = (
            (along, np.full(along.size, columns[1]))
            if rows.size > 3
            else (
                np.full(along.size, rows[1]),
                along,
            )
        )
        assert (values[on_line[0] // block, on_line[1] // block] == 255).all()
        star = (height // 3 + 1) // block, (width // 2 + 1) // block
        assert values[star] < to_map_bytes(np.array([6.0], dtype=np.float32))[0]


@given(
    px=st.floats(-100, 20000, allow_nan=False),
    block=st.integers(1, 64),
)
def test_cells_and_pixels_convert_both_ways(px, block):
    frame_map = FrameMap(
        values=np.zeros((8, 8), dtype=np.uint8), block=block, mode="fast", width_px=9, height_px=9
    )
    assert frame_map.to_px(frame_map.to_cells(px)) == pytest.approx(px, abs=1e-9)


@given(x=st.integers(0, 5000), block=st.integers(1, 64))
def test_a_pixels_centre_lies_in_the_cell_that_counts_it(x, block):
    frame_map = FrameMap(
        values=np.zeros((8, 8), dtype=np.uint8), block=block, mode="fast", width_px=9, height_px=9
    )
    assert int(frame_map.to_cells(x)) == x // block


def test_the_rim_of_a_ragged_frame_is_no_brighter_than_the_rest():
    values = make_map(_frame(509, 515), "fast", 8).values
    a_sigma = CODES_PER_SIGMA
    assert abs(float(values[-1].mean()) - float(values[:-1].mean())) < 0.5 * a_sigma
    assert abs(float(values[:, -1].mean()) - float(values[:, :-1].mean())) < 0.5 * a_sigma


def test_paper_map_is_black_and_white_and_mostly_black_on_an_empty_sky():
    values = make_map(_frame(512, 512), "paper", 8).values
    assert set(np.unique(values)) <= {0, 255}
    assert (values == 255).mean() < 0.02


def test_a_gradient_steeper_than_a_streak_leaves_both_maps_flat():
    slope = np.linspace(0, 2000, 1024).astype(np.uint16)
    pixels = _frame(512, 1024) + slope
    for mode in ("fast", "paper"):
        values = make_map(pixels, mode, 8).values.astype(float)
        left, right = values[4:-4, 4:44].mean(), values[4:-4, -44:-4].mean()
        assert abs(left - right) < 0.5 * CODES_PER_SIGMA


def test_codes_are_clipped_at_both_ends():
    codes = to_map_bytes(np.array([-9.0, -2.0, 0.0, 14.0, 99.0], dtype=np.float32))
    assert list(codes) == [0, 0, 32, 255, 255]


@pytest.mark.parametrize(
    ("width", "height", "scale", "exposure", "blocks"),
    [
        (4656, 3520, 1.264, 10.0, (8,)),
        (4656, 3520, None, None, (8, 16)),
        (512, 512, 3.04, 60.0, (4, 8)),
        (512, 512, None, None, (2, 4, 8)),
        (1024, 768, None, None, (2, 4, 8, 16)),
        (700, 700, 10.3, 120.0, (4, 8)),
        (2328, 1760, 1.264, 10.0, (4, 8)),
        (2440, 1760, 1.264, 10.0, (8,)),
        (64, 64, 1.264, 10.0, (2,)),
    ],
)
def test_blocks_suit_the_streak_and_the_frame(width, height, scale, exposure, blocks):
    assert choose_blocks(width, height, scale, exposure) == blocks


@given(side=st.integers(800, 6000), scale=st.floats(0.3, 20.0), exposure=st.floats(0.5, 60.0))
def test_a_geostationary_streak_is_12_to_40_cells_where_the_frame_allows(side, scale, exposure):
    streak_px = 15.04 * exposure / scale
    if 24 <= streak_px <= 0.3 * side:
        *_, block = choose_blocks(side, side, scale, exposure)
        # Of a frame that fits the network at once cells of 4 px cost little, and show more.
        assert streak_px / block >= 12 or (block == 4 and streak_px >= 24)
        assert streak_px / block <= 40 or block == 16 or side < 2 * block * 48


def test_a_block_below_one_is_refused():
    with pytest.raises(ValueError, match="1 or more"):
        make_map(_frame(64, 64), "fast", 0)
