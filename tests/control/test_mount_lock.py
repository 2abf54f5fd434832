"""One engine a mount, and an engine that stays reachable when its runtime folder is emptied."""

import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

from rsoconsole.base import ControlError
from rsoconsole.config import IndiConfig, state_dir
from rsoconsole.control import (
    AskStatus,
    ControlClient,
    ControlServer,
    EngineLock,
    MountLock,
    Outcome,
    Request,
    engine_pid,
)
from rsoconsole.control.record_lock import running_engine_at, running_engines

INDI = IndiConfig(host="observatory", port=7624, mount="EQMod Mount")
SECOND = """
import sys; from pathlib import Path
from rsoconsole.config import IndiConfig
from rsoconsole.control import MountLock
with MountLock(IndiConfig(host=sys.argv[1], port=7624, mount=sys.argv[2]), Path(sys.argv[3])):
    print('held')
"""


@pytest.fixture(autouse=True)
def own_folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("STATE_HOME", "RUNTIME_DIR", "CACHE_HOME"):
        monkeypatch.setenv(f"XDG_{name}", str(tmp_path / name))


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "run" / "engine.sock"


def echo(request: Request) -> Outcome:
    return Outcome(ok=True, message=request.command.verb)


def second(mount: str, socket: Path, host: str = "observatory") -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", SECOND, host, mount, str(socket)],
        capture_output=True,
        text=True,
        check=False,
    )


def until(is_true, within_s: float = 5.0) -> None:
    deadline = time.monotonic() + within_s
    while not is_true():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def test_a_second_engine_on_one_mount_is_turned_away_and_told_where_the_first_is(path, tmp_path):
    elsewhere = tmp_path / "other.sock"
    with MountLock(INDI, path):
        done = second(INDI.mount, elsewhere)
        assert "held" not in done.stdout
        assert f"already drives EQMod Mount (process {os.getpid()})" in done.stderr
        assert f"rsoconsole console --socket {path}" in done.stderr
        assert second("Another Mount", elsewhere).stdout == "held\n"
        assert second(INDI.mount, elsewhere, host="second-dome").stdout == "held\n"
    assert second(INDI.mount, elsewhere).stdout == "held\n"
    assert not list((state_dir() / "mounts").iterdir())


def test_the_lock_of_an_engine_that_was_killed_holds_nobody_out(path):
    program = SECOND.replace("print('held')", "print('held', flush=True); sys.stdin.read()")
    with subprocess.Popen(
        [sys.executable, "-c", program, "observatory", INDI.mount, str(path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as first:
        assert first.stdout is not None
        assert first.stdout.readline() == "held\n"
        assert [(each.pid, each.socket) for each in running_engines()] == [(first.pid, path)]
        first.kill()
        first.wait(10)
    assert running_engines() == []
    with MountLock(INDI, path):
        assert running_engine_at(path) is not None


@pytest.mark.parametrize("what", ["the folder", "the socket", "the state folder"])
def test_whatever_is_removed_under_a_living_engine_comes_back(path, what):
    said: list[str] = []
    mount = MountLock(INDI, path)
    with mount, ControlServer(path, echo, locks=(mount,), on_found=said.append):
        assert ControlClient(path).send(AskStatus()).ok
        gone = {"the folder": path.parent, "the state folder": state_dir(), "the socket": path}[
            what
        ]
        if what == "the socket":
            gone.unlink()
        else:
            shutil.rmtree(gone)
        # At once: a client that asks meanwhile is not told that nobody is there.
        assert ControlClient(path).send(AskStatus()).ok
        until(lambda: bool(said))
        assert "removed" in said[0]
        assert engine_pid(path) == os.getpid()
        done = second(INDI.mount, path)
        assert "already drives" in done.stderr
        for _ in range(3):
            assert ControlClient(path).send(AskStatus()).ok
    assert len(said) == 1
    assert not path.exists()


def test_who_knows_nothing_of_the_lock_still_finds_the_engine_behind_an_emptied_folder(
    path, monkeypatch, tmp_path
):
    """Another login's state folder may be another one."""
    with ControlServer(path, echo):
        shutil.rmtree(path.parent)
        monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "another"))
        assert ControlClient(path).send(AskStatus()).ok


def test_a_consoles_connection_outlives_the_socket_it_came_by(path):
    """What is connected stays so: the name of a socket is only the way in."""
    with ControlServer(path, echo):
        for _ in range(3):
            path.unlink()
            until(path.exists)
            assert ControlClient(path).send(AskStatus()).ok


def test_where_none_listens_the_running_one_is_named(path, tmp_path):
    with pytest.raises(ControlError, match="no engine is running: 'rsoconsole engine' starts one"):
        ControlClient(path).send(AskStatus())
    with MountLock(INDI, tmp_path / "demo.sock"), pytest.raises(ControlError) as raised:
        ControlClient(path).send(AskStatus())
    assert f"process {os.getpid()} at {tmp_path / 'demo.sock'}" in str(raised.value)
    assert "--socket" in str(raised.value)


def test_a_lock_that_another_has_taken_meanwhile_is_said(path):
    mount = MountLock(INDI, path)
    with mount:
        shutil.rmtree(state_dir())
        program = SECOND.replace("print('held')", "print('held', flush=True); sys.stdin.read()")
        with subprocess.Popen(
            [sys.executable, "-c", program, "observatory", INDI.mount, "/elsewhere.sock"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        ) as other:
            assert other.stdout is not None
            assert other.stdout.readline() == "held\n"
            with pytest.raises(ControlError, match=f"process {other.pid}"):
                mount.keep()
            other.kill()


def test_a_lock_in_place_is_left_alone(path):
    with EngineLock(path) as lock:
        assert not lock.keep()
        path.parent.joinpath("engine.lock").unlink()
        assert lock.keep()
        assert not lock.keep()
