"""An engine as a process of its own among simulated instruments, to be hurt.

Nothing of it outlives ``close``: every process with this engine's runtime folder in its
environment is ended, no matter who started it.
"""

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from rsoconsole.base import ControlError, SessionError
from rsoconsole.control import ControlClient, Outcome, Sender, make_command
from rsoconsole.instruments import IndiWire
from rsoconsole.instruments.indi.indi_wire import IndiVector
from rsoconsole.session import SessionReader
from rsoconsole.simulator.launch import Observatory

COMMAND = [sys.executable, "-c", "from rsoconsole.cli import main; main()"]
CHILDREN = {"mount": "mount_child", "camera": "camera_child", "solver": "solver_process"}
OVERRIDES = ("sun", "index", "pointing", "disk", "clock")
EVERY_S = 0.02


class WholeEngine:
    """One user's engine: configuration, data, socket and log under one folder."""

    def __init__(self, folder: Path, observatory: Observatory, **settings: dict[str, Any]) -> None:
        """``settings``: sections of the configuration, e.g. ``exposure={"exposure_s": 2.0}``."""
        self.folder, self.observatory = folder, observatory
        self.root = folder / "sessions"
        run = folder / "run"
        run.mkdir(mode=0o700, parents=True)
        self.socket = run / "rsoconsole" / "engine.sock"
        self.config = folder / "config.toml"
        tables = {
            "indi": {"port": observatory.port, "simulated": True},
            "session": {"root": str(self.root), "keep_frames": "none"},
        }
        for name, table in settings.items():
            tables[name] = {**tables.get(name, {}), **table}
        self.config.write_text(_toml(tables), encoding="utf-8")
        homes = {f"XDG_{name}_HOME": str(folder / name) for name in ("DATA", "STATE", "CACHE")}
        self.environment = {
            **os.environ,
            **homes,
            "XDG_RUNTIME_DIR": str(run),
            "RSOCONSOLE_CONFIG": str(self.config),
        }
        self.process: subprocess.Popen[bytes] | None = None
        self.session = Path()

    def start(self, *arguments: str) -> None:
        """Start it, armed whatever the checklist says, and wait until it is."""
        lifted = [word for name in OVERRIDES for word in ("--override", name)]
        said = self.folder / "said.txt"
        with said.open("w", encoding="utf-8") as stderr:
            self.process = subprocess.Popen(
                [*COMMAND, "engine", "--arm", *lifted, *arguments],
                env=self.environment,
                stderr=stderr,
                start_new_session=True,
            )
        mark = "engine runs; session "
        wait_for(lambda: mark in said.read_text() or self.process.poll() is not None, mark)
        text = said.read_text()
        assert mark in text, f"the engine did not start: {text}"
        self.session = Path(text.partition(mark)[2].partition(";")[0].strip().splitlines()[0])
        wait_for(lambda: self.status()["holder"] == "autonomy", "an armed engine")

    @property
    def reader(self) -> SessionReader:
        """Its session."""
        return SessionReader(self.session)

    def send(self, verb: str, **arguments: Any) -> Outcome:
        """A command by its socket."""
        return ControlClient(self.socket, sender=Sender(name="test")).send(
            make_command(verb, arguments)
        )

    def status(self) -> dict[str, Any]:
        """What it says of itself."""
        return dict(self.send("status").data)

    def frames(self) -> int:
        """Frames on record."""
        return self.reader.counts().frames

    def child(self, kind: str) -> int | None:
        """Process number of its living mount, camera or solver."""
        assert self.process is not None
        for pid in _children_of(self.process.pid):
            if CHILDREN[kind] in _command_line(pid) and _is_living(pid):
                return pid
        return None

    def words(self, since_seq: int = 0) -> list[str]:
        """Everything said on record in words, from a place in the log on."""
        said = []
        for _, _, record in self.reader.records(since_seq):
            text = getattr(record, "text", None) or getattr(record, "reason", None)
            if text:
                said.append(f"{type(record).__name__}: {text}")
        return said

    def kill(self) -> None:
        """kill -9 of the engine alone."""
        assert self.process is not None
        self.process.kill()
        self.process.wait()

    def close(self) -> None:
        """End everything that belongs to it."""
        while remaining := self.remains():
            for pid in remaining:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)
            time.sleep(EVERY_S)
        if self.process is not None:
            self.process.wait()

    def remains(self) -> list[int]:
        """Every living process of this engine's environment."""
        return processes_of(Path(self.environment["XDG_RUNTIME_DIR"]))


def processes_of(run: Path) -> list[int]:
    """Living processes, no matter whose children, whose environment has this runtime folder."""
    mark = f"XDG_RUNTIME_DIR={run}".encode()
    found = []
    for entry in Path("/proc").iterdir():
        if not entry.name.isdigit() or int(entry.name) == os.getpid():
            continue
        with contextlib.suppress(OSError):
            if mark in (entry / "environ").read_bytes().split(b"\0"):
                found.append(int(entry.name))
    return [pid for pid in found if _is_living(pid)]


@contextlib.contextmanager
def whole_engine(
    folder: Path, observatory: Observatory, **settings: dict[str, Any]
) -> Iterator[WholeEngine]:
    """An engine that is not started yet and surely ended."""
    engine = WholeEngine(folder, observatory, **settings)
    try:
        yield engine
    finally:
        engine.close()


def wait_for(
    condition: Callable[[], Any],
    what: str,
    timeout_s: float = 60.0,
    seen_instead: Callable[[], Any] = lambda: "",
) -> Any:
    """Wait until something is true, and return it."""
    ends_s = time.monotonic() + timeout_s
    while True:
        with contextlib.suppress(SessionError, ControlError):
            found = condition()
            if found:
                return found
        if time.monotonic() >= ends_s:
            raise AssertionError(
                f"in {timeout_s:g} s there was no sign of: {what}\n{seen_instead()}"
            )
        time.sleep(EVERY_S)


def mount_by_itself(observatory: Observatory, timeout_s: float = 5.0) -> dict[str, IndiVector]:
    """Position, tracking and parking by a plain connection, asked for now."""
    wire = IndiWire(observatory.host, observatory.port)
    told: dict[str, IndiVector] = {}
    try:
        for name in ("EQUATORIAL_EOD_COORD", "TELESCOPE_TRACK_STATE", "TELESCOPE_PARK"):
            wire.ask(observatory.mount_name, name)
            vector = wire.wait(lambda v, name=name: v.name == name, timeout_s)
            assert vector is not None, f"the mount does not tell {name}"
            told[name] = vector
    finally:
        wire.close()
    return told


def is_slewing(told: dict[str, IndiVector]) -> bool:
    """Whether the mount says that it moves."""
    return told["EQUATORIAL_EOD_COORD"].state == "Busy"


def is_sidereal(told: dict[str, IndiVector]) -> bool:
    """Whether the mount says that it tracks."""
    return told["TELESCOPE_TRACK_STATE"].values.get("TRACK_ON") == "On"


def _toml(tables: dict[str, dict[str, Any]]) -> str:
    lines = []
    for name, table in tables.items():
        lines.append(f"[{name}]")
        lines += [f"{key} = {_toml_value(value)}" for key, value in table.items()]
    return "\n".join(lines) + "\n"


def _toml_value(value: Any) -> str:
    if isinstance(value, list):
        return f"[{', '.join(_toml_value(one) for one in value)}]"
    if isinstance(value, dict):
        return f"{{{', '.join(f'{key} = {_toml_value(one)}' for key, one in value.items())}}}"
    return json.dumps(value)


def _children_of(pid: int) -> list[int]:
    """Children of every thread of a process."""
    found: list[int] = []
    with contextlib.suppress(OSError):
        for task in Path(f"/proc/{pid}/task").iterdir():
            with contextlib.suppress(OSError):
                found += [int(word) for word in (task / "children").read_text().split()]
    return found


def _command_line(pid: int) -> str:
    with contextlib.suppress(OSError):
        return Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode()
    return ""


def _is_living(pid: int) -> bool:
    with contextlib.suppress(OSError, IndexError):
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    return False
