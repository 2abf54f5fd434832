"""The verb lightcurve: what it prints of a night whose light is known."""

import csv
import io
import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from rsoconsole.base import SessionError
from rsoconsole.cli.app import app
from tests.nights.light_worlds import LightWorld, record_light, sinusoid, steady
from tests.nights.made_up_night import add_frames, armed, begin
from tests.pages.json_page import expect_documented


@pytest.fixture(scope="module")
def night(tmp_path_factory: pytest.TempPathFactory) -> Path:
    world = LightWorld(light=sinusoid(90.0), frames=30)
    return record_light(tmp_path_factory.mktemp("light") / "night", world)


def ran(*words: str) -> str:
    run = CliRunner().invoke(app, ["lightcurve", *words])
    assert run.exit_code == 0, run.output
    return run.stdout


def test_words_have_magnitude_plot_and_period(night: Path) -> None:
    said = ran(str(night)).splitlines()
    assert said[0].startswith("night: track 1: V 1")
    assert "30 streaks, 1200 steps" in said[0]
    assert sum("●" in line for line in said) > 5
    (period,) = [line for line in said if line.startswith("period ")]
    assert 89.0 < float(period.split()[1]) < 91.0
    assert "false-alarm probability" in period
    assert any(line.startswith("half 4") and "double 1" in line for line in said)
    assert said[-1] == "no glint"


def test_the_bright_side_is_up(tmp_path: Path) -> None:
    fading = LightWorld(light=lambda t_s: 10.0 ** (-0.001 * t_s), frames=25, steps=0)
    said = ran(str(record_light(tmp_path / "fading", fading))).splitlines()
    marks = [line.index("●") for line in said if "●" in line]
    assert marks[0] < 10
    assert marks[-1] > 60


def test_the_json_is_as_on_its_page(night: Path) -> None:
    told = json.loads(ran(str(night), "--json"))
    expect_documented("lightcurve", told)
    assert told["period"]["period_s"] == pytest.approx(90.0, rel=0.01)
    assert told["period"]["double_s"] == pytest.approx(180.0, rel=0.01)
    assert len(told["light"]) == told["streaks"] == 30
    assert told["glints"] == []


def test_the_csv_has_streaks_and_steps(night: Path) -> None:
    rows = list(csv.DictReader(io.StringIO(ran(str(night), "--csv"))))
    assert [each["kind"] for each in rows] == ["streak"] * 30 + ["step"] * 1200
    assert float(rows[0]["mag"]) == pytest.approx(11.0, abs=0.4)


def test_steady_light_has_no_period(tmp_path: Path) -> None:
    folder = record_light(tmp_path / "steady", LightWorld(light=steady, frames=25))
    said = ran(str(folder))
    assert "no period from " in said
    assert json.loads(ran(str(folder), "--json"))["period"] is None


def test_what_cannot_be_shown_is_said(night: Path, tmp_path: Path) -> None:
    wrong = CliRunner().invoke(app, ["lightcurve", str(night), "--track", "7"])
    assert wrong.exit_code == 2
    assert "there is no track 7: there are 1" in wrong.output
    both = CliRunner().invoke(app, ["lightcurve", str(night), "--csv", "--json"])
    assert both.exit_code == 2

    writer = begin(tmp_path / "dark")
    armed(writer)
    add_frames(writer, range(1, 8))
    writer.close()
    dark = CliRunner().invoke(app, ["lightcurve", str(tmp_path / "dark")])
    assert isinstance(dark.exception, SessionError)
    assert "no brightness of any track is on record" in str(dark.exception)
