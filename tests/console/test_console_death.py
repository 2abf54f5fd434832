"""A console that dies or loses its line is nothing to the telescope; the next one sees it all."""

import itertools
import os
import re
import shlex
import statistics
import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from rsoconsole.cli.app import app
from rsoconsole.cli.demo import demo, demo_night
from rsoconsole.control import ControlServer, Outcome, Request, default_socket_path
from rsoconsole.records import FrameTaken
from rsoconsole.session import SessionReader
from rsoconsole.simulator import start_observatory
from tests.rigs.seat_rig import ANSWERED
from tests.rigs.terminal import Terminal
from tests.rigs.whole_engine import COMMAND, WholeEngine, wait_for, whole_engine

CADENCE_S, SPEED = 8.0, 10.0
SIZE = (200, 60)
"""Large enough for the night's first words."""
FIRST_WORDS = "armed by configuration"
FRAMES_AFTER = 3
DEAF = ("sh", "-c", 'trap "" HUP; exec "$@"', "sh")
"""Begins a program that does not hear of a lost line."""


@pytest.fixture
def engine(tmp_path: Path) -> Iterator[WholeEngine]:
    exposure = {"exposure_s": 4.0, "cadence_s": CADENCE_S}
    stage = "tests.rigs.stub_stage:open_plain"
    with (
        start_observatory("intelsat-14", 1, SPEED, stage=stage) as sky,
        whole_engine(tmp_path, sky, exposure=exposure) as running,
    ):
        running.start()
        yield running


def console(engine: WholeEngine, before: Sequence[str] = ()) -> Terminal:
    return Terminal([*before, *COMMAND, "console"], engine.environment, SIZE)


def shows_past(terminal: Terminal, frame_id: int) -> bool:
    """A frame as late as this one, and the night's first words, where need be in the whole log."""
    shown = [int(number) for number in re.findall(r"frame (\d{4})", terminal.text)]
    if max(shown, default=0) < frame_id:
        return False
    if not terminal.shows(FIRST_WORDS) and not terminal.has_typed:
        terminal.press("l")
    return terminal.shows(FIRST_WORDS)


def frames_without_a_gap(session: Path) -> int:
    """How many frames there are; each follows the one before in number and in time."""
    frames: list[Any] = [f for _, _, f in SessionReader(session).records(kinds=(FrameTaken,))]
    assert [frame.frame_id for frame in frames] == list(range(1, len(frames) + 1))
    steps = [b.t_start_utc_ns - a.t_start_utc_ns for a, b in itertools.pairwise(frames)]
    # A busy machine delays an exposure by some of a real second, which is SPEED virtual ones.
    assert max(steps) < 4.0 * statistics.median(steps)
    return len(frames)


@pytest.mark.slow("starts an engine and kills its console")
def test_frames_go_on_when_a_console_is_killed_and_the_next_shows_the_whole_past(engine):
    with console(engine) as first:
        wait_for(lambda: first.shows("AUTO has the mount"), "a console at work")
        frames = engine.frames()
        first.kill()
    wait_for(lambda: engine.frames() >= frames + FRAMES_AFTER, "frames after the console")
    last = engine.frames()
    with console(engine) as second:
        wait_for(lambda: shows_past(second, last), "the past in a new console")
        assert second.process.poll() is None
    assert frames_without_a_gap(engine.session) >= last
    assert engine.status()["holder"] == "autonomy"


@pytest.mark.nightly("starts an observatory, an engine and a console")
@pytest.mark.parametrize("before", [(), DEAF], ids=["as it is", "under nohup"])
def test_frames_go_on_when_the_line_to_a_console_is_lost(engine, before):
    with console(engine, before) as first:
        wait_for(lambda: first.shows("AUTO has the mount"), "a console at work")
        frames = engine.frames()
        first.hang_up()
        wait_for(lambda: first.process.poll() is not None, "the console's end")
    wait_for(lambda: engine.frames() >= frames + FRAMES_AFTER, "frames after the console")
    frames_without_a_gap(engine.session)
    assert engine.status()["holder"] == "autonomy"


@pytest.mark.nights
def test_the_demo_goes_on_when_its_console_is_killed(tmp_path):
    """The whole way: ``rsoconsole demo`` in one terminal, ``rsoconsole console`` in another."""
    with start_observatory("empty", 1, 0.0, stage="tests.rigs.stub_stage:open_plain") as unused:
        whole = whole_engine(tmp_path, unused)
        with whole as user:
            session = tmp_path / "night"
            demo = [*COMMAND, "demo", "--speed", "30", "--session", str(session)]
            with Terminal(demo, user.environment, SIZE) as seat:
                wait_for(lambda: seat.shows("frame 0002"), "the demo's second frame")
                seat.kill()
            user.session = session
            goal = user.frames() + FRAMES_AFTER
            wait_for(lambda: user.frames() >= goal, "frames without a console")
            with Terminal([*COMMAND, "console"], user.environment, SIZE) as seat:
                wait_for(lambda: shows_past(seat, goal), "the past")
                took_s = time.monotonic() - seat.begun_s
            print(f"the past was there {took_s:.2f} s after the console was called")
            assert frames_without_a_gap(session) >= goal


# -- a demo's engine that is left running ----------------------------------------------------


class Idler:
    """An engine that is asked how it is; ends when it is told to."""

    def __init__(self, socket: Path, holder: str = "nobody", *, stops: bool = True) -> None:
        self.verbs: list[str] = []
        self.holder, self.stops = holder, stops
        self.server = ControlServer(socket, self.handle)

    def handle(self, request: Request) -> Outcome:
        self.verbs.append(request.command.verb)
        data: dict[str, Any] = {"state": "IDLE", "holder": self.holder, "frame": 7, "faults": []}
        data |= {"ra": None, "dec": None, "alt": None, "az": None}
        if request.command.verb == "stop":
            outcome = "stands" if self.stops else "moves"
            data = ANSWERED | {"motion": outcome, "rate_deg_s": 0.0 if self.stops else 4.0}
        return Outcome(ok=True, message="so be it", data=data)


@pytest.fixture
def beside(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where an engine listens that does not have the user's own place."""
    run = tmp_path / "run"
    run.mkdir(mode=0o700)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(run))
    monkeypatch.setenv("RSOCONSOLE_CONFIG", str(tmp_path / "none.toml"))
    return tmp_path / "a demo" / "engine.sock"


def test_an_engine_at_another_place_is_asked_stopped_and_ended_by_its_socket(beside, monkeypatch):
    monkeypatch.setattr(
        "rsoconsole.instruments.indi.wire_stop.stop_mount",
        lambda *_, **__: pytest.fail("another engine's mount was stopped"),
    )
    other = Idler(beside)
    at = ["--socket", str(beside)]
    with Idler(default_socket_path()).server, other.server:
        assert "frame 7" in CliRunner().invoke(app, ["status", *at]).output
        assert "by the mount's own process" in CliRunner().invoke(app, ["stop", *at]).output
        other.stops = False
        moves_on = 3
        assert CliRunner().invoke(app, ["stop", *at]).exit_code == moves_on
        assert CliRunner().invoke(app, ["quit", *at]).exit_code == 0
    assert other.verbs == ["status", "stop", "stop", "shutdown"]


def test_whichever_leaves_a_demo_beside_an_engine_is_told_commands_that_reach_it(
    beside, monkeypatch, capsys
):
    class LeftRunning:
        socket, session = beside, Path("night")

        def __init__(self, *_: object, **__: object) -> None:
            pass

    monkeypatch.setattr(demo, "NightProcess", LeftRunning)
    monkeypatch.setattr("rsoconsole.console.run_console", lambda **_: "quit")
    demo._watch_night(None, None)
    said = capsys.readouterr().out
    assert "another engine runs" in said
    commands = [line for line in said.splitlines() if line.startswith("rsoconsole ")]
    assert [shlex.split(line)[1] for line in commands] == ["status", "console", "quit"]
    for line in commands:
        assert shlex.split(line)[2:] == ["--socket", str(beside)]
    monkeypatch.setattr(LeftRunning, "socket", default_socket_path())
    demo._watch_night(None, None)
    assert "--socket" not in capsys.readouterr().out


@pytest.mark.parametrize(
    ("holder", "starter_lives", "ends"),
    [("nobody", False, True), ("nobody", True, False), ("autonomy", False, False)],
)
def test_a_demo_that_was_left_alone_ends_when_nothing_goes_on(
    beside, monkeypatch, holder, starter_lives, ends
):
    monkeypatch.setattr(demo_night, "LOOK_S", 0.02)
    monkeypatch.setattr(demo_night, "ABANDONED_S", 0.1)
    starter = os.getppid() if starter_lives else -1
    idler = Idler(beside, holder)
    with idler.server:
        watch = threading.Thread(
            target=demo_night.end_when_abandoned, args=(beside, starter), daemon=True
        )
        watch.start()
        if ends:
            wait_for(lambda: "shutdown" in idler.verbs, "the end of a forgotten demo")
        else:
            wait_for(lambda: len(idler.verbs) >= 15, "an engine that is watched")
            assert set(idler.verbs) == {"status"}
    watch.join(5.0)
    assert not watch.is_alive()
