"""calibrate-elements as a shell sees it: nights, files of lines, the ledger, the configuration."""

import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from rsoconsole.base import ConfigError, RsoconsoleError
from rsoconsole.cli.app import app
from rsoconsole.config import Config, config_to_toml, load_config
from rsoconsole.orbits import ASSUMED, ElementSet
from rsoconsole.pipeline import catalogue_errors
from rsoconsole.session import (
    SessionReader,
    SessionWriter,
    element_ledger_path,
    read_element_ledger,
    replace_session_rows,
)
from tests.cli.test_cli_orbit import write_track
from tests.orbits.test_element_fit import row
from tests.pages.json_page import expect_documented
from tests.truth.seen_satellites import geostationary, instants

DAY_S = 86_400.0
SLOTS = {90001: -60.0, 90002: -50.0, 90003: -71.0}
BY_HAND = """\
# The dome at the lake

[catalogue]   # names
gate_deg = 0.3   # see the log of 3 May

# by Ana
[detector]
tau = 0.4
"""


@pytest.fixture(autouse=True)
def own_folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setenv("RSOCONSOLE_CONFIG", str(tmp_path / "own.toml"))
    (tmp_path / "own.toml").write_text(BY_HAND)


@pytest.fixture
def own(tmp_path: Path) -> Path:
    """The configuration."""
    return tmp_path / "own.toml"


@pytest.fixture
def tle(tmp_path: Path) -> Path:
    """The satellites as published: each a little off."""
    path = tmp_path / "catalogue.tle"
    sets = [geostationary(number, slot) for number, slot in SLOTS.items()]
    path.write_text("".join(f"{each.line_1}\n{each.line_2}\n" for each in sets))
    return path


def night(
    folder: Path, days: float, *numbers: int, off_deg: float = 0.01, is_simulated: bool = False
) -> Path:
    """A session of ten minutes of each, which stand so far east of their elements."""
    site = {"latitude_deg": 29.19, "longitude_deg": -81.05, "elevation_m": 10.0}
    about = {"title": folder.name, "is_simulated": is_simulated}
    writer = SessionWriter.create(folder, Config.model_validate({"site": site}), about)
    for n, number in enumerate(numbers):
        real: ElementSet = geostationary(number, SLOTS[number] + off_deg)
        write_track(writer, 1 + 100 * n, real, instants(days * DAY_S + 1800.0 * n, 20))
    writer.close()
    return folder


def report(*arguments: str | Path, code: int = 0) -> dict[str, Any]:
    done = CliRunner().invoke(app, ["calibrate-elements", *map(str, arguments), "--json"])
    assert done.exit_code == code, done.output
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def said(*arguments: str | Path, code: int = 0) -> str:
    done = CliRunner().invoke(app, ["calibrate-elements", *map(str, arguments)])
    assert done.exit_code == code, done.output
    # A fault of the program's own kind is a line of the whole program (``cli.app.main``).
    assert done.exception is None or isinstance(done.exception, SystemExit | RsoconsoleError)
    return " ".join(f"{done.output} {done.exception or ''}".split())


def test_a_night_goes_into_the_ledger_and_a_second_time_takes_its_own_place(
    tmp_path: Path, tle: Path
) -> None:
    monday = night(tmp_path / "monday", 2.0, 90001, 90002)
    first = report(monday, "--tle", tle)
    expect_documented("calibrate-elements", first)
    (one,) = first["nights"]
    assert [each["norad_id"] for each in one["rows"]] == [90001, 90002]
    for each in one["rows"]:
        # 0.01 deg of the belt: 7.36 km, 2.4 s at 3.07 km/s.
        assert each["along_km"] == pytest.approx(7.36, abs=0.3)
        assert each["along_s"] == pytest.approx(2.4, abs=0.1)
        assert abs(each["across_km"]) < 0.2
        assert each["age_days"] == pytest.approx(2.0, abs=0.05)
        assert 0.0 < each["sigma_along_km"] < 0.2
        assert each["regime"] == "GEO"
    again = report(monday, "--tle", tle)
    assert again["tracks"] == 2
    assert again["regimes"] == first["regimes"]
    tuesday = night(tmp_path / "tuesday", 3.0, 90003)
    both = report(tuesday, "--tle", tle)
    (geo,) = both["regimes"]
    assert (geo["rows"], geo["objects"]) == (3, 3)
    assert [(each["from_days"], each["tracks"]) for each in geo["ages"]] == [(1.0, 2), (3.0, 1)]
    # Without a night: what it holds.
    assert report() == {**both, "nights": []}
    words = said()
    assert "geosynchronous orbits: 3 tracks of 3 objects" in words
    assert "along the track, what grows by age" in words


def test_elements_that_are_younger_than_the_night_have_a_negative_age(
    tmp_path: Path, tle: Path
) -> None:
    found = report(night(tmp_path / "before", -3.0, 90001), "--tle", tle)
    assert found["nights"][0]["rows"][0]["age_days"] == pytest.approx(-3.0, abs=0.05)


def test_written_factors_keep_all_else_of_the_file_and_name_from_then_on(
    tmp_path: Path, tle: Path, own: Path
) -> None:
    monday = night(tmp_path / "monday", 2.0, 90001, 90002, off_deg=0.03)
    found = report(monday, "--tle", tle, "--write")
    assert found["written"] == str(own)
    assert own.read_text().startswith(BY_HAND)
    (factors,) = load_config(own).catalogue.error_factors
    assert factors.regime == "GEO"
    assert (factors.tracks, factors.objects) == (2, 2)
    assert factors.measured_on.isoformat() == found["regimes"][0]["t_last_utc"][:10]
    assert factors.along_by_age == pytest.approx(
        found["regimes"][0]["factors"]["along_by_age"], abs=1e-3
    )
    assert factors.along_by_age > 1.2
    errors = catalogue_errors(load_config(own).catalogue)
    assert errors.undisturbed["GEO"].along[1] == pytest.approx(1.5 * factors.along_by_age)
    shown = report()["regimes"][0]["in_use"]
    assert shown["along_by_age"] == factors.along_by_age
    # Another night in the place of the block; identify says whose errors it goes by.
    report(night(tmp_path / "tuesday", 3.0, 90003), "--tle", tle, "--write")
    assert own.read_text().count("[[catalogue.error_factors]]") == 1
    done = CliRunner().invoke(app, ["identify", str(monday), "--tle", str(tle)])
    assert "errors of geosynchronous orbits by 3 own tracks of 3 objects, to 3 days" in " ".join(
        done.output.split()
    )
    done = CliRunner().invoke(app, ["identify", str(monday), "--tle", str(tle), "--json"])
    named = json.loads(done.stdout)
    expect_documented("identify", named)
    sources = {each["regime"]: each["source"] for each in named["element_errors"]}
    assert sources == {"GEO": "measured", "MEO": "assumed", "LEO": "assumed", "HEO": "assumed"}


def test_factors_are_recorded_with_a_session_and_checked(tmp_path: Path, own: Path) -> None:
    block = (
        '[[catalogue.error_factors]]\nregime = "LEO"\nalong_at_epoch = 0.8\n'
        "along_at_epoch_sigma = 0.2\nalong_by_age = 1.4\nalong_by_age_sigma = 0.2\n"
        "across = 2.0\nacross_sigma = 0.1\ntracks = 34\nobjects = 21\noldest_days = 12.1\n"
        "measured_on = 2026-11-20\n"
    )
    own.write_text(BY_HAND + block)
    config = load_config(own)
    copy = tmp_path / "copy.toml"
    copy.write_text(config_to_toml(config))
    assert load_config(copy) == config
    SessionWriter.create(tmp_path / "night", config, {"title": "night"}).close()
    recorded = SessionReader(tmp_path / "night").config().catalogue
    assert recorded == config.catalogue
    assert catalogue_errors(recorded).undisturbed["LEO"].along == pytest.approx((0.8, 2.1, 0.42))
    own.write_text(BY_HAND + block + block)
    with pytest.raises(ConfigError, match="error_factors has LEO twice"):
        load_config(own)
    # A session of before has none: it is named as it was.
    assert catalogue_errors(Config().catalogue) is ASSUMED


def test_identify_says_that_errors_are_assumed_where_none_were_measured(
    tmp_path: Path, tle: Path
) -> None:
    folder = night(tmp_path / "monday", 2.0, 90001)
    done = CliRunner().invoke(app, ["identify", str(folder), "--tle", str(tle)])
    words = "errors of geosynchronous orbits as the literature has them, not measured"
    assert words in " ".join(done.output.split())


def test_simulated_nights_are_kept_apart_and_never_written(tmp_path: Path, tle: Path) -> None:
    demo = night(tmp_path / "demo", 2.0, 90001, is_simulated=True)
    real = night(tmp_path / "real", 2.0, 90002)
    assert "demo is a simulated night" in said(demo, real, "--tle", tle, code=1)
    assert report()["tracks"] == 1  # the real one
    assert "leave --simulated out" in said(real, "--tle", tle, "--simulated", code=1)
    assert report(demo, "--tle", tle, "--simulated")["tracks"] == 1
    assert report("--simulated")["simulated"] is True
    assert "simulated nights tell nothing of real elements" in said(
        "--simulated", "--write", code=2
    )


def field_lines(path: Path, *, probability: float = 0.99) -> Iterator[dict[str, Any]]:
    match = {
        "norad_id": 901,
        "name": "LOW 901",
        "tle_age_days": 1.0,
        "tle_epoch_utc": "2023-06-21T02:00:00.000Z",
        "regime": "LEO",
        "probability": probability,
        "along_track_s": 0.4,
        "sigma_along_track_s": 0.01,
        "cross_track_arcsec": -20.0,
        "sigma_cross_track_arcsec": 1.0,
        "along_track_km": 3.0,
        "cross_track_km": -0.097,
        "speed_km_s": 7.5,
        "range_km": 1000.0,
        "cross_track_by_radial": 0.4,
        "cross_track_by_plane": 0.9,
    }
    seen = {"verdict": "identified", "matches": [match], "not_catalogued": 0.0}
    unknown = {"verdict": "unknown", "matches": [], "not_catalogued": 1.0}
    yield {
        "frame": str(path / "f1.fits"),
        "t_mid_utc": "2023-06-22T02:00:00.000Z",
        "streaks": [{"streak": 1, **seen}, {"streak": 2, **unknown}],
    }
    yield {"frame": str(path / "f2.fits"), "error": "it is no frame"}
    yield {
        "frames": ["f1.fits", "f3.fits"],
        "movers": [
            {
                "mover": 1,
                "t_mid_utc": "2023-06-22T02:10:00.000Z",
                "places": [{"frame": "f1.fits"}] * 3,
                **seen,
            }
        ],
    }


def written(path: Path, lines: Iterator[dict[str, Any]] | list[dict[str, Any]]) -> Path:
    path.write_text("".join(f"{json.dumps(each)}\n" for each in lines))
    return path


def test_lines_of_identify_field_are_rows_too(tmp_path: Path) -> None:
    file = written(tmp_path / "field.jsonl", field_lines(tmp_path))
    found = report(file)
    (one,) = found["nights"]
    assert (one["tracks"], len(one["rows"])) == (3, 2)
    streak, mover = one["rows"]
    assert (streak["track"], mover["track"]) == ("streak 1", "mover 1")
    assert mover["observations"] == 3
    assert streak["along_km"] == pytest.approx(3.0)
    assert streak["across_km"] == pytest.approx(-0.097, abs=1e-3)
    assert streak["age_days"] == pytest.approx(1.0)
    (low,) = found["regimes"]
    assert low["regime"] == "LEO"
    assert low["counted"] == pytest.approx(1.0)  # one object, one night
    assert report(file)["tracks"] == 2
    unsure = written(tmp_path / "field.jsonl", field_lines(tmp_path, probability=0.9))
    assert report(unsure)["tracks"] == 0  # what is no more sure is taken back


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("", "holds no frame"),
        ("hello\n", "line 1 is none of 'rsoconsole identify --field --json'"),
        ('{"frame": "a", "t_mid_utc": "2023-06-22T02:00:00Z", "streaks": [{}]}\n', "without"),
        ('{"frame": "a", "t_mid_utc": "yesterday", "streaks": []}\n', "line 1 is none"),
        ("[" * 100_000, "nested too deeply"),
        ("\x00\xff", "line 1 is none"),
    ],
)
def test_a_bad_file_is_said_in_a_line(tmp_path: Path, content: str, words: str) -> None:
    file = tmp_path / "bad.jsonl"
    file.write_text(content)
    assert words in said(file, code=1)
    assert not element_ledger_path().exists()


def test_lines_of_an_older_version_are_asked_for_once_more(tmp_path: Path) -> None:
    lines = list(field_lines(tmp_path))
    del lines[0]["streaks"][0]["matches"][0]["speed_km_s"]
    words = said(written(tmp_path / "old.jsonl", lines), code=1)
    assert "without 'speed_km_s'): print it again" in words


def test_what_cannot_be_used_ends_no_other_night(tmp_path: Path, tle: Path) -> None:
    empty = night(tmp_path / "empty", 2.0)
    good = night(tmp_path / "good", 2.0, 90001)
    words = said(empty, tmp_path / "nowhere", good, "--tle", tle, code=1)
    assert "empty holds no track" in words
    assert "nowhere does not exist: name a session's folder, or the lines" in words
    assert "good: 1 of 1 tracks surely named" in words
    assert report()["tracks"] == 1


def test_without_a_catalogue_it_says_how_to_name_one(tmp_path: Path) -> None:
    words = said(night(tmp_path / "monday", 2.0, 90001), code=1)
    assert "no catalogue: name element sets with --tle FILE" in words
    assert "no track is kept in" in words


def test_nothing_is_written_from_an_empty_ledger_nor_into_a_broken_file(
    tmp_path: Path, tle: Path, own: Path
) -> None:
    assert "not written: the ledger holds no track" in said("--write", code=1)
    assert "elements are for nights" in said("--tle", tle, code=2)
    folder = night(tmp_path / "monday", 2.0, 90001)
    report(folder, "--tle", tle)
    own.write_text("catalogue = {gate_deg = 0.3}\n")
    assert "edit it by hand" in said("--write", code=1)
    assert own.read_text() == "catalogue = {gate_deg = 0.3}\n"


def test_a_damaged_ledger_costs_its_damaged_lines_alone(tmp_path: Path, tle: Path) -> None:
    report(night(tmp_path / "monday", 2.0, 90001, 90002), "--tle", tle)
    path = element_ledger_path()
    lines = path.read_bytes().split(b"\n")
    broken = b"\n".join([lines[0], lines[1][:60], *lines[2:]]) + b"\x00 rubbish\n"
    path.write_bytes(broken)
    assert "2 lines, 2 the first, cannot be read" in said()
    assert path.read_bytes() == broken
    words = said(night(tmp_path / "tuesday", 3.0, 90003), "--tle", tle)
    assert "the ledger was damaged: it is in" in words
    assert path.with_name(f"{path.name}.damaged-1").read_bytes() == broken
    assert report()["tracks"] == 2


def test_a_later_versions_ledger_is_left_alone(tmp_path: Path) -> None:
    path = element_ledger_path()
    path.parent.mkdir(parents=True)
    path.write_text('{"did": "begun", "format": 2}\n')
    assert "of a later rsoconsole: update this one" in said(code=1)


def test_rows_come_back_as_they_were_and_nonsense_is_damage(tmp_path: Path) -> None:
    path = tmp_path / "elements.jsonl"
    rows = [row(7, 1.5, night=1), row(8, -2.5, night=2)]
    kept, _ = replace_session_rows([], rows, path)
    assert list(kept.rows) == rows
    size = path.stat().st_size
    replace_session_rows([], rows, path)
    assert path.stat().st_size == size  # what is there already is not written again
    text = path.read_text()
    for good, bad in (("1.5", "NaN"), ('"LEO"', '"XEO"'), ("0.05", "-1.0"), ("0.05", '"a"')):
        path.write_text(text.replace(good, bad, 1))
        found = read_element_ledger(path)
        assert list(found.rows) == rows[1:]
        assert found.unreadable == (2,)


def test_two_nights_of_one_name_are_two(tmp_path: Path, tle: Path) -> None:
    report(night(tmp_path / "one" / "night", 2.0, 90001), "--tle", tle)
    shutil.move(tmp_path / "one", tmp_path / "elsewhere")
    assert report(tmp_path / "elsewhere" / "night", "--tle", tle)["tracks"] == 1
    assert report(night(tmp_path / "night", 3.0, 90001), "--tle", tle)["tracks"] == 2
