"""SatSim's satellites among its stars, drawn out to trails: confirmed, in place, and no others."""

import pytest

from tests.campaign.points import DATA, judged
from tests.tiers import plain_first

ABOVE_TEN, FAINT = (10.0, 5000.0), (6.0, 10.0)
needs_data = pytest.mark.skipif(not DATA.exists(), reason=f"{DATA} is not here")


@needs_data
@pytest.mark.shared_data
@pytest.mark.nightly("five frames of four million pixels, drawn out and searched")
@pytest.mark.parametrize(
    ("name", "angle_deg"),
    plain_first(
        1, [("dense", 0.0), ("seq", 0.0), ("sparse", 0.0), ("dense", 37.0), ("seq", 118.0)]
    ),
)
def test_satellites_are_confirmed_among_trails(name, angle_deg):
    found = judged(name, angle_deg)
    assert found.false == []
    confirmed, count = found.share(ABOVE_TEN)
    assert count == 44
    assert confirmed >= 0.95 * count
    assert found.share(FAINT)[0] >= 2
    assert found.median_off_px((20.0, 5000.0)) <= 0.1
    assert found.median_off_px((10.0, 20.0)) <= 0.25
    middle, scatter = found.flux((20.0, 5000.0))
    # A few hundredths of the light lie in wings that trails do not show.
    assert middle == pytest.approx(0.95, abs=0.06)
    assert scatter < 0.06
