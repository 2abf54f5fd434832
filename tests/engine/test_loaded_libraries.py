"""A preset's library is loaded where that preset filters, and nowhere else."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

from rsoconsole.tracking.filters import estimator
from tests.rigs.engine_rig import asked, rig

NIGHT = """
import socket, sys
import rsoconsole.cli.app, rsoconsole.console.app, rsoconsole.library
import rsoconsole.engine.service.service
from rsoconsole.config import Config
from rsoconsole.pipeline.tuning import what_if_process
from rsoconsole.pipeline import what_if
from rsoconsole.session import SessionReader
from tests.nights.samples import SAMPLE
from tests.rigs.engine_rig import rig

preset = sys.argv[1]
made = rig(set(range(1, 9)), Config.model_validate({"filter": {"preset": preset}}))
made.engine.arm()
made.engine.run(frames=8)
parent, child = socket.socketpair()
parent.close()
what_if_process.main(child.detach())
log = SessionReader(SAMPLE)
night = what_if((r for _, _, r in log.records()), log.config(), {"filter.preset": preset})
assert made.memory.records and night.updates > 10
print("filterpy" in sys.modules)
"""


@pytest.mark.parametrize("preset", ["adaptive", "tuned", "paper"])
def test_filterpy_is_loaded_by_the_presets_that_filter_with_it(preset: str) -> None:
    """By engine, console, verbs and what-if together."""
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", NIGHT, preset],
        cwd=Path(__file__).resolve().parents[2],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stdout.split() == [str(preset != "adaptive")], done.stderr


def test_a_preset_that_is_set_is_loaded_before_the_next_frame(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    loaded = []
    monkeypatch.setattr(
        estimator,
        "preload_modules",
        lambda settings: loaded.append((settings.preset, r.engine.frame_id)),
    )
    r = rig(set())
    r.engine.arm()
    r.queue.put(asked("set", arguments={"name": "filter.preset", "value": "paper"}))
    r.engine.run(frames=1)
    assert loaded[0] == ("paper", 0)


HELP = """
import sys
from rsoconsole.cli import main
sys.argv = ["rsoconsole", "--help"]
try:
    main()
except SystemExit:
    pass
ours = [name for name in sys.modules if name.startswith("rsoconsole.")]
print({name.split(".")[1] for name in ours}, file=sys.stderr)
"""


def test_help_loads_nothing_of_what_the_verbs_do() -> None:
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", HELP],
        cwd=Path(__file__).resolve().parents[2],
        capture_output=True,
        text=True,
        check=True,
    )
    loaded = set(ast.literal_eval(done.stderr))
    assert "cli" in loaded
    assert not loaded & {"engine", "pipeline", "night", "session", "vision", "orbits", "tracking"}
