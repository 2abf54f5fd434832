"""What a frame's header states besides its time: read-out, temperature, scale and pointing."""

import re
from collections.abc import Mapping
from typing import Any

from rsoconsole.instruments.frames.exposure_time import exposure_time
from rsoconsole.instruments.frames.header_cards import (
    DEGREES,
    MICROMETRES,
    MILLIMETRES,
    Cards,
    card_text,
    written_number,
)
from rsoconsole.records import CameraMode
from rsoconsole.sky import parse_dec_deg, parse_ra_deg

NOTES_KEY = "NOTES"
"""Key in a frame's header for notes on reading it, a tuple of sentences."""

EXTENSION_KEY = "EXTENSION"
"""Key in a frame's header for the label of its image; absent for a file with one image."""
ABSOLUTE_ZERO_C = -273.15
POSSIBLE_ARCSEC_PX = (0.01, 3600.0)
"""Possible plate scales, arcsec/px; a scale beyond them is an error of the header."""
_METRES_BELOW = 15.0
"""Focal length, mm, below which the number is in metres."""
_PIXEL_UNITS = ((2e-4, "m"), (0.2, "mm"))
"""Sizes of a pixel, um, below which the number is in a larger unit."""
_SUMMED = re.compile(r"\s*([1-9][0-9]?)[\s,x]+([1-9][0-9]?)\s*")
_HOURS = {**dict.fromkeys(("h", "hr", "hour", "hours", "hourangle"), 15.0), **DEGREES}
POSITION_KEYS = (("RA", "DEC"), ("OBJCTRA", "OBJCTDEC"))
"""Keys of the pointing, the most trusted first."""


def header_notes(header: Mapping[str, Any]) -> tuple[str, ...]:
    """Return a sentence for each value of the header that the program reads and cannot use."""
    cards = Cards(header)
    for words in exposure_time(header).notes:
        cards.note(words)
    _read_out(cards)
    _sensor_temperature_c(cards)
    stated = _stated_scale(cards)
    impossible = impossible_scale_note(header)
    if stated is not None and impossible is not None:
        cards.note(impossible)
    _pointing_deg(cards)
    return tuple(cards.notes)


def camera_mode(header: Mapping[str, Any]) -> CameraMode:
    """Return how the frame was read out, and the source of its time."""
    binning, x0_px, y0_px, gain = _read_out(Cards(header))
    return CameraMode(
        binning=binning,
        x0_px=x0_px,
        y0_px=y0_px,
        gain=gain,
        time_by=exposure_time(header).time_by,
    )


def _read_out(cards: Cards) -> tuple[str | None, int | None, int | None, float | None]:
    """Binning, first column and row, and gain."""
    binned = _binning(cards)
    x0_px, y0_px = (
        cards.number(key, "a column or row of the sensor", 0.0, 1e6)
        for key in ("XORGSUBF", "YORGSUBF")
    )
    return (
        None if binned is None else f"{binned[0]}x{binned[1]}",
        None if x0_px is None else int(x0_px),
        None if y0_px is None else int(y0_px),
        cards.number("GAIN", "a gain"),
    )


def binning(header: Mapping[str, Any]) -> int | None:
    """Return the binning across columns as the header states it; None without it."""
    found = _binning(Cards(header))
    return None if found is None else found[0]


def _binning(cards: Cards) -> tuple[int, int] | None:
    """Binning across columns and rows; CCDSUM, as '2 2', is that of NOAO and Gemini."""
    what = "a binning of 1 to 99"
    stated = [cards.number(key, what, 1.0, 99.99) for key in ("XBINNING", "YBINNING")]
    whole = [int(each) for each in stated if each is not None]
    if whole:
        return whole[0], whole[-1]
    value = cards.value("CCDSUM")
    found = None if value is None else _SUMMED.fullmatch(card_text(value))
    if value is not None and found is None:
        cards.not_used("CCDSUM", f"it is not {what} for columns and rows")
    return None if found is None else (int(found[1]), int(found[2]))


def sensor_temperature_c(header: Mapping[str, Any]) -> float | None:
    """Return the temperature of the sensor, degrees Celsius; None where not stated."""
    return _sensor_temperature_c(Cards(header))


def _sensor_temperature_c(cards: Cards) -> float | None:
    for key in ("CCD-TEMP", "DET-TEMP", "CCDTEMP", "SET-TEMP"):
        value = cards.number(key, "a temperature in degrees Celsius", ABSOLUTE_ZERO_C + 1e-6, 99.99)
        if value is not None:
            return value
    return None


def plate_scale_arcsec_px(header: Mapping[str, Any]) -> float | None:
    """Return the plate scale in arcsec/px, from focal length (mm) and pixel size (um).

    XPIXSZ is the size after binning, by the FITS convention of MaxIm DL and INDI. None where the
    header lacks a value, or gives an impossible scale (``impossible_scale_note``).
    """
    stated = _stated_scale(Cards(header))
    if stated is None or not POSSIBLE_ARCSEC_PX[0] <= stated <= POSSIBLE_ARCSEC_PX[1]:
        return None
    return stated


def impossible_scale_note(header: Mapping[str, Any]) -> str | None:
    """Return a note on an impossible plate scale; None where it is possible or not stated."""
    cards = Cards(header)
    stated, focal_mm, pixel = _stated_scale(cards), _focal_length_mm(cards), _pixel_size(cards)
    if stated is None or focal_mm is None or pixel is None:
        return None
    if plate_scale_arcsec_px(header) is not None:
        return None
    key, pixel_um = pixel
    remedy = "set the telescope's focal length, in mm, in the camera's driver"
    if focal_mm < _METRES_BELOW:
        remedy = "FOCALLEN looks like metres, mm are wanted"
    else:
        unit = next((unit for below, unit in _PIXEL_UNITS if pixel_um < below), None)
        remedy = remedy if unit is None else f"{key} looks like {unit}, um are wanted"
    return (
        f"FOCALLEN {focal_mm:g} mm and {key} {pixel_um:g} um would be {stated:.4g} arcsec/px: not"
        f" used; {remedy}"
    )


def focal_length_mm(header: Mapping[str, Any]) -> float | None:
    """Return the focal length, mm; None where it is not stated."""
    return _focal_length_mm(Cards(header))


def _focal_length_mm(cards: Cards) -> float | None:
    if cards.value("FOCALLEN") == 0:  # what drivers write where none is set
        return None
    return cards.number("FOCALLEN", "a focal length in mm", 1e-6, 1e9, units=MILLIMETRES)


def pixel_size(header: Mapping[str, Any]) -> tuple[str, float] | None:
    """Return the size of a pixel as the header states it, um, and its key; None without one."""
    return _pixel_size(Cards(header))


def header_number(header: Mapping[str, Any], key: str) -> float | None:
    """Return the number in a card; None where there is none."""
    return Cards(header).number(key, "a number")


def _stated_scale(cards: Cards) -> float | None:
    focal_mm = _focal_length_mm(cards)
    pixel = _pixel_size(cards)
    if focal_mm is None or pixel is None:
        return None
    key, pixel_um = pixel
    binned = None if key == "XPIXSZ" else _binning(cards)
    return 206.264806 * pixel_um * (1 if binned is None else binned[0]) / focal_mm


def _pixel_size(cards: Cards) -> tuple[str, float] | None:
    for key in ("XPIXSZ", "PIXSIZE1"):
        if cards.value(key) == 0:
            continue
        pixel_um = cards.number(key, "the size of a pixel in um", 1e-6, 1e9, units=MICROMETRES)
        if pixel_um is not None:
            return key, pixel_um
    return None


def pointing_deg(header: Mapping[str, Any]) -> tuple[float | None, float | None]:
    """Return the pointing (RA, Dec) in degrees: from RA/DEC, else from OBJCTRA/OBJCTDEC.

    A number is in degrees; a sexagesimal RA is in hours. (None, None) when one is missing or
    impossible.
    """
    return _pointing_deg(Cards(header))


def position_of(header: Mapping[str, Any], keys: tuple[str, str]) -> tuple[float, float] | None:
    """Return the position (RA, Dec), degrees, in a pair of ``POSITION_KEYS``; None without one."""
    ra_deg, dec_deg = (_angle_deg(Cards(header), key, "") for key in keys)
    return None if ra_deg is None or dec_deg is None else (ra_deg % 360.0, dec_deg)


def _pointing_deg(cards: Cards) -> tuple[float | None, float | None]:
    for ra_key, dec_key in POSITION_KEYS:
        ra_deg = _angle_deg(cards, ra_key, "a right ascension of 0 to 360 deg or 0 to 24 h")
        dec_deg = _angle_deg(cards, dec_key, "a declination of -90 to 90 deg")
        if ra_deg is not None and dec_deg is not None:
            return ra_deg % 360.0, dec_deg
        for key, angle_deg, other in ((ra_key, ra_deg, dec_key), (dec_key, dec_deg, ra_key)):
            if angle_deg is not None and cards.value(other) is None:
                cards.not_used(key, f"there is no {other}")
    return None, None


def _angle_deg(cards: Cards, key: str, what: str) -> float | None:
    """Degrees from a number (already degrees) or from sexagesimal text in units of its own."""
    value = cards.value(key)
    if value is None:
        return None
    is_ra = key.endswith("RA")
    units = _HOURS if is_ra else DEGREES
    if written_number(value, units) is not None:
        low, high = (0.0, 360.0) if is_ra else (-90.0, 90.0)
        return cards.number(key, what, low, high, units=units)
    try:
        if not isinstance(value, str):
            raise ValueError(key)
        # Decimal commas: no angle has thousands.
        text = value.replace(",", ".")
        return parse_ra_deg(text) if is_ra else parse_dec_deg(text)
    except ValueError:
        cards.not_used(key, f"it is not {what}")
        return None
