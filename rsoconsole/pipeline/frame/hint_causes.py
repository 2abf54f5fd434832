"""Why a header's scale or position is not that of the stars, and what it should have been.

Each cause is a number that a program is known to write in another form: a pixel's size before
binning, a focal length in cm, a right ascension in hours. It is named where it explains the solved
plate, and the hint that it makes is tried where the header's own fails.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

from rsoconsole.instruments import (
    POSITION_KEYS,
    binning,
    focal_length_mm,
    header_number,
    pixel_size,
    position_of,
)
from rsoconsole.records import Frame, Solution
from rsoconsole.sky import separation_deg
from rsoconsole.words import ALIGN

_SAME_SHARE = 0.03
"""Tolerance of a ratio of scales: focal lengths are rounded, and change with focus and heat."""
_FOCAL_UNITS = ((10.0, "cm"), (1000.0, "m"), (25.4, "inches"))
_GLASS = (0.5, 0.63, 0.67, 0.7, 0.72, 0.75, 0.79, 0.8, 1.4, 1.5, 1.6, 2.0, 2.5, 3.0, 4.0, 5.0)
"""Factors of focal reducers and extenders on the market."""
_MAX_BINNING = 8


def likely_scale_factors(frame: Frame) -> tuple[float, ...]:
    """Return factors by which the header's scale is wrong where its pixel size is misread."""
    binned = _binned(frame)
    return () if binned is None else (float(binned), 1.0 / binned)


def scale_remedy(frame: Frame, ratio: float, setting: str) -> str:
    """Return the likely cause of a wrong scale and its remedy; empty where none can be given.

    ``ratio``: scale by the stars over the header's. ``setting``: where the focal length is set.
    """
    focal_mm = focal_length_mm(frame.header)
    pixel = pixel_size(frame.header)
    if focal_mm is None or pixel is None:
        return "" if focal_mm is None else _focal_length_remedy(frame, focal_mm, ratio, setting)
    return _pixel_remedy(
        frame, pixel, ratio, f"FOCALLEN {focal_mm:g} mm is right"
    ) or _focal_length_remedy(frame, focal_mm, ratio, setting)


def _pixel_remedy(frame: Frame, pixel: tuple[str, float], ratio: float, kept: str) -> str:
    """Cause in the size of a pixel; empty where it is not that."""
    key, pixel_um = pixel
    binned = _binned(frame)
    if binned is not None and _is_same(ratio, binned):
        return (
            f"{key} {pixel_um:g} um is the size before binning by {binned}: after it it is"
            f" {pixel_um * binned:g} um, which the program that takes the frames"
            f" should write; {kept}"
        )
    if binned is not None and _is_same(ratio, 1.0 / binned):
        return (
            f"{key} {pixel_um:g} um has the binning by {binned} in it once too often, or the"
            f" frame is not binned and XBINNING is wrong; {kept}"
        )
    if _is_same(ratio, 1000.0):
        return f"{key} {pixel_um:g} is in mm, um are wanted; {kept}"
    return ""


def _focal_length_remedy(frame: Frame, focal_mm: float, ratio: float, setting: str) -> str:
    """Cause in the focal length."""
    true_mm = focal_mm / ratio
    for factor, unit in _FOCAL_UNITS:
        if _is_same(ratio, 1.0 / factor):
            return (
                f"FOCALLEN {focal_mm:g} is in {unit}: it should be {true_mm:.4g} mm, in {setting}"
            )
    aperture_mm = header_number(frame.header, "APTDIA")
    if aperture_mm is not None and _is_same(focal_mm, aperture_mm):
        return (
            f"FOCALLEN {focal_mm:g} mm is the aperture (APTDIA): it should be {true_mm:.4g}, in"
            f" {setting}"
        )
    words = f"FOCALLEN says {focal_mm:g} mm, it should be {true_mm:.4g}: set it in {setting}"
    pixel, stated = pixel_size(frame.header), binning(frame.header)
    # PIXSIZE1 is multiplied by the binning already.
    counted = stated or 1 if pixel is not None and pixel[0] != "XPIXSZ" else 1
    whole = round(ratio * counted)
    if round(ratio) >= 2 and whole <= _MAX_BINNING and _is_same(ratio * counted, whole):
        key = "XBINNING" if "XBINNING" in frame.header else "CCDSUM"
        says = "which no XBINNING says" if stated is None else f"although {key} says {stated}"
        return (
            f"either the frame is binned by {whole}, {says}, and the pixel's size"
            f" is that before it; or {words}"
        )
    glass = next((each for each in _GLASS if _is_same(1.0 / ratio, each)), None)
    if glass is not None:
        kind = "reducer" if glass < 1.0 else "extender"
        words += f" (as by a {glass:g}x {kind} that is not counted in it)"
    return words


def _binned(frame: Frame) -> int | None:
    """Binning of the frame by its header; None where it is not binned, or nothing is stated."""
    stated = binning(frame.header)
    return stated if stated is not None and stated >= 2 else None


def _is_same(one: float, other: float) -> bool:
    return abs(one / other - 1.0) <= _SAME_SHARE


@dataclass(frozen=True, slots=True, kw_only=True)
class PositionCause:
    """A way in which a header's position may be wrong, and the position that it then means."""

    ra_icrs_deg: float
    dec_icrs_deg: float
    words: str
    is_frequent: bool
    """True where it is worth a search of its own before the whole sky is searched."""


def position_causes(frame: Frame) -> Iterator[PositionCause]:
    """Yield the ways in which a header's position may be wrong, the most frequent first."""
    ra_deg, dec_deg = frame.pointing_ra_icrs_deg, frame.pointing_dec_icrs_deg
    if ra_deg is None or dec_deg is None:
        return
    stated = [(pair, found) for pair in POSITION_KEYS if (found := position_of(frame.header, pair))]
    if not stated:
        return
    ra_key, dec_key = stated[0][0]
    is_number = header_number(frame.header, ra_key) is not None

    def cause(
        ra_deg: float, dec_deg: float, words: str, *, is_frequent: bool = False
    ) -> PositionCause:
        return PositionCause(
            ra_icrs_deg=ra_deg % 360.0, dec_icrs_deg=dec_deg, words=words, is_frequent=is_frequent
        )

    for names, other in stated[1:]:
        yield cause(
            *other,
            f"{names[0]} and {names[1]} are right, {ra_key} and {dec_key} are not",
            is_frequent=True,
        )
    if is_number and ra_deg <= 24.0:
        yield cause(
            15.0 * ra_deg,
            dec_deg,
            f"{ra_key} is in hours, a number there is in degrees: {15.0 * ra_deg:.3f} is right, or"
            " text as hh mm ss",
            is_frequent=True,
        )
    elif not is_number:
        yield cause(
            ra_deg / 15.0, dec_deg, f"{ra_key} is in degrees, text there is in hours: hh mm ss"
        )
    yield cause(ra_deg, -dec_deg, f"{dec_key} has the wrong sign")
    if ra_deg <= 90.0 or ra_deg >= 270.0:
        swapped_dec_deg = (ra_deg + 180.0) % 360.0 - 180.0
        yield cause(dec_deg, swapped_dec_deg, f"{ra_key} and {dec_key} are exchanged")
    if is_number and ra_deg <= 2.0 * math.pi and abs(dec_deg) <= math.pi / 2.0:
        yield cause(
            math.degrees(ra_deg),
            math.degrees(dec_deg),
            f"{ra_key} and {dec_key} are in radians: degrees are right",
        )


def position_remedy(frame: Frame, solution: Solution, radius_deg: float) -> str:
    """Return the likely cause of a wrong position and its remedy."""
    ra_deg, dec_deg = frame.pointing_ra_icrs_deg, frame.pointing_dec_icrs_deg
    if ra_deg == 0.0 and dec_deg == 0.0:
        return (
            "0, 0 is what is written where no mount is connected: connect it to the program that"
            " takes the frames, or have it leave the position out"
        )
    for each in position_causes(frame):
        away_deg = separation_deg(
            each.ra_icrs_deg, each.dec_icrs_deg, solution.ra_icrs_deg, solution.dec_icrs_deg
        )
        if away_deg <= radius_deg:
            return each.words
    if dec_deg is not None and abs(dec_deg) == 90.0:
        return f"the pole is where a mount believes itself that was never aligned: {ALIGN}"
    return ALIGN
