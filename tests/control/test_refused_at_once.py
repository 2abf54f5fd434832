"""What can be known at once is answered at once, and is on record."""

import pytest

from rsoconsole.control import ON_RECORD
from rsoconsole.records import OperatorAction
from rsoconsole.words import text
from tests.rigs.engine_rig import Rig, asked, command_handler_of, rig


@pytest.fixture
def idle() -> Rig:
    return rig(set())


@pytest.fixture
def armed() -> Rig:
    r = rig(set(range(1, 20)))
    r.engine.arm()
    r.engine.run(frames=6)
    return r


def outcomes(r: Rig) -> list[tuple[str, str]]:
    return [(action.verb, text(action.outcome)) for action in r.memory.of(OperatorAction)]


@pytest.mark.parametrize(
    ("verb", "says"),
    [
        ("hold", "autonomy does not have the mount: nothing to hold"),
        ("resume", "nothing is held: there is nothing to resume"),
        ("seek", "nothing has been followed this night that could be looked for"),
        ("reject", "nothing has been taken that could be rejected"),
    ],
)
def test_without_autonomy(idle: Rig, verb: str, says: str):
    answer = command_handler_of(idle).handle(asked(verb))
    assert (answer.ok, answer.message) == (False, says)
    assert outcomes(idle) == [(verb, f"refused: {says}")]
    assert idle.queue.is_settled


@pytest.mark.parametrize(
    ("verb", "says"),
    [
        ("arm", "it is armed already"),
        ("track", "autonomy has the mount: disarm it first"),
        ("resume", "nothing is held: there is nothing to resume"),
    ],
)
def test_while_autonomy_has_the_mount(armed: Rig, verb: str, says: str):
    answer = command_handler_of(armed).handle(asked(verb))
    assert (answer.ok, answer.message) == (False, says)
    assert outcomes(armed) == [(verb, f"refused: {says}")]


def test_what_a_command_before_it_may_still_change_is_not_known_yet(armed: Rig):
    """Else a script could not say 'disarm' and 'track' one after the other."""
    command_handler = command_handler_of(armed)
    assert command_handler.handle(asked("disarm")).ok
    assert command_handler.handle(asked("track", {"on": False})).ok
    assert command_handler.handle(asked("hold")).ok
    armed.engine.commands.execute_waiting()
    assert outcomes(armed)[3:] == [
        ("disarm", "done"),
        ("track", "tracking is off: the mount stands"),
        ("hold", "refused: autonomy does not have the mount: nothing to hold"),
    ]
    assert not command_handler.handle(asked("hold")).ok


def test_a_parked_mount_does_not_track(idle: Rig):
    idle.mount.is_parked = True
    answer = command_handler_of(idle).handle(asked("track"))
    assert (answer.ok, answer.message) == (False, "the mount is parked: unpark it first")


def test_the_answer_says_whether_the_refusal_is_on_record(idle: Rig):
    """A console that has said it once need not say it again when it reads that."""
    command_handler = command_handler_of(idle)
    for verb in ("resume", "arm"):
        arguments = {} if verb == "resume" else {"override": ["no such check"]}
        answer = command_handler.handle(asked(verb, arguments))
        assert not answer.ok
        assert answer.data[ON_RECORD] is True
    assert len(outcomes(idle)) == 2
    answer = command_handler.handle(asked("answer_seat", {"gives": True}))
    assert not answer.ok
    assert ON_RECORD not in answer.data
    assert len(outcomes(idle)) == 2
