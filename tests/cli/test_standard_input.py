"""``-`` is a file on standard input, ``--files-from`` a list; what is piped stays quiet."""

import json
import os
import pty
import re
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from astropy.io import fits
from typer.testing import CliRunner

from rsoconsole.base import RsoconsoleError
from rsoconsole.cli.app import app
from tests.rigs.in_process import run_here

ROOT = Path(__file__).resolve().parents[2]
NIGHT = ROOT / "sessions" / "intelsat-14"
BELT = ROOT / "rsoconsole" / "simulator" / "data" / "belt_20230622.tle"
needs_night = pytest.mark.skipif(not NIGHT.exists(), reason="no checkout: the night is not here")
PROGRAM = [sys.executable, "-c", "from rsoconsole.cli import main; main()"]


def asked(*words: str | Path, stdin: bytes = b"", code: int = 0) -> list[dict[str, Any]]:
    """What a verb prints as JSON, without what differs from run to run."""
    done = CliRunner().invoke(app, [*map(str, words), "--json"], input=stdin)
    assert done.exit_code == code, (done.output, done.exception)
    rows = [json.loads(line) for line in done.stdout.splitlines()]
    for row in rows:
        row.pop("ms", None)
    return rows


def refused(*words: str | Path, stdin: bytes = b"") -> str:
    """Why it is wrong usage, in one line."""
    done = CliRunner().invoke(app, [*map(str, words)], input=stdin)
    assert done.exit_code == 2, (done.output, done.exception)
    return " ".join(re.sub(r"[│╭╰─╮╯]", "", done.stderr).split())


@pytest.fixture(scope="module")
def frames(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Two of noise, the second with a streak drawn in."""
    rng = np.random.default_rng(5)
    folder = tmp_path_factory.mktemp("frames of noise")
    paths = [folder / "1.fits", folder / "2.fits"]
    for number, path in enumerate(paths):
        pixels = rng.normal(1000.0, 20.0, (480, 640))
        if number:
            pixels[240:243, 200:320] += 400.0
        fits.writeto(path, pixels.astype(np.uint16))
    return paths


@pytest.fixture(scope="module")
def of_both(frames: list[Path]) -> list[dict[str, Any]]:
    """What is detected in them when they are named."""
    return asked("detect", *frames)


def test_a_frame_on_standard_input_is_what_it_is_in_a_file(frames: list[Path]) -> None:
    (by_name,) = asked("detect", frames[1])
    (piped,) = asked("detect", "-", stdin=frames[1].read_bytes())
    assert piped.pop("frame") == "-"
    assert by_name.pop("frame") == str(frames[1])
    assert piped == by_name
    assert len(by_name["detections"]) == 1


def test_it_may_stand_among_others_and_leaves_nothing_behind(
    frames: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    found = asked("detect", frames[0], "-", stdin=frames[1].read_bytes())
    assert [each["frame"] for each in found] == [str(frames[0]), "-"]
    assert list(tmp_path.iterdir()) == []
    (found_by_process,) = asked("process", "-", stdin=frames[1].read_bytes())
    assert found_by_process["frame"] == "-"
    assert list(tmp_path.iterdir()) == []


def test_what_is_no_frame_is_said_without_the_place_where_it_lay(tmp_path: Path) -> None:
    for content in (b"", b"no frame", b"SIMPLE  =                    T" + b" " * 50):
        for name in ("detect", "process", "solve"):
            (row,) = asked(name, "-", stdin=content, code=1)
            assert row["frame"] == "-"
            assert "rsoconsole-" not in row["error"]
            assert "/" not in row["error"].replace("and/or", "")


@pytest.mark.parametrize(
    ("ends", "is_piped"), [(b"\n", True), (b"\n", False), (b"\r\n", False), (b"\0", True)]
)
def test_names_are_read_from_a_file_or_a_pipe(
    frames: list[Path], of_both: list[dict[str, Any]], ends: bytes, is_piped: bool, tmp_path: Path
) -> None:
    names = ends.join(os.fsencode(each) for each in frames) + ends
    (tmp_path / "list").write_bytes(names)
    source = "-" if is_piped else str(tmp_path / "list")
    found = asked("detect", "--files-from", source, stdin=names if is_piped else b"")
    assert found == of_both
    after = asked("detect", frames[1], "--files-from", source, stdin=names if is_piped else b"")
    assert [each["frame"] for each in after] == [str(frames[1]), *map(str, frames)]


def test_an_empty_list_is_no_fault_and_no_work() -> None:
    for name in ("detect", "process", "solve"):
        assert asked(name, "--files-from", "-") == []


def test_what_cannot_be_read_is_wrong_usage_in_a_line(frames: list[Path], tmp_path: Path) -> None:
    assert "name files" in refused("detect")
    assert "read once" in refused("detect", "-", "-")
    assert "read once" in refused("detect", "-", "--files-from", "-")
    assert "No such file" in refused("detect", "--files-from", tmp_path / "nosuch")
    assert "Is a directory" in refused("detect", "--files-from", tmp_path)


def test_a_terminal_is_not_waited_for() -> None:
    here, there = pty.openpty()
    try:
        with os.fdopen(there, encoding="utf-8") as terminal:
            for words in (["detect", "-"], ["detect", "--files-from", "-"], ["orbit", "-"]):
                done = run_here(*words, stdin=terminal)
                assert done.returncode == 2
                assert "nothing is piped in" in done.stderr
                assert done.stderr.count("\n") == 1
    finally:
        os.close(here)


@needs_night
def test_what_one_verb_writes_another_reads(tmp_path: Path) -> None:
    out = CliRunner().invoke(app, ["export", str(NIGHT), "--format", "tdm", "--out", "-"])
    assert out.exit_code == 0
    file = tmp_path / "-"
    file.write_text(out.stdout)
    site = ["--site", "29.19,-81.05,10"]
    from_file = asked("orbit", file, *site)
    assert asked("orbit", "-", *site, stdin=out.stdout.encode()) == from_file
    named = asked("identify", "-", "--tle", BELT, *site, stdin=out.stdout.encode())
    assert named[0]["matches"][0]["norad_id"] == 36097
    same = asked("identify", NIGHT, "--tle", "-", stdin=BELT.read_bytes())
    assert same[0]["matches"][0]["norad_id"] == 36097
    assert "read once" in refused("passes", "--tle", "-", "--tle", "-", stdin=BELT.read_bytes())


@needs_night
def test_errors_of_files_that_were_piped_name_standard_input() -> None:
    for words in (["orbit", "-"], ["identify", str(NIGHT), "--tle", "-"], ["passes", "--tle", "-"]):
        done = CliRunner().invoke(app, words, input=b"nothing of use\n")
        assert isinstance(done.exception, RsoconsoleError)
        assert "standard input" in str(done.exception)
        assert "/rsoconsole-" not in str(done.exception)


# Pipes and terminals


def run_with_terminal(words: list[str | Path]) -> tuple[bytes, bytes]:
    """What goes to stdout, and what to a terminal on stderr."""
    here, there = pty.openpty()
    with subprocess.Popen(
        [*PROGRAM, *map(str, words)], stdout=subprocess.PIPE, stderr=there
    ) as process:
        os.close(there)
        seen = all_of(here)
        assert process.stdout is not None
        out = process.stdout.read()
        assert process.wait(60) == 0
    os.close(here)
    return out, seen


def run_with_terminal_here(words: list[str | Path]) -> tuple[bytes, bytes]:
    """The verb in the process of the tests, with a terminal as standard error."""
    here, there = pty.openpty()
    seen: list[bytes] = []
    reader = threading.Thread(target=lambda: seen.append(all_of(here)))
    reader.start()
    try:
        with os.fdopen(there, "w", encoding="utf-8") as terminal:
            done = run_here(*words, stderr=terminal)
    finally:
        reader.join()
        os.close(here)
    assert done.returncode == 0
    return done.stdout.encode(), seen[0]


def all_of(terminal: int) -> bytes:
    """What is written at its other end until that is closed."""
    seen = b""
    try:
        while chunk := os.read(terminal, 65536):
            seen += chunk
    except OSError:  # the other end is closed
        pass
    return seen


def test_progress_is_for_a_terminal_on_stderr_alone(frames: list[Path]) -> None:
    words: list[str | Path] = ["detect", *frames, *frames, "--json"]
    quiet = run_here(*words)
    assert quiet.returncode == 0
    assert "frames" not in quiet.stderr
    assert "\x1b" not in quiet.stderr + quiet.stdout
    out, seen = run_with_terminal_here(words)
    assert b"frames" in seen
    assert b"/4" in seen
    assert b"\x1b" not in out
    assert len(out.splitlines()) == len(quiet.stdout.splitlines()) == 4


LONG: list[tuple[list[str | Path], str]] = [
    (["orbit", NIGHT, "--json"], "orbit"),
    (["identify", NIGHT, "--tle", BELT, "--json"], "names"),
    (["export", NIGHT, "--format", "tdm", "--out", "-"], "export tdm"),
    (["sessions", "verify", NIGHT, "--json"], "verifying"),
]


@needs_night
@pytest.mark.parametrize(("words", "bar"), LONG)
def test_long_work_says_how_far_it_is(words: list[str | Path], bar: str) -> None:
    quiet = run_here(*words)
    assert quiet.returncode == 0
    assert "\x1b" not in quiet.stderr + quiet.stdout
    assert bar not in quiet.stderr
    out, seen = run_with_terminal_here(words)
    assert bar.encode() in seen
    assert b"\x1b" not in out


nightly = pytest.mark.nightly("starts the program in a terminal")


@needs_night
@pytest.mark.parametrize(
    ("words", "bar"), [*(pytest.param(*each, marks=nightly) for each in LONG[:-1]), LONG[-1]]
)
def test_the_program_in_a_terminal_says_so_too(words: list[str | Path], bar: str) -> None:
    out, seen = run_with_terminal(words)
    assert bar.encode() in seen
    assert b"\x1b" not in out


@needs_night
@pytest.mark.parametrize(
    "words",
    [
        ["config", "show"],
        pytest.param(["config", "show", "--json"], marks=nightly),
        ["export", str(NIGHT), "--format", "jsonl", "--out", "-"],
        pytest.param(["--help"], marks=nightly),
        pytest.param(["orbit", "--help"], marks=nightly),
    ],
)
def test_a_reader_that_goes_is_no_fault(words: list[str]) -> None:
    with subprocess.Popen(
        [*PROGRAM, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        assert process.stderr.read() == b""
        assert process.wait(60) == 141
