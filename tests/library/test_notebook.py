"""sessions/review.ipynb: it runs as it is shipped, and what it shows is what it is shipped with."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.nights.samples import SAMPLE, SESSIONS
from tests.rigs.browser_lab import environment_of

NOTEBOOK = SESSIONS / "review.ipynb"
MAX_BYTES = 1_500_000
FIGURES = 7
"""The streak, the paper's five, residuals of what-if."""


def read(path: Path) -> list[dict[str, Any]]:
    """Its code cells."""
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    return [cell for cell in cells if cell["cell_type"] == "code"]


def words(cell: dict[str, Any]) -> list[str]:
    """What a cell printed and gave, without pictures."""
    said = []
    for output in cell["outputs"]:
        data = output.get("data", {})
        said += ["".join(output.get("text", [])), "".join(data.get("text/plain", []))]
        said.append("".join(data.get("text/html", [])))
    # Astropy names each table by its place in memory.
    return [re.sub(r"table\d+(-\d+)?", "table", text) for text in said if text]


def pictures(cells: list[dict[str, Any]]) -> int:
    """How many figures there are."""
    return sum("image/png" in out.get("data", {}) for cell in cells for out in cell["outputs"])


@pytest.fixture(scope="module")
def executed(tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, Any]]:
    """Run in a copy beside a copy of the sample, by a process and with a home of its own."""
    pytest.importorskip("nbclient", reason="needs rsoconsole[notebook]: nbclient is missing")
    pytest.importorskip("ipykernel", reason="needs rsoconsole[notebook]: ipykernel is missing")
    pytest.importorskip("pandas", reason="needs rsoconsole[notebook]: pandas is missing")
    folder = tmp_path_factory.mktemp("review")
    copy = folder / "sessions"
    copy.mkdir()
    for name in ("review.ipynb", "execute_notebooks.py"):
        shutil.copy(SESSIONS / name, copy)
    shutil.copytree(SAMPLE, copy / SAMPLE.name)
    before = {p: p.stat().st_mtime_ns for p in (copy / SAMPLE.name).rglob("*")}
    run = subprocess.run(
        [sys.executable, str(copy / "execute_notebooks.py"), "review.ipynb", "--out", str(folder)],
        env=environment_of(folder / "home", PYTHONWARNINGS=""),
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr[-3000:]
    assert {p: p.stat().st_mtime_ns for p in (copy / SAMPLE.name).rglob("*")} == before
    return read(folder / "review.ipynb")


@pytest.mark.nightly("executes the shipped notebook")
def test_it_runs_without_an_error_and_shows_its_figures(executed):
    outputs = [output for cell in executed for output in cell["outputs"]]
    assert "error" not in {output["output_type"] for output in outputs}
    assert [output for output in outputs if output.get("name") == "stderr"] == []
    assert pictures(executed) == FIGURES


@pytest.mark.nightly("executes the shipped notebook")
def test_its_words_and_tables_are_those_it_is_shipped_with(executed):
    shipped = read(NOTEBOOK)
    assert [cell["source"] for cell in shipped] == [cell["source"] for cell in executed]
    for old, new in zip(shipped, executed, strict=True):
        assert words(new) == words(old), (
            f"{''.join(old['source'])}\nis out of date: python sessions/execute_notebooks.py"
        )
    assert pictures(shipped) == FIGURES


@pytest.mark.nightly("executes the shipped notebook")
def test_what_it_says_of_the_night_is_so(executed):
    said = "\n".join(text for cell in executed for text in words(cell))
    for figure in (
        "after 4 frames",
        "36, 2 kept in full",
        "6 of 32 frames with a track",
        "14.985 arcsec / s over 16.0 min",
        "(1760, 2328) uint16",
        "cloud: 3 stars where 400 were; no detection",
        "constrained by prior",
        "INTELSAT 14",
        "3.16″",
        "3.17″",
        "29 icrs arcsec2",
    ):
        assert figure in said
    (proof,) = (words(cell) for cell in executed if "is_alike" in "".join(cell["source"]))
    assert proof == ["True"]


def test_it_is_small_and_names_no_machine():
    text = NOTEBOOK.read_text(encoding="utf-8")
    assert len(text) < MAX_BYTES
    assert not re.search(r"/(home|root|tmp|work|Users)/", text)
    metadata = json.loads(text)["metadata"]
    assert "version" not in metadata["language_info"]
    assert not any("execution" in cell["metadata"] for cell in read(NOTEBOOK))
    assert os.fspath(SESSIONS) not in text
