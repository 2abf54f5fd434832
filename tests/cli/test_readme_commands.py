"""Every command of the front page is one that the program takes; those without a telescope run."""

import inspect
import itertools
import re
import shlex
from pathlib import Path
from typing import Any

import pytest
from typer.main import get_command
from typer.testing import CliRunner

from rsoconsole.base import RsoconsoleError
from rsoconsole.cli.app import app
from rsoconsole.cli.words.usage import UsageError
from tests.nights.samples import SAMPLE

ROOT = Path(__file__).resolve().parents[2]
README = ROOT / "README.md"
NIGHT = ROOT / "sessions" / "intelsat-14"
BELT = ROOT / "rsoconsole" / "simulator" / "data" / "belt_20230622.tle"
pytestmark = pytest.mark.skipif(not NIGHT.exists(), reason="no checkout: the README is not here")
ALONE = {"goto", "solve", "detect"}
"""Named in a sentence without what they are given."""
OF_THE_SHELL = {"--install-completion"}
"""Changes the user's own files; ``test_completion.py`` runs it in a home of its own."""


def shown(text: str) -> list[str]:
    """The commands of a page: lines of consoles, and what its sentences and tables name."""
    found = re.findall(r"^\$ (?:\.venv/bin/)?(rsoconsole .*?)(?: +#.*)?$", text, re.MULTILINE)
    prose = re.sub(r"```.*?```", "", text, flags=re.DOTALL)
    found += [" ".join(each.split()) for each in re.findall(r"`(rsoconsole\s[^`]+)`", prose)]
    found += [
        each for row in re.findall(r"^\| (`rsoconsole .*?) \|", text, re.M) for each in row_of(row)
    ]
    return list(dict.fromkeys(part.strip() for each in found for part in each.split(" && ")))


def row_of(cell: str) -> list[str]:
    """The commands of a row, of which all but the first may be short: ``config init``, ``show``."""
    first, *others = re.findall(r"`([^`]+)`", cell)
    verbs = list(itertools.takewhile(str.islower, first.split()))
    whole = [
        each if each.startswith("rsoconsole") else f"{' '.join(verbs[:-1])} {each}"
        for each in others
    ]
    return [first, *whole]


def commands() -> list[str]:
    if not README.exists():
        return []
    found = shown(README.read_text(encoding="utf-8"))
    left_out = ALONE | OF_THE_SHELL
    return [each for each in found if not (len(each.split()) == 2 and each.split()[1] in left_out)]


def words_of(command: str) -> list[str]:
    """As a shell hands them over, with something in place of names in capitals."""
    stands_for = {
        "F": "csv",
        "NORAD": "36097",
        "TRACK": "1",
        "TARGET": "Vega",
        "SOURCE": "celestrak:geo",
        "FILE": str(BELT),
        "RA": "313.7",
        "DEC": "-4.8",
        "DEG": "1.5",
    }
    plain = re.sub(r"\[[A-Z]+\]", "", command.replace("...", ""))
    return [stands_for.get(word, word) for word in shlex.split(plain)[1:]]


def without_work(command: Any) -> Any:
    """The program with its usage as it is, where each verb takes what it is given, and no more."""
    for each in getattr(command, "commands", {}).values():
        without_work(each)
    if command.callback is not None:
        signature = inspect.signature(command.callback)
        own = {"context": None} if "context" in signature.parameters else {}
        command.callback = lambda **given: signature.bind(**own, **given) and None
    return command


def use(command: str) -> None:
    """Raises UsageError for what the program does not take."""
    without_work(get_command(app)).main(words_of(command), "rsoconsole", standalone_mode=False)


@pytest.mark.parametrize("command", commands())
def test_its_usage_is_right(command: str) -> None:
    use(command)


def test_wrong_usage_would_be_found() -> None:
    for wrong in ("rsoconsole orbits NIGHT", "rsoconsole orbit NIGHT --nosuch", "rsoconsole orbit"):
        with pytest.raises(UsageError):
            use(wrong)


RUN = [
    "rsoconsole config check",
    "rsoconsole catalogue list",
    "rsoconsole ledger",
    "rsoconsole sessions",
    "rsoconsole sessions verify NIGHT",
    "rsoconsole what-if NIGHT --q 4",
    "rsoconsole export NIGHT --format tdm --out - --norad 36097",
    "rsoconsole export SESSION --format F --out -",
    "rsoconsole status --prometheus",
]


@pytest.mark.parametrize("command", RUN)
def test_it_runs_on_the_sample_night(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("DATA", "CONFIG", "CACHE"):
        monkeypatch.setenv(f"XDG_{name}_HOME", str(tmp_path / name))
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.delenv("RSOCONSOLE_CONFIG", raising=False)
    night = str(SAMPLE if "what-if" in command else NIGHT)
    words = [night if word in {"NIGHT", "SESSION"} else word for word in words_of(command)]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, (done.output, done.exception)
    assert done.stdout.strip() or "ledger" in command or "sessions" in command


@pytest.mark.parametrize("command", ["status", "arm", "park", "resume", "hold", "unpark", "quit"])
def test_what_needs_an_engine_says_so_in_one_line(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    done = CliRunner().invoke(app, [command])
    assert isinstance(done.exception, RsoconsoleError)
    assert "engine" in str(done.exception)
    assert "\n" not in str(done.exception)
