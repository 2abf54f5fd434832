"""Children of a running engine are killed at random moments: said, replaced, gone on."""

import os
import random
import signal
import time
from collections import Counter
from collections.abc import Iterator

import pytest

from rsoconsole.base import InstrumentError
from rsoconsole.instruments import IndiWire
from rsoconsole.instruments.indi.indi_process import IndiProcess
from rsoconsole.simulator import start_observatory
from rsoconsole.simulator.launch import Observatory
from tests.rigs.whole_engine import WholeEngine, is_slewing, mount_by_itself, wait_for, whole_engine

FEW, MANY = 3, 20
SEED = 20
SPEED = 20.0
CYCLE_S = 1.2
"""About as long as a cycle of these engines takes."""
FRAMES_AFTER = 1
EXPOSURE = {"exposure_s": 4.0, "cadence_s": 8.0}
FAR_APART = {
    "pattern": "targets",
    "frames_per_field": 1,
    "targets": [
        {"name": "east", "hour_angle_deg": -40.0, "declination_deg": -5.0},
        {"name": "far east", "hour_angle_deg": -15.0, "declination_deg": 10.0},
    ],
}
NAMES = {"mount": "the mount's process", "camera": "the camera's process", "solver": "solver"}


@pytest.fixture(scope="module")
def engine(tmp_path_factory: pytest.TempPathFactory) -> Iterator[WholeEngine]:
    """Searches two places far apart, so that it slews as long as it exposes."""
    with (
        start_observatory("intelsat-14", 1, SPEED, stage="tests.rigs.stub_stage:open_plain") as sky,
        whole_engine(
            tmp_path_factory.mktemp("far"), sky, exposure=EXPOSURE, search=FAR_APART
        ) as running,
    ):
        running.start()
        yield running


@pytest.fixture(scope="module")
def solving_engine(tmp_path_factory: pytest.TempPathFactory) -> Iterator[WholeEngine]:
    """Searches a field so small that each frame is searched in full, in vain.

    On a busy machine such a search takes many seconds; its own deadline is not what is tested.
    """
    optics = {"width_px": 1164, "height_px": 880}
    with (
        start_observatory("intelsat-14", 1, SPEED, **optics) as sky,
        whole_engine(
            tmp_path_factory.mktemp("solving"),
            sky,
            exposure=EXPOSURE,
            optics=optics,
            solver={"deadline_s": 120.0},
        ) as running,
    ):
        running.start()
        yield running


def moment_of(sky: Observatory) -> str:
    """What is going on, by a plain connection of its own."""
    if is_slewing(mount_by_itself(sky)):
        return "slewing"
    wire = IndiWire(sky.host, sky.port)
    try:
        wire.ask(sky.camera_name, "CCD_EXPOSURE")
        exposure = wire.wait(lambda vector: vector.name == "CCD_EXPOSURE", 5.0)
    finally:
        wire.close()
    assert exposure is not None
    return "exposing" if exposure.state == "Busy" else "between slew and exposure"


def is_said(engine: WholeEngine, kind: str, since_seq: int) -> bool:
    """Whether the death of a child is on record in words."""
    return any(NAMES[kind] in words and "ended" in words for words in engine.words(since_seq))


def endure(engine: WholeEngine, kind: str, kills: int) -> Counter[str]:
    """Kill a child so often; each time it must be said, replaced, and frames go on."""
    rng = random.Random(f"{SEED} {kind}")
    moments: Counter[str] = Counter()
    wait_for(lambda: engine.frames() >= 1, "a first frame")
    for number in range(kills):
        pid = wait_for(lambda: engine.child(kind), f"a {kind}'s process")
        time.sleep(rng.uniform(0.0, CYCLE_S))
        moment = moment_of(engine.observatory)
        seq, frames = engine.reader.last_seq(), engine.frames()
        os.kill(pid, signal.SIGKILL)
        wait_for(lambda was=pid: engine.child(kind) not in (None, was), f"another {kind}'s process")
        goal = frames + FRAMES_AFTER
        wait_for(lambda goal=goal: engine.frames() >= goal, f"frames after kill {number}, {moment}")
        wait_for(
            lambda since=seq: is_said(engine, kind, since), f"a word on kill {number}, {moment}"
        )
        status = engine.status()
        assert status["holder"] == "autonomy", f"kill {number}, {moment}: {status}"
        moments[moment] += 1
    return moments


@pytest.mark.slow("kills the mount's process of a whole engine")
@pytest.mark.parametrize(
    ("kind", "kills"),
    [
        ("mount", 1),
        pytest.param("mount", FEW, marks=pytest.mark.nightly("again and again")),
        pytest.param("camera", FEW, marks=pytest.mark.nightly("again and again")),
    ],
)
def test_a_killed_child_is_said_replaced_and_the_night_goes_on(engine, kind, kills):
    endure(engine, kind, kills)


@pytest.mark.nightly("a whole engine as a process")
def test_a_killed_solver_is_said_replaced_and_the_night_goes_on(solving_engine):
    endure(solving_engine, "solver", FEW)


@pytest.mark.nights
@pytest.mark.parametrize("kind", ["mount", "camera"])
def test_twenty_killed_children_do_not_end_the_night(engine, kind):
    print(kind, dict(endure(engine, kind, MANY)))


@pytest.mark.nights
def test_twenty_killed_solvers_do_not_end_the_night(solving_engine):
    print("solver", dict(endure(solving_engine, "solver", MANY)))


@pytest.mark.nightly("a whole engine as a process")
def test_a_mount_whose_process_dies_in_a_slew_arrives_all_the_same(engine):
    sky = engine.observatory
    for _ in range(2):
        wait_for(lambda: is_slewing(mount_by_itself(sky)), "a slew")
        pid = engine.child("mount")
        assert pid is not None
        frames = engine.frames()
        os.kill(pid, signal.SIGKILL)
        wait_for(lambda goal=frames + 2: engine.frames() >= goal, "frames after the slew")
    assert engine.status()["faults"] == []


@pytest.mark.nightly("a whole engine as a process")
def test_a_solver_that_dies_in_a_search_costs_one_frame_its_plate(solving_engine):
    # A process that has searched: one that is killed while it starts is replaced without a word.
    goal = solving_engine.frames() + 2
    wait_for(lambda: solving_engine.frames() >= goal, "a frame that was searched")
    pid, seq = solving_engine.child("solver"), solving_engine.reader.last_seq()
    assert pid is not None
    os.kill(pid, signal.SIGSTOP)
    time.sleep(3 * CYCLE_S)
    frames = solving_engine.frames()
    time.sleep(CYCLE_S)
    assert solving_engine.frames() == frames, "it waits in a search"
    os.kill(pid, signal.SIGKILL)
    wait_for(lambda: solving_engine.frames() >= frames + 2, "frames after the search")
    said = solving_engine.words(seq)
    died = [word for word in said if word.startswith("NotSolved: the solver process died")]
    assert len(died) == 1, said


@pytest.mark.timeout(60)
def test_a_child_that_hangs_is_ended_and_one_that_is_slow_is_not(tmp_path):
    child = IndiProcess(
        name="mount",
        module="tests.children.faltering_child",
        settings={},
        log_path=tmp_path / "mount.log",
        on_event=lambda _message: None,
    )
    child.start()
    try:
        first = child.pid
        with pytest.raises(InstrumentError, match="did not answer"):
            child.request("wait for ever", 0.1)
        assert child.request("work", 10.0)["echo"] == "work"
        assert child.pid == first
        assert first is not None
        os.kill(first, signal.SIGSTOP)
        with pytest.raises(InstrumentError, match="did not answer"):
            child.request("work", 0.1)
        assert child.request("work", 10.0)["echo"] == "work"
        assert child.pid not in (None, first)
    finally:
        child.close()
