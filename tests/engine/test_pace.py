"""Exposure and cadence for what is followed: by rates of real orbits, under the operator's hand."""

from dataclasses import replace

import pytest

from rsoconsole.config import Config, with_setting
from rsoconsole.engine.tasks.pace import LONGEST_SHARE, SHORTEST_PX, Pace, exposure_and_cadence_for
from rsoconsole.records import TrackState

CONFIG = Config()
RATES = {
    # arcsec/s on the sky, from the motion page: what the night's 10 s every 30 s are made for
    "geostationary": 15.04,
    "GPS": 36.5,
    "Galileo": 30.0,
    "Molniya at apogee": 6.5,
    "transfer orbit at 21,200 km": 18.0,
}


def track(rate_arcsec_s: float, innovations: int = 3) -> TrackState:
    zero = (0.0,) * 4
    return TrackState(
        track_id=1,
        kind="updated",
        frame_id=5,
        t_utc_ns=0,
        x=(10.0, 0.0, 0.0, rate_arcsec_s / 3600.0),
        P=(zero, zero, zero, zero),
        innovations=innovations,
    )


@pytest.mark.parametrize("name", RATES)
def test_what_the_night_is_made_for_keeps_its_exposure(name):
    assert exposure_and_cadence_for(RATES[name], CONFIG) == (10.0, 30.0)


@pytest.mark.parametrize("rate", [167.0, 500.0, 1190.0, 3600.0])
def test_the_faster_the_shorter_and_never_out_of_the_field(rate):
    (exposure_s, cadence_s), optics = exposure_and_cadence_for(rate, CONFIG), CONFIG.optics
    streak_px = rate * exposure_s / optics.scale_arcsec_px
    if exposure_s > CONFIG.exposure.shortest_s:
        assert SHORTEST_PX < streak_px < LONGEST_SHARE * optics.height_px
    assert exposure_s < 10.0
    assert exposure_s < cadence_s < 30.0


def test_what_hardly_moves_is_exposed_longer_within_the_bounds():
    exposure_s, cadence_s = exposure_and_cadence_for(2.5, CONFIG)
    assert exposure_s == pytest.approx(
        1.25 * SHORTEST_PX * CONFIG.optics.scale_arcsec_px / 2.5, rel=0.05
    )
    assert cadence_s - exposure_s == pytest.approx(20.0, abs=0.1)
    assert exposure_and_cadence_for(1.7, CONFIG)[0] == CONFIG.exposure.longest_s
    # No exposure makes a streak of it: more sky is all that a longer one would bring.
    assert exposure_and_cadence_for(0.1, CONFIG)[0] == CONFIG.exposure.exposure_s
    bounded = with_setting(CONFIG, "exposure.shortest_s", 2.0)
    assert exposure_and_cadence_for(3600.0, bounded)[0] == 2.0


def test_it_is_set_for_the_track_and_set_back_after_it_on_record():
    pace = Pace()
    config, changes = pace.after(CONFIG, track(167.0))
    assert [c.name for c in changes] == ["exposure.exposure_s", "exposure.cadence_s"]
    assert changes[0].by == "the track's 167 arcsec/s"
    assert config.exposure.exposure_s == changes[0].after < 10.0
    again, none = pace.after(config, track(170.0))
    assert (again, none) == (config, ())
    back, changes = pace.after(config, None)
    assert back == CONFIG
    assert {c.by for c in changes} == {"the end of the track"}
    assert pace.after(CONFIG, None) == (CONFIG, ())


def test_it_goes_back_by_itself_where_the_rate_allows():
    pace = Pace()
    config, _ = pace.after(CONFIG, track(167.0))
    back, _ = pace.after(config, track(30.0))
    assert back == CONFIG


def test_a_pair_alone_tells_no_rate_worth_acting_on():
    assert Pace().after(CONFIG, track(500.0, innovations=0)) == (CONFIG, ())


def test_what_the_operator_sets_stands_until_the_track_ends():
    pace = Pace()
    config, _ = pace.after(CONFIG, track(167.0))
    own = with_setting(config, "exposure.exposure_s", 4.0)
    assert pace.after(own, track(167.0)) == (own, ())
    after, changes = pace.after(own, None)
    assert [c.name for c in changes] == ["exposure.cadence_s"]
    assert (after.exposure.exposure_s, after.exposure.cadence_s) == (4.0, 30.0)
    later, changes = pace.after(after, track(600.0))
    assert changes
    assert pace.after(later, None)[0] == after


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("exposure.automatic", False),
        ("filter.preset", "paper"),
        ("calibration.darks", ["dark-10s.fits"]),
    ],
)
def test_where_one_exposure_is_wanted_it_is_left(name, value):
    config = with_setting(CONFIG, name, value)
    assert Pace().after(config, track(500.0)) == (config, ())


def test_an_exposure_below_the_bound_is_never_lengthened_for_a_streak_that_is_too_long():
    short = with_setting(CONFIG, "exposure.exposure_s", 0.2)
    assert exposure_and_cadence_for(10_000.0, short)[0] <= 0.2


def test_bounds_the_wrong_way_round_are_refused():
    with pytest.raises(Exception, match="shortest_s"):
        with_setting(with_setting(CONFIG, "exposure.longest_s", 3.0), "exposure.shortest_s", 5.0)


def test_the_rate_is_on_the_sky_not_in_right_ascension():
    fast = replace(track(0.0), x=(10.0, 167.0 / 3600.0, 80.0, 0.0))
    assert Pace().after(CONFIG, fast) == (CONFIG, ())
