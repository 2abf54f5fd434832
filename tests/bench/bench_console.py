"""How quick and how frugal the console is, in a real pseudo-terminal.

    python -m tests.bench.bench_console [--frames 5000] [--seconds 40] [--write]

Run from the project's root. A made-up session of so many frames is written; the console is opened
on it as an operator opens it, and timed from the command to its first line and to its last frame.
Then frames come in, one each 2 s: how long a key takes until its effect is on the terminal, and
what share of a core the program takes, idle and at work. Bytes written a second are taken at one
frame each 10 s. Dialogs are opened and closed over a demo at ten times the clock, which keeps one
core busy: from the key to the dialog's title, and from ``esc`` to the screen behind it, with the
terminal library's wait for what may follow an escape.
Prints; ``--write`` keeps the figures in ``results/console.json``.
"""

import argparse
import contextlib
import json
import os
import platform
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from statistics import median
from typing import Any

from rsoconsole.session import SessionWriter
from tests.nights import made_up_night as night
from tests.rigs.terminal import Terminal

RESULTS = Path(__file__).parent / "results" / "console.json"
COMMAND = [sys.executable, "-c", "from rsoconsole.cli import main; main()", "console", "--session"]
SIZE = (120, 40)
PATIENCE_S = 60.0
KEYS = 24
DIALOGS = {
    "g": "─ go to ─",
    "n": "─ note ─",
    "e": "─ exposure and cadence ─",
    "i": "─ aim beside the prediction ─",
    "j": "─ reject a measurement ─",
}
"""Keys, and what only their dialogs say."""
BEHIND = "x STOP"
TICKS_A_SECOND = os.sysconf("SC_CLK_TCK")


def write_session(folder: Path, frames: int) -> SessionWriter:
    """A night of so many frames, with pictures of the last ones; still open."""
    writer = night.begin(folder)
    night.armed(writer)
    for first in range(1, frames + 1, 250):
        night.add_frames(writer, range(first, min(first + 250, frames + 1)))
    night.add_previews(writer, range(max(frames - 2, 1), frames + 1))
    return writer


def _whole(frames: int) -> tuple[str, str]:
    """What a console says that has read the whole night and shows its last picture."""
    return f"frame {frames:04d}", f"of {frames}"


def cpu_s(pid: int) -> float:
    """Seconds of a core that a process has taken."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / TICKS_A_SECOND


def wait(is_so: Callable[[], bool]) -> float:
    """Seconds until it is."""
    began = time.monotonic()
    while not is_so():
        if time.monotonic() - began > PATIENCE_S:
            raise TimeoutError("it never came to be")
        time.sleep(0.001)
    return time.monotonic() - began


def first_paint(folder: Path, frames: int) -> dict[str, float]:
    """From the command to the first line, and to the session's end."""
    with Terminal([*COMMAND, str(folder)], os.environ, SIZE) as terminal:
        wait(lambda: terminal.shows("STOP"))
        first_s = time.monotonic() - terminal.begun_s
        wait(lambda: terminal.shows(*_whole(frames)))
        return {"first": first_s, "all": time.monotonic() - terminal.begun_s}


def at_work(folder: Path, writer: SessionWriter, options: argparse.Namespace) -> dict[str, float]:
    """Keys, processor and bytes while frames come each 2 s, and while none does."""
    frames, seconds = options.frames, options.seconds
    with Terminal([*COMMAND, str(folder)], os.environ, SIZE) as terminal:
        wait(lambda: terminal.shows(*_whole(frames)))
        time.sleep(2.0)
        pid = terminal.process.pid
        idle_share = _share(pid, seconds / 2.0)
        with coming(writer, frames, every_s=2.0) as last:
            busy_share = _share(pid, seconds)
            latencies = [_key_s(terminal, turn) for turn in range(KEYS)]
        with coming(writer, last(), every_s=10.0):
            bytes_before, began = len(terminal.written), time.monotonic()
            time.sleep(options.bytes_over)
            a_second = (len(terminal.written) - bytes_before) / (time.monotonic() - began)
    return {
        "key_ms": median(latencies) * 1e3,
        "key_largest_ms": max(latencies) * 1e3,
        "idle_percent": idle_share * 100.0,
        "busy_percent": busy_share * 100.0,
        "bytes_a_second": a_second,
    }


@contextlib.contextmanager
def coming(writer: SessionWriter, number: int, every_s: float) -> Iterator[Callable[[], int]]:
    """Frames after that one, so often, while it lasts; says which was the last."""
    is_over = threading.Event()

    def take_frames() -> None:
        nonlocal number
        while not is_over.wait(every_s):
            number += 1
            night.add_frames(writer, range(number, number + 1))
            night.add_previews(writer, range(number, number + 1))

    taker = threading.Thread(target=take_frames, daemon=True)
    taker.start()
    yield lambda: number
    is_over.set()
    taker.join()


def _share(pid: int, seconds: float) -> float:
    before, began = cpu_s(pid), time.monotonic()
    time.sleep(seconds)
    return (cpu_s(pid) - before) / (time.monotonic() - began)


def _key_s(terminal: Terminal, turn: int) -> float:
    """From a key to its word on the terminal."""
    word = ("full resolution", "field", "close-up")[turn % 3]
    taken_s = _until_s(terminal, "z", f"picture: {word}")
    time.sleep(0.15 + 0.05 * (turn % 5))
    return taken_s


def _until_s(terminal: Terminal, key: str, word: str) -> float:
    """From a key to a word on the terminal."""
    known, began = len(terminal.text), time.monotonic()
    terminal.press(key)
    wait(lambda: terminal.shows(word, since=known))
    return time.monotonic() - began


def at_dialogs(place: Path, rounds: int) -> dict[str, float]:
    """From key to dialog and from esc to the screen behind it; a demo keeps a core busy."""
    (place / "run").mkdir(mode=0o700)
    homes = ("STATE_HOME", "CONFIG_HOME", "DATA_HOME")
    own = {f"XDG_{name}": str(place) for name in homes} | {"XDG_RUNTIME_DIR": str(place / "run")}
    demo = [*COMMAND[:-2], "demo", "--speed", "10", "--session", str(place / "demo")]
    opened, closed = list[float](), list[float]()
    with Terminal(demo, {**os.environ, **own}, SIZE) as terminal:
        wait(lambda: terminal.shows("TRACK"))
        time.sleep(5.0)
        for turn in range(rounds):
            for key, title in DIALOGS.items():
                for pressed, word, taken in ((key, title, opened), ("\x1b", BEHIND, closed)):
                    taken.append(_until_s(terminal, pressed, word))
                    time.sleep(0.6 + 0.05 * (turn % 5))
        for key in ("q", "s"):
            terminal.press(key)
            time.sleep(2.0)
    return {
        "dialog_ms": median(opened) * 1e3,
        "dialog_largest_ms": max(opened) * 1e3,
        "esc_ms": median(closed) * 1e3,
        "esc_largest_ms": max(closed) * 1e3,
    }


def main() -> None:
    """Measure, print, and write when asked to."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, default=5000)
    parser.add_argument("--seconds", type=float, default=40.0)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--bytes-over", type=float, default=60.0, help="seconds")
    parser.add_argument("--rounds", type=int, default=8, help="times each dialog is opened")
    parser.add_argument("--write", action="store_true")
    options = parser.parse_args()
    figures: dict[str, Any] = {
        "machine": f"{platform.machine()}, {os.cpu_count()} cores",
        "load_before": round(os.getloadavg()[0], 1),
        "frames": options.frames,
        "terminal": f"{SIZE[0]}x{SIZE[1]}",
    }
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "night"
        writer = write_session(folder, options.frames)
        starts = [first_paint(folder, options.frames) for _ in range(options.repeats)]
        figures["first_paint_s"] = round(median(each["first"] for each in starts), 3)
        figures["whole_night_s"] = round(median(each["all"] for each in starts), 3)
        worked = at_work(folder, writer, options)
        figures |= {name: round(value, 2) for name, value in worked.items()}
        writer.close()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as place:
        dialogs = at_dialogs(Path(place), options.rounds)
        figures |= {name: round(value, 1) for name, value in dialogs.items()}
    figures["load_after"] = round(os.getloadavg()[0], 1)
    for name, value in figures.items():
        print(f"{name:24s} {value}")
    if options.write:
        RESULTS.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
