"""Trails right through a frame lie where the truth says and are as bright as it says."""

import math

import numpy as np
import pytest

from models.altered import QUARTER
from tests.campaign import crossings
from tests.makers import straight_detection


def test_the_trail_is_on_its_line_with_the_ridge_that_is_said():
    frame, (x_a, y_a, x_b, y_b), snr = crossings.draw(1)
    assert snr == crossings.JUDGED_SNR
    for x, y in ((x_a, y_a), (x_b, y_b)):
        is_on_a_side = min(abs(x + 0.5), abs(x + 0.5 - QUARTER.width_px)) < 1e-6
        is_on_a_side |= min(abs(y + 0.5), abs(y + 0.5 - QUARTER.height_px)) < 1e-6
        assert is_on_a_side
    angle = math.atan2(y_b - y_a, x_b - x_a)
    along = np.linspace(0.02, 0.98, 3000)

    def beside(away: float) -> np.ndarray:
        x = x_a + along * (x_b - x_a) - away * math.sin(angle)
        y = y_a + along * (y_b - y_a) + away * math.cos(angle)
        rows = np.clip(np.rint(y).astype(int), 0, QUARTER.height_px - 1)
        return frame.pixels[rows, np.clip(np.rint(x).astype(int), 0, QUARTER.width_px - 1)]

    # By medians, which stars do not lift; a pixel is up to half of one off the middle of the cut.
    sky = np.concatenate([beside(away) for away in (-60.0, -40.0, 40.0, 60.0)]).astype(float)
    noise = 1.4826 * np.median(np.abs(sky - np.median(sky)))
    ridge = (np.median(beside(0.0)) - np.median(sky)) / noise
    assert 0.75 * snr < ridge < 1.05 * snr


@pytest.mark.parametrize(
    ("away_px", "turned_deg"),
    [(0.0, 0.0), (0.08, 0.0), (-0.08, 0.0), (0.0, 0.005), (0.0, -0.005)],
)
def test_offset_and_angle_are_those_between_two_lines(away_px, turned_deg):
    trail = (-0.5, 100.0, 2327.5, 900.0)
    angle = math.atan2(800.0, 2328.0) + math.radians(turned_deg)
    x = 700.0 - away_px * math.sin(angle)
    y = 100.0 + 800.0 * 700.5 / 2328.0 + away_px * math.cos(angle)
    dx, dy = 300.0 * math.cos(angle), 300.0 * math.sin(angle)
    found = straight_detection(
        x_px=x, y_px=y, x_a_px=x - dx, y_a_px=y - dy, x_b_px=x + dx, y_b_px=y + dy
    )
    offset, turn = crossings.lies_off(found, trail)
    assert offset == pytest.approx(abs(away_px), abs=1e-3)
    assert turn == pytest.approx(abs(turned_deg), abs=1e-6)


def test_a_line_of_the_table_counts_only_what_is_above_tau():
    known = {"ridge_snr": 3.0, "kind": "crossing", "offset_px": 0.02, "turn_deg": 0.001, "false": 0}
    rows = [known | {"confidence": 0.9}, known | {"confidence": 0.05}]
    assert "1 of 2" in crossings.table(rows)
