"""Two consoles on one engine: both see, one acts, the other may ask."""

import dataclasses

import pytest
from textual.pilot import Pilot

from rsoconsole.console.app import ConsoleApp
from rsoconsole.control import COMMANDS, Outcome, Sender
from rsoconsole.engine.tasks.seats import ASKED_S, GONE_S, ConsoleControl, SeatView
from tests.rigs.engine_rig import asked, command_handler_of, rig
from tests.rigs.seat_rig import FakeWire, can_answer, pane, play, until

ANA, BOB = Sender.console("ana@pts/1"), Sender.console("bob@pts/2")


@dataclasses.dataclass
class Watch:
    """A clock that a test turns."""

    t_s: float = 0.0

    def __call__(self) -> float:
        return self.t_s


@pytest.fixture
def clock() -> Watch:
    return Watch()


@pytest.fixture
def seats(clock: Watch) -> ConsoleControl:
    return ConsoleControl(clock)


def test_the_first_console_that_acts_has_the_seat_and_others_are_refused(seats: ConsoleControl):
    assert seats.view() == SeatView(holder=None, asked_by=None)
    assert seats.refusal(BOB, needs_control=False) is None
    assert seats.view().holder is None
    assert seats.refusal(ANA, needs_control=True) is None
    assert seats.refusal(BOB, needs_control=True) == "ana@pts/1 has control: ask for it"
    assert seats.refusal(ANA, needs_control=True) is None


@pytest.mark.parametrize("verb", ["stop", "status", "preview", "note"])
def test_what_moves_nothing_and_stop_are_everybodys(seats: ConsoleControl, verb: str):
    seats.refusal(ANA, needs_control=True)
    assert seats.refusal(BOB, needs_control=COMMANDS[verb].needs_control) is None
    assert seats.view().holder == ANA


def test_a_shell_is_never_refused(seats: ConsoleControl):
    seats.refusal(ANA, needs_control=True)
    assert seats.refusal(Sender(), needs_control=True) is None
    assert seats.view().holder == ANA


def test_who_is_asked_gives_or_keeps(seats: ConsoleControl):
    seats.refusal(ANA, needs_control=True)
    assert "is asked" in seats.ask(BOB)
    assert seats.view().asked_by == BOB
    assert "keep" in seats.answer_request(ANA, gives=False)
    assert seats.view() == SeatView(holder=ANA, asked_by=None)
    seats.ask(BOB)
    assert "bob@pts/2 has control now" in seats.answer_request(ANA, gives=True)
    assert seats.refusal(BOB, needs_control=True) is None
    assert seats.refusal(ANA, needs_control=True) is not None
    with pytest.raises(ValueError, match="nobody asks you"):
        seats.answer_request(ANA, gives=True)


def test_who_says_nothing_gives_it_up(seats: ConsoleControl, clock: Watch):
    seats.refusal(ANA, needs_control=True)
    seats.ask(BOB)
    while clock.t_s < ASKED_S - 1.0:
        clock.t_s += 1.0
        seats.refusal(ANA, needs_control=False)
        seats.refusal(BOB, needs_control=False)
        assert seats.view().holder == ANA
    clock.t_s += 1.5
    seats.refusal(BOB, needs_control=False)
    assert seats.view() == SeatView(holder=BOB, asked_by=None)


def test_who_has_gone_has_no_seat(seats: ConsoleControl, clock: Watch):
    seats.refusal(ANA, needs_control=True)
    clock.t_s = GONE_S + 0.1
    assert seats.refusal(BOB, needs_control=True) is None
    assert seats.view().holder == BOB


def test_who_asked_and_left_does_not_get_it(seats: ConsoleControl, clock: Watch):
    seats.refusal(ANA, needs_control=True)
    seats.ask(BOB)
    for clock.t_s in range(1, 40):
        seats.refusal(ANA, needs_control=False)
    assert seats.view() == SeatView(holder=ANA, asked_by=None)


def test_the_engine_refuses_the_second_console_and_tells_everybody_who_has_the_seat():
    command_handler = command_handler_of(rig(set()))
    assert command_handler.handle(asked("disarm", by=ANA.words)).ok
    refused = command_handler.handle(asked("disarm", by=BOB.words))
    assert not refused.ok
    assert refused.data["seat"] == "ana@pts/1"
    assert command_handler.handle(asked("stop", by=BOB.words)).ok
    assert command_handler.handle(asked("ask_seat", by=BOB.words)).ok
    data = command_handler.handle(asked("status", by=ANA.words)).data
    assert (data["seat"], data["seat_asked_by"]) == ("ana@pts/1", "bob@pts/2")
    assert command_handler.handle(asked("answer_seat", by=ANA.words, arguments={"gives": True})).ok
    assert command_handler.handle(asked("disarm", by=BOB.words)).ok
    assert not command_handler.handle(asked("answer_seat", by=ANA.words)).ok


# -- on the console -------------------------------------------------------------------------------


def test_a_refused_console_may_ask_for_the_seat(wire: FakeWire):
    wire.outcomes["hold"] = Outcome(ok=False, message="taken", data={"seat": "bob@pts/2"})

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.holder == "autonomy")
        await pilot.press("h")
        await can_answer(app, pilot)
        await pilot.press("y")
        await until(pilot, lambda: wire.verbs == ["hold", "ask_seat"])

    play(wire, scene, seat_name="ana@pts/1")


@pytest.mark.parametrize(("key", "gives"), [("ctrl+g", True), ("ctrl+k", False)])
def test_the_holder_is_asked_in_the_alert_and_answers_by_a_key_of_its_own(
    wire: FakeWire, key: str, gives: bool
):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        await pilot.press(key)
        wire.status |= {"seat": "ana@pts/1", "seat_asked_by": "bob@pts/2"}
        await until(pilot, lambda: "bob@pts/2 asks for control" in pane(app, "alert"))
        assert app.screen is app.live
        await pilot.press(key)
        await until(pilot, lambda: wire.verbs == ["answer_seat"])
        assert wire.sent[0][1] == {"gives": gives, "to": "bob@pts/2"}
        wire.status |= {"seat_asked_by": None}
        await until(pilot, lambda: not app.live.query_one("#alert").display)

    play(wire, scene, seat_name="ana@pts/1")


def test_what_one_types_when_the_seat_is_asked_for_gives_nothing_away(wire: FakeWire):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        await pilot.press("n", "s", "k")
        wire.status |= {"seat": "ana@pts/1", "seat_asked_by": "bob@pts/2"}
        await until(pilot, lambda: app.live.control_requester == "bob@pts/2")
        await pilot.press("y", "enter")
        await until(pilot, lambda: bool(wire.sent))
        assert wire.sent == [("note", {"text": "sky"})]

    play(wire, scene, seat_name="ana@pts/1")


def test_an_answer_is_for_whom_it_was_meant(seats: ConsoleControl, clock: Watch):
    """Bob's wish has lapsed, Carl asks by now: a late answer to Bob gives Carl nothing."""
    for who in ("ana", "bob", "carl"):
        seats.refusal(Sender.console(who), needs_control=False)
    assert seats.refusal(Sender.console("ana"), needs_control=True) is None
    seats.ask(Sender.console("carl"))
    with pytest.raises(ValueError, match="carl asks by now"):
        seats.answer_request(Sender.console("ana"), gives=True, to="bob")
    assert "carl has control" in seats.answer_request(Sender.console("ana"), gives=True, to="carl")


def test_others_are_not_asked(wire: FakeWire):
    wire.status |= {"seat": "carl@pts/9", "seat_asked_by": "bob@pts/2"}

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.seat == "carl@pts/9")
        await pilot.pause(0.1)
        assert app.screen is app.live

    play(wire, scene, seat_name="ana@pts/1")
