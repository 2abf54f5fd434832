"""Measurement of a streak in a solved frame: a direction on the sky with its covariance."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rsoconsole.config import CalibratedTiming, ExposureConfig
from rsoconsole.records import (
    BelowTau,
    CameraMode,
    Detection,
    Detections,
    Frame,
    FrameTaken,
    Measurement,
    Solution,
    Source,
    measurement_id_of,
)
from rsoconsole.sky import jacobian_arcsec_px, pixel_to_sky

GPS_SIGMA_S = 0.001
"""Timing sigma of a camera with its own GPS receiver, unless it was measured."""
NO_MODE = CameraMode()
MAX_FAINT = 40
"""Number of a frame's candidates below tau that may be of a track."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameTiming:
    """Timing of the shutter for one frame."""

    late_s: float
    """True mid-exposure of the first row minus that of the header."""
    sigma_s: float
    """Scatter from frame to frame, one sigma."""
    line_time_us: float
    bias_sigma_s: float = 0.0
    """Sigma of ``late_s``, an error common to all frames; 0 where it is not known."""

    @property
    def total_sigma_s(self) -> float:
        """Sigma of one frame's time: scatter and bias in quadrature."""
        return math.hypot(self.sigma_s, self.bias_sigma_s)


def frame_timing(frame: Frame | FrameTaken, exposure: ExposureConfig) -> FrameTiming:
    """Shutter timing of a frame: calibrated for its camera mode, else the settings for all modes.

    With the settings for all modes, a time by the camera's own GPS has no header latency.
    """
    found = calibrated_timing(frame, exposure) if exposure.calibrated else None
    if found is not None:
        return FrameTiming(
            late_s=found.bias_s,
            sigma_s=_surely(found),
            line_time_us=found.line_time_us,
            bias_sigma_s=found.bias_sigma_s,
        )
    is_gps = frame.camera is not None and frame.camera.time_by == "gps"
    return FrameTiming(
        late_s=0.0 if is_gps else exposure.header_latency_s,
        sigma_s=min(exposure.timing_sigma_s, GPS_SIGMA_S) if is_gps else exposure.timing_sigma_s,
        line_time_us=exposure.line_time_us,
    )


def calibrated_timing(
    frame: Frame | FrameTaken, exposure: ExposureConfig
) -> CalibratedTiming | None:
    """Return the calibrated timing for the frame's read-out mode and exposure; None without one.

    Of several exposures the nearest counts. A part of the sensor that was not calibrated itself has
    the timing of the whole sensor, with a larger sigma of the bias.
    """
    mode = read_out_mode(frame)
    fitting = [each for each in exposure.calibrated if each.read_out_mode == mode]
    if not fitting:
        fitting = [
            each.model_copy(update={"bias_sigma_s": math.hypot(each.bias_sigma_s, OF_PART_S)})
            for each in exposure.calibrated
            if _holds(each, frame)
        ]
    if not fitting:
        return None

    nearest = min(fitting, key=lambda each: _exposures_apart(each, frame.exposure_s))
    pooled = next((each for each in fitting if each.exposure_s is None), None)
    is_same = _exposures_apart(nearest, frame.exposure_s) <= math.log(SAME_EXPOSURE)
    return nearest if is_same or pooled is None else pooled


def _holds(known: CalibratedTiming, frame: Frame | FrameTaken) -> bool:
    """True where a frame is a part of the mode's area of the sensor, with like binning and gain."""
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
"""Assumed sigma, s, of the change in time bias when only a part of the sensor is read."""
SAME_EXPOSURE = 1.05
"""Largest ratio of two exposures that count as one camera mode."""


def usual_timing_sigma_s(exposure: ExposureConfig) -> float:
    """Timing scatter, s, of the calibrated mode nearest to the set exposure, else as configured."""
    if not exposure.calibrated:
        return exposure.timing_sigma_s

    set_s = exposure.exposure_s
    return _surely(min(exposure.calibrated, key=lambda each: _exposures_apart(each, set_s)))


def _exposures_apart(known: CalibratedTiming, exposure_s: float | None) -> float:
    """Distance of a mode's exposure from another, as a logarithm; infinite where one is unknown."""
    if known.exposure_s is None or not exposure_s:
        return math.inf
    return abs(math.log(known.exposure_s / exposure_s))


def _surely(found: CalibratedTiming) -> float:
    """Scatter with its error: a scatter found to be zero may be as large as its error."""
    return math.hypot(found.scatter_s, found.scatter_sigma_s)


def read_out_mode(frame: Frame | FrameTaken) -> tuple[object, ...]:
    """Read-out mode of a frame, in the form of ``CalibratedTiming.read_out``."""
    camera = frame.camera or NO_MODE
    sides = (frame.width_px, frame.height_px, camera.x0_px, camera.y0_px)
    return (camera.binning, *sides, camera.gain, camera.time_by)


AIR_ARCSEC_ROOT_S = 0.40
"""Wander of the satellite against stars half a degree off, times the root of the exposure.

1.3 arcsec theta^0.25 T^-0.5, theta in radians. Source: Lindegren 1980.
"""


def mid_exposure_utc_ns(frame: Frame | FrameTaken, exposure: ExposureConfig) -> int | None:
    """Return the mid-exposure, UTC ns: the header's plus the shutter's known delay.

    With a rolling shutter it is that of the first row. None where the header has no time.
    """
    if frame.t_mid_utc_ns is None:
        return None
    return frame.t_mid_utc_ns + round(frame_timing(frame, exposure).late_s * 1e9)


def with_row_time(measurement: Measurement, t_mid_utc_ns: int, shutter: FrameTiming) -> Measurement:
    """Return the measurement with the mid-exposure of its own row of pixels.

    ``t_mid_utc_ns``: mid-exposure of the first row.
    """
    t_row_ns = _row_mid_utc_ns(t_mid_utc_ns, measurement.y_px, shutter)
    if t_row_ns == measurement.t_mid_utc_ns:
        return measurement
    return replace(measurement, t_mid_utc_ns=t_row_ns)


def _row_mid_utc_ns(t_mid_utc_ns: int, y_px: float, shutter: FrameTiming) -> int:
    """Return the mid-exposure of a row: with a rolling shutter later than the first row's.

    A streak over several rows has the mid-exposure of its middle one, as its motion is even.
    """
    return t_mid_utc_ns + round(y_px * shutter.line_time_us * 1e3)


def measure(
    detection: Detection,
    solution: Solution,
    frame: Frame | FrameTaken,
    exposure: ExposureConfig,
    *,
    measurement_id: str,
    source: Source = "network",
) -> Measurement | None:
    """Return a streak's midpoint on the sky at mid-exposure; None when the frame has no time.

    The covariance is the sum of:
    - the midpoint's covariance along and across the streak, rotated to the sky,
    - (rate x timing scatter)^2 along the streak,
    - the error by the atmosphere and that of the plate solution, in every direction.

    The plate residuals include catalogue errors that differ from star to star (about 0.1 arcsec
    where proper motions are known). An error common to all stars of a field (0.5 mas/yr) is the
    same in the next frame, and does not show in a track's innovations.
    """
    t_mid_ns = mid_exposure_utc_ns(frame, exposure)
    if t_mid_ns is None or frame.exposure_s is None:
        return None
    shutter = frame_timing(frame, exposure)
    wcs = solution.wcs
    x, y = detection.x_px, detection.y_px
    ra, dec = pixel_to_sky(wcs, x, y)
    ra_ends, dec_ends = pixel_to_sky(
        wcs,
        np.array([detection.x_a_px, detection.x_b_px]),
        np.array([detection.y_a_px, detection.y_b_px]),
    )
    return Measurement(
        measurement_id=measurement_id,
        frame_id=frame.frame_id,
        t_mid_utc_ns=_row_mid_utc_ns(t_mid_ns, y, shutter),
        ra_icrs_deg=float(ra),
        dec_icrs_deg=float(dec),
        cov_sky_arcsec2=_covariance(detection, solution, frame.exposure_s, shutter),
        x_px=x,
        y_px=y,
        confidence=detection.confidence,
        source=source,
        ends_icrs_deg=(
            None
            if detection.method == "box"
            else ((float(ra_ends[0]), float(dec_ends[0])), (float(ra_ends[1]), float(dec_ends[1])))
        ),
        is_crossing=detection.kind == "crossing",
        object_class=detection.object_class,
        is_clipped=detection.is_clipped,
    )


def measure_detections(
    found: Detections, solution: Solution, frame: Frame | FrameTaken, exposure: ExposureConfig
) -> tuple[Measurement, ...]:
    """Return the measurements of a frame's detections, in their order; () without a time."""
    made = (
        measure(
            each,
            solution,
            frame,
            exposure,
            measurement_id=measurement_id_of(frame.frame_id, number),
        )
        for number, each in enumerate(found.detections)
    )
    return tuple(m for m in made if m is not None)


def measure_faint(
    found: Detections, solution: Solution, frame: Frame | FrameTaken, exposure: ExposureConfig
) -> tuple[Measurement, ...]:
    """Return the measurements of a frame's likeliest candidates below tau; () without a time."""
    numbered = enumerate(found.rejected, start=len(found.detections))
    faint = (
        (number, each.detection)
        for number, each in numbered
        if isinstance(each.reason, BelowTau) and each.detection.kind == "streak"
    )
    made = (
        measure(
            detection,
            solution,
            frame,
            exposure,
            measurement_id=measurement_id_of(frame.frame_id, number),
            source="faint",
        )
        for number, detection in itertools.islice(faint, MAX_FAINT)
    )
    return tuple(m for m in made if m is not None)


def with_recorded_ids(
    measurements: Sequence[Measurement], recorded: Sequence[Measurement], found: Detections
) -> tuple[Measurement, ...]:
    """Return the measurements of a frame reduced again, with ids not used for other ones.

    A measurement equal to one of ``recorded`` gets its id. Any other gets a number after those of
    the recorded candidates ``found``, because the operator's decisions may refer to these.
    """
    numbers = itertools.count(len(found.detections) + len(found.rejected))
    same = {replace(each, measurement_id=""): each.measurement_id for each in recorded}
    return tuple(
        replace(
            each,
            measurement_id=same.get(replace(each, measurement_id=""))
            or measurement_id_of(each.frame_id, next(numbers)),
        )
        for each in measurements
    )


def _covariance(
    detection: Detection, solution: Solution, exposure_s: float, shutter: FrameTiming
) -> tuple[float, float, float]:
    jacobian = jacobian_arcsec_px(solution.wcs, detection.x_px, detection.y_px)
    angle = math.radians(detection.angle_deg)
    along = jacobian @ np.array([math.cos(angle), math.sin(angle)])
    across = jacobian @ np.array([-math.sin(angle), math.cos(angle)])
    timing_px = detection.length_px / exposure_s * shutter.sigma_s
    variance_along = detection.sigma_along_px**2 + timing_px**2
    cov = variance_along * np.outer(along, along)
    cov += detection.sigma_across_px**2 * np.outer(across, across)
    plate_arcsec2 = solution.rms_arcsec**2 / max(solution.matched, 1)
    air_arcsec2 = AIR_ARCSEC_ROOT_S**2 / max(exposure_s, 0.01)
    cov += np.eye(2) * (plate_arcsec2 + air_arcsec2)
    return float(cov[0, 0]), float(cov[0, 1]), float(cov[1, 1])
