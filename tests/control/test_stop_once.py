"""STOP is one procedure: every seat runs it, and on the wire every one sends the same command."""

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from rsoconsole.base import ConfigError
from rsoconsole.cli.app import app
from rsoconsole.console.commands.keymap import Orders
from rsoconsole.control import (
    Command,
    ControlServer,
    Found,
    Outcome,
    Request,
    Stop,
    StopNews,
    Stopping,
    default_socket_path,
)
from rsoconsole.library.notebook.panel._panel_orders import PanelOrders

STOPPED = {"is_answered": True, "ms": 12.0, "path": "mount", "motion": "tracks"}
PAST = {"is_answered": True, "ms": 12.0, "path": "indi", "motion": "stands"}
PATIENCE_S = 20.0


class Answering:
    """An engine's end that says what it is told to say."""

    def __init__(self, data: dict[str, Any]) -> None:
        self.data, self.heard = data, list[Command]()

    def send(self, command: Command, *, timeout_s: float = 5.0) -> Outcome:
        self.heard.append(command)
        return Outcome(ok=True, data=self.data)


def without_server(on_found: Callable[[Found], None]) -> None:
    """The way past the engine where no INDI server answers."""
    on_found({"is_answered": False, "path": "indi", "detail": "no server"})


class QuietLink:
    """What the panel looks at the engine with, idle."""

    live = now_utc_ns = None

    def look_now(self) -> None:
        pass


def by_console(wire: Answering, told: Callable[[], None]) -> None:
    Orders(lambda: wire).stop(lambda news: told() if news.phase == "stopped" else None)


def by_panel(wire: Answering, told: Callable[[], None]) -> None:
    def tell(name: str, value: dict[str, Any]) -> None:
        if name == "stop_news" and value.get("phase") == "stopped":
            told()

    link: Any = QuietLink()
    panel = PanelOrders(wire, link, tell, read_only=True, stop_directly=None)
    panel.receive({"kind": "stop", "press": 1})


@pytest.fixture
def begun(monkeypatch: pytest.MonkeyPatch) -> list[Stopping]:
    """Every procedure that was begun."""
    seen: list[Stopping] = []
    begin = Stopping.begin

    def note(self: Stopping) -> None:
        seen.append(self)
        begin(self)

    monkeypatch.setattr(Stopping, "begin", note)
    return seen


@pytest.mark.parametrize("seat", [by_console, by_panel])
def test_console_and_panel_stop_by_the_one_procedure(seat, begun: list[Stopping]):
    wire, is_told = Answering(STOPPED), threading.Event()
    seat(wire, is_told.set)
    assert is_told.wait(PATIENCE_S)
    assert wire.heard == [Stop()]
    assert len(begun) == 1


def test_the_shell_stops_by_the_one_procedure(
    begun: list[Stopping], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    heard: list[Command] = []

    def handle(request: Request) -> Outcome:
        heard.append(request.command)
        return Outcome(ok=True, data=STOPPED)

    with ControlServer(default_socket_path(), handle):
        assert CliRunner().invoke(app, ["stop"]).exit_code == 0
    assert heard == [Stop()]
    assert len(begun) == 1


def test_who_waits_for_the_end_waits_for_the_way_past_the_engine_too():
    """It may have told the mount to end its motion, and tracking is set after that."""
    is_late, may_answer, has_settled = threading.Event(), threading.Event(), threading.Event()

    class Late(Answering):
        def send(self, command: Command, *, timeout_s: float = 5.0) -> Outcome:
            may_answer.wait(PATIENCE_S)
            return super().send(command)

    def directly(on_found: Callable[[Found], None]) -> None:
        may_answer.set()
        is_late.wait(0.3)
        has_settled.set()

    wire = Late(STOPPED)
    stopping = Stopping(lambda: wire, directly)
    stopping.begin()
    ended = stopping.wait()
    assert (ended.phase, ended.path) == ("stopped", "mount")
    assert has_settled.is_set()


def test_it_has_failed_only_when_every_way_has_said_no():
    news: list[StopNews] = []
    stopping = Stopping(lambda: Answering({}), without_server, news.append)
    stopping.begin()
    ended = stopping.wait()
    assert news[-1] is ended
    assert (ended.phase, ended.path) == ("failed", "indi")
    assert ended.reason == "the engine gave no reason; no server"


@pytest.mark.parametrize("fault", ["raises", "blocks"])
def test_who_hears_the_news_keeps_no_stop_waiting(fault: str, monkeypatch: pytest.MonkeyPatch):
    """The way past the engine goes out though the screen that is told hangs or breaks."""
    is_past, may_go_on = threading.Event(), threading.Event()

    class Hung(Answering):
        def send(self, command: Command, *, timeout_s: float = 5.0) -> Outcome:
            may_go_on.wait(PATIENCE_S)
            return super().send(command)

    def told(_news: StopNews) -> None:
        if fault == "raises":
            raise RuntimeError("no such widget")
        may_go_on.wait(PATIENCE_S)

    def directly(on_found: Callable[[Found], None]) -> None:
        is_past.set()
        on_found(PAST)

    stopping = Stopping(lambda: Hung(STOPPED), directly, told)
    stopping.begin()
    assert is_past.wait(PATIENCE_S / 4)
    may_go_on.set()
    assert stopping.wait().phase == "stopped"


def test_a_runtime_folder_that_is_refused_does_not_stand_in_the_way_of_a_stop():
    def wire() -> Answering:
        raise ConfigError("/run/user/1000 belongs to another user (uid 1000): run as that user")

    stopping = Stopping(wire, lambda on_found: on_found(PAST))
    stopping.begin()
    assert stopping.wait().phase == "stopped"
    failing = Stopping(wire, without_server)
    failing.begin()
    assert failing.wait().reason == "/run/user/1000 belongs to another user (uid 1000); no server"


def test_a_stop_that_is_answered_past_the_engine_at_once_is_not_called_late_behind_it():
    """The way past the engine may be through before it is said that it is gone."""
    news: list[StopNews] = []
    may_answer, is_answered = threading.Event(), threading.Event()

    class Hung(Answering):
        def send(self, command: Command, *, timeout_s: float = 5.0) -> Outcome:
            may_answer.wait(PATIENCE_S)
            return super().send(command)

    stopping = Stopping(lambda: Hung(STOPPED), None, news.append)

    def directly(on_found: Callable[[Found], None]) -> None:
        on_found({key: value for key, value in PAST.items() if key != "motion"})
        is_answered.set()
        may_answer.wait(PATIENCE_S)

    stopping._directly = directly
    go_past = stopping._go_past

    def go_past_and_wait() -> None:
        go_past()
        is_answered.wait(PATIENCE_S)

    stopping._go_past = go_past_and_wait  # type: ignore[method-assign]
    stopping.begin()
    assert is_answered.wait(PATIENCE_S)
    may_answer.set()
    assert stopping.wait().phase == "stopped"
    assert [each.phase for each in news] == ["answered", "stopped"]
