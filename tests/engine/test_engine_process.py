"""The engine as a process of its own: status, STOP and a safe end, against the simulated sky."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from rsoconsole.control import AskStatus, ControlClient, Sender
from rsoconsole.instruments.indi.wire_stop import stop_mount
from rsoconsole.session import SessionReader
from rsoconsole.simulator import start_observatory
from rsoconsole.simulator.launch import Observatory
from tests.rigs.whole_engine import OVERRIDES

STAGE = "tests.rigs.stub_stage:open_plain"
LIFTED = [word for name in OVERRIDES for word in ("--override", name)]
"""Its frames show no sky."""
pytestmark = pytest.mark.slow("starts a whole engine")
COMMAND = [sys.executable, "-c", "from rsoconsole.cli import main; main()"]


@pytest.fixture(scope="module")
def observatory() -> Iterator[Observatory]:
    """For one engine after another."""
    with start_observatory("intelsat-14", 1, 10.0, stage=STAGE) as running:
        yield running


@pytest.fixture
def environment(tmp_path: Path, observatory: Observatory) -> dict[str, str]:
    """A user of its own: configuration, data, socket and log under one folder."""
    config = tmp_path / "config.toml"
    config.write_text(
        f'[indi]\nport = {observatory.port}\nsimulated = true\n[session]\nkeep_frames = "none"\n'
    )
    homes = {f"XDG_{name}_HOME": str(tmp_path / name) for name in ("DATA", "STATE", "CACHE")}
    run = tmp_path / "run"
    run.mkdir(mode=0o700)
    return {
        **os.environ,
        **homes,
        "XDG_RUNTIME_DIR": str(run),
        "RSOCONSOLE_CONFIG": str(config),
    }


@pytest.fixture
def engine(tmp_path: Path, environment: dict[str, str]) -> Iterator[subprocess.Popen[str]]:
    process = subprocess.Popen(
        [*COMMAND, "engine", "--arm", *LIFTED, "--session", str(tmp_path / "session")],
        env=environment,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stderr is not None
    assert "engine runs" in process.stderr.readline()
    yield process
    process.kill()
    process.wait()
    process.stderr.close()


def verb(environment: dict[str, str], *arguments: str, status: int = 0) -> dict:
    run = subprocess.run(
        [*COMMAND, *arguments, "--json"],
        env=environment,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert run.returncode == status, run.stderr
    return json.loads(run.stdout)


def status(environment: dict[str, str]) -> dict[str, Any]:
    """As ``verb`` has it, without a process for each question."""
    socket = Path(environment["XDG_RUNTIME_DIR"]) / "rsoconsole" / "engine.sock"
    return dict(ControlClient(socket, sender=Sender(name="test")).send(AskStatus()).data)


def wait_for(condition, timeout_s: float = 60.0, every_s: float = 0.2) -> None:
    ends = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < ends, "it never came true"
        time.sleep(every_s)


def test_it_answers_stops_at_once_and_ends_safely(engine, environment, tmp_path, observatory):
    wait_for(lambda: status(environment)["frame"] >= 1)
    assert verb(environment, "status")["holder"] == "autonomy"
    stopped = verb(environment, "stop")
    assert (stopped["stopped"], stopped["motion"]) == (True, "tracks")
    assert stopped["answered_ms"] < 2000
    wait_for(lambda: status(environment)["state"] == "IDLE")
    engine.send_signal(signal.SIGTERM)
    assert engine.wait(30) == 0
    assert SessionReader(tmp_path / "session").read_meta()["is_closed"] is True
    assert stop_mount(
        observatory.host, observatory.port, observatory.mount_name, measures=False
    ).is_answered


@pytest.mark.nightly("starts a whole engine")
def test_stop_works_when_the_engine_was_killed(engine, environment):
    engine.kill()
    engine.wait()
    answer = verb(environment, "stop", status=4)
    # Nobody is left to let the simulated sky's time pass, in which motion could be measured.
    assert (answer["motion"], answer["path"]) == ("unknown", "indi")
    assert answer["answered_ms"] < 2000


@pytest.mark.nightly("starts a whole engine")
def test_a_second_engine_is_refused_with_words(engine, environment, tmp_path):
    run = subprocess.run(
        [*COMMAND, "engine", "--session", str(tmp_path / "other")],
        env=environment,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert run.returncode == 1
    assert "already" in run.stderr
    assert "Traceback" not in run.stderr


@pytest.mark.nightly("starts a whole engine")
def test_sigterm_again_and_again_is_one_safe_end(engine, environment, tmp_path, observatory):
    wait_for(lambda: status(environment)["frame"] >= 1)
    session = tmp_path / "session"
    engine.send_signal(signal.SIGTERM)
    # Again while it takes itself apart: the socket goes first, the session's end comes after.
    wait_for(lambda: not list((tmp_path / "run").rglob("engine.sock")), every_s=0.001)
    for number in (signal.SIGTERM, signal.SIGINT):
        engine.send_signal(number)
    assert engine.wait(30) == 0
    reader = SessionReader(session)
    assert reader.read_meta()["is_closed"] is True
    assert [row["after"] for row in reader.view_rows("states")][-1] == "IDLE"
    assert stop_mount(
        observatory.host, observatory.port, observatory.mount_name, measures=False
    ).is_answered


@pytest.mark.nightly("starts a whole engine")
def test_a_lost_terminal_is_nothing_to_the_engine(engine, environment):
    engine.send_signal(signal.SIGHUP)
    frames = status(environment)["frame"]
    wait_for(lambda: status(environment)["frame"] > frames)
    assert engine.poll() is None
