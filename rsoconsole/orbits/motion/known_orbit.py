"""An orbit as it is known at its epoch, and what carries it through time. Pure."""

from dataclasses import dataclass

import numpy as np

from rsoconsole.orbits.motion.forces import Forces, Motion
from rsoconsole.records import FloatArray, OrbitEstimate
from rsoconsole.sky import NS_PER_S, IntArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class KnownOrbit:
    """A state, its covariance and the forces on it."""

    epoch_utc_ns: int
    r_km: FloatArray
    """(3,) GCRS at the epoch"""
    v_km_s: FloatArray
    covariance: FloatArray
    """(6, 6) km and km/s"""
    forces: Motion
    """What carries it through time from its epoch."""

    def states(self, t_utc_ns: IntArray) -> tuple[FloatArray, FloatArray]:
        """GCRS positions and velocities (N, 3) at instants (N,): km, km/s."""
        t = np.atleast_1d(np.asarray(t_utc_ns, np.int64))
        return self.forces.states(self.r_km, self.v_km_s, (t - self.epoch_utc_ns) / NS_PER_S)


def orbit_from_record(estimate: OrbitEstimate) -> KnownOrbit:
    """The orbit that is on record."""
    return KnownOrbit(
        epoch_utc_ns=estimate.epoch_utc_ns,
        r_km=np.array(estimate.r_gcrs_km),
        v_km_s=np.array(estimate.v_gcrs_km_s),
        covariance=np.array(estimate.covariance),
        forces=Forces(epoch_utc_ns=estimate.epoch_utc_ns),
    )
