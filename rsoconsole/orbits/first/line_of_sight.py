"""A state told as a telescope sees it: direction, range and their rates. Pure.

Six unknowns about a line of sight: east and north of it (tangents), their rates (rad/s), the
logarithm of the range in km, and the range's rate over the range (1/s). Kilometres, seconds.
"""

from dataclasses import dataclass

import numpy as np

from rsoconsole.orbits.first.initial_states import State
from rsoconsole.records import FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LineOfSight:
    """From a moving site towards where an object is thought to be."""

    site_km: FloatArray
    """(3,)"""
    site_km_s: FloatArray
    towards: FloatArray
    east: FloatArray
    north: FloatArray

    @classmethod
    def through(cls, state: State, site_km: FloatArray, site_km_s: FloatArray) -> "LineOfSight":
        """The one on which the state lies."""
        towards = state[0] - site_km
        towards = towards / np.linalg.norm(towards)
        east = np.cross([0.0, 0.0, 1.0] if abs(towards[2]) < 0.999 else [1.0, 0.0, 0.0], towards)
        east = east / np.linalg.norm(east)
        return cls(
            site_km=site_km,
            site_km_s=site_km_s,
            towards=towards,
            east=east,
            north=np.cross(towards, east),
        )

    def unknowns(self, state: State) -> FloatArray:
        """(6,) of a state on the line itself."""
        u = state[0] - self.site_km
        distance = float(np.linalg.norm(u))
        rates = (state[1] - self.site_km_s) / distance
        turn = (rates @ self.east, rates @ self.north)
        return np.array([0.0, 0.0, *turn, np.log(distance), rates @ self.towards])

    def state(self, unknowns: FloatArray) -> State:
        """Position and velocity (3,) of unknowns (6,)."""
        line, _ = self._line(unknowns)
        turn = unknowns[2] * self.east + unknowns[3] * self.north
        distance = np.exp(unknowns[4])
        return (
            self.site_km + distance * line,
            self.site_km_s + distance * (unknowns[5] * line + turn),
        )

    def slopes(self, unknowns: FloatArray) -> FloatArray:
        """(6, 6): position and velocity by the unknowns."""
        line, size = self._line(unknowns)
        turn = unknowns[2] * self.east + unknowns[3] * self.north
        distance, rate = np.exp(unknowns[4]), unknowns[5]
        out = np.zeros((6, 6))
        for n, axis in enumerate((self.east, self.north)):
            aside = distance / size * (axis - line * (line @ axis))
            out[:3, n], out[3:, n] = aside, rate * aside
            out[3:, 2 + n] = distance * axis
        out[:3, 4], out[3:, 4] = distance * line, distance * (rate * line + turn)
        out[3:, 5] = distance * line
        return out

    def _line(self, unknowns: FloatArray) -> tuple[FloatArray, float]:
        line = self.towards + unknowns[0] * self.east + unknowns[1] * self.north
        size = float(np.linalg.norm(line))
        return line / size, size
