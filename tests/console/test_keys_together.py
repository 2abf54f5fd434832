"""Keys that arrive together, as over a slow line, end in the right field in the right order."""

import asyncio
import contextlib
import json
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from textual.command import CommandPalette
from textual.containers import VerticalScroll
from textual.events import Key
from textual.pilot import Pilot
from textual.widgets import Input

from rsoconsole.console.actions.second_press import REPEAT_S, SETTLES_S
from rsoconsole.console.app import ConsoleApp
from rsoconsole.console.commands.commands import SEAT_COMMANDS
from rsoconsole.console.commands.key_parser import KeyParser
from rsoconsole.console.dialogs.ask import AimDialog, ExposureDialog, GotoDialog, LineDialog
from rsoconsole.console.dialogs.candidates import RejectDialog
from rsoconsole.console.dialogs.dialogs import UNASKED_DEAF_S, ConfirmDialog, LeaveDialog
from rsoconsole.console.dialogs.session_list import SessionListDialog
from rsoconsole.console.dialogs.up_list import VisibleSatellitesDialog
from rsoconsole.console.panes.panes import MomentField
from rsoconsole.console.screens.live import LiveScreen
from rsoconsole.console.screens.review import ReviewScreen
from rsoconsole.control import Command, Outcome
from tests.rigs.seat_rig import FakeWire, can_answer, opened, pane, play, until
from tests.rigs.terminal import EVERY_S, Terminal

ESC, UP, ENTER, BACKSPACE = "\x1b", "\x1b[A", "\r", "\x7f"
CTRL_P, CTRL_X = "\x10", "\x18"
PATIENCE_S = 60.0
A_MOMENT_S = 0.4
"""In which a command that was sent would have been read."""
AGAIN_S = 10.0
SIZE = (120, 40)

# -- the real console in a real terminal -----------------------------------------------------------


class Seat:
    """The console in its terminal, and what it has sent."""

    def __init__(self, terminal: Terminal, sent: Path) -> None:
        self.terminal, self._file = terminal, sent
        self.known = 0

    def sent(self) -> list[list[Any]]:
        """The commands since the test began, but for previews."""
        lines = self._file.read_text(encoding="utf-8").splitlines() if self._file.exists() else []
        entries = [json.loads(line) for line in lines]
        return [each for each in entries if each[0] != "preview"][self.known :]

    def begin(self) -> None:
        """Count from here."""
        self.known = 0
        self.known = len(self.sent())

    def burst(self, keys: str) -> int:
        """Write these bytes at once; the length of what was shown before."""
        length = len(self.terminal.text)
        self.terminal.press(keys)
        return length

    def answer(self, key: str) -> None:
        """Press a key until it is taken: a busy machine notes late that the question is drawn."""
        deadline = time.monotonic() + PATIENCE_S
        while not self.sent():
            assert time.monotonic() < deadline, f"never taken: {key!r}"
            self.terminal.press(key)
            with contextlib.suppress(AssertionError):
                wait_for(lambda: bool(self.sent()), "an answer", AGAIN_S)


def wait_for(is_so: Callable[[], bool], what: str, seconds: float = PATIENCE_S) -> None:
    deadline = time.monotonic() + seconds
    while not is_so():
        assert time.monotonic() < deadline, f"never: {what}"
        time.sleep(EVERY_S)


@pytest.fixture(scope="module")
def terminal(told_night: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Seat]:
    folder = tmp_path_factory.mktemp("together")
    homes = {f"XDG_{name}_HOME": str(folder / name) for name in ("CONFIG", "DATA", "STATE")}
    config = {"RSOCONSOLE_CONFIG": str(folder / "config.toml")}
    environment = {**os.environ, **homes, **config, "LANG": "C.UTF-8", "LC_ALL": "C.UTF-8"}
    sent = folder / "sent"
    command = [sys.executable, "-m", "tests.rigs.made_up_console", str(told_night), str(sent)]
    with Terminal(command, environment, SIZE) as shown:
        wait_for(lambda: shown.shows("AUTO has the mount", "frame 0020"), "a console")
        yield Seat(shown, sent)


NOTED = ["note", {"text": "it is clear"}]
LIMIT = {"name": "filter.max_3sigma_arcmin", "value": 100.0}


@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        (f"n{NOTED[1]['text']}{ENTER}", [NOTED]),
        (f"none{ENTER}ntwo{ENTER}", [["note", {"text": "one"}], ["note", {"text": "two"}]]),
        (f"nno{ESC}n{NOTED[1]['text']}{ENTER}", [NOTED]),
        (f"{CTRL_P}note{ENTER}{NOTED[1]['text']}{ENTER}", [NOTED]),
        (f"g12{ESC}5ses{ESC}n{NOTED[1]['text']}{ENTER}", [NOTED]),
        (f"e7{ENTER}", [["set", {"name": "exposure.exposure_s", "value": 7.0}]]),
        (
            f"t{UP}90{ESC}100{ENTER}{ENTER}f12{ENTER}{ESC}",
            [["set", LIMIT], ["set", LIMIT | {"frames": 12}]],
        ),
    ],
    ids=["note", "two notes", "esc", "by name", "lists", "exposure", "digits"],
)
def test_keys_in_one_read_do_what_they_say(
    terminal: Seat, keys: str, expected: list[list[Any]]
) -> None:
    terminal.begin()
    terminal.burst(keys)
    wait_for(lambda: len(terminal.sent()) >= len(expected), f"what was typed: {terminal.sent()}")
    time.sleep(A_MOMENT_S)
    assert terminal.sent() == expected


def test_a_preset_is_kept_and_loaded_by_one_read_each(terminal: Seat) -> None:
    length = terminal.burst(f"twpaper{ENTER}")
    wait_for(lambda: terminal.terminal.shows("preset 'paper' is kept", since=length), "a preset")
    length = terminal.burst(f"opaper{ENTER}o{ESC}{ESC}/SEARCH{ENTER}")
    wait_for(lambda: terminal.terminal.shows("lines with 'SEARCH'", since=length), "a filter")
    length = terminal.burst(f"/{BACKSPACE}{ENTER}")
    wait_for(lambda: terminal.terminal.shows("log: every line", since=length), "no filter")


@pytest.mark.parametrize(
    ("keys", "asks", "answer", "verb"),
    [
        ("py", "park position", "y", "park"),
        (f"p{ENTER}y", "park position", "y", "park"),
        ("jj", "reject a measurement", "j", "reject"),
        (f"j{ENTER}", "reject a measurement", ENTER, "reject"),
        (f"gM31{ENTER}{ENTER}", "enter goes there", ENTER, "goto"),
        (f"{CTRL_P}park{ENTER}yy", "park position", "y", "park"),
    ],
)
def test_a_question_is_not_answered_by_what_was_typed_before_it_was_seen(
    terminal: Seat, keys: str, asks: str, answer: str, verb: str
) -> None:
    terminal.begin()
    length = terminal.burst(keys)
    wait_for(lambda: terminal.terminal.shows(asks, since=length), asks)
    time.sleep(A_MOMENT_S)
    assert terminal.sent() == []
    terminal.answer(answer)
    assert [each[0] for each in terminal.sent()] == [verb]


def test_the_engine_is_not_ended_by_two_keys_in_one_read(terminal: Seat) -> None:
    terminal.begin()
    length = terminal.burst("qs")
    wait_for(lambda: terminal.terminal.shows("leave the console", since=length), "the question")
    time.sleep(A_MOMENT_S)
    assert terminal.sent() == []
    length = terminal.burst(f"{ESC}n?{ENTER}")
    wait_for(lambda: [each[0] for each in terminal.sent()] == ["note"], "a console that goes on")


@pytest.mark.parametrize("keys", ["ss", "aaaa", UP * 2])
def test_a_track_is_not_ended_by_a_key_that_comes_twice_in_one_read(
    terminal: Seat, keys: str
) -> None:
    terminal.begin()
    length = terminal.burst(keys)
    wait_for(lambda: terminal.terminal.shows("held down", since=length), "what became of it")
    time.sleep(A_MOMENT_S + SETTLES_S)
    assert terminal.sent() == []


@pytest.mark.parametrize("keys", ["x", f"nno{CTRL_X}", f"g{ESC}x", f"p{CTRL_X}", "ax"])
def test_stop_acts_at_once_and_drops_what_was_typed_before_it(terminal: Seat, keys: str) -> None:
    terminal.begin()
    terminal.burst(keys)
    wait_for(lambda: bool(terminal.sent()), "STOP")
    time.sleep(A_MOMENT_S)
    assert [each[0] for each in terminal.sent()] == ["stop"]
    terminal.burst(f"n-{ENTER}")
    wait_for(lambda: [each[0] for each in terminal.sent()] == ["stop", "note"], "nothing is open")


# -- every key that opens something ----------------------------------------------------------------


def burst(app: ConsoleApp, *keys: str) -> None:
    """Hand keys to the application as a driver does that has read them together."""
    for key in keys:
        app.post_message(Key(key, key if len(key) == 1 else None))


FIELDS: dict[str, type] = {
    "n": LineDialog,
    "slash": LineDialog,
    "g": GotoDialog,
    "e": ExposureDialog,
    "i": AimDialog,
    "5": VisibleSatellitesDialog,
    "r": SessionListDialog,
    "ctrl+p": CommandPalette,
}


@pytest.mark.parametrize("key", FIELDS)
def test_a_word_goes_whole_into_the_field_that_its_first_key_opens(wire: FakeWire, key: str):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        burst(app, key, *"1234")
        await until(pilot, lambda: isinstance(app.screen, FIELDS[key]))
        await until(pilot, lambda: app.screen.query(Input).first().value.endswith("1234"))
        assert set(wire.verbs) <= {"preview"}

    play(wire, scene)


OPENERS = [
    command.keys.split(",")[0]
    for command in SEAT_COMMANDS
    if command.name
    in {
        *("goto", "up_now", "aim", "exposure", "park", "verdicts", "centre", "reject", "sessions"),
        *("note", "read", "filter_log", "leave", "help", "open_frame"),
    }
]


@pytest.mark.parametrize("key", [*OPENERS, "ctrl+p"])
def test_escape_behind_a_key_closes_what_the_key_opens(wire: FakeWire, key: str):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        seen: list[str] = []
        await until(pilot, lambda: app.live.engine.is_attached and bool(app.live.night.measured))
        app.screen_change_signal.subscribe(app.live, lambda s: seen.append(type(s).__name__))
        burst(app, key, "escape", "n", "1")
        await until(pilot, lambda: isinstance(app.focused, Input) and app.focused.value == "1")
        assert isinstance(app.screen, LineDialog)
        assert len(seen) == 3  # what the key opened, the screen again, the note
        assert len(app.screen_stack) == 3

    play(wire, scene)


def test_a_frame_typed_with_the_key_that_asks_for_it_is_gone_to_in_a_review(wire: FakeWire):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        review = app.root
        assert isinstance(review, ReviewScreen)
        await until(pilot, lambda: review.timeline.is_whole and review.moment is not None)
        burst(app, "g", *"12", "enter", "t", "1")
        await until(pilot, lambda: isinstance(app.screen, LineDialog))
        await until(pilot, lambda: review.moment.view.frame.frame_id == 12)
        assert not review.query_one(MomentField).display
        assert app.screen.query_one(Input).value == "1"

    session = Path(wire.status["session"])
    play_review(wire, scene, session)


def play_review(wire: FakeWire, scene: Callable[..., Any], session: Path) -> None:
    async def run() -> None:
        app = ConsoleApp(lambda: wire, review=(session, ""))
        async with opened(app, SIZE) as pilot:
            await scene(app, pilot)

    asyncio.run(run())


@pytest.mark.parametrize(
    ("keys", "dialog"),
    [("py", ConfirmDialog), ("ql", LeaveDialog), ("qs", LeaveDialog), ("j1", RejectDialog)],
)
def test_an_answer_counts_once_the_question_has_been_drawn(wire: FakeWire, keys: str, dialog: type):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached and bool(app.live.night.measured))
        burst(app, *keys)
        await until(pilot, lambda: isinstance(app.screen, dialog))
        await can_answer(app, pilot)
        await asyncio.sleep(UNASKED_DEAF_S)
        assert isinstance(app.screen, dialog)
        assert f"{keys[-1]} came before" in app.screen.query_one(VerticalScroll).border_subtitle
        await pilot.press(keys[-1])
        await until(pilot, lambda: not isinstance(app.screen, dialog))

    play(wire, scene)


def test_enter_before_the_way_is_shown_is_said_to_be_too_early(
    wire: FakeWire, monkeypatch: pytest.MonkeyPatch
):
    is_shown, send = threading.Event(), wire.send

    def late(command: Command, *arguments: Any, **named: Any) -> Outcome:
        if command.verb == "preview":
            is_shown.wait(PATIENCE_S)
        return send(command, *arguments, **named)

    monkeypatch.setattr(wire, "send", late)

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached and app.live.night.config)
        burst(app, "g", *"83.05 -4.87", "enter")
        await until(pilot, lambda: isinstance(app.screen, GotoDialog))
        box = app.screen.query_one(VerticalScroll)
        await until(pilot, lambda: "enter came before" in (box.border_subtitle or ""))
        is_shown.set()
        assert "goto" not in wire.verbs

    play(wire, scene)


def test_two_presses_that_came_together_are_no_two_presses_however_late_they_are_handled(
    wire: FakeWire,
):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        first, second = Key("s", "s"), Key("s", "s")
        app.post_message(first)
        await until(pilot, lambda: "s again within 2 s" in pane(app, "keys"))
        await asyncio.sleep(3.0 * REPEAT_S)
        second.time = first.time + 0.1 * REPEAT_S
        app.post_message(second)
        await until(pilot, lambda: "s is held down" in pane(app, "keys"))
        await asyncio.sleep(2.0 * SETTLES_S)
        assert wire.verbs == []

    play(wire, scene)


def test_stops_letter_acts_where_no_field_has_the_focus_yet(wire: FakeWire):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        burst(app, *"gM31x")
        await until(pilot, lambda: "stop" in wire.verbs)
        await asyncio.sleep(A_MOMENT_S)
        assert wire.verbs == ["stop"]
        assert app.screen is app.live

    play(wire, scene)


def test_stop_drops_a_key_that_is_on_its_way(wire: FakeWire, monkeypatch: pytest.MonkeyPatch):
    on_key = LiveScreen.on_key

    def stop_meanwhile(screen: LiveScreen, event: Key) -> None:
        on_key(screen, event)
        if event.key == "n":
            screen.app.action_stop()

    monkeypatch.setattr(LiveScreen, "on_key", stop_meanwhile)

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        burst(app, "n", "p")
        await until(pilot, lambda: wire.verbs == ["stop"])
        await asyncio.sleep(A_MOMENT_S)
        assert app.screen is app.live

    play(wire, scene)


def test_keys_behind_a_dialog_that_never_settles_come_through(
    wire: FakeWire, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("rsoconsole.console.app.SETTLES_WITHIN_S", 0.1)
    monkeypatch.setattr(ConsoleApp, "_is_searching", property(lambda _: True))

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        burst(app, "n", "1", "2")
        await until(pilot, lambda: isinstance(app.focused, Input) and app.focused.value == "12")

    play(wire, scene)


# -- an escape and what is behind it ---------------------------------------------------------------


@pytest.mark.parametrize(
    ("written", "keys"),
    [
        ("\x1b1", ["escape", "1"]),
        ("\x1b\r", ["escape", "enter"]),
        ("\x1bo", ["escape", "o"]),
        ("\x1b.\x1b\x1b.", ["escape", "full_stop", "escape", "escape", "full_stop"]),
        ("t1\x1b10\r", ["t", "1", "escape", "1", "0", "enter"]),
        ("\x1b[A1\x1b[120;3u", ["up", "1", "alt+x"]),
        ("\x1bx", ["alt+x"]),
        ("\x1b\x18", ["escape", "ctrl+x"]),
    ],
)
def test_an_escape_and_the_key_behind_it_are_two_keys(written: str, keys: list[str]):
    parser = KeyParser()
    events = [*parser.feed(written)]
    assert [event.key for event in events if isinstance(event, Key)] == keys
