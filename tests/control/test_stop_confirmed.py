"""STOP: ordered, answered and measured are told apart; the first way to answer counts."""

import threading
import time
from typing import Any

import pytest

from rsoconsole.control import Command, LastStop, Outcome, Stop, StopNews, Stopping
from rsoconsole.engine.service import stop_now as stop_now_module
from rsoconsole.instruments import StopResult
from rsoconsole.instruments.motion import Motion
from rsoconsole.instruments.mount._mount_stop import MountStop
from rsoconsole.night import line_of
from rsoconsole.records import Event, OperatorAction
from rsoconsole.words import text
from tests.rigs.engine_rig import asked, command_handler_of, end_when_idle, rig

PATIENCE_S = 20.0
SOON_S = 5.0


def result(*, is_answered: bool, path: Any = "mount", **facts: Any) -> StopResult:
    return StopResult(is_answered=is_answered, ms=0.0, path=path, **facts)


# ---- two ways to one mount -----------------------------------------------------------------


def test_order_answer_and_measurement_are_told_apart_and_each_once():
    news: list[StopResult] = []
    stop = MountStop(news.append)
    began_s = time.monotonic()
    stop.ordered("mount", began_s + 0.010)
    stop.ordered("indi")
    stop.answered("indi", began_s + 0.050)
    stop.answered("mount")
    stop.measured("mount", Motion(kind="tracks"), began_s + 3.0)
    one_ms = 1.0
    ordered, answered, measured = news
    assert (ordered.is_answered, answered.is_answered, answered.path) == (False, True, "indi")
    assert ordered.ordered_ms == pytest.approx(10.0, abs=one_ms)
    assert (answered.ordered_ms, answered.ms) == (
        ordered.ordered_ms,
        pytest.approx(50.0, abs=one_ms),
    )
    assert (answered.motion, answered.is_at_rest) == (None, False)
    assert (measured.ms, measured.is_at_rest) == (answered.ms, True)
    assert measured.measured_ms == pytest.approx(3000.0, abs=one_ms)


def test_the_way_that_settles_first_is_not_held_up_by_the_other():
    hangs = threading.Event()
    stop = MountStop(lambda _: None)
    stop.begin("mount", lambda: bool(hangs.wait(PATIENCE_S)) and result(is_answered=False))
    stop.begin("indi", lambda: result(is_answered=True, path="indi", is_tracking=True))
    began_s = time.monotonic()
    found = stop.wait_end(began_s + PATIENCE_S)
    assert time.monotonic() - began_s < SOON_S
    assert (found.is_answered, found.path, found.is_tracking) == (True, "indi", True)
    assert not stop.is_over
    assert not stop.leaves_to("mount")
    hangs.set()


def test_a_way_that_breaks_is_a_way_that_fails():
    def breaks() -> StopResult:
        raise RuntimeError("no such process")

    stop = MountStop(lambda _: None)
    stop.begin("mount", breaks)
    assert not stop.wait_answered(PATIENCE_S)
    stop.begin("indi", lambda: result(is_answered=False, path="indi", detail="no server"))
    found = stop.wait_end(time.monotonic() + PATIENCE_S)
    assert (found.is_answered, found.ordered_ms) == (False, None)
    assert found.detail in ("no such process", "no server")


def test_what_comes_after_the_end_is_not_told():
    news: list[StopResult] = []
    stop = MountStop(news.append)
    stop.begin("mount", lambda: result(is_answered=False, detail="the mount still moves"))
    assert stop.wait_end(time.monotonic() + PATIENCE_S).detail == "the mount still moves"
    stop.answered("mount")
    assert news == []


def test_an_order_ends_the_measurement_of_what_came_before_it():
    news: list[StopResult] = []
    stop = MountStop(news.append)
    stop.end("another order came before it was measured", is_superseded=True)
    stop.measured("mount", Motion(kind="moves"))
    (last,) = news
    assert (last.is_superseded, last.is_at_rest, last.is_answered) == (True, False, False)


# ---- the engine's answer -------------------------------------------------------------------


class Slow:
    """A mount that says when it has been told, when it answers, and when tracking is settled."""

    def __init__(self, *, answers: bool) -> None:
        self.is_settled = threading.Event()
        self._answers = answers

    def abort(self, timeout_s: float = 2.0, *, on_news: Any) -> StopResult:
        told = StopResult(is_answered=False, ms=12.0, ordered_ms=12.0, path="mount")
        on_news(told)
        answered = StopResult(is_answered=True, ms=40.0, ordered_ms=12.0, path="mount")
        if self._answers:
            on_news(answered)
        self.is_settled.wait(PATIENCE_S)
        return answered


def test_stop_is_answered_when_the_driver_has_and_not_when_tracking_is_settled():
    r = rig(set())
    mount = Slow(answers=True)
    r.mount.abort = mount.abort  # type: ignore[method-assign]
    command_handler = command_handler_of(r)
    outcome = command_handler.handle(asked("stop", by="console"))
    assert outcome.ok
    assert (outcome.data["ordered_ms"], outcome.data["ms"]) == (12.0, 40.0)
    # Until tracking is settled the loop gives no order.
    assert r.queue.is_stopping
    (action,) = r.memory.of(OperatorAction)
    assert text(action.outcome) == (
        "ABORT answered in 40 ms by the mount's own process; ordered in 12 ms"
    )
    line = line_of(action, 0)
    assert line is not None
    assert line.text.endswith("ordered in 12 ms (counted in the engine)")
    mount.is_settled.set()
    last = command_handler.status().last_stop
    assert last is not None
    assert (last.by, last.text) == (
        "console",
        "ordered in 12 ms, answered in 40 ms: measuring",
    )


def test_a_driver_that_does_not_answer_is_an_alarm_at_once_and_told_if_it_answers_later(
    monkeypatch: pytest.MonkeyPatch,
):
    monkeypatch.setattr(stop_now_module, "ALARM_S", 0.1)
    r = rig(set())
    mount = Slow(answers=False)
    r.mount.abort = mount.abort  # type: ignore[method-assign]
    command_handler = command_handler_of(r)
    outcome = command_handler.handle(asked("stop"))
    assert not outcome.ok
    assert outcome.message == "ordered in 12 ms, not answered in 0.1 s"
    (alarm,) = [each for each in r.memory.of(Event) if each.level == "alarm"]
    assert alarm.text == (
        "STOP ordered in 12 ms, not answered in 0.1 s: cut the mount's power if it moves"
    )
    last = command_handler.status().last_stop
    assert last is not None
    assert last.text == "ordered in 12 ms, NOT ANSWERED: measuring"
    assert r.memory.of(OperatorAction) == []
    mount.is_settled.set()
    ends_s = time.monotonic() + PATIENCE_S
    while not r.memory.of(OperatorAction) and time.monotonic() < ends_s:
        time.sleep(0.01)
    (action,) = r.memory.of(OperatorAction)
    assert action.outcome.kind == "answered"
    last = command_handler.status().last_stop
    assert last is not None
    assert last.answered_ms == 40.0


def test_the_alarm_comes_within_two_seconds():
    two_seconds = 2.0
    assert two_seconds > stop_now_module.ALARM_S


def test_the_line_of_the_log_has_both_figures():
    r = rig(set())
    r.mount.abort = lambda **_: StopResult(  # type: ignore[method-assign]
        is_answered=True, ms=40.0, ordered_ms=12.0, path="mount"
    )
    command_handler = command_handler_of(r)
    r.engine.arm()
    command_handler.handle(asked("stop"))
    end_when_idle(r)
    r.engine.run()
    said = [each.text for each in r.memory.of(Event) if each.text.startswith("STOP")]
    assert said == [
        "STOP: ABORT sent, ordered in 12 ms, answered in 40 ms (counted in the engine);"
        " disarmed, how the mount moves is being measured"
    ]


# ---- the seat's words ----------------------------------------------------------------------


class Answering:
    """An engine's end: what it answers to STOP, then what its status says of it."""

    def __init__(self, data: dict[str, Any], *later: dict[str, Any]) -> None:
        self._data, self._later = data, list(later)

    def send(self, command: Command, *, timeout_s: float = 5.0) -> Outcome:
        if isinstance(command, Stop):
            return Outcome(ok=self._data["is_answered"], message="slow mount", data=self._data)
        return Outcome(ok=True, data={"last_stop": self._later.pop(0)})


ANSWERED = {"is_answered": True, "number": 3, "path": "mount", "ms": 1.0, "ordered_ms": 0.5}


def ended(*said: dict[str, Any]) -> tuple[StopNews, list[StopNews]]:
    news: list[StopNews] = []
    wire = Answering(*said)
    stopping = Stopping(lambda: wire, None, news.append)
    stopping.begin()
    return stopping.wait(), news


def test_the_seat_tells_order_answer_and_what_was_measured():
    measuring = {"number": 3, "motion": None}
    end, (answered, stopped) = ended(
        ANSWERED, measuring, {**measuring, "motion": "tracks", "measured_ms": 3100.0}
    )
    assert end is stopped
    assert (answered.phase, stopped.phase, stopped.motion) == ("answered", "stopped", "tracks")
    assert answered.ordered_ms is not None
    assert answered.answered_ms is not None
    assert answered.ordered_ms <= answered.answered_ms
    assert "ABORT answered in" in answered.text
    # The record has the engine's own.
    assert answered.text.endswith("ms: measuring (counted from the key)")
    assert stopped.text.startswith("the mount tracks, measured in ")


@pytest.mark.parametrize(
    ("last", "outcome", "words"),
    [
        ({"motion": "stands"}, "stands", "the mount stands, measured in "),
        (
            {"motion": "moves", "rate_deg_s": 3.96},
            "moves",
            "the mount STILL MOVES at 4.0 deg/s: cut the mount's power",
        ),
        (
            {"motion": "moves", "rate_deg_s": 0.005},
            "moves",
            "the mount STILL MOVES at 18 arcsec/s: cut the mount's power",
        ),
        (
            {"motion": "unknown", "detail": "nothing was heard of it"},
            "unknown",
            "NOT KNOWN whether the mount moves (nothing was heard of it): run 'rsoconsole stop'",
        ),
        (
            {"motion": "unknown", "is_superseded": True, "detail": "another order came"},
            "unknown",
            "NOT KNOWN whether the mount moves (another order came)",
        ),
    ],
)
def test_a_stop_has_four_outcomes(last: dict[str, Any], outcome: str, words: str):
    end, _ = ended(ANSWERED, {"number": 3, **last})
    assert end.motion == outcome
    assert end.phase == ("stopped" if outcome == "stands" else "failed")
    assert end.text.startswith(words.replace("0 ms", f"{end.ordered_ms:.0f} ms"))


def test_what_a_stop_before_it_came_to_is_not_told_of_this_one():
    earlier = {"number": 2, "motion": "stands"}
    end, _ = ended(ANSWERED, earlier, {"number": 3, "motion": "tracks"})
    assert end.motion == "tracks"


def test_a_stop_that_nobody_answered_may_still_be_measured_to_have_stopped():
    unanswered = {**ANSWERED, "is_answered": False}
    end, news = ended(unanswered, {"number": 3, "motion": "stands"})
    assert [each.phase for each in news] == ["stopped"]
    assert end.answered_ms is None


def test_a_stop_that_never_left_is_called_so():
    assert LastStop(by="x").text == "not ordered, NOT ANSWERED: measuring"
