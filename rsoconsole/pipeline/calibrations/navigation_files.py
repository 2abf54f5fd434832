"""Files with the orbits of navigation satellites, and their catalogue numbers."""

import gzip
import math
import zlib
from collections.abc import Sequence
from dataclasses import replace
from operator import gt
from pathlib import Path

import numpy as np

from rsoconsole.base import MAX_DATA_BYTES, OrbitError, read_foreign_text
from rsoconsole.config import CalibratedTiming, ExposureConfig
from rsoconsole.orbits import (
    CatalogueEntry,
    NavigationFile,
    NavigationSatellite,
    Satellite,
    ShutterTiming,
    nearest_epoch_entries,
    parse_rinex_nav,
    parse_sp3,
    states_gcrs,
)
from rsoconsole.pipeline.calibrations.time_calibration import (
    CalibrationMode,
    FoundSatellite,
    FoundTiming,
)
from rsoconsole.words import NS_PER_DAY

_READ_OUT = ("binning", "width_px", "height_px", "x0_px", "y0_px", "gain", "time_by")
"""Fields of ``CalibratedTiming.read_out``, in its order."""
_GZIP = b"\x1f\x8b"
_REVOLUTIONS_A_DAY = (1.6, 2.4)
_MAX_E = 0.1
"""Largest eccentricity; with the revolutions a day it selects navigation satellites."""
_SAME_KM = 100.0
"""Largest distance of one satellite by two sources, km; two satellites are thousands apart."""
_DAYS = 30.0


def read_rinex(files: Sequence[Path]) -> NavigationFile:
    """Read broadcast ephemerides, plain or gzipped. Raises OrbitError with a one-line message."""
    return parse_rinex_nav({str(path): _text(path) for path in files})


def read_sp3(files: Sequence[Path]) -> NavigationFile:
    """Read precise orbits, plain or gzipped. Raises OrbitError with a one-line message."""
    return parse_sp3({str(path): _text(path) for path in files})


def navigation_from_elements(entries: Sequence[CatalogueEntry], t_utc_ns: int) -> NavigationFile:
    """Return the navigation satellites among element sets, by the sets nearest to an instant.

    Their places are good to a kilometre. Raises OrbitError where there is no such satellite.
    """
    chosen = _medium(entries, t_utc_ns)
    if not chosen:
        raise OrbitError(
            "the element files hold no navigation satellite within"
            f" {_DAYS:g} days of the nights: give those of GPS and Galileo"
        )
    reach = round(_DAYS * NS_PER_DAY)
    return NavigationFile(
        kind="tle",
        satellites=tuple(
            NavigationSatellite(
                name=entry.name or str(entry.norad_id),
                kind="tle",
                position_gcrs=Satellite(entry).position_gcrs,
                norad_id=entry.norad_id,
            )
            for entry in chosen
        ),
        first_utc_ns=min(entry.epoch_utc_ns for entry in chosen) - reach,
        last_utc_ns=max(entry.epoch_utc_ns for entry in chosen) + reach,
        skipped={},
    )


def with_norad_ids(
    found: FoundTiming, file: NavigationFile, entries: Sequence[CatalogueEntry]
) -> FoundTiming:
    """Return a result with the catalogue numbers of its satellites, matched by position."""
    if not entries or not found.satellites:
        return found
    by_name = {each.name: each for each in file.satellites}
    candidates = _medium(entries, found.satellites[0].t_utc_ns)
    named = tuple(
        each if each.norad_id is not None else _named(each, by_name[each.name], candidates)
        for each in found.satellites
    )
    return replace(found, satellites=named)


def _named(
    seen: FoundSatellite, satellite: NavigationSatellite, entries: Sequence[CatalogueEntry]
) -> FoundSatellite:
    t = np.array([seen.t_utc_ns], np.int64)
    here, _ = satellite.position_gcrs(t)
    there, _ = states_gcrs(entries, t)
    off_km = np.nan_to_num(np.linalg.norm(there[:, 0] - here[0], axis=-1), nan=np.inf)
    if not len(off_km) or not np.min(off_km) <= _SAME_KM:
        return seen
    entry = entries[int(np.argmin(off_km))]
    return replace(seen, norad_id=entry.norad_id, norad_name=entry.name)


def _medium(entries: Sequence[CatalogueEntry], t_utc_ns: int) -> list[CatalogueEntry]:
    low, high = _REVOLUTIONS_A_DAY
    return [
        entry
        for entry in nearest_epoch_entries(entries, t_utc_ns)
        if low <= entry.revolutions_a_day <= high
        and entry.eccentricity <= _MAX_E
        and abs(entry.epoch_utc_ns - t_utc_ns) <= _DAYS * NS_PER_DAY
        and not entry.record.error
    ]


def _text(path: Path) -> str:
    try:
        # Comments in such files are in whatever encoding their station uses.
        text = read_foreign_text(path, most_bytes=MAX_DATA_BYTES, encoding="latin-1")
        if not text.startswith(_GZIP.decode("latin-1")):
            return text
        with gzip.open(path) as file:
            content = file.read(MAX_DATA_BYTES + 1)
    except FileNotFoundError as error:
        raise OrbitError(f"{path} does not exist: name a file of orbits") from error
    except (OSError, EOFError, zlib.error) as error:
        raise OrbitError(f"{path} cannot be read: {error}") from error
    if len(content) > MAX_DATA_BYTES:
        raise OrbitError(f"{path} unpacks to more than {MAX_DATA_BYTES >> 20} MB")
    return content.decode("latin-1").replace("\r\n", "\n")


def timing_settings(found: FoundTiming) -> tuple[CalibratedTiming, ...]:
    """Return the settings' entry of each calibrated camera mode; none if element sets were used."""
    if found.kind == "tle":
        return ()
    return tuple(_timing(mode, timing, found) for mode, timing in found.modes if timing is not None)


def _timing(mode: CalibrationMode, timing: ShutterTiming, found: FoundTiming) -> CalibratedTiming:
    return CalibratedTiming.model_validate(
        {
            "exposure_s": mode.exposure_s,
            **dict(zip(_READ_OUT, mode.read_out, strict=True)),
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


def merged_timings(
    exposure: ExposureConfig, timings: Sequence[CalibratedTiming]
) -> tuple[CalibratedTiming, ...]:
    """Return the settings' timings, the new ones replacing those of the same modes."""
    new = {each.camera_mode for each in timings}
    return (*(each for each in exposure.calibrated if each.camera_mode not in new), *timings)


def less_certain_timings(
    timings: Sequence[CalibratedTiming], exposure: ExposureConfig
) -> tuple[tuple[CalibratedTiming, CalibratedTiming], ...]:
    """Return (new, known) for each mode whose new timing is less certain than the known one.

    Less certain means a larger sigma of the bias, of the scatter or of the line time.
    """
    known = {each.camera_mode: each for each in exposure.calibrated}
    pairs = ((each, known[each.camera_mode]) for each in timings if each.camera_mode in known)
    return tuple((new, old) for new, old in pairs if any(map(gt, _sigmas(new), _sigmas(old))))


def _sigmas(timing: CalibratedTiming) -> tuple[float, float, float]:
    """Return the sigmas of bias, scatter and line time; infinite where no line time was found."""
    line_us = timing.line_time_sigma_us
    return timing.bias_sigma_s, timing.scatter_sigma_s, math.inf if line_us is None else line_us
