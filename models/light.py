"""Random light curves (m,) of a moving source, from opening to closing of the shutter."""

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
_STEPS = 64


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """A random number whose logarithm is uniform between two bounds."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def satellite_curve(rng: np.random.Generator) -> FloatArray:
    """Light curve of a satellite: slow turn, ramp, tumbling or glint; 1: ordinary brightness."""
    time = np.linspace(0.0, 1.0, _STEPS)
    kind = int(rng.choice(4, p=[0.35, 0.25, 0.2, 0.2]))
    if kind == 0:
        wave = np.sin(2 * np.pi * (rng.uniform(0.5, 3.0) * time + rng.random()))
        return np.asarray(1.0 - rng.uniform(0.1, 0.45) * (1.0 + wave))
    if kind == 1:
        first, last = rng.permutation([1.0, rng.uniform(0.05, 0.8)])
        return np.linspace(first, last, _STEPS)
    if kind == 2:
        wave = np.sin(2 * np.pi * (rng.uniform(1.0, 8.0) * time + rng.random()))
        floor = rng.uniform(0.0, 0.5)
        return np.asarray(floor + (1.0 - floor) * (0.5 + 0.5 * wave) ** rng.uniform(1.0, 3.0))
    glint = np.exp(-0.5 * ((time - rng.uniform(0.05, 0.95)) / rng.uniform(0.02, 0.15)) ** 2)
    return np.asarray(rng.uniform(0.6, 1.0) + rng.uniform(1.0, 6.0) * glint)


def lamp_curve(rng: np.random.Generator, flashes: float) -> FloatArray:
    """Light curve of an aircraft's lamp with this number of flashes along its trail."""
    steps = int(np.clip(40 * flashes, 200, 6000))
    time = np.linspace(0.0, 1.0, steps)
    duty = log_uniform(rng, 0.03, 0.6)
    phase = (time * flashes + rng.random()) % 1.0
    is_lit = phase < duty
    if rng.random() < 0.3:
        # A double flash, as many strobes give.
        is_lit |= (phase > 1.5 * duty) & (phase < 2.5 * duty)
    return np.where(is_lit, rng.uniform(1.5, 10.0), rng.uniform(0.1, 0.9))


def meteor_curve(rng: np.random.Generator) -> FloatArray:
    """Light curve of a meteor: brightening and fading, one in three with a burst; 1: maximum."""
    time = np.linspace(0.0, 1.0, 2 * _STEPS)
    rise, fall = rng.uniform(0.8, 3.0), rng.uniform(0.4, 1.5)
    curve = time**rise * (1.0 - time) ** fall
    curve /= curve.max()
    if rng.random() < 1 / 3:
        curve += rng.uniform(0.5, 2.0) * np.exp(-0.5 * ((time - rng.uniform(0.5, 0.9)) / 0.02) ** 2)
    return np.asarray(curve / curve.max())
