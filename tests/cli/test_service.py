"""The service verb writes a unit that systemd takes, and that never moves a telescope unasked."""

import json
import os
import re
import shlex
import shutil
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import Result
from typer.testing import CliRunner

from rsoconsole.base import RsoconsoleError
from rsoconsole.cli.app import app
from rsoconsole.cli.telescope import service
from rsoconsole.engine.machine.machine import notify_systemd
from rsoconsole.session import SessionReader, verify_session
from rsoconsole.simulator import start_observatory

COMMAND = ("/opt/a b/bin/python", "-c", "run()", "engine", "--config", "/home/o/50% $x.toml")


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A user of its own with a configuration."""
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    for name in ("XDG_DATA_HOME", "XDG_STATE_HOME", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    config = tmp_path / "night.toml"
    config.write_text("[site]\nlatitude_deg = 47.0\n")
    monkeypatch.setenv("RSOCONSOLE_CONFIG", str(config))
    return tmp_path


@pytest.fixture
def systemctl(home: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A stand-in for systemctl that writes down what it was told and answers as a live one."""
    folder, told = home / "bin", home / "told"
    folder.mkdir()
    told.write_text("")
    program = folder / "systemctl"
    program.write_text(
        f'#!/bin/sh\necho "$@" >> {shlex.quote(str(told))}\n'
        'case "$2" in is-enabled) echo enabled;; is-active) echo active;; esac\n'
    )
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{folder}{os.pathsep}{os.environ['PATH']}")
    return told


def rsoconsole(*arguments: str) -> Result:
    return CliRunner().invoke(app, arguments)


def setting(unit: str, key: str) -> str:
    (value,) = [row.split("=", 1)[1] for row in unit.splitlines() if row.split("=", 1)[0] == key]
    return value


def test_the_unit_starts_this_installation_by_its_full_path_and_never_arms(home: Path) -> None:
    unit = rsoconsole("service", "show").stdout
    words = shlex.split(setting(unit, "ExecStart"))
    assert Path(words[0]).is_absolute()
    assert Path(words[0]).parent == Path(sys.executable).absolute().parent
    assert words[-3:] == ["engine", "--config", str(home / "night.toml")]
    assert "arm" not in [word.strip("-") for word in words]


def test_the_unit_is_a_safe_stop_a_restart_after_failure_and_no_boot_by_itself() -> None:
    unit = rsoconsole("service", "show").stdout
    assert setting(unit, "Type") == "notify"
    assert setting(unit, "Restart") == "on-failure"
    assert setting(unit, "KillSignal") == "SIGTERM"
    assert setting(unit, "KillMode") == "process"
    assert int(setting(unit, "TimeoutStopSec")) >= 60
    assert int(setting(unit, "WatchdogSec")) >= 60
    assert setting(unit, "WantedBy") == "default.target"
    assert not re.search("@[A-Z_]+@", unit)


def test_the_program_a_unit_names_really_starts(home: Path) -> None:
    words = shlex.split(setting(rsoconsole("service", "show").stdout, "ExecStart"))
    start = words[: words.index("engine")]
    done = subprocess.run([*start, "--version"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("rsoconsole ")


def test_odd_paths_reach_systemd_whole() -> None:
    unit = service.unit_text(COMMAND, {})
    assert setting(unit, "ExecStart") == (
        '"/opt/a b/bin/python" "-c" "run()" "engine" "--config" "/home/o/50%% $$x.toml"'
    )
    assert service._starts(unit) == "/opt/a b/bin/python"
    odd = ('/opt/"q" \\ 5%/python', "engine")
    assert service._starts(service.unit_text(odd, {})) == odd[0]
    with pytest.raises(RsoconsoleError, match="control character"):
        service.unit_text(("/opt/new\nline",), {})


def test_moved_default_places_are_the_services_too() -> None:
    unit = service.unit_text(COMMAND, {"XDG_DATA_HOME": "/big disk/100%", "HOME": "/home/o"})
    assert 'Environment="XDG_DATA_HOME=/big disk/100%%"' in unit.splitlines()
    assert "HOME=/home/o" not in unit


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="needs systemd-analyze")
def test_systemd_finds_nothing_wrong_with_the_unit(home: Path) -> None:
    def verdict(unit: str) -> str:
        path = home / service.UNIT
        path.write_text(unit)
        done = subprocess.run(
            ["systemd-analyze", "--user", "verify", str(path)],
            env={**os.environ, "XDG_RUNTIME_DIR": str(home)},
            capture_output=True,
            text=True,
            check=False,
        )
        return f"{done.stderr}{done.stdout}" + ("" if done.returncode == 0 else "failed")

    for is_in_namespace in (False, True):
        real = (sys.executable, "engine")
        assert verdict(service.unit_text(real, {}, is_in_namespace=is_in_namespace)) == ""
    unit = rsoconsole("service", "show").stdout
    assert verdict(unit) == ""
    assert "Unknown key" in verdict(unit.replace("KillMode=", "KilMode="))
    odd = (sys.executable, *COMMAND[1:])
    assert verdict(service.unit_text(odd, {"XDG_DATA_HOME": "/big disk/100%"})) == ""


def exposure(unit: str, home: Path, *words: str) -> float:
    """What ``systemd-analyze security`` makes of a unit, 0 to 10."""
    path = home / service.UNIT
    path.write_text(unit)
    done = subprocess.run(
        ["systemd-analyze", *words, "security", "--offline=true", "--no-pager", str(path)],
        env={**os.environ, "XDG_RUNTIME_DIR": str(home), "LC_ALL": "C.UTF-8"},
        capture_output=True,
        text=True,
        check=False,
    )
    found = re.search(r"Overall exposure level for \S+: ([0-9.]+)", done.stdout)
    assert found is not None, done.stderr
    return float(found.group(1))


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="needs systemd-analyze")
@pytest.mark.parametrize("words", [(), ("--user",)])
def test_what_the_service_may_do_is_little(home: Path, words: tuple[str, ...]) -> None:
    whole = service.unit_text(COMMAND, {})
    assert exposure(whole, home, *words) < 4.0
    alone = service.unit_text(COMMAND, {}, is_in_namespace=False)
    assert exposure(alone, home, *words) < 7.0
    bare = "\n".join(row for row in alone.splitlines() if not row.startswith(RESTRICTING))
    assert exposure(bare, home, *words) > 9.0


RESTRICTING = ("NoNew", "Lock", "Restrict", "SystemCall")


def test_the_service_keeps_what_the_engine_needs() -> None:
    unit = service.unit_text(COMMAND, {})
    families = setting(unit, "RestrictAddressFamilies").split()
    assert {"AF_UNIX", "AF_INET", "AF_INET6"} <= set(families)
    assert setting(unit, "ProtectSystem") == "full"  # /etc, /usr and /boot; disks stay writable
    keys = {row.partition("=")[0] for row in unit.splitlines()}
    hindering = {
        "DeviceAllow",
        "DevicePolicy",
        "IPAddressDeny",
        "InaccessiblePaths",
        "MemoryDenyWriteExecute",
        "PrivateDevices",
        "PrivateIPC",
        "PrivateNetwork",
        "PrivateTmp",
        "ProtectHome",
        "ReadOnlyPaths",
        "TemporaryFileSystem",
        "UMask",
    }
    assert not keys & hindering


JAIL = Path(__file__).parents[1] / "children" / "jail.py"
SYSTEM_PYTHON = "/usr/bin/python3"


def has_jail() -> bool:
    if shutil.which("systemd-analyze") is None or not Path(SYSTEM_PYTHON).exists():
        return False
    command = [SYSTEM_PYTHON, "-c", "import seccomp"]
    return subprocess.run(command, capture_output=True, check=False).returncode == 0


@pytest.mark.nightly("a whole night, jailed")
@pytest.mark.skipif(not has_jail(), reason="needs systemd-analyze and python3-seccomp")
def test_a_night_goes_well_with_the_system_calls_of_the_service_alone(home: Path) -> None:
    unit = service.unit_text(COMMAND, {})
    filters = [row.partition("=")[2] for row in unit.splitlines() if "SystemCallFilter=" in row]

    def jailed(*command: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [SYSTEM_PYTHON, str(JAIL), *filters, "--", *command],
            env={**os.environ, "XDG_RUNTIME_DIR": str(home), "XDG_DATA_HOME": str(home / "data")},
            capture_output=True,
            text=True,
            check=False,
        )

    # That the filter holds at all: no mount, no other clock.
    assert "not permitted" in jailed("date", "-s", "2020-01-01").stderr
    start = [sys.executable, "-c", "from rsoconsole.cli import main; main()", "demo"]
    done = jailed(*start, "--headless", "--frames", "2", "--keep-frames", "all", "--json")
    assert done.returncode == 0, done.stderr
    *_, figures = [json.loads(line) for line in done.stdout.splitlines()]
    session = SessionReader(Path(figures["session"]))
    assert session.counts().frames == 2
    assert verify_session(session.folder).is_sound


@pytest.mark.parametrize(("status", "words"), [(0, ""), (217, "no user namespace"), (1, "again")])
def test_what_needs_a_user_namespace_is_tried_before_it_is_written(
    home: Path, systemctl: Path, status: int, words: str
) -> None:
    trial, changes = systemctl.parent / "bin" / "systemd-run", home / "tried"
    trial.write_text(
        f'#!/bin/sh\nprintf "%s\\n" "$@" > {shlex.quote(str(changes))}\nexit {status}\n'
    )
    trial.chmod(0o755)
    done = rsoconsole("service", "install")
    assert done.exit_code == 0, done.output
    unit = (home / "config" / "systemd" / "user" / "rsoconsole.service").read_text()
    asked = changes.read_text().splitlines()
    for line in service.namespace_lines():
        assert f"--property={line}" in asked
        assert (line in unit.splitlines()) is (status == 0)
    assert "NoNewPrivileges=yes" in unit.splitlines()
    assert words in done.output
    assert ("PrivateUsers" in done.output) is (status != 0)


def test_install_writes_the_unit_and_starts_nothing(home: Path, systemctl: Path) -> None:
    done = rsoconsole("service", "install")
    assert done.exit_code == 0, done.output
    path = home / "config" / "systemd" / "user" / "rsoconsole.service"
    assert path.read_text() == rsoconsole("service", "show").stdout
    told = systemctl.read_text().splitlines()
    assert told == ["--user daemon-reload", "--user is-active rsoconsole.service"]
    assert "it runs still as it was" in done.stdout
    for words in ("loginctl enable-linger", "journalctl --user -u rsoconsole", "rsoconsole arm"):
        assert words in done.stdout


def test_install_again_writes_the_unit_again_but_never_over_anothers(
    home: Path, systemctl: Path
) -> None:
    path = home / "config" / "systemd" / "user" / "rsoconsole.service"
    path.parent.mkdir(parents=True)
    path.write_text("[Service]\nExecStart=/bin/mine\n")
    refused = rsoconsole("service", "install")
    assert isinstance(refused.exception, RsoconsoleError)
    assert "not written by rsoconsole" in str(refused.exception)
    refused = rsoconsole("service", "remove")
    assert isinstance(refused.exception, RsoconsoleError)
    assert "/bin/mine" in path.read_text()
    path.write_text(service.MARK + "\n")
    assert rsoconsole("service", "install").exit_code == 0
    assert "ExecStart" in path.read_text()


def test_a_simulated_observatory_is_no_service(home: Path, systemctl: Path) -> None:
    (home / "night.toml").write_text("[indi]\nsimulated = true\n")
    refused = rsoconsole("service", "install")
    assert "rsoconsole demo" in str(refused.exception)
    assert not (home / "config").exists()


def test_remove_stops_disables_and_removes(home: Path, systemctl: Path) -> None:
    rsoconsole("service", "install")
    systemctl.write_text("")
    done = rsoconsole("service", "remove")
    assert done.exit_code == 0, done.output
    assert not (home / "config" / "systemd" / "user" / "rsoconsole.service").exists()
    assert systemctl.read_text().splitlines() == [
        "--user disable --now rsoconsole.service",
        "--user daemon-reload",
    ]
    assert "nothing to remove" in rsoconsole("service", "remove").stdout


def test_status_tells_what_systemd_says(
    home: Path, systemctl: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(service, "LINGER", home)
    assert json.loads(rsoconsole("service", "status", "--json").stdout)["installed"] is False
    rsoconsole("service", "install")
    row = json.loads(rsoconsole("service", "status", "--json").stdout)
    assert row["installed"]
    assert row["program_exists"]
    assert (row["enabled"], row["active"], row["lingers"]) == ("enabled", "active", False)
    assert "enable-linger" in rsoconsole("service", "status").stdout
    path = Path(row["unit"])
    path.write_text(path.read_text().replace(row["program"], "/gone/python"))
    assert "its program is gone" in rsoconsole("service", "status").stdout


def test_a_machine_without_systemd_is_told_in_words(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(home))
    refused = rsoconsole("service", "install")
    assert isinstance(refused.exception, RsoconsoleError)
    assert "no systemd" in str(refused.exception)
    assert not (home / "config").exists()
    assert "no systemd" in rsoconsole("service", "status").stdout
    row = json.loads(rsoconsole("service", "status", "--json").stdout)
    assert (row["systemd"], row["active"]) == (False, None)
    assert "ExecStart" in rsoconsole("service", "show").stdout


def test_a_service_manager_that_does_not_run_is_told(
    home: Path, systemctl: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = home / "bin" / "systemctl"
    program.write_text("#!/bin/sh\necho 'Failed to connect to bus' >&2\nexit 1\n")
    done = rsoconsole("service", "install")
    assert done.exit_code == 0, done.output
    assert "Failed to connect to bus" in done.stdout
    assert "next login" in done.stdout


# ---- what the service hears from the engine ---------------------------------------------------


def test_without_a_service_manager_nothing_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NOTIFY_SOCKET", raising=False)
    assert not notify_systemd("READY=1")
    monkeypatch.setenv("NOTIFY_SOCKET", "relative")
    assert not notify_systemd("READY=1")
    monkeypatch.setenv("NOTIFY_SOCKET", "/nobody/listens")
    assert not notify_systemd("READY=1")


@pytest.mark.parametrize("kind", ["file", "name"])
def test_a_word_reaches_the_service_manager(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    if kind == "name" and sys.platform != "linux":
        pytest.skip("only Linux has sockets without a file")
    name = f"rsoconsole-test-{os.getpid()}"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / "n") if kind == "file" else f"\0{name}")
        manager.settimeout(10.0)
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "n") if kind == "file" else f"@{name}")
        assert notify_systemd("READY=1")
        assert manager.recv(100) == b"READY=1"


def test_the_engine_says_that_it_is_ready_that_it_watches_and_that_it_ends(tmp_path: Path) -> None:
    run = tmp_path / "run"
    run.mkdir(mode=0o700)
    config = tmp_path / "config.toml"
    with (
        socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager,
        start_observatory("empty", 1, 50.0) as observatory,
    ):
        manager.bind(str(tmp_path / "notify"))
        manager.settimeout(60.0)
        config.write_text(f"[indi]\nport = {observatory.port}\nsimulated = true\n")
        homes = {f"XDG_{name}_HOME": str(tmp_path / name) for name in ("DATA", "STATE", "CACHE")}
        heard: list[bytes] = []

        def wait_for(word: bytes) -> None:
            while word not in heard:
                heard.append(manager.recv(1000))

        engine = subprocess.Popen(
            [*service.exec_start_command(config)],
            env={
                **os.environ,
                **homes,
                "XDG_RUNTIME_DIR": str(run),
                "NOTIFY_SOCKET": str(tmp_path / "notify"),
            },
            stderr=subprocess.PIPE,
        )
        try:
            wait_for(b"READY=1")
            wait_for(b"WATCHDOG=1")
            engine.send_signal(signal.SIGTERM)
            wait_for(b"STOPPING=1")
            assert engine.wait(60) == 0
        finally:
            engine.kill()
            engine.communicate()
        assert heard[0] == b"READY=1"
        assert {word for word in heard if not word.startswith(b"STATUS=")} == {
            *(b"READY=1", b"WATCHDOG=1", b"STOPPING=1")
        }, "only the engine speaks, no program that it runs"
