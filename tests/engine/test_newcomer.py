"""In a real terminal: a newcomer's first minutes, and a morning with a recorded night."""

import contextlib
import os
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.nights.samples import SAMPLE
from tests.rigs.terminal import EVERY_S, READS_S, Terminal
from tests.rigs.whole_engine import COMMAND

SIZE = (120, 40)
PATIENCE_S = 90.0
ESC, RIGHT, DOWN = "\x1b", "\x1b[C", "\x1b[B"
F1 = "\x1bOP"
pytestmark = pytest.mark.timeout(300)


@pytest.fixture
def house(tmp_path: Path) -> Iterator[dict[str, str]]:
    """A user of its own; whatever still runs in it at the end is ended."""
    run = tmp_path / "run"
    run.mkdir(mode=0o700)
    homes = {f"XDG_{name}_HOME": str(tmp_path / name) for name in ("CONFIG", "DATA", "STATE")}
    environment = {
        **os.environ,
        **homes,
        "XDG_RUNTIME_DIR": str(run),
        "RSOCONSOLE_CONFIG": str(tmp_path / "config.toml"),
        "LANG": "C.UTF-8",
        "LC_ALL": "C.UTF-8",
    }
    yield environment
    mark = f"XDG_RUNTIME_DIR={run}".encode()
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit() and int(entry.name) != os.getpid():
            with contextlib.suppress(OSError):
                if mark in (entry / "environ").read_bytes().split(b"\0"):
                    os.kill(int(entry.name), signal.SIGKILL)


def wait_for(is_so: Callable[[], bool], what: str, seat: Terminal) -> None:
    ends_s = time.monotonic() + PATIENCE_S
    while not is_so():
        assert time.monotonic() < ends_s, f"there was no sign of: {what}; {seat.text[-3000:]}"
        time.sleep(EVERY_S)


def shown_after(seat: Terminal, keys: str, *words: str) -> None:
    """Press, and wait for what must come of it."""
    known = len(seat.text)
    seat.press(keys)
    wait_for(lambda: seat.shows(*words, since=known), f"{words} after {keys!r}", seat)


@pytest.mark.slow("a night in a terminal")
def test_a_newcomer_sees_a_lock_takes_the_tour_leaves_and_comes_back(
    tmp_path: Path, house: dict[str, str]
):
    demo = [*COMMAND, "demo", "--speed", "20", "--session", str(tmp_path / "night")]
    with Terminal(demo, house, SIZE) as seat:
        # What is simulated, and what will come.
        words = ("DEMO ×20 SIMULATED", "searches for a satellite")
        wait_for(lambda: seat.shows(*words), "words", seat)
        wait_for(lambda: seat.shows("TRACK"), "a lock", seat)
        # F1: the tour first, page by page, then the keys and the terms.
        shown_after(seat, F1, "tour 1 of 4", "what you see")
        shown_after(seat, RIGHT, "tour 2 of 4")
        shown_after(seat, RIGHT, "tour 3 of 4")
        shown_after(seat, RIGHT, "how to stop", "rsoconsole stop")
        seat.press(RIGHT)
        time.sleep(0.3)
        shown_after(seat, F1, "help: keys and signs", "Telescope")
        shown_after(seat, "\t", "help: terms", "confidence")
        seat.press(ESC)
        time.sleep(0.5)
        # Leave: the engine goes on.
        shown_after(seat, "q", "leave the console", "keeps running")
        time.sleep(READS_S)
        seat.press("l")
        wait_for(lambda: seat.process.poll() is not None, "the console's end", seat)
        assert seat.process.returncode == 0
    with Terminal([*COMMAND, "console"], house, SIZE) as seat:
        # The whole night is there again.
        wait_for(lambda: seat.shows("DEMO ×20 SIMULATED", "STOP"), "the seat again", seat)
        shown_after(seat, "l", "ACQUIRE → TRACK")
        seat.press("l")
        known = len(seat.text)
        seat.press(F1)
        wait_for(lambda: seat.shows("help: keys", since=known), "the help, not the tour", seat)
        seat.press(ESC)
        time.sleep(0.5)
        shown_after(seat, "q", "leave the console")
        time.sleep(READS_S)
        seat.press("s")
        wait_for(lambda: seat.process.poll() is not None, "the engine's end", seat)


@pytest.mark.nightly("a morning in a terminal")
def test_a_morning_from_the_miss_to_the_what_if_of_the_same_night(house: dict[str, str]):
    with Terminal([*COMMAND, "review", str(SAMPLE)], house, SIZE) as seat:
        wait_for(lambda: seat.shows("REVIEW", "frame 0001 · 10 s"), "a screen", seat)
        # Where was it missed, and what did the sky do?
        shown_after(seat, "E", "events: ○ miss")
        shown_after(seat, ">", "COAST")
        shown_after(seat, "2", "FWHM", "stars")
        shown_after(seat, "4", "polar alignment")
        shown_after(seat, "1", "plots: confidence")
        # The night's end, with another Q, before anything is saved.
        shown_after(seat, "\x1b[F", "frame 0036")
        shown_after(seat, "t", " to here")
        shown_after(seat, DOWN * 2 + RIGHT, "→")
        wait_for(lambda: seat.shows("if tried"), "the effect", seat)
        seat.press(ESC)
        time.sleep(0.5)
        seat.press("q")
        wait_for(lambda: seat.process.poll() is not None, "its end", seat)
        assert seat.process.returncode == 0
    what_if = [*COMMAND, "what-if", str(SAMPLE), "--q", "4"]
    with Terminal(what_if, house, SIZE) as shell:
        wait_for(lambda: shell.process.poll() is not None, "both nights side by side", shell)
        wait_for(lambda: shell.shows("NIS", "misses"), "its figures", shell)
        assert shell.process.returncode == 0
