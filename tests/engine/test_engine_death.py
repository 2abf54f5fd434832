"""An engine that is killed: what it acknowledged is kept, the mount is safe, the next one goes on.

What is promised: an intention is on disk before it is answered, but for STOP, which is answered
first and is on disk with the next commit, a quarter of a second later.
"""

import os
import signal
import sqlite3
import threading
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from rsoconsole.base import ControlError
from rsoconsole.records import Event, FrameTaken, OperatorAction
from rsoconsole.session import SessionReader
from rsoconsole.session.writing.log_writer import COMMIT_S
from rsoconsole.simulator import start_observatory
from rsoconsole.simulator.launch import Observatory
from tests.rigs.stop_witness import Ear
from tests.rigs.whole_engine import WholeEngine, is_sidereal, is_slewing, mount_by_itself, wait_for
from tests.rigs.whole_engine import whole_engine as an_engine

SPEED = 10.0
EXPOSURE = {"exposure_s": 4.0, "cadence_s": 8.0}
LEASE_S = 2.0


@pytest.fixture
def observatory() -> Iterator[Observatory]:
    with start_observatory(
        "intelsat-14", 1, SPEED, stage="tests.rigs.stub_stage:open_plain"
    ) as sky:
        yield sky


@pytest.fixture
def engine(tmp_path: Path, observatory: Observatory) -> Iterator[WholeEngine]:
    settings: dict[str, dict[str, Any]] = {
        "exposure": EXPOSURE,
        "mount": {"lease_s": LEASE_S},
        "session": {"keep_frames": "all"},
    }
    with an_engine(tmp_path, observatory, **settings) as running:
        running.start()
        yield running


class Operator:
    """Changes a setting without rest, and keeps what was acknowledged, until the engine is gone."""

    def __init__(self, engine: WholeEngine) -> None:
        self.acknowledged: list[float] = []
        self._engine = engine
        self._thread = threading.Thread(target=self._work)
        self._thread.start()

    def wait_until_gone(self) -> None:
        self._thread.join(30.0)
        assert not self._thread.is_alive()

    def _work(self) -> None:
        for number in range(1, 100_000):
            value = 0.1 + number * 1e-6
            try:
                if self._engine.send("set", name="detector.tau", value=value).ok:
                    self.acknowledged.append(value)
            except ControlError:
                return


def is_whole(session: Path) -> bool:
    """SQLite's own word on the database."""
    with closing(sqlite3.connect(session / "session.db")) as connection:
        return connection.execute("PRAGMA integrity_check").fetchone() == ("ok",)


def records(session: Path, kind: type[Any]) -> list[Any]:
    return [record for _, _, record in SessionReader(session).records(kinds=(kind,))]


@pytest.mark.slow("kills a whole engine")
def test_what_was_acknowledged_outlives_the_engine(engine):
    wait_for(lambda: engine.frames() >= 2, "frames")
    operator = Operator(engine)
    wait_for(lambda: len(operator.acknowledged) >= 5, "acknowledgements")
    wait_for(lambda: engine.frames() >= 3, "another frame")
    seen = {frame.frame_id for frame in records(engine.session, FrameTaken)}
    paths = {n: SessionReader(engine.session).frame_path(n) for n in seen}
    engine.kill()
    operator.wait_until_gone()
    assert is_whole(engine.session)
    kept = {
        action.arguments["value"]
        for action in records(engine.session, OperatorAction)
        if action.verb == "set" and action.outcome.kind == "accepted"
    }
    assert len(operator.acknowledged) >= 5
    assert set(operator.acknowledged) <= kept
    assert seen <= {frame.frame_id for frame in records(engine.session, FrameTaken)}
    whole = [path for path in paths.values() if path is not None]
    assert whole
    for path in whole:
        assert pixels_of(path).shape == (192, 256)


def pixels_of(path: Path) -> Any:
    from astropy.io import fits

    with fits.open(path) as file:
        return file[1].data


@pytest.mark.nightly("a whole engine as a process")
def test_a_stop_is_on_disk_one_commit_after_its_answer(engine):
    wait_for(lambda: engine.frames() >= 1, "a frame")
    assert engine.send("stop").ok
    time.sleep(COMMIT_S * 3)
    engine.kill()
    assert "stop" in [action.verb for action in records(engine.session, OperatorAction)]
    assert is_whole(engine.session)


@pytest.mark.slow("kills a whole engine")
def test_the_mount_of_a_killed_engine_ends_its_slew_and_tracks(engine, observatory):
    wait_for(lambda: engine.frames() >= 1, "a frame")
    with Ear(observatory) as ear:
        ear.slew()
        engine.kill()
        wait_for(lambda: not is_slewing(mount_by_itself(observatory)), "the end of the slew")
        wait_for(lambda: is_sidereal(mount_by_itself(observatory)), "tracking")


@pytest.mark.nightly("a whole engine as a process")
def test_the_next_engine_says_what_happened_and_goes_on_in_a_new_session(engine):
    wait_for(lambda: engine.frames() >= 1, "a frame")
    first = engine.session
    engine.kill()
    engine.start()
    assert engine.session != first
    assert engine.reader.read_meta()["continues"] == str(first)
    wait_for(lambda: engine.frames() >= 1, "a frame of the next engine")
    said = [event.text for event in records(engine.session, Event)]
    assert any(first.name in text and "without closing" in text for text in said)
    assert SessionReader(first).read_meta()["is_closed"] is False
    assert is_whole(first)
    # One that ends well is not continued by the third.
    assert engine.process is not None
    engine.process.send_signal(signal.SIGTERM)
    assert engine.process.wait(30) == 0
    engine.start()
    assert engine.reader.read_meta()["continues"] is None


@pytest.mark.nightly("a whole engine as a process")
def test_a_slew_whose_engine_hangs_is_ended_by_the_mounts_process(engine, observatory):
    wait_for(lambda: engine.frames() >= 1, "a frame")
    assert engine.process is not None
    with Ear(observatory) as ear:
        ear.slew()
        os.kill(engine.process.pid, signal.SIGSTOP)
        try:
            # Time of the sky stands still with the engine: only an order can end the slew.
            assert is_slewing(mount_by_itself(observatory))
            wait_for(lambda: not is_slewing(mount_by_itself(observatory)), "the end of the slew")
            wait_for(lambda: is_sidereal(mount_by_itself(observatory)), "tracking")
        finally:
            os.kill(engine.process.pid, signal.SIGCONT)
    frames = engine.frames()
    wait_for(lambda: engine.frames() >= frames + 2, "frames of the engine that came back")
    assert any("nobody has watched this slew" in words for words in engine.words())


FAR_APART = {
    "pattern": "targets",
    "targets": [
        {"name": "east", "slot_longitude_deg": -50.0},
        {"name": "west", "slot_longitude_deg": -112.0},
    ],
}
"""Slews of some 60 deg, which take seconds of the wall."""
LEASE = "because the engine had not renewed its lease for"


@pytest.mark.nightly("a whole engine as a process")
def test_a_suspended_engine_says_what_became_of_its_slew_and_goes_on(tmp_path, observatory):
    """As by a laptop's lid or Ctrl+Z; nobody has to say 'resume'."""
    settings: dict[str, dict[str, Any]] = {
        "exposure": EXPOSURE,
        "mount": {"lease_s": LEASE_S},
        "search": FAR_APART,
    }
    with an_engine(tmp_path, observatory, **settings) as engine:
        engine.start()
        wait_for(lambda: engine.frames() >= 1, "a frame")
        assert engine.process is not None
        frames, seq = engine.frames(), engine.reader.last_seq()
        wait_for(lambda: is_slewing(mount_by_itself(observatory)), "a slew of its own")
        os.kill(engine.process.pid, signal.SIGSTOP)
        try:
            wait_for(lambda: not is_slewing(mount_by_itself(observatory)), "the end of the slew")
        finally:
            os.kill(engine.process.pid, signal.SIGCONT)
        wait_for(lambda: any(LEASE in words for words in engine.words(seq)), "why it ended")
        wait_for(lambda: engine.frames() >= frames + 2, "frames again")
        said = engine.words(seq)
        assert any("within its limits: autonomy goes on" in words for words in said)
        assert not any("somebody else" in words for words in said)
        assert engine.status()["holder"] == "autonomy"
