"""calibrate-time on recorded nights; their truth is made by ``tests/truth/navigation_truth.py``.

Twenty tracks with a bias of 137 ms, a scatter of 8 ms, lines of 15 us and stars that are all off
by 0.2 arcsec must give all three within their stated errors, the bias to 5 ms.
"""

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from rsoconsole.cli.app import app
from rsoconsole.config import load_config
from rsoconsole.orbits.navigation.sp3 import utc_ns_of_gps
from rsoconsole.pipeline import read_rinex
from rsoconsole.records import CameraMode
from rsoconsole.sky import iso_to_utc_ns
from rsoconsole.words import NS_PER_S, camera_mode_words
from tests.pages.json_page import expect_documented
from tests.pipeline.test_navigation_files import BROADCAST_2, PRECISE, epochs_of
from tests.truth.navigation_truth import (
    GPS_MINUS_UTC_S,
    Constellation,
    Plan,
    Shutter,
    constellation,
    flight_of_file,
    night,
    of_elements,
)
from tests.truth.regimes import TLES

T0 = iso_to_utc_ns("2023-06-22T01:00:00Z") - GPS_MINUS_UTC_S * NS_PER_S
NIGHTS = 3
statistics = pytest.mark.nightly("statistics over many drawn nights")
FIVE_MS = 0.005
SIGMAS = 3.0


@pytest.fixture(autouse=True)
def own_config(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RSOCONSOLE_CONFIG", str(tmp_path / "none.toml"))


@pytest.fixture(scope="module")
def sky() -> Constellation:
    return constellation(T0, 10.0)


@pytest.fixture(scope="module")
def sp3(sky: Constellation, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("orbits") / "day.sp3"
    path.write_text(sky.sp3())
    return path


@pytest.fixture(scope="module")
def recorded(sky: Constellation, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    return nights(range(NIGHTS), sky, tmp_path_factory.mktemp("nights"))


@pytest.fixture(scope="module")
def more_recorded(sky: Constellation, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    return nights(range(NIGHTS, 2 * NIGHTS), sky, tmp_path_factory.mktemp("more-nights"))


def nights(seeds: range, sky: Constellation, root: Path) -> list[Path]:
    return [
        night(root / f"n{seed}", sky, Shutter(), Plan(), np.random.default_rng(seed))
        for seed in seeds
    ]


def found(*arguments: str | Path) -> dict[str, Any]:
    done = CliRunner().invoke(app, ["calibrate-time", *map(str, arguments), "--json"])
    assert done.exit_code == 0, done.output
    (line,) = done.stdout.splitlines()
    expect_documented("calibrate-time", json.loads(line))
    return json.loads(line)


def failure(*arguments: str | Path) -> str:
    done = CliRunner().invoke(app, ["calibrate-time", *map(str, arguments)])
    assert done.exit_code != 0
    assert done.exception is not None
    return str(done.exception) if not isinstance(done.exception, SystemExit) else done.output


def off(told: dict[str, Any], name: str, truth: float) -> float:
    """In stated sigmas."""
    return (told[name]["value"] - truth) / told[name]["sigma"]


def test_bias_scatter_and_line_time_lie_within_their_stated_errors(recorded, sp3) -> None:
    expect_stated_errors(recorded, sp3)


@statistics
def test_so_they_do_in_more_nights(recorded, more_recorded, sp3) -> None:
    expect_stated_errors([*recorded, *more_recorded], sp3)


def expect_stated_errors(folders: list[Path], sp3: Path) -> None:
    all_off = []
    for folder in folders:
        told = found(folder, "--sp3", sp3)
        (mode,) = told["modes"]
        assert told["of_most_streaks"] == mode
        assert mode["bias_s"]["sigma"] <= FIVE_MS
        assert mode["mode"].startswith(f"{mode['exposure_s']:g} s")
        all_off.append(
            [
                off(mode, "bias_s", 0.137),
                off(mode, "scatter_s", 0.008),
                off(mode, "line_time_s", 15e-6),
                off(mode, "bias_at_middle_s", 0.137 + 15e-6 * mode["middle_row_px"]),
            ]
        )
        assert mode["rejected"] == 2  # the two that were put 15 arcsec off, and no other
        assert 15 <= mode["tracks"] <= 20  # those of one satellite in half an hour are one
        (of_night,) = told["nights"]
        drift, sigma = (
            np.array([each[key] for each in of_night["drift_arcsec"]]) for key in ("value", "sigma")
        )
        assert np.all(np.abs(drift - [0.16, -0.12]) <= SIGMAS * sigma)
        assert of_night["is_separated"]
    assert np.max(np.abs(all_off)) <= SIGMAS
    # Stated errors that were far too large would hold as well.
    assert 0.4 < np.sqrt(np.mean(np.square(all_off))) < 1.5


def test_several_sessions_of_a_night_share_what_the_catalogue_is_off(recorded, sp3) -> None:
    together, alone = found(*recorded[:3], "--sp3", sp3), found(recorded[0], "--sp3", sp3)
    assert len(together["nights"]) == 1
    assert len(together["nights"][0]["folders"]) == 3
    (mode,), (first,) = together["modes"], alone["modes"]
    assert mode["bias_s"]["sigma"] < 0.8 * first["bias_s"]["sigma"]
    assert abs(off(mode, "bias_s", 0.137)) <= SIGMAS


def test_each_camera_mode_has_a_shutter_of_its_own(sky, sp3, tmp_path) -> None:
    plain, binned = Shutter(), Shutter(bias_s=0.052, scatter_s=0.02, line_time_s=30e-6)
    rng = np.random.default_rng(11)
    one = night(tmp_path / "one", sky, plain, Plan(tracks=14), rng)
    camera = CameraMode(binning="2x2", gain=0.0)
    other = night(tmp_path / "two", sky, binned, Plan(tracks=14, camera=camera), rng)
    told = found(one, other, "--sp3", sp3)
    by_binning = {mode["binning"]: mode for mode in told["modes"]}
    assert by_binning.keys() == {"1x1", "2x2"}
    for binning, shutter in (("1x1", plain), ("2x2", binned)):
        mode = by_binning[binning]
        assert abs(off(mode, "bias_s", shutter.bias_s)) <= SIGMAS
        assert abs(off(mode, "scatter_s", shutter.scatter_s)) <= SIGMAS
        assert abs(off(mode, "line_time_s", shutter.line_time_s)) <= SIGMAS


def test_nights_whose_clocks_differ_are_said_and_are_in_the_error(sky, tmp_path) -> None:
    later = constellation(T0 + 24 * 3600 * NS_PER_S, 10.0)
    rng = np.random.default_rng(12)
    folders = [
        night(tmp_path / "one", sky, Shutter(), Plan(tracks=12), rng),
        night(tmp_path / "two", later, Shutter(bias_s=0.237), Plan(tracks=12), rng),
    ]
    both = tmp_path / "both.sp3"
    both.write_text(sky.sp3())
    second = tmp_path / "second.sp3"
    second.write_text(later.sp3())
    told = found(*folders, "--sp3", both, "--sp3", second)
    (mode,) = told["modes"]
    assert mode["night_spread_s"] == pytest.approx(0.1 / math.sqrt(2.0), rel=0.15)
    assert mode["bias_s"]["sigma"] > 0.05
    assert any("the nights differ by" in words for words in told["cautions"])


def test_nights_that_lie_in_other_rows_have_one_shutter(sky, tmp_path) -> None:
    """A rolling shutter opens later in the lower rows: that is no other clock."""
    later = constellation(T0 + 24 * 3600 * NS_PER_S, 10.0)
    rng = np.random.default_rng(21)
    plans = (Plan(tracks=12, rows=(100.0, 900.0)), Plan(tracks=12, rows=(2600.0, 3400.0)))
    folders = [
        night(tmp_path / name, where, Shutter(), plan, rng)
        for name, where, plan in (("one", sky, plans[0]), ("two", later, plans[1]))
    ]
    files = []
    for name, where in (("a.sp3", sky), ("b.sp3", later)):
        (tmp_path / name).write_text(where.sp3())
        files += ["--sp3", tmp_path / name]
    told = found(*folders, *files)
    (mode,) = told["modes"]
    assert mode["night_spread_s"] == 0.0
    assert abs(off(mode, "bias_s", 0.137)) <= SIGMAS
    assert not any("the nights differ by" in words for words in told["cautions"])


def test_satellites_that_all_go_the_same_way_are_said(sky, sp3, tmp_path) -> None:
    plan = Plan(tracks=6, heading_deg=35.0, spread_deg=8.0)
    folder = night(tmp_path / "n", sky, Shutter(), plan, np.random.default_rng(3))
    told = found(folder, "--sp3", sp3)
    assert not told["nights"][0]["is_separated"]
    assert any("go much the same way" in words for words in told["cautions"])
    # The prior of half an arcsecond at 35 arcsec/s is what the bias is then known to.
    (mode,) = told["modes"]
    assert mode["bias_at_middle_s"]["sigma"] > FIVE_MS
    assert abs(off(mode, "bias_s", 0.137)) <= SIGMAS


def test_streaks_without_ends_serve_too(sky, sp3, tmp_path) -> None:
    plan = Plan(has_ends=False)
    folder = night(tmp_path / "n", sky, Shutter(), plan, np.random.default_rng(13))
    (mode,) = found(folder, "--sp3", sp3)["modes"]
    assert mode["bias_s"]["sigma"] <= FIVE_MS
    for name, truth in (("bias_s", 0.137), ("scatter_s", 0.008), ("line_time_s", 15e-6)):
        assert abs(off(mode, name, truth)) <= SIGMAS


@pytest.mark.parametrize("seeds", [(31,), pytest.param((32, 33), marks=statistics)])
def test_in_wind_light_tells_what_ends_do_not(seeds, sky, sp3, tmp_path) -> None:
    """Each end is off by 2.5 arcsec of wind; by light and ends together the middle by 0.45."""
    windy = Shutter(wind_arcsec=2.5)
    sigmas, all_off = [], []
    for seed in seeds:
        by_ends, by_light = (
            found(
                night(tmp_path / f"{name}{seed}", sky, each, Plan(), np.random.default_rng(seed)),
                *("--sp3", sp3),
            )["modes"][0]
            for name, each in (("ends", windy), ("light", replace(windy, light_arcsec=0.45)))
        )
        sigmas.append((by_ends["bias_s"]["sigma"], by_light["bias_s"]["sigma"]))
        all_off += [
            off(by_light, "bias_s", 0.137),
            off(by_light, "scatter_s", 0.008),
            off(by_light, "line_time_s", 15e-6),
        ]
        assert by_light["rejected"] <= 4
    assert np.max(np.abs(all_off)) <= SIGMAS
    assert all(light < 0.5 * ends for ends, light in sigmas)
    assert max(light for _, light in sigmas) <= 0.006


def test_a_line_time_that_the_rows_do_not_tell_is_the_configured_one(sky, sp3, tmp_path) -> None:
    config = {"exposure": {"line_time_us": 15.0}}
    plan = Plan(rows=(1700.0, 1700.0), cadence_s=1.0)
    folder = night(tmp_path / "n", sky, Shutter(), plan, np.random.default_rng(4), **config)
    told = found(folder, "--sp3", sp3)
    (mode,) = told["modes"]
    assert mode["is_line_time_found"] is False
    assert mode["line_time_s"]["value"] == pytest.approx(15e-6)
    assert abs(off(mode, "bias_s", 0.137)) <= SIGMAS
    assert any("rows too much alike" in words for words in told["cautions"])


def test_real_broadcast_ephemerides_calibrate_what_real_precise_orbits_show(tmp_path) -> None:
    """Truth moves by the precise file, with polynomials and frames that are not the product's."""
    told = epochs_of(PRECISE)
    t0 = iso_to_utc_ns("2021-04-28T18:00:00Z")
    flights = []
    for rows in told.values():
        t_gps_s = np.array([t for t, _ in rows]) / 1e9 + GPS_MINUS_UTC_S
        flights.append(flight_of_file(t_gps_s, np.array([p for _, p in rows]), t0))
    real = Constellation(t0_utc_ns=t0, hours=4.4, names=list(told), flights=flights)
    plan = Plan(tracks=16, least_altitude_deg=10.0)
    folder = night(tmp_path / "n", real, Shutter(), plan, np.random.default_rng(6))
    answer = found(folder, "--rinex", BROADCAST_2)
    assert answer["kind"] == "broadcast"
    assert answer["skipped"] == dict(read_rinex([BROADCAST_2]).skipped)
    (mode,) = answer["modes"]
    assert mode["bias_s"]["sigma"] <= FIVE_MS
    for name, truth in (("bias_s", 0.137), ("scatter_s", 0.008), ("line_time_s", 15e-6)):
        assert abs(off(mode, name, truth)) <= SIGMAS


@pytest.mark.skipif(not (TLES / "mix_20230622.tle").exists(), reason="the elements are not there")
@pytest.mark.parametrize(
    ("late_s", "seeds"),
    [
        (0.26, (0,)),
        pytest.param(0.26, (1, 2), marks=statistics),
        *(pytest.param(late_s, range(3), marks=statistics) for late_s in (0.0, 0.1)),
    ],
)
def test_elements_tell_the_clock_as_well_as_they_know_it(late_s, seeds, tmp_path) -> None:
    """Each satellite is late by its own error: its tracks agree with each other, and are wrong."""
    file, off_by = TLES / "mix_20230622.tle", []
    for seed in seeds:
        rng = np.random.default_rng(seed)
        sky = of_elements(file, T0, 8.0, late_s, rng)
        told = found(night(tmp_path / f"n{seed}", sky, Shutter(), Plan(), rng), "--tle", file)
        assert told["kind"] == "tle"
        assert "a sanity check of the clock, not a calibration" in told["cautions"][0]
        (mode,) = told["modes"]
        assert 0.08 < mode["bias_s"]["sigma"] < 0.3
        off_by.append(off(mode, "bias_s", 0.137))
    assert np.max(np.abs(off_by)) <= SIGMAS


class TestWriting:
    def test_the_result_is_written_used_and_guarded(self, recorded, sp3, tmp_path) -> None:
        path = tmp_path / "mine.toml"
        path.write_text("# mine\n[exposure]\nexposure_s = 2.0\n")
        told = found(recorded[0], "--sp3", sp3, "--config", path, "--write")
        assert told["written"] == str(path)
        assert path.read_text().startswith("# mine\n[exposure]\nexposure_s = 2.0\n")
        (known,) = load_config(path).exposure.calibrated
        (mode,) = told["modes"]
        assert known.bias_s == pytest.approx(mode["bias_s"]["value"], abs=1e-5)
        assert camera_mode_words(known.camera_mode) == "2 s, 1x1, 4656 x 3520 px, gain 139"
        assert (known.source, known.measured_on.isoformat()) == ("sp3", told["measured_on"])
        # Two nights are better than one; one alone does not replace them.
        found(*recorded[:2], "--sp3", sp3, "--config", path, "--write")
        (better,) = load_config(path).exposure.calibrated
        assert better.bias_sigma_s < known.bias_sigma_s
        refused = failure(recorded[0], "--sp3", sp3, "--config", path, "--write")
        assert "not written" in refused
        assert "--force" in refused
        assert load_config(path).exposure.calibrated == (better,)
        found(recorded[0], "--sp3", sp3, "--config", path, "--write", "--force")
        assert load_config(path).exposure.calibrated == (known,)

    def test_a_simulated_shutter_is_not_written_over_a_cameras(self, sky, sp3, tmp_path) -> None:
        folder = night(
            tmp_path / "n", sky, Shutter(), Plan(tracks=4), np.random.default_rng(2),
            about={"is_simulated": True},
        )  # fmt: skip
        path = tmp_path / "mine.toml"
        path.write_text("")
        assert "simulated observatory" in failure(folder, "--sp3", sp3, "--config", path, "--write")
        assert path.read_text() == ""
        found(folder, "--sp3", sp3, "--config", path, "--write", "--force")
        assert len(load_config(path).exposure.calibrated) == 1

    def test_what_of_the_files_is_not_used_is_said(self, recorded, sp3, tmp_path) -> None:
        lines = sp3.read_text().splitlines()
        first = next(k for k, line in enumerate(lines) if line.startswith("PG01"))
        lines[first] = "PG01" + 3 * "      0.000000" + lines[first][46:]
        other = tmp_path / "other.sp3"
        other.write_text("\n".join(lines))
        told = found(recorded[0], "--sp3", other)
        assert told["skipped"] == {"no place at an epoch": 1}
        done = CliRunner().invoke(app, ["calibrate-time", str(recorded[0]), "--sp3", str(other)])
        for reason, times in told["skipped"].items():
            assert f"  not used of the files: {reason} ({times})" in done.stdout.splitlines()

    def test_people_are_told_the_same(self, recorded, sp3) -> None:
        done = CliRunner().invoke(app, ["calibrate-time", str(recorded[0]), "--sp3", str(sp3)])
        assert done.exit_code == 0, done.output
        lines = done.stdout.splitlines()
        assert max(map(len, lines)) <= 80
        assert lines[0].startswith("120 streaks of ")
        assert "2 s, 1x1, 4656 x 3520 px, gain 139" in lines
        assert any(line.startswith("  bias ") and " ms " in line for line in lines)


class TestWhatIsWrong:
    def test_no_orbits_are_named(self, recorded) -> None:
        assert "name the orbits" in failure(recorded[0])

    def test_elements_are_not_written(self, recorded, tmp_path) -> None:
        tle = tmp_path / "a.tle"
        tle.write_text("")
        assert "elements are no calibration" in failure(recorded[0], "--tle", tle, "--write")

    def test_the_file_is_of_another_day(self, recorded) -> None:
        words = failure(recorded[0], "--rinex", BROADCAST_2)
        assert "reaches from 2021-04-28" in words
        assert "give the file of that day" in words

    def test_the_kind_of_file_is_another(self, recorded, sp3) -> None:
        assert "is no RINEX navigation file" in failure(recorded[0], "--rinex", sp3)
        assert "is no SP3-c or SP3-d file" in failure(recorded[0], "--sp3", BROADCAST_2)

    def test_nothing_of_the_night_is_a_navigation_satellite(self, sp3, tmp_path) -> None:
        # The same streaks seen from another place are nobody's.
        elsewhere = constellation(T0, 10.0)
        plan = Plan(tracks=2)
        folder = night(
            tmp_path / "n", elsewhere, Shutter(), plan, np.random.default_rng(8),
            site={"latitude_deg": 30.2, "longitude_deg": -81.05, "elevation_m": 10.0},
        )  # fmt: skip
        assert "none of 15 streaks is a satellite of day.sp3" in failure(folder, "--sp3", sp3)

    def test_there_are_too_few(self, sky, sp3, tmp_path) -> None:
        plan = Plan(tracks=1, frames=4, outliers=0)
        folder = night(tmp_path / "n", sky, Shutter(), plan, np.random.default_rng(9))
        assert "4 streaks" in failure(folder, "--sp3", sp3)

    def test_a_folder_is_no_session(self, sp3, tmp_path) -> None:
        assert "session" in failure(tmp_path, "--sp3", sp3)


def test_the_file_of_truth_begins_on_a_whole_hour_of_gps_time() -> None:
    assert utc_ns_of_gps(T0 + GPS_MINUS_UTC_S * NS_PER_S) == T0
