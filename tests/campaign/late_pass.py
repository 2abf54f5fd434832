"""A demo's night whose engine waits for the target by elements that are wrong, in a process.

    python -m tests.campaign.late_pass LATE_S --target NORAD --tle FILE --site .. --at .. --frames N
        --session FOLDER

The sky moves by the elements as they are. The engine knows others, by which the satellite is so
late on its orbit and stands a hundredth of a degree beside it, and waits where these say. Prints
what ``rsoconsole demo --headless --json`` does.
"""

import argparse
import itertools
import json
import sys
import tempfile
from pathlib import Path

from rsoconsole.cli.demo._demo_targets import config_for_plan, plan_targets
from rsoconsole.cli.demo.demo import demo_config
from rsoconsole.cli.demo.demo_night import SimulatedNight, run_night
from rsoconsole.cli.words.options import parse_site

_BESIDE_DEG = 0.01
_S_PER_DAY = 86_400.0


def late_elements(text: str, norad_id: int, late_s: float) -> str:
    """Two lines by which that satellite of the file is so late, and beside its orbit."""
    lines = text.splitlines()
    first, second = next(
        pair
        for pair in itertools.pairwise(lines)
        if pair[0].startswith("1 ") and int(pair[0][2:7]) == norad_id
    )
    # The state of an epoch, told for an earlier one.
    day = float(first[20:32]) - late_s / _S_PER_DAY
    node_deg = (float(second[17:25]) + _BESIDE_DEG) % 360.0
    first = _summed(f"{first[:20]}{day:012.8f}{first[32:68]}")
    second = _summed(f"{second[:17]}{node_deg:8.4f}{second[25:68]}")
    return f"{first}\n{second}\n"


def _summed(line: str) -> str:
    """With its check digit."""
    total = sum(int(each) if each.isdigit() else each == "-" for each in line)
    return f"{line}{total % 10}"


def main() -> int:
    """Exit status 0."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("late_s", type=float)
    parser.add_argument("--target", type=int, required=True)
    parser.add_argument("--tle", type=Path, required=True)
    parser.add_argument("--site", required=True)
    parser.add_argument("--at", required=True)
    parser.add_argument("--frames", type=int, required=True)
    parser.add_argument("--session", type=Path, required=True)
    asked = parser.parse_args()
    config = demo_config(
        parse_site(asked.site), preset="adaptive", keep_frames="none", catalogue=[asked.tle]
    )
    plan = plan_targets([str(asked.target)], config, at=asked.at, seed=1, frames=asked.frames)
    config = config_for_plan(config, plan)
    night = SimulatedNight(
        scenario=plan.title,
        seed=1,
        speed=0.0,
        frames=asked.frames,
        session=asked.session,
        plan=plan.to_table(),
    )
    with tempfile.TemporaryDirectory(prefix="late-") as scratch:
        known = Path(scratch) / "known.tle"
        known.write_text(
            late_elements(asked.tle.read_text(encoding="utf-8"), asked.target, asked.late_s),
            encoding="utf-8",
        )
        leap = config.leap.model_copy(update={"pass_norad": asked.target})
        catalogue = config.catalogue.model_copy(update={"tle_files": (known,)})
        config = config.model_copy(update={"leap": leap, "catalogue": catalogue})
        print(json.dumps(run_night(config, night)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
