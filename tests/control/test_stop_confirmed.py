"""STOP: ordered and confirmed are told apart, the first way to confirm answers, silence alarms."""

import threading
import time
from typing import Any

import pytest

from rsoconsole.console.night.log_lines import line_of
from rsoconsole.control import LastStop, Outcome
from rsoconsole.control.stop import StopNews, Stopping
from rsoconsole.engine.service import stop_now as stop_now_module
from rsoconsole.instruments.mount.mount_stop import MountStop
from rsoconsole.instruments.ports import StopResult
from rsoconsole.reason_text import text
from rsoconsole.records import Event, OperatorAction
from tests.rigs.engine_rig import asked, command_handler_of, end_when_idle, rig

PATIENCE_S = 20.0
SOON_S = 5.0


def result(*, stopped: bool, path: Any = "mount", **facts: Any) -> StopResult:
    return StopResult(stopped=stopped, ms=0.0, path=path, **facts)


# ---- two ways to one mount -----------------------------------------------------------------


def test_the_order_and_the_confirmation_are_told_apart_and_each_once():
    news: list[StopResult] = []
    stop = MountStop(news.append)
    began_s = time.monotonic()
    stop.ordered("mount", began_s + 0.010)
    stop.ordered("indi")
    stop.stands("indi", began_s + 0.050)
    stop.stands("mount")
    one_ms = 1.0
    ordered, stands = news
    assert (ordered.stopped, stands.stopped, stands.path) == (False, True, "indi")
    assert ordered.ordered_ms == pytest.approx(10.0, abs=one_ms)
    assert (stands.ordered_ms, stands.ms) == (ordered.ordered_ms, pytest.approx(50.0, abs=one_ms))


def test_the_way_that_settles_first_is_not_held_up_by_the_other():
    hangs = threading.Event()
    stop = MountStop(lambda _: None)
    stop.begin("mount", lambda: bool(hangs.wait(PATIENCE_S)) and result(stopped=False))
    stop.begin("indi", lambda: result(stopped=True, path="indi", is_tracking=True))
    began_s = time.monotonic()
    found = stop.wait_end(began_s + PATIENCE_S)
    assert time.monotonic() - began_s < SOON_S
    assert (found.stopped, found.path, found.is_tracking) == (True, "indi", True)
    assert stop.is_over
    hangs.set()


def test_a_way_that_breaks_is_a_way_that_fails():
    def breaks() -> StopResult:
        raise RuntimeError("no such process")

    stop = MountStop(lambda _: None)
    stop.begin("mount", breaks)
    assert not stop.wait_stands(PATIENCE_S)
    stop.begin("indi", lambda: result(stopped=False, path="indi", detail="no server"))
    found = stop.wait_end(time.monotonic() + PATIENCE_S)
    assert (found.stopped, found.ordered_ms) == (False, None)
    assert found.detail in ("no such process", "no server")


def test_what_comes_after_the_end_is_not_told():
    news: list[StopResult] = []
    stop = MountStop(news.append)
    stop.begin("mount", lambda: result(stopped=False, detail="the mount still moves"))
    assert stop.wait_end(time.monotonic() + PATIENCE_S).detail == "the mount still moves"
    stop.stands("mount")
    assert news == []


# ---- the engine's answer -------------------------------------------------------------------


class Slow:
    """A mount that says when it has been told, when it stands, and when tracking is settled."""

    def __init__(self, *, stands: bool) -> None:
        self.is_settled = threading.Event()
        self._stands = stands

    def abort(self, timeout_s: float = 2.0, *, on_news: Any) -> StopResult:
        told = StopResult(stopped=False, ms=12.0, ordered_ms=12.0, path="mount")
        on_news(told)
        stood = StopResult(stopped=True, ms=40.0, ordered_ms=12.0, path="mount")
        if self._stands:
            on_news(stood)
        self.is_settled.wait(PATIENCE_S)
        return stood


def test_stop_is_answered_when_the_mount_stands_and_not_when_tracking_is_settled():
    r = rig(set())
    mount = Slow(stands=True)
    r.mount.abort = mount.abort  # type: ignore[method-assign]
    command_handler = command_handler_of(r)
    outcome = command_handler.handle(asked("stop", by="console"))
    assert outcome.ok
    assert (outcome.data["ordered_ms"], outcome.data["ms"]) == (12.0, 40.0)
    # Until tracking is settled the loop gives no order.
    assert r.queue.is_stopping
    (action,) = r.memory.of(OperatorAction)
    assert text(action.outcome) == (
        "motion ended, confirmed in 40 ms by the mount's own process; ordered in 12 ms"
    )
    line = line_of(action, 0)
    assert line is not None
    assert line.text.endswith("ordered in 12 ms (counted in the engine)")
    mount.is_settled.set()
    last = command_handler.status().last_stop
    assert last is not None
    assert (last.by, last.text) == ("console", "ordered in 12 ms, confirmed in 40 ms")


def test_a_mount_that_does_not_confirm_is_an_alarm_at_once_and_told_if_it_confirms_later(
    monkeypatch: pytest.MonkeyPatch,
):
    monkeypatch.setattr(stop_now_module, "ALARM_S", 0.1)
    r = rig(set())
    mount = Slow(stands=False)
    r.mount.abort = mount.abort  # type: ignore[method-assign]
    command_handler = command_handler_of(r)
    outcome = command_handler.handle(asked("stop"))
    assert not outcome.ok
    assert outcome.message == "ordered in 12 ms, not confirmed in 0.1 s"
    (alarm,) = [each for each in r.memory.of(Event) if each.level == "alarm"]
    assert alarm.text == (
        "STOP ordered in 12 ms, not confirmed in 0.1 s: cut the mount's power if it moves"
    )
    last = command_handler.status().last_stop
    assert last is not None
    assert last.text == "ordered in 12 ms, NOT CONFIRMED"
    assert r.memory.of(OperatorAction) == []
    mount.is_settled.set()
    ends_s = time.monotonic() + PATIENCE_S
    while not r.memory.of(OperatorAction) and time.monotonic() < ends_s:
        time.sleep(0.01)
    (action,) = r.memory.of(OperatorAction)
    assert action.outcome.kind == "stopped"
    last = command_handler.status().last_stop
    assert last is not None
    assert last.is_confirmed


def test_the_alarm_comes_within_two_seconds():
    two_seconds = 2.0
    assert two_seconds > stop_now_module.ALARM_S


def test_the_line_of_the_log_has_both_figures():
    r = rig(set())
    r.mount.abort = lambda **_: StopResult(  # type: ignore[method-assign]
        stopped=True, ms=40.0, ordered_ms=12.0, path="mount"
    )
    command_handler = command_handler_of(r)
    r.engine.arm()
    command_handler.handle(asked("stop"))
    end_when_idle(r)
    r.engine.run()
    said = [each.text for each in r.memory.of(Event) if each.text.startswith("STOP")]
    assert said == [
        "STOP: motion ended, ordered in 12 ms, confirmed in 40 ms (counted in the engine);"
        " disarmed, the mount tracks on"
    ]


# ---- the seat's words ----------------------------------------------------------------------


class Answering:
    """An engine's end."""

    def __init__(self, data: dict[str, Any]) -> None:
        self._data = data

    def send(self, _command: Any, *, timeout_s: float = 5.0) -> Outcome:
        return Outcome(ok=self._data["stopped"], message="slow mount", data=self._data)


def ended(data: dict[str, Any]) -> StopNews:
    stopping = Stopping(lambda: Answering(data), None)
    stopping.begin()
    return stopping.wait()


def test_the_seat_tells_order_and_confirmation():
    news = ended({"stopped": True, "path": "mount", "ms": 1.0, "ordered_ms": 0.5})
    assert news.phase == "stopped"
    assert news.ordered_ms is not None
    assert news.ms is not None
    assert news.ordered_ms <= news.ms
    assert "motion ended, confirmed in" in news.text
    assert news.text.endswith("ms (counted from the key)")  # the record has the engine's own


def test_the_seat_tells_what_was_ordered_and_is_not_confirmed():
    news = ended({"stopped": False, "path": "mount", "ms": 1.0, "ordered_ms": 0.5})
    assert news.phase == "failed"
    assert news.text.startswith("ordered in ")
    assert "ms, NOT CONFIRMED: " in news.text


@pytest.mark.parametrize("odd", [None, "soon", [], {}])
def test_an_older_engine_that_tells_no_order_is_understood(odd: Any):
    news = ended({"stopped": True, "path": "mount", "ms": 1.0, "ordered_ms": odd})
    assert (news.phase, news.ordered_ms) == ("stopped", None)
    assert "ordered" not in news.text


def test_a_stop_that_never_left_is_called_so():
    assert LastStop(by="x").text == "not ordered, NOT CONFIRMED"
