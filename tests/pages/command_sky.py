"""A simulated observatory for the commands: three satellites in one field, of a binned camera."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

from rsoconsole.config import OpticsConfig
from rsoconsole.simulator import Scene, scenario_named, start_observatory
from rsoconsole.simulator.launch import Observatory
from rsoconsole.simulator.nights.scenarios import ScenarioSatellite
from rsoconsole.simulator.server import (
    ObservatorySettings,
    ObservatorySetup,
    make_observatory_setup,
)
from tests.pages.command_things import BELT, site_toml
from tests.truth.seen_satellites import geostationary

BINNING = 4
OPTICS = OpticsConfig(
    width_px=4656 // BINNING,
    height_px=3520 // BINNING,
    pixel_um=3.8 * BINNING,
    focal_length_mm=620.0,
)
SPEED = 10.0
SES_10, SES_17, THIRD = 42432, 49332, 90001
THIRD_EAST_DEG = -66.75
"""Where SES 10 and SES 17 stand at -66.9 and -67.1."""


def three(settings: ObservatorySettings) -> ObservatorySetup:
    """The stage of ``ses-10`` with three satellites alike, near each other."""
    night = scenario_named("ses-10")
    pair = [each for each in night.satellites if each.element_set.norad_id in {SES_10, SES_17}]
    sets = [
        *(each.element_set for each in pair),
        geostationary(THIRD, THIRD_EAST_DEG, epoch_utc_ns=night.t_start_utc_ns, name="THE THIRD"),
    ]
    night = replace(
        night,
        satellites=tuple(ScenarioSatellite(element_set=s, standard_magnitude=11.9) for s in sets),
    )
    stage = make_observatory_setup(replace(settings, stage=None, scenario="ses-10"))
    scene = Scene(night, settings.seed, optics=stage.optics, world=stage.world)
    return replace(stage, scene=scene)


@contextmanager
def observatory(speed: float = SPEED) -> Iterator[Observatory]:
    """Mount, camera and sky, so many times as fast as the clock on the wall."""
    with start_observatory(
        "ses-10",
        1,
        speed,
        stage="tests.pages.command_sky:three",
        world={"sensor": {"binning": BINNING}},
    ) as running:
        yield running


def engine_toml(sky: Observatory) -> str:
    """The configuration of the telescope there."""
    return site_toml() + (
        f"[optics]\nwidth_px = {OPTICS.width_px}\nheight_px = {OPTICS.height_px}\n"
        f"pixel_um = {OPTICS.pixel_um}\nfocal_length_mm = {OPTICS.focal_length_mm}\n"
        f"[indi]\nport = {sky.port}\nsimulated = true\n"
        f'[catalogue]\ntle_files = ["{BELT}"]\n'
        '[session]\nkeep_frames = "none"\n'
        # However slow the machine is.
        "[exposure]\nframe_timeout_s = 120.0\n[solver]\ndeadline_s = 60.0\n"
    )
