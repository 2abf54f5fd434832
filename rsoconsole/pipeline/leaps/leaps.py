"""Leap to a low satellite: where and when to meet it next, and for how long to expose it. Pure.

The telescope cannot keep up with the satellite: it slews ahead of the satellite, waits, exposes
while the satellite passes, and slews ahead again. Exposures are long enough for a streak that is
measured well, and short enough for both its ends to be in the field.
"""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from math import erf, sqrt
from typing import Literal

import numpy as np

from rsoconsole.config import Config, MountConfig
from rsoconsole.orbits import PredictedPosition, PredictedSkyPath
from rsoconsole.pipeline.frame.plate import MIN_PART_PX
from rsoconsole.records import FloatArray
from rsoconsole.sky import LimitName, Limits, PierSide, Pose, Refusal
from rsoconsole.words import NS_PER_S

USUAL_RAMP_S = 2.0
"""Time of a slew from rest to full rate, before a slew has been measured."""
USUAL_FIXED_S = 0.5
_BELIEF = np.array([0.3, 0.7, 1.5])
"""One sigma of the logarithms of rate, ramp and fixed part, which keeps them above zero."""
_SCATTER_S = 0.1
"""Scatter of a slew's time about the law, as assumed in the fit."""
_FIT_ROUNDS = 12
LAST_SLEWS = 60


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredSlew:
    """Slew of the mount and the time it took."""

    travel_deg: tuple[float, float]
    """Travel of the polar and the declination axis."""
    seconds: float
    """Time from the order to the report of rest."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MountMotion:
    """Model of the durations of a mount's slews: rate, acceleration, fixed time."""

    rate_deg_s: float
    acceleration_deg_s2: float
    fixed_s: float
    scatter_s: float
    """Scatter of the slews about the model, one sigma."""
    slews: int
    """Number of slews it was fitted to; 0: as configured."""

    def slew_s(self, travel_deg: tuple[float, float]) -> float:
        """Return the most likely duration of a slew, s."""
        rate, way = self.rate_deg_s, max(*travel_deg, 0.0)
        ramp = rate / self.acceleration_deg_s2
        if way < rate * ramp:
            return self.fixed_s + 2.0 * math.sqrt(way * ramp / rate)
        return self.fixed_s + way / rate + ramp

    def slew_98_percent_s(self, travel_deg: tuple[float, float]) -> float:
        """Return the time after which a slew is over in 98 of 100 cases, s."""
        return self.slew_s(travel_deg) + 2.0 * self.scatter_s


def configured_motion(mount: MountConfig) -> MountMotion:
    """Return the model of the mount's slews by the configuration, for use before the first slew."""
    rate = mount.slew_rate_deg_s
    return MountMotion(
        rate_deg_s=rate,
        acceleration_deg_s2=rate / USUAL_RAMP_S,
        fixed_s=USUAL_FIXED_S,
        scatter_s=USUAL_FIXED_S / 2.0,
        slews=0,
    )


def learned_motion(mount: MountConfig, seen: Sequence[MeasuredSlew]) -> MountMotion:
    """Return the model fitted to the last slews, with the configured model as its prior."""
    start = configured_motion(mount)
    last = [each for each in seen if max(each.travel_deg) > 0.0][-LAST_SLEWS:]
    if not last:
        return start
    way = np.array([max(each.travel_deg) for each in last])
    took = np.array([each.seconds for each in last])
    before = np.log([start.rate_deg_s, USUAL_RAMP_S, start.fixed_s])
    law = before.copy()
    for _ in range(_FIT_ROUNDS):
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
    """Return the durations of slews over distances (N,) by rate, ramp and fixed part, s."""
    rate, ramp, fixed = law
    short = 2.0 * np.sqrt(np.maximum(way_deg, 0.0) * ramp / rate)
    return np.asarray(fixed + np.where(way_deg < rate * ramp, short, way_deg / rate + ramp))


def _slope(law: FloatArray, way_deg: FloatArray, n: int) -> FloatArray:
    step = np.zeros(3)
    step[n] = 1e-4
    low, high = _seconds(np.exp(law - step), way_deg), _seconds(np.exp(law + step), way_deg)
    return np.asarray((high - low) / 2e-4)


LENGTH_PX = 250.0
"""Length of a streak that is measured well, px; beyond 500 px the detector is less sure."""
MIN_LENGTH_PX = 40.0
BINNED_LENGTH_PX = 100.0
"""Shortest length of a streak with a binned camera, px."""
SHORTEST_S, LONGEST_S = 0.05, 1.0
BESIDE_ARCSEC = 180.0
"""Largest distance between where the mount was sent and where it points, its offset known."""
RIM = 0.96
"""Fraction of the field, from its centre outwards, within which ends count as inside."""
MIN_WITHIN = 0.2
"""Least probability of both ends in the field with which a leap is made."""
_WAITS_S = (0.0, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0)
_ROUNDS = 30
_SAME_S = 0.05
"""Tolerance on the earliest possible instant, s."""
_GAINING = 0.97
"""Ratio of successive steps above which they lead nowhere in time."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LeapParameters:
    """Parameters on which leaps depend: field, image scale, times of camera and mount.

    The parameters of the slew itself are not among them.
    """

    field_deg: tuple[float, float]
    scale_arcsec_px: float
    settle_s: float
    """Time from the arrival until an exposure may be ordered."""
    latency_s: float
    """Time from the order of an exposure to its beginning."""
    readout_s: float
    """Time from the end of an exposure until the next order can be given."""
    binning: int = 1
    """Binning: pixels joined on each axis; ``scale_arcsec_px`` is that of the joined ones."""

    @property
    def streak_length_px(self) -> float:
        """Length of a streak that is measured well, in binned pixels."""
        return max(LENGTH_PX / self.binning, BINNED_LENGTH_PX)

    @property
    def field_radius_deg(self) -> float:
        """Radius of the circle in which streak ends count as inside the field, degrees.

        It is ``RIM`` times half the field's shorter side, so the camera's rotation does not
        matter.
        """
        return RIM * min(self.field_deg) / 2.0


BINNED_SCALE_ARCSEC_PX = 4.0
"""Coarsest scale of binned pixels; with coarser ones a star falls into a single pixel."""
MANY_PX = 6_000_000
"""Number of a camera's pixels below which binning saves no time that matters."""


def leap_binning(config: Config) -> int:
    """Return the binning for leaps: 2 for a large sensor with a fine scale, else 1."""
    optics = config.optics
    if optics.width_px * optics.height_px < MANY_PX:
        return 1
    return 2 if 2.0 * optics.scale_arcsec_px <= BINNED_SCALE_ARCSEC_PX else 1


def leap_parameters(config: Config, binning: int = 1) -> LeapParameters:
    """Return the configured parameters; ``binning``: configured pixels joined on each axis."""
    exposure = config.exposure
    return LeapParameters(
        field_deg=config.optics.field_deg,
        scale_arcsec_px=binning * config.optics.scale_arcsec_px,
        settle_s=config.mount.settle_s,
        latency_s=exposure.start_latency_s,
        readout_s=exposure.readout_s / binning**2,
        binning=binning,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Telescope:
    """The mount's motion, the terms of leaps and the telescope's limits."""

    motion: MountMotion
    terms: LeapParameters
    limits: Limits
    lifted: Collection[LimitName] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Leap:
    """Slew ahead of a satellite, a wait, and an exposure."""

    t_order_utc_ns: int
    t_expose_utc_ns: int
    """Instant at which the exposure is ordered, with the mount settled."""
    t_mid_utc_ns: int
    exposure_s: float
    place: PredictedPosition
    """Predicted position at mid-exposure: the middle of the field."""
    side: PierSide | None
    slew_s: float
    within: float
    """Probability that both ends of the streak are in the field."""
    flips: bool
    binning: int = 1
    share: float = 1.0
    """Fraction of each side of the sensor that is read out."""

    @property
    def t_close_utc_ns(self) -> int:
        """Instant at which the shutter closes."""
        return self.t_mid_utc_ns + round(self.exposure_s / 2.0 * NS_PER_S)

    @property
    def length_arcsec(self) -> float:
        """Length of the streak, arcsec."""
        return self.place.speed_arcsec_s * self.exposure_s

    def streak_reach_px(self, terms: LeapParameters) -> float:
        """Distance from the field's centre, pixels, within which both ends lie at 3 sigma."""
        off_arcsec = self.length_arcsec / 2.0 + 3.0 * self.place.sigma_arcsec + BESIDE_ARCSEC
        return off_arcsec / terms.scale_arcsec_px

    def fits_in(self, share: float, terms: LeapParameters) -> bool:
        """True where a central part of the sensor, ``share`` of each side, suffices for the leap.

        It suffices where it holds both ends of the streak, and enough stars for a plate solution.
        False where the slew changes the side of the pier, as the mount's pointing is then not
        known.
        """
        if self.flips:
            return False
        short_px = share * 3600.0 * min(terms.field_deg) / terms.scale_arcsec_px
        return short_px >= MIN_PART_PX and self.streak_reach_px(terms) <= RIM * short_px / 2.0


NoLeapKind = Literal["it sets", "too fast", "too unsure", "limit"]


@dataclass(frozen=True, slots=True, kw_only=True)
class NoLeap:
    """Reason why there is no next leap; for kind "limit" with the limit's ``refusal``."""

    kind: NoLeapKind
    refusal: Refusal | None = None


def next_leap(
    path: PredictedSkyPath, start: Pose, now_utc_ns: int, telescope: Telescope
) -> Leap | NoLeap:
    """Return the first leap for which the mount is in time and within its limits, else the reason.

    ``start``: direction of the telescope at ``now_utc_ns``.
    """
    last: NoLeap = NoLeap(kind="it sets")
    for wait_s in _WAITS_S:
        earliest_ns = now_utc_ns + round(wait_s * NS_PER_S)
        found = _meeting(path, start, now_utc_ns, earliest_ns, telescope)
        if isinstance(found, NoLeap):
            # Later it is nearer to its end; what was refused before it says more.
            return last if last.kind == "limit" else found
        refusal = telescope.limits.refuse_slew(
            start,
            *found.place.direction_deg,
            t_aim_utc_ns=found.t_mid_utc_ns,
            t_until_utc_ns=found.t_close_utc_ns + round(telescope.terms.readout_s * NS_PER_S),
            lifted=telescope.lifted,
        )
        if refusal is None:
            return found if found.within >= MIN_WITHIN else NoLeap(kind="too unsure")
        last = NoLeap(kind="limit", refusal=refusal)
    return last


def leap_exposure_s(place: PredictedPosition, terms: LeapParameters) -> float:
    """Exposure, s, for a streak of good length that is in the field with three sigma to spare."""
    speed = max(place.speed_arcsec_s, 1e-3)
    sigma_arcsec = sqrt(max(place.variance_along_arcsec2, 0.0))
    room_arcsec = 2.0 * (3600.0 * terms.field_radius_deg - 3.0 * sigma_arcsec)
    long_px = min(terms.streak_length_px, max(room_arcsec / terms.scale_arcsec_px, MIN_LENGTH_PX))
    wanted_s = long_px * terms.scale_arcsec_px / speed
    return float(np.clip(wanted_s, SHORTEST_S, LONGEST_S))


def both_ends_probability(
    place: PredictedPosition, exposure_s: float, terms: LeapParameters
) -> float:
    """Probability that both ends of the streak are in a field centred on the predicted position."""
    along, across = np.sqrt(np.maximum(np.diag(place.along_across_arcsec2), 1e-6))
    half = 3600.0 * terms.field_radius_deg
    room = max(half - place.speed_arcsec_s * exposure_s / 2.0, 0.0)
    return erf(room / along / sqrt(2.0)) * erf(half / across / sqrt(2.0))


def _meeting(
    path: PredictedSkyPath, start: Pose, now_utc_ns: int, earliest_ns: int, telescope: Telescope
) -> Leap | NoLeap:
    """Leap to the place where the mount has arrived and settled just when the satellite comes.

    Near a pole the polar axis gains on the satellite slowly: steps that shrink by a steady factor
    are summed up at once, and where that leads too far the search goes half the way back.
    """
    motion, terms, limits = telescope.motion, telescope.terms, telescope.limits
    t_ns = max(earliest_ns, path.from_utc_ns)
    late_ns, soon_ns, step_ns = t_ns, 0, 0
    exposure_s, good = SHORTEST_S, None
    for _ in range(_ROUNDS):
        near = path.at(t_ns + round((terms.latency_s + exposure_s / 2.0) * NS_PER_S))
        if near is not None:
            exposure_s = leap_exposure_s(near, terms)
        t_mid_ns = t_ns + round((terms.latency_s + exposure_s / 2.0) * NS_PER_S)
        met = path.at(t_mid_ns)
        if met is None:
            return NoLeap(kind="it sets")
        slew_s = motion.slew_98_percent_s(limits.travel_deg(start, *met.direction_deg))
        there_ns = now_utc_ns + round((slew_s + terms.settle_s) * NS_PER_S)
        if there_ns <= t_ns:
            good = (t_ns, t_mid_ns, exposure_s, met, slew_s)
            if t_ns <= late_ns or t_ns - max(there_ns, late_ns) <= _SAME_S * NS_PER_S:
                break
            soon_ns = t_ns
        else:
            late_ns, before_ns, step_ns = t_ns, step_ns, there_ns - t_ns
            ratio = step_ns / before_ns if before_ns > 0 else 0.0
            more_s = _SAME_S / 2.0 * NS_PER_S
            if 0.0 < ratio < _GAINING:
                more_s += step_ns * ratio / (1.0 - ratio)
            t_ns = there_ns + round(more_s)
        if soon_ns and not late_ns < t_ns < soon_ns:
            t_ns = (late_ns + soon_ns) // 2
    if good is None:
        return NoLeap(kind="too fast")
    t_ns, t_mid_ns, exposure_s, met, slew_s = good
    side = limits.arrival_side(start, *met.direction_deg, now_utc_ns)
    return Leap(
        t_order_utc_ns=now_utc_ns,
        t_expose_utc_ns=t_ns,
        t_mid_utc_ns=t_mid_ns,
        exposure_s=exposure_s,
        place=met,
        side=side,
        slew_s=slew_s,
        within=both_ends_probability(met, exposure_s, terms),
        flips=None not in (side, start.pier_side) and side != start.pier_side,
        binning=terms.binning,
    )
