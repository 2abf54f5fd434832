"""What a newcomer on a Raspberry Pi does, step by step, and what must come of it."""

import json
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from tests.aarch64.compare import largest_difference
from tests.aarch64.systems import Done, System
from tests.hash_requirements import entries

ROOT = Path(__file__).resolve().parents[2]
CLONE = "rsoconsole"
FRAMES = 6
DEMO = f"demo --headless --frames {FRAMES} --keep-frames all --json"
TEST_FILES = (
    "tests/vision/test_detector.py",
    "tests/vision/test_streak_fit.py",
    "tests/tracking/test_lqe.py",
    "tests/tracking/test_follow.py",
    "tests/instruments/test_solver.py",
    "tests/session/test_session.py",
    "tests/session/test_session_codec.py",
    "tests/cli/test_setup_check.py",
)
TEST_PACKAGES = (
    "hypothesis",
    "iniconfig",
    "pluggy",
    "pytest",
    "pytest-timeout",
    "sortedcontainers",
)
"""Of ``requirements-test.txt``, what these files need."""
UNLIKE = {"latency_ms", "session", "ms"}
"""What two machines may not share."""
SAME = 1e-5
"""Largest relative difference of two figures that both machines show alike."""
REFUSED_WITHIN_S = 60.0
"""Of emulated time, an order slower than a Pi."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """One line of the table."""

    name: str
    is_green: bool
    seconds: float
    found: str


def readme_block(fence: str, number: int = 0) -> str:
    """The commands of a fenced block of the README, exactly as printed."""
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    blocks = re.findall(rf"```{fence}\n(.*?)```", readme, re.DOTALL)
    return str(blocks[number]).strip()


def newcomer(system: System, log: Path) -> Iterator[Step]:
    """All steps on a 64-bit system, each after the last; ends with the first that fails."""
    apt_line, first_command = readme_block("bash"), readme_block("sh")
    yield _versions(system)
    done = system.run("sudo apt-get update && sudo apt-get install git", log=log)
    yield _step("git for the clone", done.status, done.seconds, "")
    _clone(system, log)
    yield refusal(system, log, apt_line)
    done = system.run(apt_line, log=log)
    yield _step("packages of the README", done.status, done.seconds, apt_line)
    done = system.run(first_command, folder=CLONE, log=log)
    yield _step(
        "the README's first command, verbatim",
        done.status,
        done.seconds,
        f"{_compilation(system)}; {done.out.strip().splitlines()[-1] if done.out else done.error}",
    )
    for run in (_demo, _doctor, _bench, _detect, _solve, _tests):
        yield run(system, log)


def refusal(system: System, log: Path, words: str) -> Step:
    """The first command on a system that lacks something: it must say what within seconds."""
    done = system.run(readme_block("sh"), folder=CLONE, log=log)
    is_told = done.status != 0 and words in done.error and done.seconds < REFUSED_WITHIN_S
    said = next((line for line in done.error.splitlines() if words in line), done.error[-300:])
    return Step(
        name="the first command before that",
        is_green=is_told,
        seconds=done.seconds,
        found=f"refused: {said}",
    )


def put_clone(system: System, log: Path) -> None:
    """The checkout without git, for a system that is refused anyway."""
    _clone(system, log, with_git=False)


def _clone(system: System, log: Path, *, with_git: bool = True) -> None:
    home = system.home()
    if with_git:
        bundle = home / "rsoconsole.bundle"
        subprocess.run(["git", "bundle", "create", "-q", bundle, "HEAD"], cwd=ROOT, check=True)
        done = system.run(f"git clone -q ~/rsoconsole.bundle {CLONE}", log=log)
        if done.status != 0:
            raise SystemExit(f"the clone failed: {done.error}")
        return
    target = home / CLONE
    target.mkdir()
    packed = subprocess.run(["git", "archive", "HEAD"], cwd=ROOT, check=True, capture_output=True)
    subprocess.run(["tar", "-x", "-C", target], input=packed.stdout, check=True)
    owner = home.stat()
    subprocess.run(["chown", "-R", f"{owner.st_uid}:{owner.st_gid}", target], check=True)


def _versions(system: System) -> Step:
    done = system.run(
        "uname -m; cat /etc/debian_version; python3 --version; getconf GNU_LIBC_VERSION"
    )
    return _step("system", done.status, done.seconds, ", ".join(done.out.strip().splitlines()))


def _compilation(system: System) -> str:
    """What pip's log says of ``astrometry``, whose wheel is published for x86-64 alone."""
    times: dict[str, datetime] = {}
    for line in system.home("pip.log").read_text(errors="replace").splitlines():
        stamp, _, said = line.partition(" ")
        for name in ("Building wheel for astrometry", "Created wheel for astrometry"):
            if said.strip().startswith(name):
                times.setdefault(name, datetime.fromisoformat(stamp.rstrip(",")))
    if len(times) == 2:
        start, end = times.values()
        return f"astrometry compiled natively in {(end - start).total_seconds():.0f} s"
    return "astrometry from pip's cache: the wheel of an earlier native build"


def _demo(system: System, log: Path) -> Step:
    done = _verb(system, f"{DEMO} --session ~/night", log)
    if done.status != 0:
        return _step(f"demo, {FRAMES} frames", done.status, done.seconds, done.error[-300:])
    night = log.with_name(f"{system.kind.name}-night-here")
    shutil.rmtree(night, ignore_errors=True)
    here = _here(*DEMO.split(), "--session", str(night))
    difference = largest_difference(json.loads(done.out), json.loads(here), UNLIKE)
    found = json.loads(done.out)
    figures = f'measured {found["measured_rms_arcsec"]}" rms, {found["detections"]} detections'
    return _compared(f"demo, {FRAMES} frames", done.seconds, difference, figures)


def _doctor(system: System, log: Path) -> Step:
    done = _verb(system, "doctor --json", log)
    checks = [json.loads(line) for line in done.out.splitlines()]
    failed = [check["check"] for check in checks if check["ok"] is False]
    # No INDI server runs beside it, and the clock is the host's.
    return Step(
        name="doctor",
        is_green=bool(checks) and set(failed) <= {"INDI server", "clock"},
        seconds=done.seconds,
        found=f"{len(checks)} checks, failed: {', '.join(failed) or 'none'}",
    )


def _bench(system: System, log: Path) -> Step:
    done = _verb(system, "doctor --bench", log)
    log.with_name(f"{system.kind.name}-bench.txt").write_text(done.out, encoding="utf-8")
    last = done.out.strip().splitlines()[-1] if done.out.strip() else done.error[-300:]
    return _step("doctor --bench", done.status, done.seconds, last)


def _detect(system: System, log: Path) -> Step:
    return _frames_compared(system, log, "detect")


def _solve(system: System, log: Path) -> Step:
    return _frames_compared(system, log, "solve")


def _frames_compared(system: System, log: Path, verb: str) -> Step:
    """A verb over the frames that the demo kept, here and there."""
    done = _verb(system, f"{verb} --json ~/night/frames/*", log)
    if done.status != 0:
        return _step(verb, done.status, done.seconds, done.error[-300:])
    paths = sorted(system.home("night", "frames").iterdir())
    here = _here(verb, "--json", *map(str, paths))
    ours, theirs = (
        [json.loads(line) | {"frame": None} for line in text.splitlines()]
        for text in (here, done.out)
    )
    difference = largest_difference(theirs, ours, UNLIKE)
    return _compared(f"{verb}, {len(theirs)} frames", done.seconds, difference, "")


def _tests(system: System, log: Path) -> Step:
    pinned = entries((ROOT / "requirements-test.txt").read_text(encoding="utf-8"))
    wanted = [line for line in pinned if line.partition("==")[0] in TEST_PACKAGES]
    lines = shlex.quote("\n".join(wanted))
    done = system.run(
        f"printf %s {lines} | .venv/bin/pip install -q --require-hashes --no-deps -r /dev/stdin"
        f" && .venv/bin/pytest -q -p no:xdist -o timeout=3600 {' '.join(TEST_FILES)}",
        folder=CLONE,
        log=log,
    )
    last = done.out.strip().splitlines()[-1] if done.out.strip() else done.error[-300:]
    return _step("tests of detector, filter, solver, session", done.status, done.seconds, last)


def _verb(system: System, words: str, log: Path) -> Done:
    return system.run(f".venv/bin/rsoconsole {words}", folder=CLONE, log=log)


def _here(*words: str) -> str:
    """The same verb on this machine."""
    program = "import sys; from rsoconsole.cli import main; sys.argv[0] = 'rsoconsole'; main()"
    done = subprocess.run(
        [sys.executable, "-c", program, *words],
        capture_output=True,
        text=True,
        check=False,
        cwd=ROOT,
        stdin=subprocess.DEVNULL,
    )
    if done.returncode != 0:
        raise SystemExit(f"'rsoconsole {' '.join(words[:3])}' fails here: {done.stderr[-500:]}")
    return done.stdout


def _compared(name: str, seconds: float, difference: float | str, figures: str) -> Step:
    if isinstance(difference, str):
        return Step(name=name, is_green=False, seconds=seconds, found=difference)
    words = "the same as on x86-64 to the last digit"
    if difference > 0.0:
        words = f"as on x86-64, largest relative difference {difference:.1e}"
    found = "; ".join(part for part in (figures, words) if part)
    return Step(name=name, is_green=difference <= SAME, seconds=seconds, found=found)


def _step(name: str, status: int, seconds: float, found: str) -> Step:
    return Step(name=name, is_green=status == 0, seconds=seconds, found=found)
