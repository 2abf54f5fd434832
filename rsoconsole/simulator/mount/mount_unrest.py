"""What a mount does after it says that it has arrived: it creeps on, and now and then it jumps."""

from dataclasses import dataclass, field
from math import cos, hypot, pi, sin

import numpy as np

from rsoconsole.simulator.camera import frame_rng

NS = 1_000_000_000
_STREAM = 36


@dataclass(frozen=True, slots=True)
class MountUnrest:
    """Pure of time; offsets east and north in degrees."""

    seed: int
    t_night_utc_ns: int
    settle_s: float = 0.0
    settle_arcsec: float = 0.0
    jump_arcsec: float = 0.0
    jump_every_s: float = 600.0
    _jumps: list[tuple[float, float, float]] = field(default_factory=list)
    """Of each interval so far: its instant in seconds of the night, and where it leads."""

    @property
    def is_none(self) -> bool:
        """Whether this mount stands where it stands."""
        return self.settle_s == self.jump_arcsec == 0.0

    def offset_deg(
        self, t_utc_ns: int, since_arrival_s: float, way_deg: tuple[float, float]
    ) -> tuple[float, float]:
        """Where it looks beside its place; ``way_deg``: the slew it comes from, east and north."""
        east_deg, north_deg = self._jumped_deg((t_utc_ns - self.t_night_utc_ns) / NS)
        length_deg = hypot(*way_deg)
        if length_deg > 0.0 and 0.0 <= since_arrival_s < self.settle_s:
            left_deg = self.settle_arcsec / 3600.0 * (1.0 - since_arrival_s / self.settle_s)
            east_deg -= left_deg * way_deg[0] / length_deg
            north_deg -= left_deg * way_deg[1] / length_deg
        return east_deg, north_deg

    def _jumped_deg(self, t_s: float) -> tuple[float, float]:
        """The sum of all jumps until then: one at a random instant of each interval."""
        if self.jump_arcsec == 0.0 or t_s < 0.0:
            return 0.0, 0.0
        while len(self._jumps) <= t_s / self.jump_every_s:
            number = len(self._jumps)
            rng = frame_rng(self.seed, number, _STREAM)
            at_s = (number + rng.random()) * self.jump_every_s
            angle = rng.uniform(0.0, 2.0 * pi)
            size_deg = self.jump_arcsec / 3600.0
            self._jumps.append((at_s, size_deg * cos(angle), size_deg * sin(angle)))
        past = np.array([jump[1:] for jump in self._jumps if jump[0] <= t_s])
        east_deg, north_deg = past.sum(axis=0) if len(past) else (0.0, 0.0)
        return float(east_deg), float(north_deg)
