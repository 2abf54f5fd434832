"""What a frame's header states besides its time: read-out, temperature, scale and pointing."""

from collections.abc import Mapping
from typing import Any

from rsoconsole.instruments.frames.exposure_time import exposure_time
from rsoconsole.instruments.frames.header_cards import (
    MICROMETRES,
    MILLIMETRES,
    Cards,
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
_METRES_BELOW, _MILLIMETRES_BELOW = 15.0, 0.2
"""Focal length, mm, and size of a pixel, um, below which the number is in a larger unit."""
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
    binned = [_binning(cards, key) for key in ("XBINNING", "YBINNING")]
    whole = [each for each in binned if each is not None]
    x0_px, y0_px = (
        cards.number(key, "a column or row of the sensor", 0.0, 1e6)
        for key in ("XORGSUBF", "YORGSUBF")
    )
    return (
        f"{whole[0]}x{whole[-1]}" if whole else None,
        None if x0_px is None else int(x0_px),
        None if y0_px is None else int(y0_px),
        cards.number("GAIN", "a gain"),
    )


def _binning(cards: Cards, key: str) -> int | None:
    found = cards.number(key, "a binning of 1 to 99", 1.0, 99.99)
    return None if found is None else int(found)


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
    elif pixel_um < _MILLIMETRES_BELOW:
        remedy = f"{key} looks like mm, um are wanted"
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
    binning = 1 if key == "XPIXSZ" else _binning(cards, "XBINNING") or 1
    return 206.264806 * pixel_um * binning / focal_mm


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
    number = written_number(value)
    if number is not None:
        low, high = (0.0, 360.0) if is_ra else (-90.0, 90.0)
        return cards.number(key, what, low, high)
    try:
        if not isinstance(value, str):
            raise ValueError(key)
        # Decimal commas: no angle has thousands.
        text = value.replace(",", ".")
        return parse_ra_deg(text) if is_ra else parse_dec_deg(text)
    except ValueError:
        cards.not_used(key, f"it is not {what}")
        return None
