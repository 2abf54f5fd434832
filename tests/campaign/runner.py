"""Runs nights side by side, each answer kept in a file of its own: interrupted, it goes on."""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path
from typing import Any

from rsoconsole.config import APP
from tests.campaign.cases import Case, RealIndi
from tests.real_sky import real_sky_night

_PROGRAM = "import sys; from rsoconsole.cli import main; sys.argv[0] = 'rsoconsole'; main()"
_NIGHT_S = 3600.0
_LOOK_S = 5.0
INDEX = Path(__file__).resolve().parents[2] / ".cache/index/usr/share/astrometry"
"""The whole sky's stars, fetched by ``tests/fetch_debian_index.sh``."""
RESULTS = Path(__file__).with_name("results")
_ALLOCATOR = {"MALLOC_MMAP_THRESHOLD_": "2000000000", "MALLOC_TRIM_THRESHOLD_": "8000000000"}
"""Frames are drawn by the hundred megabytes: kept memory saves a tenth of the time."""


def answers(cases: Sequence[Case], folder: Path) -> dict[str, dict[str, Any]]:
    """What is known by now, by the name of the case."""
    return {
        case.name: json.loads(answer_path(case, folder).read_text(encoding="utf-8"))
        for case in cases
        if answer_path(case, folder).exists()
    }


def go_on(groups: Iterable[str], folder: Path) -> None:
    """Take the answers beside the table for known, where the folder has none of that night yet."""
    for group in groups:
        kept = RESULTS / f"{group}.json"
        if not kept.exists():
            continue
        for name, answer in json.loads(kept.read_text(encoding="utf-8")).items():
            path = folder / group / f"{name}.json"
            if not path.exists():
                _write(path, answer)


def _write(path: Path, answer: Mapping[str, Any]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_suffix(".partial")
    partial.write_text(json.dumps(answer, indent=1) + "\n", encoding="utf-8")
    partial.rename(path)


def keep(group: str, answers: Mapping[str, Mapping[str, Any]]) -> None:
    """Put the answers of a group beside the table: what later figures are compared with."""
    if answers:
        RESULTS.mkdir(exist_ok=True)
        lines = [f"{json.dumps(name)}: {json.dumps(each)}" for name, each in answers.items()]
        text = "{\n" + ",\n".join(lines) + "\n}\n"
        (RESULTS / f"{group}.json").write_text(text, encoding="utf-8")


def answer_path(case: Case, folder: Path) -> Path:
    """Where the answer of one night is kept."""
    return folder / case.group / f"{case.name}.json"


def run_missing(
    cases: Sequence[Case], folder: Path, jobs: int, sessions: Path | None = None
) -> Iterator[tuple[Case, Any]]:
    """Every night whose answer is not there yet, as it is done; ``sessions``: where they stay."""
    missing = [case for case in cases if not answer_path(case, folder).exists()]
    with ThreadPoolExecutor(jobs) as pool:
        running = {pool.submit(run, case, sessions): case for case in missing}
        for done in as_completed(running):
            case, answer = running[done], done.result()
            _write(answer_path(case, folder), answer)
            yield case, answer


def run(case: Case, sessions: Path | None = None) -> dict[str, Any]:
    """One night to its summary; ``{"error": ...}`` where it does not come to its end."""
    started_s = time.monotonic()
    found = _demo(case, sessions) if case.real_indi is None else _indi_night(case.real_indi)
    return found | {"wall_s": round(time.monotonic() - started_s, 1)}


def _indi_night(night: RealIndi) -> dict[str, Any]:
    try:
        found = real_sky_night.run_night(night.frames, night.seed, night.scatter_s)
    except RuntimeError as error:
        return {"error": str(error).splitlines()[0]}
    for each in found["objects"]:
        each["norad"] = each.pop("norad_id")
    return found


def _demo(case: Case, sessions: Path | None) -> dict[str, Any]:
    with tempfile.TemporaryDirectory(prefix="campaign-") as scratch:
        kept = Path(scratch) / "night" if sessions is None else sessions / case.group / case.name
        words = [*case.words, "--session", str(kept.absolute())]
        if case.world:
            world = Path(scratch) / "world.toml"
            world.write_text(case.world, encoding="utf-8")
            words += ["--world", str(world)]
        homes = ("RUNTIME_DIR", "STATE_HOME", "CONFIG_HOME", "DATA_HOME")
        own = {f"XDG_{name}": scratch for name in homes} | _ALLOCATOR
        if INDEX.exists():
            (Path(scratch) / APP).mkdir()
            (Path(scratch) / APP / "index").symlink_to(INDEX)
        program = ["-c", _PROGRAM, "demo", "--headless", "--json"]
        if case.late_s is not None:
            program = ["-m", "tests.campaign.late_pass", f"{case.late_s:.3f}"]
        child = subprocess.Popen(
            [sys.executable, *program, *words],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            stdin=subprocess.DEVNULL,
            env=os.environ | own,
        )
        try:
            stdout, stderr = _to_its_end(
                child, lambda: case.is_over is not None and case.is_over(kept)
            )
        except subprocess.TimeoutExpired:
            return {"error": f"not over after {_NIGHT_S:.0f} s"}
    if child.returncode != 0 or not stdout.strip():
        said = stderr.strip().splitlines() or ["it says nothing"]
        return {"error": said[-1]}
    found: dict[str, Any] = json.loads(stdout.splitlines()[-1])
    # Where it lay and how fast this machine was say nothing of the night.
    for unlike in ("session", "latency_ms"):
        found.pop(unlike, None)
    return found


def _to_its_end(child: subprocess.Popen[str], is_over: Callable[[], bool]) -> tuple[str, str]:
    """What it says; told to end where it may. Raises TimeoutExpired, and it is gone."""
    ends_s, is_told = time.monotonic() + _NIGHT_S, False
    try:
        while True:
            try:
                return child.communicate(timeout=_LOOK_S)
            except subprocess.TimeoutExpired:
                if time.monotonic() > ends_s:
                    raise
                if not is_told and is_over():
                    child.terminate()  # a second time would cut its summary short
                    is_told = True
    except BaseException:
        child.kill()
        child.communicate()
        raise
