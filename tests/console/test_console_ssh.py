"""The console over a real SSH line: cut it harms nothing, left it restores the terminal."""

import contextlib
import getpass
import os
import re
import shlex
import shutil
import signal
import socket
import subprocess
import termios
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from rsoconsole.simulator import start_observatory
from tests.console.test_console_death import FIRST_WORDS, FRAMES_AFTER, SIZE, frames_without_a_gap
from tests.rigs.terminal import READS_S, Terminal
from tests.rigs.whole_engine import COMMAND, OVERRIDES, WholeEngine, wait_for, whole_engine

pytestmark = pytest.mark.nightly("an SSH server, an engine and consoles")
EXPOSURE = {"exposure_s": 4.0, "cadence_s": 8.0}
SPEED = 10.0
HOMES = (
    "XDG_RUNTIME_DIR",
    *(f"XDG_{name}_HOME" for name in ("DATA", "STATE", "CACHE")),
    "RSOCONSOLE_CONFIG",
)
ENTERED, LEFT = "\x1b[?1049h", "\x1b[?1049l"
RESTORED = {
    "the first screen": LEFT,
    "the cursor": "\x1b[?25h",
    "no clicks reported": "\x1b[?1000l",
    "no motion reported": "\x1b[?1003l",
    "no pasting in brackets": "\x1b[?2004l",
}
PROGRAMS = ("ssh", "ssh-keygen", "sshd")


class Line(Terminal):
    """A terminal that tells how it is set."""

    @property
    def is_as_a_shell_wants_it(self) -> bool:
        """Whether what is typed is echoed, and taken a line at a time."""
        wanted = termios.ECHO | termios.ICANON | termios.ISIG
        return termios.tcgetattr(self._master)[3] & wanted == wanted


@dataclass(frozen=True)
class Server:
    """A running sshd: where it listens, and who may come in."""

    process: "subprocess.Popen[bytes]"
    folder: Path
    port: int

    def line(self, engine: WholeEngine, *options: str) -> Line:
        """``ssh -tt`` in a terminal, with the console at its other end."""
        homes = [f"{name}={engine.environment[name]}" for name in HOMES]
        # As most machines pass it on; the terminal's colours it does not.
        words = ["env", "LANG=C.UTF-8", *homes, *COMMAND, "console", *options]
        ssh = [
            *("ssh", "-F", "none", "-tt", "-p", str(self.port), "-i", str(self.folder / "user")),
            *("-o", "IdentitiesOnly=yes", "-o", "BatchMode=yes", "-o", "LogLevel=ERROR"),
            *("-o", f"UserKnownHostsFile={self.folder / 'known'}"),
            *("-o", "StrictHostKeyChecking=no", f"{getpass.getuser()}@127.0.0.1"),
        ]
        return Line([*ssh, shlex.join(words)], os.environ, SIZE)

    def sessions(self) -> list[int]:
        """The server's processes for lines that are open."""
        found: list[int] = []
        for pid in _children(self.process.pid):
            found += [pid, *(p for p in _children(pid) if "sshd" in _program(p))]
        return found


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    programs = {name: shutil.which(name, path=_search_path()) for name in PROGRAMS}
    missing = [name for name, path in programs.items() if path is None]
    if missing:
        pytest.skip(f"needs {', '.join(missing)}: apt install openssh-server openssh-client")
    folder = tmp_path_factory.mktemp("ssh")
    for key in ("host", "user"):
        make = [programs["ssh-keygen"], "-q", "-t", "ed25519", "-N", "", "-f", str(folder / key)]
        subprocess.run(make, check=True)
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    settings = folder / "sshd_config"
    settings.write_text(
        f"ListenAddress 127.0.0.1\nPort {port}\nPidFile none\n"
        f"HostKey {folder / 'host'}\nAuthorizedKeysFile {folder / 'user.pub'}\n"
        "UsePAM no\nStrictModes no\nPasswordAuthentication no\n",
        encoding="utf-8",
    )
    with contextlib.suppress(OSError):
        Path("/run/sshd").mkdir(mode=0o755, exist_ok=True)  # else made when the system starts
    run = [programs["sshd"], "-f", str(settings)]
    trial = subprocess.run([*run, "-t"], capture_output=True, text=True, check=False)
    if trial.returncode:
        pytest.skip(f"sshd does not start here: {trial.stderr.strip()}")
    with (folder / "sshd.log").open("wb") as log:
        process = subprocess.Popen([*run, "-D", "-e"], stderr=log, start_new_session=True)
    running = Server(process, folder, port)
    try:
        wait_for(lambda: _listens(port), "a listening sshd")
        _expect_a_way_in(running)
        yield running
    finally:
        for pid in (*running.sessions(), process.pid):
            _kill(pid)
        process.wait()


@pytest.fixture(scope="module")
def engine(tmp_path_factory: pytest.TempPathFactory, server: Server) -> Iterator[WholeEngine]:
    stage = "tests.rigs.stub_stage:open_plain"
    with (
        start_observatory("intelsat-14", 1, SPEED, stage=stage) as sky,
        whole_engine(tmp_path_factory.mktemp("night"), sky, exposure=EXPOSURE) as running,
    ):
        running.start()
        yield running


@pytest.fixture(autouse=True)
def nobody_stays(engine: WholeEngine) -> Iterator[None]:
    """No test leaves a console to the next."""
    yield
    for pid in consoles(engine):
        _kill(pid)


# -- a line that is cut ----------------------------------------------------------------------


def the_client_is_killed(server: Server, line: Line) -> None:
    line.kill()


def the_servers_session_is_killed(server: Server, line: Line) -> None:
    for pid in server.sessions():
        _kill(pid)


@pytest.mark.parametrize("cut", [the_client_is_killed, the_servers_session_is_killed])
def test_a_line_cut_in_mid_frame_ends_the_console_and_nothing_else(engine, server, cut):
    session = engine.status()["session"]
    with server.line(engine) as line:
        wait_for(lambda: line.shows("AUTO has the mount", "x STOP"), "a console by ssh")
        assert len(consoles(engine)) == 1
        wait_for(lambda: engine.status()["exposing_until_utc_ns"], "an open shutter", 30.0)
        frames = engine.frames()
        cut(server, line)
        wait_for(lambda: not consoles(engine), "the console's end", 10.0)
    wait_for(lambda: engine.frames() >= frames + FRAMES_AFTER, "frames after the console")
    last = engine.frames()
    status = engine.status()
    assert (status["holder"], status["faults"]) == ("autonomy", [])
    with server.line(engine) as again:
        wait_for(lambda: newest_frame(again) >= last, "the present in a new console")
        again.press("l\x1b[F")  # the whole log, its end: the night's beginning
        wait_for(lambda: again.shows(FIRST_WORDS, "AUTO has the mount"), "the past in it")
        assert engine.status()["session"] == session
        leave(again)
    assert frames_without_a_gap(engine.session) >= last


def test_who_comes_back_by_ssh_acts_though_the_lost_line_had_the_seat(engine, server):
    with server.line(engine) as line:
        wait_for(lambda: line.shows("AUTO has the mount"), "a console by ssh")
        line.press("h")
        wait_for(lambda: engine.status()["is_held"], "a hold")
        line.kill()
        wait_for(lambda: not consoles(engine), "the console's end")
    with server.line(engine) as again:
        wait_for(lambda: again.shows("HELD"), "the hold in a new console")
        again.press("h")
        wait_for(lambda: not engine.status()["is_held"], "the hold's end")
        leave(again)


# -- a line that is left ---------------------------------------------------------------------


def test_leaving_restores_the_terminal_and_its_answer_comes_through(engine, server):
    with server.line(engine) as line:
        wait_for(lambda: line.shows("x STOP"), "a console by ssh")
        assert ENTERED in line.raw
        assert not line.is_as_a_shell_wants_it
        leave(line)
        wait_for(lambda: line.raw.rfind(LEFT) > line.raw.rfind(ENTERED), "the first screen")
        after = line.raw[line.raw.rfind(ENTERED) :]
        assert [name for name, word in RESTORED.items() if word not in after] == []
        assert line.process.returncode == 0
        assert line.is_as_a_shell_wants_it
    assert consoles(engine) == []


def test_a_console_that_is_told_to_end_restores_the_terminal_too(engine, server):
    with server.line(engine) as line:
        wait_for(lambda: line.shows("x STOP"), "a console by ssh")
        (console,) = consoles(engine)
        os.kill(console, signal.SIGTERM)
        wait_for(lambda: line.process.poll() is not None, "the console's end")
        wait_for(lambda: line.raw.rfind(LEFT) > line.raw.rfind(ENTERED), "the first screen", 2.0)
        after = line.raw[line.raw.rfind(ENTERED) :]
        assert [name for name, word in RESTORED.items() if word not in after] == []


# -- a line that is silent ------------------------------------------------------------------


@pytest.fixture
def stopped(engine: WholeEngine) -> Iterator[None]:
    """For a test that stops the telescope: armed again afterwards."""
    yield
    wait_for(lambda: engine.send("arm", override=[*OVERRIDES]).ok, "arming")
    wait_for(lambda: engine.status()["holder"] == "autonomy", "an armed engine")


def test_beside_a_line_that_is_silent_but_not_cut_another_console_stops(engine, server, stopped):
    """A closed laptop, a dead radio link: for minutes nobody tells the server of it."""
    with server.line(engine) as silent:
        wait_for(lambda: silent.shows("AUTO has the mount"), "a console by ssh")
        os.kill(silent.process.pid, signal.SIGSTOP)
        frames = engine.frames()
        wait_for(lambda: engine.frames() >= frames + FRAMES_AFTER, "frames all the same")
        with server.line(engine) as other:
            wait_for(lambda: newest_frame(other) > frames, "the present in another console")
            other.press("x")
            wait_for(lambda: other.shows("ABORT answered"), "STOP", 5.0)
            wait_for(lambda: other.shows("measured in"), "how the mount moves")
            wait_for(lambda: engine.status()["holder"] == "nobody", "a disarmed engine")
            leave(other)


def leave(line: Line) -> None:
    """By the keys that leave the engine running."""
    line.press("q")
    wait_for(lambda: line.shows("leave the console"), "the question")
    time.sleep(READS_S)
    line.press("l")
    wait_for(lambda: line.process.poll() is not None, "the end of the line")


def newest_frame(line: Line) -> int:
    """Of those a console has named."""
    return max((int(number) for number in re.findall(r"frame (\d{4})", line.text)), default=0)


def consoles(engine: WholeEngine) -> list[int]:
    """Every living console of this engine's user."""
    return [pid for pid in engine.remains() if _program(pid).rstrip().endswith(" console")]


def _expect_a_way_in(server: Server) -> None:
    key = ["-i", str(server.folder / "user"), "-o", f"UserKnownHostsFile={server.folder / 'known'}"]
    ask = ["ssh", "-F", "none", *key, "-o", "BatchMode=yes", "-o", "StrictHostKeyChecking=no"]
    told = subprocess.run(
        [*ask, "-p", str(server.port), f"{getpass.getuser()}@127.0.0.1", "true"],
        capture_output=True,
        text=True,
        timeout=20,
        check=False,
    )
    if told.returncode:
        pytest.skip(f"this user cannot come in by ssh: {told.stderr.strip()}")


def _search_path() -> str:
    """Servers lie where users seldom look."""
    return os.pathsep.join([os.environ.get("PATH", os.defpath), "/usr/sbin", "/usr/local/sbin"])


def _listens(port: int) -> bool:
    with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port), 1.0):
        return True
    return False


def _children(pid: int) -> list[int]:
    found: list[int] = []
    with contextlib.suppress(OSError):
        for task in Path(f"/proc/{pid}/task").iterdir():
            found += [int(word) for word in (task / "children").read_text().split()]
    return found


def _program(pid: int) -> str:
    with contextlib.suppress(OSError):
        return Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode()
    return ""


def _kill(pid: int) -> None:
    with contextlib.suppress(ProcessLookupError):
        os.kill(pid, signal.SIGKILL)
