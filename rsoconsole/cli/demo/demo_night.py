"""A simulated night: observatory and engine together, in this process or a separate one.

The separate process (``python -m rsoconsole.cli.demo.demo_night``) serves the demo's console: it
reads its settings as one JSON line, prints one line when the engine listens, and goes on when the
console ends.
"""

import contextlib
import json
import logging
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import platformdirs

from rsoconsole.base import ControlError, InstrumentError, RsoconsoleError, report_waits_to
from rsoconsole.config import APP, Config

if TYPE_CHECKING:
    from rsoconsole.engine import Engine
    from rsoconsole.pipeline import Reduction


log = logging.getLogger(__name__)

SCRATCH_SOCKET = "engine.sock"
LOOK_S = 20.0
ABANDONED_S = 900.0
"""Time without autonomy's control after which a demo whose console has ended ends too, s."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatedNight:
    """Settings of a simulated night: scenario or plan, seed, speed, length, imperfections."""

    scenario: str
    seed: int
    speed: float
    """Virtual seconds per wall second; 0: no pacing."""
    frames: int | None
    """Number of exposures to take; None: until the engine ends."""
    session: Path | None
    world: Mapping[str, Any] = field(default_factory=dict)
    """Imperfections by section, as ``World.named`` gives them."""
    plan: dict[str, Any] | None = None
    """``NightPlan.to_table`` of a night of chosen satellites, in place of the scenario."""


def run_night(
    config: Config,
    night: SimulatedNight,
    *,
    on_cycle: "Callable[[Engine, Reduction], None] | None" = None,
    on_start: Callable[[Path, Path], None] | None = None,
) -> dict[str, Any]:
    """Run observatory and engine until the night is over; return a summary of the run.

    The summary compares the session with the simulated truth. ``on_cycle``: called after each
    frame. ``on_start``: called with the session's folder and the engine's socket once the engine
    listens.
    """
    from rsoconsole.cli.judge.summary import read_truth, summarise
    from rsoconsole.control import default_socket_path
    from rsoconsole.engine import RunSettings, run_engine
    from rsoconsole.session import SessionReader
    from rsoconsole.simulator import start_observatory

    with tempfile.TemporaryDirectory(prefix="rsoconsole-") as scratch:
        truth_path = Path(scratch) / "truth.jsonl"
        socket = demo_socket(Path(scratch))
        with start_observatory(
            night.scenario, night.seed, night.speed, truth_path, plan=night.plan, world=night.world
        ) as observatory:
            indi = config.indi.model_copy(
                update={
                    "host": observatory.host,
                    "port": observatory.port,
                    "mount": observatory.mount_name,
                    "camera": observatory.camera_name,
                    "simulated": True,
                }
            )
            settings = RunSettings(
                title=f"{night.scenario} seed {night.seed}",
                session=night.session,
                frames=night.frames,
                is_armed=True,
            )

            def engine_at(place: Path | None) -> Path:
                def has_started(folder: Path) -> None:
                    _record_world(night, folder)
                    if on_start is not None:
                        on_start(folder, place or default_socket_path())

                return run_engine(
                    config.model_copy(update={"indi": indi}),
                    replace(settings, socket=place),
                    on_cycle=on_cycle,
                    on_start=has_started,
                )

            try:
                folder = engine_at(socket)
            except ControlError:
                if socket is not None:
                    raise
                # Another engine has taken the usual place since it was looked at.
                folder = engine_at(Path(scratch) / SCRATCH_SOCKET)
        records = (record for _, _, record in SessionReader(folder).records())
        figures = summarise(records, read_truth(truth_path), target_names(night))
    about = {"scenario": night.scenario, "seed": night.seed, "session": str(folder)}
    return {**about, **figures, "world": dict(night.world)}


def _record_world(night: SimulatedNight, session: Path) -> None:
    """Write the imperfections into the session's folder, to simulate the night again."""
    from rsoconsole.session import WORLD
    from rsoconsole.simulator import world_from, world_to_toml

    if night.world:
        (session / WORLD).write_text(world_to_toml(world_from(night.world)), encoding="utf-8")


def target_names(night: SimulatedNight) -> dict[int, str]:
    """Return the names, by catalogue number, of the satellites for which the night was made."""
    if night.plan is not None:
        return dict(zip(night.plan["targets"], night.plan["names"], strict=True))
    from rsoconsole.simulator import scenario_named

    target = scenario_named(night.scenario).target
    return {} if target is None else {target.element_set.norad_id: target.element_set.name}


def demo_socket(scratch: Path) -> Path | None:
    """Return None, for the default socket path, if no engine uses it; else one in ``scratch``."""
    from rsoconsole.control import EngineLock, default_socket_path

    try:
        # Asking an engine would not do: one that hangs or has just begun holds the place, too.
        with EngineLock(default_socket_path()):
            return None
    except (ControlError, OSError):
        return scratch / SCRATCH_SOCKET


class NightProcess:
    """A night in a separate process, which outlives the process that started it."""

    def __init__(
        self, config: Config, night: SimulatedNight, on_wait: Callable[[str], None] = log.info
    ) -> None:
        """Start the process and wait until its engine listens.

        ``on_wait`` is called with the cause of a long wait, in words. Raises InstrumentError with
        the process's own message when it fails.
        """
        log_path = platformdirs.user_log_path(APP) / "demo.log"
        log_path.parent.mkdir(parents=True, exist_ok=True)
        with log_path.open("ab") as log:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "rsoconsole.cli.demo.demo_night"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=log,
                # A terminal that closes must not take the telescope with it.
                start_new_session=True,
            )
        order = {
            "config": config.model_dump(mode="json"),
            "night": asdict(night),
            "starter": os.getpid(),
        }
        assert self._process.stdin is not None
        with contextlib.suppress(OSError):
            self._process.stdin.write(json.dumps(order, default=str).encode() + b"\n")
            self._process.stdin.close()
        started = self._line()
        while "waiting" in started:
            on_wait(started["waiting"])
            started = self._line()
        if "socket" not in started:
            said = started.get("error", f"it said nothing; {log_path} may tell more")
            raise InstrumentError(f"the demo's engine did not start: {said}")
        self.socket = Path(started["socket"])
        self.session = Path(started["session"])

    def wait_for_figures(self) -> dict[str, Any]:
        """Wait for the night's end; return its figures. Raises InstrumentError if it failed."""
        figures = self._line()
        self._process.wait()
        if "frames" not in figures:
            raise InstrumentError(f"the demo ended early: {figures.get('error', 'see its log')}")
        return figures

    def _line(self) -> dict[str, Any]:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        return dict(json.loads(line)) if line.strip() else {}


def end_when_abandoned(socket: Path, starter: int) -> None:
    """End the engine at ``socket`` once it is abandoned; return when the engine has ended.

    It is abandoned when the process ``starter`` (an id) has ended and autonomy has been without
    control for ``ABANDONED_S`` (after dawn, a STOP, a fault). Consoles attached later do not
    count.
    """
    from rsoconsole.control import AskStatus, ControlClient, Sender, Shutdown, read_status

    client = ControlClient(socket, sender=Sender(name="demo"))
    idle_since_s = time.monotonic()
    while True:
        time.sleep(LOOK_S)
        try:
            is_busy = read_status(client.send(AskStatus()).data).holder == "autonomy"
            if is_busy or os.getppid() == starter:
                idle_since_s = time.monotonic()
            elif time.monotonic() - idle_since_s > ABANDONED_S:
                client.send(Shutdown())
                return
        except ControlError as error:
            log.warning("%s", error)
            if isinstance(error.__cause__, FileNotFoundError | ConnectionRefusedError):
                return


def main() -> int:
    """Run one night, as read from stdin; exit status 0, or 1 after a failure."""
    logging.basicConfig(stream=sys.stderr, level=logging.INFO)
    order = json.loads(sys.stdin.readline())
    table = order["night"]
    night = SimulatedNight(
        **{**table, "session": Path(table["session"]) if table["session"] else None}
    )

    def report(message: dict[str, Any]) -> None:
        # Anyone who asked may be gone: the night goes on.
        with contextlib.suppress(OSError, ValueError):
            print(json.dumps(message), flush=True)

    waits = contextlib.ExitStack()
    waits.enter_context(report_waits_to(lambda words: report({"waiting": words})))

    def has_started(folder: Path, path: Path) -> None:
        waits.close()
        report({"session": str(folder), "socket": str(path)})
        forgotten = threading.Thread(
            target=end_when_abandoned, args=(path, order["starter"]), daemon=True
        )
        forgotten.start()

    try:
        config = Config.model_validate(order["config"])
        report(run_night(config, night, on_start=has_started))
    except RsoconsoleError as error:
        logging.exception("the night failed")
        report({"error": str(error)})
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
