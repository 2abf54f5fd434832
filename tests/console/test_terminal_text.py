"""What strangers wrote is shown as text: no verb and no screen lets it command the terminal."""

import ast
import contextlib
import json
import shutil
import socket
import sqlite3
import sys
import threading
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from astropy.io import fits
from rich.segment import Segment
from rich.style import Style
from textual.color import Color

import rsoconsole.cli
from rsoconsole.base import resource_path
from rsoconsole.cli import main
from rsoconsole.console.drawing.plain import ControlCharacterFilter, without_terminal_commands
from tests.console.test_review_terminal import COMMAND, home, shown_after, wait_for
from tests.nights.samples import SAMPLE
from tests.rigs.terminal import Terminal

__all__ = ["home"]

BELT = resource_path("simulator", "data", "belt_20230622.tle")
EVIL = "\x1b]0;pwned\x07\x1b]52;c;cm0=\x07\x1b[31m\x9b31m\u202e\u2066\x00\r\nFORGED"
"""A title, the clipboard, a colour, one with a C1 control, turned text, and a line of its own."""

Run = Callable[..., str]


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    """The program with these words; all it said, which must be text on lines of its own."""
    for name in ("CONFIG", "DATA", "STATE", "CACHE"):
        monkeypatch.setenv(f"XDG_{name}_HOME", str(tmp_path / name))

    def ran(*words: object) -> str:
        monkeypatch.setattr(sys, "argv", ["rsoconsole", *map(str, words)])
        with pytest.raises(SystemExit):
            main()
        said = "".join(capsys.readouterr())
        assert all(letter.isprintable() or letter == "\n" for letter in said), repr(said)
        assert not [line for line in said.splitlines() if line.startswith("FORGED")]
        return said

    return ran


def with_evil(value: Any) -> Any:
    """The same with every text that people read continued."""
    if isinstance(value, dict):
        return {key: with_evil(each) for key, each in value.items()}
    if isinstance(value, list):
        return [with_evil(each) for each in value]
    return value + EVIL if isinstance(value, str) and " " in value else value


@pytest.fixture
def foreign(tmp_path: Path) -> Path:
    """The sample with evil in its name, its facts, its records and its file names."""
    folder = tmp_path / "sessions" / f"night{EVIL.replace(chr(0), '')}"
    shutil.copytree(SAMPLE, folder)
    with closing(sqlite3.connect(folder / "session.db")) as connection:
        for seq, body in connection.execute("SELECT seq, body FROM log").fetchall():
            changed = json.dumps(with_evil(json.loads(body)))
            connection.execute("UPDATE log SET body = ? WHERE seq = ?", (changed, seq))
        connection.execute("UPDATE log SET kind = kind || ? WHERE seq % 50 = 0", (EVIL,))
        connection.execute(
            "UPDATE meta SET value = ? WHERE key = 'title'", (json.dumps(f"a title {EVIL}"),)
        )
        connection.execute("UPDATE files SET path = path || ? WHERE frame_id = 11", (EVIL,))
        connection.commit()
    branch = folder / "branches" / EVIL.replace("\x00", "")
    branch.mkdir(parents=True)
    shutil.copy(folder / "session.db", branch)
    return folder


@pytest.mark.parametrize(
    "words",
    [
        ("sessions", "verify"),
        ("sessions", "repair"),
        ("sessions", "keep"),
        ("sessions", "archive"),
        ("review",),
        ("what-if", "--q", "4"),
        ("orbit",),
        ("identify", "--tle", str(BELT)),
        ("figures",),
        ("export", "--format", "csv"),
    ],
    ids=" ".join,
)
def test_no_verb_prints_what_a_session_commands(run, foreign, tmp_path, words, monkeypatch):
    monkeypatch.chdir(tmp_path)
    place = ["--out", tmp_path / "out"] if words[0] in ("figures", "export") else []
    options = words[1:] if words[0] != "sessions" else words[2:]
    verb = words[:1] if words[0] != "sessions" else words[:2]
    assert run(*verb, foreign, *options, *place)


def test_the_list_shows_a_foreign_session_on_one_line(run, foreign):
    said = run("sessions", "--root", foreign.parent)
    assert len(said.splitlines()) == 2
    assert "night" in said


def test_a_damaged_word_is_quoted_without_its_commands(run, foreign):
    with closing(sqlite3.connect(foreign / "session.db")) as connection:
        connection.execute("UPDATE meta SET value = ? WHERE key = 'config'", (EVIL,))
        connection.commit()
    assert "table meta" in run("sessions", "verify", foreign)
    assert "table meta" in run("sessions", "--root", foreign.parent)


def frame(folder: Path) -> Path:
    """With evil in its own name and in that of its extension."""
    path = folder / f"frame{EVIL.replace(chr(0), '')}.fits"
    sky = np.random.default_rng(1).normal(800.0, 20.0, (96, 128)).astype(np.uint16)
    units = [fits.PrimaryHDU(), fits.ImageHDU(sky, name="SCIENCE_"), fits.ImageHDU(sky, name="B")]
    fits.HDUList(units).writeto(path)
    content = path.read_bytes().replace(b"SCIENCE_", b"\x1b]0;x\x07\n")
    path.write_bytes(content)
    return path


@pytest.mark.parametrize("verb", ["detect", "process", "solve"])
def test_no_name_of_a_frame_and_no_header_commands_the_terminal(run, tmp_path, verb):
    assert "frame" in run(verb, frame(tmp_path))
    assert "frame" in run(verb, tmp_path / f"no frame{EVIL.replace(chr(0), '')}")


def test_no_name_in_an_element_file_commands_the_terminal(run, tmp_path):
    elements = tmp_path / "elements.tle"
    rows = BELT.read_text(encoding="utf-8").splitlines()
    names = EVIL.replace("\r\n", " ")
    elements.write_text(
        "\n".join(row if row[:2] in ("1 ", "2 ") else row + names for row in rows), "utf-8"
    )
    said = run("identify", SAMPLE, "--tle", elements)
    assert "objects compared" in said or "element" in said


def test_wrong_usage_is_quoted_without_its_commands(run):
    assert "rsoconsole" in run("sessions", f"--{EVIL}")
    assert run(f"verb{EVIL}")
    assert run("set", f"detector.tau{EVIL}", "1")


def announce(listener: socket.socket) -> None:
    """What an INDI server says of a device that is called like that."""
    name = "Mount&#27;[31m&#x202e;&#x2066;&#10;FORGED"
    words = (
        f'<defSwitchVector device="{name}" name="CONNECTION" state="Ok" perm="rw" rule="AnyOfMany">'
    )
    words += '<defSwitch name="CONNECT">On</defSwitch></defSwitchVector>'
    with contextlib.ExitStack() as peers, contextlib.suppress(OSError):
        while True:
            peer = peers.enter_context(listener.accept()[0])
            peer.sendall(words.encode())


def test_no_name_of_an_indi_device_commands_the_terminal(run, tmp_path):
    config = tmp_path / "config.toml"
    with socket.create_server(("127.0.0.1", 0)) as listener:
        server = threading.Thread(target=announce, args=(listener,), daemon=True)
        server.start()
        port = listener.getsockname()[1]
        config.write_text(
            f'[indi]\nport = {port}\nmount = "Telescope"\ncamera = "CCD"\n[waits]\nquiet_s = 1\n'
        )
        assert "it has: Mount" in run("doctor", "--config", config)
        listener.shutdown(socket.SHUT_RDWR)
        server.join()


PRINTS = {"app.py": 1, "demo_night.py": 1}
"""Help of the program's own, and messages to another process."""


def test_nothing_is_printed_past_the_one_place():
    found: dict[str, int] = {}
    for path in Path(rsoconsole.cli.__file__).parent.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and ast.unparse(node.func) in (
                "print",
                "typer.echo",
                "typer.secho",
                "sys.stdout.write",
                "sys.stderr.write",
            ):
                found[path.name] = found.get(path.name, 0) + 1
    assert found.pop("output.py") > 0
    assert found == PRINTS


def test_a_line_of_the_screen_keeps_its_width_and_loses_its_commands():
    style = Style(color="red")
    line = [Segment(f"a{EVIL}b", style), Segment("\x1b[3;4H"), Segment("plain", style)]
    cleaned = ControlCharacterFilter().apply(line, Color(0, 0, 0))
    assert "".join(each.text for each in cleaned).isprintable() is False  # the cursor's own move
    assert cleaned[0].text.isprintable()
    assert cleaned[1:] == line[1:]
    assert Segment.get_line_length(cleaned[:1]) == Segment.get_line_length(line[:1])
    picture = Segment("\x1bPq#0\x1b\\", None, [(1, 2)])  # type: ignore[list-item]
    assert ControlCharacterFilter().apply([picture], Color(0, 0, 0)) == [picture]


@pytest.mark.parametrize("sign", ["─", "█", "▘", "⣿", "±", "″", "\U0001cd00", "\U0010eeee\u0305"])
def test_signs_that_the_screen_draws_with_are_left_alone(sign):
    assert without_terminal_commands(sign) == sign


def test_no_screen_passes_on_what_a_session_commands(foreign, home):
    with Terminal([*COMMAND, str(foreign)], home, (120, 40)) as seat:
        wait_for(lambda: seat.shows("frame 0001"), "a screen")
        shown_after(seat, "\x1b[F", "frame 0036")  # end
        wait_for(lambda: "pwned" in seat.text, "what was written")
        for forbidden in ("pwned\x07", "\x1b]52;", "\x9b31m", "\u202e", "\u2066", "\x00"):
            assert forbidden not in seat.raw
