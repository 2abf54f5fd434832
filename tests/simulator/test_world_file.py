"""Worlds as files, as random draws and as documentation: what is named is what is meant."""

import re

import numpy as np
import pytest

from models.world_settings import README, with_table
from rsoconsole.base import ConfigError
from rsoconsole.config import allowed_words
from rsoconsole.simulator import (
    DEFAULT_WORLD,
    LAWS,
    World,
    load_world,
    random_world,
    settings_of_worlds,
    world_from,
    world_to_toml,
)

TWO_HUNDRED_SEEDS = range(200)


def value_of(world, name):
    section, _, key = name.partition(".")
    return getattr(getattr(world, section), key)


def test_a_world_is_read_from_toml_and_written_so_that_it_reads_back_the_same(tmp_path):
    path = tmp_path / "windy.toml"
    path.write_text("[wind]\nrms_px = 1.5\n[sensor]\nbayer = true\nbits = 14\n", encoding="utf-8")
    world = load_world(path)
    assert world.non_default_settings() == {
        "wind": {"rms_px": 1.5},
        "sensor": {"bayer": True, "bits": 14},
    }
    for each in (world, random_world(3)):
        path.write_text(world_to_toml(each), encoding="utf-8")
        assert load_world(path) == each


def test_an_empty_file_names_nothing(tmp_path):
    path = tmp_path / "empty.toml"
    path.write_text("", encoding="utf-8")
    assert load_world(path) == DEFAULT_WORLD
    assert world_to_toml(DEFAULT_WORLD) == ""


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"stars": {"drift_pix": 3}}, r"no setting 'stars.drift_pix': .*\[stars\] drift_px\?"),
        ({"wind": {"drift_px": 3}}, r"no setting 'wind.drift_px': .*\[stars\] drift_px\?"),
        ({"sensr": {"bits": 8}}, r"no section 'sensr': did you mean \[sensor\]\?"),
        ({"drift_px": 3}, r"no section 'drift_px': did you mean \[stars\] drift_px\?"),
        ({"stars": {"drift_px": 500}}, r"drift_px = 500 cannot be; allowed: >= 0, <= 200 px"),
        ({"stars": {"drift_px": "far"}}, r"drift_px = 'far' cannot be; allowed"),
        ({"stars": 12}, r"stars is a section: write \[stars\] above"),
        ({"clock": {"offset_s": float("nan")}}, r"offset_s = nan cannot be"),
    ],
)
def test_a_fault_is_named_with_its_remedy(table, words):
    with pytest.raises(ConfigError, match=words):
        world_from(table)


def test_every_fault_of_a_file_is_told_at_once():
    with pytest.raises(ConfigError, match=r"'wind.rms'.*bits = 7"):
        world_from({"wind": {"rms": 1}, "sensor": {"bits": 7}})


def test_a_file_that_is_not_there_or_no_toml_says_what_one_looks_like(tmp_path):
    with pytest.raises(ConfigError, match=r"does not exist: .*\[stars\] drift_px = 12"):
        load_world(tmp_path / "none.toml")
    path = tmp_path / "bad.toml"
    path.write_text("drift = = 3", encoding="utf-8")
    with pytest.raises(ConfigError, match=r"cannot be read as TOML .*\[stars\] drift_px = 12"):
        load_world(path)


def test_an_operator_knows_the_latency_to_a_tenth_of_a_second():
    for latency_s, known_s in ((0.0, 0.0), (0.04, 0.0), (0.37, 0.4), (0.848, 0.8)):
        world = world_from({"shutter": {"latency_s": latency_s, "bias_s": 0.3}})
        assert world.known_latency_s == pytest.approx(known_s)


def test_a_seed_has_one_random_world_and_another_seed_another():
    assert random_world(7) == random_world(7)
    assert random_world(7) != random_world(8)


@pytest.mark.parametrize(
    ("name", "low", "high", "share"),
    [
        ("shutter.scatter_s", 0.01, 1.0, 1.0),
        ("shutter.latency_s", 0.0, 1.0, 1.0),
        ("shutter.line_time_us", 0.0, 25.0, 1.0),
        ("seeing.fwhm_arcsec", 1.5, 7.0, 1.0),
        ("focus.ring_px", 0.0, 10.0, 0.2),
        ("stars.drift_px", 0.0, 20.0, 1.0),
        ("wind.rms_px", 0.0, 4.0, 1.0),
        ("sensor.row_noise_sigma", 0.0, 2.0, 1.0),
        ("optics.scale_error", -0.04, 0.04, 1.0),
        ("clock.offset_s", -2.0, 2.0, 1.0),
        ("satellite.flash_period_s", 1.0, 60.0, 0.1),
    ],
)
def test_random_worlds_fill_the_stated_ranges(name, low, high, share):
    default = value_of(DEFAULT_WORLD, name)
    drawn = [value_of(random_world(seed), name) for seed in TWO_HUNDRED_SEEDS]
    named = np.array([value for value in drawn if value != default], dtype=float)
    assert len(named) / len(drawn) == pytest.approx(share, abs=0.07)
    assert low <= named.min()
    assert named.max() <= high
    if share == 1.0:
        assert named.min() < low + 0.05 * (high - low)
        assert named.max() > high - 0.05 * (high - low)


def test_shutter_scatter_is_uniform_in_its_logarithm():
    drawn = [random_world(seed).shutter.scatter_s for seed in TWO_HUNDRED_SEEDS]
    assert np.median(np.log10(drawn)) == pytest.approx(-1.0, abs=0.2)


def test_a_low_satellite_crosses_a_tenth_of_the_frames():
    assert {random_world(seed).traffic.low_satellite_rate for seed in range(20)} == {0.1}


def test_settings_of_one_group_are_named_together():
    for seed in TWO_HUNDRED_SEEDS:
        flash = random_world(seed).non_default_settings().get("satellite", {})
        assert len(flash) in {0, 3}


def test_every_law_names_a_setting_that_there_is():
    names = set(settings_of_worlds())
    assert {law.name for law in LAWS} <= names


def test_every_setting_says_what_it_is():
    for name, setting in settings_of_worlds().items():
        assert setting.description
        assert setting.default is not None or setting.json_schema_extra["own"]
        assert allowed_words(setting) or isinstance(value_of(World(), name), bool)


def test_the_documentation_is_the_code():
    text = README.read_text(encoding="utf-8")
    assert text == with_table(text), "python -m models.world_settings writes it"
    rows = re.findall(r"^\| `(\w+)` \|", text, flags=re.MULTILINE)
    assert len(rows) == len(settings_of_worlds())
