"""Extra magnitudes of a satellite through a night, on top of range, phase and shadow.

A rotating satellite shows a bright and a dark side in turn; one whose panel stops reflecting the
Sun towards the site fades until it does so again. Both are functions of time, so that exposures
can be drawn in any order.
"""

import math
from dataclasses import dataclass

import numpy as np

from rsoconsole.records import FloatArray
from rsoconsole.simulator.camera.rendering import frame_rng
from rsoconsole.simulator.world.world import SatelliteWorld

_STREAM = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class PeriodicFading:
    """Slow rotation with one dark side: fades of equal shape at equal intervals."""

    period_s: float
    first_s: float
    """Middle of the first fade, in seconds after the scenario's start."""
    depth_mag: float
    sharpness: int = 6
    """The fade's shape is a squared cosine to this power: the larger, the shorter."""
    jitter_s: float = 0.0
    """Largest shift in time, earlier or later, of all fades together; drawn from the seed."""
    last_s: float = float("inf")
    """Latest middle of a fade, in seconds after the scenario's start."""

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
    """Changes of one satellite's brightness through a night; steady by default."""

    schedule: tuple[tuple[float, float], ...] = ()
    """Nodes (seconds since the scenario's start, magnitudes lost), linear in between."""
    turning: PeriodicFading | None = None
    repeats_s: float | None = None
    """Seconds after which all of it begins again; None: the last node holds on."""

    def extra_mag(self, t_s: FloatArray, seed: int) -> FloatArray:
        """Magnitudes lost (n,) at these seconds after the scenario's start."""
        t_s = np.asarray(t_s) if self.repeats_s is None else np.mod(t_s, self.repeats_s)
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
    """Magnitudes lost (n,) by the world's dimming, fading and flashing.

    ``t_s``: seconds after the night's start.
    """
    t = np.asarray(t_s, dtype=np.float64)
    fades = world.fade_norad in (0, norad_id)
    extra = world.fainter_mag + (world.fade_mag_h if fades else 0.0) * t / 3600.0
    if world.flash_period_s > 0.0:
        phase = frame_rng(seed, norad_id, _PHASE_STREAM).random()
        turn = (t / world.flash_period_s + phase) % 1.0
        extra = extra + np.where(turn < world.flash_duty, 0.0, world.flash_depth_mag)
    return np.asarray(extra, dtype=np.float64)


def flash_sample_count(world: SatelliteWorld, exposure_s: float) -> int:
    """Return the odd number of instants of an exposure that resolve flashes; 1: no flashes."""
    if world.flash_period_s <= 0.0:
        return 1
    steps = math.ceil(exposure_s / world.flash_period_s * _STEPS_A_FLASH)
    return int(np.clip(steps, _MIN_NODES, _MAX_NODES)) // 2 * 2 + 1
