"""Small things that a night is long with: enter after a dialog, what is cut, copied, left."""

import asyncio
import base64
import threading
from typing import Any

import pytest
from textual.pilot import Pilot
from textual.widgets import Button, OptionList

from rsoconsole.console.app import ConsoleApp
from rsoconsole.console.dialogs import dialogs
from rsoconsole.console.dialogs.dialogs import ArmDialog, Dialog, Tick
from rsoconsole.console.drawing.plain import COLOURS
from rsoconsole.console.frame.frame_sheet import FrameSheet
from rsoconsole.console.night.engine_view import EngineView, alerts_between
from rsoconsole.console.screens._message_list import MessageListDialog
from rsoconsole.control import Arm, Command, Hold, MarkByHand, Outcome, Seek, Shutdown
from rsoconsole.records import CommandResult, Event, OperatorAction
from rsoconsole.session import SessionReader, SessionWriter
from tests.makers import NS
from tests.nights import made_up_night as night
from tests.rigs.seat_rig import (
    FRAMES,
    PATIENCE_S,
    FakeWire,
    can_answer,
    opened,
    pane,
    play,
    screen_text,
    until,
)

LARGE = (120, 40)
A_MARK = MarkByHand(x_a_px=10.0, y_a_px=10.0, x_b_px=50.0, y_b_px=10.0)
IDLE = {"state": "IDLE", "holder": "nobody"}


def shown(app: ConsoleApp) -> str:
    return "\n".join(str(each.render()) for each in app.screen.query("Static"))


def test_a_second_enter_after_a_dialog_opens_no_frame(
    wire: FakeWire, monkeypatch: pytest.MonkeyPatch
):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        await pilot.press("n")
        await until(pilot, lambda: app.screen is not app.live)
        await pilot.press("c", "enter")
        await until(pilot, lambda: app.screen is app.live)
        await pilot.press("enter")
        await pilot.pause(0.1)
        assert app.screen is app.live
        monkeypatch.setattr(Dialog, "closed_s", 0.0)  # a second later
        await pilot.press("enter")
        await until(pilot, lambda: isinstance(app.screen, FrameSheet))

    play(wire, scene)


def test_night_colours_come_first_and_the_bright_ones_last():
    names = list(COLOURS)
    assert names[:2] == ["dark", "night"]
    assert names[-1] == "light"


def test_every_message_is_there_in_full_and_can_be_copied(wire: FakeWire):
    fault = "no INDI server answers, " + "and so on " * 40 + "-> start indiserver"
    wire.status |= {"faults": [fault]}

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: "shows all" in pane(app, "alert"))
        assert "start indiserver" in pane(app, "alert")
        await pilot.press("ctrl+o")
        await until(pilot, lambda: isinstance(app.screen, MessageListDialog))
        options = app.screen.query_one(OptionList)
        assert fault in str(options.get_option_at_index(0).prompt)
        assert options.option_count > 3
        await pilot.press("enter")
        await until(pilot, lambda: app.screen is app.live)
        assert fault in app.clipboard
        assert "copied" in pane(app, "keys")

    play(wire, scene, LARGE)


def test_what_is_looked_at_is_copied_as_plain_text(wire: FakeWire):
    written: list[str] = []

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        assert app._driver is not None
        app._driver.write = written.append  # type: ignore[method-assign]
        await pilot.press("ctrl+y")
        await until(pilot, lambda: "copied" in pane(app, "keys"))
        assert pane(app, "top").strip() in app.clipboard
        coded = base64.b64encode(app.clipboard.encode()).decode()
        assert any(f"\x1b]52;c;{coded}\a" in each for each in written)
        await pilot.press("l", "down", "down", "ctrl+y")
        await until(pilot, lambda: app.clipboard.count("\n") == 0)
        assert app.clipboard.split("Z")[0].count(":") == 2

    play(wire, scene, LARGE)


ENDED = Event(level="info", text="the engine ends, the mount stands", topic="engine ended")


def asked_to_end(came_of: CommandResult) -> OperatorAction:
    return OperatorAction(verb=Shutdown.verb, arguments={}, outcome=came_of, by="command")


def test_an_engine_that_has_ended_as_it_was_asked_to_is_not_gone(
    wire: FakeWire, writer: SessionWriter
):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        before = app.live.night, app.live.engine
        writer.append(asked_to_end(CommandResult(kind="accepted")), night.t_of(FRAMES) + 8 * NS)
        writer.append(ENDED, night.t_of(FRAMES) + 8 * NS)
        await until(pilot, lambda: app.live.night.has_ended)
        wire.is_gone = True
        await until(pilot, lambda: "ENGINE ENDED" in pane(app, "top"))
        assert "GONE" not in pane(app, "top")
        await until(pilot, lambda: "'rsoconsole engine' starts one" in pane(app, "alert"))
        assert alerts_between(before, (app.live.night, app.live.engine)) == []

    play(wire, scene)


@pytest.mark.parametrize(
    "came_of",
    [
        CommandResult.refused("not while the dome moves"),
        CommandResult(kind="accepted"),
        CommandResult(kind="done"),
    ],
)
def test_an_engine_that_dies_before_the_mount_stood_is_gone_though_it_was_asked_to_end(
    wire: FakeWire, writer: SessionWriter, came_of: CommandResult
):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        before = app.live.night, app.live.engine
        writer.append(asked_to_end(came_of), night.t_of(FRAMES) + 8 * NS)
        await until(pilot, lambda: app.live.night.seq > before[0].seq)
        wire.is_gone = True
        await until(pilot, lambda: "ENGINE GONE" in pane(app, "top"))
        await until(pilot, lambda: "'rsoconsole stop' stops the mount" in pane(app, "alert"))
        now = app.live.night, app.live.engine
        assert alerts_between(before, now) == [("fault", "the engine is gone")]

    play(wire, scene)


def test_a_console_that_still_reads_the_past_does_not_say_that_nothing_happened(
    wire: FakeWire, monkeypatch: pytest.MonkeyPatch
):
    """Over a slow line or card the past of a night takes seconds."""
    read = threading.Event()
    plain = SessionReader.records

    def records(self: SessionReader, **named: Any) -> Any:
        assert read.wait(PATIENCE_S)
        return plain(self, **named)

    monkeypatch.setattr(SessionReader, "records", records)

    async def scene() -> None:
        app = ConsoleApp(lambda: wire)
        async with opened(app, LARGE) as pilot:
            await until(pilot, lambda: app.live.engine.is_attached)
            await until(pilot, lambda: "reading the night so far" in screen_text(app))
            assert "nothing has happened yet" not in screen_text(app)
            assert "no frame yet" not in screen_text(app)
            read.set()
            await until(pilot, lambda: "two frames agree" in screen_text(app))
            await until(pilot, lambda: "reading" not in screen_text(app))

    asyncio.run(scene())


def test_an_engine_that_dies_is_an_alarm_as_ever():
    from rsoconsole.night import NightView

    seen = NightView(is_read=True), EngineView(reach="attached", state="TRACK")
    gone = seen[0], EngineView(reach="gone", state="TRACK")
    assert alerts_between(seen, gone) == [("fault", "the engine is gone")]


@pytest.mark.parametrize(
    ("status", "focused", "says"),
    [
        (
            {"state": "MANUAL", "holder": "operator", "is_slewing": True, "slew_left_s": 23.0},
            "stay",
            "THE TELESCOPE IS MOVING: slewing, 23 s left",
        ),
        ({}, "leave", "It follows"),
        (IDLE, "leave", "nobody has the mount"),
    ],
)
def test_leaving_says_what_moves_and_proposes_what_is_safe(
    wire: FakeWire, status: dict[str, Any], focused: str, says: str
):
    wire.status |= status

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        await pilot.press("q")
        await until(pilot, lambda: app.screen is not app.live)
        await until(pilot, lambda: isinstance(app.focused, Button))
        assert app.focused is not None
        assert app.focused.id == focused
        assert says in shown(app)

    play(wire, scene)


@pytest.mark.parametrize(
    ("command", "outcome", "keys"),
    [
        (Arm(), {"checks": [{"name": "sun", "ok": False, "detail": "it is day"}]}, ["space"]),
        (A_MARK, {"asks": "replaces", "sigma_arcsec": 118.0, "better_arcsec": 0.3}, ["enter", "m"]),
        (Hold(), {"seat": "bob@pts/2"}, ["y", "down", "enter"]),
        (Seek(), {}, ["s", "enter"]),
    ],
)
def test_a_dialog_that_opens_by_itself_takes_no_answer_before_it_can_be_read(
    wire: FakeWire,
    monkeypatch: pytest.MonkeyPatch,
    command: Command,
    outcome: dict[str, Any],
    keys: list[str],
):
    wire.outcomes[command.verb] = Outcome(ok=False, message="no", data=outcome)

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        monkeypatch.setattr(dialogs, "UNASKED_DEAF_S", 3600.0)
        app.live.send(command)
        await until(pilot, lambda: isinstance(app.screen, Dialog))
        before = shown(app)
        await pilot.press(*keys)
        await pilot.pause()
        assert isinstance(app.screen, Dialog)
        assert shown(app) == before
        assert wire.verbs == [command.verb]
        await pilot.press("escape")
        await until(pilot, lambda: app.screen is app.live)
        monkeypatch.undo()
        app.live.send(command)
        await can_answer(app, pilot)
        dialog, before = app.screen, shown(app)
        await pilot.press(*keys)
        await until(pilot, lambda: app.screen is not dialog or shown(app) != before)

    play(wire, scene, LARGE)


@pytest.mark.parametrize("after_s", [0.0, 0.7])
def test_words_typed_over_a_refusal_are_dropped_as_a_whole(wire: FakeWire, after_s: float):
    """Of /cloud the first key was eaten, and "c" with enter behind it moved the mount."""
    wire.outcomes["hold"] = Outcome(ok=False, message="no cloud now: 400 stars")

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        await pilot.press("w")
        await until(pilot, lambda: isinstance(app.screen, Dialog))
        await pilot.pause(after_s)
        dialog = app.screen
        for key in ("slash", "c", "l", "o", "u", "d"):
            await pilot.press(key)
            await pilot.pause(0.15)
        assert app.screen is dialog
        assert "no cloud now" in shown(app)
        await pilot.press("enter")
        await pilot.pause(dialogs.UNASKED_DEAF_S + 0.1)
        assert app.screen in {dialog, app.live}
        await pilot.press("enter")
        await until(pilot, lambda: dialog not in app.screen_stack)
        assert wire.verbs == ["hold"]

    play(wire, scene, LARGE)


def test_stop_is_never_dropped_with_the_keys_before_it(wire: FakeWire):
    wire.outcomes["hold"] = Outcome(ok=False, message="no cloud now: 400 stars")

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        await pilot.press("w")
        await until(pilot, lambda: isinstance(app.screen, Dialog))
        await pilot.press("slash", "c", "x")
        await until(pilot, lambda: wire.verbs == ["hold", "stop"])
        assert app.screen is app.live

    play(wire, scene, LARGE)


def test_what_stands_against_arming_is_said_once_and_ticks_are_kept(wire: FakeWire):
    wire.status |= IDLE
    checks = [
        {"name": "site", "ok": True, "detail": "equal", "remedy": ""},
        {"name": "sun", "ok": False, "detail": "the Sun stands high", "remedy": "wait 40 min"},
        {"name": "disk", "ok": False, "detail": "3 GB free", "remedy": "free 40 GB"},
    ]
    refused = "not armed. sun: the Sun stands high. If you answer for it: --override sun"
    wire.outcomes["arm"] = Outcome(ok=False, message=refused, data={"checks": checks})

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.holder == "nobody")
        await pilot.press("a")
        await until(pilot, lambda: isinstance(app.screen, ArmDialog))
        await until(pilot, lambda: isinstance(app.focused, Tick))
        assert "--override" not in shown(app)
        assert shown(app).count("the Sun stands high") == 1
        assert "well: site" in shown(app)
        await can_answer(app, pilot)
        await pilot.press("space")
        app.screen.query_one("#arm", Button).press()
        await until(pilot, lambda: wire.sent[-1] == ("arm", {"override": ["sun"]}))
        await until(pilot, lambda: isinstance(app.screen, ArmDialog))
        await until(pilot, lambda: len(app.screen.query(Tick)) == 2)
        assert [tick.is_on for tick in app.screen.query(Tick)] == [True, False]

    play(wire, scene)


def test_ctrl_z_gives_the_terminal_back_to_the_shell(
    wire: FakeWire, monkeypatch: pytest.MonkeyPatch
):
    suspended: list[bool] = []
    monkeypatch.setattr(ConsoleApp, "action_suspend_process", lambda _app: suspended.append(True))

    async def scene(_app: ConsoleApp, pilot: Pilot[str]) -> None:
        await pilot.press("ctrl+z")
        await until(pilot, lambda: bool(suspended))
        await asyncio.sleep(0)

    play(wire, scene)
