"""What moves the mount is answered with the mount's own first word to it, or why there is none."""

from typing import Any

import pytest

from rsoconsole.base import InstrumentError
from rsoconsole.control import ON_RECORD, Outcome, PendingOutcome
from rsoconsole.engine.aim.instrument_controller import Interrupted
from rsoconsole.engine.aim.states import LimitMet, Stopped
from rsoconsole.engine.service._command_handler import MOUNT_WORD_S, SENT, WAITS, CommandHandler
from rsoconsole.instruments import MountAbilities
from rsoconsole.instruments.motion import Motion
from rsoconsole.records import OperatorAction
from rsoconsole.words import text
from tests.rigs.engine_rig import START_DEG, Rig, asked, command_handler_of, rig

ASIDE = {"ra_icrs_deg": START_DEG[0] + 1.0, "dec_icrs_deg": START_DEG[1]}
NUDGE = {"east_arcmin": 6.0, "north_arcmin": 0.0}
LONG_S = 60.0
"""No test waits for so long: what is not answered at once hangs it."""
OWN_REASON = "the mount refused to slew: below its horizon"


@pytest.fixture
def idle() -> Rig:
    return rig(set())


def begun(r: Rig, verb: str, arguments: dict[str, Any] | None = None) -> PendingOutcome:
    """The answer, as the wire waits for it."""
    later = command_handler_of(r, LONG_S).begin(asked(verb, arguments))
    assert isinstance(later, PendingOutcome), later
    return later


def answered(r: Rig, verb: str, arguments: dict[str, Any] | None = None) -> Outcome:
    """The same once the loop has looked."""
    later = begun(r, verb, arguments)
    r.engine.commands.execute_waiting()
    return later.outcome()


def refuse(*_arguments: Any, **_named: Any) -> None:
    raise InstrumentError(OWN_REASON)


@pytest.mark.parametrize(
    ("verb", "arguments", "says"),
    [
        ("goto", ASIDE, "on its way; you have the mount"),
        ("nudge", NUDGE, "on its way; you have the mount"),
        ("park", {}, "the mount parks"),
        ("track", {"on": True}, "the mount tracks"),
        ("track", {"on": False}, "tracking is off: the mount stands"),
    ],
)
def test_the_answer_is_that_the_mount_has_taken_it(idle: Rig, verb: str, arguments, says: str):
    outcome = answered(idle, verb, arguments)
    assert (outcome.ok, outcome.message) == (True, says)


def test_a_mount_that_is_parked_already_is_said_to_be(idle: Rig):
    idle.mount.is_parked = True
    assert answered(idle, "park").message == "the mount is parked"


def test_a_parked_mount_is_released(idle: Rig):
    idle.mount.is_parked = True
    assert answered(idle, "unpark").ok
    assert not idle.mount.is_parked


@pytest.mark.parametrize(
    ("verb", "arguments", "broken"),
    [
        ("goto", ASIDE, "slew"),
        ("nudge", NUDGE, "slew"),
        ("track", {"on": True}, "set_tracking"),
        ("unpark", {}, "unpark"),
    ],
)
def test_a_refusal_is_the_answer_with_its_own_reason(idle: Rig, verb: str, arguments, broken: str):
    idle.mount.is_parked = verb == "unpark"
    setattr(idle.mount, broken, refuse)
    outcome = answered(idle, verb, arguments)
    assert (outcome.ok, outcome.message) == (False, OWN_REASON)
    assert outcome.data[ON_RECORD] is True
    assert text(idle.memory.of(OperatorAction)[-1].outcome) == f"refused: {OWN_REASON}"


def test_a_refused_park_is_said_at_once_and_that_it_is_told_again(idle: Rig):
    idle.mount.park = refuse  # type: ignore[method-assign]
    outcome = answered(idle, "park")
    assert not outcome.ok
    assert outcome.message == f"{OWN_REASON}; it is told again: 'unpark' ends that"


def test_a_mount_without_a_park_position_is_not_parked(idle: Rig):
    idle.mount.able = MountAbilities(can_park=False)
    outcome = answered(idle, "park")
    assert (outcome.ok, outcome.message) == (False, "this mount's driver has no park position")
    assert not idle.engine._parking.is_wanted


def test_what_the_check_refuses_is_answered_without_the_loop(idle: Rig):
    low = {"ra_icrs_deg": START_DEG[0], "dec_icrs_deg": -85.0}
    outcome = command_handler_of(idle, LONG_S).handle(asked("goto", low))
    assert not outcome.ok
    assert outcome.message.startswith("altitude")


def test_the_bound_is_two_seconds_since_the_command_came(idle: Rig):
    assert MOUNT_WORD_S == 2.0
    request = asked("goto", ASIDE)
    later = CommandHandler(idle.engine, idle.queue, idle.engine.config.session.root).begin(request)
    assert isinstance(later, PendingOutcome)
    assert later.until_s == request.came_s + MOUNT_WORD_S


def test_behind_the_bound_it_says_how_far_the_order_has_come(idle: Rig):
    later = command_handler_of(idle, 0.0).begin(asked("goto", ASIDE))
    assert isinstance(later, PendingOutcome)
    assert (later.outcome().ok, later.outcome().message) == (True, WAITS)
    said: list[Outcome] = []
    idle.mount.slew = lambda *_arguments: said.append(later.outcome())  # type: ignore[method-assign]
    idle.engine.commands.execute_waiting()
    assert [(each.ok, each.message) for each in said] == [(True, SENT)]
    assert later.outcome().message == "on its way; you have the mount"


def test_stop_answers_what_it_drops_before_it_is_done(idle: Rig):
    later = begun(idle, "goto", ASIDE)
    said: list[Outcome] = []

    def abort() -> Any:
        said.append(later.outcome())
        return idle.mount.abort()

    idle.queue.stop(Stopped(by="b"), abort)
    assert [(each.ok, each.message) for each in said] == [(False, "dropped by STOP")]


def test_what_was_cut_short_and_waits_again_is_answered_when_it_is_done(idle: Rig):
    plain, cuts = idle.engine.instrument_controller.order_slew, [True]

    def order_slew(*direction: float) -> None:
        if cuts:
            cuts.pop()
            raise Interrupted
        plain(*direction)

    idle.engine.instrument_controller.order_slew = order_slew  # type: ignore[method-assign]
    later = begun(idle, "goto", ASIDE)
    with pytest.raises(Interrupted):
        idle.engine.commands.execute_waiting()
    assert later.wait(0.0).message == WAITS
    idle.engine.commands.execute_waiting()
    assert later.outcome().message == "on its way; you have the mount"


def test_a_limit_that_cuts_into_a_move_is_its_answer(idle: Rig):
    def order_slew(*_direction: float) -> None:
        idle.queue.stop(LimitMet(words="pier by 0.1 deg"), idle.mount.abort)
        raise Interrupted

    idle.engine.instrument_controller.order_slew = order_slew  # type: ignore[method-assign]
    later = begun(idle, "goto", ASIDE)
    with pytest.raises(Interrupted):
        idle.engine.commands.execute_waiting()
    assert (later.outcome().ok, later.outcome().message) == (False, "dropped: a limit was met")


def test_what_waits_when_the_engine_ends_is_answered(idle: Rig):
    later = begun(idle, "goto", ASIDE)
    idle.queue.request_shutdown()
    idle.engine.run()
    assert (later.outcome().ok, later.outcome().message) == (False, "dropped: the engine ends")


@pytest.mark.parametrize("kind", ["stands", "tracks", "moves", "unknown"])
def test_the_status_has_the_measured_motion_and_its_rate(idle: Rig, kind):
    idle.mount.motion = Motion(kind=kind, ra_rate_arcsec_s=7200.0, dec_rate_arcsec_s=-10800.0)
    idle.engine.watch.look()
    status = idle.engine.status()
    assert (status.mount_motion, status.is_parking) == (kind, False)
    assert status.mount_rate_deg_s == (None if kind == "unknown" else 3.0)
