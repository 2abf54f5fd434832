"""Two satellites that a frame cannot show apart keep their tracks, each its own."""

import numpy as np
import pytest

from tests.nights.approach_rig import night
from tests.tiers import plain_first

FRAMES = 200
RMS_ARCSEC, INSIDE_3SIGMA = 1.0, 0.97


@pytest.mark.parametrize(
    ("name", "light", "scatter_s"),
    plain_first(1, [("30.5E", 0.5, 0.2), ("30W", 0.25, 0.015), ("30W", 0.5, 0.015)]),
)
def test_a_close_approach_costs_no_track_its_satellite(name, light, scatter_s):
    """Within 30 arcsec for most of two hours, as one streak for half an hour of it."""
    told = night(name, FRAMES, seed=3, scatter_s=scatter_s, light=light)
    assert told.counts["other"] == 0
    assert told.ended == 0
    resolved = told.counts["own"] + told.counts["none"]
    assert told.counts["own"] >= 0.98 * resolved
    assert told.counts["blended"] >= 0.9 * (told.counts["blended"] + told.counts["apart"])
    assert told.counts["blended"] > 40
    assert np.mean(np.array(told.off_sigmas) <= 9.0) >= INSIDE_3SIGMA
    off = np.sqrt(np.mean(np.square(told.off_arcsec)))
    assert off <= RMS_ARCSEC + 15.0 * scatter_s
