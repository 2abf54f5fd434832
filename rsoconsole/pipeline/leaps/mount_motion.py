"""How long the slews of this mount take: learned from those of the night. Pure.

An axis speeds up, runs at its full rate and slows down; beside that a slew has a fixed part, from
the order to the report that it has ended. What has not been seen is as configured.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rsoconsole.config import MountConfig
from rsoconsole.records import FloatArray

USUAL_RAMP_S = 2.0
"""From rest to full rate, before a slew has been seen."""
USUAL_FIXED_S = 0.5
_BELIEF = np.array([0.3, 0.7, 1.5])
"""One sigma of the logarithms of rate, ramp and fixed part: none of them falls to nothing."""
_SCATTER_S = 0.1
"""Of a slew's time beside the law, as far as it is believed to go."""
_ROUNDS = 12
LAST_SLEWS = 60


@dataclass(frozen=True, slots=True, kw_only=True)
class SlewSeen:
    """One slew that was done."""

    travel_deg: tuple[float, float]
    """Of the polar and the declination axis."""
    seconds: float
    """From the order to the report of rest."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MountMotion:
    """The law of a mount's slews."""

    rate_deg_s: float
    acceleration_deg_s2: float
    fixed_s: float
    scatter_s: float
    """By how much slews have differed from it, one sigma."""
    slews: int
    """From how many it was learned; 0: as configured."""

    def slew_s(self, travel_deg: tuple[float, float]) -> float:
        """Seconds that a slew takes, most likely."""
        rate, way = self.rate_deg_s, max(*travel_deg, 0.0)
        ramp = rate / self.acceleration_deg_s2
        if way < rate * ramp:
            return self.fixed_s + 2.0 * math.sqrt(way * ramp / rate)
        return self.fixed_s + way / rate + ramp

    def surely_s(self, travel_deg: tuple[float, float]) -> float:
        """Seconds after which it is over in 98 of 100 cases."""
        return self.slew_s(travel_deg) + 2.0 * self.scatter_s


def configured(mount: MountConfig) -> MountMotion:
    """What is believed before the first slew."""
    rate = mount.slew_rate_deg_s
    return MountMotion(
        rate_deg_s=rate,
        acceleration_deg_s2=rate / USUAL_RAMP_S,
        fixed_s=USUAL_FIXED_S,
        scatter_s=USUAL_FIXED_S / 2.0,
        slews=0,
    )


def learned(mount: MountConfig, seen: Sequence[SlewSeen]) -> MountMotion:
    """The law that fits the last slews best, near what is configured."""
    start = configured(mount)
    last = [each for each in seen if max(each.travel_deg) > 0.0][-LAST_SLEWS:]
    if not last:
        return start
    way = np.array([max(each.travel_deg) for each in last])
    took = np.array([each.seconds for each in last])
    before = np.log([start.rate_deg_s, USUAL_RAMP_S, start.fixed_s])
    law = before.copy()
    for _ in range(_ROUNDS):
        off = took - _seconds(np.exp(law), way)
        # A slew that was sent twice, or ended by somebody, says nothing of the others.
        weight = 1.0 / (1.0 + (off / (3.0 * _SCATTER_S)) ** 2) / _SCATTER_S**2
        slopes = np.stack([_slope(law, way, n) for n in range(3)], axis=-1)
        normal = slopes.T @ (weight[:, None] * slopes) + np.diag(_BELIEF**-2.0)
        pull = slopes.T @ (weight * off) + (before - law) / _BELIEF**2
        step = np.linalg.solve(normal, pull)
        law = law + np.clip(step, -0.5, 0.5)
    off = np.abs(took - _seconds(np.exp(law), way))
    rate, ramp, fixed = np.exp(law)
    few = (2.0 * start.scatter_s + float(np.sum(np.minimum(1.4826 * off, 1.0)))) / (2.0 + len(off))
    return MountMotion(
        rate_deg_s=float(rate),
        acceleration_deg_s2=float(rate / ramp),
        fixed_s=float(fixed),
        scatter_s=few,
        slews=len(last),
    )


def _seconds(law: FloatArray, way_deg: FloatArray) -> FloatArray:
    """Of ways (N,) by rate, ramp and fixed part."""
    rate, ramp, fixed = law
    short = 2.0 * np.sqrt(np.maximum(way_deg, 0.0) * ramp / rate)
    return np.asarray(fixed + np.where(way_deg < rate * ramp, short, way_deg / rate + ramp))


def _slope(law: FloatArray, way_deg: FloatArray, n: int) -> FloatArray:
    step = np.zeros(3)
    step[n] = 1e-4
    low, high = _seconds(np.exp(law - step), way_deg), _seconds(np.exp(law + step), way_deg)
    return np.asarray((high - low) / 2e-4)
