"""The wire between operator and engine."""

import contextlib
import json
import multiprocessing
import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from rsoconsole.base import ControlError
from rsoconsole.control import (
    Arm,
    AskStatus,
    ControlClient,
    ControlServer,
    EngineLock,
    Outcome,
    Park,
    Request,
    Sender,
    Set,
    Stop,
    make_command,
)
from rsoconsole.control import wire as control_wire
from rsoconsole.control.record_lock import socket_address
from rsoconsole.control.server import MAX_CONNECTIONS
from rsoconsole.control.wire import parse_sender


def echo(request: Request) -> Outcome:
    return Outcome(
        ok=True, message=request.command.verb, data={"arguments": request.command.arguments()}
    )


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "run" / "engine.sock"


@contextlib.contextmanager
def raw_wire(path: Path) -> Iterator[socket.socket]:
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as wire:
        wire.settimeout(5)
        wire.connect(str(socket_address(path)))
        yield wire


def one_reply(wire: socket.socket) -> dict[str, object]:
    received = b""
    while not received.endswith(b"\n"):
        chunk = wire.recv(65536)
        assert chunk, "the server closed the connection without an answer"
        received += chunk
    return json.loads(received)


def test_a_command_is_acknowledged_with_its_arguments(path: Path) -> None:
    with ControlServer(path, echo):
        outcome = ControlClient(path, sender=Sender(name="test")).send(
            Set(name="detector.tau", value=0.2)
        )
    assert outcome.ok
    assert outcome.message == "set"
    assert outcome.data == {"arguments": {"name": "detector.tau", "value": 0.2}}


def test_the_sender_is_named(path: Path) -> None:
    seen: list[Request] = []

    def note(request: Request) -> Outcome:
        seen.append(request)
        return Outcome(ok=True)

    with ControlServer(path, note):
        ControlClient(path, sender=Sender.console("ana@pts/1")).send(Arm())
        ControlClient(path, sender=Sender(name="console of mine")).send(Arm())
    ana, mine = (request.sender for request in seen)
    assert (ana, ana.words) == (Sender.console("ana@pts/1"), "console ana@pts/1")
    assert (mine.kind, mine.words) == ("script", "console of mine")


@pytest.mark.parametrize(
    ("by", "kind"),
    [("console ana@pts/1", "console"), ("operator", "script"), ("consoles", "script")],
)
def test_a_sender_that_does_not_say_what_it_is_is_known_by_its_name(by: str, kind: str) -> None:
    assert (parse_sender(by).kind, parse_sender(by).words) == (kind, by)


def test_stop_is_handled_while_another_command_is_under_way(path: Path) -> None:
    is_slewing, may_end = threading.Event(), threading.Event()

    def handler(request: Request) -> Outcome:
        if request.command.verb == "park":
            is_slewing.set()
            may_end.wait(20)
        return Outcome(ok=True, message=request.command.verb)

    with ControlServer(path, handler), raw_wire(path) as wire:
        # The very connection that waits for the slew can bring the STOP.
        wire.sendall(b'{"id": 1, "verb": "park", "timeout_s": 60}\n')
        assert is_slewing.wait(5)
        wire.sendall(b'{"id": 2, "verb": "stop"}\n')
        assert one_reply(wire)["id"] == 2
        assert ControlClient(path).send(Stop()).message == "stop"
        may_end.set()
        assert one_reply(wire)["id"] == 1


def test_a_command_whose_sender_gave_up_is_not_carried_out(path: Path) -> None:
    is_busy, may_end = threading.Event(), threading.Event()
    carried_out: list[str] = []

    def handler(request: Request) -> Outcome:
        carried_out.append(request.command.verb)
        if request.command.verb == "unpark":
            is_busy.set()
            may_end.wait(20)
        return Outcome(ok=True)

    with ControlServer(path, handler), raw_wire(path) as wire:
        wire.sendall(b'{"id": 1, "verb": "unpark", "timeout_s": 60}\n')
        assert is_busy.wait(5)
        with pytest.raises(ControlError, match="did not answer 'park' within"):
            ControlClient(path).send(Park(), timeout_s=0.05)
        may_end.set()
        assert one_reply(wire)["id"] == 1
        assert ControlClient(path).send(Arm()).ok
    assert carried_out == ["unpark", "arm"]


def test_a_stop_gets_in_though_many_knock_before_it(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With a full backlog the system answers at once that it cannot take one more."""
    monkeypatch.setattr("rsoconsole.control.server.BACKLOG", 0)
    handled: list[str] = []

    def handler(request: Request) -> Outcome:
        handled.append(request.command.verb)
        return Outcome(ok=True)

    def knock(verb: str) -> None:
        assert ControlClient(path).send(make_command(verb, {}), timeout_s=20.0).ok

    with ControlServer(path, handler):
        threads = [
            threading.Thread(target=knock, args=(verb,)) for verb in ["unpark"] * 20 + ["stop"]
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(20)
    assert sorted(handled) == ["stop"] + ["unpark"] * 20


def test_a_door_that_stays_crowded_is_said_to_be_so_in_time(path: Path) -> None:
    with contextlib.ExitStack() as stack:
        listener = stack.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_STREAM))
        path.parent.mkdir(mode=0o700, exist_ok=True)
        listener.bind(str(path))
        listener.listen(0)
        for _ in range(1):
            stack.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)).connect(
                str(path)
            )
        with pytest.raises(ControlError, match="did not answer 'status' within"):
            ControlClient(path).send(AskStatus(), timeout_s=0.1)


def test_a_handler_that_breaks_is_an_outcome_and_the_wire_stays(path: Path) -> None:
    def broken(request: Request) -> Outcome:
        raise RuntimeError("the mount is on fire")

    with ControlServer(path, broken):
        for verb in ("park", "stop"):
            outcome = ControlClient(path).send(make_command(verb, {}))
            assert not outcome.ok
            assert outcome.message == f"{verb}: the mount is on fire"


@pytest.mark.parametrize(
    ("line", "says"),
    [
        (b"hello\n", "not a line of JSON"),
        (b"\xff\xfe\n", "not a line of JSON"),
        (b"[1]\n", "a JSON object"),
        (b"{}\n", "needs a 'verb'"),
        (b'{"verb": 7}\n', "needs a 'verb'"),
        (b'{"verb": "arm", "arguments": []}\n', "'arguments'"),
        (b'{"verb": "arm", "id": {}}\n', "'id'"),
        (b'{"verb": "arm", "timeout_s": -1}\n', "'timeout_s'"),
        (b'{"verb": "arm", "timeout_s": NaN}\n', "'timeout_s'"),
        (b'{"verb": "dance"}\n', "the engine knows no 'dance'; it knows stop,"),
        (b'{"verb": "goto", "arguments": {"ra_icrs_deg": 3}}\n', "needs dec_icrs_deg, a number"),
        (b'{"verb": "disarm", "arguments": {"now": 1}}\n', "knows no 'now'"),
        (b"[" * 60000 + b"\n", "not a line of JSON"),
        (b"x" * 70000, "more than 65536 bytes"),
    ],
)
def test_a_malformed_line_is_answered_and_the_server_lives(
    path: Path, line: bytes, says: str
) -> None:
    with ControlServer(path, echo):
        with raw_wire(path) as wire:
            wire.sendall(line)
            reply = one_reply(wire)
        assert reply["ok"] is False
        assert says in str(reply["message"])
        assert ControlClient(path).send(AskStatus()).ok


def test_a_peer_that_leaves_in_the_middle_of_a_line_harms_nobody(path: Path) -> None:
    with ControlServer(path, echo):
        with raw_wire(path) as wire:
            wire.sendall(b'{"verb": "st')
        assert ControlClient(path).send(AskStatus()).ok


def test_an_answer_that_json_cannot_carry_is_said_to_be_so(path: Path) -> None:
    with ControlServer(path, lambda _: Outcome(ok=True, data={"ra": float("nan")})):
        outcome = ControlClient(path).send(AskStatus())
    assert not outcome.ok
    assert "cannot be sent" in outcome.message


def test_without_an_engine_the_client_says_how_to_start_one(path: Path) -> None:
    with pytest.raises(ControlError, match="no engine is running: 'rsoconsole engine'"):
        ControlClient(path).send(AskStatus())


def test_a_second_engine_is_refused_and_the_first_goes_on(path: Path) -> None:
    program = (
        "import sys, time; from pathlib import Path; "
        "from rsoconsole.control import ControlServer, Outcome\n"
        "with ControlServer(Path(sys.argv[1]), lambda i: Outcome(ok=True, message='first')):\n"
        "    print('ready', flush=True); sys.stdin.read()\n"
    )
    first = subprocess.Popen(
        [sys.executable, "-c", program, str(path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    with first:
        assert first.stdout is not None
        assert first.stdout.readline() == "ready\n"
        with pytest.raises(ControlError, match=f"already running .process {first.pid}"):
            ControlServer(path, echo).start()
        assert ControlClient(path).send(AskStatus()).message == "first"
        first.send_signal(signal.SIGKILL)
        first.wait(10)
    # The dead engine left its socket behind.
    assert socket_address(path).exists()
    with pytest.raises(ControlError, match="no engine is running"):
        ControlClient(path).send(AskStatus())
    with ControlServer(path, echo):
        assert ControlClient(path).send(AskStatus()).message == "status"


def test_two_servers_in_one_process_are_refused_too(path: Path) -> None:
    with ControlServer(path, echo), pytest.raises(ControlError, match="already running"):
        ControlServer(path, echo).start()
    with ControlServer(path, echo):
        assert ControlClient(path).send(AskStatus()).ok


def _sleep(seconds: float) -> None:
    time.sleep(seconds)


@pytest.mark.filterwarnings("ignore:.*multi-threaded.*fork:DeprecationWarning")
def test_a_forked_child_that_outlives_the_engine_does_not_hold_its_lock(path: Path) -> None:
    lock = EngineLock(path)
    lock.acquire()
    child = multiprocessing.get_context("fork").Process(target=_sleep, args=(30,))
    child.start()
    try:
        lock.release()
        program = (
            "import sys; from pathlib import Path; from rsoconsole.control import EngineLock"
            "\nwith EngineLock(Path(sys.argv[1])): print('held')\n"
        )
        done = subprocess.run(
            [sys.executable, "-c", program, str(path)], capture_output=True, text=True, check=False
        )
        assert done.stdout == "held\n", done.stderr
    finally:
        child.kill()
        child.join(10)


def test_what_is_no_socket_is_put_aside_and_kept(path: Path) -> None:
    path.parent.mkdir()
    path.write_text("precious")
    found: list[str] = []
    with ControlServer(path, echo, on_found=found.append):
        assert ControlClient(path).send(AskStatus()).ok
    aside = path.with_name(f"{path.name}.aside-1")
    assert aside.read_text() == "precious"
    assert str(aside) in found[0]


def test_a_living_engine_is_reached_again_whatever_takes_the_place_of_its_socket(
    path: Path,
) -> None:
    with ControlServer(path, echo):
        path.unlink()
        path.mkdir()
        (path / "file").touch()
        deadline = time.monotonic() + 10.0
        while not path.is_socket():
            assert time.monotonic() < deadline
            time.sleep(0.02)
        assert ControlClient(path).send(AskStatus()).ok
    assert (path.with_name(f"{path.name}.aside-1") / "file").exists()


def test_the_socket_is_for_its_owner_alone_and_goes_with_the_server(path: Path) -> None:
    with ControlServer(path, echo):
        assert path.stat().st_mode & 0o777 == 0o600
        assert path.parent.stat().st_mode & 0o777 == 0o700
    assert not path.exists()


def test_another_users_peer_is_turned_away(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(control_wire.os, "getuid", lambda: os.geteuid() + 1)
    with ControlServer(path, echo):
        outcome = ControlClient(path).send(Stop())
    assert not outcome.ok
    assert outcome.message == "this engine belongs to another user"


def test_a_path_too_long_for_a_socket_falls_back_to_a_short_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    long_path = tmp_path / ("observatory" * 12) / "engine.sock"
    # A folder of pytest's own may already be too long.
    with tempfile.TemporaryDirectory() as short:
        monkeypatch.setattr("tempfile.tempdir", short)
        with ControlServer(long_path, echo):
            assert ControlClient(long_path).send(AskStatus()).ok
            assert socket_address(long_path).parent.stat().st_mode & 0o777 == 0o700


def test_a_fallback_folder_open_to_others_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    folder = tmp_path / f"rsoconsole-{os.getuid()}"
    folder.mkdir()
    folder.chmod(0o777)
    with pytest.raises(ControlError, match="not this user's own closed folder"):
        socket_address(tmp_path / ("observatory" * 12) / "engine.sock")


@pytest.mark.parametrize(
    "odd", [{"arguments": None}, {"by": 7}, {"timeout_s": 0}, {"id": 1.5}, {"arguments": [1]}]
)
def test_nothing_odd_about_a_stop_stands_in_its_way(path: Path, odd: dict[str, object]):
    with ControlServer(path, echo), raw_wire(path) as wire:
        wire.sendall(json.dumps({"id": 1, "verb": "stop", **odd}).encode() + b"\n")
        reply = one_reply(wire)
    assert (reply["ok"], reply["message"]) == (True, "stop")


def test_half_open_connections_cannot_keep_a_stop_out(path: Path) -> None:
    """Four times as many as there are places, none of which says a word."""
    with ControlServer(path, echo), contextlib.ExitStack() as stack:
        for _ in range(4 * MAX_CONNECTIONS):
            stack.enter_context(raw_wire(path))
        assert ControlClient(path).send(Stop()).ok
        outcome = ControlClient(path).send(Set(name="detector.tau", value=0.2))
        assert not outcome.ok
        assert "close one" in outcome.message
    with ControlServer(path, echo):
        assert ControlClient(path).send(AskStatus()).ok
