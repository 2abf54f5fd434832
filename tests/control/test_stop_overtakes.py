"""What was asked for before a STOP moves nothing after it, wherever it was when STOP came."""

import dataclasses
import threading
import time
from pathlib import Path
from typing import Any

import pytest

from rsoconsole.control import ControlClient, ControlServer, Goto, Nudge, Outcome, Sender, Stop
from rsoconsole.engine.aim.instrument_controller import Interrupted
from rsoconsole.engine.aim.states import LimitMet
from rsoconsole.engine.service._command_handler import CommandHandler
from rsoconsole.instruments import MountReport
from rsoconsole.records import OperatorAction, SlewRefusal
from rsoconsole.words import text
from tests.rigs.engine_rig import START_DEG, Rig, asked, command_handler_of, heed_alarms, rig

ASIDE = {"ra_icrs_deg": START_DEG[0] + 1.0, "dec_icrs_deg": START_DEG[1]}
SLOW_DISK_S = 0.05
NUDGES = 12


@pytest.fixture
def armed() -> Rig:
    r = rig(set(range(1, 20)))
    r.engine.arm()
    r.engine.run(frames=6)
    return r


def heed(r: Rig) -> None:
    heed_alarms(r)
    r.engine.commands.execute_waiting()


def test_a_move_that_is_being_computed_when_stop_comes_is_dropped(armed: Rig):
    command_handler, plain = command_handler_of(armed), armed.engine.slews.refusal

    def refusal(*arguments: Any, **named: Any) -> SlewRefusal | None:
        assert command_handler.handle(asked("stop", by="console b")).ok
        return plain(*arguments, **named)

    armed.engine.slews.refusal = refusal  # type: ignore[method-assign]
    stamp = armed.queue.stops
    outcome = command_handler.handle(asked("goto", arguments=ASIDE, stamp=stamp))
    assert (outcome.ok, outcome.message) == (False, "dropped by STOP")
    slews = len(armed.mount.slews)
    heed(armed)
    assert armed.engine.authority.state == "IDLE"
    assert len(armed.mount.slews) == slews
    (goto,) = [a for a in armed.memory.of(OperatorAction) if a.verb == "goto"]
    assert text(goto.outcome) == "dropped by STOP"


def test_moves_that_wait_behind_a_slow_disk_when_stop_comes_are_dropped(armed: Rig, tmp_path: Path):
    def flush(_timeout_s: float) -> bool:
        time.sleep(SLOW_DISK_S)
        return True

    command_handler = CommandHandler(
        armed.engine, armed.queue, tmp_path, flush=flush, mount_word_s=0.0
    )
    socket, outcomes = tmp_path / "engine.sock", list[Outcome]()

    def nudge() -> None:
        client = ControlClient(socket, sender=Sender.console("a"))
        outcomes.append(client.send(Nudge(east_arcmin=1.0, north_arcmin=0.0)))

    with ControlServer(socket, command_handler.handle, stamp=lambda: armed.queue.stops):
        threads = [threading.Thread(target=nudge) for _ in range(NUDGES)]
        for thread in threads:
            thread.start()
        time.sleep(2.5 * SLOW_DISK_S)
        assert ControlClient(socket, sender=Sender.console("a")).send(Stop()).ok
        slews = len(armed.mount.slews)
        heed(armed)
        for thread in threads:
            thread.join()
        heed_again = armed.engine.commands.execute_waiting
        heed_again()
        assert armed.engine.authority.state == "IDLE"
        assert len(armed.mount.slews) == slews
        assert [o.ok for o in outcomes].count(False) >= NUDGES - 4
        # What is asked for afterwards is done.
        assert ControlClient(socket, sender=Sender.console("a")).send(Goto(**ASIDE)).ok
        heed_again()
    assert armed.engine.authority.state == "MANUAL"


@pytest.mark.parametrize("verb", ["disarm", "shutdown"])
def test_what_moves_nothing_is_done_though_stop_has_come(armed: Rig, verb: str):
    stamp = armed.queue.stops
    command_handler = command_handler_of(armed)
    assert command_handler.handle(asked("stop")).ok
    assert command_handler.handle(asked(verb, stamp=stamp)).ok


def test_a_limit_drops_what_moves_and_keeps_what_was_asked_for_to_stand(armed: Rig):
    command_handler = command_handler_of(armed)
    for verb, arguments in (("hold", {}), ("goto", ASIDE), ("disarm", {})):
        assert command_handler.handle(asked(verb, arguments=arguments)).ok
    armed.queue.stop(LimitMet(words="altitude 14.9 deg"), armed.mount.abort)
    assert armed.queue.stops == 0
    slews = len(armed.mount.slews)
    heed(armed)
    outcomes = {a.verb: text(a.outcome) for a in armed.memory.of(OperatorAction)}
    assert outcomes["goto"] == "dropped: a limit was met"
    assert outcomes["disarm"] == "done"
    assert armed.engine.authority.state == "IDLE"
    assert len(armed.mount.slews) == slews


def test_nudges_that_come_while_one_is_granted_add_up(armed: Rig):
    """Else those behind it were dropped, and the log blamed a STOP that nobody gave."""
    command_handler = command_handler_of(armed)
    plain, reports = armed.mount.report, iter([True, True, False])

    def report(*arguments: Any, **named: Any) -> MountReport:
        return dataclasses.replace(plain(*arguments, **named), is_slewing=next(reports, False))

    for _ in range(3):
        assert command_handler.handle(
            asked("nudge", arguments={"east_arcmin": 0.0, "north_arcmin": 6.0})
        ).ok
    before = armed.engine.planner.looking_at(plain())
    armed.mount.report = report  # type: ignore[method-assign]
    armed.engine.commands.execute_waiting()
    done = [a for a in armed.memory.of(OperatorAction) if text(a.outcome) == "on its way"]
    assert len(done) == 3
    assert armed.engine.hand_move is not None
    assert armed.engine.hand_move.direction[1] - before[1] == pytest.approx(0.3, abs=1e-3)


def test_a_limit_that_cuts_into_a_move_drops_it_and_keeps_the_hold_behind_it(armed: Rig):
    command_handler, plain = (
        command_handler_of(armed),
        armed.engine.instrument_controller.order_slew,
    )

    def order_slew(*direction: float) -> None:
        armed.queue.stop(LimitMet(words="pier by 0.1 deg"), armed.mount.abort)
        plain(*direction)

    for verb, arguments in (("goto", ASIDE), ("hold", {})):
        assert command_handler.handle(asked(verb, arguments=arguments)).ok
    armed.engine.instrument_controller.order_slew = order_slew  # type: ignore[method-assign]
    slews = len(armed.mount.slews)
    with pytest.raises(Interrupted):
        armed.engine.commands.execute_waiting()
    heed(armed)
    outcomes = {a.verb: text(a.outcome) for a in armed.memory.of(OperatorAction)}
    assert outcomes == {"goto": "dropped: a limit was met", "hold": "done"}
    assert armed.engine.authority.is_held
    assert len(armed.mount.slews) == slews
