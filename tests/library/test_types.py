"""A type checker sees what the library takes and gives, and its front door stays quick to open."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

import rsoconsole as rso
from rsoconsole.base import RsoconsoleError
from tests.pages.source_graph import ROOT, door, modules

SCRIPT = Path(__file__).parent / "typed_script.py"
_SAID = re.compile(r"^[^:]+:(\d+): (note|error): (.*)$")


@pytest.fixture(scope="module")
def said(tmp_path_factory: pytest.TempPathFactory) -> dict[int, list[tuple[str, str]]]:
    """By line: what mypy says of the script, with the package as it is installed."""
    folder = tmp_path_factory.mktemp("user")
    (folder / "script.py").write_text(SCRIPT.read_text(encoding="utf-8"), encoding="utf-8")
    run = subprocess.run(
        [
            *(
                sys.executable,
                "-m",
                "mypy",
                "--strict",
                "--no-error-summary",
                "--hide-error-context",
            ),
            *("--config-file", "", "--cache-dir", str(ROOT / ".mypy_cache" / "of_scripts")),
            "script.py",
        ],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode in (0, 1), run.stderr
    found: dict[int, list[tuple[str, str]]] = {}
    for line in run.stdout.splitlines():
        match = _SAID.match(line)
        assert match is not None, line
        found.setdefault(int(match[1]), []).append((match[2], match[3]))
    return found


def lines_with(mark: str) -> dict[int, str]:
    """What the script's comments promise, by line."""
    marked = {}
    for number, line in enumerate(SCRIPT.read_text(encoding="utf-8").splitlines(), start=1):
        if f"# {mark} " in line and not line.startswith("A line"):
            marked[number] = line.rpartition(f"# {mark} ")[2].strip()
    return marked


@pytest.mark.nightly("runs a type checker")
@pytest.mark.timeout(300)
def test_right_uses_have_their_types(said):
    expected = lines_with("is")
    assert len(expected) >= 12
    for number, type_ in expected.items():
        assert said.get(number) == [("note", f'Revealed type is "{type_}"')], number


@pytest.mark.nightly("runs a type checker")
@pytest.mark.timeout(300)
def test_wrong_uses_are_errors_and_nothing_else_is(said):
    expected = lines_with("error:")
    assert len(expected) >= 12
    errors = {
        number: [words for level, words in told if level == "error"]
        for number, told in said.items()
        if any(level == "error" for level, _ in told)
    }
    assert {number: f"[{code}]" for number, code in expected.items()} == {
        number: words[0].rpartition("  ")[2] for number, words in errors.items()
    }


def test_what_the_door_lists_is_there_and_in_tab_completion():
    listed = set(door(modules()["rsoconsole"]))
    assert listed == set(rso.__all__) - {"__version__"}
    assert listed <= set(dir(rso))
    for name in listed:
        assert getattr(rso, name).__doc__, name
    # Sub-packages that were imported do not hide it.
    assert {"detect", "solve", "measure", "track", "orbit", "identify"} <= listed
    assert callable(rso.orbit)
    assert issubclass(rso.NotSolvedError, RsoconsoleError)


@pytest.mark.parametrize("first", ["", "import rsoconsole.orbits.motion, rsoconsole.cli.app; "])
def test_the_functions_are_functions_whatever_was_imported_before(first: str):
    code = (
        f"{first}import rsoconsole as rso;"
        " print([type(getattr(rso, n)).__name__ for n in"
        " ('detect', 'solve', 'measure', 'track', 'orbit', 'identify')])"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == str(["function"] * 6)
