"""The verbs for a running telescope, over a real socket to a stand-in for the engine."""

import contextlib
import dataclasses
import json
import os
import subprocess
import sys
import threading
import time
import types
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest
from click.testing import Result
from typer.testing import CliRunner

from rsoconsole.base import ControlError
from rsoconsole.cli.app import app
from rsoconsole.cli.demo.demo import demo_config
from rsoconsole.cli.demo.demo_night import SimulatedNight, demo_socket, run_night
from rsoconsole.config import Config, SessionConfig
from rsoconsole.control import ControlServer, EngineLock, Outcome, Request, default_socket_path
from rsoconsole.control.stop import LATE_S
from rsoconsole.instruments import StopResult
from rsoconsole.instruments.motion import Motion
from rsoconsole.session import SessionWriter
from tests.rigs.stub_stage import SITE

UNMEASURED = {"is_answered": True, "path": "mount", "ms": 12.5, "detail": "", "number": 1}
STOPPED = {**UNMEASURED, "motion": "tracks"}


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A user of its own, whose configuration does not exist yet; the path is the file's."""
    run = tmp_path / "run"
    run.mkdir(mode=0o700)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(run))
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    config = tmp_path / "config.toml"
    monkeypatch.setenv("RSOCONSOLE_CONFIG", str(config))
    return config


@contextlib.contextmanager
def engine_that(handle: Callable[[Request], Outcome]) -> Iterator[list[Request]]:
    """What came to an engine that does as ``handle`` says."""
    heard: list[Request] = []

    def receive(request: Request) -> Outcome:
        heard.append(request)
        return handle(request)

    with ControlServer(default_socket_path(), receive):
        yield heard


def rsoconsole(*arguments: str) -> Result:
    return CliRunner().invoke(app, arguments)


# ---- commands ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("words", "verb", "arguments"),
    [
        (["arm"], "arm", {}),
        (["arm", "--override", "disk"], "arm", {"override": ["disk"]}),
        (["disarm"], "disarm", {}),
        (["quit"], "shutdown", {}),
        (["hold"], "hold", {}),
        (["resume"], "resume", {}),
        (["keep", "3"], "keep", {"track": 3}),
        (["drop", "3"], "drop", {"track": 3}),
        (["park"], "park", {}),
        (["unpark"], "unpark", {}),
        (["set", "detector.tau", "0.25"], "set", {"name": "detector.tau", "value": 0.25}),
        (
            ["set", "filter.q_arcsec2_s3", "1e-5"],
            "set",
            {"name": "filter.q_arcsec2_s3", "value": 1e-5},
        ),
        (["set", "filter.preset", "paper"], "set", {"name": "filter.preset", "value": "paper"}),
        (["set", "filter.gate_nis", "nan"], "set", {"name": "filter.gate_nis", "value": "nan"}),
    ],
)
def test_a_command_reaches_the_engine_and_its_answer_the_operator(words, verb, arguments):
    with engine_that(lambda _: Outcome(ok=True, message="from the next cycle")) as heard:
        run = rsoconsole(*words)
        as_json = rsoconsole(*words, "--json")
    assert (run.exit_code, run.output) == (0, "from the next cycle\n")
    assert [(each.command.verb, each.command.arguments()) for each in heard] == [
        (verb, arguments)
    ] * 2
    assert json.loads(as_json.stdout) == {
        "schema": 1,
        "verb": words[0],
        "ok": True,
        "message": "from the next cycle",
    }


@pytest.mark.parametrize("words", [["arm"], ["disarm"], ["set", "detector.tau", "1"], ["quit"]])
def test_a_refusal_is_a_failure_with_the_engine_s_words(words):
    with engine_that(lambda _: Outcome(ok=False, message="not tonight")):
        run = rsoconsole(*words, "--json")
    assert run.exit_code == 1
    assert isinstance(run.exception, ControlError)
    assert str(run.exception) == "not tonight"
    assert json.loads(run.stdout)["ok"] is False


def test_a_refusal_is_one_line_on_stderr_and_exit_1_in_a_shell(home):
    with engine_that(lambda _: Outcome(ok=False, message="not tonight")):
        run = subprocess.run(
            [sys.executable, "-c", "from rsoconsole.cli import main; main()", "arm"],
            env=os.environ.copy(),
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )
    assert (run.returncode, run.stdout, run.stderr) == (1, "", "rsoconsole: not tonight\n")


STATUS = {
    "state": "TRACK",
    "holder": "autonomy",
    "frame": 24,
    "is_held": False,
    "faults": [],
    **dict.fromkeys(("ra", "dec", "alt", "az")),
}


@pytest.mark.parametrize(
    ("machine", "said"),
    [
        (None, ""),
        ({"cpu_temperature_c": None, "troubles": []}, ""),
        ({"cpu_temperature_c": 51.6, "troubles": []}, " · CPU 52 °C"),
        (
            {"cpu_temperature_c": 83.9, "troubles": ["under-voltage: the supply", "hot: 84 °C"]},
            " · CPU 84 °C · MACHINE under-voltage: the supply · MACHINE hot: 84 °C",
        ),
    ],
)
def test_status_tells_the_machines_heat_and_what_is_wrong_with_it(machine, said):
    with engine_that(lambda _: Outcome(ok=True, data={**STATUS, "machine": machine})):
        plain, as_json = rsoconsole("status"), rsoconsole("status", "--json")
    assert plain.stdout == f"TRACK · autonomy has the mount · frame 24{said}\n"
    assert json.loads(as_json.stdout)["machine"] == machine


@pytest.mark.parametrize(
    ("motion", "said"),
    [
        (None, " · STOP ordered in 2 ms, answered in 41 ms: measuring"),
        ("stands", ""),
        ("tracks", ""),
        ("moves", "STILL MOVES"),
    ],
)
def test_status_says_what_the_last_stop_has_come_to(motion, said):
    stop = {"ordered_ms": 2.0, "answered_ms": 41.0, "motion": motion, "rate_deg_s": 3.9}
    with engine_that(lambda _: Outcome(ok=True, data={**STATUS, "last_stop": stop})):
        line = rsoconsole("status").stdout.removeprefix("TRACK · autonomy has the mount · frame 24")
    assert said in line if said else line == "\n"


@pytest.mark.parametrize(
    "words", [["arm"], ["disarm"], ["set", "detector.tau", "1"], ["quit"], ["status"]]
)
def test_without_an_engine_each_verb_says_how_to_start_one(words):
    run = rsoconsole(*words)
    assert run.exit_code == 1
    assert "'rsoconsole engine' starts one" in str(run.exception)


@pytest.mark.parametrize(
    "verb", ["demo", "engine", "status", "arm", "disarm", "set", "quit", "stop"]
)
def test_each_verb_s_help_has_an_example(verb):
    assert f"Example: rsoconsole {verb}" in " ".join(rsoconsole(verb, "--help").output.split())


def test_the_engine_s_help_says_how_to_arm_it():
    assert "rsoconsole arm" in rsoconsole("engine", "--help").output


# ---- stop ----------------------------------------------------------------------------------


@pytest.fixture
def direct(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, int, str]]:
    """Every STOP that went to the mount past the engine; each succeeds."""
    result = StopResult(is_answered=True, ms=5.0, path="indi")
    measured = dataclasses.replace(result, motion=Motion(kind="tracks"), measured_ms=3100.0)
    return stand_in_for_the_wire(monkeypatch, result, measured)


def stand_in_for_the_wire(
    monkeypatch: pytest.MonkeyPatch, *results: StopResult
) -> list[tuple[str, int, str]]:
    calls: list[tuple[str, int, str]] = []

    def stop_mount(
        host: str,
        port: int,
        device: str,
        *,
        after_stop: str,
        on_result: Callable[[StopResult], None],
    ) -> StopResult:
        calls.append((host, port, device))
        for result in results:
            on_result(result)
        return results[-1]

    monkeypatch.setattr("rsoconsole.instruments.indi.wire_stop.stop_mount", stop_mount)
    return calls


def test_an_engine_that_stopped_the_mount_is_believed(direct):
    with engine_that(lambda _: Outcome(ok=True, data=STOPPED)):
        run = rsoconsole("stop", "--json")
    answer = json.loads(run.stdout)
    assert (run.exit_code, answer["stopped"], answer["path"]) == (0, True, "mount")
    assert answer["ms"] > 0
    assert direct == []


@pytest.mark.parametrize(
    "data",
    [
        {},
        {**UNMEASURED, "is_answered": False, "detail": "its driver says that it still moves"},
        {**UNMEASURED, "is_answered": "yes"},
        {"is_answered": True},
        {"path": "mount"},
    ],
    ids=["empty", "not stopped", "no truth value", "no path", "no answer"],
)
def test_an_engine_that_did_not_surely_stop_the_mount_is_passed_by(
    direct: list[Any], data: Mapping[str, Any]
):
    with engine_that(lambda _: Outcome(ok=True, data=data)) as heard:
        run = rsoconsole("stop", "--json")
    assert [each.command.verb for each in heard if each.command.verb != "status"] == ["stop"]
    assert (run.exit_code, json.loads(run.stdout)["path"]) == (0, "indi")
    assert len(direct) == 1


def test_an_engine_that_breaks_or_refuses_is_passed_by(direct):
    def breaks(_request: Request) -> Outcome:
        raise RuntimeError("out of order")

    with engine_that(breaks):
        assert rsoconsole("stop").exit_code == 0
    assert len(direct) == 1


def test_an_engine_that_hangs_is_passed_by(direct, monkeypatch):
    monkeypatch.setattr("rsoconsole.control.stop.ENGINE_S", 0.1)
    hangs = threading.Event()

    def hang(_request: Request) -> Outcome:
        hangs.wait(20)
        return Outcome(ok=True, data=STOPPED)

    with engine_that(hang):
        run = rsoconsole("stop", "--json")
        hangs.set()
    assert json.loads(run.stdout)["path"] == "indi"
    assert len(direct) == 1


def test_an_engine_that_is_late_is_believed_where_there_is_no_other_way(monkeypatch):
    result = StopResult(is_answered=False, ms=5.0, path="indi", detail="start indiserver")
    stand_in_for_the_wire(monkeypatch, result)

    def be_late(_request: Request) -> Outcome:
        time.sleep(2 * LATE_S)
        return Outcome(ok=True, data=STOPPED)

    with engine_that(be_late):
        run = rsoconsole("stop", "--json")
    answer = json.loads(run.stdout)
    assert (run.exit_code, answer["stopped"], answer["path"]) == (0, True, "mount")


def test_without_an_engine_the_configured_mount_is_stopped(direct, home):
    home.write_text('[indi]\nhost = "dome"\nport = 7000\nmount = "EQMod Mount"\n')
    run = rsoconsole("stop")
    assert run.exit_code == 0
    assert direct == [("dome", 7000, "EQMod Mount")]
    answered, measured = run.stdout.splitlines()
    assert answered.startswith("STOP ABORT answered in ")
    assert "by a connection past the engine (a second INDI connection): measuring" in answered
    assert measured.startswith("STOP the mount tracks, measured in ")


@pytest.mark.parametrize("text", ["not TOML", "[detector]\ntau = 7\n", "[nonsense]\n"])
def test_a_faulty_configuration_does_not_prevent_a_stop(direct, home, text):
    home.write_text(text)
    run = rsoconsole("stop", "--json")
    assert run.exit_code == 0
    assert json.loads(run.stdout)["stopped"] is True
    standard = Config().indi
    assert direct == [(standard.host, standard.port, standard.mount)]
    assert str(home) in run.stderr
    assert "stopping 'Telescope Simulator' at 127.0.0.1:7624 instead" in run.stderr


def test_a_stop_that_nobody_answers_is_a_failure_that_says_why(monkeypatch):
    result = StopResult(is_answered=False, ms=5.0, path="indi", detail="start indiserver")
    stand_in_for_the_wire(monkeypatch, result)
    run = rsoconsole("stop", "--json")
    answer = json.loads(run.stdout)
    assert (run.exit_code, answer["stopped"], answer["motion"]) == (4, False, "unknown")
    assert "start indiserver" in answer["reason"]
    said = rsoconsole("stop").stdout
    assert "NOT ANSWERED: NOT KNOWN whether the mount moves" in said
    assert "cut the mount's power if it moves" in said


@pytest.mark.parametrize(
    ("motion", "status", "words"),
    [
        (Motion(kind="stands", ra_rate_arcsec_s=15.04), 0, "the mount stands, measured in "),
        (Motion(kind="tracks"), 0, "the mount tracks, measured in "),
        (
            Motion(kind="moves", dec_rate_arcsec_s=14_400.0),
            3,
            "the mount STILL MOVES at 4.0 deg/s: cut the mount's power",
        ),
        (Motion(), 4, "NOT KNOWN whether the mount moves"),
    ],
)
def test_each_outcome_of_a_stop_has_its_words_and_its_status(monkeypatch, motion, status, words):
    result = StopResult(is_answered=True, ms=5.0, path="indi")
    measured = dataclasses.replace(result, motion=motion, measured_ms=3100.0)
    stand_in_for_the_wire(monkeypatch, result, measured)
    run = rsoconsole("stop")
    assert run.exit_code == status
    assert f"STOP {words}" in run.stdout


# ---- demo ----------------------------------------------------------------------------------


def demo_dump(**changes: Any) -> dict[str, Any]:
    return demo_config(SITE, preset="tuned", keep_frames="none").model_dump() | changes


def test_nothing_but_the_sessions_folder_of_the_user_s_file_reaches_the_demo(home, tmp_path):
    before = demo_dump()
    home.write_text(
        "[optics]\nwidth_px = 640\n[detector]\ntau = 0.9\n[search]\npattern = 'stay'\n"
        f"[filter]\nsigma_arcsec = 99\n[session]\nroot = '{tmp_path / 'mine'}'\n"
    )
    after = demo_dump()
    assert after.pop("session") == {"root": tmp_path / "mine", "keep_frames": "none"}
    del before["session"]
    assert after == before
    assert after["site"]["latitude_deg"] == SITE.latitude_deg


@pytest.mark.parametrize("text", ["not TOML", "[detector]\ntau = 7\n"])
def test_a_broken_file_does_not_stop_the_demo(home, text, capsys):
    home.write_text(text)
    assert demo_dump()["session"]["root"] == SessionConfig().root
    assert "the demo does without" in capsys.readouterr().err


def test_a_slow_machine_has_time_enough_in_the_demo():
    config = demo_config(SITE, preset="paper", keep_frames="all")
    assert (config.exposure.frame_timeout_s, config.solver.deadline_s) == (120.0, 60.0)
    assert (config.filter.preset, config.session.keep_frames) == ("paper", "all")


def test_the_demo_listens_where_status_and_stop_look_for_it(tmp_path):
    assert demo_socket(tmp_path) is None


def test_the_demo_leaves_a_running_or_hanging_engine_its_place(tmp_path):
    with engine_that(lambda _: Outcome(ok=True)):
        assert demo_socket(tmp_path) == tmp_path / "engine.sock"
    with EngineLock(default_socket_path()):
        assert demo_socket(tmp_path) == tmp_path / "engine.sock"


@pytest.mark.parametrize("option", ["--preset", "--keep-frames"])
def test_a_choice_that_there_is_not_is_wrong_usage(option):
    assert rsoconsole("demo", option, "nonsense").exit_code == 2


def test_a_demo_gives_way_to_an_engine_that_takes_the_usual_place_meanwhile(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    places: list[Path | None] = []

    def run_engine(_config: Any, settings: Any, **_: Any) -> Path:
        places.append(settings.socket)
        if settings.socket is None:
            raise ControlError("an engine is already running (process 1)")
        return tmp_path / "night"

    @contextlib.contextmanager
    def observatory(*_: Any, **__: Any) -> Iterator[Any]:
        yield types.SimpleNamespace(host="", port=1, mount_name="", camera_name="")

    monkeypatch.setattr("rsoconsole.cli.demo.demo_night.demo_socket", lambda _: None)
    monkeypatch.setattr("rsoconsole.engine.service.service.run_engine", run_engine)
    monkeypatch.setattr("rsoconsole.simulator.launch.start_observatory", observatory)
    SessionWriter.create(tmp_path / "night", Config(), {}).close()
    night = SimulatedNight(scenario="empty", seed=1, speed=0.0, frames=1, session=None)
    assert run_night(Config(), night)["frames"] == 0
    assert [None if place is None else place.name for place in places] == [None, "engine.sock"]
