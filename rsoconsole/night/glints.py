"""Glints: short brightenings far above the rest of a light curve. Pure.

A glint stands out of the curve's own scatter, so that the peaks of a tumbling satellite are none,
and out of its noise, with the number of points in mind among which the highest was picked.
"""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from rsoconsole.night.light_curve import LightCurve, LightPoints
from rsoconsole.records import FloatArray

GLINT_PROBABILITY = 0.01
"""Probability that noise alone makes a glint anywhere in a curve."""
MIN_HEIGHT_MAG = 0.3
"""Smallest height of a glint above the rest, magnitudes."""
MIN_POINTS = 5
"""Smallest number of points that make a rest to stand out of."""
REST_FRAMES = 5
"""Number of frames to each side whose light is the rest about a frame."""
_ROBUST = 1.4826
"""Standard deviation of normal noise in units of its median absolute deviation."""
_EDGE = 0.5
"""Share of a glint's height down to which steps beside its peak are of it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Glint:
    """One short brightening."""

    frame_id: int
    t_utc_ns: int
    """Time of its highest point, UTC nanoseconds."""
    height_mag: float
    """Magnitudes by which its highest point is above the rest."""
    duration_s: float
    """Time above half of its height, s; of one seen in whole frames only, at most this."""
    snr: float
    """Height in sigmas of noise and of the rest's scatter."""
    is_within_frame: bool
    """True where it is seen in the steps of a streak; False: the streak as a whole is bright."""


def glints_of(curve: LightCurve) -> tuple[Glint, ...]:
    """Return the glints of a track's light curve, in order of time.

    One that is seen in the steps of a frame's streak is not listed again for the frame as a whole.
    """
    within = _glints(curve.steps, curve.points, is_within_frame=True)
    within_ids = {each.frame_id for each in within}
    whole = _glints(curve.points, curve.points, is_within_frame=False)
    return tuple(
        sorted(
            [*within, *(each for each in whole if each.frame_id not in within_ids)],
            key=lambda each: each.t_utc_ns,
        )
    )


class _Heights(NamedTuple):
    """Light above the rest of each point."""

    rest: FloatArray
    above: FloatArray
    """Light minus the rest's."""
    snr: FloatArray


def _glints(points: LightPoints, whole: LightPoints, *, is_within_frame: bool) -> list[Glint]:
    if len(points) < MIN_POINTS:
        return []
    heights = _heights(points, whole)
    least = _threshold(len(points))
    found: list[Glint] = []
    for run in _runs(points, heights, least):
        peak = run[int(np.argmax(heights.above[run]))]
        height_mag = 2.5 * math.log10(1.0 + heights.above[peak] / heights.rest[peak])
        if height_mag < MIN_HEIGHT_MAG:
            continue
        of_run = points.t_utc_ns[run]
        width_s = float(np.nan_to_num(points.exposure_s[peak]))
        found.append(
            Glint(
                frame_id=int(points.frame_ids[peak]),
                t_utc_ns=int(points.t_utc_ns[peak]),
                height_mag=height_mag,
                duration_s=float(of_run[-1] - of_run[0]) / 1e9 + width_s,
                snr=float(heights.snr[peak]),
                is_within_frame=is_within_frame,
            )
        )
    return found


def _heights(points: LightPoints, whole: LightPoints) -> _Heights:
    """Heights above the slow course of the light in the frames about each point's own."""
    floor = 0.02 * max(float(np.median(whole.light)), 1e-9)
    numbers = np.unique(points.frame_ids)
    own = [points.frame_ids == number for number in numbers]
    t_s = np.array([(points.t_utc_ns[each].mean() - points.t_utc_ns[0]) / 1e9 for each in own])
    logs = np.log([max(float(np.median(points.light[each])), floor) for each in own])
    rest = np.zeros(len(points))
    for at, each in enumerate(own):
        near = slice(max(at - REST_FRAMES, 0), at + REST_FRAMES + 1)
        rest[each] = math.exp(_on_line(t_s[near] - t_s[at], logs[near]))
    above = points.light - rest
    noise = points.light_sigma
    excess = _ROBUST * float(np.median(np.abs(above / rest - np.median(above / rest))))
    return _Heights(rest, above, above / np.hypot(noise, excess * rest))


def _on_line(t_s: FloatArray, values: FloatArray) -> float:
    """Value at time 0 of the line with the median slope of all pairs of points (Theil-Sen)."""
    first, second = np.triu_indices(t_s.size, 1)
    lags = t_s[second] - t_s[first]
    slope = (
        np.median((values[second] - values[first])[lags > 0] / lags[lags > 0]) if first.size else 0
    )
    return float(np.median(values - slope * t_s))


def _threshold(points: int) -> float:
    """Sigmas that the highest of a number of points of noise passes with ``GLINT_PROBABILITY``."""
    from scipy.stats import norm

    return float(norm.isf(GLINT_PROBABILITY / points))


def _runs(points: LightPoints, heights: _Heights, least: float) -> list[Any]:
    """Indices of each glint: neighbours within a frame above half the height of its peak."""
    runs: list[Any] = []
    is_used = np.zeros(len(points), bool)
    for peak in np.argsort(heights.snr)[::-1]:
        if heights.snr[peak] < least:
            break
        if is_used[peak]:
            continue
        edge = _EDGE * heights.above[peak]
        first, last = int(peak), int(peak)
        while first > 0 and _is_beside(points, heights, (first - 1, first), edge):
            first -= 1
        while last + 1 < len(points) and _is_beside(points, heights, (last + 1, last), edge):
            last += 1
        run = np.arange(first, last + 1)
        if not is_used[run].any():
            runs.append(run)
        # What lies beside it is its wing, not a glint of its own.
        is_used[max(first - 2, 0) : last + 3] |= (
            points.frame_ids[max(first - 2, 0) : last + 3] == points.frame_ids[peak]
        )
    return runs


def _is_beside(points: LightPoints, heights: _Heights, pair: tuple[int, int], edge: float) -> bool:
    new, old = pair
    is_same_frame = points.frame_ids[new] == points.frame_ids[old]
    return bool(is_same_frame and heights.above[new] >= edge)
