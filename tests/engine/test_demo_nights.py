"""The demo's nights: one satellite comes back, six share a field, one is leapt ahead of."""

import itertools

import numpy as np
import pytest

from rsoconsole.cli.demo.demo import config_for_scenario, demo_config
from rsoconsole.config import Config
from rsoconsole.records import LeapDone, StateChange, TrackState
from rsoconsole.session import SessionReader
from rsoconsole.simulator import DEFAULT_SCENARIO, scenario_named
from tests.cli.test_demo import night_here
from tests.rigs.engine_rig import rig

CADENCE_S = 30.0
HIDDEN_MAG = 2.0


def test_the_default_nights_satellite_is_found_again_after_each_fade():
    """More than an hour without pixels: it is seen where its brightness is enough."""
    frames = np.arange(1, 132)
    target = scenario_named(DEFAULT_SCENARIO).target
    assert target is not None
    lost_mag = target.brightness.extra_mag(frames * CADENCE_S, 1)
    offline = Config.model_validate({"orbit": {"online": False}})
    r = rig({int(each) for each in frames[lost_mag < HIDDEN_MAG]}, offline)
    r.engine.arm()
    r.engine.run(frames=len(frames))
    states = [change.after for change in r.memory.of(StateChange)]
    following = [state for state in states if state in {"TRACK", "COAST", "LOST"}]
    assert following == ["TRACK", "COAST"] * 4 + ["TRACK"]
    is_hidden = itertools.groupby(lost_mag >= HIDDEN_MAG)
    longest = max(len(list(each)) for gone, each in is_hidden if gone)
    assert longest >= 9
    assert {each.track_id for each in r.memory.of(TrackState)} == {1}


def test_a_nights_own_settings_are_the_programs():
    def of(name: str) -> Config:
        scenario = scenario_named(name)
        plain = demo_config(scenario.site, preset="adaptive", keep_frames="none")
        return config_for_scenario(scenario, plain)

    assert of("intelsat-14").aim.policy == "lead"
    assert of("cluster").aim.policy == "group"
    low = of("low-pass")
    assert (low.leap.enabled, low.search.pattern, low.exposure.exposure_s) == (True, "stay", 1.0)
    assert Config.model_validate(low.model_dump()) == low


@pytest.mark.slow("six satellites in the pixels of six frames")
def test_the_cluster_night_has_six_tracks(tmp_path):
    found = night_here(tmp_path / "night", "--scenario", "cluster", frames=6, binning=4)
    assert len(found["tracks"]) == 6
    assert {each["state"] for each in found["tracks"]} == {"TRACK"}
    assert {each["track_frames"] for each in found["objects"]} == {3}
    assert found["false_measurements"] == 0


@pytest.mark.slow("a low satellite is waited for in the pixels, and met")
def test_the_low_pass_is_leapt_ahead_of(tmp_path):
    found = night_here(tmp_path / "night", "--scenario", "low-pass", frames=12, binning=4)
    assert found["target"] == "VANGUARD R/B"
    assert found["leaps"]["met"] >= 3
    done = [record for _, _, record in SessionReader(tmp_path / "night").records(kinds=(LeapDone,))]
    assert {each.result for each in done} == {"met"}


@pytest.mark.nightly("a fade in the pixels, from the first frame to after it")
@pytest.mark.timeout(600)
def test_the_default_nights_satellite_is_measured_again_after_it_was_gone(tmp_path):
    found = night_here(tmp_path / "night", frames=52, binning=4)
    [track] = found["tracks"]
    assert (track["name"], track["state"], track["last_frame"]) == ("INTELSAT 14", "TRACK", 52)
    assert found["states"]["COAST"] >= 6
    assert found["objects"][0]["false_measurements"] == 0
