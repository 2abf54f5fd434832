"""The manual page is the program's own helps, sound roff, and every command on it is one."""

import re
import shutil
import subprocess
import tomllib
from pathlib import Path

import pytest
from typer.main import get_command

from rsoconsole.cli.app import app
from rsoconsole.cli.manual_page import PAGE, manual_page_source
from tests.cli.test_readme_commands import use

ROOT = Path(__file__).resolve().parents[2]


def read() -> str:
    """As a terminal of 200 columns shows it."""
    program = shutil.which("man")
    if program is None:
        pytest.skip("needs man")
    done = subprocess.run(
        [program, "--warnings=w", "-l", str(PAGE)],
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
        env={"PATH": "/usr/bin:/bin", "MANWIDTH": "200", "LC_ALL": "C.UTF-8", "MANPAGER": "cat"},
    )
    assert done.stderr == ""
    return done.stdout


def test_the_page_that_packages_bring_is_that_of_the_program() -> None:
    """``python -m rsoconsole.cli.manual_page`` writes it."""
    assert PAGE.read_text(encoding="utf-8") == manual_page_source()
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    shared = project["tool"]["hatch"]["build"]["targets"]["wheel"]["shared-data"]
    assert shared[str(PAGE.relative_to(ROOT))] == "share/man/man1/rsoconsole.1"


def test_man_shows_it_without_a_warning() -> None:
    shown = read()
    assert shown.startswith("RSOCONSOLE(1)")
    assert "rsoconsole - find and follow satellites" in shown
    # What roff might have taken for its own.
    assert "drift_px = 12 under [stars]" in " ".join(shown.split())
    assert "\\" not in shown


def test_mandoc_finds_nothing_to_say() -> None:
    program = shutil.which("mandoc")
    if program is None:
        pytest.skip("needs mandoc")
    done = subprocess.run(
        [program, "-Tlint", str(PAGE)], capture_output=True, text=True, timeout=60, check=False
    )
    said = [line for line in done.stdout.splitlines() if "missing date" not in line]
    assert said == []  # a page that is the same for everybody has no date


def test_every_verb_and_every_option_is_on_it() -> None:
    shown = PAGE.read_text(encoding="utf-8").replace("\\-", "-")
    section = re.compile(r'^\.SS "(rsoconsole [^"]+)"$(.*?)(?=^\.S[SH] )', re.MULTILINE | re.DOTALL)
    sections = dict(section.findall(shown))
    verbs = {head.partition(" [")[0]: body for head, body in sections.items()}

    def expect(command: object, path: str) -> int:
        inner = getattr(command, "commands", None)
        if inner is not None:
            return sum(expect(each, f"{path} {name}") for name, each in inner.items())
        body = next(text for head, text in sections.items() if f"{head} ".startswith(f"{path} "))
        for each in command.params:  # type: ignore[attr-defined]
            if each.param_type_name == "option" and "--help" not in each.opts:
                assert all(option in body for option in each.opts), (path, each.opts)
        return 1

    assert expect(get_command(app), "rsoconsole") > 40
    assert len(verbs) > 40


def commands() -> list[str]:
    """What a reader may type from it, but for what changes the shell's own files."""
    page = PAGE.read_text(encoding="utf-8")
    found = re.findall(r"^\.EX\n(.*?)^\.EE", page, re.MULTILINE | re.DOTALL)
    lines = [line.strip() for each in found for line in each.splitlines()]
    plain = [line.replace("\\-", "-").replace("\\&", "").replace("\\(aq", "'") for line in lines]
    return [each for each in dict.fromkeys(plain) if "--install-completion" not in each]


def own_part(line: str) -> str:
    """Of a line with pipes and variables what is the program's."""
    found = re.search(r"\brsoconsole\b[^|]*", line)
    assert found is not None, line
    return found[0].replace("*", "").strip()


@pytest.mark.parametrize("line", commands())
def test_every_command_on_it_is_one_that_the_program_takes(line: str) -> None:
    use(own_part(line))


def test_there_are_commands_on_it() -> None:
    assert len(commands()) > 40
