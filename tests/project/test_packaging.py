"""What the package brings with it, and what the package index shows of it."""

import importlib.util
import re
import subprocess
import tomllib
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
PROJECT = ROOT / "pyproject.toml"
pytestmark = pytest.mark.skipif(not PROJECT.exists(), reason="no checkout: the project is not here")
OWN_DATA = {".py", ".pyi", ".md", ".typed", ".css", ".js", ".j2", ".conf", ".service", ".1"}
"""Endings of what was written for this program."""


@pytest.fixture
def project() -> dict[str, Any]:
    return tomllib.loads(PROJECT.read_text(encoding="utf-8"))


@pytest.fixture
def hook() -> ModuleType:
    spec = importlib.util.spec_from_file_location("hatch_build", ROOT / "hatch_build.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def tracked(folder: str) -> list[str]:
    asked = ["git", "ls-files", folder]
    done = subprocess.run(asked, cwd=ROOT, capture_output=True, text=True, check=False)
    if done.returncode:
        pytest.skip("no git checkout")
    return done.stdout.split()


def test_everything_that_comes_from_others_is_in_the_notice(project: dict[str, Any]) -> None:
    notice = (ROOT / "NOTICE").read_text(encoding="utf-8")
    assert "NOTICE" in project["project"]["license-files"]
    shipped = [Path(each) for each in tracked("rsoconsole") if Path(each).suffix not in OWN_DATA]
    assert any(each.name == "tycho2_belt.npz" for each in shipped)
    for each in shipped:
        stem = re.sub(r"-\d\d\.fits$", "-*.fits", each.name)
        assert stem in notice, each
    for into in project["tool"]["hatch"]["build"]["targets"]["wheel"]["force-include"].values():
        assert Path(into).name in notice, into


def test_what_the_wheel_takes_from_outside_the_package_is_there_and_in_the_sources(
    project: dict[str, Any],
) -> None:
    targets = project["tool"]["hatch"]["build"]["targets"]
    for source in targets["wheel"]["force-include"]:
        assert (ROOT / source).exists()
        # The wheel is made of the source distribution.
        taken = [each.lstrip("/") for each in targets["sdist"]["include"]]
        assert any(Path(source).is_relative_to(each) for each in taken), source
    for each in project["project"]["license-files"]:
        assert (ROOT / each).is_file()


def test_on_the_package_index_no_link_leads_nowhere(hook: ModuleType) -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert "](sessions/console.png)" in readme
    shown = hook.for_package_index(readme)
    assert not re.findall(r"\]\((?!https?:)", shown)
    assert shown.startswith("# rsoconsole\n")
    assert "| The operator's console |" in shown
    assert len(shown) > 0.8 * len(readme)


def test_with_an_address_they_lead_there(hook: ModuleType) -> None:
    text = (
        "![a\nconsole](sessions/a.png)\n\nsee [this](b/c.md#d), [that](https://e.org/f) and [x](#y)"
    )
    assert hook.for_package_index(
        text, links="https://g.org/blob/", pictures="https://g.org/raw/"
    ) == (
        "![a\nconsole](https://g.org/raw/sessions/a.png)\n\n"
        "see [this](https://g.org/blob/b/c.md#d), [that](https://e.org/f) and [x](#y)"
    )
    assert hook.for_package_index(text) == "see this, [that](https://e.org/f) and [x](#y)"


def test_the_pythons_that_are_named_are_those_that_are_admitted(project: dict[str, Any]) -> None:
    told = [
        each.rpartition(" ")[2]
        for each in project["project"]["classifiers"]
        if each.startswith("Programming Language :: Python :: 3.")
    ]
    assert told == ["3.11", "3.12", "3.13", "3.14"]
    assert project["project"]["requires-python"] == ">=3.11"
