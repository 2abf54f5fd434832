"""What each key of the seat tells the engine; every command has a key, help, and a place."""

import dataclasses
import threading
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from textual.pilot import Pilot
from textual.widgets import Button, Input, Static

from rsoconsole.base import ConfigError
from rsoconsole.config import Config, default_config_path
from rsoconsole.console.app import ConsoleApp
from rsoconsole.console.commands.commands import commands_in
from rsoconsole.console.commands.keymap import Orders, key_words, load_keymap
from rsoconsole.console.dialogs.help import help_text
from rsoconsole.console.panes.frame_pane import SIGHTS, FramePane
from rsoconsole.console.panes.log_pane import LogPane
from rsoconsole.console.screens.night_screen import ChangedPartsDrawer
from rsoconsole.control import Command, Hold, MarkByHand, Outcome
from rsoconsole.records import ChartStar, Detections, Event, NotSolved
from rsoconsole.session import SessionWriter
from tests.makers import NS
from tests.nights import made_up_night as night
from tests.rigs.seat_rig import (
    FRAMES,
    PATIENCE_S,
    PREVIEW,
    FakeWire,
    can_answer,
    click,
    pane,
    play,
    screen_text,
    until,
    written,
)

LARGE = (120, 40)
YOURS = {"state": "MANUAL", "holder": "operator"}
IDLE = {"state": "IDLE", "holder": "nobody"}
# -- the list of commands -----------------------------------------------------------------------


def test_every_command_has_an_action_a_key_words_and_a_place_in_help_and_palette(wire: FakeWire):
    async def scene(app: ConsoleApp, _pilot: Pilot[str]) -> None:
        titles = {command.title for command in app.get_system_commands(app.live)}
        text = help_text()
        for command in commands_in("live"):
            owner = app if command.is_everywhere else app.live
            does = getattr(owner, f"action_{command.name}", None)
            assert callable(does) != (command.sends is not None), command.name
            assert command.help
            assert command.title in text
            if command.name not in {"stop_by_letter", "put_away"}:
                assert command.title in titles
        bound = {binding.id for _, binding in app.live._bindings if binding.id}
        bound |= {binding.id for _, binding in app._bindings if binding.id}
        assert bound == {command.name for command in commands_in("live")}

    play(wire, scene)


def test_no_two_parts_of_a_screen_answer_the_same_key(wire: FakeWire):
    async def scene(app: ConsoleApp, _pilot: Pilot[str]) -> None:
        live = type(app.live)
        for name in (f"action_{command.name}" for command in commands_in("live")):
            owners = [each for each in live.__mro__ if name in vars(each)]
            # A screen may go on from what its part does; two parts know nothing of each other.
            assert all(issubclass(a, b) for a, b in pairwise(owners)), name
            parts = [part for part in (app.live.streaks, app.live.telescope) if hasattr(part, name)]
            assert len(parts) + bool(owners) <= 1, name

    play(wire, scene)


def test_what_is_drawn_from_several_facts_is_drawn_once_when_they_come_together(wire: FakeWire):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        live, drawn = app.live, []
        both, night_alone = (lambda: drawn.append("both")), (lambda: drawn.append("night"))
        app._engine_watch.close()
        app._session_watch.close()
        await pilot.pause(0.2)
        ChangedPartsDrawer(live, {both: ("night", "engine"), night_alone: ("night",)})
        live.night, live.engine = live.night, live.engine
        await until(pilot, lambda: bool(drawn))
        assert drawn == ["both", "night"]
        live.engine = live.engine
        await until(pilot, lambda: len(drawn) > 2)
        assert drawn[2:] == ["both"]

    play(wire, scene)


def test_no_key_does_two_things_and_none_needs_a_chord_that_terminals_lack():
    keys = [key for command in commands_in("live") for key in command.keys.split(",")]
    assert len(keys) == len(set(keys))
    assert not [
        key for key in keys if "shift+" in key or key in {"ctrl+enter", "f10", "f11", "f12"}
    ]
    assert key_words("f1,question_mark") == "F1 ?"
    assert key_words("ctrl+x") == "^x"


def test_a_keymap_gives_commands_other_keys(wire: FakeWire, tmp_path: Path):
    path = tmp_path / "keymap.toml"
    path.write_text('hold_or_resume = "f2"\nnote = "ctrl+n, f3"\n', encoding="utf-8")
    keymap = load_keymap(path)
    assert keymap == {"hold_or_resume": "f2", "note": "ctrl+n,f3"}

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        await pilot.press("h")
        await pilot.press("f2")
        await until(pilot, lambda: wire.verbs == ["hold"])
        await pilot.press("f1")
        await until(pilot, lambda: app.screen is not app.live)
        shown = str(app.screen.query_one(Static).render())
        assert "F2" in shown.upper()
        await pilot.press("escape")
        assert "f2 Hold" in pane(app, "keys")

    play(wire, scene, keymap=keymap)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('fly = "f"', "no command is called fly"),
        ('note = "g"', "g is both goto and note"),
        ("note = 3", "note needs a key as text"),
        ("note = ", "Invalid value"),
        ('stop = "f5"', "STOP keeps its keys"),
        ('stop_by_letter = "f6"', "STOP keeps its keys"),
        ('unpark = "x"', "x is both"),
        ('goto = "["', "left_square_bracket is both"),
        ('note = "ctrl+q"', "ctrl\\+q is Leave"),
        ('note = "enter"', "enter is for"),
        ('note = "crtl+r"', "there is no key"),
        ('note = "shift+r"', "there is no key"),
        ('note = "ctrl+i"', "tab to a terminal"),
        ('note = "g,"', "write it like"),
        ('note = "nosuch"', "there is no key 'nosuch'"),
    ],
)
def test_a_keymap_that_cannot_be_is_refused_with_the_reason(tmp_path: Path, text: str, words: str):
    path = tmp_path / "keymap.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=words):
        load_keymap(path)
    assert load_keymap(tmp_path / "none.toml") == {}
    assert default_config_path().name != "keymap.toml"


# -- keys that tell the engine something ---------------------------------------------------------


@pytest.mark.parametrize(
    ("key", "status", "verb", "arguments"),
    [
        ("w", {}, "hold", {"until": "clear"}),
        ("u", {"is_parked": True}, "unpark", {}),
        ("u", {"kept": "SES-10", "is_resumable": True} | IDLE, "resume", {}),
        ("h", {"kept": "SES-10", "is_resumable": True} | IDLE, "resume", {}),
        ("ctrl+u", {}, "unpark", {}),
        ("k", {"is_tracking": True}, "track", {"on": False}),
        ("k", {"is_tracking": False}, "track", {"on": True}),
        ("b", {}, "abort", {}),
        ("y", {}, "accept", {"frame": FRAMES}),
        ("s", {"state": "SEARCH"}, "seek", {}),
        ("d", {}, "choose", {"frame": FRAMES, "x": 2000.0, "y": 1500.0}),
        ("up", YOURS, "nudge", {"east_arcmin": 0.0, "north_arcmin": 1.0}),
        ("left", IDLE, "nudge", {"east_arcmin": -1.0, "north_arcmin": 0.0}),
    ],
)
def test_a_key_is_one_command(
    wire: FakeWire, key: str, status: dict[str, Any], verb: str, arguments: dict[str, Any]
):
    wire.status |= status

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        await until(
            pilot,
            lambda: all(getattr(app.live.engine, name) == status[name] for name in status),
        )
        await pilot.press(key)
        await until(pilot, lambda: bool(wire.sent))
        name, said = wire.sent[0]
        if verb == "nudge":
            # The picture of the made-up night is turned: what is up there is the plate's word.
            assert name == verb
            assert sum(value**2 for value in said.values()) == pytest.approx(1.0)
        else:
            assert (name, said) == (verb, arguments)

    play(wire, scene)


def test_up_is_the_same_way_where_clouds_hide_the_stars(wire: FakeWire):
    """The camera stays as it is: a frame that is not solved takes no direction away."""

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        live = app.live
        await until(pilot, lambda: live.picture is not None)
        before, picture = live._on_the_sky(0.0, -1.0), live.picture
        assert picture is not None
        live.picture = replace(picture, detail=replace(picture.detail, solution=None))
        await pilot.pause()
        assert live._on_the_sky(0.0, -1.0) == before != (0.0, 1.0)

    play(wire, scene)


@pytest.mark.parametrize("key", ["g", "e", "m", "n", "d", "y", "j", "s", "w", "u", "k", "b", "up"])
def test_a_seat_that_only_looks_tells_nobody_anything(wire: FakeWire, key: str):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        await pilot.press(key)
        await until(pilot, lambda: "only looks" in pane(app, "keys"))
        assert app.screen is app.live
        assert wire.verbs == []

    play(wire, scene, read_only=True)


def test_the_step_of_the_nudges_is_chosen_and_said(wire: FakeWire):
    wire.status |= YOURS

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.holder == "operator")
        await pilot.press("left_square_bracket")
        assert "nudge by 20″" in pane(app, "keys")
        await pilot.press("up")
        await until(pilot, lambda: wire.verbs == ["nudge"])
        length = sum(value**2 for value in wire.sent[0][1].values()) ** 0.5
        assert length == pytest.approx(20.0 / 60.0, abs=1e-5)
        for _ in range(9):
            await pilot.press("right_square_bracket")
        assert "nudge by 30′" in pane(app, "keys")

    play(wire, scene)


def test_a_nudge_up_moves_what_is_up_in_the_picture_to_the_middle(wire: FakeWire):
    """The plate says where up is on the sky."""

    wire.status |= YOURS

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        solution = app.live.picture.detail.solution
        # Through the plate: one pixel up from the reference pixel, in degrees of sky.
        cd = solution.wcs.cd
        await until(pilot, lambda: app.live.engine.holder == "operator")
        await pilot.press("up")
        await until(pilot, lambda: wire.verbs == ["nudge"])
        said = wire.sent[0][1]
        assert said["east_arcmin"] * -cd[3] == pytest.approx(said["north_arcmin"] * -cd[1])
        assert said["east_arcmin"] * -cd[1] + said["north_arcmin"] * -cd[3] > 0.0

    play(wire, scene)


# -- what is asked first --------------------------------------------------------------------------


async def typed_into_goto(app: ConsoleApp, pilot: Pilot[str], text: str) -> Static:
    """Open the dialog and type; where it says what it makes of that."""
    await pilot.press("g")
    await until(pilot, lambda: app.screen is not app.live)
    app.screen.query_one(Input).value = text
    return app.screen.query_one("#understood", Static)


def test_go_to_shows_the_way_before_anything_moves(wire: FakeWire):
    wire.outcomes["preview"] = Outcome(ok=True, data=PREVIEW)

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        said = await typed_into_goto(app, pilot, "83.05 -4.87")
        await until(pilot, lambda: "way" in str(said.render()))
        text = str(said.render())
        for words in ("RA and Dec, ICRS, in degrees", "alt 47.2 az 201.3", "12.4°, 9s"):
            assert words in text
        assert "to the east of the pier" in text
        assert "goto" not in wire.verbs
        await can_answer(app, pilot)
        await pilot.press("enter")
        await until(pilot, lambda: "goto" in wire.verbs)
        sent = dict(wire.sent[-1][1])
        assert sent == {"ra_icrs_deg": 83.05, "dec_icrs_deg": -4.87}

    play(wire, scene)


def test_a_move_that_is_refused_says_why_and_enter_does_nothing(wire: FakeWire):
    refusal = "altitude 3.1 deg, 15 at least"
    wire.outcomes["preview"] = Outcome(ok=True, data=PREVIEW | {"refused": refusal})

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        said = await typed_into_goto(app, pilot, "alt 3 az 180")
        await until(pilot, lambda: "REFUSED" in str(said.render()))
        assert refusal in str(said.render())
        await can_answer(app, pilot)
        await pilot.press("enter")
        app.screen.query_one(Input).value = "nowhere at all"
        await until(pilot, lambda: "no star known" in str(said.render()))
        await pilot.press("enter", "escape")
        await until(pilot, lambda: app.screen is app.live)
        assert "goto" not in wire.verbs

    play(wire, scene)


def test_exposure_and_cadence_are_taken_where_they_differ(wire: FakeWire):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        await pilot.press("e")
        await until(pilot, lambda: app.screen is not app.live)
        field = app.screen.query_one("#exposure-exposure_s", Input)
        assert float(field.value) == Config().exposure.exposure_s
        field.value = "ten"
        await pilot.press("enter")
        assert "is no number" in str(app.screen.query_one("#told", Static).render())
        field.value = "7.5"
        await pilot.press("enter")
        await until(pilot, lambda: wire.verbs == ["set"])
        assert wire.sent[0][1] == {"name": "exposure.exposure_s", "value": 7.5}

    play(wire, scene)


def test_a_note_goes_into_the_session(wire: FakeWire):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        await pilot.press("n")
        await until(pilot, lambda: app.screen is not app.live)
        await pilot.press(*"thin", "space", *"fog", "enter")
        await until(pilot, lambda: wire.sent == [("note", {"text": "thin fog"})])

    play(wire, scene)


def test_centring_shows_the_way_before_it_takes_the_mount_from_autonomy(wire: FakeWire):
    wire.outcomes["preview"] = Outcome(ok=True, data=PREVIEW)

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.holder == "autonomy")
        await pilot.press("c")
        await until(pilot, lambda: app.screen is not app.live)
        said = app.screen.query_one("#told", Static)
        await until(pilot, lambda: "12.4°, 9s" in str(said.render()))
        assert "this takes it" in str(said.render())
        assert wire.verbs == ["preview"]
        # Where it is now: it has gone on since its last frame.
        track = app.live.night.track
        since_s = (app.live.engine.now_utc_ns - track.t_utc_ns) / NS
        assert since_s > 5.0
        now_deg = track.x[0] + track.x[1] * since_s
        await can_answer(app, pilot)
        await pilot.press("enter")
        await until(pilot, lambda: wire.verbs == ["preview", "goto"])
        assert wire.sent[-1][1] == wire.sent[0][1]
        assert wire.sent[-1][1]["ra_icrs_deg"] == pytest.approx(now_deg, abs=1e-6)

    play(wire, scene)


def test_centring_that_is_refused_goes_nowhere(wire: FakeWire):
    wire.outcomes["preview"] = Outcome(ok=True, data=PREVIEW | {"refused": "a wall"})

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        await pilot.press("c")
        await until(pilot, lambda: app.screen is not app.live)
        said = app.screen.query_one("#told", Static)
        await until(pilot, lambda: "REFUSED  a wall" in str(said.render()))
        await can_answer(app, pilot)
        await pilot.press("enter", "escape")
        await until(pilot, lambda: app.screen is app.live)
        assert wire.verbs == ["preview"]

    play(wire, scene)


# -- a mark by hand --------------------------------------------------------------------------------


def test_a_streak_is_marked_with_arrows_and_enter(wire: FakeWire):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        await pilot.press("z")
        drawing = app.live.drawing
        assert drawing.px_per_square == 1.0
        await pilot.press("m")
        assert "mark the first end" in pane(app, "keys")
        assert "Leave off" in pane(app, "keys")
        await pilot.press("left", "left", "enter", *["right"] * 7, "down", "enter")
        await until(pilot, lambda: wire.verbs == ["mark"])
        said = wire.sent[0][1]
        window = drawing.window
        middle = window.x0_px + window.width_px / 2.0, window.y0_px + window.height_px / 2.0
        assert said["frame"] == FRAMES
        assert said["x_a"] == pytest.approx(middle[0] - 2.0, abs=0.6)
        assert said["x_b"] - said["x_a"] == pytest.approx(7.0)
        assert said["y_b"] - said["y_a"] == pytest.approx(1.0)
        assert said["sigma_px"] == 1.0
        assert app.live.marking is None

    play(wire, scene, LARGE)


@pytest.mark.parametrize("size", [(80, 24), LARGE, (200, 60)])
def test_a_mark_begins_in_the_close_up_and_in_the_field_where_there_is_none(
    wire: FakeWire, writer: SessionWriter, size: tuple[int, int]
):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        while app.live.drawing.px_per_square < 10.0:
            await pilot.press("z")  # to the field
        await pilot.press("m")
        window = app.live.drawing.window
        assert window.width_px <= 256.0
        x_px, y_px = app.live.marking.cursor_px
        assert window.x0_px < x_px < window.x0_px + window.width_px
        assert (x_px, y_px) == pytest.approx((2000.0, 1500.0), abs=4.0)
        await pilot.press("escape")
        app.live.picture = dataclasses.replace(app.live.picture, closeup=None, place=None)
        await pilot.press("m")
        assert app.live.drawing.window.width_px == 4656.0
        assert app.live.marking.px_per_square > 10.0

    play(wire, scene, size)


def test_in_a_frame_that_was_not_solved_no_mark_is_begun(wire: FakeWire, writer: SessionWriter):
    """It says so at the first key, and not after both ends."""
    number = FRAMES + 1
    writer.append(night.taken(number, 150.0, -5.0), night.t_of(number))
    found = Detections(frame_id=number, width_px=4656, height_px=3520, detections=())
    writer.append(found, night.t_of(number))
    cloud = NotSolved(frame_id=number, reason="4 stars, 8 needed", ms=1.0)
    writer.append(cloud, night.t_of(number))
    night.add_previews(writer, range(number, number + 1))

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        await until(pilot, lambda: app.live.picture.frame_id == number)
        await pilot.press("m")
        assert app.live.marking is None
        assert "not solved (4 stars, 8 needed)" in screen_text(app)
        assert wire.sent == []

    play(wire, scene, LARGE)


def test_a_mark_is_made_while_the_operator_has_the_mount(wire: FakeWire):
    wire.status |= YOURS

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.holder == "operator")
        assert "m Mark" in pane(app, "keys")
        await pilot.press("m", "enter", *["right"] * 5, "enter")
        await until(pilot, lambda: wire.verbs == ["mark"])

    play(wire, scene, LARGE)


def test_the_engine_has_time_to_read_a_frames_pixels_before_it_answers_a_mark(
    monkeypatch: pytest.MonkeyPatch, wire: FakeWire
):
    """From a slow card, a compressed frame takes longer than any other answer."""
    given: dict[str, float] = {}
    plain = wire.send

    def send(command: Command, *, timeout_s: float = 5.0) -> Outcome:
        given[command.verb] = timeout_s
        return plain(command, timeout_s=timeout_s)

    monkeypatch.setattr(wire, "send", send)
    come = threading.Event()
    orders = Orders(lambda: wire)
    orders.send(Hold(), lambda _: come.set())
    assert come.wait(PATIENCE_S)
    come.clear()
    orders.send(MarkByHand(x_a_px=1.0, y_a_px=1.0, x_b_px=9.0, y_b_px=1.0), lambda _: come.set())
    assert come.wait(PATIENCE_S)
    assert given["mark"] >= 20.0 > given["hold"]


def test_before_a_mark_replaces_what_is_known_better_both_are_shown(wire: FakeWire):
    asks = {
        "asks": "replaces",
        "sigma_arcsec": 118.0,
        "better_arcsec": 0.3,
        "how": "no light stands out beneath it",
    }
    wire.outcomes["mark"] = Outcome(ok=False, message="yours is worse", data=asks)

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        for answer in ("escape", "enter"):
            await pilot.press("m", "enter", *["right"] * 5, "enter")
            await until(pilot, lambda: app.screen is not app.live)
            await can_answer(app, pilot)
            words = " ".join(str(each.render()) for each in app.screen.query(Static))
            assert "good to ±2.0′: no light stands out" in words
            assert "to ±0.30″" in words
            if answer == "enter":
                wire.outcomes["mark"] = Outcome(ok=True, message="taken up")
            sent = len(wire.sent)
            await pilot.press(answer)
            await until(pilot, lambda: app.screen is app.live)
            assert len(wire.sent) == sent or answer == "enter"
        await until(pilot, lambda: len(wire.sent) == 3)
        assert [said.get("replaces") for _, said in wire.sent] == [None, None, True]

    play(wire, scene, LARGE)


@pytest.mark.parametrize(
    ("keys", "frame"), [(["j"], FRAMES), (["3"], FRAMES - 2), (["enter"], FRAMES)]
)
def test_a_measurement_is_rejected_by_its_number(wire: FakeWire, keys: list[str], frame: int):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        await pilot.press("j")
        await can_answer(app, pilot)
        lines = [str(button.label) for button in app.screen.query(Button)]
        assert lines[0].startswith(f"1  frame {FRAMES:04d}  02:22:50Z")
        assert "detector" in lines[0]
        assert "±1.00″" in lines[0]
        assert "NIS" in lines[0]
        await pilot.press(*keys)
        await until(pilot, lambda: bool(wire.sent))
        assert wire.sent == [("reject", {"frame": frame})]

    play(wire, scene, LARGE)


def test_what_was_said_last_is_taken_back(wire: FakeWire):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        await pilot.press("backspace")
        await until(pilot, lambda: bool(wire.sent))
        assert wire.sent == [("take_back", {})]

    play(wire, scene)


def test_a_mark_stays_in_its_own_frame_while_newer_ones_come(wire: FakeWire, writer: SessionWriter):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        await pilot.press("m", "enter")
        night.add_frames(writer, range(FRAMES + 1, FRAMES + 2))
        night.add_previews(writer, range(FRAMES + 1, FRAMES + 2))
        await until(pilot, lambda: app.live.newer_picture is not None)
        assert f"frame {FRAMES:04d}" in screen_text(app)
        await pilot.press(*["right"] * 5)
        assert "a newer frame waits" in pane(app, "keys")
        await pilot.press("enter")
        await until(pilot, lambda: wire.verbs == ["mark"])
        assert wire.sent[0][1]["frame"] == FRAMES
        await until(pilot, lambda: f"frame {FRAMES + 1:04d}" in screen_text(app))

    play(wire, scene, LARGE)


def test_a_mark_is_left_off_when_another_session_begins(
    wire: FakeWire, writer: SessionWriter, tmp_path: Path
):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        await pilot.press("m", "enter")
        night.add_frames(writer, range(FRAMES + 1, FRAMES + 2))
        night.add_previews(writer, range(FRAMES + 1, FRAMES + 2))
        await until(pilot, lambda: app.live.newer_picture is not None)
        other = written(tmp_path / "another")
        wire.status["session"] = str(other.folder)
        await until(pilot, lambda: app.live.night.folder == other.folder)
        assert app.live.marking is None
        assert app.live.newer_picture is None
        await until(pilot, lambda: app.live.picture is not None)
        await pilot.press("enter")
        assert wire.verbs == []
        other.close()

    play(wire, scene)


def test_a_mark_is_as_sure_as_the_coarser_view_of_its_two_ends(wire: FakeWire):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        await pilot.press("z", "m", "enter")
        assert app.live.marking.px_per_square == 1.0
        await pilot.press("z")
        square = app.live.drawing.px_per_square
        assert app.live.marking.px_per_square == square > 10.0
        await pilot.press("right", "enter")
        await until(pilot, lambda: wire.verbs == ["mark"])
        assert wire.sent[0][1]["sigma_px"] == square

    play(wire, scene, LARGE)


def test_a_shifted_arrow_goes_further(wire: FakeWire):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        await pilot.press("m")
        before = app.live.marking.cursor_px[0]
        await pilot.press("shift+right", "right")
        moved = app.live.marking.cursor_px[0] - before
        assert moved == pytest.approx(6 * app.live.marking.px_per_square)

    play(wire, scene)


def test_a_held_arrow_sends_one_nudge_at_a_time(wire: FakeWire):
    wire.hangs["nudge"] = threading.Event()

    wire.status |= YOURS

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.holder == "operator")
        await pilot.press(*["up"] * 5)
        await until(pilot, lambda: wire.verbs == ["nudge"])
        wire.hangs["nudge"].set()
        await until(pilot, lambda: "nudge: done" in pane(app, "keys"))
        await pilot.press("up")
        await until(pilot, lambda: wire.verbs == ["nudge", "nudge"])

    play(wire, scene)


def test_verdicts_tell_what_became_of_each_streak(wire: FakeWire):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        await pilot.press("v")
        await until(pilot, lambda: app.screen is not app.live)
        text = str(app.screen.query_one(Static).render())
        assert "followed" in text
        assert "at 2000, 1500" in text
        await pilot.press("escape")
        assert app.screen is app.live

    play(wire, scene, read_only=True)


def test_looking_beside_the_prediction_is_shown_first_then_set(wire: FakeWire):
    wire.outcomes["preview"] = Outcome(ok=True, data=PREVIEW)

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        await pilot.press("i")
        await until(pilot, lambda: app.screen is not app.live)
        app.screen.query_one("#aim-lead_s", Input).value = "20"
        said = app.screen.query_one("#told", Static)
        await until(pilot, lambda: "12.4°, 9s" in str(said.render()))
        assert "from the next exposure on" in str(said.render())
        asked = {"lead_s": 20.0, "along_arcmin": 0.0, "across_arcmin": 0.0}
        assert wire.sent[-1] == ("preview", asked)
        await pilot.press("enter")
        await until(pilot, lambda: wire.sent[-1][0] == "set")
        assert wire.sent[-1][1] == {"name": "aim.lead_s", "value": 20.0}

    play(wire, scene)


def test_an_answer_without_a_preview_is_told_and_goes_nowhere(wire: FakeWire):
    wire.outcomes["preview"] = Outcome(ok=True, data={"way_deg": 3.0})

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        said = await typed_into_goto(app, pilot, "83.05 -4.87")
        await until(pilot, lambda: "cannot be read" in str(said.render()))
        await pilot.press("enter", "escape")
        assert "goto" not in wire.verbs

    play(wire, scene)


def test_where_the_sky_stands_is_asked_again_when_one_goes(wire: FakeWire):
    wire.outcomes["preview"] = Outcome(ok=True, data=PREVIEW)

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        said = await typed_into_goto(app, pilot, "alt 47 az 201")
        await until(pilot, lambda: "way" in str(said.render()))
        first = dict(wire.sent[-1][1])
        now_ns = wire.status["now_utc_ns"] + 600 * NS
        wire.status["now_utc_ns"] = now_ns
        await until(pilot, lambda: app.live.engine.now_utc_ns == now_ns)
        await pilot.press("enter")
        await until(pilot, lambda: wire.sent[-1][0] == "goto")
        turned = wire.sent[-1][1]["ra_icrs_deg"] - first["ra_icrs_deg"]
        assert turned == pytest.approx(2.5, abs=0.02)

    play(wire, scene)


def test_a_cadence_shorter_than_the_exposure_is_not_taken(wire: FakeWire):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        await pilot.press("e")
        await until(pilot, lambda: app.screen is not app.live)
        app.screen.query_one("#exposure-exposure_s", Input).value = "60"
        await pilot.press("enter")
        assert "longer than the exposure" in str(app.screen.query_one("#told", Static).render())
        assert wire.verbs == []

    play(wire, scene)


def test_esc_leaves_a_mark_off_and_arrows_nudge_again(wire: FakeWire):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        await pilot.press("m", "right", "enter", "escape")
        assert app.live.marking is None
        assert wire.verbs == []
        wire.status |= YOURS
        await until(pilot, lambda: app.live.engine.holder == "operator")
        await pilot.press("right")
        await until(pilot, lambda: wire.verbs == ["nudge"])

    play(wire, scene)


def test_a_mark_is_drawn_with_the_mouse(wire: FakeWire):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        await pilot.press("m")
        await pilot.mouse_down("#frame", offset=(20, 6))
        await pilot.mouse_up("#frame", offset=(30, 8))
        await until(pilot, lambda: wire.verbs == ["mark"])
        said = wire.sent[0][1]
        square = app.live.query_one("#frame", FramePane).drawing.px_per_square
        assert said["x_b"] - said["x_a"] == pytest.approx(10 * square, rel=0.01)
        assert said["y_b"] - said["y_a"] == pytest.approx(4 * square, rel=0.05)

    play(wire, scene)


def test_a_click_on_the_followed_streak_says_so(wire: FakeWire):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        window = app.live.query_one("#frame", FramePane).drawing.window
        column, row = window.cell(2000.0, 1500.0)
        await pilot.click("#frame", offset=(column, row + 1))
        await until(pilot, lambda: "is followed already" in pane(app, "keys"))
        assert wire.verbs == []

    play(wire, scene)


# -- what is seen ----------------------------------------------------------------------------------


def test_the_keys_of_the_last_line_are_buttons_too(wire: FakeWire):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await click(app, pilot, "h Hold")
        await until(pilot, lambda: wire.verbs == ["hold"])
        await click(app, pilot, "x STOP")
        await until(pilot, lambda: wire.verbs == ["hold", "stop"])
        await pilot.click("#keys", offset=(0, 0))
        assert wire.verbs == ["hold", "stop"]

    play(wire, scene, LARGE)


def test_zoom_and_stretch_go_round(wire: FakeWire):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        for sight in (SIGHTS[2], *SIGHTS[:2]):
            await pilot.press("z")
            assert f"picture: {sight}" in pane(app, "keys")
            title = screen_text(app).splitlines()[app.live.picture_panes()[0].region.y]
            assert ("close-up" in title) is (sight != "field")
        for stretch in ("asinh", "linear", "streaks"):
            await pilot.press("f")
            assert f"stretch: {stretch}" in pane(app, "keys")
            assert (f"· {stretch}" in screen_text(app)) is (stretch != "streaks")

    play(wire, scene, LARGE)


def test_the_field_is_a_chart_and_f_shows_its_pixels(wire: FakeWire, writer: SessionWriter):
    stars = [ChartStar(100.0 + 400.0 * k, 150.0 + 300.0 * k, 900.0 * 2.0**k) for k in range(11)]
    night.add_frames(writer, range(FRAMES + 1, FRAMES + 2))
    night.add_previews(writer, range(FRAMES + 1, FRAMES + 2), stars)

    def field(app: ConsoleApp) -> str:
        pane_of_it = app.live.picture_panes()[1]
        return "".join(pane_of_it.render_line(y).text for y in range(pane_of_it.size.height))

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.picture is not None and app.live.picture.has_chart)
        await until(pilot, lambda: field(app).count("✶") >= 1)
        assert not set(field(app)) & set("▖▗▘▝▚▞█▌▐")
        assert "[─]" in field(app) or "[──]" in field(app)
        for look in ("stretch: streaks", "stretch: asinh", "stretch: linear"):
            await pilot.press("f")
            assert look in pane(app, "keys")
            assert set(field(app)) & set("▖▗▘▝▚▞█▌▐")
        await pilot.press("f")
        assert "field: chart" in pane(app, "keys")
        assert "✶" in field(app)
        await pilot.press("m")  # what was missed is on no chart
        assert set(field(app)) & set("▖▗▘▝▚▞█▌▐")

    play(wire, scene, LARGE)


def test_the_log_is_filtered_by_words(wire: FakeWire, writer: SessionWriter):
    writer.append(Event(level="info", text="the dome has opened"), night.t_of(FRAMES))
    assert writer.flush()

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: "dome" in screen_text(app))
        await pilot.press("slash")
        await until(pilot, lambda: app.screen is not app.live)
        await pilot.press(*"DOME", "enter")
        await until(pilot, lambda: app.screen is app.live)
        assert "the dome has opened" in screen_text(app)
        assert "log: 'DOME' · / changes, esc clears" in screen_text(app)  # stays, unlike the notice
        log = app.live.query_one("#log", LogPane)
        routine = [line for line in log.lines if line.kind != "StateChange"]
        shown = {line.text for line in log.found}
        assert any("TRACK → COAST" in text for text in shown)  # what happens passes every filter
        assert len(shown) == len({line.text for line in log.lines} - {r.text for r in routine}) + 1
        await pilot.press("escape")
        await pilot.pause()
        assert "esc clears" not in screen_text(app)
        assert log.found == tuple(reversed(log.lines))

    play(wire, scene)


def test_colours_go_round_and_the_night_has_no_bright_one(wire: FakeWire):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        seen = [app.theme]
        for _ in range(4):
            await pilot.press("ctrl+t")
            await pilot.pause()
            seen.append(app.theme)
            if app.theme == "night":
                strips = app.live._compositor.render_strips()
                for strip in strips:
                    for segment in strip:
                        _nothing_but_red(segment.style)
        assert len(set(seen)) == 5

    play(wire, scene, LARGE)


def _nothing_but_red(style: Any) -> None:
    for colour in (style.color, style.bgcolor) if style is not None else ():
        if colour is not None and colour.triplet is not None:
            red, green, blue = colour.triplet
            assert green <= 0.45 * red + 8, colour
            assert blue <= 0.45 * red + 8, colour


def test_what_was_set_is_known_from_the_record(wire: FakeWire, writer: SessionWriter):
    from rsoconsole.records import ParameterChange

    change = ParameterChange(name="exposure.exposure_s", before=10.0, after=7.5, by="operator")
    writer.append(change, night.t_of(FRAMES))
    assert writer.flush()

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.night.setting("exposure.exposure_s") == 7.5)
        assert app.live.night.setting("detector.tau") == Config().detector.tau
        assert app.live.night.setting("no.such") is None
        assert dataclasses.replace(app.live.night, config=None).setting("detector.tau") is None

    play(wire, scene)
