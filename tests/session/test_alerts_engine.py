"""A whole engine with alerts: services that fail change nothing for it, and its end is told."""

import json
import os
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from rsoconsole.session import SessionReader
from rsoconsole.simulator import start_observatory
from tests.children.bad_server import BadServer, bad_server
from tests.children.bad_server import send as answer
from tests.engine.test_engine_process import COMMAND, wait_for

STAGE = "tests.rigs.stub_stage:open_plain"


@pytest.fixture
def server() -> Iterator[BadServer]:
    with bad_server() as running:
        running.default = answer(b"{}")
        yield running


@pytest.fixture
def engine(tmp_path: Path, server: BadServer) -> Iterator[subprocess.Popen[str]]:
    good = server.url.replace("http://", "json://")
    services = f'services = ["json://ann:hunter2@127.0.0.1:9/", "{good}", "nosuch://x"]'
    with start_observatory("intelsat-14", 1, 5.0, stage=STAGE) as observatory:
        config = tmp_path / "config.toml"
        config.write_text(
            f"[indi]\nport = {observatory.port}\nsimulated = true\n"
            '[session]\nkeep_frames = "none"\n'
            f'[alerts]\n{services}\nheartbeat_url = "{server.url}/beat"\nheartbeat_s = 1\n'
        )
        run = tmp_path / "run"
        run.mkdir(mode=0o700)
        homes = {f"XDG_{name}_HOME": str(tmp_path / name) for name in ("DATA", "STATE", "CACHE")}
        process = subprocess.Popen(
            [*COMMAND, "engine", "--session", str(tmp_path / "session")],
            env={
                **os.environ,
                **homes,
                "XDG_RUNTIME_DIR": str(run),
                "RSOCONSOLE_CONFIG": str(config),
            },
            stderr=subprocess.PIPE,
            text=True,
        )
        assert process.stderr is not None
        assert "engine runs" in process.stderr.readline()
        yield process
        process.kill()
        process.wait()
        process.stderr.close()


def titles(server: BadServer) -> list[str]:
    return [json.loads(body)["title"] for body in server.bodies if body]


@pytest.mark.slow("a whole engine with alerts")
def test_its_safe_end_is_told_by_the_service_that_works_and_the_session_is_whole(
    engine: subprocess.Popen[str], server: BadServer, tmp_path: Path
) -> None:
    wait_for(lambda: "/beat" in server.asked)
    engine.send_signal(signal.SIGTERM)
    assert engine.wait(60) == 0
    wait_for(lambda: "rsoconsole Daytona Beach (simulated): done" in titles(server))
    about = SessionReader(tmp_path / "session").read_meta()
    assert about["is_closed"] is True
    told = json.dumps(about) + (tmp_path / "session" / "config.toml").read_text()
    logs = "".join(path.read_text() for path in (tmp_path / "STATE").rglob("*.log"))
    assert "hunter2" not in told + logs


@pytest.mark.nightly("kills a whole engine")
def test_an_engine_that_is_killed_is_told_and_its_heartbeat_stops(
    engine: subprocess.Popen[str], server: BadServer
) -> None:
    wait_for(lambda: "/beat" in server.asked)
    engine.kill()
    engine.wait()
    wait_for(lambda: any(title.endswith(": fault") for title in titles(server)), timeout_s=90.0)
    beats = server.asked.count("/beat")
    time.sleep(2.5)
    assert server.asked.count("/beat") == beats
