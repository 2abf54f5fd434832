"""The library's notebooks: they run as they are shipped, and show what they are shipped with."""

import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.library.test_notebook import pictures, read, words
from tests.nights.samples import SAMPLE, SESSIONS
from tests.rigs.browser_lab import environment_of

FRAMES = SESSIONS / "frames"
FIGURES = {"own-frames.ipynb": 1, "orbit-to-name.ipynb": 1}
MAX_BYTES = 3_000_000


@pytest.fixture(scope="module")
def executed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[dict[str, Any]]]:
    """Run in a copy beside copies of what they read, by a process and with a home of its own."""
    for library in ("nbclient", "ipykernel", "matplotlib"):
        pytest.importorskip(library, reason=f"needs rsoconsole[notebook]: {library} is missing")
    folder = tmp_path_factory.mktemp("library")
    copy = folder / "sessions"
    copy.mkdir()
    for name in (*FIGURES, "execute_notebooks.py"):
        shutil.copy(SESSIONS / name, copy)
    shutil.copytree(FRAMES, copy / "frames")
    shutil.copytree(SAMPLE, copy / SAMPLE.name)
    before = {p: p.stat().st_mtime_ns for p in copy.rglob("*") if p.is_file()}
    run = subprocess.run(
        [sys.executable, str(copy / "execute_notebooks.py"), *FIGURES, "--out", str(folder)],
        env=environment_of(folder / "home", PYTHONWARNINGS=""),
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr[-3000:]
    # What they write they take away, and nothing that was there is changed.
    after = {p: p.stat().st_mtime_ns for p in copy.rglob("*") if p.is_file()}
    assert after == before
    return {name: read(folder / name) for name in FIGURES}


@pytest.mark.nightly("executes notebooks")
@pytest.mark.parametrize("name", FIGURES)
def test_they_run_without_an_error_and_show_their_figures(executed, name):
    outputs = [output for cell in executed[name] for output in cell["outputs"]]
    assert "error" not in {output["output_type"] for output in outputs}
    assert [output for output in outputs if output.get("name") == "stderr"] == []
    assert pictures(executed[name]) == FIGURES[name]


@pytest.mark.nightly("executes notebooks")
@pytest.mark.parametrize("name", FIGURES)
def test_their_words_and_tables_are_those_they_are_shipped_with(executed, name):
    shipped = read(SESSIONS / name)
    assert [cell["source"] for cell in shipped] == [cell["source"] for cell in executed[name]]
    for old, new in zip(shipped, executed[name], strict=True):
        assert "".join(words(new)) == "".join(words(old)), (
            f"{''.join(old['source'])}\nis out of date: python sessions/execute_notebooks.py {name}"
        )


@pytest.mark.nightly("executes notebooks")
def test_what_they_say_is_so(executed):
    own = "\n".join(text for cell in executed["own-frames.ipynb"] for text in words(cell))
    # A geostationary satellite at declination -4.8 runs east by 15.04 arcsec/s times its cosine.
    rate = re.search(r"(\d+\.\d\d) arcsec / s, towards 90 deg", own)
    assert rate is not None
    assert float(rate[1]) == pytest.approx(14.99, rel=0.015)
    for figure in ("track 1: 6 measurements", "0 stars, 8"):
        assert figure in own, figure
    name = "\n".join(text for cell in executed["orbit-to-name.ipynb"] for text in words(cell))
    for figure in ("identified INTELSAT 14 36097", "'unknown'", "has no unit"):
        assert figure in name, figure


def test_frames_and_notebooks_are_small():
    files = [*FRAMES.iterdir(), *(SESSIONS / name for name in FIGURES)]
    assert sum(Path(file).stat().st_size for file in files) < MAX_BYTES
