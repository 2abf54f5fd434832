"""``rsoconsole review`` in a real terminal, over the sample session; and without one."""

import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner

from rsoconsole.base import SessionError
from rsoconsole.cli.app import app
from rsoconsole.console import run_review
from tests.nights.samples import SAMPLE
from tests.rigs.terminal import EVERY_S, Terminal

COMMAND = [sys.executable, "-c", "from rsoconsole.cli import main; main()", "review"]
PATIENCE_S = 60.0


@pytest.fixture
def home(tmp_path: Path) -> dict[str, str]:
    """An environment of its own."""
    places = {f"XDG_{name}_HOME": str(tmp_path / name) for name in ("CONFIG", "DATA", "STATE")}
    return {**os.environ, **places, "LANG": "C.UTF-8", "LC_ALL": "C.UTF-8"}


def wait_for(is_so: Callable[[], bool], what: str) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not is_so():
        assert time.monotonic() < deadline, f"never: {what}"
        time.sleep(EVERY_S)


def shown_after(terminal: Terminal, keys: str, *words: str) -> None:
    """Press, and wait for what must come of it."""
    known = len(terminal.text)
    terminal.press(keys)
    wait_for(lambda: terminal.shows(*words, since=known), f"{words} after {keys!r}")


def test_the_sample_night_is_played_searched_compared_and_left(home: dict[str, str]):
    with Terminal([*COMMAND, str(SAMPLE)], home, (120, 40)) as seat:
        wait_for(lambda: seat.shows("frame 1 of 36", "frame 0001 · 10 s", "space Play"), "a screen")
        shown_after(seat, "]]]", "×300")
        shown_after(seat, " ", "space Pause", "frame 0036 · 10 s", "space Play")
        shown_after(seat, "\x1b[H", "frame 0001")  # home
        shown_after(seat, "E", "events: ○ miss (7 in the night)")
        shown_after(seat, ">", "frame 0011 · 10 s", "COAST")
        shown_after(seat, "K", "A is kept")
        shown_after(seat, ".", "frame 0012 · 10 s")
        shown_after(seat, "K", "compare A with B", "0011", "0012", "between")
        shown_after(seat, "B", "frame 0011 · 10 s")
        shown_after(seat, "g", "go to a moment")
        shown_after(seat, "05:35\r", "frame 0010 · 10 s")
        seat.press("q")
        wait_for(lambda: seat.process.poll() is not None, "its end")
        assert seat.process.returncode == 0


@pytest.mark.nightly("drives a terminal")
def test_it_begins_where_it_is_told_to(home: dict[str, str]):
    with Terminal([*COMMAND, str(SAMPLE), "--at", "05:36"], home, (80, 24)) as seat:
        wait_for(lambda: seat.shows("frame 12 of 36"), "the frame of that time")


def test_night_and_day_the_sample_is_not_written_to(home: dict[str, str]):
    def state() -> dict[str, tuple[int, int]]:
        return {
            str(path): (path.stat().st_mtime_ns, path.stat().st_size)
            for path in sorted(SAMPLE.rglob("*"))
            if path.is_file()
        }

    before = state()
    with Terminal([*COMMAND, str(SAMPLE), "--at", "5"], home, (120, 40)) as seat:
        wait_for(lambda: seat.shows("frame 5 of 36"), "a screen")
        seat.press("t")
        wait_for(lambda: seat.shows(" to here"), "the tuning pane")
        seat.press("\x1b[C\r")
        time.sleep(0.5)
    assert state() == before


def run(home: dict[str, str], *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [*COMMAND, *arguments]
    return subprocess.run(command, env=home, capture_output=True, text=True, check=False)


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        ([str(SAMPLE)], 1, "'rsoconsole export' and 'rsoconsole figures' work without one"),
        pytest.param(
            ["no-such-night"],
            1,
            "does not exist",
            marks=pytest.mark.nightly("starts the whole program"),
        ),
    ],
    ids=["no terminal", "no session"],
)
def test_what_cannot_be_is_said_in_one_line(
    home: dict[str, str], arguments: list[str], code: int, words: str
):
    ended = run(home, *arguments)
    assert ended.returncode == code
    said = " ".join((ended.stdout + ended.stderr).replace("│", " ").split())
    assert words in said
    assert "Traceback" not in said
    assert len(ended.stderr.strip().splitlines()) == 1


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        ([str(SAMPLE), "--at", "soon"], 2, "no frame and no UTC"),
        (["--help"], 0, "Example: rsoconsole review"),
    ],
    ids=["no moment", "help"],
)
def test_how_a_review_is_asked_for_is_said(arguments: list[str], code: int, words: str):
    ended = CliRunner().invoke(app, ["review", *arguments])
    assert ended.exit_code == code
    assert words in " ".join(ended.output.replace("│", " ").split())


def test_a_night_that_is_not_there_is_refused(tmp_path: Path):
    with pytest.raises(SessionError, match="does not exist"):
        run_review(tmp_path / "no-such-night")
