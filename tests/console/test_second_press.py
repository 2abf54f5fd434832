"""A running track is ended by no stray key and by no click; STOP stays one key."""

import asyncio

import pytest
from textual.pilot import Pilot

from rsoconsole.console.actions.second_press import (
    RELEASED_S,
    REPEAT_S,
    SETTLES_S,
    WITHIN_S,
    SecondPress,
)
from rsoconsole.console.app import ConsoleApp
from rsoconsole.console.dialogs.dialogs import ConfirmDialog
from rsoconsole.console.panes.frame_pane import FramePane
from rsoconsole.console.panes.last_line import Key
from rsoconsole.session import SessionWriter
from tests.nights import made_up_night as night
from tests.rigs.seat_rig import FRAMES, FakeWire, click, pane, play, until

LARGE = (120, 40)
NAMED = {"target": "INTELSAT 14"}


async def twice(pilot: Pilot[str], key: str) -> None:
    """As a person does it who means it."""
    await pilot.press(key)
    await asyncio.sleep(2 * REPEAT_S)
    await pilot.press(key)


@pytest.mark.parametrize("state", ["TRACK", "COAST"])
@pytest.mark.parametrize(
    ("key", "verb", "does"),
    [
        ("a", "disarm", "ends the track of INTELSAT 14 ("),
        ("s", "seek", "gives up the track of INTELSAT 14 ("),
        ("up", "nudge", "takes the mount from AUTO (h gives it back)"),
        ("left", "nudge", "takes the mount from AUTO (h gives it back)"),
    ],
)
def test_one_press_says_what_would_end_and_a_second_one_ends_it(
    wire: FakeWire, state: str, key: str, verb: str, does: str
):
    wire.status |= NAMED | {"state": state}

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.state == state)
        await pilot.press(key)
        await until(pilot, lambda: f"again within 2 s {does}" in pane(app, "keys"))
        await asyncio.sleep(SETTLES_S)
        assert wire.verbs == []
        await pilot.press(key)
        await until(pilot, lambda: wire.verbs == [verb])

    play(wire, scene, LARGE)


def test_a_second_press_of_another_key_or_too_late_ends_nothing(wire: FakeWire):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        await pilot.press("a")
        await pilot.press("s")
        await asyncio.sleep(2 * REPEAT_S)
        await pilot.press("a")
        await asyncio.sleep(WITHIN_S + SETTLES_S)
        await pilot.press("a")
        await asyncio.sleep(2 * SETTLES_S)
        assert wire.verbs == []
        await pilot.press("x")
        await until(pilot, lambda: wire.verbs == ["stop"])

    play(wire, scene)


def test_a_key_held_down_is_no_second_press():
    pressed, now_s = SecondPress(), 100.0
    assert pressed.receive("a", now_s) == "asked"
    # The first repeat comes late, as a second press would; those behind it tell.
    assert pressed.receive("a", now_s + 0.5) == "acts"
    number = pressed.number
    heard = [pressed.receive("a", now_s + 0.5 + 0.033 * n) for n in range(1, 40)]
    assert set(heard) == {"held"}
    assert pressed.number != number  # so what the second press led to is off
    slow = [pressed.receive("a", now_s + 1.8 + 0.12 * n) for n in range(1, 20)]
    assert set(slow) == {"held"}
    assert pressed.receive("a", now_s + 4.2 + RELEASED_S) == "asked"


@pytest.mark.parametrize("key", ["a", "s", "up"])
def test_a_second_press_that_still_waits_is_never_carried_out_after_stop(wire: FakeWire, key: str):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        await twice(pilot, key)
        await pilot.press("x")
        await asyncio.sleep(2 * SETTLES_S)
        assert wire.verbs == ["stop"]
        await pilot.press(key)  # and what was asked before STOP is asked again
        await asyncio.sleep(2 * SETTLES_S)
        assert wire.verbs == ["stop"]
        assert f"{'↑' if key == 'up' else key} again within 2 s" in pane(app, "keys")

    play(wire, scene)


def test_another_key_calls_off_a_second_press_that_still_waits(wire: FakeWire):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        await twice(pilot, "up")
        await pilot.press("z")
        await asyncio.sleep(2 * SETTLES_S)
        assert wire.verbs == []

    play(wire, scene)


def test_a_press_that_was_meant_for_disarming_never_arms(wire: FakeWire):
    at_rest = {"state": "IDLE", "holder": "nobody"}

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        await pilot.press("a")
        await until(pilot, lambda: "a again within 2 s ends" in pane(app, "keys"))
        wire.status |= at_rest  # somebody else has disarmed it meanwhile
        await until(pilot, lambda: app.live.engine.holder == "nobody")
        await pilot.press("a")
        await until(pilot, lambda: "not armed: a was Disarm a moment ago" in pane(app, "keys"))
        wire.status |= {"state": "SEARCH", "holder": "autonomy"}
        await until(pilot, lambda: app.live.engine.holder == "autonomy")
        await pilot.press("a")
        await until(pilot, lambda: wire.verbs == ["disarm"])
        wire.status |= at_rest
        await until(pilot, lambda: app.live.engine.holder == "nobody")
        await pilot.press("a", "a")
        assert wire.verbs == ["disarm"]
        await asyncio.sleep(WITHIN_S)
        await pilot.press("a")
        await until(pilot, lambda: wire.verbs == ["disarm", "arm"])

    play(wire, scene, LARGE)


def test_a_click_asks_and_never_acts(wire: FakeWire):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: "a Disarm" in pane(app, "keys"))
        for _ in range(3):
            await click(app, pilot, "a Disarm")
            await asyncio.sleep(2 * REPEAT_S)
        assert "a twice within 2 s ends the track" in pane(app, "keys")
        await asyncio.sleep(SETTLES_S)
        assert wire.verbs == []
        await pilot.press("a")  # the click was no first press either
        await until(pilot, lambda: "a again within 2 s ends the track" in pane(app, "keys"))
        await asyncio.sleep(2 * SETTLES_S)
        assert wire.verbs == []
        await click(app, pilot, "a Disarm")
        await pilot.press("a")
        await asyncio.sleep(2 * SETTLES_S)
        assert wire.verbs == []
        await click(app, pilot, "p Park")
        await until(pilot, lambda: isinstance(app.screen, ConfirmDialog))
        assert "This ends the track of" in " ".join(
            str(each.render()) for each in app.screen.query("Static")
        )
        await pilot.press("escape")
        wire.status |= {"state": "IDLE", "holder": "nobody"}
        await until(pilot, lambda: "a Arm" in pane(app, "keys"))
        await click(app, pilot, "a Arm")
        assert "by the key alone" in pane(app, "keys")
        assert wire.verbs == []

    play(wire, scene, LARGE)


def test_another_streak_is_followed_by_two_presses_and_by_no_number_of_clicks(
    wire: FakeWire, monkeypatch: pytest.MonkeyPatch
):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        # As if the track had taken another one of the frame.
        monkeypatch.setattr(app.live.streaks, "is_followed", lambda _streak: False)
        streak, known = app.live.streaks.streaks()[0], 0
        await pilot.press("d")
        await until(pilot, lambda: "d again within 2 s leaves" in pane(app, "keys"))
        assert len(wire.sent) == known
        await asyncio.sleep(2 * REPEAT_S)
        await pilot.press("d")
        await until(pilot, lambda: len(wire.sent) == known + 1)
        assert wire.sent[-1][1]["x"] == streak.x_px
        window = app.live.query_one("#frame", FramePane).drawing.window
        column, row = window.cell(streak.x_px, streak.y_px)
        for _ in range(3):
            await pilot.click("#frame", offset=(column, row + 1))
            await until(pilot, lambda: "d twice within 2 s leaves" in pane(app, "keys"))
            await asyncio.sleep(2 * REPEAT_S)
        await asyncio.sleep(2 * SETTLES_S)
        assert len(wire.sent) == known + 1

    play(wire, scene, LARGE)


def test_the_key_after_a_click_means_the_streak_that_was_clicked_in_its_frame(
    wire: FakeWire, writer: SessionWriter, monkeypatch: pytest.MonkeyPatch
):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        monkeypatch.setattr(app.live.streaks, "is_followed", lambda _streak: False)
        streak = app.live.streaks.streaks()[0]
        window = app.live.query_one("#frame", FramePane).drawing.window
        column, row = window.cell(streak.x_px, streak.y_px)
        await pilot.click("#frame", offset=(column, row + 1))
        await until(pilot, lambda: "d twice within 2 s leaves" in pane(app, "keys"))
        night.add_frames(writer, range(FRAMES + 1, FRAMES + 2))
        night.add_previews(writer, range(FRAMES + 1, FRAMES + 2))
        await until(pilot, lambda: app.live.picture.frame_id == FRAMES + 1)
        await pilot.press("d")
        said = f"for a streak of frame {FRAMES:04d}"
        await until(pilot, lambda: said in " ".join(pane(app, "keys").split()))
        await asyncio.sleep(2 * REPEAT_S)
        await pilot.press("d")
        await until(pilot, lambda: len(wire.sent) == 1)
        assert (wire.sent[0][1]["frame"], wire.sent[0][1]["x"]) == (FRAMES, streak.x_px)

    play(wire, scene, LARGE)


def test_where_nothing_is_followed_a_click_asks_for_the_key(
    wire: FakeWire, monkeypatch: pytest.MonkeyPatch
):
    wire.status |= {"state": "ACQUIRE"}

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.state == "ACQUIRE")
        monkeypatch.setattr(app.live.streaks, "is_followed", lambda _streak: False)
        streak = app.live.streaks.streaks()[0]
        window = app.live.query_one("#frame", FramePane).drawing.window
        column, row = window.cell(streak.x_px, streak.y_px)
        await pilot.click("#frame", offset=(column, row + 1))
        await until(pilot, lambda: "d within 8 s follows this streak" in pane(app, "keys"))
        await pilot.click("#frame", offset=(column, row + 1))
        await asyncio.sleep(2 * SETTLES_S)
        assert wire.verbs == []
        await pilot.press("d")
        await until(pilot, lambda: wire.verbs == ["choose"])
        assert wire.sent[0][1]["x"] == streak.x_px

    play(wire, scene, LARGE)


def test_what_is_kept_is_offered_where_it_can_be_followed_again(wire: FakeWire):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        wire.status |= {"state": "IDLE", "holder": "nobody", "kept": "SES-10", "is_resumable": True}
        await until(pilot, lambda: "SES-10 kept: u follows it again" in pane(app, "top"))
        await pilot.press("h")
        await until(pilot, lambda: wire.verbs == ["resume"])
        wire.status |= {"state": "COAST", "holder": "autonomy", "kept": None}
        await until(pilot, lambda: app.live.engine.state == "COAST")
        wire.status |= {"state": "SEARCH", "kept": "SES-10"}
        await until(pilot, lambda: "SES-10 kept: u follows it again" in pane(app, "top"))
        keys: list[Key] = app.live.keys
        assert ("u", "Follow again") in [key[:2] for key in keys]
        await pilot.press("u")
        await until(pilot, lambda: wire.verbs == ["resume", "resume"])
        wire.status |= {"state": "MANUAL", "holder": "operator", "is_resumable": True}
        await until(pilot, lambda: "SES-10 kept: u follows it again" in pane(app, "top"))
        wire.status |= {"kept": None, "ra": None}
        await until(pilot, lambda: "nothing kept: h searches again" in pane(app, "top"))
        # Nothing is there to be undone: no search may begin, which would slew.
        await pilot.press("u")
        await until(pilot, lambda: "nothing is kept" in pane(app, "keys"))
        assert wire.verbs == ["resume", "resume"]
        wire.status |= {"is_resumable": False}
        await until(pilot, lambda: "nothing kept: a hands it over" in pane(app, "top"))
        wire.status |= {"state": "SEARCH", "holder": "autonomy"}
        await until(pilot, lambda: "kept" not in pane(app, "top"))
        await pilot.press("u")
        await until(pilot, lambda: "nothing is kept" in pane(app, "keys"))

    play(wire, scene, LARGE)
