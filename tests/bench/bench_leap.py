"""From a binned frame of 4 megapixels in memory to the order of the next slew, by part.

    .venv/bin/python -m tests.bench.bench_leap [FRAMES] [--whole] [--full]

Leaps after a low satellite over frames of the simulated camera, 2 x 2 binned, with the real
network, fits, solver process and planning; mount and camera live in the benchmark. Each order waits
for its frame (``leap.at_close`` false). ``--whole``: by the whole frame, without a look at its
middle; ``--full``: frames of 16 megapixels. Prints the median and the 90 % point. Not in it: the
frame's way through the camera's process (``read`` of 'rsoconsole demo --headless --json') and the
order's to the mount's. It needs the whole sky's stars ('rsoconsole index install').
"""

import dataclasses
import statistics
import sys
import time

from rsoconsole.cli.demo._demo_targets import plan_targets
from rsoconsole.config import Config, OpticsConfig
from rsoconsole.pipeline import open_reducer
from rsoconsole.records import CycleTiming, Event, Frame, SlewCommand
from rsoconsole.simulator import Scene, binned_optics, world_from
from rsoconsole.simulator.nights.night_plan import load_stars_for_plan, scenario_from_plan
from rsoconsole.sky import icrs_of_hour_angle
from tests.campaign.leaps import FILE
from tests.makers import NS
from tests.rigs import engine_rig
from tests.rigs.leap_rig import SETTINGS, SlowCamera, TravellingMount

NORAD_ID, AT = 53826, "2023-06-22T20:06:00Z"
SITE = {"latitude_deg": 35.0, "longitude_deg": 8.0, "elevation_m": 200.0}


class DrawnCamera(SlowCamera):
    """Its frames are drawn where the mount stood; drawing them counts for nothing."""

    def __init__(self, clock, mount, scene: Scene, optics: OpticsConfig) -> None:
        super().__init__(clock, mount)
        self.scene, self.optics = scene, optics
        self.came_s = 0.0

    def wait_frame(self, timeout_s) -> Frame:
        plain = super().wait_frame(timeout_s)
        ra_deg, dec_deg = self.looked_deg[plain.frame_id]
        pixels, _ = self.scene.expose(
            ra_deg, dec_deg, 1.7, False, plain.t_start_utc_ns, plain.exposure_s
        )
        frame = dataclasses.replace(
            plain,
            pixels=pixels,
            scale_arcsec_px=self.optics.scale_arcsec_px,
            pointing_ra_icrs_deg=ra_deg,
            pointing_dec_icrs_deg=dec_deg,
            saturation_adu=65520.0,
        )
        self.came_s = time.perf_counter()
        return frame


class TimedMount(TravellingMount):
    """Notes how long after a frame it is sent on."""

    camera: DrawnCamera

    def slew(self, ra_icrs_deg, dec_icrs_deg, now_utc_ns) -> None:
        self.after_ms.append((time.perf_counter() - self.camera.came_s) * 1e3)
        super().slew(ra_icrs_deg, dec_icrs_deg, now_utc_ns)

    def __init__(self, clock) -> None:
        super().__init__(clock)
        self.after_ms: list[float] = []


def main() -> None:
    """Measure and print."""
    numbers = [each for each in sys.argv[1:] if each.isdigit()]
    frames = int(numbers[0]) if numbers else 40
    joined = 1 if "--full" in sys.argv else 2
    world = world_from({"sensor": {"binning": joined}})
    optics = binned_optics(OpticsConfig(), world)
    table = {name: dict(values) for name, values in SETTINGS.items()}
    table |= {"optics": optics.model_dump(), "site": SITE, "catalogue": {"tle_files": [str(FILE)]}}
    table["leap"]["at_close"] = False
    config = Config.model_validate(table)
    plan = plan_targets([str(NORAD_ID)], config, at=AT, seed=1, frames=frames)
    scene = Scene(
        scenario_from_plan(plan), 1, optics=optics, catalogue=load_stars_for_plan(plan), world=world
    )
    made = engine_rig.rig(set(), config)
    made.clock.t_utc_ns = plan.t_start_utc_ns
    mount = TimedMount(made.clock)
    mount.at_deg = icrs_of_hour_angle(
        plan.site, plan.start_hour_angle_deg, plan.start_declination_deg, plan.t_start_utc_ns
    )
    mount.camera = camera = DrawnCamera(made.clock, mount, scene, optics)
    instruments = dataclasses.replace(
        made.engine.instrument_controller.instruments, mount=mount, camera=camera
    )
    with open_reducer(config) as (reducer, _):
        if "--whole" in sys.argv:
            reducer.glance = lambda _frame, _reach_px: None  # type: ignore[method-assign]
        reducer.make_ready()
        engine = engine_rig.Engine(
            config=config,
            instrument_controller=engine_rig.InstrumentController(
                instruments, config, lambda: made.queue.is_interrupt_wanted
            ),
            reducer=reducer,
            record=made.memory,
            queue=made.queue,
        )
        engine.arm()
        engine.run(frames=frames)
    leaps = {each.frame_id for each in made.memory.of(SlewCommand) if each.reason == "leap"}
    rows: dict[str, list[float]] = {}
    for each in made.memory.of(CycleTiming):
        if each.frame_id in leaps:
            for stage, ms in each.stage_ms.items():
                rows.setdefault(stage, []).append(ms)
    rows["frame to order"] = [ms for ms in mount.after_ms if ms < 30 * NS]
    met = sum(" met:" in each.text for each in made.memory.of(Event))
    print(f"{'part':16} {'median ms':>10} {'90 % ms':>10}   ({len(leaps)} orders, {met} leaps met)")
    for stage, values in rows.items():
        ordered = sorted(values)
        tail = ordered[min(len(ordered) - 1, round(0.9 * (len(ordered) - 1)))]
        print(f"{stage:16} {statistics.median(values):10.1f} {tail:10.1f}")


if __name__ == "__main__":
    main()
