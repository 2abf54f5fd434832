"""Brightness of a satellite through a night, beside range, phase and shadow.

An attitude that turns shows a bright side and a dark one in turn; a panel that moves out of the
mirror fades for good. Both are given as extra magnitudes against time, so that any exposure may
be asked for in any order.
"""

import math
from dataclasses import dataclass

import numpy as np

from rsoconsole.records import FloatArray
from rsoconsole.simulator.camera.rendering import frame_rng
from rsoconsole.simulator.world.world import SatelliteWorld

_STREAM = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class Turning:
    """A slow turn with one dark side: fades of one shape at equal intervals."""

    period_s: float
    first_s: float
    """Middle of the first fade, after the scenario's start."""
    depth_mag: float
    sharpness: int = 6
    """Power of the cosine square that is the fade's shape: the larger, the shorter."""
    jitter_s: float = 0.0
    """Largest shift by which a seed moves all fades together, either way."""
    last_s: float = float("inf")
    """Latest middle of a fade."""

    def extra_mag(self, t_s: FloatArray, seed: int) -> FloatArray:
        """Magnitudes lost (n,) at these seconds after the scenario's start."""
        shift_s = float(frame_rng(seed, _STREAM).uniform(-self.jitter_s, self.jitter_s))
        turns = (np.asarray(t_s, dtype=np.float64) - self.first_s - shift_s) / self.period_s
        nearest = np.rint(turns)
        is_fade = (nearest >= 0) & (self.first_s + nearest * self.period_s <= self.last_s)
        shape = np.cos(np.pi * (turns - nearest)) ** (2 * self.sharpness)
        return np.where(is_fade, self.depth_mag * shape, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class BrightnessHistory:
    """One satellite's night; without arguments a steady one."""

    schedule: tuple[tuple[float, float], ...] = ()
    """Nodes (seconds since the scenario's start, extra magnitudes), linear in between."""
    turning: Turning | None = None

    def extra_mag(self, t_s: FloatArray, seed: int) -> FloatArray:
        """Magnitudes (n,) to add to those of a steady satellite."""
        extra = np.zeros(np.shape(t_s))
        if self.schedule:
            times, magnitudes = zip(*self.schedule, strict=True)
            extra = extra + np.interp(t_s, times, magnitudes)
        if self.turning is not None:
            extra = extra + self.turning.extra_mag(t_s, seed)
        return np.asarray(extra, dtype=np.float64)


_PHASE_STREAM = 31
_STEPS_A_FLASH = 40
_MIN_NODES, _MAX_NODES = 201, 4001


def world_extra_mag(world: SatelliteWorld, seed: int, norad_id: int, t_s: FloatArray) -> FloatArray:
    """Magnitudes lost (n,) at these seconds after the night's start."""
    t = np.asarray(t_s, dtype=np.float64)
    fades = world.fade_norad in (0, norad_id)
    extra = (world.fade_mag_h if fades else 0.0) * t / 3600.0
    if world.flash_period_s > 0.0:
        phase = frame_rng(seed, norad_id, _PHASE_STREAM).random()
        turn = (t / world.flash_period_s + phase) % 1.0
        extra = extra + np.where(turn < world.flash_duty, 0.0, world.flash_depth_mag)
    return np.asarray(extra, dtype=np.float64)


def flash_nodes(world: SatelliteWorld, exposure_s: float) -> int:
    """Number of instants in an exposure that show the flashes; odd."""
    if world.flash_period_s <= 0.0:
        return 1
    steps = math.ceil(exposure_s / world.flash_period_s * _STEPS_A_FLASH)
    return int(np.clip(steps, _MIN_NODES, _MAX_NODES)) // 2 * 2 + 1
