"""What the engine makes of a bright geostationary satellite on INDI's own simulators.

    python -m tests.bench.bench_real_indi [--frames N] [--seed N] [--write]

Run from the project's root, with Debian's indi-bin: a quarter of an hour a night, in real time,
with little work for the processor. In one night each streak begins with its call, in the other a
fifth of a second (one sigma) sooner or later. Prints; ``--write`` keeps the figures in
``results/real_indi.json``.
"""

import argparse
import json
import platform
import sys
from pathlib import Path
from typing import Any

from tests.real_sky.real_sky_night import lacks, run_night

RESULTS = Path(__file__).parent / "results" / "real_indi.json"
SCATTERS_S = (0.0, 0.2)
OF_A_NIGHT = (
    *("seed", "scatter_s", "cadence_s", "standard_mag", "frames", "solved", "solve_rms_arcsec"),
    *("calls", "scatter_rms_s", "call_after_header_ms", "call_after_header_ms_max", "gsc_ms"),
    *("alarms", "states", "states_in_order", "reasons"),
)


def figures(night: dict[str, Any]) -> dict[str, Any]:
    """What is kept of a night."""
    told = night["as_the_demo_tells"]
    return {
        **{name: night[name] for name in OF_A_NIGHT},
        "nis_mean": told["nis_mean"],
        "measured_chi2_mean": told["measured_chi2_mean"],
        "objects": night["objects"],
    }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=30)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--write", action="store_true")
    asked = parser.parse_args()
    fault = lacks()
    if fault is not None:
        sys.exit(fault)
    nights = [figures(run_night(asked.frames, asked.seed, each)) for each in SCATTERS_S]
    found = {"nights": nights, "machine": platform.processor() or platform.machine()}
    print(json.dumps(found, indent=2))
    if asked.write:
        RESULTS.write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
