"""The doctor tells a machine that is ready from one that is not, and never falls ill itself."""

import contextlib
import json
import os
import pty
import socket
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from rsoconsole.config import Config
from rsoconsole.engine.doctor import doctor, doctor_system
from rsoconsole.engine.doctor.doctor_system import ClockReading, Terminal, terminal_colours
from rsoconsole.engine.machine.medium import disk_outlook
from rsoconsole.instruments import allowed_libraries, utc_now_ns
from rsoconsole.sky import iso_to_utc_ns

SITE_WORDS = b"""
<defNumberVector device="Telescope Simulator" name="GEOGRAPHIC_COORD" state="Ok">
<defNumber name="LAT">29.19</defNumber><defNumber name="LONG">278.95</defNumber>
<defNumber name="ELEV">10</defNumber></defNumberVector>
"""


SHORT = {"quiet_s": 0.3}


def config_with(**sections: dict[str, object]) -> Config:
    return Config.model_validate(sections)


@pytest.fixture
def indi_server() -> Iterator[int]:
    """A server that speaks of two devices, in two pieces, as drivers report one by one."""
    listener = socket.create_server(("127.0.0.1", 0))

    def serve() -> None:
        while True:
            try:
                peer, _ = listener.accept()
            except OSError:
                return
            with peer:
                peer.recv(1000)
                peer.sendall(b'<defTextVector device="Telescope Simulator" name="DRIVER_')
                peer.sendall(b"INFO\"/><defTextVector device='CCD Simulator'/>")
                peer.sendall(SITE_WORDS)
                peer.settimeout(10.0)
                with contextlib.suppress(OSError):
                    peer.recv(1000)  # a server does not hang up

    thread = threading.Thread(target=serve)
    thread.start()
    yield listener.getsockname()[1]
    listener.shutdown(socket.SHUT_RDWR)
    listener.close()
    thread.join(5)


def test_element_files_are_read_and_old_ones_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    belt = Path(doctor.__file__).parents[2] / "simulator" / "data" / "belt_20230622.tle"
    config = config_with(catalogue={"tle_files": [str(belt)]})
    assert "no element files" in doctor.check_catalogue(config_with()).detail
    monkeypatch.setattr(doctor, "utc_now_ns", lambda: iso_to_utc_ns("2023-06-24T00:00:00Z"))
    fresh = doctor.check_catalogue(config)
    assert (fresh.ok, fresh.remedy) == (True, "")
    objects = sum(line.startswith("1 ") for line in belt.read_text().splitlines())
    assert fresh.detail.startswith(f"{objects} objects, half of their elements younger than ")
    monkeypatch.setattr(doctor, "utc_now_ns", lambda: iso_to_utc_ns("2023-09-24T00:00:00Z"))
    stale = doctor.check_catalogue(config)
    assert stale.ok is None
    assert "fetch fresh ones" in stale.remedy
    (tmp_path / "half.tle").write_text(belt.read_text()[:100])
    broken = doctor.check_catalogue(
        config_with(catalogue={"tle_files": [str(tmp_path / "half.tle")]})
    )
    assert broken.ok is False
    assert "half.tle" in broken.detail


def test_every_check_reports_and_what_is_not_well_has_a_remedy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(doctor, "check_libraries", lambda _: 1 / 0)
    config = config_with(session={"root": str(tmp_path / "s")}, indi={"port": 9})
    found = list(doctor.run_checks(config))
    assert [check.check for check in found] == [
        "system",
        "python",
        "network",
        "camera",
        "calibration",
        "index files",
        "catalogue",
        "site",
        "INDI client",
        "INDI server",
        "mount site",
        "mount driver",
        "clock",
        "shutter",
        "time source",
        "temperature",
        "power",
        "disk",
        "recording medium",
        "sessions folder",
        "terminal",
    ]
    assert found[1].ok is None
    assert "ZeroDivisionError" in found[1].detail
    assert all(check.remedy for check in found if check.ok is False)
    assert not (tmp_path / "s").exists()


@pytest.mark.parametrize(
    ("optics", "exposure_s", "ok", "says"),
    [
        ({}, 10.0, True, "1.26 arcsec/px"),
        ({"focal_length_mm": 25.0}, 10.0, None, "calibrated for 0.3 to 10"),
        ({"focal_length_mm": 20000.0}, 10.0, False, "outside the 0.3 to 250"),
        ({}, 120.0, None, "made for 0.05 to 60 s"),
        ({}, 0.05, True, "0.05 s"),
        ({"width_px": 320, "height_px": 240}, 10.0, None, "smaller than 640 x 480"),
        ({"width_px": 9576, "height_px": 6388}, 60.0, True, "9576 x 6388"),
        ({"width_px": 14192, "height_px": 10640}, 10.0, None, "larger than the 9576 x 6388"),
    ],
)
def test_a_camera_beyond_what_is_calibrated_is_told(
    optics: dict[str, float], exposure_s: float, ok: bool | None, says: str
) -> None:
    exposure = {"exposure_s": exposure_s, "cadence_s": 200.0}
    check = doctor.check_camera(config_with(optics=optics, exposure=exposure))
    assert check.ok is ok
    assert says in check.detail
    assert bool(check.remedy) == (ok is not True)


def test_libraries_that_are_here_load() -> None:
    assert doctor.check_libraries(Config()).ok is True


def test_a_library_that_is_missing_or_crashes_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "crashing_library.py").write_text("import os\nos.abort()\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setattr(doctor, "_LIBRARIES", ("json", "no_such_library"))
    monkeypatch.setattr(doctor, "_LIBRARIES_OF_PROCESSES", ("crashing_library", "csv"))
    check = doctor.check_libraries(Config())
    assert check.ok is False
    assert "no_such_library: ModuleNotFoundError" in check.detail
    assert "crashing_library: it ends the process" in check.detail
    assert "csv: not tried" in check.detail
    assert "json:" not in check.detail


@pytest.mark.parametrize("setting", ["pyindi", "indipyclient"])
def test_the_library_that_speaks_indi_is_told_with_its_version(setting: str) -> None:
    (library,) = allowed_libraries(setting)
    if not library.is_installed:
        pytest.skip(f"{library.package} is not installed")
    check = doctor.doctor_indi.check_client(config_with(indi={"client": setting}))
    assert check.ok is True
    assert check.detail == f"{library.title} (indi.client is {setting})"


def test_a_library_of_indi_that_does_not_load_is_told_and_the_other_is_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "PyIndi.py").write_text("raise ImportError('libindiclient.so: no such file')\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    check = doctor.doctor_indi.check_client(config_with(indi={"client": "auto"}))
    assert check.ok is True
    assert check.detail.startswith("indipyclient ")
    assert "does not load: ImportError: libindiclient.so" in check.detail
    wanted = doctor.doctor_indi.check_client(config_with(indi={"client": "pyindi"}))
    assert wanted.ok is False
    assert "set indi.client to auto" in wanted.remedy
    (tmp_path / "indipyclient.py").write_text("import os\nos.abort()\n")
    neither = doctor.doctor_indi.check_client(config_with(indi={"client": "auto"}))
    assert neither.ok is False
    assert "it ends the process" in neither.detail
    assert "pip install indipyclient" in neither.remedy


def test_a_network_that_is_not_there_is_told(tmp_path: Path) -> None:
    check = doctor.check_network(config_with(detector={"model": str(tmp_path / "none.tflite")}))
    assert check.ok is False
    assert str(tmp_path / "none") in check.detail


def test_the_shipped_index_files_are_enough_for_the_papers_field() -> None:
    assert doctor.check_index_files(Config()).ok is True


def test_a_field_that_no_index_file_fits_is_told() -> None:
    tiny = config_with(optics={"focal_length_mm": 20000.0})
    assert doctor.check_index_files(tiny).ok is False


def test_an_indi_server_with_the_devices_is_well(indi_server: int) -> None:
    check = doctor.check_indi_server(config_with(indi={"port": indi_server}))
    assert check.ok is True, check.detail


def test_an_indi_server_without_the_camera_is_not(
    indi_server: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    check = doctor.check_indi_server(
        config_with(indi={"port": indi_server, "camera": "CCD"}, waits=SHORT)
    )
    assert check.ok is False
    assert "has no CCD" in check.detail
    assert "indi.camera" in check.remedy


def test_weather_and_dome_must_be_there_where_they_are_configured(
    indi_server: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = config_with(
        indi={"port": indi_server, "weather": "Vane", "dome": "CCD Simulator"}, waits=SHORT
    )
    check = doctor.check_indi_server(config)
    assert check.ok is False
    assert "has no Vane" in check.detail
    assert "indi.weather" in check.remedy
    assert "indi.dome" not in check.remedy


@pytest.mark.parametrize(
    ("latitude_deg", "ok", "says"),
    [
        (29.195, True, "0.6 km from"),  # 0.005 deg of latitude are 556 m
        (29.29, False, "11.1 km from"),
    ],
)
def test_the_mounts_site_is_held_against_the_configured_one(
    indi_server: int, latitude_deg: float, ok: bool, says: str
) -> None:
    site = {"latitude_deg": latitude_deg}
    check = doctor.check_mount_site(config_with(indi={"port": indi_server}, site=site))
    assert check.ok is ok, check.detail
    assert says in check.detail
    if not ok:
        assert "LAT=29.29;LONG=278.95;ELEV=10'" in check.remedy
        assert f"indi_setprop -p {indi_server} 'Telescope" in check.remedy


def test_a_mount_that_does_not_tell_its_site_is_no_failure(
    indi_server: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    mute = doctor.check_mount_site(
        config_with(indi={"port": indi_server, "mount": "CCD Simulator"}, waits=SHORT)
    )
    assert mute.ok is None
    assert "connected" in mute.detail
    with socket.create_server(("127.0.0.1", 0)) as unused:
        port = unused.getsockname()[1]
    assert doctor.check_mount_site(config_with(indi={"port": port})).ok is None


def test_no_indi_server_is_told_with_its_address() -> None:
    with socket.create_server(("127.0.0.1", 0)) as unused:
        port = unused.getsockname()[1]
    check = doctor.check_indi_server(config_with(indi={"port": port}))
    assert check.ok is False
    assert f"127.0.0.1:{port}" in check.detail


@pytest.mark.parametrize(
    ("reading", "ok", "says"),
    [
        (ClockReading(is_synchronised=None), None, "does not tell"),
        (ClockReading(is_synchronised=False), False, "not synchronised"),
        (
            ClockReading(is_synchronised=True, offset_s=-0.0021, max_error_s=0.035),
            True,
            "synchronised, offset -2.100 ms, error at most 35 ms",
        ),
    ],
)
def test_the_clock_is_judged_by_what_the_kernel_says(
    monkeypatch: pytest.MonkeyPatch, reading: ClockReading, ok: bool | None, says: str
) -> None:
    monkeypatch.setattr(doctor_system, "read_clock", lambda: reading)
    check = doctor.check_clock()
    assert check.ok is ok
    assert says in check.detail
    assert bool(check.remedy) == (ok is not True)


def test_the_kernels_clock_can_be_read_here() -> None:
    reading = doctor_system.read_clock()
    if reading.offset_s is not None:
        assert abs(reading.offset_s) < 1.0


def test_a_disk_too_small_for_the_night_is_told(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    config = config_with(session={"root": str(tmp_path / "not" / "yet")})
    monkeypatch.setattr(doctor_system, "free_bytes", lambda _: 5e9)
    check = doctor.check_disk(config)
    assert check.ok is False
    assert check.detail.startswith("5.0 GB free, ")
    assert "room for 0." in check.detail
    assert "session.root" in check.remedy


def test_a_disk_that_will_soon_be_full_is_told_while_there_is_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    night = disk_outlook(Config(), 0, utc_now_ns()).bytes_a_night
    monkeypatch.setattr(doctor_system, "free_bytes", lambda _: 2 * night)
    check = doctor.check_disk(Config())
    assert check.ok is True
    assert "room for 2.0 nights; soon: move or remove old sessions" in check.detail
    monkeypatch.setattr(doctor_system, "free_bytes", lambda _: 9 * night)
    assert doctor.check_disk(Config()).detail.endswith("room for 9.0 nights")


def test_the_papers_site_is_doubted_another_is_not() -> None:
    check = doctor.check_site(Config())
    assert check.ok is None
    assert "29.190 N 81.050 W, 10 m: still the default" in check.detail
    assert "site.latitude_deg" in check.remedy
    own = doctor.check_site(config_with(site={"latitude_deg": -33.5, "longitude_deg": 289.5}))
    assert (own.ok, own.detail) == (True, "33.500 S 70.500 W, 10 m")
    assert doctor.check_site(config_with(indi={"simulated": True})).ok is True


def test_a_sessions_folder_that_cannot_be_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    assert doctor_system.write_fault(tmp_path) is None
    assert doctor_system.write_fault(tmp_path / "a" / "b") is None
    assert "no folder" in str(doctor_system.write_fault(tmp_path / "file" / "a"))
    check = doctor.check_sessions_folder(config_with(session={"root": str(tmp_path / "file")}))
    assert check.ok is False
    assert list(tmp_path.iterdir()) == [tmp_path / "file"]


@pytest.mark.parametrize(
    ("terminal", "remedy"),
    [
        (Terminal(columns=80, rows=24, colours=256, is_utf8=True), ""),
        (Terminal(columns=79, rows=24, colours=256, is_utf8=True), "make it at least 80 x 24"),
        (Terminal(columns=80, rows=24, colours=256, is_utf8=False), "set LANG"),
        (Terminal(columns=80, rows=24, colours=2, is_utf8=True), "set TERM"),
    ],
)
def test_the_terminal_is_judged_by_size_colours_and_encoding(
    monkeypatch: pytest.MonkeyPatch, terminal: Terminal, remedy: str
) -> None:
    monkeypatch.setattr(doctor_system, "read_terminal", lambda: terminal)
    check = doctor.check_terminal()
    assert check.ok is (remedy == "")
    assert check.remedy.startswith(remedy)


def test_colours_are_what_the_terminal_says() -> None:
    assert terminal_colours({"TERM": "xterm", "COLORTERM": "truecolor"}) == 1 << 24
    assert terminal_colours({"TERM": "xterm-256color"}) == 256
    assert terminal_colours({"TERM": "linux"}) == 16
    assert (
        terminal_colours({"TERM": "dumb"})
        == terminal_colours({})
        == terminal_colours({"TERM": "vt100"})
        == 2
    )


def test_the_size_of_a_real_terminal_is_read(monkeypatch: pytest.MonkeyPatch) -> None:
    import fcntl
    import struct
    import termios

    leader, follower = pty.openpty()
    try:
        fcntl.ioctl(follower, termios.TIOCSWINSZ, struct.pack("HHHH", 30, 100, 0, 0))
        size_of = os.get_terminal_size
        monkeypatch.setattr(os, "get_terminal_size", lambda _: size_of(follower))
        found = doctor_system.read_terminal({"TERM": "xterm-256color"})
    finally:
        os.close(leader)
        os.close(follower)
    assert found is not None
    assert (found.columns, found.rows, found.colours) == (100, 30, 256)


def test_a_check_is_one_json_object() -> None:
    from dataclasses import asdict

    check = doctor.CheckResult(check="clock", ok=None, detail="unknown")
    assert json.loads(json.dumps(asdict(check))) == {
        "check": "clock",
        "ok": None,
        "detail": "unknown",
        "remedy": "",
    }
