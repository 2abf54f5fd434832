"""From a 16-megapixel frame in memory to the plan of the next exposure, by stage.

    .venv/bin/python -m tests.bench.bench_cycle [FRAMES]

Frames of the simulated camera, the whole cycle (network, line fit, solver process, filter) and
the planning of the next exposure, by the default configuration. Prints the median and the 95 %
point of each stage. Not in it: the frame's way from its last byte through the camera's process
and the order to the mount; ``rsoconsole demo --headless --json`` has them as ``read``, ``order``.
"""

import statistics
import sys
import time

from rsoconsole.config import Config
from rsoconsole.engine.aim.plan import Planner
from rsoconsole.instruments import MountReport
from rsoconsole.pipeline import Cycle, open_reducer
from rsoconsole.records import Frame
from rsoconsole.simulator import Scene, scenario_named
from rsoconsole.sky import icrs_of_hour_angle
from rsoconsole.tracking import Following

NS = 1_000_000_000
TARGET_HOUR_ANGLE_DEG = -41.0


def main() -> None:
    """Measure and print."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    scenario = scenario_named("intelsat-14")
    scene = Scene(scenario, 1)
    config = Config()
    rows: dict[str, list[float]] = {}
    following = Following()
    planner = Planner(config)
    with open_reducer(config) as (reducer, _):
        cycle = Cycle(reducer, config)
        for number in range(1, count + 1):
            t_ns = scenario.t_start_utc_ns + number * 30 * NS
            ra, dec = icrs_of_hour_angle(
                scenario.site, TARGET_HOUR_ANGLE_DEG, scenario.start_declination_deg, t_ns
            )
            pixels, _ = scene.expose(ra, dec, 1.0, False, t_ns, 10.0)
            frame = Frame(
                frame_id=number,
                name=str(number),
                pixels=pixels,
                t_start_utc_ns=t_ns,
                exposure_s=10.0,
                scale_arcsec_px=config.optics.scale_arcsec_px,
                pointing_ra_icrs_deg=ra,
                pointing_dec_icrs_deg=dec,
            )
            if number == 1:
                report = MountReport(
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
            stages = {
                **reduce_ms,
                "filter": (folded_s - began_s) * 1e3 - sum(reduce_ms.values()),
                "plan": (ended_s - folded_s) * 1e3,
                "total": (ended_s - began_s) * 1e3,
            }
            for stage, value in stages.items():
                rows.setdefault(stage, []).append(value)
    print(f"{'stage':10} {'median ms':>10} {'95 % ms':>10}   ({count} frames, {following.state})")
    for stage, values in rows.items():
        ordered = sorted(values)
        tail = ordered[min(len(ordered) - 1, round(0.95 * (len(ordered) - 1)))]
        print(f"{stage:10} {statistics.median(values):10.1f} {tail:10.1f}")


if __name__ == "__main__":
    main()
