"""Starting and ending the simulated observatory from another process."""

import json
import math
import select
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import IO, Any, Self

from rsoconsole.base import InstrumentError, LongWait

HOST = "127.0.0.1"
MOUNT_NAME = "Telescope Simulator"
CAMERA_NAME = "CCD Simulator"
WEATHER_NAME = "Weather Simulator"
DOME_NAME = "Dome Simulator"
START_S = 180.0
"""Time-out for the observatory to listen, s; only an overloaded machine comes near it."""
_LOOK_S = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class ObservatorySettings:
    """Settings of the observatory, sent to its process as JSON."""

    scenario: str
    seed: int
    speed: float
    """Virtual seconds per wall second; 0: no pacing."""
    truth_path: str | None = None
    """File to which the truth is written, one JSON line per frame; None: none."""
    width_px: int | None = None
    """Height of a sensor smaller than the scenario's, for quick tests; ``width_px`` alike."""
    height_px: int | None = None
    stage: str | None = None
    """``module:function`` that makes the ``ObservatorySetup`` in place of the scenario."""
    plan: dict[str, Any] | None = None
    """``NightPlan.to_table`` of a night of chosen satellites, in place of the scenario."""
    weather: Sequence[tuple[float, str]] = ()
    """Weather, (seconds since the start, "ok" | "warning" | "alert"), in order; "ok" before."""
    dome: Sequence[tuple[float, str]] = ()
    """Dome in order: (seconds since the start, "open" | "closed" | "moving"); open at first."""
    world: Mapping[str, Any] = field(default_factory=dict)
    """Imperfections by section, as ``World.named`` gives them."""


class Observatory:
    """A running simulated observatory: its address, its device names, and its process."""

    def __init__(self, process: "subprocess.Popen[bytes]", port: int) -> None:
        self.process = process
        self.host = HOST
        self.port = port
        self.mount_name = MOUNT_NAME
        self.camera_name = CAMERA_NAME
        self.weather_name = WEATHER_NAME
        self.dome_name = DOME_NAME

    def stop(self, timeout_s: float = 5.0) -> None:
        """End the observatory; kill its process if it has not ended within ``timeout_s``."""
        for stream in (self.process.stdin, self.process.stdout):
            if stream is not None:
                with suppress(OSError):
                    stream.close()
        try:
            self.process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.stop()


def start_observatory(
    scenario_name: str, seed: int, speed: float, truth_path: Path | None = None, **others: Any
) -> Observatory:
    """Start the observatory in a process of its own and wait until it listens on 127.0.0.1.

    ``speed``: virtual seconds per wall second; 0 or infinity: no pacing. ``others``: further fields
    of ``ObservatorySettings``. Raises InstrumentError, with the last output of the process, when
    the observatory does not start.
    """
    settings = ObservatorySettings(
        scenario=scenario_name,
        seed=seed,
        speed=0.0 if math.isinf(speed) else speed,
        truth_path=None if truth_path is None else str(Path(truth_path).absolute()),
        **others,
    )
    with tempfile.TemporaryFile() as log:
        process = subprocess.Popen(
            [sys.executable, "-m", "rsoconsole.simulator.server"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=log,
            # Ctrl+C in the terminal is the engine's affair: it stops the mount first.
            start_new_session=True,
        )
        answer = _first_line(process, asdict(settings))
        if "port" in answer:
            return Observatory(process, int(answer["port"]))
        Observatory(process, 0).stop()
        said = answer.get("error") or _tail(log)
    raise InstrumentError(f"the simulated observatory did not start: {said}")


def _first_line(process: "subprocess.Popen[bytes]", settings: dict[str, Any]) -> dict[str, Any]:
    assert process.stdin is not None
    assert process.stdout is not None
    with suppress(OSError):
        process.stdin.write(json.dumps(settings).encode() + b"\n")
        process.stdin.flush()
    wait = LongWait("the simulated observatory to start")
    while not select.select([process.stdout], [], [], _LOOK_S)[0]:
        wait.log_if_due()
        if wait.waited_s >= START_S:
            process.kill()
            return {"error": f"it did not listen within {START_S:.0f} s: try again"}
    line = process.stdout.readline()
    return dict(json.loads(line)) if line.strip() else {}


def _tail(log: IO[bytes]) -> str:
    log.seek(0)
    lines = log.read().decode(errors="replace").strip().splitlines()
    return lines[-1] if lines else "it said nothing; try 'rsoconsole doctor'"
