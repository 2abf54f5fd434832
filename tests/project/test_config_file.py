"""The configuration as a file: begun, shown with origins, checked."""

import os
import re
import tomllib
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rsoconsole.base import ConfigError
from rsoconsole.config import (
    Config,
    config_faults,
    config_to_toml,
    effective_settings,
    every_setting,
    load_config,
    runtime_dir,
    write_initial_config,
)
from rsoconsole.config.file import initial_config_text


@pytest.fixture(autouse=True)
def own_default_place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    place = tmp_path / "home" / "config.toml"
    monkeypatch.setenv("RSOCONSOLE_CONFIG", str(place))
    return place


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "observatory.toml"
    path.write_text(text, encoding="utf-8")
    return path


def uncommented(text: str) -> str:
    return re.sub(r"^# (\w+ = )", r"\1", text, flags=re.MULTILINE)


def test_the_first_file_names_every_setting_with_its_default() -> None:
    text = initial_config_text()
    assert tomllib.loads(text) == {section: {} for section in Config.model_fields}
    assert Config.model_validate(tomllib.loads(uncommented(text))) == Config()
    for name, value, description in every_setting(Config()):
        key = name.partition(".")[2]
        assert f"# {key} = " in text or (value is None and f"# {key} is not set" in text)
        assert description in text
    assert "confidence a detection must exceed; > 0, < 1" in text
    assert 'one of "fast", "paper"' in text


def test_the_first_file_is_never_written_over_another(own_default_place: Path) -> None:
    assert write_initial_config() == own_default_place
    own_default_place.write_text("[site]\nname = 'mine'\n")
    with pytest.raises(ConfigError, match="exists already: --force writes over it"):
        write_initial_config()
    assert "mine" in own_default_place.read_text()
    write_initial_config(force=True)
    assert load_config() == Config()


def test_a_place_that_cannot_be_written_is_an_error_in_words(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(ConfigError, match="cannot be written"):
        write_initial_config(tmp_path / "file" / "config.toml")


@settings(max_examples=50)
@given(
    name=st.text(),
    tau=st.floats(1e-300, 0.999),
    q=st.floats(1e-12, 1e3),
    declination_deg=st.none() | st.floats(-90, 90),
    dirs=st.lists(st.text("abc /\\\"'é\x7f\n", min_size=1).map(lambda s: f"/{s}"), max_size=3),
)
def test_an_effective_configuration_comes_back_from_its_toml(
    *,
    tmp_path_factory: pytest.TempPathFactory,
    name: str,
    tau: float,
    q: float,
    declination_deg: float | None,
    dirs: list[str],
) -> None:
    config = Config.model_validate(
        {
            "site": {"name": name},
            "detector": {"tau": tau, "model": "/a network.tflite"},
            "filter": {"q_arcsec2_s3": q},
            "search": {"declination_deg": declination_deg},
            "solver": {"index_dirs": dirs},
            "indi": {"simulated": True},
        }
    )
    path = tmp_path_factory.getbasetemp() / "round.toml"
    path.write_text(config_to_toml(config), encoding="utf-8")
    assert load_config(path) == config


def test_every_value_says_where_it_came_from(tmp_path: Path) -> None:
    path = written(tmp_path, "[detector]\ntau = 0.3\nthreads = 3\n[search]\npattern = 'belt'\n")
    rows = {row.name: row for row in effective_settings(path, {"detector.threads": 4})}
    assert list(rows) == [name for name, _, _ in every_setting(Config())]
    assert (rows["detector.tau"].value, rows["detector.tau"].origin) == (0.3, "file")
    assert (rows["detector.threads"].value, rows["detector.threads"].origin) == (4, "command line")
    # Set to the default, but by the operator.
    assert rows["search.pattern"].origin == "file"
    assert rows["site.name"].origin == "default"
    assert rows["detector.tau"].description == "confidence a detection must exceed"
    assert isinstance(rows["session.root"].value, str)


def test_without_a_file_everything_is_a_default() -> None:
    assert {row.origin for row in effective_settings()} == {"default"}
    assert config_faults() == ()


def test_every_fault_is_found_at_once_and_has_a_remedy(tmp_path: Path) -> None:
    path = written(
        tmp_path,
        "[detector]\ntau = 1.5\nmap_mode = 'slow'\n[optics]\nfocal_lenght_mm = 620\n[zzz]\na = 1\n"
        "[site]\nlatitude_deg = 'north'\nelevation_m = nan\n",
    )
    faults = {fault.name: fault for fault in config_faults(path, {"exposure.cadence_s": -1})}
    assert set(faults) == {
        "detector.tau",
        "detector.map_mode",
        "optics.focal_lenght_mm",
        "zzz",
        "site.latitude_deg",
        "site.elevation_m",
        "exposure.cadence_s",
    }
    assert faults["detector.tau"].remedy == "allowed: > 0, < 1; the default is 0.1"
    assert faults["detector.tau"].problem.startswith("1.5: ")
    assert '"fast", "paper"' in faults["detector.map_mode"].remedy
    assert faults["optics.focal_lenght_mm"].remedy == "did you mean optics.focal_length_mm?"
    assert "config show" in faults["zzz"].remedy
    assert all(fault.remedy for fault in faults.values())
    with pytest.raises(ConfigError) as error:
        load_config(path)
    for name in set(faults) - {"exposure.cadence_s"}:
        assert name in str(error.value)


def test_a_file_that_is_no_toml_says_in_which_line(tmp_path: Path) -> None:
    (fault,) = config_faults(written(tmp_path, "[site]\nname = \n"))
    assert "line 2" in fault.problem
    (fault,) = config_faults(tmp_path / "nothing.toml")
    assert "does not exist" in fault.problem


def test_a_section_that_is_no_table_is_a_fault_and_no_crash(tmp_path: Path) -> None:
    path = written(tmp_path, "detector = 3\n")
    (fault,) = config_faults(path, {"detector.tau": 0.2})
    assert fault.name == "detector"
    with pytest.raises(ConfigError, match="detector"):
        load_config(path, {"detector.tau": 0.2})
    with pytest.raises(ConfigError, match="detector"):
        effective_settings(path)


def test_values_that_contradict_each_other_are_faults(tmp_path: Path) -> None:
    path = written(
        tmp_path,
        f"[exposure]\nexposure_s = 20.0\ncadence_s = 10.0\n"
        f"[detector]\nmodel = '{tmp_path}/none.tflite'\n",
    )
    assert [fault.name for fault in config_faults(path)] == [
        "exposure.cadence_s",
        "detector.model",
    ]


def test_the_tilde_is_the_home_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    path = written(tmp_path, "[session]\nroot = '~/nights'\n[solver]\nindex_dirs = ['~/index']\n")
    config = load_config(path)
    assert config.session.root == tmp_path / "nights"
    assert config.solver.index_dirs == (tmp_path / "index",)


def test_targets_of_a_search_come_back_from_their_toml(tmp_path: Path) -> None:
    search = {
        "pattern": "targets",
        "targets": [
            {"name": 'a "slot"', "slot_longitude_deg": -89.0},
            {"name": "a place", "ra_icrs_deg": 10.0, "declination_deg": -5.0},
        ],
    }
    config = Config.model_validate({"search": search})
    path = tmp_path / "targets.toml"
    path.write_text(config_to_toml(config), encoding="utf-8")
    assert load_config(path) == config


def test_without_a_folder_for_the_socket_the_operator_hears_what_to_make(monkeypatch):
    for name in ("XDG_RUNTIME_DIR", "XDG_CACHE_HOME"):
        monkeypatch.setenv(name, "/proc/none")
    with pytest.raises(ConfigError, match="set XDG_RUNTIME_DIR to a folder of your own"):
        runtime_dir()


def test_a_folder_of_another_user_is_refused_for_root_as_well(tmp_path: Path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    folder = runtime_dir()
    assert folder.stat().st_mode & 0o777 == 0o700
    mine = os.geteuid()
    # For one who owns neither it is a stranger's; root meets that under "sudo -E".
    monkeypatch.setattr(os, "geteuid", lambda: mine + 1)
    with pytest.raises(ConfigError, match=r"belongs to another user .* run this as that user"):
        runtime_dir()


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a folder away")
def test_root_takes_no_place_that_another_user_could_swap(tmp_path: Path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    runtime_dir()
    os.chown(tmp_path, 12345, -1)
    with pytest.raises(ConfigError, match="belongs to another user \\(uid 12345\\)"):
        runtime_dir()
    os.chown(tmp_path, 0, -1)
    os.chown(tmp_path / "rsoconsole", 12345, -1)
    with pytest.raises(ConfigError, match="belongs to another user"):
        runtime_dir()


def test_a_link_in_place_of_the_folder_is_refused(tmp_path: Path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "rsoconsole").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(ConfigError, match="is no folder: remove it"):
        runtime_dir()


def test_check_names_the_file_that_it_read_or_says_that_there_is_none(tmp_path, monkeypatch):
    from typer.testing import CliRunner

    from rsoconsole.cli.app import app

    path = tmp_path / "config.toml"
    monkeypatch.setenv("RSOCONSOLE_CONFIG", str(path))
    none = CliRunner().invoke(app, ["config", "check"])
    assert none.exit_code == 0
    assert f"there is no configuration file: {path} does not exist" in none.output
    assert "Daytona Beach" in none.output
    path.write_text("[site]\nname = 'Hill'\n", encoding="utf-8")
    found = CliRunner().invoke(app, ["config", "check"])
    assert found.output == f"{path}: the configuration is sound\n"
