"""Drift of the telescope while its mount tracks, and the error of the polar axis. Pure.

The plate gives the direction in which the telescope looks, the mount reports the direction that it
assumes; the difference changes while the mount tracks. A polar axis that is off makes the
declination drift: near the meridian by its error in azimuth, low in the east or west by its error
in altitude. Source: drift alignment as in Hook 1989, J. Br. Astron. Assoc. 99, 19; terms ME and MA
in Wallace 1994, TPOINT. Flexure and refraction cause drift too: no error of the axis is stated
below half an arcminute.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from rsoconsole.records import FloatArray
from rsoconsole.sky import IntArray, wrap_180

SAME_SLEW_ARCSEC = 10.0
"""Largest change of the mount's reported direction between frames of one slew."""
FLIP_DEG = 90.0
MIN_FRAMES = 5
MIN_HOURS = 0.05
RADIANS_AN_HOUR = math.radians(15.0)
NEAR_MERIDIAN_DEG, FAR_FROM_MERIDIAN_DEG = 30.0, 60.0
NO_ERROR_ARCMIN = 0.5
NS_PER_HOUR = 3600.0 * 1e9

Axis = Literal["azimuth", "altitude", "both"]


@dataclass(frozen=True, slots=True, kw_only=True)
class SolvedPointing:
    """One solved frame: the directions that the mount and the plate give."""

    t_utc_ns: int
    mount_icrs_deg: tuple[float, float]
    """Direction that the mount reports (RA, Dec)."""
    plate_icrs_deg: tuple[float, float]
    """Direction that the plate solution gives (RA, Dec)."""
    rotation_deg: float


@dataclass(frozen=True, slots=True, kw_only=True)
class HourlyRate:
    """A rate per hour, with its one sigma."""

    value: float
    sigma: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Drift:
    """Rates at which the plate's direction drifts from the mount's, on one side of the pier."""

    frames: int
    hours: float
    east_arcsec_h: HourlyRate
    """Rate of plate minus mount, eastward on the sky."""
    north_arcsec_h: HourlyRate
    rotation_deg_h: HourlyRate
    """Rate of the field's rotation, east of north."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PolarHint:
    """Error of the polar axis that the drift in declination at one hour angle shows."""

    axis: Axis
    error_arcmin: float
    """Size of the error, as far as that hour angle shows it."""
    words: str
    """Sense of the error, as ``too low``; empty: too small, or not shown at that hour angle."""


def offsets_arcsec(looks: Sequence[SolvedPointing]) -> FloatArray:
    """Offsets (n, 2) of the plate from the mount, east (on the sky) and north, arcsec."""
    mount = np.array([look.mount_icrs_deg for look in looks]).reshape(-1, 2)
    plate = np.array([look.plate_icrs_deg for look in looks]).reshape(-1, 2)
    east = wrap_180(plate[:, 0] - mount[:, 0]) * np.cos(np.radians(plate[:, 1]))
    return np.asarray(3600.0 * np.stack([east, plate[:, 1] - mount[:, 1]], axis=1))


def fit_drift(looks: Sequence[SolvedPointing]) -> Drift | None:
    """Fit the drift over the frames since the camera was last flipped.

    None: too few frames, or over too short a time. Frames between which the mount was not slewed
    share one offset, so that the scatter of slews does not count as drift.
    """
    recent = _since_flip(looks)
    if len(recent) < MIN_FRAMES:
        return None
    t_h = np.array([(look.t_utc_ns - recent[0].t_utc_ns) / NS_PER_HOUR for look in recent])
    if t_h[-1] - t_h[0] < MIN_HOURS:
        return None
    slews = _slews(recent)
    east, north = offsets_arcsec(recent).T
    rotation = np.array([look.rotation_deg for look in recent])
    turned = rotation[0] + np.asarray(wrap_180(rotation - rotation[0]))
    whole = np.zeros(len(recent), int)
    return Drift(
        frames=len(recent),
        hours=float(t_h[-1] - t_h[0]),
        east_arcsec_h=_better(t_h, east, slews, whole),
        north_arcsec_h=_better(t_h, north, slews, whole),
        rotation_deg_h=_better(t_h, turned, whole),
    )


def polar_hint(drift: Drift, hour_angle_deg: float, latitude_deg: float) -> PolarHint:
    """Error of the polar axis that a drift in declination shows.

    ``hour_angle_deg``: that of the frames, west positive.
    """
    north = drift.north_arcsec_h
    hour_angle_deg = float(wrap_180(hour_angle_deg))
    away_deg = min(abs(hour_angle_deg), 180.0 - abs(hour_angle_deg))
    error_arcmin = abs(north.value) / RADIANS_AN_HOUR / 60.0
    axis: Axis = "both"
    if away_deg <= NEAR_MERIDIAN_DEG:
        axis = "azimuth"
        error_arcmin /= math.cos(math.radians(away_deg))
    elif away_deg >= FAR_FROM_MERIDIAN_DEG:
        axis = "altitude"
        error_arcmin /= math.sin(math.radians(away_deg))
    is_sure = abs(north.value) > 3.0 * north.sigma and error_arcmin >= NO_ERROR_ARCMIN
    if not is_sure or axis == "both":
        return PolarHint(axis=axis, error_arcmin=error_arcmin, words="")
    # Seen from the south the axis' other end is up.
    sign = math.copysign(1.0, north.value) * (1.0 if latitude_deg >= 0.0 else -1.0)
    if axis == "azimuth":
        beyond_pole = abs(hour_angle_deg) > 90.0
        is_east = (sign > 0.0) is not beyond_pole
        words = "too far east" if is_east else "too far west"
    else:
        is_low = (sign > 0.0) is (hour_angle_deg < 0.0)
        words = "too low" if is_low else "too high"
    return PolarHint(axis=axis, error_arcmin=error_arcmin, words=words)


def _since_flip(looks: Sequence[SolvedPointing]) -> list[SolvedPointing]:
    """Return the last frames, back to where the camera stood the other way round."""
    recent: list[SolvedPointing] = []
    for look in reversed(looks):
        if recent and abs(wrap_180(look.rotation_deg - recent[-1].rotation_deg)) > FLIP_DEG:
            break
        recent.append(look)
    return recent[::-1]


def _slews(looks: Sequence[SolvedPointing]) -> IntArray:
    """Number of the slew before each frame."""
    mount = np.array([look.mount_icrs_deg for look in looks])
    east = wrap_180(np.diff(mount[:, 0])) * np.cos(np.radians(mount[1:, 1]))
    moved = 3600.0 * np.hypot(east, np.diff(mount[:, 1])) > SAME_SLEW_ARCSEC
    return np.concatenate([[0], np.cumsum(moved)])


def _better(t_h: FloatArray, values: FloatArray, *groupings: IntArray) -> HourlyRate:
    """Slope by the grouping with the smaller error."""
    rates = [rate for each in groupings if (rate := _slope(t_h, values, each)) is not None]
    return min(rates, key=lambda rate: rate.sigma)


def _slope(t_h: FloatArray, values: FloatArray, groups: IntArray) -> HourlyRate | None:
    """Least-squares slope with a constant for each group; None where no group has a span."""
    t, y = t_h.copy(), values.copy()
    count = int(groups[-1]) + 1
    for group in range(count):
        mine = groups == group
        t[mine] -= t[mine].mean()
        y[mine] -= y[mine].mean()
    spread = float(t @ t)
    freedom = len(t) - count - 1
    if spread < (MIN_HOURS / 10.0) ** 2 or freedom < 2:
        return None
    value = float(t @ y) / spread
    scatter = float(np.sum((y - value * t) ** 2)) / freedom
    return HourlyRate(value=value, sigma=math.sqrt(scatter / spread))
