"""The situations in which STOP must work, each with a mount that really moves."""

import contextlib
import json
import os
import resource
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rsoconsole.simulator import start_observatory
from tests.rigs.stop_witness import Ear, Witness
from tests.rigs.whole_engine import COMMAND, OVERRIDES, WholeEngine, wait_for, whole_engine

SPEED = 5.0
INTO_PROCESSING_S_PER_PX = 2e-8
"""How long after a frame's last byte its reduction is surely under way: it is unpacked first."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Figures:
    """What one STOP took, counted from the instant at which it was given."""

    abort_ms: float
    """Until the last byte of the first ABORT had come out of the engine."""
    ended_ms: float
    """Until the mount told somebody else that it stands."""
    answer_ms: float
    path: str
    is_answered: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Scene:
    """An engine, and who watches it."""

    engine: WholeEngine
    witness: Witness
    ear: Ear
    pixels: int
    """Of a frame."""

    def arm(self) -> None:
        """Have autonomy take the mount, and wait for an exposure of its own."""
        with contextlib.suppress(AssertionError):
            wait_for(lambda: self.engine.status()["holder"] == "autonomy", "autonomy", 0.2)
            return
        wait_for(lambda: self.engine.send("arm", override=[*OVERRIDES]).ok, "arming")
        wait_for(lambda: self.engine.status()["holder"] == "autonomy", "autonomy")

    def stop(self, give: Callable[[], dict[str, Any]] | None = None) -> Figures:
        """Give STOP, by the control socket unless told how, and measure what comes of it."""
        begun_s = time.monotonic()
        data = dict(self.engine.send("stop").data) if give is None else give()
        answer_ms = (time.monotonic() - begun_s) * 1e3
        wait_for(lambda: self.engine.status()["holder"] == "nobody", "the loop's notice of STOP")
        aborts = wait_for(
            lambda: [at_s for at_s in self.witness.aborts_s if at_s >= begun_s], "an ABORT", 10.0
        )
        return Figures(
            abort_ms=(aborts[0] - begun_s) * 1e3,
            ended_ms=(self.ear.ended_s(begun_s) - begun_s) * 1e3,
            answer_ms=answer_ms,
            path=str(data["path"]),
            is_answered=data["answered_ms"] is not None,
        )


@contextlib.contextmanager
def scene(folder: Path, size_px: tuple[int, int] = (2328, 1760)) -> Iterator[Scene]:
    """A running engine between its witnesses; its frames take a while to arrive."""
    sensor = {"width_px": size_px[0], "height_px": size_px[1]}
    with (
        start_observatory(
            "intelsat-14", 1, SPEED, stage="tests.rigs.stub_stage:open_plain", **sensor
        ) as sky,
        Witness(sky, frame_s=0.6) as witness,
        Ear(sky) as ear,
        whole_engine(
            folder,
            sky,
            indi={"port": witness.port, "simulated_latency_s": 0.0},
            optics=sensor,
            # No pause of the sky between a frame's arrival and its reduction.
            exposure={"exposure_s": 2.0, "cadence_s": 5.0, "readout_s": 0.0},
        ) as engine,
    ):
        engine.start()
        yield Scene(engine=engine, witness=witness, ear=ear, pixels=size_px[0] * size_px[1])


def while_idle(stage: Scene) -> Figures:
    """Disarmed, the mount moved by hand."""
    stage.engine.send("disarm")
    stage.ear.slew()
    return stage.stop()


def while_a_frame_arrives(stage: Scene) -> Figures:
    """Between a frame's first byte and its last."""
    stage.arm()
    stage.witness.frame_begins()
    stage.ear.slew()
    return stage.stop()


def while_one_is_processed(stage: Scene) -> Figures:
    """Between a frame's last byte and the end of its reduction."""
    stage.arm()
    stage.witness.frame_begins()
    stage.ear.slew()
    stage.witness.frame_ends()
    time.sleep(INTO_PROCESSING_S_PER_PX * stage.pixels)
    return stage.stop()


def with_the_mounts_process_hung(stage: Scene) -> Figures:
    """The mount's process answers nothing."""
    stage.arm()
    pid = wait_for(lambda: stage.engine.child("mount"), "a mount's process")
    stage.ear.slew()
    os.kill(pid, signal.SIGSTOP)
    try:
        return stage.stop()
    finally:
        # It may have been replaced meanwhile.
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGCONT)


def with_the_mounts_process_killed(stage: Scene) -> Figures:
    """The mount's process has just been killed."""
    stage.arm()
    pid = wait_for(lambda: stage.engine.child("mount"), "a mount's process")
    stage.ear.slew()
    os.kill(pid, signal.SIGKILL)
    return stage.stop()


def with_the_disk_full(stage: Scene) -> Figures:
    """No file of the engine can grow by a byte."""
    stage.arm()
    with full_disk(stage.engine):
        stage.witness.frame_begins()
        stage.ear.slew()
        return stage.stop()


def stop_by_command(stage: Scene) -> dict[str, Any]:
    """``rsoconsole stop`` from another terminal: its answer.

    Its status is not that of success: in a simulated observatory without an engine no time passes
    in which motion could be measured.
    """
    run = subprocess.run(
        [*COMMAND, "stop", "--json"],
        env=stage.engine.environment,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    answer: dict[str, Any] = json.loads(run.stdout)
    return answer


SITUATIONS: dict[str, Callable[[Scene], Figures]] = {
    "idle": while_idle,
    "while a frame arrives": while_a_frame_arrives,
    "while one is processed": while_one_is_processed,
    "the mount's process hung": with_the_mounts_process_hung,
    "the mount's process killed": with_the_mounts_process_killed,
    "the disk full": with_the_disk_full,
}


@contextlib.contextmanager
def full_disk(engine: WholeEngine) -> Iterator[None]:
    """Every write of the engine itself to a file fails, as on a full disk."""
    assert engine.process is not None
    pid = engine.process.pid
    before = resource.prlimit(pid, resource.RLIMIT_FSIZE)
    resource.prlimit(pid, resource.RLIMIT_FSIZE, (0, before[1]))
    try:
        yield
    finally:
        resource.prlimit(pid, resource.RLIMIT_FSIZE, before)
