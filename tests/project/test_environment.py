"""Settings by environment variables: above the file, below options, named where they are wrong."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from rsoconsole.base import ConfigError
from rsoconsole.cli.app import app
from rsoconsole.config import (
    Config,
    config_faults,
    config_to_toml,
    effective_settings,
    environment_warnings,
    every_setting,
    load_config,
)
from rsoconsole.config.settings import OTHERS, environment_name
from tests.pages.json_page import expect_documented

ROOT = Path(__file__).resolve().parents[2]
LATITUDE = "RSOCONSOLE_SITE__LATITUDE_DEG"


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    path = tmp_path / "config.toml"
    path.write_text("[site]\nlatitude_deg = 10.0\n\n[detector]\ntau = 0.3\n")
    monkeypatch.setenv("RSOCONSOLE_CONFIG", str(path))
    return path


def test_an_option_counts_more_than_a_variable_and_that_more_than_the_file(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert load_config().site.latitude_deg == 10.0
    monkeypatch.setenv(LATITUDE, "51.5")
    assert load_config().site.latitude_deg == 51.5
    assert load_config(file).site.latitude_deg == 51.5
    assert load_config(None, {"site.latitude_deg": 20.0}).site.latitude_deg == 20.0
    assert load_config(environ={}).site.latitude_deg == 10.0
    monkeypatch.setenv(LATITUDE, "")
    assert load_config().site.latitude_deg == 10.0
    monkeypatch.setenv(LATITUDE, "null")
    assert load_config().site.latitude_deg == Config().site.latitude_deg


def test_every_setting_can_be_given_by_its_variable(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a variable says comes to the same as what a file says."""
    table = {
        f"{section}.{key}": value
        for section, values in Config().model_dump(mode="json").items()
        for key, value in values.items()
        if value is not None
    }
    for name, value in table.items():
        text = value if isinstance(value, str) else json.dumps(value)
        monkeypatch.setenv(environment_name(name), text)
    assert load_config(environ=os.environ) == Config()
    assert set(table) <= {name for name, _, _ in every_setting(Config())}
    assert len(table) > 100


@pytest.mark.parametrize(
    ("name", "text", "value"),
    [
        ("catalogue.tle_files", "/a b", (Path("/a b"),)),
        ("catalogue.tle_files", '["/a", "~/b"]', (Path("/a"), Path("~/b"))),
        ("alerts.events", "lock", ("lock",)),
        ("console.ascii", "true", True),
        ("console.ascii", "null", None),
        ("instruments.options", '{"baud": 9600}', {"baud": 9600}),
        ("site.name", "[Hill]", "[Hill]"),
        ("indi.port", "7625", 7625),
    ],
)
def test_lists_are_one_value_or_json(
    name: str, text: str, value: object, file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(environment_name(name), text)
    found = {each: given for each, given, _ in every_setting(load_config())}
    if isinstance(value, tuple) and isinstance(value[0], Path):
        value = tuple(path.expanduser() for path in value)
    assert found[name] == value


@pytest.mark.parametrize(
    ("variable", "text", "words"),
    [
        (LATITUDE, "north", "must be a number"),
        (LATITUDE, "91", "must be at most 90"),
        ("RSOCONSOLE_CATALOGUE__TLE_FILES", '["/a"', "is no JSON"),
        ("RSOCONSOLE_INSTRUMENTS__OPTIONS", "fast", "is no JSON"),
        ("RSOCONSOLE_DETECTOR__MAP_MODE", "slow", "must be"),
    ],
)
def test_what_is_wrong_names_the_variable(
    variable: str, text: str, words: str, file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(variable, text)
    with pytest.raises(ConfigError) as found:
        load_config()
    assert variable in str(found.value)
    assert words in str(found.value)
    assert str(file) not in str(found.value)
    assert "\n" not in str(found.value)
    (fault,) = config_faults()
    assert fault.name == variable
    assert fault.remedy


def test_a_fault_of_the_file_names_the_file_and_no_variable(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RSOCONSOLE_SITE__NAME", "Hill")
    file.write_text("[site]\nlatitude_deg = 91\n")
    with pytest.raises(ConfigError) as found:
        load_config()
    assert str(file) in str(found.value)
    assert "RSOCONSOLE" not in str(found.value)
    monkeypatch.setenv(LATITUDE, "10")  # stands in for what is wrong in the file
    assert load_config().site.latitude_deg == 10.0


def test_config_show_names_the_variable_as_where_a_value_comes_from(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(LATITUDE, "51.5")
    monkeypatch.setenv("RSOCONSOLE_DETECTOR__TAU", "null")
    found = {each.name: each for each in effective_settings(None, {"aim.policy": "lead"})}
    origins = {
        name: (found[name].origin, found[name].variable)
        for name in ("site.latitude_deg", "detector.tau", "aim.policy", "site.longitude_deg")
    }
    assert origins == {
        "site.latitude_deg": ("environment", LATITUDE),
        "detector.tau": ("default", "RSOCONSOLE_DETECTOR__TAU"),
        "aim.policy": ("command line", None),
        "site.longitude_deg": ("default", None),
    }
    done = CliRunner().invoke(app, ["config", "show", "--json"])
    rows = [json.loads(line) for line in done.stdout.splitlines()]
    for row in rows[:3]:
        expect_documented("config show", row)
    assert next(each for each in rows if each["name"] == "site.latitude_deg")["value"] == 51.5
    plain = CliRunner().invoke(app, ["config", "show"]).stdout
    assert re.search(rf"^site\.latitude_deg +51\.5 +{LATITUDE}", plain, re.MULTILINE)


def test_a_secret_of_the_environment_is_shown_nowhere(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RSOCONSOLE_ALERTS__SERVICES", "tgram://T0KEN/1")
    monkeypatch.setenv("RSOCONSOLE_CATALOGUE__SOURCES", '["url:https://ann:hunter2@x.org/a"]')
    monkeypatch.setenv("RSOCONSOLE_CATALOGUE__SPACE_TRACK_URL", "https://ann:hunter2@x.org")
    config = load_config()
    assert config.alerts.services == ("tgram://T0KEN/1",)
    shown = CliRunner().invoke(app, ["config", "show"]).stdout
    shown += CliRunner().invoke(app, ["config", "show", "--json"]).stdout
    shown += config_to_toml(config) + repr(config)
    monkeypatch.setenv("RSOCONSOLE_ALERTS__SERVICES", '["T0KEN"]')
    monkeypatch.setenv("RSOCONSOLE_CATALOGUE__SOURCES", "ann:hunter2@x.org")
    monkeypatch.setenv("RSOCONSOLE_CATALOGUE__SPACE_TRACK_URL", "ftp://ann:hunter2@x.org")
    with pytest.raises(ConfigError) as found:
        load_config()
    shown += str(found.value) + repr(config_faults())
    monkeypatch.setenv("RSOCONSOLE_ALERTS__SERVICES", '["T0KEN"')
    shown += repr(config_faults())
    assert "T0KEN" not in shown
    assert "hunter" not in shown


@pytest.mark.parametrize(
    ("variable", "meant"),
    [
        ("RSOCONSOLE_SITE__LATITUDE", LATITUDE),
        ("RSOCONSOLE_SITE_LATITUDE_DEG", LATITUDE),
        ("RSOCONSOLE_CONFIGS", "RSOCONSOLE_CONFIG"),
        ("RSOCONSOLE_QUUX", "config show"),
    ],
)
def test_a_variable_that_does_nothing_is_a_warning_with_the_one_meant(
    variable: str, meant: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(variable, "1")
    (line,) = environment_warnings()
    assert variable in line
    assert meant in line


def test_the_warning_is_on_stderr_and_the_command_does_its_work(file: Path) -> None:
    environ = {**os.environ, "RSOCONSOLE_SITE__LATITUD_DEG": "1", "RSOCONSOLE_SITE__NAME": "Hill"}
    done = subprocess.run(
        [sys.executable, "-c", "from rsoconsole.cli import main; main()", "config", "check"],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
        env=environ,
    )
    assert done.returncode == 0
    assert done.stderr.count("\n") == 1
    assert LATITUDE in done.stderr
    assert "is sound" in done.stdout


def test_every_variable_that_the_project_reads_is_known() -> None:
    texts = [
        path.read_text(encoding="utf-8")
        for folder in ("rsoconsole", "tests", "models")
        for path in (ROOT / folder).rglob("*.py")
    ]
    asked = r'environ(?:\.get\(|\[)\s*"(RSOCONSOLE_\w+)"'
    found = {name for text in texts for name in re.findall(asked, text)}
    assert found
    assert found <= {*OTHERS}


def test_what_is_written_to_the_file_is_not_what_the_environment_says(
    file: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    monkeypatch.setenv("RSOCONSOLE_CATALOGUE__SOURCES", "celestrak:visual")
    done = CliRunner().invoke(app, ["catalogue", "add", "celestrak:geo"])
    assert done.exit_code == 0, done.output
    assert load_config(environ={}).catalogue.sources == ("celestrak:geo",)
    assert "RSOCONSOLE_CATALOGUE__SOURCES is set and counts more" in done.stderr
