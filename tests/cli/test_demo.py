"""The whole way, from a bare command to a satellite found and followed, as a shell sees it."""

import json
from pathlib import Path
from typing import Any

import pytest

from rsoconsole.cli.demo.demo import config_for_world, demo_config
from rsoconsole.pipeline import replay
from rsoconsole.records import TrackState
from rsoconsole.session import SessionReader, verify_session
from rsoconsole.simulator import DAYTONA_BEACH, load_world
from tests.cli.test_cli_frames import rsoconsole
from tests.pages.json_page import expect_documented
from tests.rigs.in_process import run_here

FRAMES = 14
whole_night = pytest.mark.nightly("simulates a night at full frame size")


def night(session: Any, *more: str, frames: int = FRAMES, timeout_s: float = 170.0) -> dict:
    """The summary of one simulated night."""
    words = ("demo", "--headless", "--json", "--frames", str(frames), "--session", session, *more)
    return summary_of(rsoconsole(*words, timeout_s=timeout_s))


def night_here(session: Any, *more: str, frames: int, binning: int) -> dict:
    """A night in the process of the tests, with the frames of a binned camera."""
    words = ("demo", "--headless", "--json", "--frames", str(frames), "--session", session, *more)
    return summary_of(run_here(*words, "--world", binned(Path(session).parent, binning)))


def summary_of(run: Any) -> dict:
    """The figures that the demo printed."""
    assert run.returncode == 0, run.stderr
    (summary,) = [json.loads(line) for line in run.stdout.splitlines()]
    expect_documented("demo", summary)
    return summary


def binned(folder: Path, binning: int) -> str:
    """A file of a world whose camera joins so many pixels on each axis."""
    path = folder / "binned.toml"
    path.write_text(f"[sensor]\nbinning = {binning}\n", encoding="utf-8")
    return str(path)


@pytest.fixture(scope="module")
def first_night(tmp_path_factory: pytest.TempPathFactory) -> dict:
    return night(tmp_path_factory.mktemp("night") / "one", "--seed", "1")


@pytest.fixture(scope="module")
def small_night(tmp_path_factory: pytest.TempPathFactory) -> dict:
    folder = tmp_path_factory.mktemp("night")
    return night(folder / "small", "--seed", "1", "--world", binned(folder, 2), frames=8)


@pytest.fixture(params=["small_night", pytest.param("first_night", marks=whole_night)])
def a_night(request: pytest.FixtureRequest) -> dict:
    return request.getfixturevalue(request.param)


@pytest.mark.slow("a whole night from a bare command on")
def test_it_finds_the_satellite_without_a_prior_and_follows_it(a_night):
    assert a_night["target"] == "INTELSAT 14"
    assert a_night["target_share"] == 1.0
    assert a_night["states"]["SEARCH"] >= 1
    assert a_night["states"]["TRACK"] >= 4
    # Three frames at 1.4 sigma a pixel are measured too, one of them beside a bright star.
    assert a_night["measured_rms_arcsec"] <= 2.0
    assert a_night["prediction_rms_arcsec"] <= 6.0
    assert a_night["inside_3sigma"] >= 0.9
    assert a_night["false_measurements"] == 0


def test_the_night_ends_with_an_orbit_and_a_name_in_the_session(a_night):
    orbit, name = a_night["orbit"], a_night["identified"]
    assert orbit["label"] == "constrained by prior"
    assert abs(orbit["a_km"] - 42_166.0) <= 3.0 * orbit["sigma_a_km"]
    assert (name["verdict"], name["name"]) == ("identified", "INTELSAT 14")
    assert name["separation_arcsec"] < 5.0
    assert name["runner_up"]
    reader = SessionReader(a_night["session"])
    found = reader.view_rows("orbits")
    assert found[-1]["a_km"] == pytest.approx(orbit["a_km"])
    updates = [row for row in reader.view_rows("track") if row["step"] == "updated"]
    assert len(found) == len(updates), "one for each direction from the third on"
    assert reader.view_rows("identifications")[-1]["norad_id"] == 36_097
    refined = [row["ms"] for row in reader.view_rows("timings") if row["stage"] == "orbit"]
    assert len(refined) == a_night["frames"]


@whole_night
def test_the_same_seed_gives_the_same_night_at_another_speed_and_in_a_world_without_names(
    first_night, tmp_path
):
    nameless = tmp_path / "nameless.toml"
    nameless.write_text("[wind]\n[shutter]\n", encoding="utf-8")
    again = night(tmp_path / "two", "--seed", "1", "--speed", "400", "--world", str(nameless))
    assert again["world"] == {}
    for key in ("session", "latency_ms"):
        del again[key]
    assert again == {key: first_night[key] for key in again}


@whole_night
def test_either_indi_client_gives_the_same_night(first_night, tmp_path, monkeypatch):
    """Frames, measurements, orbit and name to the last digit; only what a stage took differs."""
    by_pyindi = SessionReader(first_night["session"])
    if "pyindi-client" not in by_pyindi.read_meta()["versions"]:
        pytest.skip("pyindi-client is not installed")
    monkeypatch.setenv("RSOCONSOLE_INDI__CLIENT", "indipyclient")
    other = night(tmp_path / "other", "--seed", "1")
    assert {"indipyclient"} == SessionReader(other["session"]).read_meta()["versions"].keys() & {
        "indipyclient",
        "pyindi-client",
    }
    for key in ("session", "latency_ms"):
        del other[key]
    assert other == {key: first_night[key] for key in other}


def test_the_track_is_a_fold_over_the_session_bit_for_bit(a_night):
    """A replay of what is on record gives every record of the fold again."""
    reader = SessionReader(a_night["session"])
    recorded = [record for _, _, record in reader.records()]
    replayed = list(replay(recorded, reader.config()))
    assert all(frame.is_as_recorded for frame in replayed)
    states = [r for frame in replayed for r in frame.records if isinstance(r, TrackState)]
    assert states == [r for r in recorded if isinstance(r, TrackState)]
    assert len(states) >= a_night["frames"] // 2


@pytest.mark.nightly("simulates a night")
def test_a_named_world_is_that_of_the_night_and_on_record(tmp_path):
    """The operator is told the latency to 0.1 s; a clock that is 1 s wrong costs 15 arcsec."""
    world = tmp_path / "world.toml"
    world.write_text(
        "[clock]\noffset_s = 1.0\n[shutter]\nlatency_s = 0.31\n[sensor]\nbinning = 2\n",
        encoding="utf-8",
    )
    summary = night(tmp_path / "named", "--world", str(world), frames=7)
    assert summary["world"] == {
        "shutter": {"latency_s": 0.31},
        "sensor": {"binning": 2},
        "clock": {"offset_s": 1.0},
    }
    assert summary["target"] == "INTELSAT 14"
    assert summary["measured_rms_arcsec"] == pytest.approx(1.01 * 15.0, abs=1.0)
    folder = tmp_path / "named"
    assert load_world(folder / "world.toml").non_default_settings() == summary["world"]
    config = SessionReader(folder).config()
    assert config.exposure.header_latency_s == 0.3
    assert (config.optics.width_px, config.optics.pixel_um) == (2328, 7.6)
    assert verify_session(folder).state == "closed"
    assert not verify_session(folder).findings


def test_the_world_of_a_night_is_on_record_and_the_operator_knows_the_camera(small_night):
    folder = Path(small_night["session"])
    assert small_night["world"] == {"sensor": {"binning": 2}}
    assert load_world(folder / "world.toml").non_default_settings() == small_night["world"]
    optics = SessionReader(folder).config().optics
    assert (optics.width_px, optics.pixel_um) == (2328, 7.6)
    assert verify_session(folder).state == "closed"
    assert not verify_session(folder).findings


def test_of_a_world_the_operator_knows_what_can_be_known(tmp_path):
    path = tmp_path / "world.toml"
    path.write_text(
        "[clock]\noffset_s = 1.0\n[shutter]\nlatency_s = 0.31\nline_time_us = 14.8\n",
        encoding="utf-8",
    )
    own = demo_config(DAYTONA_BEACH, preset="adaptive", keep_frames="none")
    config = config_for_world(load_world(path), own)
    assert config.exposure.header_latency_s == 0.3
    assert config.exposure.line_time_us == 15
    assert config.optics == own.optics


def test_a_world_that_cannot_be_is_refused_with_its_remedy(tmp_path):
    world = tmp_path / "world.toml"
    world.write_text("[stars]\ndrift_pix = 3\n", encoding="utf-8")
    run = run_here("demo", "--headless", "--world", str(world))
    assert run.returncode == 1
    assert "no setting 'stars.drift_pix': did you mean [stars] drift_px?" in run.stderr


@whole_night
def test_an_empty_sky_ends_in_search(tmp_path):
    expect_search(night(tmp_path / "empty", "--scenario", "empty", frames=8))


@pytest.mark.nightly("one more night")
def test_a_binned_camera_finds_nothing_in_an_empty_sky_either(tmp_path):
    expect_search(night_here(tmp_path / "empty", "--scenario", "empty", frames=3, binning=4))


def expect_search(summary: dict) -> None:
    assert summary["states"] == {"SEARCH": summary["frames"]}
    assert (summary["locked_after_frames"], summary["target"]) == (None, None)
