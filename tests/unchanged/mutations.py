"""Ten single changes to what stops the mount; the tests of each must notice it.

    python -m tests.unchanged.mutations

Runs in a copy of the working tree, one change after the other. A time-out counts as noticed.
"""

import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).parents[2]
TIMEOUT_S = 300.0


@dataclass(frozen=True)
class Mutation:
    """One change."""

    what: str
    file: str
    """A file of this name that has the text."""
    old: str
    new: str
    tests: tuple[str, ...]


MUTATIONS = (
    Mutation(
        "a step's ABORT is not sent",
        "loop.py",
        'if "abort" in result.actions:\n            # Before',
        'if "abort" in result.actions and False:\n            # Before',
        ("tests/engine/test_in_charge.py", "tests/engine/test_engine.py"),
    ),
    Mutation(
        "the lease is inverted",
        "mount_lease.py",
        "now_s >= self._ends_s",
        "now_s < self._ends_s",
        ("tests/instruments/test_lease.py",),
    ),
    Mutation(
        "tracking goes on past its limit",
        "mount_lease.py",
        "now_utc_ns >= limit_utc_ns",
        "now_utc_ns < limit_utc_ns",
        ("tests/instruments/test_lease.py",),
    ),
    Mutation(
        "the altitude's limit has the other sign",
        "margins.py",
        "altitude_deg, limits.min_altitude_deg)",
        "altitude_deg, -limits.min_altitude_deg)",
        ("tests/sky/test_limits.py",),
    ),
    Mutation(
        "STOP raises no flag",
        "command_queue.py",
        "self._stops_under_way += 1",
        "self._stops_under_way += 0",
        ("tests/control/test_stop_overtakes.py", "tests/control/test_stop_confirmed.py"),
    ),
    Mutation(
        "STOP leaves autonomy the mount",
        "states.py",
        '_enter(authority, "IDLE", reason, "abort"), authority.tracked)',
        '_enter(authority, "SEARCH", reason, "abort"), authority.tracked)',
        ("tests/engine/test_states.py", "tests/engine/test_in_charge.py"),
    ),
    Mutation(
        "ABORT is not repeated",
        "motion.py",
        "sends = must_repeat and",
        "sends = not must_repeat and",
        ("tests/instruments/test_motion.py", "tests/engine/test_odd_sequences.py"),
    ),
    Mutation(
        "a mount that moves is at rest",
        "motion.py",
        "self.is_over = motion.is_at_rest or",
        "self.is_over = not motion.is_at_rest or",
        ("tests/instruments/test_motion.py", "tests/engine/test_odd_sequences.py"),
    ),
    Mutation(
        "no ABORT at a limit",
        "_limit_stop.py",
        "result = mount.abort()",
        'result = StopResult(is_answered=True, ms=0.0, path="mount")',
        ("tests/engine/test_limits_in_every_state.py", "tests/engine/test_watch.py"),
    ),
    Mutation(
        "a STOP that is not obeyed is a calm state",
        "_command_handler.py",
        "if not (result.is_at_rest or result.is_superseded):",
        "if result.is_at_rest or result.is_superseded:",
        ("tests/engine/test_in_charge.py", "tests/control/test_stop_confirmed.py"),
    ),
)


def place_of(mutation: Mutation, root: Path) -> Path:
    """The one file that has the text."""
    found = [
        path
        for path in sorted((root / "rsoconsole").rglob(mutation.file))
        if path.read_text(encoding="utf-8").count(mutation.old) == 1
    ]
    if len(found) != 1:
        raise SystemExit(f"{mutation.what}: {len(found)} places in files called {mutation.file}")
    return found[0]


def is_noticed(mutation: Mutation, root: Path) -> bool:
    """Whether its tests fail."""
    path = place_of(mutation, root)
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace(mutation.old, mutation.new), encoding="utf-8")
    tests = [each for each in mutation.tests if (root / each).exists()]
    try:
        run = subprocess.run(
            [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *tests],
            cwd=root,
            env=None,
            capture_output=True,
            text=True,
            timeout=TIMEOUT_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return True
    finally:
        path.write_text(text, encoding="utf-8")
    if run.returncode not in (0, 1):
        raise SystemExit(run.stdout[-2000:])
    return run.returncode == 1


def main() -> int:
    """Each of them."""
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder) / "checkout"
        skipped = shutil.ignore_patterns(".git", ".venv", ".*cache", "__pycache__")
        shutil.copytree(HERE, root, ignore=skipped)
        found = {each.what: is_noticed(each, root) for each in MUTATIONS}
    for what, noticed in found.items():
        print("noticed:    " if noticed else "NOT NOTICED:", what)
    return int(not all(found.values()))


if __name__ == "__main__":
    sys.exit(main())
