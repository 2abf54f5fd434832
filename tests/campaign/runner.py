"""Runs nights side by side, each answer kept in a file of its own: interrupted, it goes on."""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path
from typing import Any

from tests.campaign.cases import Case

_PROGRAM = "import sys; from rsoconsole.cli import main; sys.argv[0] = 'rsoconsole'; main()"
_NIGHT_S = 3600.0


def answers(cases: Sequence[Case], folder: Path) -> dict[str, dict[str, Any]]:
    """What is known by now, by the name of the case."""
    return {
        case.name: json.loads(answer_path(case, folder).read_text(encoding="utf-8"))
        for case in cases
        if answer_path(case, folder).exists()
    }


def answer_path(case: Case, folder: Path) -> Path:
    """Where the answer of one night is kept."""
    return folder / case.group / f"{case.name}.json"


def run_missing(cases: Sequence[Case], folder: Path, jobs: int) -> Iterator[tuple[Case, Any]]:
    """Every night whose answer is not there yet, as it is done."""
    missing = [case for case in cases if not answer_path(case, folder).exists()]
    with ThreadPoolExecutor(jobs) as pool:
        running = {pool.submit(run, case): case for case in missing}
        for done in as_completed(running):
            case, answer = running[done], done.result()
            path = answer_path(case, folder)
            path.parent.mkdir(parents=True, exist_ok=True)
            partial = path.with_suffix(".partial")
            partial.write_text(json.dumps(answer, indent=1) + "\n", encoding="utf-8")
            partial.rename(path)
            yield case, answer


def run(case: Case) -> dict[str, Any]:
    """One night from the verb to its summary; ``{"error": ...}`` where the verb ends with one."""
    started_s = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="campaign-") as scratch:
        words = [*case.words, "--session", str(Path(scratch) / "night")]
        if case.world:
            world = Path(scratch) / "world.toml"
            world.write_text(case.world, encoding="utf-8")
            words += ["--world", str(world)]
        own = {f"XDG_{name}": scratch for name in ("RUNTIME_DIR", "STATE_HOME", "CONFIG_HOME")}
        try:
            done = subprocess.run(
                [sys.executable, "-c", _PROGRAM, "demo", "--headless", "--json", *words],
                capture_output=True,
                text=True,
                check=False,
                timeout=_NIGHT_S,
                stdin=subprocess.DEVNULL,
                env=os.environ | own,
            )
        except subprocess.TimeoutExpired:
            return {"error": f"not over after {_NIGHT_S:.0f} s"}
    if done.returncode != 0 or not done.stdout.strip():
        said = done.stderr.strip().splitlines() or ["it says nothing"]
        return {"error": said[-1]}
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    # Where it lay and how fast this machine was say nothing of the night.
    for unlike in ("session", "latency_ms"):
        found.pop(unlike, None)
    return found | {"wall_s": round(time.monotonic() - started_s, 1)}
