"""A colour camera's mosaic: gone from sky and stars alike, and nothing else changed."""

from dataclasses import replace

import numpy as np
import pytest

from rsoconsole.records import Frame
from rsoconsole.simulator.camera.sensor import MOSAIC_RGGB
from rsoconsole.vision import has_mosaic, without_mosaic
from rsoconsole.vision.frame.mosaic import CELL, even_out_mosaic

SHAPE = (600, 801)
"""Not a whole number of cells."""
PEDESTAL, SKY, FULL = 500.0, 900.0, 65535.0


def sky(shares: tuple[float, ...], *, stars: int = 60, seed: int = 1) -> np.ndarray:
    """Sky that brightens to one side, and stars of 2.2 px FWHM, behind a mosaic; photon noise."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    light = SKY * (1.0 + 0.3 * x / SHAPE[1])
    for _ in range(stars):
        x0, y0 = rng.uniform(20, SHAPE[1] - 20), rng.uniform(20, SHAPE[0] - 20)
        r2 = (x - x0) ** 2 + (y - y0) ** 2
        light += rng.uniform(2000, 20000) * np.exp(-r2 / (2 * 0.93**2))
    for (row, column), share in zip(CELL, shares, strict=True):
        light[row::2, column::2] *= share
    counts = rng.poisson(light).astype(float) + rng.normal(0.0, 3.0, SHAPE) + PEDESTAL
    # Hot pixels: each lights one colour alone.
    hot = rng.integers(0, light.size, 200)
    counts.ravel()[hot] += 20000.0
    return np.clip(np.rint(counts), 0, FULL).astype(np.uint16)


def levels(pixels: np.ndarray, columns: slice) -> np.ndarray:
    return np.array([np.median(pixels[row::2, column::2][:, columns]) for row, column in CELL])


@pytest.mark.parametrize("shares", [MOSAIC_RGGB, (1.0, 0.5, 0.5, 0.3), (0.3, 1.0, 0.9, 0.5)])
def test_the_factors_are_those_of_the_filters(shares):
    _, factors, _ = even_out_mosaic(sky(shares), FULL)
    found = 1.0 / np.array(factors)
    # Sixty stars whose places in the cell are anywhere.
    five_percent = 0.05
    assert found / found.mean() == pytest.approx(
        np.array(shares) / np.mean(shares), rel=five_percent
    )


def test_the_sky_is_level_in_every_part_of_the_frame():
    pixels = sky((1.0, 0.5, 0.5, 0.3))
    even = even_out_mosaic(pixels, FULL)[0]
    for part in (slice(0, 60), slice(170, 230), slice(340, 400)):
        assert np.ptp(levels(pixels, part)) > 400.0
        noise_adu = 25.0
        assert np.ptp(levels(even, part)) < 0.3 * noise_adu


def test_without_stars_the_noise_tells_the_filters():
    even, factors, _ = even_out_mosaic(sky((1.0, 0.5, 0.5, 0.3), stars=0), FULL)
    found = 1.0 / np.array(factors)
    # The sky outshines the read noise a hundredfold.
    assert found / found[0] == pytest.approx([1.0, 0.5, 0.5, 0.3], rel=0.1)
    assert np.ptp(levels(even, slice(170, 230))) < 8.0


def test_a_frame_without_a_mosaic_is_handed_through():
    frame = Frame(frame_id=1, name="a", pixels=sky((1.0, 1.0, 1.0, 1.0)))
    assert without_mosaic(frame) is frame
    for pattern in ("", "NONE", "MONO", "no", 1, True):
        assert not has_mosaic({"BAYERPAT": pattern})
    for pattern in ("RGGB", "bggr ", "GRBG", "GBRG"):
        assert has_mosaic({"BAYERPAT": pattern})
    assert has_mosaic({"COLORTYP": "RGGB"})


def test_a_mosaic_that_was_binned_away_costs_nothing():
    pixels = sky((1.0, 1.0, 1.0, 1.0))
    even, factors, _ = even_out_mosaic(pixels, FULL)
    assert factors == pytest.approx([1.0] * 4, abs=0.05)
    assert np.abs(levels(even, slice(0, 400)) - levels(pixels, slice(0, 400))).max() < 8.0


def test_saturation_is_that_of_the_colour_that_is_full_first():
    frame = Frame(
        frame_id=1,
        name="a",
        pixels=sky((1.0, 0.5, 0.5, 0.3)),
        saturation_adu=30000.0,
        header={"BAYERPAT": "RGGB"},
    )
    even = without_mosaic(frame)
    assert even.saturation_adu < 30000.0
    full = without_mosaic(
        replace(frame, pixels=np.where(frame.pixels > 15000, 30000, frame.pixels))
    )
    assert full.pixels[frame.pixels > 15000].min() >= 0.98 * full.saturation_adu


def test_few_steps_of_noise_become_real_numbers():
    coarse = np.clip(sky(MOSAIC_RGGB) // 64, 0, 255).astype(np.uint16)
    even = even_out_mosaic(coarse, 255.0)[0]
    assert even.dtype == np.float32
    assert even_out_mosaic(sky(MOSAIC_RGGB), FULL)[0].dtype == np.uint16


def test_the_detector_finds_the_same_behind_a_mosaic_and_without_one():
    """The simulator's field seen by a mono and by a colour sensor of the same brightness."""
    from rsoconsole.config import Config
    from rsoconsole.vision import ConfidenceCurve, Network, StreakDetector
    from tests.campaign.families import draw

    settings = Config().detector
    network = Network.load(settings.model, settings.threads)
    detector = StreakDetector(network, settings, ConfidenceCurve.from_card(network.card))
    for number in range(3):
        frame, truth, _ = draw("bayer", number)
        seen = without_mosaic(replace(frame, header={"BAYERPAT": "RGGB"}))
        assert not np.array_equal(seen.pixels, frame.pixels)
        (found,) = detector.detect(seen).detections
        middle = (truth.x_a_px + truth.x_b_px) / 2, (truth.y_a_px + truth.y_b_px) / 2
        one_pixel = 1.0
        assert np.hypot(found.x_px - middle[0], found.y_px - middle[1]) < one_pixel
        assert found.confidence > 0.9
