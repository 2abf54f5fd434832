"""SatSim frames as the campaign alters them: the light is where it is said to be, as bright."""

import math

import numpy as np
import pytest

from tests.campaign import independent
from tests.campaign.satsim_altered import FAMILIES, FRAMES, drawn, looks, snr_of

pytestmark = [
    pytest.mark.shared_data,
    pytest.mark.skipif(not FRAMES.exists(), reason=f"{FRAMES} is not here"),
]


@pytest.mark.nightly("alters a frame of each family twice")
@pytest.mark.parametrize("name", ["plain", "blur", "drift", "wind", "stripes", "binned"])
def test_the_satellite_s_light_lies_between_its_ends(name):
    frame, streaks, severity = drawn(name, 0)
    family = FAMILIES[name]
    assert family.low <= severity <= family.high
    assert np.array_equal(drawn(name, 0)[0].pixels, frame.pixels)
    x_a, y_a, x_b, y_b = streaks[0]
    angle = math.atan2(y_b - y_a, x_b - x_a)
    t = np.linspace(0.1, 0.9, 300)
    x, y = x_a + t * (x_b - x_a), y_a + t * (y_b - y_a)
    values = frame.pixels.astype(float)

    def light(far: float) -> float:
        rows = np.rint(y + far * math.cos(angle)).astype(int)
        columns = np.rint(x - far * math.sin(angle)).astype(int)
        return float(np.median(values[rows, columns]))

    assert light(0.0) > max(light(25.0), light(-25.0))


@pytest.mark.nightly("statistics over many streaks")
def test_what_spreads_a_line_of_light_takes_of_its_signal():
    plain = looks()[0].snr
    assert snr_of("plain", 0) == plain
    assert snr_of("ring", 0) < 0.75 * plain
    assert snr_of("drift", 0) == pytest.approx(plain, rel=0.2)


@pytest.mark.nightly("statistics over many streaks")
def test_a_row_tells_whether_the_satellite_is_found():
    row = independent.row_of("plain", 0)
    assert row["confidence"] > 0.9
    assert (row["false"], row["lost"]) == (0, "")
    assert "1 of 1" in independent.line_of("plain", [row])
