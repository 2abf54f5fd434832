"""Light curve of one track of a night: points of whole streaks and of steps along them. Pure.

The light of frames under different transparency compares: each streak's counts are scaled by its
own magnitude, or by the frame's zero point where it has none.
"""

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from rsoconsole.night.frame import NightFrame
from rsoconsole.night.tracks import NightTrack
from rsoconsole.records import Band, FloatArray, Measurement, StreakLight, TrackState
from rsoconsole.sky import wrap_180

MAG_PER_E = 2.5 / math.log(10.0)
"""Magnitudes in which light changes by a factor of e."""
MIN_DIRECTION_SIGMAS = 3.0
"""Speed along the streak, in sigmas of it, from which the direction of motion counts as known."""
NS_PER_S = 1e9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LightPoints:
    """Points of a light curve in order of time; all arrays have the shape (points,)."""

    frame_ids: Any
    t_utc_ns: Any
    """Middle of the time in which the light was collected, UTC nanoseconds, int64."""
    mag: FloatArray
    """Apparent magnitude; NaN where no light is left above noise."""
    mag_sigma: FloatArray
    """One sigma by noise, and in points of whole streaks by the zero point; NaN where unknown."""
    light: FloatArray
    """Light relative to the median of the track's streaks; noise makes it negative."""
    light_sigma: FloatArray
    exposure_s: FloatArray
    """Time in which the light was collected, s; NaN where it is not known."""
    is_saturated: Any
    """True where the object is brighter than measured."""
    is_blended: Any
    """True where stars on the streak had more than a tenth of its light."""

    def __len__(self) -> int:
        return len(self.t_utc_ns)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LightCurve:
    """Light curve of one track."""

    track_id: int
    band: Band
    points: LightPoints
    """One point for each streak, at the middle of its exposure."""
    steps: LightPoints
    """Points along the streaks, each at its own time."""
    unit_mag: float
    """Magnitude of a light of 1."""
    frames: int
    """Number of frames in which the track was measured."""
    other_band: int = 0
    """Number of streaks that were left out because their magnitude is of another band."""
    shared: int = 0
    """Number of streaks that were left out because another track took the same light."""
    undirected: int = 0
    """Number of streaks without steps because the direction of motion is not known."""


class _Streak(NamedTuple):
    """One streak of the track with its scale from counts to relative light."""

    measured: Measurement
    light: StreakLight
    scale: float
    """Relative flux (0 mag is 1) of 1 ADU a second."""
    exposure_s: float


def light_curve_of(frames: Sequence[NightFrame], track: NightTrack) -> LightCurve | None:
    """Return the light curve of a track; None where no brightness of it is on record."""
    by_id = {each.frame_id: each for each in frames}
    shared = {each.measurement_id for each in track.states if each.shared_with is not None}
    found = [
        (measured, frame, light)
        for measured in track.measurements
        if (frame := by_id.get(measured.frame_id)) is not None
        and (light := frame.light_of(measured.measurement_id)) is not None
    ]
    own = [each for each in found if each[0].measurement_id not in shared]
    if not own:
        return None
    band = Counter(light.band for _, _, light in own).most_common(1)[0][0]
    streaks = sorted(
        (_streak(m, frame, light) for m, frame, light in own if light.band == band),
        key=lambda each: each.measured.t_mid_utc_ns,
    )
    unit = _unit(streaks)
    points = _points([_whole(each, unit) for each in streaks])
    steps: list[_Row] = []
    undirected = 0
    for each in streaks:
        if not each.light.steps:
            continue
        is_a_first = is_end_a_first(track.states, each.measured)
        undirected += is_a_first is None
        if is_a_first is not None:
            steps += _rows_of_steps(each, unit, is_a_first=is_a_first)
    return LightCurve(
        track_id=track.number,
        band=band,
        points=points,
        steps=_points(sorted(steps, key=lambda each: each.t_utc_ns)),
        unit_mag=-2.5 * math.log10(unit),
        frames=len({each.frame_id for each in track.measurements}),
        other_band=len(own) - len(streaks),
        shared=len(found) - len(own),
        undirected=undirected,
    )


def is_end_a_first(states: Iterable[TrackState], measured: Measurement) -> bool | None:
    """Return True if the object was at end a of its streak first, by the rate of its track.

    The state nearest in time gives the rate. None where the ends are not known, and where the speed
    along the streak is below ``MIN_DIRECTION_SIGMAS``.
    """
    t_ns = measured.t_mid_utc_ns
    state = min(
        states,
        key=lambda each: (abs(each.t_utc_ns - t_ns), each.kind == "predicted"),
        default=None,
    )
    if state is None or measured.ends_icrs_deg is None:
        return None
    (ra_a, dec_a), (ra_b, dec_b) = measured.ends_icrs_deg
    cos_dec = math.cos(math.radians(measured.dec_icrs_deg))
    along = np.array([float(wrap_180(ra_b - ra_a)) * cos_dec, dec_b - dec_a])
    length = float(np.hypot(*along))
    if length == 0.0:
        return None
    along /= length
    rates = np.array([state.x[1] * cos_dec, state.x[3]])
    P = np.asarray(state.P, float)[np.ix_((1, 3), (1, 3))]
    to_sky = np.diag((cos_dec, 1.0))
    speed = float(along @ rates)
    sigma = math.sqrt(max(float(along @ to_sky @ P @ to_sky @ along), 0.0))
    if speed == 0.0 or abs(speed) < MIN_DIRECTION_SIGMAS * sigma:
        return None
    return speed > 0.0


class _Row(NamedTuple):
    """One point, in the order of the fields of ``LightPoints``."""

    frame_id: int
    t_utc_ns: int
    mag: float
    mag_sigma: float
    light: float
    light_sigma: float
    exposure_s: float
    is_saturated: bool
    is_blended: bool


def _streak(measured: Measurement, frame: NightFrame, light: StreakLight) -> _Streak:
    zero_point = None if frame.photometry is None else frame.photometry.zero_point_mag
    if light.mag is not None and light.rate_adu_s > 0.0:
        scale = 10.0 ** (-0.4 * light.mag) / light.rate_adu_s
    elif light.band == "V" and zero_point is not None:
        scale = 10.0 ** (-0.4 * zero_point)
    else:
        scale = 1.0
    exposure_s = None if frame.taken is None else frame.taken.exposure_s
    return _Streak(measured, light, scale, math.nan if exposure_s is None else exposure_s)


def _unit(streaks: Sequence[_Streak]) -> float:
    """Median flux of the streaks that have any, in the units of 0 mag."""
    fluxes = [each.light.rate_adu_s * each.scale for each in streaks]
    return float(np.median([flux for flux in fluxes if flux > 0.0] or [1.0]))


def _whole(streak: _Streak, unit: float) -> _Row:
    light, scale = streak.light, streak.scale / unit
    value = light.rate_adu_s * scale
    noise = light.rate_sigma_adu_s * scale
    if light.mag_sigma is not None and value > 0.0:
        noise = max(noise, value * light.mag_sigma / MAG_PER_E)
    return _Row(
        frame_id=streak.measured.frame_id,
        t_utc_ns=streak.measured.t_mid_utc_ns,
        mag=math.nan if light.mag is None else light.mag,
        mag_sigma=math.nan if light.mag_sigma is None else light.mag_sigma,
        light=value,
        light_sigma=noise,
        exposure_s=streak.exposure_s,
        is_saturated=light.is_saturated,
        is_blended=light.is_blended,
    )


def _rows_of_steps(streak: _Streak, unit: float, *, is_a_first: bool) -> Iterator[_Row]:
    scale, sign = streak.scale / unit, 1.0 if is_a_first else -1.0
    times = [each.t_s for each in streak.light.steps]
    width_s = float(np.median(np.abs(np.diff(times)))) if len(times) > 1 else math.nan
    for each in streak.light.steps:
        value, noise = each.rate_adu_s * scale, each.rate_sigma_adu_s * scale
        is_lit = value > 0.0
        yield _Row(
            frame_id=streak.measured.frame_id,
            t_utc_ns=streak.measured.t_mid_utc_ns + round(sign * each.t_s * NS_PER_S),
            mag=-2.5 * math.log10(value * unit) if is_lit else math.nan,
            mag_sigma=MAG_PER_E * noise / value if is_lit else math.nan,
            light=value,
            light_sigma=noise,
            exposure_s=width_s,
            is_saturated=streak.light.is_saturated,
            is_blended=streak.light.is_blended,
        )


def _points(rows: Sequence[_Row]) -> LightPoints:
    def column(name: str, kind: Any = float) -> Any:
        return np.array([getattr(each, name) for each in rows], dtype=kind)

    return LightPoints(
        frame_ids=column("frame_id", np.int64),
        t_utc_ns=column("t_utc_ns", np.int64),
        mag=column("mag"),
        mag_sigma=column("mag_sigma"),
        light=column("light"),
        light_sigma=column("light_sigma"),
        exposure_s=column("exposure_s"),
        is_saturated=column("is_saturated", bool),
        is_blended=column("is_blended", bool),
    )
