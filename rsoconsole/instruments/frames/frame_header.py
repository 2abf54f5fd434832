"""Reads start, exposure time, scale and pointing from a frame's header, in the program's units."""

import math
import re
from collections.abc import Mapping
from typing import Any

from rsoconsole.records import CameraMode
from rsoconsole.sky import iso_to_utc_ns
from rsoconsole.words import NS_PER_S

LOCKED = 3
_FARTHEST_S = 900.0
"""Largest difference of the receiver's time from DATE-OBS that is believed, s."""
_SAME_SHARE, _SAME_S = 0.05, 0.01
"""Largest differences of the receiver's exposure time from the header's, as share and seconds."""


def gps_time(
    header: Mapping[str, Any], header_start_utc_ns: int | None, exposure_s: float | None
) -> tuple[int | None, str | None]:
    """Return the start of the exposure by the camera's GPS receiver, and why it is not used.

    (start in UTC ns, None), or (None, reason); (None, None) where the header has no receiver. The
    start is chosen so that the middle of the exposure is the middle that the receiver states.
    """
    start_ns = _instant(header, "GPS_SUTC", "GPS_ST", "GPS_SU")
    if start_ns is None:
        return None, None
    for key in ("GPS_SFLG", "GPS_EFLG"):
        flag = header.get(key)
        if isinstance(flag, int) and (flag >> 4 if flag > 15 else flag) != LOCKED:
            return _not_used(f"its receiver was not locked ({key} is {flag})")
    if header_start_utc_ns is not None:
        off_s = (start_ns - header_start_utc_ns) / NS_PER_S
        if abs(off_s) > _FARTHEST_S:
            return _not_used(f"it is {off_s:.0f} s from DATE-OBS")
    end_ns = _instant(header, "GPS_EUTC", "GPS_ET", "GPS_EU")
    if end_ns is None or exposure_s is None:
        return start_ns, None
    open_s = (end_ns - start_ns) / NS_PER_S
    if abs(open_s - exposure_s) > max(_SAME_SHARE * exposure_s, _SAME_S):
        return _not_used(f"its shutter was open for {open_s:.3f} s, by EXPTIME {exposure_s:g} s")
    return (start_ns + end_ns - round(exposure_s * NS_PER_S)) // 2, None


def _not_used(why: str) -> tuple[None, str]:
    return None, f"the time by the camera's GPS is not used, DATE-OBS is: {why}"


def _instant(header: Mapping[str, Any], whole: str, second: str, micro: str) -> int | None:
    """Instant in one of the two notations."""
    stated = header.get(whole)
    if isinstance(stated, str):
        return _iso(stated)
    stated, microseconds = header.get(second), header.get(micro)
    if not isinstance(stated, str):
        return None
    if isinstance(microseconds, bool) or not isinstance(microseconds, int | float):
        return _iso(stated)
    if not 0.0 <= microseconds < 1e6:
        return None
    # The text is cut to milliseconds, or has none at all.
    seconds = _iso(re.sub(r"\.\d*", "", stated))
    return None if seconds is None else seconds + round(float(microseconds) * 1000.0)


def _iso(text: str) -> int | None:
    try:
        return iso_to_utc_ns(text.strip())
    except ValueError:
        return None


NOTES_KEY = "NOTES"
"""Key in a frame's header for notes on reading it, a tuple of sentences."""

EXTENSION_KEY = "EXTENSION"
"""Key in a frame's header for the label of its image; absent for a file with one image."""
ABSOLUTE_ZERO_C = -273.15
POSSIBLE_ARCSEC_PX = (0.01, 3600.0)
"""Possible plate scales, arcsec/px; a scale beyond them is an error of the header."""


def exposure_start(header: Mapping[str, Any]) -> tuple[int | None, str | None]:
    """Return the start of the exposure (UTC ns), and a reason or None.

    By the camera's GPS receiver, where it has one that was locked; else by DATE-OBS; else by
    DATE-BEG or DATE-AVG. The reason says why the start is None, or why the receiver's time is not
    used.
    """
    stated_ns, note = header_start(header)
    gps_ns, why_not = gps_time(header, stated_ns, exposure_s(header))
    return (stated_ns, note or why_not) if gps_ns is None else (gps_ns, None)


def camera_mode(header: Mapping[str, Any]) -> CameraMode:
    """Return how the frame was read out, and the source of its time."""
    gps_ns, _ = gps_time(header, header_start(header)[0], exposure_s(header))
    binned = [_number(header.get(key)) for key in ("XBINNING", "YBINNING")]
    whole = [int(each) for each in binned if each is not None and 1.0 <= each < 100.0]
    corner = [_number(header.get(key)) for key in ("XORGSUBF", "YORGSUBF")]
    x0, y0 = (int(each) if each is not None and each >= 0.0 else None for each in corner)
    return CameraMode(
        binning=f"{whole[0]}x{whole[-1]}" if whole else None,
        x0_px=x0,
        y0_px=y0,
        gain=_number(header.get("GAIN")),
        time_by="header" if gps_ns is None else "gps",
    )


def header_start(header: Mapping[str, Any]) -> tuple[int | None, str | None]:
    """Return the exposure's start as ``exposure_start`` does, but without the GPS receiver."""
    stated = header.get("DATE-OBS")
    if not isinstance(stated, str) or not stated.strip():
        return _standard_start(header)
    system = str(header.get("TIMESYS", "UTC")).strip().upper()
    if system not in ("UTC", ""):
        return None, f"TIMESYS is {system}, not UTC: the time of exposure is not used"
    iso = stated.strip()
    time_of_day = header.get("TIME-OBS") or header.get("UT")
    if "T" not in iso and isinstance(time_of_day, str):
        iso = f"{iso}T{time_of_day.strip()}"
    if "T" not in iso:
        return None, f"DATE-OBS '{stated}' names no time of day"
    try:
        return iso_to_utc_ns(iso), None
    except ValueError:
        return None, f"DATE-OBS '{stated}' is not ISO 8601: the time of exposure is not known"


def _standard_start(header: Mapping[str, Any]) -> tuple[int | None, str | None]:
    """Return the start of the exposure by the FITS standard's DATE-BEG, else DATE-AVG.

    (None, None) where neither is stated.
    """
    system = str(header.get("TIMESYS", "UTC")).strip().upper()
    length_s = exposure_s(header)
    for key, earlier_s in (("DATE-BEG", 0.0), ("DATE-AVG", length_s and length_s / 2.0)):
        stated = header.get(key)
        if not isinstance(stated, str) or earlier_s is None:
            continue
        if system not in ("UTC", ""):
            return None, f"TIMESYS is {system}, not UTC: the time of exposure is not used"
        try:
            return iso_to_utc_ns(stated.strip()) - round(earlier_s * NS_PER_S), None
        except ValueError:
            continue
    return None, None


def exposure_s(header: Mapping[str, Any]) -> float | None:
    """Return the exposure time from EXPTIME or EXPOSURE, s; None where neither is valid."""
    for key in ("EXPTIME", "EXPOSURE"):
        value = _number(header.get(key))
        if value is not None and value > 0:
            return value
    return None


def sensor_temperature_c(header: Mapping[str, Any]) -> float | None:
    """Return the temperature of the sensor, degrees Celsius; None where not stated."""
    for key in ("CCD-TEMP", "DET-TEMP", "CCDTEMP", "SET-TEMP"):
        value = _number(header.get(key))
        if value is not None and ABSOLUTE_ZERO_C < value < 100.0:
            return value
    return None


def plate_scale_arcsec_px(header: Mapping[str, Any]) -> float | None:
    """Return the plate scale in arcsec/px, from focal length (mm) and pixel size (um).

    XPIXSZ is the size after binning, by the FITS convention of MaxIm DL and INDI. None where the
    header lacks a value, or gives an impossible scale (``impossible_scale_note``).
    """
    stated = _stated_scale(header)
    if stated is None or not POSSIBLE_ARCSEC_PX[0] <= stated <= POSSIBLE_ARCSEC_PX[1]:
        return None
    return stated


def impossible_scale_note(header: Mapping[str, Any]) -> str | None:
    """Return a note on an impossible plate scale; None where it is possible or not stated."""
    stated = _stated_scale(header)
    if stated is None or plate_scale_arcsec_px(header) is not None:
        return None
    return (
        f"FOCALLEN {header['FOCALLEN']} mm would be {stated:.4g} arcsec/px: it is not used; set"
        " the telescope's focal length in the camera's driver"
    )


def _stated_scale(header: Mapping[str, Any]) -> float | None:
    focal_length_mm = _number(header.get("FOCALLEN"))
    pixel_um = _number(header.get("XPIXSZ"))
    if pixel_um is None:
        pixel_um = _number(header.get("PIXSIZE1"))
        binning = _number(header.get("XBINNING")) or 1.0
        pixel_um = None if pixel_um is None else pixel_um * binning
    if not focal_length_mm or not pixel_um or focal_length_mm <= 0 or pixel_um <= 0:
        return None
    return 206.264806 * pixel_um / focal_length_mm


def pointing_deg(header: Mapping[str, Any]) -> tuple[float | None, float | None]:
    """Return the pointing (RA, Dec) in degrees: from RA/DEC, else from OBJCTRA/OBJCTDEC.

    A number is in degrees; a sexagesimal RA is in hours. (None, None) when one is missing or
    impossible.
    """
    for ra_key, dec_key in (("RA", "DEC"), ("OBJCTRA", "OBJCTDEC")):
        ra_deg = _angle_deg(header.get(ra_key), 15.0)
        dec_deg = _angle_deg(header.get(dec_key), 1.0)
        if ra_deg is None or dec_deg is None:
            continue
        if 0.0 <= ra_deg <= 360.0 and -90.0 <= dec_deg <= 90.0:
            return ra_deg % 360.0, dec_deg
    return None, None


def _number(value: Any) -> float | None:
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    try:
        number = float(value)
    except ValueError:
        return None
    return number if math.isfinite(number) else None


def _angle_deg(value: Any, deg_per_unit: float) -> float | None:
    """Degrees from a number (already degrees) or from sexagesimal text in units of its own."""
    number = _number(value)
    if number is not None:
        return number
    if not isinstance(value, str):
        return None
    parts = value.replace(":", " ").split()
    if not 2 <= len(parts) <= 3:
        return None
    try:
        whole, *rest = (float(part) for part in parts)
    except ValueError:
        return None
    size = abs(whole) + sum(part / 60.0 ** (i + 1) for i, part in enumerate(rest))
    return math.copysign(size, -1.0 if parts[0].startswith("-") else 1.0) * deg_per_unit
