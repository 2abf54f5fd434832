"""Unseen for minutes to more than an hour, as through cloud or the Earth's shadow: taken up again.

Truth is an integration with Moon, Sun and radiation pressure (``tests/truth/orbit_truth.py``);
fold and online orbit are the program's own, fed with directions of 0.5 arcsec.
"""

import numpy as np
import pytest

from rsoconsole.records import TrackState
from tests.pipeline.test_orbit_online import CADENCE_S, GEO, INCLINED, MEO, Watched, config, flight
from tests.tiers import plain_first

REGIMES = {"geostationary": GEO, "inclined geosynchronous": INCLINED, "navigation": MEO}
BEFORE = 30
"""Frames: a quarter of an hour."""


@pytest.mark.parametrize(
    "gap_min",
    [0.5, 70.0, *(pytest.param(m, marks=pytest.mark.nightly("more gaps")) for m in (10.0, 30.0))],
)
@pytest.mark.parametrize("regime", plain_first(2, REGIMES))
def test_after_a_gap_it_is_where_the_track_says_and_taken_up_again(regime, gap_min):
    true, watched = flight(*REGIMES[regime]), Watched(config())
    first_s = np.arange(BEFORE) * float(CADENCE_S)
    watched.see(true.places(first_s)[0])
    assert watched.following.state == "TRACK"
    again_s = first_s[-1] + 60.0 * gap_min + np.arange(3) * float(CADENCE_S)
    watched.see(true.places(again_s)[0])
    assert watched.following.state == "TRACK"
    assert watched.following.track_id == 1
    states = [r for r in watched.log if isinstance(r, TrackState) and r.frame_id == BEFORE + 1]
    predicted, updated = states
    assert predicted.foretold_by == ("filter" if gap_min < 1.0 else "orbit")
    assert updated.nis is not None
    assert updated.nis < 11.83
    assert watched.last.observations == BEFORE + 3


@pytest.mark.parametrize("regime", REGIMES)
def test_through_frames_that_show_nothing_it_coasts_and_comes_back(regime):
    """Ten minutes of frames in which it is not found; the state on record follows its orbit."""
    true, watched = flight(*REGIMES[regime]), Watched(config())
    every_s = np.arange(BEFORE + 23) * float(CADENCE_S)
    watched.see(true.places(every_s)[0], hidden=range(BEFORE, BEFORE + 20))
    assert watched.following.state == "TRACK"
    assert watched.following.track_id == 1
    coasted = [
        r
        for r in watched.log
        if isinstance(r, TrackState) and BEFORE + 5 < r.frame_id <= BEFORE + 20
    ]
    assert {r.foretold_by for r in coasted} == {"orbit"}
    # What is not known of the path's bend grows with the coast, not with the number of its frames.
    said = coasted[-1].mixture
    assert said is not None
    assert said.turn_sigma < 0.5
