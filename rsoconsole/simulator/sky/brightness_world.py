"""How a world makes every satellite of a night flash and fade."""

import math

import numpy as np

from rsoconsole.records import FloatArray
from rsoconsole.simulator.camera import frame_rng
from rsoconsole.simulator.world import SatelliteWorld

_STREAM = 31
_STEPS_A_FLASH = 40
_FEWEST_NODES, _MOST_NODES = 201, 4001


def world_extra_mag(world: SatelliteWorld, seed: int, norad_id: int, t_s: FloatArray) -> FloatArray:
    """Magnitudes lost (n,) at these seconds after the night's start."""
    t = np.asarray(t_s, dtype=np.float64)
    fades = world.fade_norad in (0, norad_id)
    extra = (world.fade_mag_h if fades else 0.0) * t / 3600.0
    if world.flash_period_s > 0.0:
        phase = frame_rng(seed, norad_id, _STREAM).random()
        turn = (t / world.flash_period_s + phase) % 1.0
        extra = extra + np.where(turn < world.flash_duty, 0.0, world.flash_depth_mag)
    return np.asarray(extra, dtype=np.float64)


def flash_nodes(world: SatelliteWorld, exposure_s: float) -> int:
    """How many places in time an exposure needs to show the flashes; odd."""
    if world.flash_period_s <= 0.0:
        return 1
    steps = math.ceil(exposure_s / world.flash_period_s * _STEPS_A_FLASH)
    return int(np.clip(steps, _FEWEST_NODES, _MOST_NODES)) // 2 * 2 + 1
