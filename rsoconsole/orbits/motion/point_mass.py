"""Motion about a point mass, exactly. Pure.

As the paper (Jordan et al., arXiv 2304.06227) has it, which names Runge-Kutta steps; beyond an hour
`forces.Forces` is what counts. Kilometres, seconds.
"""

from dataclasses import dataclass

import numpy as np

from rsoconsole.orbits.motion.two_body import propagate
from rsoconsole.records import FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class PointMass:
    """A `forces.Motion` without forces but the Earth's attraction from its centre."""

    def states(
        self, r_km: FloatArray, v_km_s: FloatArray, t_s: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Positions and velocities (N, 3) at times (N,) since the epoch of a state (3,), (3,)."""
        return propagate(r_km, v_km_s, np.atleast_1d(np.asarray(t_s, float)))
