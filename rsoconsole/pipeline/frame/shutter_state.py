"""What is known of the shutter that took a frame: calibrated for its camera mode, or as set."""

import math
from dataclasses import dataclass

from rsoconsole.config import CalibratedTiming, ExposureConfig
from rsoconsole.records import CameraMode, Frame, FrameTaken

GPS_SIGMA_S = 0.001
"""How well a camera's own GPS receiver knows its shutter, unless that was measured."""
NO_MODE = CameraMode()


@dataclass(frozen=True, slots=True, kw_only=True)
class ShutterTime:
    """Of one frame."""

    late_s: float
    """True mid-exposure of the first row minus the header's."""
    sigma_s: float
    """From frame to frame, one sigma."""
    line_time_us: float
    bias_sigma_s: float = 0.0
    """What ``late_s`` may be off in all frames together; 0: nobody knows."""

    @property
    def total_sigma_s(self) -> float:
        """Of one frame's time by itself."""
        return math.hypot(self.sigma_s, self.bias_sigma_s)


def shutter_time(frame: Frame | FrameTaken, exposure: ExposureConfig) -> ShutterTime:
    """By the calibration of the frame's mode; where there is none, by the settings for all.

    A time by the camera's own GPS has no header latency.
    """
    found = calibrated_for(frame, exposure) if exposure.calibrated else None
    if found is not None:
        return ShutterTime(
            late_s=found.bias_s,
            sigma_s=_surely(found),
            line_time_us=found.line_time_us,
            bias_sigma_s=found.bias_sigma_s,
        )
    is_gps = frame.camera is not None and frame.camera.time_by == "gps"
    return ShutterTime(
        late_s=0.0 if is_gps else exposure.header_latency_s,
        sigma_s=min(exposure.timing_sigma_s, GPS_SIGMA_S) if is_gps else exposure.timing_sigma_s,
        line_time_us=exposure.line_time_us,
    )


def calibrated_for(frame: Frame | FrameTaken, exposure: ExposureConfig) -> CalibratedTiming | None:
    """The entry of the frame's read-out mode and the exposure nearest to its own.

    Of a part of the sensor that has none, that of the whole, whose clock and lines it shares; its
    bias is known less well.
    """
    mode = read_out_of(frame)
    fitting = [each for each in exposure.calibrated if each.read_out == mode]
    if not fitting:
        fitting = [
            each.model_copy(update={"bias_sigma_s": math.hypot(each.bias_sigma_s, OF_PART_S)})
            for each in exposure.calibrated
            if _holds(each, frame)
        ]
    if not fitting:
        return None

    def how_far(each: CalibratedTiming) -> float:
        if each.exposure_s is None or not frame.exposure_s:
            return math.inf
        return abs(math.log(each.exposure_s / frame.exposure_s))

    nearest = min(fitting, key=how_far)
    pooled = next((each for each in fitting if each.exposure_s is None), None)
    is_same = how_far(nearest) <= math.log(SAME_EXPOSURE)
    return nearest if is_same or pooled is None else pooled


def _holds(known: CalibratedTiming, frame: Frame | FrameTaken) -> bool:
    """Whether a frame is a part of the sensor that a mode reads, joined and amplified alike."""
    camera = frame.camera or NO_MODE
    if None in (camera.x0_px, camera.y0_px, known.width_px, known.height_px):
        return False
    x0, y0 = (camera.x0_px or 0) - (known.x0_px or 0), (camera.y0_px or 0) - (known.y0_px or 0)
    return (
        (known.binning, known.gain, known.time_by) == (camera.binning, camera.gain, camera.time_by)
        and 0 <= x0 <= (known.width_px or 0) - frame.width_px
        and 0 <= y0 <= (known.height_px or 0) - frame.height_px
    )


OF_PART_S = 0.005
"""What reading a part may change of when the shutter opens: nobody has measured it."""
SAME_EXPOSURE = 1.05
"""Exposures that differ by no more than this factor are of one mode."""


def usual_sigma_s(exposure: ExposureConfig) -> float:
    """Scatter of the shutter where no frame is at hand: of the mode nearest to the set exposure."""
    if not exposure.calibrated:
        return exposure.timing_sigma_s

    def how_far(each: CalibratedTiming) -> float:
        if each.exposure_s is None:
            return math.inf
        return abs(math.log(each.exposure_s / exposure.exposure_s))

    return _surely(min(exposure.calibrated, key=how_far))


def _surely(found: CalibratedTiming) -> float:
    """Its scatter with its error: what was found to be nothing may be as much as that."""
    return math.hypot(found.scatter_s, found.scatter_sigma_s)


def read_out_of(frame: Frame | FrameTaken) -> tuple[object, ...]:
    """As ``CalibratedTiming.read_out``."""
    camera = frame.camera or NO_MODE
    sides = (frame.width_px, frame.height_px, camera.x0_px, camera.y0_px)
    return (camera.binning, *sides, camera.gain, camera.time_by)
