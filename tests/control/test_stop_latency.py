"""STOP by the wire in every bad moment; the figures themselves are bench_stop's.

The bounds are wide enough for a loaded machine: they hold that STOP waits for nothing (a frame, a
solver, a dead process, a disk), not how fast it is.
"""

import os
import signal
from collections.abc import Iterator

import pytest

from tests.rigs.stop_situations import SITUATIONS, Scene, full_disk, scene, stop_by_command
from tests.rigs.whole_engine import is_sidereal, is_slewing, mount_by_itself, wait_for

ACKNOWLEDGED_MS = 2000.0
ENDED_MS = 5000.0
NIGHTLY = pytest.mark.nightly("STOP of a whole engine")
PLAIN = ("while one is processed", "the mount's process hung")
"""The one in the way, and what is not there to obey."""


@pytest.fixture(scope="module")
def stage(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Scene]:
    with scene(tmp_path_factory.mktemp("stop")) as built:
        yield built


@pytest.mark.slow("STOP of a whole engine")
@pytest.mark.parametrize(
    "name", [each if each in PLAIN else pytest.param(each, marks=NIGHTLY) for each in SITUATIONS]
)
def test_stop_waits_for_nothing(stage, name):
    found = SITUATIONS[name](stage)
    assert found.is_answered
    assert found.abort_ms < ACKNOWLEDGED_MS
    assert found.ended_ms < ENDED_MS
    alone = mount_by_itself(stage.engine.observatory)
    assert not is_slewing(alone)
    assert is_sidereal(alone)


@NIGHTLY
def test_the_command_stops_past_an_engine_that_hangs(stage):
    engine = stage.engine
    assert engine.process is not None
    stage.ear.slew()
    os.kill(engine.process.pid, signal.SIGSTOP)
    try:
        found = stop_by_command(stage)
    finally:
        os.kill(engine.process.pid, signal.SIGCONT)
    assert found["answered_ms"] is not None
    assert (found["motion"], found["path"]) == ("unknown", "indi")
    assert not is_slewing(mount_by_itself(engine.observatory))


@NIGHTLY
def test_what_a_full_disk_kept_out_is_on_record_once_it_has_room(stage):
    engine = stage.engine
    wait_for(lambda: not any("log" in fault for fault in engine.status()["faults"]), "room")
    seq = engine.reader.last_seq()
    with full_disk(engine):
        stage.ear.slew()
        assert engine.send("stop").ok
        wait_for(
            lambda: any("log cannot be written" in each for each in engine.status()["faults"]),
            "a word on the disk",
        )
        assert engine.reader.last_seq() == seq
    wait_for(lambda: any("STOP: ABORT sent" in words for words in engine.words(seq)), "the stop")
    wait_for(lambda: not any("log" in fault for fault in engine.status()["faults"]), "no fault")


@pytest.mark.nights
def test_stop_reaches_a_mount_whose_process_hangs_and_the_process_is_replaced(stage):
    engine = stage.engine
    stage.arm()
    pid = wait_for(lambda: engine.child("mount"), "a mount's process")
    seq, frames = engine.reader.last_seq(), engine.frames()
    stage.ear.slew()
    os.kill(pid, signal.SIGSTOP)
    assert stage.stop().is_answered
    stage.arm()
    wait_for(lambda: engine.frames() > frames + 1, "frames again")
    assert engine.child("mount") != pid
    assert any("the mount's process hangs" in words for words in engine.words(seq))
