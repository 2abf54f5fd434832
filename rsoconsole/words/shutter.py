"""The shutter's calibration in words, with its age."""

from datetime import date

from rsoconsole.config import CalibratedTiming, ExposureConfig
from rsoconsole.words.angles import count_words

OLD_DAYS = 180
"""Age in days from which on a calibration is old: drivers are updated, cables changed."""


def camera_mode_words(mode: tuple[object, ...], others: str = "any exposure") -> str:
    """Format a camera's mode: ``2 s, 1x1, 4656 x 3520 px, gain 139``.

    ``others``: words for a mode without an exposure time.
    """
    exposure_s, binning, width_px, height_px, x0_px, y0_px, gain, time_by = mode
    parts = [others if exposure_s is None else f"{exposure_s:g} s"]
    parts += [str(binning)] if binning else []
    if width_px and height_px:
        at = f" from {x0_px}, {y0_px}" if x0_px or y0_px else ""
        parts.append(f"{width_px} x {height_px} px{at}")
    parts += [f"gain {gain:g}"] if isinstance(gain, int | float) else []
    parts += ["times by the camera's GPS"] if time_by == "gps" else []
    return ", ".join(parts)


def timing_words(timing: CalibratedTiming, today: date) -> str:
    """Format a calibration with its age.

    E.g. ``+137.2 ± 2.1 ms late, scatter 8.0 ± 0.9 ms, lines 15.0 ± 0.5 µs, 3 days old``.
    """
    return (
        f"{timing.bias_s * 1e3:+.1f} ± {timing.bias_sigma_s * 1e3:.1f} ms late, scatter"
        f" {timing.scatter_s * 1e3:.1f} ± {timing.scatter_sigma_s * 1e3:.1f} ms,"
        f" lines {line_time_words(timing)}, {calibration_age_words(timing, today)}"
    )


def timing_errors_words(timing: CalibratedTiming) -> str:
    """Format the errors of a calibration: those of bias, scatter and line time."""
    line = timing.line_time_sigma_us
    lines = "lines not measured" if line is None else f"lines ±{line:.1f} µs"
    return (
        f"bias ±{timing.bias_sigma_s * 1e3:.1f} ms, scatter ±{timing.scatter_sigma_s * 1e3:.1f} ms,"
        f" {lines}"
    )


def line_time_words(timing: CalibratedTiming) -> str:
    """Format the line time with its sigma, or with the remark that it was not measured."""
    value = f"{timing.line_time_us:.1f}"
    if timing.line_time_sigma_us is None:
        return f"{value} µs (not measured)"
    return f"{value} ± {timing.line_time_sigma_us:.1f} µs"


def calibration_age_days(timing: CalibratedTiming, today: date) -> int:
    """Return the whole days since a calibration's last night."""
    return (today - timing.measured_on).days


def calibration_age_words(timing: CalibratedTiming, today: date) -> str:
    """Format a calibration's age: of today, 1 day old, 3 days old."""
    days = calibration_age_days(timing, today)
    return "of today" if days == 0 else "1 day old" if days == 1 else f"{days} days old"


def shutter_words(exposure: ExposureConfig, today: date) -> str:
    """Format the newest calibration of the shutter in one line, with the number of other modes."""
    if not exposure.calibrated:
        return (
            f"shutter not calibrated: ±{exposure.timing_sigma_s * 1e3:g} ms assumed,"
            f" {exposure.header_latency_s * 1e3:+g} ms late"
        )
    newest = max(exposure.calibrated, key=lambda each: each.measured_on)
    others = len(exposure.calibrated) - 1
    more = f" (and {count_words(others, 'other mode')})" if others else ""
    return (
        f"shutter at {camera_mode_words(newest.camera_mode)}: {timing_words(newest, today)}{more}"
    )
