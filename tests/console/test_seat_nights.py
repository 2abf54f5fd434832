"""Nights at the console in a real terminal: stray keys in a track, a server that dies and returns.

Real processes: the console in a pseudo-terminal, the engine, an observatory.
"""

import dataclasses
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from rsoconsole.records import OperatorAction, StateChange
from rsoconsole.simulator import start_observatory
from rsoconsole.simulator.launch import Observatory
from rsoconsole.simulator.server import ObservatorySettings, ObservatorySetup
from tests.children.relay import Relay
from tests.rigs.stub_stage import open_plain
from tests.rigs.terminal import READS_S, Terminal
from tests.rigs.whole_engine import COMMAND, WholeEngine, wait_for, whole_engine

SIZE = (120, 40)
SPEED = 30.0
A_MOMENT_S = 0.3
"""Between two presses of somebody who means them."""
HELD_DOWN = 12
"""So many times a key comes that is held down."""


@pytest.fixture
def sky() -> Iterator[Observatory]:
    with start_observatory("intelsat-14", 1, SPEED) as observatory:
        yield observatory


def console(engine: WholeEngine) -> Terminal:
    return Terminal([*COMMAND, "console"], engine.environment, SIZE)


def shown(seat: Terminal, words: str, since: int = 0) -> Callable[[], bool]:
    return lambda: seat.shows(words, since=since)


def changes(engine: WholeEngine) -> list[StateChange]:
    return [r for _, _, r in engine.reader.records(kinds=(StateChange,))]


@pytest.mark.nightly("starts an observatory, an engine and a console")
def test_stray_keys_in_a_track_end_nothing_and_two_presses_can_be_undone(
    tmp_path: Path, sky: Observatory
):
    with whole_engine(tmp_path, sky) as engine:
        engine.start()
        with console(engine) as seat:
            wait_for(lambda: engine.status()["state"] == "TRACK", "a track", 90.0)
            known = len(seat.text)
            wait_for(shown(seat, " TRACK ", known), "the track on the screen")
            for key, says in (
                ("a", "ends the track of"),
                ("s", "gives up the track of"),
                ("\x1b[A", "takes the mount from AUTO"),
                ("\x1b[D", "takes the mount from AUTO"),
            ):
                known = len(seat.text)
                seat.press(key)
                wait_for(shown(seat, says, known), f"what {key!r} would do")
            # A key held down, a click on the footer, keys that only look, an enter.
            seat.press("a" * HELD_DOWN)
            for column in range(10, 20):
                seat.press(f"\x1b[<0;{column};{SIZE[1]}M\x1b[<0;{column};{SIZE[1]}m")
            seat.press("zzffll")
            known = len(seat.text)
            seat.press("p")
            wait_for(shown(seat, "This ends", known), "what parking would end")
            time.sleep(READS_S)
            seat.press("\r")
            wait_for(lambda: engine.frames() > 6, "frames")
            assert engine.status()["holder"] == "autonomy"
            assert [r.verb for _, _, r in engine.reader.records(kinds=(OperatorAction,))] == []
            assert {c.after for c in changes(engine)} <= {"SEARCH", "ACQUIRE", "TRACK", "COAST"}
            # Two presses that are meant end it, and one key takes it up again.
            track = _track_id(engine)
            known = len(seat.text)
            seat.press("a")
            wait_for(shown(seat, "ends the track of", known), "what a would do")
            time.sleep(A_MOMENT_S)
            seat.press("a")
            wait_for(lambda: engine.status()["holder"] == "nobody", "a disarmed engine")
            wait_for(shown(seat, "follows it again", known), "the way back")
            seat.press("u")
            wait_for(lambda: engine.status()["state"] == "TRACK", "the track again", 60.0)
            assert _track_id(engine) == track
            known = len(seat.text)
            seat.press("x")
            wait_for(shown(seat, "ABORT answered", known), "STOP by one key")
            wait_for(lambda: engine.status()["holder"] == "nobody", "a disarmed engine")


def _track_id(engine: WholeEngine) -> Any:
    from rsoconsole.records import TrackState

    return [r.track_id for _, _, r in engine.reader.records(kinds=(TrackState,))][-1]


def open_near_the_pole(settings: ObservatorySettings) -> ObservatorySetup:
    """Above every limit at any hour."""
    return dataclasses.replace(open_plain(settings), start_dec_icrs_deg=85.0)


@pytest.mark.nightly("starts an observatory, an engine and a console")
def test_a_server_that_dies_is_said_once_and_is_over_when_it_is_back(tmp_path: Path):
    # By the machine's own clock, as on a real telescope.
    limits = {"twilight_deg": 90.0, "max_hour_angle_deg": 180.0, "past_meridian_deg": 90.0}
    stage = f"{__name__}:open_near_the_pole"
    with start_observatory("intelsat-14", 1, 10.0, stage=stage) as sky:
        server = Relay(sky.port)
        with whole_engine(
            tmp_path,
            sky,
            exposure={"exposure_s": 2.0, "cadence_s": 4.0},
            limits=limits,
            indi={"port": server.port, "simulated": False},
        ) as engine:
            engine.start()
            with console(engine) as seat:
                wait_for(shown(seat, "AUTO has the mount"), "a console at work")
                server.go()
                wait_for(lambda: engine.status()["state"] == "FAULT", "a fault", 45.0)
                wait_for(shown(seat, "start indiserver"), "its remedy")
                faults = engine.status()["faults"]
                assert len(faults) == len(set(faults))
                known = len(seat.text)
                server.come(sky.port)
                wait_for(lambda: not engine.status()["faults"], "the end of the fault", 45.0)
                wait_for(shown(seat, "cause of the FAULT is over", known), "word of it")
                wait_for(shown(seat, "mount RA", known), "where the mount now stands")
                status = engine.status()
                assert (status["state"], status["holder"]) == ("FAULT", "nobody")
                assert status["mount_t_utc_ns"] > 0
        server.go()
