"""Streaks of low satellites in a frame, by their two ends on the sky. Pure."""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rsoconsole.config import ExposureConfig
from rsoconsole.orbits import UNSEEN_ARCSEC, StreakEnds, TimingErrors
from rsoconsole.pipeline.frame.measurement import (
    AIR_ARCSEC_ROOT_S,
    frame_timing,
    mid_exposure_utc_ns,
)
from rsoconsole.records import Detection, Detections, FloatArray, Frame, FrameTaken, Solution
from rsoconsole.sky import pixel_to_sky
from rsoconsole.tracking import TRACKABLE_CLASSES
from rsoconsole.words import NS_PER_S

MIN_SIGMA_PX = 0.3
"""Lowest sigma of an end, however well its streak fits."""
UNKNOWN_BIAS_S = 0.1
"""Assumed sigma, s, of a shutter's time bias that has not been measured."""
MIN_SCATTER_S = 1e-4
STATED_FRAMES = 2.0
"""Weight, in frames, of a timing scatter that is configured and not measured."""
RIM_PX = 6.0
"""Distance from the frame's edge within which a streak's end counts as cut by the edge."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrameStreak:
    """Streak of a frame, by its ends on the sky and as detected."""

    ends: StreakEnds
    detection: Detection

    @property
    def may_begin_track(self) -> bool:
        """True where a track may begin with this streak: both ends seen, and a satellite's class.

        Once a track exists, a streak with the satellite's predicted place, direction and speed
        belongs to it whatever its class: the brightest satellites look like aircraft.
        """
        return self.ends.is_whole and self.detection.object_class in TRACKABLE_CLASSES


def frame_streaks(
    found: Detections, solution: Solution, frame: Frame | FrameTaken, exposure: ExposureConfig
) -> tuple[FrameStreak, ...]:
    """Return the streaks with one or both ends in the frame; the most confident first."""
    t_mid_ns, exposure_s = mid_exposure_utc_ns(frame, exposure), frame.exposure_s
    if t_mid_ns is None or exposure_s is None:
        return ()
    half_ns = round(exposure_s / 2.0 * NS_PER_S)
    shutter = frame_timing(frame, exposure)
    size_px = (frame.width_px, frame.height_px)
    made = []
    for each in sorted(found.detections, key=lambda one: -one.confidence):
        if each.kind == "crossing" or each.method == "box":
            continue
        along, across = _sigmas(each, solution, exposure_s)
        x = np.array([each.x_a_px, each.x_b_px])
        y = np.array([each.y_a_px, each.y_b_px])
        cut = _is_cut(each, x, y, size_px)
        if np.all(cut):
            continue
        ra, dec = pixel_to_sky(solution.wcs, x, y)
        ends = StreakEnds(
            t_open_utc_ns=t_mid_ns - half_ns,
            t_close_utc_ns=t_mid_ns + half_ns,
            ra_icrs_deg=np.asarray(ra),
            dec_icrs_deg=np.asarray(dec),
            sigma_along_arcsec=np.where(cut, UNSEEN_ARCSEC, along),
            sigma_across_arcsec=np.full(2, across),
            delay_s=y * shutter.line_time_us * 1e-6,
        )
        made.append(FrameStreak(ends=ends, detection=each))
    return tuple(made)


def timing_uncertainty(frame: Frame | FrameTaken, exposure: ExposureConfig) -> TimingErrors:
    """Return sigmas of the errors of exposure times in the camera mode of ``frame``.

    The errors are a bias common to all frames and the scatter from frame to frame.
    """
    shutter = frame_timing(frame, exposure)
    is_gps = frame.camera is not None and frame.camera.time_by == "gps"
    unknown_s = 0.0 if is_gps else UNKNOWN_BIAS_S
    is_measured = is_gps or shutter.bias_sigma_s > 0.0
    return TimingErrors(
        scatter_s=max(shutter.sigma_s, MIN_SCATTER_S),
        bias_sigma_s=shutter.bias_sigma_s or unknown_s,
        scatter_frames=math.inf if is_measured else STATED_FRAMES,
    )


def _sigmas(detection: Detection, solution: Solution, exposure_s: float) -> tuple[float, float]:
    """Sigmas of either end along and across the streak, arcsec, from those of the midpoint."""
    scale = solution.scale_arcsec_px
    # Two ends that err by themselves make a midpoint that errs by a root of two less.
    along_px = max(math.sqrt(2.0) * detection.sigma_along_px, MIN_SIGMA_PX)
    turn_deg = detection.sigma_angle_deg or 0.0
    lever_px = detection.length_px / 2.0 * math.radians(turn_deg)
    across_px = max(math.hypot(detection.sigma_across_px, lever_px), MIN_SIGMA_PX)
    plate_arcsec2 = solution.rms_arcsec**2 / max(solution.matched, 1)
    shared = plate_arcsec2 + AIR_ARCSEC_ROOT_S**2 / max(exposure_s, 0.01)
    return (
        math.sqrt((along_px * scale) ** 2 + shared),
        math.sqrt((across_px * scale) ** 2 + shared),
    )


def _is_cut(
    detection: Detection, x: FloatArray, y: FloatArray, size_px: tuple[int, int]
) -> npt.NDArray[np.bool_]:
    """True for each end, (2,), at the rim; of a clipped streak at least for the nearer one."""
    room = np.minimum(np.minimum(x, size_px[0] - 1 - x), np.minimum(y, size_px[1] - 1 - y))
    cut = room < RIM_PX
    if detection.is_clipped and not np.any(cut):
        cut[int(np.argmin(room))] = True
    return np.asarray(cut)
