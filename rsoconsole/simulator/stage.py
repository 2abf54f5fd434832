"""What the observatory must know of a scenario before the first exposure."""

import importlib
from dataclasses import dataclass

from rsoconsole.config import OpticsConfig
from rsoconsole.records import Site
from rsoconsole.simulator.devices import SceneLike
from rsoconsole.simulator.nights import plan_of_table, scenario_named, scenario_of, stars_of
from rsoconsole.simulator.observatory_settings import ObservatorySettings
from rsoconsole.simulator.scene import Scene, binned
from rsoconsole.simulator.world import NAMELESS, World, world_from
from rsoconsole.sky import icrs_of_hour_angle


@dataclass(frozen=True, slots=True, kw_only=True)
class Stage:
    """Where, when, with what, and what is to be seen."""

    site: Site
    optics: OpticsConfig
    t_start_utc_ns: int
    start_ra_icrs_deg: float
    """Where the mount looks when the night begins."""
    start_dec_icrs_deg: float
    scene: SceneLike
    world: World = NAMELESS
    """What is imperfect; the scene knows its own part of it."""


def open_stage(settings: ObservatorySettings) -> Stage:
    """The stage of a named scenario, of a plan, or of the function that the settings name.

    Raises ConfigError for a name that no scenario has, and for a world that cannot be.
    """
    if settings.stage is None:
        return _scenario_stage(settings)
    module, _, function = settings.stage.partition(":")
    stage: Stage = getattr(importlib.import_module(module), function)(settings)
    return stage


def _scenario_stage(settings: ObservatorySettings) -> Stage:
    plan = None if settings.plan is None else plan_of_table(settings.plan)
    scenario = scenario_named(settings.scenario) if plan is None else scenario_of(plan)
    world = world_from(settings.world)
    standard = OpticsConfig()
    optics = standard.model_copy(
        update={
            "width_px": settings.width_px or standard.width_px,
            "height_px": settings.height_px or standard.height_px,
        }
    )
    optics = binned(optics, world)
    ra_icrs_deg, dec_icrs_deg = icrs_of_hour_angle(
        scenario.site,
        scenario.start_hour_angle_for(optics.field_deg[0]),
        scenario.start_declination_deg,
        scenario.t_start_utc_ns,
    )
    return Stage(
        site=scenario.site,
        optics=optics,
        t_start_utc_ns=scenario.t_start_utc_ns,
        start_ra_icrs_deg=float(ra_icrs_deg),
        start_dec_icrs_deg=float(dec_icrs_deg),
        scene=Scene(
            scenario,
            settings.seed,
            optics=optics,
            catalogue=None if plan is None else stars_of(plan),
            world=world,
        ),
        world=world,
    )
