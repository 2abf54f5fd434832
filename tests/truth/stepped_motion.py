"""Motion about a point mass by the fixed Runge-Kutta steps of the paper, to compare with.

The paper (Jordan et al., arXiv 2304.06227) names a two-body propagation by Runge and Kutta's fourth
order. Kilometres, seconds.
"""

from dataclasses import dataclass

import numpy as np

from rsoconsole.orbits.motion.two_body import MU_EARTH_KM3_S2
from rsoconsole.records import FloatArray

PAPER_STEP_S = 10.0
"""The paper names none; its exposures last so long."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SteppedPointMass:
    """A `forces.Motion` as `point_mass.PointMass`, by steps of Runge-Kutta 4."""

    step_s: float = PAPER_STEP_S

    def states(
        self, r_km: FloatArray, v_km_s: FloatArray, t_s: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Positions and velocities (N, 3) at times (N,) since the epoch of a state (3,), (3,)."""
        times = np.atleast_1d(np.asarray(t_s, float))
        start = np.concatenate([np.asarray(r_km, float), np.asarray(v_km_s, float)])
        out = np.empty((len(times), 6))
        for sign, chosen in ((1.0, times >= 0.0), (-1.0, times < 0.0)):
            if np.any(chosen):
                out[chosen] = self._carried(start, times[chosen], sign * self.step_s)
        return out[:, :3], out[:, 3:]

    def _carried(self, start: FloatArray, times: FloatArray, step_s: float) -> FloatArray:
        """Whole steps as far as they go, and for each time a shorter last one."""
        whole = np.floor(times / step_s).astype(int)
        grid = np.empty((int(whole.max()) + 1, 6))
        grid[0] = start
        for n in range(1, len(grid)):
            grid[n] = _runge_kutta_4(grid[n - 1], np.asarray(step_s))
        return _runge_kutta_4(grid[whole], times - whole * step_s)


def _runge_kutta_4(state: FloatArray, step_s: FloatArray) -> FloatArray:
    """States (..., 6) one step (...) later."""
    h = step_s[..., None]
    k1 = _slope(state)
    k2 = _slope(state + h / 2.0 * k1)
    k3 = _slope(state + h / 2.0 * k2)
    k4 = _slope(state + h * k3)
    return np.asarray(state + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4))


def _slope(state: FloatArray) -> FloatArray:
    r = state[..., :3]
    distance = np.sqrt(np.sum(r * r, axis=-1, keepdims=True))
    return np.concatenate([state[..., 3:], -MU_EARTH_KM3_S2 / distance**3 * r], axis=-1)
