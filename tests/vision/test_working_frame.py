"""Pixels joined where stars are wide: nothing is lost on the way there and back."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rsoconsole.config import DetectorConfig
from rsoconsole.records import Frame
from rsoconsole.vision import (
    ConfidenceCurve,
    Network,
    StreakDetector,
    WorkingFrame,
    detection_in_original_pixels,
)
from tests.drawn.drawn_lines import exposed, integrated_snr, line_of_light, stars
from tests.makers import straight_detection


@given(side=st.integers(1, 8), x=st.floats(-10, 5000), y=st.floats(-10, 4000))
def test_places_go_there_and_back(side, x, y):
    found = straight_detection(
        x_px=(x + 0.5) / side - 0.5, y_px=(y + 0.5) / side - 0.5, length_px=100.0 / side
    )
    back = detection_in_original_pixels(found, side)
    assert (back.x_px, back.y_px) == pytest.approx((x, y), abs=1e-6)
    assert back.length_px == pytest.approx(100.0)
    assert back.angle_deg == pytest.approx(found.angle_deg, abs=1e-6)


@pytest.mark.parametrize("side", [2, 3, 5])
def test_a_joined_pixel_is_the_mean_of_its_own(side):
    rng = np.random.default_rng(side)
    pixels = rng.integers(0, 65535, (64, 91)).astype(np.uint16)
    frame = Frame(frame_id=1, name="f", pixels=pixels, scale_arcsec_px=1.5)
    working = WorkingFrame.of(frame, side)
    assert working.frame.pixels.shape == (64 // side, 91 // side)
    first = pixels[:side, side : 2 * side].astype(float).mean()
    assert working.frame.pixels[0, 1] == pytest.approx(first, rel=1e-5)
    assert working.frame.scale_arcsec_px == pytest.approx(1.5 * side)
    assert working.to_original_px(0.0) == pytest.approx((side - 1) / 2)


@pytest.fixture(scope="module")
def detector() -> StreakDetector:
    network = Network.load(None, 1)
    return StreakDetector(
        network, DetectorConfig(threads=1), ConfidenceCurve.from_card(network.card)
    )


@pytest.mark.parametrize("sigma", [3.0, 5.0])
def test_a_streak_among_wide_stars_is_found_where_it_is(detector, sigma):
    rng = np.random.default_rng(int(sigma))
    shape, ends = (900, 1200), (300.0, 500.0, 640.0, 430.0)
    light = line_of_light(shape, ends, sigma)
    light *= 120.0 * 30.0 / integrated_snr(light, 1.0)
    pixels = exposed(light + 12.0 * stars(shape, 150, sigma, rng), rng)
    analysis = detector.analyse(Frame(frame_id=1, name="f", pixels=pixels), 0.1)
    assert analysis.working.side >= 2
    best = analysis.detections.detections[0]
    assert math.hypot(best.x_px - 470.0, best.y_px - 465.0) < sigma
    assert best.length_px == pytest.approx(math.hypot(340.0, 70.0), rel=0.05)
    assert best.width_px == pytest.approx(2.3548 * sigma, rel=0.2)
    assert analysis.stars.median_fwhm_px == pytest.approx(2.3548 * sigma, rel=0.2)
