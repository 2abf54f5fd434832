"""What else crosses a field: low satellites from edge to edge, aircraft with their lamps."""

import math

import numpy as np

from rsoconsole.records import FloatArray
from rsoconsole.simulator.camera import (
    FieldContent,
    SensorModel,
    Streak,
    TrafficTruth,
    frame_rng,
    straight_streak,
)
from rsoconsole.simulator.world import TrafficWorld

_STREAM = 30
BEYOND_PX = 60.0
"""How far outside the frame a crossing trail begins and ends."""
_LAMP_STEPS = 4000
_STROBES_S = (0.8, 1.2)
_STROBE_SHINES_S = 0.06
_AIRCRAFT_FWHM_PX = (5.0, 14.0)
_LOW_SATELLITE_PEAK = (4.0, 60.0)
_AIRCRAFT_PEAK = (8.0, 80.0)


def traffic(
    world: TrafficWorld, seed: int, t_start_utc_ns: int, sensor: SensorModel, content: FieldContent
) -> tuple[tuple[Streak, ...], tuple[TrafficTruth, ...]]:
    """What crosses this exposure, drawn, and the truth of it; Poisson numbers at the rates."""
    rng = frame_rng(seed, t_start_utc_ns, _STREAM)
    streaks: list[Streak] = []
    truths: list[TrafficTruth] = []
    noise_e = math.sqrt(content.sky_electrons_px + sensor.read_noise_e**2)
    for _ in range(int(rng.poisson(world.low_satellite_rate))):
        start, end, length_px = _chord(rng, sensor)
        # Across a line of a given peak lies about 1.06 times its width of light.
        peak = _log_uniform(rng, *_LOW_SATELLITE_PEAK)
        electrons = peak * noise_e * 1.06 * content.fwhm_px * length_px
        streaks.append(straight_streak(start, end, electrons))
        truths.append(TrafficTruth(kind="low satellite", start_px=start, end_px=end))
    for _ in range(int(rng.poisson(world.aircraft_rate))):
        start, end, length_px = _chord(rng, sensor)
        fwhm_px = _log_uniform(rng, *_AIRCRAFT_FWHM_PX)
        peak = _log_uniform(rng, *_AIRCRAFT_PEAK)
        electrons = peak * noise_e * 1.06 * fwhm_px * length_px
        crossing_s = content.exposure_s * rng.uniform(0.3, 1.0)
        for shine in (np.full(2, 0.4), _strobe(rng, crossing_s)):
            streaks.append(straight_streak(start, end, electrons, shine, fwhm_px))
        truths.append(TrafficTruth(kind="aircraft", start_px=start, end_px=end))
    return tuple(streaks), tuple(truths)


def _chord(
    rng: np.random.Generator, sensor: SensorModel
) -> tuple[tuple[float, float], tuple[float, float], float]:
    """A line of random direction through a random place, from beyond one edge to beyond another."""
    x, y = rng.uniform(0, sensor.width_px), rng.uniform(0, sensor.height_px)
    angle = rng.uniform(0.0, 2.0 * math.pi)
    dx, dy = math.cos(angle), math.sin(angle)

    def reach(sign: float) -> float:
        ways = []
        for at, step, size in ((x, sign * dx, sensor.width_px), (y, sign * dy, sensor.height_px)):
            edge = size + BEYOND_PX if step > 0 else -BEYOND_PX
            ways.append((edge - at) / step if abs(step) > 1e-9 else math.inf)
        return min(ways)

    back, forth = reach(-1.0), reach(1.0)
    start = (float(x - back * dx), float(y - back * dy))
    end = (float(x + forth * dx), float(y + forth * dy))
    return start, end, back + forth


def _strobe(rng: np.random.Generator, crossing_s: float) -> FloatArray:
    """An anti-collision light: short flashes, some five times as bright as the rest in the mean."""
    period_s = rng.uniform(*_STROBES_S)
    time_s = np.linspace(0.0, crossing_s, _LAMP_STEPS) + rng.uniform(0.0, period_s)
    is_lit = time_s % period_s < _STROBE_SHINES_S
    return np.where(is_lit, 0.6 * period_s / _STROBE_SHINES_S, 0.0)


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(math.log(low), math.log(high))))
