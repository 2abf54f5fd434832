"""What is known of the shutter, in words, with its age."""

from datetime import date, timedelta

from rsoconsole.config import CalibratedTiming, ExposureConfig
from rsoconsole.sky import NS_PER_DAY

OLD_DAYS = 180
"""Drivers are updated, cables changed: by then it is worth another look."""


def timing_words(timing: CalibratedTiming, today: date) -> str:
    """E.g. ``+137.2 ± 2.1 ms late, scatter 8.0 ± 0.9 ms, lines 15.0 ± 0.5 µs, 3 days old``."""
    return (
        f"{timing.bias_s * 1e3:+.1f} ± {timing.bias_sigma_s * 1e3:.1f} ms late, scatter"
        f" {timing.scatter_s * 1e3:.1f} ± {timing.scatter_sigma_s * 1e3:.1f} ms,"
        f" lines {line_words(timing)}, {age_words(timing, today)}"
    )


def errors_words(timing: CalibratedTiming) -> str:
    """Its errors alone."""
    line = timing.line_time_sigma_us
    lines = "lines not measured" if line is None else f"lines ±{line:.1f} µs"
    return (
        f"bias ±{timing.bias_sigma_s * 1e3:.1f} ms, scatter ±{timing.scatter_sigma_s * 1e3:.1f} ms,"
        f" {lines}"
    )


def line_words(timing: CalibratedTiming) -> str:
    """The line time, and whether it was measured."""
    value = f"{timing.line_time_us:.1f}"
    if timing.line_time_sigma_us is None:
        return f"{value} µs (not measured)"
    return f"{value} ± {timing.line_time_sigma_us:.1f} µs"


def age_days(timing: CalibratedTiming, today: date) -> int:
    """Whole days since its last night."""
    return (today - timing.measured_on).days


def age_words(timing: CalibratedTiming, today: date) -> str:
    """How old it is."""
    days = age_days(timing, today)
    return "of today" if days == 0 else "1 day old" if days == 1 else f"{days} days old"


def day_of(t_utc_ns: int) -> date:
    """The day (UTC) of an instant."""
    return date(1970, 1, 1) + timedelta(days=t_utc_ns // NS_PER_DAY)


def shutter_words(exposure: ExposureConfig, today: date) -> str:
    """What is known of the shutter, for a line that has room for one mode: the newest one's."""
    if not exposure.calibrated:
        return (
            f"shutter not calibrated: ±{exposure.timing_sigma_s * 1e3:g} ms assumed,"
            f" {exposure.header_latency_s * 1e3:+g} ms late"
        )
    newest = max(exposure.calibrated, key=lambda each: each.measured_on)
    others = len(exposure.calibrated) - 1
    more = f" (and {others} other mode{'s' if others > 1 else ''})" if others else ""
    return f"shutter at {newest.mode_words}: {timing_words(newest, today)}{more}"
