"""When the terminal rings: for what has just come to pass, and for nothing else."""

import dataclasses
from pathlib import Path

import pytest
from textual.pilot import Pilot

from rsoconsole.config import Config, ConsoleConfig
from rsoconsole.console.app import ConsoleApp
from rsoconsole.console.night.engine_view import EngineView, alerts_between, notification_sequence
from rsoconsole.night import NightView, line_of
from rsoconsole.records import Cause, Event, Missed, StateChange, TrackLost
from rsoconsole.session import SessionWriter
from tests.nights import made_up_night as night
from tests.rigs.seat_rig import FRAMES, FakeWire, play, until

HERE = NightView(folder=Path("night"), state="TRACK", is_read=True)
ATTACHED = EngineView(reach="attached")


def alerts(before: NightView, after: NightView, engine: EngineView = ATTACHED) -> list[str]:
    return [alert for alert, _ in alerts_between((before, ATTACHED), (after, engine))]


@pytest.mark.parametrize(
    ("was", "now", "said"),
    [
        ("ACQUIRE", "TRACK", ["acquisition"]),
        ("COAST", "TRACK", []),
        ("TRACK", "COAST", []),
        ("COAST", "LOST", ["loss"]),
        ("TRACK", "SEARCH", ["loss"]),
        ("LOST", "SEARCH", []),
        ("LOST", "LOST", []),
        ("TRACK", "FAULT", ["fault"]),
        ("FAULT", "FAULT", []),
        ("TRACK", "MANUAL", []),
    ],
)
def test_states_ring_when_they_are_entered(was, now, said):
    before, after = (dataclasses.replace(HERE, state=state) for state in (was, now))
    assert alerts(before, after) == said


def test_a_limit_rings_once_and_history_never():
    words = "limit: altitude 14.9 deg; motion and tracking ended"
    said = Event(level="alarm", text=words, topic="limit")
    line = line_of(said, 1)
    assert line is not None
    line = dataclasses.replace(line, seq=1)
    after = dataclasses.replace(HERE, log=(line,), seq=1)
    assert alerts(HERE, after) == ["limit"]
    past = dataclasses.replace(HERE, is_read=False)
    assert alerts(past, dataclasses.replace(after, is_read=False)) == []
    # Another line may go at the same look: what came of a wish says that it was accepted, too.
    full = dataclasses.replace(HERE, log=(dataclasses.replace(line, seq=1, text="x"),), seq=1)
    instead = dataclasses.replace(HERE, log=(dataclasses.replace(line, seq=2),), seq=2)
    assert alerts(full, instead) == ["limit"]
    hung = line_of(Event(level="alarm", text="the loop hangs: limits are still watched"), 1)
    assert hung is not None
    assert alerts(HERE, dataclasses.replace(HERE, log=(dataclasses.replace(hung, seq=1),))) == []
    assert alerts(after, after) == []
    assert alerts(NightView(), dataclasses.replace(after, state="FAULT")) == []
    other = dataclasses.replace(after, folder=Path("another"))
    assert alerts(HERE, other) == []


def test_two_that_come_near_ring_and_their_end_does_not():
    words = 'tracks 1 and 2: 80.1" apart, closest approach 12" (8 to 15") at 22:10 UTC ± 2 min'
    for level, expected in (("warning", ["approach"]), ("info", [])):
        line = line_of(Event(level=level, text=words, topic="approach"), 1)
        assert line is not None
        after = dataclasses.replace(HERE, log=(dataclasses.replace(line, seq=1),), seq=1)
        assert alerts(HERE, after) == expected
    assert "approach" in Config().console.bell


def test_a_weak_supply_rings_as_a_fault_with_its_name():
    text = "machine: under-voltage: the power supply gives too little: use another"
    line = line_of(Event(level="alarm", text=text, topic="machine"), 1)
    assert line is not None
    after = dataclasses.replace(HERE, log=(dataclasses.replace(line, seq=1),), seq=1)
    assert alerts_between((HERE, ATTACHED), (after, ATTACHED)) == [("fault", text)]
    assert alerts(after, after) == []
    over = line_of(Event(level="info", text="machine: no longer under-voltage"), 2)
    assert over is not None
    later = dataclasses.replace(after, log=(dataclasses.replace(over, seq=2),), seq=2)
    assert alerts(after, later) == []


def test_what_the_operator_has_looked_for_again_is_no_loss():
    sought = Cause(kind="looked for again", by="operator")
    change = StateChange(frame_id=1, before="TRACK", after="SEARCH", reason=sought)
    line = line_of(change, 1)
    assert line is not None
    assert alerts(HERE, dataclasses.replace(HERE, state="SEARCH", log=(line,))) == []
    word = Cause(kind="operator's word", detail="frame 1: rejected")
    rejected = line_of(StateChange(frame_id=1, before="TRACK", after="SEARCH", reason=word), 1)
    assert rejected is not None
    assert alerts(HERE, dataclasses.replace(HERE, state="SEARCH", log=(rejected,))) == []


def test_an_engine_that_is_gone_rings():
    assert alerts(HERE, HERE, EngineView(reach="gone")) == ["fault"]
    unread = dataclasses.replace(HERE, is_read=False)
    assert alerts(unread, unread, EngineView(reach="gone")) == ["fault"]


def test_a_notification_holds_no_control_characters():
    assert notification_sequence("lost\x1b[2J\n") == "\x1b]9;rsoconsole: lost[2J\x1b\\"


def test_each_may_be_switched_off():
    config = Config.model_validate({"console": {"bell": [], "notify": ["loss"]}})
    assert config.console.bell == ()
    with pytest.raises(ValueError, match="acquisition"):
        Config.model_validate({"console": {"bell": ["everything"]}})


@pytest.mark.parametrize("is_wanted", [True, False])
def test_the_seat_rings_for_a_loss_where_that_is_wanted(
    wire: FakeWire, writer: SessionWriter, monkeypatch: pytest.MonkeyPatch, is_wanted: bool
):
    rung: list[str] = []
    monkeypatch.setattr(ConsoleApp, "bell", lambda _self: rung.append("bell"))

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        assert rung == []
        missed = Missed(kind="no detection", lost=TrackLost.by_time(900.0))
        coasted = Cause(kind="missed", missed=missed)
        change = StateChange(frame_id=FRAMES, before="TRACK", after="LOST", reason=coasted)
        writer.append(change, night.t_of(FRAMES))
        assert writer.flush()
        await until(pilot, lambda: app.live.night.state == "LOST")
        assert rung == (["bell"] if is_wanted else [])

    play(wire, scene, settings=ConsoleConfig(bell=("loss",) if is_wanted else ()))
