"""One pass over a frame: against the same done at full size, in as many words."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from rsoconsole.vision import Workers, bin_side_px, find_stars, local_background, make_map
from rsoconsole.vision.frame.background import sky_noise
from rsoconsole.vision.frame.bins import (
    CELL_PX,
    bin_frame,
    block_maximum,
    cell_means_of_whole_blocks,
    opened_along_lines,
)
from rsoconsole.vision.stars.stars import STAR_BLOCK_PX

BLOCKS = (1, 2, 4, 8, 16)
SIDES = st.integers(64, 330)
DTYPES = st.sampled_from([np.uint16, np.float32])
TWO_THREADS = Workers(2)


def sky(height: int, width: int, dtype: type) -> np.ndarray:
    """Noise on a slope, with bright spots, some of them at the rim."""
    rng = np.random.default_rng([height, width])
    pixels = rng.normal(900.0, 30.0, (height, width)) + np.linspace(0, 200, width)
    for y, x in zip(rng.integers(0, height, 40), rng.integers(0, width, 40), strict=True):
        pixels[max(y - 1, 0) : y + 2, max(x - 1, 0) : x + 2] += rng.uniform(100, 20000)
    pixels[-2:, -2:] += 5000.0
    return np.rint(pixels).astype(np.uint16) if dtype is np.uint16 else pixels.astype(np.float32)


def squares(values: np.ndarray, side: int) -> np.ndarray:
    """(rows, side, columns, side) of whole squares."""
    height, width = values.shape
    return values.reshape(height // side, side, width // side, side)


def up_to(values: np.ndarray, whole: int) -> np.ndarray:
    """Mirrored to a multiple of ``whole`` on the right and below."""
    height, width = values.shape
    return np.pad(values, ((0, -height % whole), (0, -width % whole)), mode="reflect")


@settings(max_examples=30, deadline=None)
@given(height=SIDES, width=SIDES, dtype=DTYPES)
def test_cells_and_blocks_are_those_of_the_whole_frame(height, width, dtype):
    pixels = sky(height, width, dtype)
    bins = bin_frame(pixels, BLOCKS, workers=TWO_THREADS)
    whole = up_to(pixels.astype(np.float64), CELL_PX)
    a_float32 = 1e-5
    assert np.allclose(bins.means, squares(whole, CELL_PX).mean(axis=(1, 3)), rtol=a_float32)
    for block in BLOCKS:
        binned = squares(up_to(pixels.astype(np.float64), block), bin_side_px(block))
        largest = squares(binned.mean(axis=(1, 3)), block // bin_side_px(block)).max(axis=(1, 3))
        assert bins.brightest[block].shape == (-(-height // block), -(-width // block))
        assert np.allclose(bins.brightest[block], largest, rtol=a_float32)


def opened(bins: np.ndarray) -> np.ndarray:
    """Darkest of five in a row, brightest of eight directions, as morphology has it."""
    best = np.full(bins.shape, -np.inf)
    for angle in np.arange(8) * np.pi / 8:
        row = np.zeros((5, 5), dtype=bool)
        for step in range(-2, 3):
            # The nearest bins on a square spiral: two to the side, one of them possibly askew.
            far = max(abs(np.cos(angle)), abs(np.sin(angle)))
            y, x = step * np.sin(angle) / far, step * np.cos(angle) / far
            row[2 + round(np.sign(y) * np.floor(abs(y) + 0.45)), 2 + round(x_of(x))] = True
        assert row.sum() == 5
        best = np.maximum(best, ndimage.minimum_filter(bins, footprint=row, mode="mirror"))
    return best


def x_of(x: float) -> float:
    """Half a bin to the side is still in the same column."""
    return float(np.sign(x) * np.floor(abs(x) + 0.45))


@settings(max_examples=30, deadline=None)
@given(height=SIDES, width=SIDES, dtype=DTYPES, block=st.sampled_from(BLOCKS))
def test_the_lines_of_blocks_are_those_of_the_whole_frame_opened(height, width, dtype, block):
    pixels = sky(height, width, dtype)
    lines = bin_frame(pixels, line_blocks=(block,), workers=TWO_THREADS).lines[block]
    assert lines.shape == (-(-height // block), -(-width // block))
    binned = squares(up_to(pixels.astype(np.float64), block), bin_side_px(block)).mean(axis=(1, 3))
    expected = squares(opened(binned), block // bin_side_px(block)).max(axis=(1, 3))
    # At the rim pixels are mirrored here and bins there; whole-numbered bins are rounded.
    rim = -(-3 * bin_side_px(block) // block)
    inner = slice(rim, -rim)
    rounding = 0.51 if dtype is np.uint16 else 1e-2
    assert np.allclose(lines[inner, inner], expected[inner, inner], atol=rounding)


def test_an_opened_line_keeps_its_light_and_a_star_loses_it():
    bins = np.zeros((40, 60), dtype=np.float32)
    bins[20, 10:40] = 5.0
    bins[28:31, 50:53] = 900.0
    bins[33, 20:24] = 900.0
    found = opened_along_lines(bins)
    assert found.shape == (36, 60)
    assert (found[18, 12:38] == 5.0).all()
    assert found[24:].max() == 0.0


@settings(max_examples=30, deadline=None)
@given(height=SIDES, width=SIDES, dtype=DTYPES, block=st.sampled_from(BLOCKS))
def test_a_map_sees_a_rim_of_whole_blocks_then_of_whole_cells(height, width, dtype, block):
    pixels = sky(height, width, dtype)
    means = cell_means_of_whole_blocks(pixels, bin_frame(pixels), block)
    binning = bin_side_px(block)
    binned = squares(up_to(pixels.astype(np.float64), block), binning).mean(axis=(1, 3))
    cell = CELL_PX // binning
    expected = squares(up_to(binned, cell), cell).mean(axis=(1, 3))
    a_float32 = 1e-5
    assert np.allclose(means, expected, rtol=a_float32)


@settings(max_examples=30, deadline=None)
@given(height=SIDES, width=SIDES, dtype=DTYPES, block=st.sampled_from((2, 4, 8, 16)))
def test_noise_of_bins_is_that_of_a_frame_made_of_them(height, width, dtype, block):
    pixels = sky(height, width, dtype)
    binning = bin_side_px(block)
    binned = squares(up_to(pixels.astype(np.float64), block), binning).mean(axis=(1, 3))
    alone = local_background(binned.astype(np.float32), CELL_PX // binning)
    noise = sky_noise(
        pixels, alone.noise.shape, CELL_PX, block=block, binning=binning, workers=TWO_THREADS
    )
    a_float32 = 1e-5
    assert np.allclose(noise, alone.noise, rtol=a_float32)


@settings(max_examples=30, deadline=None)
@given(height=SIDES, width=SIDES, dtype=DTYPES)
def test_what_is_handed_on_and_what_is_made_again_agree_to_the_last_bit(height, width, dtype):
    pixels = sky(height, width, dtype)
    bins = bin_frame(pixels, (STAR_BLOCK_PX,), line_blocks=BLOCKS, workers=TWO_THREADS)
    with_bins = local_background(pixels, bins=bins, workers=TWO_THREADS)
    alone = local_background(pixels)
    assert np.array_equal(with_bins.level, alone.level)
    assert np.array_equal(with_bins.noise, alone.noise)
    for block in BLOCKS:
        with_map = make_map(pixels, "fast", block, bins=bins, workers=TWO_THREADS)
        assert np.array_equal(with_map.values, make_map(pixels, "fast", block).values)


@pytest.mark.parametrize("dtype", [np.uint16, np.float32])
@pytest.mark.parametrize("shape", [(1030, 1101), (300, 1500)])
def test_stars_are_the_same_with_bins_and_without(shape, dtype):
    pixels = sky(*shape, dtype)
    bins = bin_frame(pixels, (STAR_BLOCK_PX,), workers=TWO_THREADS)
    handed, alone = find_stars(pixels, bins=bins), find_stars(pixels)
    assert len(alone) > 5
    assert np.array_equal(handed.x_px, alone.x_px)
    assert np.array_equal(handed.flux, alone.flux)


def test_bins_without_the_block_that_is_asked_for_are_not_used_for_it():
    pixels = sky(200, 300, np.uint16)
    bins = bin_frame(pixels, (4, 8), line_blocks=(8,))
    assert np.array_equal(
        make_map(pixels, "fast", 4, bins=bins).values, make_map(pixels, "fast", 4).values
    )
    assert len(find_stars(pixels, bins=bin_frame(pixels))) == len(find_stars(pixels))


@given(rows=st.integers(1, 6), columns=st.integers(1, 6), block=st.integers(1, 9))
def test_block_maximum_is_the_maximum_of_every_block(rows, columns, block):
    rng = np.random.default_rng([rows, columns, block])
    values = rng.normal(size=(rows * block, columns * block)).astype(np.float32)
    by_force = [
        [
            values[r * block : (r + 1) * block, c * block : (c + 1) * block].max()
            for c in range(columns)
        ]
        for r in range(rows)
    ]
    assert np.array_equal(block_maximum(values, block), by_force)


def test_the_sky_follows_an_amplifiers_glow_to_its_brightest_cell():
    """The glow of a corner is brighter than 98 of 100 cells, as stars are, but it is the sky."""
    rng = np.random.default_rng(2)
    y, x = np.mgrid[0:1024, 0:1536].astype(np.float64)
    true = 800.0 + 20000.0 * np.exp(-np.hypot(x - 1536, y - 1024) / 90.0)
    pixels = np.clip(np.rint(true + rng.normal(0.0, 30.0, true.shape)), 0, 65535).astype(np.uint16)
    found = local_background(pixels)
    cells = true.reshape(64, 16, 96, 16).mean(axis=(1, 3))
    inside = np.s_[3:-3, 3:-3]
    assert np.abs(found.level[inside] / cells[inside] - 1.0).max() < 0.06
