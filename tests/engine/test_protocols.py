"""Mounts and cameras by packages that are installed beside the program."""

import sys
from pathlib import Path

import pytest

from rsoconsole.base import InstrumentError
from rsoconsole.config import Config
from rsoconsole.engine.doctor.doctor import check_indi_server, check_mount_site
from rsoconsole.instruments import (
    CameraPort,
    MountPort,
    ProtocolContext,
    connect_instruments,
)

MODULE = """
class Device:
    def __init__(self, connection):
        self.options, self.calls = connection.config.instruments.options, []
        self.context = connection
    def start(self):
        self.calls.append("start")
    def close(self):
        self.calls.append("close")
"""
ENTRY_POINTS = """
[rsoconsole.mounts]
alpaca = alpaca_for_test:Device
broken = alpaca_for_test:Nothing
[rsoconsole.cameras]
alpaca = alpaca_for_test:Device
"""


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Installed, as pip leaves one."""
    (tmp_path / "alpaca_for_test.py").write_text(MODULE)
    about = tmp_path / "alpaca_for_test-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: alpaca-for-test\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text(ENTRY_POINTS)
    monkeypatch.syspath_prepend(str(tmp_path))
    yield
    sys.modules.pop("alpaca_for_test", None)


def configured(mount: str, camera: str) -> Config:
    table = {"mount": mount, "camera": camera, "options": {"address": "10.0.0.9:11111"}}
    return Config.model_validate({"instruments": table, "indi": {"port": 1}})


@pytest.mark.usefixtures("package")
def test_an_installed_package_brings_mount_and_camera(tmp_path: Path) -> None:
    config = configured("alpaca", "alpaca")
    with connect_instruments(config, log_dir=tmp_path) as instruments:
        devices: tuple[MountPort | CameraPort, ...] = (instruments.mount, instruments.camera)
        for device in devices:
            assert isinstance(device.context, ProtocolContext)
            assert device.calls == ["start"]
            assert device.options == {"address": "10.0.0.9:11111"}
    assert (instruments.mount_name, instruments.camera_name) == ("alpaca", "alpaca")
    assert instruments.mount.calls == instruments.camera.calls == ["start", "close"]


@pytest.mark.usefixtures("package")
def test_the_doctor_asks_no_indi_server_for_them() -> None:
    found = check_indi_server(configured("alpaca", "alpaca"))
    assert found.ok
    assert "not used" in found.detail
    assert check_mount_site(configured("alpaca", "indi")).ok is None


@pytest.mark.usefixtures("package")
@pytest.mark.parametrize(
    ("mount", "camera", "words"),
    [
        (
            "nexstar",
            "alpaca",
            "'nexstar' is installed (there is: alpaca, broken, indi)",
        ),
        ("alpaca", "qhy", "'qhy' is installed (there is: alpaca, indi)"),
        ("broken", "alpaca", "cannot be loaded"),
    ],
)
def test_one_that_is_not_there_is_named(mount: str, camera: str, words: str) -> None:
    config = configured(mount, camera)
    with pytest.raises(InstrumentError) as refused, connect_instruments(config):
        pass
    assert words in str(refused.value)
    found = check_indi_server(config)
    assert found.ok is False
    assert words in found.detail
