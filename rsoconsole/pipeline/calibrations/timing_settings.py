"""A shutter's timing as settings, and against those that it would replace."""

from collections.abc import Sequence

from rsoconsole.config import CalibratedTiming, ExposureConfig
from rsoconsole.orbits.navigation import ShutterTiming
from rsoconsole.pipeline.calibrations.time_calibration import FoundTiming, Mode


def timings_of(found: FoundTiming) -> tuple[CalibratedTiming, ...]:
    """One entry for each mode of which something was found; none of mere elements."""
    if found.kind == "tle":
        return ()
    return tuple(_timing(mode, timing, found) for mode, timing in found.modes if timing is not None)


def _timing(mode: Mode, timing: ShutterTiming, found: FoundTiming) -> CalibratedTiming:
    binning, width_px, height_px, x0_px, y0_px, gain, time_by = mode.read_out
    return CalibratedTiming.model_validate(
        {
            "exposure_s": mode.exposure_s,
            "binning": binning,
            "width_px": width_px,
            "height_px": height_px,
            "x0_px": x0_px,
            "y0_px": y0_px,
            "gain": gain,
            "time_by": time_by,
            "bias_s": round(timing.bias_s.value, 5),
            "bias_sigma_s": round(timing.bias_s.sigma, 5),
            "scatter_s": round(timing.scatter_s.value, 5),
            "scatter_sigma_s": round(timing.scatter_s.sigma, 5),
            "line_time_us": round(timing.line_time_s.value * 1e6, 3),
            "line_time_sigma_us": (
                round(timing.line_time_s.sigma * 1e6, 3) if timing.is_line_time_found else None
            ),
            "measured_on": found.measured_on,
            "source": found.kind,
            "tracks": timing.tracks,
            "measurements": timing.measurements,
        }
    )


def put_together(
    exposure: ExposureConfig, timings: Sequence[CalibratedTiming]
) -> tuple[CalibratedTiming, ...]:
    """What is known of other modes, then the new ones."""
    new = {each.mode for each in timings}
    return (*(each for each in exposure.calibrated if each.mode not in new), *timings)


def worse_than_known(
    timings: Sequence[CalibratedTiming], exposure: ExposureConfig
) -> tuple[tuple[CalibratedTiming, CalibratedTiming], ...]:
    """(new, known) of each mode of which something known is surer than the new."""
    known = {each.mode: each for each in exposure.calibrated}
    pairs = ((each, known[each.mode]) for each in timings if each.mode in known)
    return tuple((new, old) for new, old in pairs if _is_worse(new, old))


def _is_worse(new: CalibratedTiming, old: CalibratedTiming) -> bool:
    if new.bias_sigma_s > old.bias_sigma_s or new.scatter_sigma_s > old.scatter_sigma_s:
        return True
    if old.line_time_sigma_us is None:
        return False
    return new.line_time_sigma_us is None or new.line_time_sigma_us > old.line_time_sigma_us
