"""States of engine, session and terminal: no console crashes in one, and each is shown or said.

Where it matters what the terminal gets, the console runs in a real one; where it matters how the
screen lies, under a pilot.
"""

import contextlib
import dataclasses
import io
import json
import os
import re
import shutil
import signal
import sqlite3
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from textual.pilot import Pilot

from rsoconsole.base import RsoconsoleError, SessionError
from rsoconsole.console import run_console
from rsoconsole.console.app import ConsoleApp, command_action, is_utf8
from rsoconsole.console.commands.commands import COMMANDS, commands_in
from rsoconsole.console.drawing.plot import Line
from rsoconsole.console.panes.panes import NOT_DRAWN
from rsoconsole.control import ControlServer, Outcome, Request
from rsoconsole.records import Event
from rsoconsole.session import SessionWriter
from rsoconsole.simulator import start_observatory
from rsoconsole.simulator.launch import Observatory
from rsoconsole.simulator.server import ObservatorySettings, ObservatorySetup
from tests.makers import NS
from tests.nights import made_up_night as night
from tests.rigs.seat_rig import (
    FRAMES,
    STOPPED,
    FakeWire,
    has_outlook,
    pane,
    play,
    screen_text,
    until,
)
from tests.rigs.stop_situations import full_disk
from tests.rigs.stub_stage import open_plain
from tests.rigs.terminal import EVERY_S, Terminal
from tests.rigs.whole_engine import (
    COMMAND,
    WholeEngine,
    is_slewing,
    mount_by_itself,
    wait_for,
    whole_engine,
)
from tests.tiers import plain_first

EXPOSURE = {"exposure_s": 4.0, "cadence_s": 8.0}
SPEED = 10.0
FULL, LARGE, SMALL, TINY = (80, 24), (120, 40), (40, 12), (20, 5)
DRIVES = pytest.mark.nightly("drives a terminal")
STYLE = re.compile(r"\x1b\[([\d;]*)m")
TRUE_COLOUR = re.compile(r"\b[34]8;2;(\d+);(\d+);(\d+)")
PALETTE = re.compile(r"\b(?:[34]8;5;\d+|[349][0-7]|10[0-7])\b")
NOT_A_TRACEBACK = ("Traceback", "something broke", "Error(")


@contextlib.contextmanager
def console(
    environment: dict[str, str], *words: str, size: tuple[int, int] = FULL
) -> Iterator[Terminal]:
    """``rsoconsole console`` in a real terminal; no traceback may ever be seen there.

    A word with ``=`` in it is set in its environment, ``-u NAME`` taken out of it.
    """
    at = [n for n, word in enumerate(words) if "=" in word or word == "-u" or words[n - 1] == "-u"]
    settings = [word for n, word in enumerate(words) if n in at]
    options = [word for n, word in enumerate(words) if n not in at]
    command = ["env", *settings, *COMMAND, "console", *options]
    with Terminal(command, environment, size) as terminal:
        yield terminal
        assert [word for word in NOT_A_TRACEBACK if word in terminal.text] == []


def ended(environment: dict[str, str], *words: str, **named: Any) -> tuple[int, list[str]]:
    """Exit code and lines of a console that does not open."""
    with console(environment, *words, **named) as terminal:
        wait_for(lambda: terminal.process.poll() is not None, "the console's end", 10.0)
        wait_for(lambda: terminal.text.endswith("\n"), "its last word")
        code = terminal.process.returncode
        said = terminal.text
    assert isinstance(code, int)
    return code, said.split("\r\n")[:-1]


# -- an engine that dies, loses its instruments, or its disk ---------------------------------


@pytest.fixture
def sky() -> Iterator[Observatory]:
    with start_observatory(
        "intelsat-14", 1, SPEED, stage="tests.rigs.stub_stage:open_plain"
    ) as observatory:
        yield observatory


@pytest.fixture
def engine(tmp_path: Path, sky: Observatory) -> Iterator[WholeEngine]:
    with whole_engine(tmp_path, sky, exposure=EXPOSURE) as running:
        running.start()
        yield running


@pytest.mark.nightly("starts an engine twice, with two consoles")
def test_a_killed_engine_is_called_gone_with_the_way_to_stop_the_mount(engine, sky):
    with (
        console(engine.environment) as wide,
        console(engine.environment, size=SMALL) as narrow,
    ):
        for seat in (wide, narrow):
            wait_for(lambda seat=seat: seat.shows("AUTO has the mount"), "a console at work")
        engine.kill()
        for seat in (wide, narrow):
            wait_for(lambda seat=seat: seat.shows("ENGINE GONE"), "the engine's end")
            wait_for(lambda seat=seat: seat.shows("'rsoconsole stop' stops the"), "a remedy")
        wide.press("x")
        wait_for(lambda: wide.shows("ABORT answered", "past the engine"), "a STOP past the engine")
        # How it moves is not measured here: a simulated sky without an engine stands still.
        assert not is_slewing(mount_by_itself(sky))
        known = len(narrow.text)
        engine.start("--session", str(engine.folder / "next night"))
        wait_for(lambda: narrow.shows("AUTO has the mount", since=known), "the next engine")


@pytest.mark.nightly("starts an observatory, an engine and consoles")
def test_a_simulated_night_whose_observatory_dies_ends_and_says_why(engine, sky):
    with console(engine.environment) as seat:
        wait_for(lambda: seat.shows("AUTO has the mount"), "a console at work")
        sky.process.kill()
        wait_for(lambda: seat.shows("ENGINE GONE"), "the engine's end")
        wait_for(lambda: "INDI server" in seat.text or "observatory" in seat.text, "the reason")
        assert seat.process.poll() is None


def open_near_the_pole(settings: ObservatorySettings) -> ObservatorySetup:
    """Above every limit at any hour."""
    return dataclasses.replace(open_plain(settings), start_dec_icrs_deg=85.0)


@pytest.mark.nightly("starts an observatory, an engine and consoles")
def test_an_indi_server_that_dies_is_a_fault_on_the_screen_with_its_remedy(tmp_path):
    # By the machine's own clock, as on a real telescope: no demo, which ends with its sky.
    limits = {"twilight_deg": 90.0, "max_hour_angle_deg": 180.0, "past_meridian_deg": 90.0}
    stage = f"{__name__}:open_near_the_pole"
    with (
        start_observatory("intelsat-14", 1, SPEED, stage=stage) as sky,
        whole_engine(
            tmp_path, sky, exposure=EXPOSURE, limits=limits, indi={"simulated": False}
        ) as engine,
    ):
        engine.start()
        with (
            console(engine.environment, size=(200, 60)) as wide,
            console(engine.environment, size=SMALL) as narrow,
        ):
            for seat in (wide, narrow):
                wait_for(lambda seat=seat: seat.shows("AUTO has the mount"), "a console at work")
            sky.process.kill()
            for seat in (wide, narrow):
                wait_for(lambda seat=seat: seat.shows("FAULT", "nobody has the mount"), "a fault")
            wait_for(
                lambda: wide.shows("start indiserver"),
                "its remedy",
                seen_instead=lambda: (engine.status(), log_events(engine), wide.text[-4000:]),
            )
            assert engine.status()["holder"] == "nobody"


@pytest.mark.nightly("starts an observatory, an engine and consoles")
def test_a_full_disk_is_a_fault_on_the_screen_until_it_has_room_again(engine):
    with (
        console(engine.environment, size=LARGE) as wide,
        console(engine.environment, size=SMALL) as narrow,
    ):
        seats = (wide, narrow)
        for seat in seats:
            wait_for(lambda seat=seat: seat.shows("AUTO has the mount"), "a console at work")
        with full_disk(engine):
            for seat in seats:
                wait_for(lambda seat=seat: seat.shows("FAULT the session's log"), "the fault")
            frames = engine.status()["frame"]
            wait_for(lambda: engine.status()["frame"] >= frames + 2, "frames without a disk")
        wait_for(lambda: engine.frames() >= frames + 2, "what the disk had refused")
        wait_for(lambda: not log_faults(engine), "the fault's end")
        for seat in seats:
            wait_for(
                lambda seat=seat: "FAULT the session" not in again(seat), "a screen without it"
            )


def again(seat: Terminal) -> str:
    """What it shows at this moment: painted again, for another size."""
    known = 0
    for lines in (30, 31):
        known = seat.resize(60, lines)
        wait_for(lambda since=known: seat.shows("x STOP", "F1", since=since), "a screen")
    return seat.text[known:]


def log_events(engine: WholeEngine) -> list[str]:
    """What the log says aloud."""
    return [each.text for _, _, each in engine.reader.records() if isinstance(each, Event)]


def log_faults(engine: WholeEngine) -> list[str]:
    """Of the session's log alone: a preview that was given up stays given up."""
    return [fault for fault in engine.status()["faults"] if "log" in fault]


def test_the_last_state_of_a_dead_engine_is_what_it_said_and_not_what_it_could_write(wire):
    """With a full disk the session is behind."""

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        wire.status |= {"state": "MANUAL", "holder": "operator"}
        await until(pilot, lambda: "MANUAL" in pane(app, "top"))
        wire.is_gone = True
        await until(pilot, lambda: "ENGINE GONE" in pane(app, "top"))
        assert "was MANUAL" in pane(app, "top")

    play(wire, scene)


# -- a clock that was set ------------------------------------------------------------------


@pytest.mark.parametrize("step_s", [-3600, -1, 5 * 3600, 400 * 86400])
def test_a_clock_that_is_set_harms_no_figure_and_the_first_line_has_the_new_time(wire, step_s):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        before = pane(app, "top").split()[-1]
        for name in ("now_utc_ns", "exposing_until_utc_ns"):
            wire.status[name] += step_s * NS
        if step_s % 86400:
            await until(pilot, lambda: pane(app, "top").split()[-1] != before)
        else:
            await until(pilot, lambda: "3m37" not in pane(app, "top"))
        assert not re.search(r"-\d+ ?(s|m|h)\b", screen_text(app))
        assert "2 s left" in screen_text(app)

    play(wire, scene)


@pytest.mark.parametrize("size", plain_first(2, [(FULL,), ((60, 20),), (LARGE,), ((200, 60),)]))
def test_a_clock_that_is_not_synchronised_is_in_sight(wire, size):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        wire.status["health"] = [{"name": "clock", "ok": False, "text": "not synchronised"}]
        await until(pilot, lambda: has_outlook(app) and len(app.live.engine.health) == 1)
        await pilot.pause()
        assert "clock not synchronised" in screen_text(app)

    play(wire, scene, size)


def test_records_that_go_back_in_time_are_shown_in_their_order(wire, writer: SessionWriter):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        back_ns = night.t_of(FRAMES) - 3600 * NS
        words = "the camera's clock is -3600 s off this machine's: synchronise"
        writer.append(Event(level="warning", text=words), back_ns)
        night.add_frames(writer, range(FRAMES + 1, FRAMES + 2))
        assert writer.flush()
        await until(pilot, lambda: len(app.live.night.rows) == FRAMES + 1)
        assert "the camera's clock is -3600 s off" in screen_text(app)
        assert app.live.night.log[-1].text.endswith(words)

    play(wire, scene)


# -- sessions of other versions --------------------------------------------------------------

Change = Callable[[sqlite3.Connection], None]


def sql(*statements: str) -> Change:
    def change(connection: sqlite3.Connection) -> None:
        for statement in statements:
            connection.execute(statement)

    return change


def config(make: Callable[[dict[str, Any]], dict[str, Any]]) -> Change:
    def change(connection: sqlite3.Connection) -> None:
        ((text,),) = connection.execute("SELECT value FROM meta WHERE key = 'config'")
        words = json.dumps(make(json.loads(text)))
        connection.execute("UPDATE meta SET value = ? WHERE key = 'config'", (words,))

    return change


LATER_RECORDS = ("Closeup", "Ruling", "FollowedAgain")
LATER_SECTIONS = ("console", "aim", "catalogue")
NEWER_KIND = (
    "INSERT INTO log (seq, t_utc_ns, kind, frame_id, body) "
    "SELECT max(seq) + 1, max(t_utc_ns), 'Occultation', 20, '{\"by\": \"Moon\"}' FROM log"
)
SHOWN_IN_FULL: dict[str, Change] = {
    "before close-ups and rulings": sql(
        f"DELETE FROM log WHERE kind IN {LATER_RECORDS}", "DELETE FROM files WHERE role = 'closeup'"
    ),
    "before some views": sql("DROP VIEW rejections", "DROP VIEW not_followed", "DROP VIEW timings"),
    "before some settings": config(
        lambda c: {name: table for name, table in c.items() if name not in LATER_SECTIONS}
    ),
    "with a kind of record from a later one": sql(NEWER_KIND),
    "with more in each record": sql("UPDATE log SET body = json_set(body, '$.later', 'word')"),
    "without a configuration": sql("DELETE FROM meta WHERE key = 'config'"),
    "with a setting from a later one": config(lambda c: {**c, "guider": {"rate": 0.5}}),
}
SAID_INSTEAD: dict[str, tuple[Change, str]] = {
    "of a later schema": (sql("PRAGMA user_version = 99"), "update rsoconsole"),
    "of another program": (sql("PRAGMA application_id = 1"), "is not a session of rsoconsole"),
}


def changed(told: Path, folder: Path, change: Change) -> Path:
    """A copy of a told night, as another version might have written it."""
    shutil.copytree(told, folder)
    with contextlib.closing(sqlite3.connect(folder / "session.db")) as connection:
        change(connection)
        connection.commit()
    return folder


@pytest.fixture
def home(tmp_path: Path) -> dict[str, str]:
    """The environment of a user for whom no engine runs."""
    run = tmp_path / "run"
    run.mkdir(mode=0o700)
    homes = {f"XDG_{name}_HOME": str(tmp_path / name) for name in ("DATA", "STATE", "CACHE")}
    return {
        **{name: value for name, value in os.environ.items() if name != "NO_COLOR"},
        **homes,
        "LC_ALL": "C.UTF-8",
        "XDG_RUNTIME_DIR": str(run),
        "RSOCONSOLE_CONFIG": str(tmp_path / "config.toml"),
    }


@pytest.mark.parametrize("which", SHOWN_IN_FULL)
def test_a_session_of_another_version_is_shown_as_one_of_this(told_night, tmp_path, wire, which):
    folder = changed(told_night, tmp_path / "night", SHOWN_IN_FULL[which])

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        seen = screen_text(app)
        for words in ("RECORDED: TRACK", f"frame {FRAMES:04d} · 10 s", "ideal 2", "NIS", "x STOP"):
            assert words in seen
        await pilot.press("q")

    assert play(wire, scene, session=folder) == "quit"


@DRIVES
@pytest.mark.parametrize("which", SHOWN_IN_FULL)
def test_a_session_of_another_version_is_shown_to_its_last_frame(told_night, tmp_path, home, which):
    folder = changed(told_night, tmp_path / "night", SHOWN_IN_FULL[which])
    with console(home, "--session", str(folder)) as seat:
        wait_for(lambda: seat.shows("RECORDED: TRACK", f"frame {FRAMES:04d} · 10 s"), "the night")
        wait_for(lambda: seat.shows("ideal 2", "NIS", "x STOP"), "all of it")
        seat.press("q")
        wait_for(lambda: seat.process.poll() is not None, "the console's end")
        assert seat.process.returncode == 0


@pytest.mark.parametrize("which", SAID_INSTEAD)
def test_a_session_that_cannot_be_shown_is_refused(told_night, tmp_path, which):
    change, words = SAID_INSTEAD[which]
    folder = changed(told_night, tmp_path / "night", change)
    with pytest.raises(SessionError, match=words):
        run_console(session=folder)


@pytest.mark.parametrize(
    "which", ["of a later schema", pytest.param("of another program", marks=DRIVES)]
)
def test_a_session_that_cannot_be_shown_is_refused_in_one_sentence(
    told_night, tmp_path, home, which
):
    change, words = SAID_INSTEAD[which]
    folder = changed(told_night, tmp_path / "night", change)
    code, lines = ended(home, "--session", str(folder), size=(200, 24))
    assert code == 1
    assert len(lines) == 1
    assert words in lines[0]


def test_what_is_known_of_a_later_configuration_is_heard_or_its_loss_is_said(
    told_night, tmp_path, wire
):
    def later(c: dict[str, Any]) -> dict[str, Any]:
        return {**c, "guider": {"rate": 0.5}, "detector": {**c["detector"], "tau": 0.37}}

    folder = changed(told_night, tmp_path / "night", config(later))

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        seen = screen_text(app)
        assert "RECORDED: TRACK" in seen
        assert f"{FRAMES} frames" in seen
        assert "τ .37" in seen or "the configuration of" in seen

    play(wire, scene, LARGE, session=folder)


def test_one_damaged_record_is_said_and_hides_no_other(told_night, tmp_path, wire):
    damage = sql("UPDATE log SET body = '{}' WHERE kind = 'Miss'")
    folder = changed(told_night, tmp_path / "night", damage)

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: "a Miss of this session is damaged" in screen_text(app))
        await until(pilot, lambda: f"frame {FRAMES:04d}" in screen_text(app))

    play(wire, scene, session=folder)


# -- terminals -------------------------------------------------------------------------------


class Told:
    """An engine that says what it is told to say and keeps what it was asked."""

    def __init__(self, socket: Path, session: Path) -> None:
        self.verbs: list[str] = []
        self.status = FakeWire(session).status
        socket.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        self.server = ControlServer(socket, self.handle)
        self._lock = threading.Lock()

    def handle(self, request: Request) -> Outcome:
        if request.command.verb == "status":
            return Outcome(ok=True, data=dict(self.status))
        with self._lock:
            self.verbs.append(request.command.verb)
        is_stop = request.command.verb == "stop"
        return Outcome(ok=True, data=STOPPED if is_stop else {})


@pytest.fixture
def told(told_night: Path, home: dict[str, str]) -> Iterator[Told]:
    speaking = Told(Path(home["XDG_RUNTIME_DIR"]) / "rsoconsole" / "engine.sock", told_night)
    with speaking.server:
        yield speaking


@DRIVES
def test_the_smallest_terminal_has_state_holder_clock_and_stop(told, home):
    with console(home, size=SMALL) as seat:
        wait_for(lambda: seat.shows("TRACK", "AUTO has the mount", "x STOP"), "what matters")
        wait_for(lambda: re.search(r"\d\d:\d\d:\d\dZ", seat.text), "the clock")
        seat.press("x")
        wait_for(lambda: seat.shows("tracks, measured"), "what came of STOP")
        assert told.verbs == ["stop"]


def test_a_terminal_is_made_small_and_large_again_and_stops_at_any_size(told, home):
    with console(home, size=LARGE) as seat:
        wait_for(lambda: seat.shows("TRACK", "x STOP"), "a console at work")
        for stops, size in enumerate(
            (SMALL, TINY, (1, 1), (4, 2), TINY, SMALL, LARGE, (200, 60), FULL), 1
        ):
            known = seat.resize(*size)
            if size in {SMALL, LARGE, FULL}:
                wait_for(
                    lambda known=known: seat.shows("TRACK", "the mount", "STOP", since=known),
                    f"a screen of {size}",
                )
            seat.press("x")
            wait_for(lambda stops=stops: len(told.verbs) == stops, f"STOP at {size}")
        assert seat.process.poll() is None
        assert set(told.verbs) == {"stop"}


def test_a_pane_that_cannot_be_drawn_says_so_and_stop_is_sent(wire, caplog):
    def broken(_width: int, _height: int) -> list[Line]:
        raise ZeroDivisionError("of a plot")

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        nis = app.live.pane("nis")
        nis.show(broken)
        await pilot.resize_terminal(*LARGE)
        await until(pilot, lambda: NOT_DRAWN in nis.text)
        await pilot.press("x")
        await until(pilot, lambda: wire.verbs == ["stop"])
        nis.show(lambda _width, _height: [])

    play(wire, scene, FULL)
    assert "nis cannot be drawn" in caplog.text
    assert "ZeroDivisionError" in caplog.text


@pytest.mark.parametrize("keys", ["f1", "q", "t", "p", "g", "l", "e", "n", "slash", "ctrl+p"])
@pytest.mark.parametrize("size", plain_first(1, [(TINY,), (SMALL,)]))
def test_no_dialog_breaks_in_a_small_terminal(wire, size, keys):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        await pilot.press(keys)
        await pilot.pause()
        await pilot.resize_terminal(*FULL)
        await pilot.resize_terminal(*size)
        await pilot.pause()
        await pilot.press("ctrl+x")
        await until(pilot, lambda: wire.verbs == ["stop"])
        assert app.screen is app.live

    play(wire, scene, size)


@DRIVES
def test_without_colour_every_cell_is_grey_and_the_picture_is_still_there(told, home):
    with console(home, "NO_COLOR=1") as seat:
        wait_for(lambda: seat.shows("TRACK", "x STOP", f"frame {FRAMES:04d} · 10 s"), "a screen")
        wait_for(lambda: "▚" in seat.text, "the picture")
        true, of_palette = colours(seat.raw)
        assert len(true) > 3, "nothing was looked at"
        assert [colour for colour in true if len(set(colour)) > 1] == []
        assert of_palette == set()


def colours(raw: str) -> tuple[set[tuple[str, ...]], set[str]]:
    """Every colour asked for: those by red, green and blue, and those by a number."""
    styles = STYLE.findall(raw)
    true = {found for style in styles for found in TRUE_COLOUR.findall(style)}
    rest = [TRUE_COLOUR.sub("", style) for style in styles]
    return true, {found for style in rest for found in PALETTE.findall(style)}


@DRIVES
def test_the_colours_that_no_color_takes_away_are_there_without_it(told, home):
    with console(home) as seat:
        wait_for(lambda: seat.shows("TRACK", "x STOP", f"frame {FRAMES:04d} · 10 s"), "a screen")
        wait_for(lambda: any(len(set(c)) > 1 for c in colours(seat.raw)[0]), "a colour")


@pytest.mark.parametrize(
    ("given", "is_taken"),
    [
        ({"LC_ALL": "C"}, False),
        ({"LC_ALL": "POSIX"}, False),
        ({"LC_ALL": "C", "LANG": "C.UTF-8"}, False),
        ({"LC_CTYPE": "POSIX", "LANG": "C.UTF-8"}, False),
        ({"LANG": "C"}, False),
        ({"LANG": "C.UTF-8"}, True),
        ({}, True),
    ],
)
def test_signs_beyond_ascii_are_for_a_locale_that_has_them(monkeypatch, given, is_taken):
    """The first of three settings that is made counts."""
    for name in ("LC_ALL", "LC_CTYPE", "LANG"):
        monkeypatch.delenv(name, raising=False)
    for name, value in given.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(sys, "__stderr__", io.TextIOWrapper(io.BytesIO(), "utf-8"))
    assert is_utf8() is is_taken
    monkeypatch.setattr(sys, "__stderr__", io.TextIOWrapper(io.BytesIO(), "ascii"))
    assert not is_utf8()


@pytest.mark.parametrize(
    "settings",
    [
        "LC_ALL=C",
        *(pytest.param(each, marks=DRIVES) for each in ("LC_ALL=POSIX", "PYTHONIOENCODING=ascii")),
    ],
)
def test_without_unicode_the_terminal_gets_ascii_alone(told, home, settings):
    with console(home, settings) as seat:
        wait_for(lambda: seat.shows("TRACK", "x STOP", f"frame {FRAMES:04d}"), "a screen")
        assert "\\u" not in seat.text
        assert seat.raw.isascii()


@DRIVES
def test_a_language_of_c_is_one_of_ascii_whatever_python_makes_of_it(told, home):
    """Python puts LC_CTYPE=C.UTF-8 into its own environment then (PEP 538)."""
    with console(home, "-u", "LC_ALL", "-u", "LC_CTYPE", "LANG=C") as seat:
        wait_for(lambda: seat.shows("TRACK", "x STOP", f"frame {FRAMES:04d}"), "a screen")
        assert seat.raw.isascii()


@DRIVES
def test_where_the_configuration_wants_ascii_the_terminal_gets_ascii_alone(told, home):
    Path(home["RSOCONSOLE_CONFIG"]).write_text("[console]\nascii = true\n", encoding="utf-8")
    with console(home) as seat:
        wait_for(lambda: seat.shows("TRACK", "x STOP", f"frame {FRAMES:04d} . 10 s"), "a screen")
        wait_for(lambda: "].55" in seat.text, "the mark in the picture")
        assert seat.raw.isascii()


def test_a_terminal_that_can_do_nothing_is_told_so_in_one_line(told, home):
    code, lines = ended(home, "TERM=dumb", size=(200, 24))
    assert code == 1
    assert len(lines) == 1
    assert "terminal" in lines[0]


@pytest.mark.parametrize("what", ["stdin", "stdout", "stderr", "TERM"])
def test_what_is_no_terminal_is_refused_before_anything_is_drawn(told_night, monkeypatch, what):
    for name in ("stdin", "stdout", "stderr"):
        monkeypatch.setattr(sys, name, Stream(is_terminal=name != what))
    monkeypatch.setenv("TERM", "dumb" if what == "TERM" else "xterm")
    with pytest.raises(RsoconsoleError, match="terminal"):
        run_console(session=told_night)


class Stream(io.StringIO):
    """One of the three, as a terminal or as a file."""

    def __init__(self, *, is_terminal: bool) -> None:
        super().__init__()
        self._is_terminal = is_terminal

    def isatty(self) -> bool:
        return self._is_terminal


@pytest.mark.parametrize("what", ["stdin", pytest.param("stdout", marks=DRIVES)])
def test_without_a_terminal_one_line_says_so(told, home, what):
    done = into_a_pipe(home, what)
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert "needs a terminal" in done.stderr
    assert "rsoconsole status" in done.stderr


def into_a_pipe(home: dict[str, str], what: str) -> "subprocess.CompletedProcess[str]":
    """A console one of whose ends is no terminal, the others are."""
    master, slave = os.openpty()
    ends: dict[str, Any] = {"stdin": slave, "stdout": slave}
    ends[what] = subprocess.DEVNULL if what == "stdin" else subprocess.PIPE
    try:
        return subprocess.run(
            [*COMMAND, "console"],
            env=home,
            stderr=subprocess.PIPE,
            text=True,
            timeout=20,
            check=False,
            **ends,
        )
    finally:
        os.close(master)
        os.close(slave)


@DRIVES
def test_a_screen_never_goes_into_a_file_that_errors_were_sent_to(told, home, tmp_path):
    errors = tmp_path / "errors.txt"
    words = ["sh", "-c", f'exec "$@" 2>{errors}', "sh", *COMMAND, "console"]
    with Terminal(words, home, FULL) as seat:
        wait_for(
            lambda: seat.shows("TRACK", "x STOP") or seat.process.poll() is not None,
            "a screen, or an end",
            10.0,
        )
        assert "\x1b[" not in errors.read_text(encoding="utf-8")


# -- a seat that only looks ------------------------------------------------------------------

KEYS_AS_TYPED = {"up": "\x1b[A", "down": "\x1b[B", "right": "\x1b[C", "left": "\x1b[D"}


@DRIVES
def test_a_seat_that_only_looks_touches_nothing_whatever_is_pressed(told, home):
    acting = [c.keys for c in COMMANDS if c.acts]
    assert len(acting) > 15
    with console(home, "--read-only") as seat:
        wait_for(lambda: seat.shows("TRACK", "x STOP", f"frame {FRAMES:04d} · 10 s"), "a screen")
        for keys in acting:
            seat.press(KEYS_AS_TYPED.get(keys, keys))
            time.sleep(EVERY_S)  # else two might be read as one
        # And what might stand in a dialog that must not have opened.
        seat.press("y\r12 00 00 -5 00 00\r")
        wait_for(lambda: seat.shows("only looks"), "why nothing is done")
        seat.press("\x18")
        wait_for(lambda: "stop" in told.verbs, "STOP, which works everywhere")
        assert set(told.verbs) == {"stop"}
        seat.press("q")
        wait_for(lambda: seat.process.poll() is not None, "the console's end")


@pytest.mark.slow("presses every key")
@pytest.mark.parametrize("size", plain_first(1, [(FULL,), ((200, 60),)]))
def test_a_seat_that_only_looks_tunes_marks_and_points_at_nothing(wire, size):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        for command in commands_in("live"):
            if command.name in {"stop", "stop_by_letter", "leave", "sessions"}:
                continue
            owner = app if command.is_everywhere else app.live
            command_action(owner, command)()
            await pilot.pause()
            await pilot.press("right", "enter", "u", "w", "y")
            while app.screen is not app.live:
                await pilot.press("escape")
                await pilot.pause()
        await pilot.click("#frame", offset=(12, 8))
        await pilot.pause(0.2)
        assert wire.verbs == []

    play(wire, scene, size, read_only=True)


@DRIVES
def test_a_seat_that_only_looks_says_so_before_anything_is_pressed(told, home):
    with console(home, "--read-only", size=LARGE) as seat:
        wait_for(lambda: seat.shows("TRACK", "x STOP", f"{FRAMES} frames"), "a screen")
        wait_for(lambda: re.search("read.only|only looks", seat.text), "a word of it", 2.0)


# -- ends that nobody wanted ----------------------------------------------------------------


@pytest.mark.parametrize(
    "number", [signal.SIGTERM, pytest.param(signal.SIGINT, marks=DRIVES)], ids=["TERM", "INT"]
)
def test_a_console_that_is_told_to_end_leaves_the_terminal_as_it_was(told, home, number):
    with console(home) as seat:
        wait_for(lambda: seat.shows("TRACK", "x STOP"), "a screen")
        os.kill(seat.process.pid, number)
        wait_for(lambda: seat.process.poll() is not None, "the console's end")
        wait_for(lambda: "\x1b[?1049l" in seat.raw and "\x1b[?25h" in seat.raw, "its screen", 2.0)


def test_a_console_that_breaks_gives_the_terminal_back_and_one_line(told, home):
    breaks = "from rsoconsole.console.app import ConsoleApp as A; A.ring_alerts = lambda *_: 1 / 0"
    command = [sys.executable, "-c", f"{breaks}; from rsoconsole.cli import main; main()"]
    with Terminal([*command, "console"], home, (200, 24)) as seat:
        wait_for(lambda: seat.process.poll() is not None, "the console's end")
        wait_for(lambda: "\x1b[?1049l" in seat.raw, "the first screen")
        assert seat.process.returncode == 1
        wait_for(lambda: seat.shows("something broke"), "a word of it", 2.0)
        said = seat.raw[seat.raw.rfind("\x1b[?1049l") :]
        assert said.count("\n") == 1
        assert "division by zero" in said


# -- a screen that is busier than its news --------------------------------------------------


def test_news_does_not_pile_up_before_a_screen_that_is_busy(wire):
    """Each holds a picture: an hour of a slow machine would be hundreds of megabytes."""

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        app._session_watch.close()
        await pilot.pause()
        seen = []
        app.live.watch(app.live, "night", lambda: seen.append(app.live.night), init=False)
        nights = [dataclasses.replace(app.live.night, log=()) for _ in range(50)]
        for each in nights:
            app._night_seen(each, app.live.picture)
        await until(pilot, lambda: app.live.night is nights[-1])
        assert len(seen) <= 2
        app._night_seen(nights[0], app.live.picture)
        await until(pilot, lambda: app.live.night is nights[0])

    play(wire, scene)
