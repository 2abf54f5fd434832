"""Which library speaks INDI, and what is said where the chosen one is missing."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from rsoconsole.base import ConfigError, InstrumentError
from rsoconsole.config import Config
from rsoconsole.instruments import client_library, connect_instruments
from rsoconsole.instruments.indi.client_choice import LIBRARIES
from rsoconsole.simulator import start_observatory
from tests.rigs.stub_stage import T_START_UTC_NS

OPEN = """
import json, sys
from rsoconsole.base import InstrumentError
from rsoconsole.instruments.indi.client_choice import open_client
try:
    print(json.dumps(open_client(sys.argv[1], "Mount", print)[1].name))
except InstrumentError as error:
    print(json.dumps(str(error)))
"""


def opened(setting: str, folder: Path, *missing: str) -> str:
    """The library's name, or the words, where some do not load."""
    for module in missing:
        (folder / f"{module}.py").write_text(f"raise ImportError('no {module} here')\n")
    done = subprocess.run(
        [sys.executable, "-c", OPEN, setting],
        capture_output=True,
        text=True,
        check=True,
        env={"PYTHONPATH": str(folder)},
    )
    return str(json.loads(done.stdout.splitlines()[-1]))


def test_the_owner_s_choice_wins_where_it_loads(tmp_path: Path) -> None:
    assert [each.name for each in LIBRARIES] == ["pyindi", "indipyclient"]
    if not LIBRARIES[0].is_installed:
        pytest.skip("pyindi-client is not installed")
    assert opened("auto", tmp_path) == "pyindi"
    assert opened("indipyclient", tmp_path) == "indipyclient"
    assert client_library("auto").name == "pyindi"


def test_without_it_the_other_one_speaks(tmp_path: Path) -> None:
    assert opened("auto", tmp_path, "PyIndi") == "indipyclient"


@pytest.mark.parametrize(
    ("setting", "missing", "words"),
    [
        ("pyindi", ("PyIndi",), ("pip install --no-deps pyindi-client", "no PyIndi here")),
        (
            "indipyclient",
            ("indipyclient",),
            ("pip install indipyclient", "set indi.client to auto"),
        ),
        ("auto", ("PyIndi", "indipyclient"), ("no INDI client", "pip install indipyclient")),
    ],
)
def test_a_chosen_one_that_is_missing_is_a_clear_sentence(
    tmp_path: Path, setting: str, missing: tuple[str, ...], words: tuple[str, ...]
) -> None:
    said = opened(setting, tmp_path, *missing)
    assert "\n" not in said
    assert all(each in said for each in words), said


def test_a_missing_one_stops_the_engine_s_start_with_that_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "PyIndi.py").write_text("raise ImportError('no PyIndi here')\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    config = Config.model_validate({"indi": {"client": "pyindi"}})
    with (
        pytest.raises(InstrumentError, match=r"indi\.client is 'pyindi'"),
        connect_instruments(config, log_dir=tmp_path),
    ):
        pass


def test_a_client_that_nobody_knows_is_refused_with_the_choice(tmp_path: Path) -> None:
    from rsoconsole.config import load_config

    path = tmp_path / "config.toml"
    path.write_text('[indi]\nclient = "kstars"\n')
    with pytest.raises(ConfigError, match=r"indi\.client.*'auto', 'pyindi' or 'indipyclient'"):
        load_config(path)


def test_the_log_names_the_library_of_each_process(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with start_observatory("plain", 1, 0, stage="tests.rigs.stub_stage:open_plain") as observatory:
        indi = {"port": observatory.port, "simulated": True, "client": "indipyclient"}
        optics = {"width_px": 256, "height_px": 192}
        config = Config.model_validate({"indi": indi, "optics": optics})
        with (
            caplog.at_level("INFO"),
            connect_instruments(config, log_dir=tmp_path) as instruments,
        ):
            assert instruments.clock.now_utc_ns() >= T_START_UTC_NS
    title = client_library("indipyclient").title
    assert f"the mount speaks INDI by {title}" in caplog.text
    assert f"the camera speaks INDI by {title}" in caplog.text
