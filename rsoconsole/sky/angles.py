"""Angles on a circle and on a sphere, and their written forms.

Degrees everywhere; hours only where an operator or INDI wants them. Functions take floats or numpy
arrays and give back the same kind.
"""

import math
import re
from typing import TypeVar, overload

import numpy as np

from rsoconsole.records import FloatArray

Angle = TypeVar("Angle", float, FloatArray)
AngleLike = float | FloatArray
_DEG = np.pi / 180.0
_NUMBER = re.compile(r"\d+(?:\.\d*)?|\.\d+", re.ASCII)
_MARKS = re.compile(r"[\s:hdms°'\"′″]+", re.IGNORECASE)


def wrap_180(angle_deg: Angle) -> Angle:
    """Wrap the angle to -180 <= angle < 180."""
    if isinstance(angle_deg, np.ndarray):
        return np.asarray(np.mod(angle_deg + 180.0, 360.0) - 180.0)
    return wrap_360(float(angle_deg) + 180.0) - 180.0


def wrap_360(angle_deg: Angle) -> Angle:
    """Wrap the angle to 0 <= angle < 360."""
    if isinstance(angle_deg, np.ndarray):
        wrapped = np.mod(angle_deg, 360.0)
        return np.where(wrapped >= 360.0, 0.0, wrapped)
    # The remainder of a tiny negative angle rounds up to 360 itself.
    wrapped_deg = float(angle_deg) % 360.0
    return 0.0 if wrapped_deg >= 360.0 else wrapped_deg


def line_angle_deg(one_deg: float, other_deg: float) -> float:
    """Angle, 0 to 90 deg, between two lines given by their direction angles in degrees.

    A direction and its opposite (180 deg further) are the same line.
    """
    return abs((one_deg - other_deg + 90.0) % 180.0 - 90.0)


def hours_to_deg(hours: Angle) -> Angle:
    """Convert hours of right ascension or hour angle to degrees; not wrapped."""
    return hours * 15.0


def deg_to_hours(angle_deg: Angle) -> Angle:
    """Convert degrees to hours; not wrapped."""
    return angle_deg / 15.0


def direction_to_unit(ra_deg: AngleLike, dec_deg: AngleLike) -> FloatArray:
    """Convert right ascensions and declinations, arrays (...), to unit vectors (..., 3)."""
    ra, dec = np.broadcast_arrays(np.asarray(ra_deg) * _DEG, np.asarray(dec_deg) * _DEG)
    cos_dec = np.cos(dec)
    return np.stack([cos_dec * np.cos(ra), cos_dec * np.sin(ra), np.sin(dec)], axis=-1)


def east_and_north(ra_deg: FloatArray, dec_deg: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Unit vectors (..., 3) that point east and north at the directions (...), in this order."""
    ra, dec = np.radians(ra_deg), np.radians(dec_deg)
    east = np.stack([-np.sin(ra), np.cos(ra), np.zeros_like(ra)], axis=-1)
    north = np.stack([-np.sin(dec) * np.cos(ra), -np.sin(dec) * np.sin(ra), np.cos(dec)], axis=-1)
    return east, north


def unit_to_direction(vector: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Convert vectors (..., 3) of any length to RA (0 to 360) and Dec in degrees."""
    x, y, z = vector[..., 0], vector[..., 1], vector[..., 2]
    ra_deg = np.degrees(np.arctan2(y, x)) % 360.0
    dec_deg = np.degrees(np.arctan2(z, np.hypot(x, y)))
    return np.asarray(ra_deg), np.asarray(dec_deg)


def _separation(
    ra_a_deg: AngleLike, dec_a_deg: AngleLike, ra_b_deg: AngleLike, dec_b_deg: AngleLike
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """East and north parts of b seen from a (times sin of the distance) and its cosine."""
    dra = (np.asarray(ra_b_deg, float) - np.asarray(ra_a_deg, float)) * _DEG
    dec_a, dec_b = np.asarray(dec_a_deg, float) * _DEG, np.asarray(dec_b_deg, float) * _DEG
    east = np.cos(dec_b) * np.sin(dra)
    # Written with the half angle so that arcsecond separations keep their digits.
    bend = 2.0 * np.cos(dec_b) * np.sin(dra / 2.0) ** 2
    north = np.sin(dec_b - dec_a) + np.sin(dec_a) * bend
    cosine = np.cos(dec_b - dec_a) - np.cos(dec_a) * bend
    return np.asarray(east), np.asarray(north), np.asarray(cosine)


@overload
def separation_deg(
    ra_a_deg: float, dec_a_deg: float, ra_b_deg: float, dec_b_deg: float
) -> float: ...
@overload
def separation_deg(
    ra_a_deg: AngleLike, dec_a_deg: AngleLike, ra_b_deg: AngleLike, dec_b_deg: AngleLike
) -> AngleLike: ...
def separation_deg(
    ra_a_deg: AngleLike, dec_a_deg: AngleLike, ra_b_deg: AngleLike, dec_b_deg: AngleLike
) -> AngleLike:
    """Great-circle distance between directions a and b, degrees.

    Exact for tiny distances and for opposite directions (Vincenty's form).
    """
    east, north, cosine = _separation(ra_a_deg, dec_a_deg, ra_b_deg, dec_b_deg)
    distance = np.degrees(np.arctan2(np.hypot(east, north), cosine))
    return float(distance) if np.ndim(distance) == 0 else np.asarray(distance)


@overload
def position_angle_deg(
    ra_a_deg: float, dec_a_deg: float, ra_b_deg: float, dec_b_deg: float
) -> float: ...
@overload
def position_angle_deg(
    ra_a_deg: AngleLike, dec_a_deg: AngleLike, ra_b_deg: AngleLike, dec_b_deg: AngleLike
) -> AngleLike: ...
def position_angle_deg(
    ra_a_deg: AngleLike, dec_a_deg: AngleLike, ra_b_deg: AngleLike, dec_b_deg: AngleLike
) -> AngleLike:
    """Direction of b as seen from a, in degrees east of north, 0 to 360."""
    east, north, _ = _separation(ra_a_deg, dec_a_deg, ra_b_deg, dec_b_deg)
    angle = np.degrees(np.arctan2(east, north)) % 360.0
    return wrap_360(float(angle)) if np.ndim(angle) == 0 else wrap_360(np.asarray(angle))


def parse_sexagesimal(text: str) -> float:
    """Parse one to three fields ('12.5', '12 34.5', '12:34:56.7') to one number.

    The result is in the unit of the first field: hours or degrees. Blanks, colons and the marks h,
    d, m, s, degree, minute and second separate fields. Raises ValueError for anything else.
    """
    cleaned = text.strip().replace("−", "-")
    sign = -1.0 if cleaned.startswith("-") else 1.0
    parts = [part for part in _MARKS.split(cleaned.lstrip("+-")) if part]
    if not 1 <= len(parts) <= 3 or any(_NUMBER.fullmatch(part) is None for part in parts):
        raise ValueError(f"{text!r} is not an angle: write it like 12:34:56.7 or 12 34 56.7")
    if any("." in part for part in parts[:-1]):
        raise ValueError(f"{text!r}: only the last field may have decimals")
    fields = [float(part) for part in parts] + [0.0, 0.0]
    if fields[1] >= 60.0 or fields[2] >= 60.0:
        raise ValueError(f"{text!r}: minutes and seconds must be below 60")
    return sign * (fields[0] + fields[1] / 60.0 + fields[2] / 3600.0)


def parse_ra_deg(text: str) -> float:
    """Parse a right ascension in hours ('hh mm ss', 'h:m:s', '12h34m56s') to degrees, 0 to 360.

    A single number is degrees, as in FITS headers, unless it is marked with an h. Raises ValueError
    for anything else or out of range.
    """
    plain = text.strip().lower()
    is_single = len([part for part in _MARKS.split(plain.lstrip("+-")) if part]) == 1
    is_degrees = is_single and "h" not in plain
    value = parse_sexagesimal(text)
    ra_deg = value if is_degrees else hours_to_deg(value)
    if not 0.0 <= ra_deg < 360.0 + 1e-12:
        raise ValueError(f"{text!r}: right ascension lies between 0 and 24 h")
    return wrap_360(ra_deg)


def parse_dec_deg(text: str) -> float:
    """Parse a declination written in degrees ('+dd mm ss', '-d:m:s', decimal) to degrees.

    Raises ValueError for anything else or beyond 90 deg.
    """
    dec_deg = parse_sexagesimal(text)
    if abs(dec_deg) > 90.0:
        raise ValueError(f"{text!r}: declination lies between -90 and +90 deg")
    return dec_deg


def largest_sigma(east_east: float, east_north: float, north_north: float) -> float:
    """Largest standard deviation in a 2x2 covariance: the root of its larger eigenvalue."""
    half = math.hypot(0.5 * (east_east - north_north), east_north)
    return math.sqrt(max(0.5 * (east_east + north_north) + half, 0.0))
