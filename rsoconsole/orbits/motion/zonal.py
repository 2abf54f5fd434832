"""Motion about the flattened Earth, quick: J2 to J4 by steps of Runge and Kutta. Pure.

For low orbits while they are followed, and some revolutions ahead: Moon and Sun are less there than
a pass of streaks tells, and for the Earth's unevenness along the equator the next pass is told the
wider (``low_fit.LEFT_OUT_KM_S2``). `forces.Forces` has more and takes twenty times as long.
Kilometres, seconds, along GCRS axes.
"""

from dataclasses import dataclass
from functools import lru_cache
from math import ceil, sqrt

import numpy as np

from rsoconsole.orbits.motion.forces import J2, J3, J4, Vector
from rsoconsole.orbits.motion.two_body import MU_EARTH_KM3_S2
from rsoconsole.records import FloatArray
from rsoconsole.sky import EARTH_RADIUS_KM, cirs_to_gcrs

STEP_S = 20.0
"""At 400 km a step is wrong by a tenth of a millimetre, and the curve between two by some."""
_State = tuple[float, float, float, float, float, float]


@lru_cache(maxsize=16)
def _pole(day: int) -> Vector:
    """The Earth's axis at noon of a day since 1970."""
    x, y, z = cirs_to_gcrs((day * 86_400 + 43_200) * 1_000_000_000)[:, 2].tolist()
    return x, y, z


@dataclass(frozen=True, slots=True, kw_only=True)
class Zonal:
    """A `forces.Motion`: what moves the object is the Earth alone, alike all round its axis."""

    epoch_utc_ns: int
    """Instant to which times are counted."""

    def states(
        self, r_km: FloatArray, v_km_s: FloatArray, t_s: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Positions and velocities (N, 3) at times (N,). NaN where the object has come down."""
        times = np.atleast_1d(np.asarray(t_s, float))
        out = np.full((len(times), 6), np.nan)
        start = np.concatenate([r_km, v_km_s])
        if not np.all(np.isfinite(start)):
            return out[:, :3], out[:, 3:]
        pole = _pole(self.epoch_utc_ns // 86_400_000_000_000)
        for step_s, chosen in ((STEP_S, times >= 0.0), (-STEP_S, times < 0.0)):
            if np.any(chosen):
                out[chosen] = _carried(start, times[chosen], step_s, pole)
        return out[:, :3], out[:, 3:]


def _carried(start: FloatArray, times: FloatArray, step_s: float, pole: Vector) -> FloatArray:
    """States (N, 6) on one side of the epoch: between whole steps by Hermite's cubic."""
    steps = max(1, ceil(float(np.max(np.abs(times))) / abs(step_s)))
    states = np.full((steps + 1, 6), np.nan)
    slopes = np.full((steps + 1, 6), np.nan)
    y: _State = tuple(start.tolist())
    for n in range(steps + 1):
        k1 = _slope(y, pole)
        states[n], slopes[n] = y, k1
        if y[0] ** 2 + y[1] ** 2 + y[2] ** 2 < EARTH_RADIUS_KM**2:
            break
        k2 = _slope(_moved(y, k1, step_s / 2.0), pole)
        k3 = _slope(_moved(y, k2, step_s / 2.0), pole)
        k4 = _slope(_moved(y, k3, step_s), pole)
        mean = tuple(
            (a + 2.0 * (b + c) + d) / 6.0 for a, b, c, d in zip(k1, k2, k3, k4, strict=True)
        )
        y = _moved(y, mean, step_s)  # type: ignore[arg-type]
    n = np.minimum((times / step_s).astype(int), steps - 1)
    u = (times / step_s - n)[:, None]
    before, after = states[n], states[n + 1]
    # Positions by a quintic would want more slopes; velocities are the cubic's of their own.
    h00, h10 = (1.0 + 2.0 * u) * (1.0 - u) ** 2, u * (1.0 - u) ** 2
    h01, h11 = u * u * (3.0 - 2.0 * u), u * u * (u - 1.0)
    return np.asarray(h00 * before + h01 * after + step_s * (h10 * slopes[n] + h11 * slopes[n + 1]))


def _moved(y: _State, slope: _State, step_s: float) -> _State:
    return (
        y[0] + step_s * slope[0],
        y[1] + step_s * slope[1],
        y[2] + step_s * slope[2],
        y[3] + step_s * slope[3],
        y[4] + step_s * slope[4],
        y[5] + step_s * slope[5],
    )


def _slope(y: _State, pole: Vector) -> _State:
    """Velocity and acceleration. Source: Montenbruck & Gill 2000, 3.2; as `forces` has it."""
    x, y_, z, vx, vy, vz = y
    px, py, pz = pole
    d2 = x * x + y_ * y_ + z * z
    d = sqrt(d2)
    s, q = (x * px + y_ * py + z * pz) / d, EARTH_RADIUS_KM / d
    s2 = s * s
    j2, j3, j4 = J2 * q * q, J3 * q * q * q, J4 * q * q * q * q
    slope = j2 * 3.0 * s + j3 * (7.5 * s2 - 1.5) + j4 * (17.5 * s2 - 7.5) * s
    swell = (
        j2 * 3.0 * (1.5 * s2 - 0.5)
        + j3 * 4.0 * (2.5 * s2 - 1.5) * s
        + j4 * 5.0 * ((4.375 * s2 - 3.75) * s2 + 0.375)
    )
    pull = MU_EARTH_KM3_S2 / d2
    outward, axial = pull / d * (swell + s * slope - 1.0), -pull * slope
    return (
        vx,
        vy,
        vz,
        outward * x + axial * px,
        outward * y_ + axial * py,
        outward * z + axial * pz,
    )
