"""Measures the cycle on written frames, in the tree that it is run in: this one or an older one.

    PYTHONPATH=TREE python tests/bench/cycle_program.py FOLDER...

Imports nothing of ``tests``, and finds names where either tree has them. Takes one frame after
each line that it reads, so that two trees can take turns, and prints a line of JSON for each: the
milliseconds of its stages, streaks, state, and the largest memory so far, MiB.
"""

import importlib
import json
import re
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from rsoconsole.config import Config
from rsoconsole.records import Frame

NS = 1_000_000_000


def _named(name: str, *modules: str) -> Any:
    for module in modules:
        try:
            return getattr(importlib.import_module(module), name)
        except (ImportError, AttributeError):
            continue
    raise SystemExit(f"{name} is in none of {', '.join(modules)}")


PLANNER = _named("Planner", "rsoconsole.engine.aim.plan", "rsoconsole.engine.plan")
REPORT = _named("MountReport", "rsoconsole.instruments", "rsoconsole.instruments.ports")
CYCLE = _named("Cycle", "rsoconsole.pipeline", "rsoconsole.pipeline.cycle")
OPEN = _named("open_reducer", "rsoconsole.pipeline", "rsoconsole.pipeline.open")
FOLLOWING = _named("Following", "rsoconsole.tracking", "rsoconsole.tracking.follow")


def _peak_mib() -> float:
    """Of this program alone: the kernel's other figure begins with that of the one before."""
    found = re.search(r"VmHWM:\s+(\d+) kB", Path("/proc/self/status").read_text())
    return int(found[1]) / 1024 if found else 0.0


def _measure(reducer: Any, config: Config, folder: Path) -> None:
    cycle, following, planner = CYCLE(reducer, config), FOLLOWING(), PLANNER(config)
    for taken in json.loads((folder / "frames.json").read_text()):
        sys.stdin.readline()
        t_ns, ra, dec = taken["t_ns"], taken["ra_deg"], taken["dec_deg"]
        frame = Frame(
            frame_id=taken["number"],
            name=str(taken["number"]),
            pixels=np.load(folder / f"{taken['number']}.npy"),
            t_start_utc_ns=t_ns,
            exposure_s=config.exposure.exposure_s,
            scale_arcsec_px=config.optics.scale_arcsec_px,
            pointing_ra_icrs_deg=ra,
            pointing_dec_icrs_deg=dec,
        )
        if taken["number"] == 1:
            report = REPORT(
                t_utc_ns=t_ns,
                ra_icrs_deg=ra,
                dec_icrs_deg=dec,
                is_slewing=False,
                is_parked=False,
                is_tracking=True,
                pier_side="west",
            )
            planner.start_search(report, t_ns)
        began_s = time.perf_counter()
        result = cycle.run(frame, following)
        folded_s = time.perf_counter()
        following = result.after
        planner.plan(following, t_ns + 12 * NS)
        ended_s = time.perf_counter()
        reduce_ms = result.reduction.stage_ms
        found = {
            "streaks": len(result.reduction.detections.detections),
            "state": str(following.state),
            "peak_mib": _peak_mib(),
            "ms": {
                **reduce_ms,
                "filter": (folded_s - began_s) * 1e3 - sum(reduce_ms.values()),
                "plan": (ended_s - folded_s) * 1e3,
                "total": (ended_s - began_s) * 1e3,
            },
        }
        print(json.dumps(found), flush=True)


def main() -> None:
    """Measure all folders with one reducer."""
    config = Config()
    with OPEN(config) as (reducer, _):
        for folder in sys.argv[1:]:
            _measure(reducer, config, Path(folder))


if __name__ == "__main__":
    main()
