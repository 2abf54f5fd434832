"""Output of calibrate-time: its result as JSON, and as lines for people."""

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from rsoconsole.cli.words import output
from rsoconsole.orbits import MIN_MEASUREMENTS, SYSTEMS, Estimate, ShutterTiming
from rsoconsole.pipeline import CalibrationMode, FoundSatellite, FoundTiming
from rsoconsole.words import camera_mode_words, count_words

_SOURCES = {
    "broadcast": "broadcast ephemerides (2 m)",
    "sp3": "precise orbits",
    "tle": "ELEMENTS, GOOD TO A KILOMETRE (0.3 s)",
}


def timing_report(found: FoundTiming, written: Path | None) -> dict[str, Any]:
    """The result as a JSON object: nights, satellites, each camera mode with its timing.

    ``written``: the configuration file to which it was written, or None.
    """
    calibration = found.calibration
    modes = [_mode_report(mode, timing) for mode, timing in found.modes]
    measured = [each for each in modes if "measurements" in each]
    of_nights = zip(found.nights, calibration.drift_arcsec, calibration.is_separated, strict=True)
    return {
        "kind": found.kind,
        "is_sanity_check": found.kind == "tle",
        "measured_on": found.measured_on,
        "of_most_streaks": max(measured, key=lambda each: each["measurements"], default=None),
        "modes": modes,
        "nights": [
            {**output.with_unit_keys(night), "drift_arcsec": drift, "is_separated": is_separated}
            for night, drift, is_separated in of_nights
        ],
        "satellites": found.satellites,
        "place_arcsec": calibration.place_arcsec,
        "error_scale": calibration.error_scale,
        "rejected": calibration.is_used.count(False),
        "skipped": found.skipped,
        "cautions": list(cautions(found)),
        "written": written,
    }


def _mode_report(mode: CalibrationMode, timing: ShutterTiming | None) -> dict[str, Any]:
    names = ("binning", "width", "height", "x0_px", "y0_px", "gain", "time_by")
    read_out = dict(zip(names, mode.read_out, strict=True))
    known = {"bias_s": None} if timing is None else output.with_unit_keys(timing)
    return {"mode": _mode(mode), "exposure_s": mode.exposure_s, **read_out, **known}


def timing_lines(found: FoundTiming) -> Iterator[str]:
    """Lines on the result for people, at most 80 columns wide."""
    streaks = sum(each.streaks for each in found.nights)
    nights = count_words(len(found.nights), "night")
    yield f"{streaks} streaks of {_satellites_words(found.satellites)}, {nights}"
    yield f"by {_SOURCES[found.kind]}"
    for reason, times in sorted(found.skipped.items()):
        yield f"  not used of the files: {reason} ({times})"
    for mode, timing in found.modes:
        yield ""
        yield _mode(mode)
        yield from _mode_lines(timing)
    yield ""
    for night, drift in zip(found.nights, found.calibration.drift_arcsec, strict=True):
        east, north = drift
        yield f"{night.name}: {night.streaks} of {night.candidates} streaks"
        yield f"  star catalogue off {_arcsec(east)} east, {_arcsec(north)} north"
        if night.clock_offset_s is not None:
            yield (
                f"  the machine's clock was {night.clock_offset_s * 1e3:+.1f} ms off by its time"
                " source; it is in the bias"
            )
    yield ""
    yield "satellite        streaks     rate  towards"
    for each in found.satellites:
        number = f"{each.norad_id}" if each.norad_id is not None else ""
        yield (
            f"{each.name[:16]:16} {each.streaks:7} {each.rate_arcsec_s:6.1f}″/s"
            f" {each.position_angle_deg:6.0f}°  {number} {each.norad_name[:24]}".rstrip()
        )


def _mode_lines(timing: ShutterTiming | None) -> Iterator[str]:
    if timing is None:
        yield f"  too few of its streaks: {MIN_MEASUREMENTS} are needed"
        return
    yield f"  bias      {_ms(timing.bias_s)}  true mid-exposure of row 0 minus the header's"
    yield f"  scatter   {_ms(timing.scatter_s, sign='')}  from frame to frame"
    line = timing.line_time_s
    if timing.is_line_time_found:
        value = f"{line.value * 1e6:+8.2f} ± {line.sigma * 1e6:.2f} µs"
        yield f"  line time {value}  each row after the row above"
    else:
        yield f"  line time not found: {line.value * 1e6:g} µs as configured"
    middle = f"  in row {timing.middle_row_px:.0f}"
    yield f"{middle:11} {_ms(timing.bias_at_middle_s)}  where the streaks lie"
    yield (
        f"  {timing.measurements} streaks in {timing.frames} frames, {timing.tracks} tracks;"
        f" {timing.rejected} left out"
    )


def cautions(found: FoundTiming) -> Iterator[str]:
    """Sentences of caution about the result, each with its remedy."""
    if found.kind == "tle":
        yield (
            "elements are good to a kilometre, which is 0.3 s: a sanity check of the clock, not a"
            " calibration; give --rinex of the night, or --sp3 afterwards"
        )
    for night, is_apart in zip(found.nights, found.calibration.is_separated, strict=True):
        if not is_apart and night.streaks:
            yield (
                f"{night.name}: all satellites go much the same way: time and what the star"
                " catalogue is off cannot be told apart, and the errors say so; add satellites that"
                " go across"
            )
    for mode, timing in found.modes:
        if timing is None:
            continue
        if not timing.is_line_time_found:
            yield (
                f"{_mode(mode)}: the streaks lie in rows too much alike for the line time; let"
                " satellites cross high and low in the frame"
            )
        if timing.night_spread_s:
            yield (
                f"{_mode(mode)}: the nights differ by {timing.night_spread_s * 1e3:.1f} ms,"
                " more than their errors explain; it is in the bias's error: look at the clocks"
            )
        if timing.tracks < _FEW:
            yield f"{_mode(mode)}: {timing.tracks} tracks are few: give {_FEW} or more"


_FEW = 4


def _mode(mode: CalibrationMode) -> str:
    return camera_mode_words((mode.exposure_s, *mode.read_out), "other exposures")


def _satellites_words(satellites: Sequence[FoundSatellite]) -> str:
    systems: dict[str, int] = {}
    for each in satellites:
        system = SYSTEMS.get(each.name[:1], "") if each.name[1:].isdigit() else ""
        systems[system] = systems.get(system, 0) + 1
    named = ", ".join(f"{count} {system}" for system, count in sorted(systems.items()) if system)
    return count_words(len(satellites), "satellite") + (f" ({named})" if named else "")


def _ms(value: Estimate, *, sign: str = "+") -> str:
    return f"{value.value * 1e3:{sign}8.1f} ± {value.sigma * 1e3:.1f} ms"


def _arcsec(value: Estimate) -> str:
    decimals = 2 if value.sigma < 1.0 and not math.isnan(value.sigma) else 0
    return f"{value.value:+.{decimals}f} ± {value.sigma:.{decimals}f}″"
