"""Starting and ending the simulated observatory from another process."""

import json
import math
import select
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO, Any, Self

from rsoconsole.base import InstrumentError, LongWait

HOST = "127.0.0.1"
MOUNT_NAME = "Telescope Simulator"
CAMERA_NAME = "CCD Simulator"
WEATHER_NAME = "Weather Simulator"
DOME_NAME = "Dome Simulator"
START_S = 180.0
"""Ends as soon as it listens; so much only on a machine that is held up."""
_LOOK_S = 0.5


class Observatory:
    """A running simulated observatory: where it listens, and how to end it."""

    def __init__(self, process: "subprocess.Popen[bytes]", port: int) -> None:
        self.process = process
        self.host = HOST
        self.port = port
        self.mount_name = MOUNT_NAME
        self.camera_name = CAMERA_NAME
        self.weather_name = WEATHER_NAME
        self.dome_name = DOME_NAME

    def stop(self, timeout_s: float = 5.0) -> None:
        """End it; a process that does not go in time is killed."""
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
    scenario_name: str,
    seed: int,
    speed: float,
    truth_path: Path | None = None,
    *,
    width_px: int | None = None,
    height_px: int | None = None,
    stage: str | None = None,
    plan: Mapping[str, Any] | None = None,
    weather: Sequence[tuple[float, str]] = (),
    dome: Sequence[tuple[float, str]] = (),
    world: Mapping[str, Any] | None = None,
) -> Observatory:
    """Start the observatory in a process of its own and wait until it listens on 127.0.0.1.

    ``speed``: virtual seconds a wall second, 0 or infinity for at once. ``truth_path``: a file
    that gets one JSON line a frame. ``width_px``, ``height_px``: a smaller sensor. ``stage``:
    ``module:function`` giving another stage than the scenarios'. ``plan``: a ``NightPlan`` as a
    table, instead of the scenario. ``weather``, ``dome``: what they become, as (seconds since the
    night's start, "ok" | "warning" | "alert") and (seconds, "open" | "closed" | "moving"); fine
    and open unless told. ``world``: the imperfections that are named, as ``World.named`` gives
    them. Raises InstrumentError when the observatory does not come up, with the last of what it
    said.
    """
    settings = {
        "scenario": scenario_name,
        "seed": seed,
        "speed": 0.0 if math.isinf(speed) else speed,
        "truth_path": None if truth_path is None else str(Path(truth_path).absolute()),
        "width_px": width_px,
        "height_px": height_px,
        "stage": stage,
        "plan": None if plan is None else dict(plan),
        "weather": list(weather),
        "dome": list(dome),
        "world": dict(world or {}),
    }
    with tempfile.TemporaryFile() as log:
        process = subprocess.Popen(
            [sys.executable, "-m", "rsoconsole.simulator.server"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=log,
            # Ctrl+C in the terminal is the engine's affair: it stops the mount first.
            start_new_session=True,
        )
        answer = _first_line(process, settings)
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
        wait.look()
        if wait.waited_s >= START_S:
            process.kill()
            return {"error": f"it did not listen within {START_S:.0f} s: try again"}
    line = process.stdout.readline()
    answer: dict[str, Any] = json.loads(line) if line.strip() else {}
    return answer


def _tail(log: IO[bytes]) -> str:
    log.seek(0)
    lines = log.read().decode(errors="replace").strip().splitlines()
    return lines[-1] if lines else "it said nothing; try 'rsoconsole doctor'"
