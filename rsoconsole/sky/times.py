"""Time scales: whole nanoseconds of UTC since 1970 as ISO text, UT1, TT and sidereal time.

Julian dates come as pairs (day, fraction), as erfa takes them. A nanosecond count has no room for a
leap second: the second 23:59:60 is not representable, as in POSIX time. UT1 and polar motion come
from the table that astropy-iers-data ships (IERS finals2000A); nothing is downloaded. Beyond the
table's ends UT1-TAI and the pole keep their last value.
"""

import re
from dataclasses import dataclass
from datetime import date, timedelta
from functools import lru_cache
from importlib.resources import files
from typing import Final, overload

import erfa
import numpy as np
import numpy.typing as npt

from rsoconsole.records import FloatArray
from rsoconsole.words import NS_PER_DAY, NS_PER_S

IntArray = npt.NDArray[np.int64]
TimeLike = int | IntArray

JD_UNIX = 2_440_587.5
MJD_UNIX = 40_587
TT_MINUS_TAI_S = 32.184
ARCSEC_RAD = np.pi / 648_000.0

_ISO = re.compile(
    r"(\d{4})-(?:(\d{2})-(\d{2})|(\d{3}))[T ](\d{2}):(\d{2})(?::(\d{2})(?:\.(\d{1,9})\d*)?)?"
    r"(Z|[+-]\d{2}:?\d{2})?",
    re.ASCII,
)


def day_of(t_utc_ns: int) -> date:
    """Day (UTC) of an instant."""
    return date(1970, 1, 1) + timedelta(days=t_utc_ns // NS_PER_DAY)


def iso_to_utc_ns(text: str) -> int:
    """Parse an ISO 8601 instant to UTC nanoseconds; without an offset it is taken as UTC.

    The day may be one of the year: 2023-173T03:04:05.

    Digits beyond the nanosecond are dropped. Raises ValueError for anything else: a time that
    cannot be read never becomes another time.
    """
    match = _ISO.fullmatch(text.strip()) if isinstance(text, str) else None
    if match is None:
        raise ValueError(f"{text!r} is not a time: write it like 2023-06-22T03:04:05.678Z")
    hour, minute, second = int(match[5]), int(match[6]), int(match[7] or 0)
    if hour > 23 or minute > 59 or second > 59:
        raise ValueError(f"{text!r} is not a time of day between 00:00:00 and 23:59:59")
    try:
        day = _day(int(match[1]), match[2], match[3], match[4])
    except ValueError as error:
        raise ValueError(f"{text!r} is not a date: {error}") from error
    nanoseconds = int((match[8] or "0").ljust(9, "0"))
    days = day - date(1970, 1, 1).toordinal()
    total_s = days * 86_400 + hour * 3600 + minute * 60 + second - _offset_s(match[9])
    return total_s * NS_PER_S + nanoseconds


def _day(year: int, month: str | None, day: str | None, of_year: str | None) -> int:
    """Ordinal of a day. Raises ValueError where the year has no such day."""
    if month is not None and day is not None:
        return date(year, int(month), int(day)).toordinal()
    first, number = date(year, 1, 1).toordinal(), int(of_year or 0)
    if not 1 <= number <= date(year, 12, 31).toordinal() - first + 1:
        raise ValueError(f"{year} has no day {number}")
    return first + number - 1


def _offset_s(zone: str | None) -> int:
    if zone is None or zone == "Z":
        return 0
    hours, minutes = int(zone[1:3]), int(zone[-2:])
    if hours > 14 or minutes > 59:
        raise ValueError(f"{zone!r} is not an offset from UTC")
    return (1 if zone[0] == "+" else -1) * (hours * 3600 + minutes * 60)


def jd_utc(t_utc_ns: TimeLike) -> tuple[FloatArray, FloatArray]:
    """Julian date of UTC as (day, fraction): the date at 0 h, and the fraction of a day since."""
    days, in_day = np.divmod(np.asarray(t_utc_ns, np.int64), NS_PER_DAY)
    return np.asarray(JD_UNIX + days), np.asarray(in_day / NS_PER_DAY)


@lru_cache(maxsize=4096)
def _tai_minus_utc_of_day(day: int) -> float:
    d = date.fromordinal(date(1970, 1, 1).toordinal() + day)
    # erfa's C function warns of years beyond its release; leap seconds then stay as they are.
    values, _ = erfa.ufunc.dat(d.year, d.month, d.day, 0.0)
    return float(values)


def tai_minus_utc_s(t_utc_ns: TimeLike) -> FloatArray:
    """TAI - UTC in seconds; after the end of the leap-second table its last value holds."""
    days = np.asarray(t_utc_ns, np.int64) // NS_PER_DAY
    if days.ndim == 0:
        return np.asarray(_tai_minus_utc_of_day(int(days)))
    unique, inverse = np.unique(days, return_inverse=True)
    values = np.array([_tai_minus_utc_of_day(int(day)) for day in unique])
    return np.asarray(values[inverse].reshape(days.shape))


def jd_tt(t_utc_ns: TimeLike) -> tuple[FloatArray, FloatArray]:
    """Julian date of terrestrial time as (day, fraction); serves for TDB too (2 ms off at most)."""
    jd_1, jd_2 = jd_utc(t_utc_ns)
    return jd_1, jd_2 + (tai_minus_utc_s(t_utc_ns) + TT_MINUS_TAI_S) / 86_400.0


def jd_ut1(t_utc_ns: TimeLike) -> tuple[FloatArray, FloatArray]:
    """Julian date of UT1 as (day, fraction)."""
    jd_1, jd_2 = jd_utc(t_utc_ns)
    return jd_1, jd_2 + earth_orientation(t_utc_ns).ut1_minus_utc_s / 86_400.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EarthOrientation:
    """UT1-UTC and the coordinates of the Earth's pole, one value for each instant."""

    ut1_minus_utc_s: FloatArray
    pole_x_arcsec: FloatArray
    pole_y_arcsec: FloatArray


def earth_orientation(t_utc_ns: TimeLike) -> EarthOrientation:
    """UT1-UTC and the Earth's pole at instants, linear between the days of the IERS table."""
    mjd, ut1_minus_tai, pole_x, pole_y = _iers_table()
    t = np.asarray(t_utc_ns, np.int64)
    t_mjd = MJD_UNIX + t / NS_PER_DAY
    return EarthOrientation(
        ut1_minus_utc_s=np.interp(t_mjd, mjd, ut1_minus_tai) + tai_minus_utc_s(t),
        pole_x_arcsec=np.interp(t_mjd, mjd, pole_x),
        pole_y_arcsec=np.interp(t_mjd, mjd, pole_y),
    )


@lru_cache(maxsize=1)
def _iers_table() -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """MJD, UT1-TAI (s), pole x and y (arcsec); UT1-TAI has no leaps, so it can be interpolated.

    Fixed columns of finals2000A, Bulletin A. Without the package UT1 is taken as UTC of 2017 on.
    """
    try:
        table = files("astropy_iers_data") / "data" / "finals2000A.all"
        lines = table.read_text(encoding="ascii").splitlines()
    except (ImportError, OSError):
        return np.array([0.0]), np.array([-37.0]), np.array([0.0]), np.array([0.0])
    rows = [
        (float(line[7:15]), float(line[58:68]), float(line[18:27]), float(line[37:46]))
        for line in lines
        if line[58:68].strip()
    ]
    mjd, ut1_minus_utc, pole_x, pole_y = np.array(rows).T.copy()  # else copied at each use
    t_utc_ns = (mjd.astype(np.int64) - MJD_UNIX) * NS_PER_DAY
    return mjd, ut1_minus_utc - tai_minus_utc_s(t_utc_ns), pole_x, pole_y


TIME_SCALES: Final = ("UTC", "UT1", "TAI", "TT", "TDB", "GPS")
"""Time scales that ``utc_ns_of_scale`` converts."""
_GPS_MINUS_TAI_S = -19.0
_ROUNDS = 3
"""Rounds in which a conversion settles; it needs more than one only beside a leap second."""


def utc_ns_of_scale(count_ns: int, scale: str) -> int:
    """Convert an instant of a time scale, ns of that scale since its 1970-01-01T00:00, to UTC ns.

    ``scale``: one of ``TIME_SCALES``. TDB is taken at the geocentre (2 us off at most). Source:
    FITS standard 4.0, table 30; IAU SOFA, time scale cookbook. Raises ValueError for another scale.
    """
    if scale not in TIME_SCALES:
        raise ValueError(f"{scale} is not converted: {', '.join(TIME_SCALES)} are")
    t_utc_ns = count_ns
    for _ in range(_ROUNDS):
        ahead_s = _ahead_of_utc_s(t_utc_ns, scale)
        t_utc_ns = count_ns - round(ahead_s * NS_PER_S)
    return t_utc_ns


def _ahead_of_utc_s(t_utc_ns: int, scale: str) -> float:
    """Seconds by which a time scale is ahead of UTC."""
    if scale == "UTC":
        return 0.0
    if scale == "UT1":
        return float(earth_orientation(t_utc_ns).ut1_minus_utc_s)
    tai_s = float(tai_minus_utc_s(t_utc_ns))
    if scale == "TAI":
        return tai_s
    if scale == "GPS":
        return tai_s + _GPS_MINUS_TAI_S
    tt_s = tai_s + TT_MINUS_TAI_S
    if scale == "TT":
        return tt_s
    return tt_s + float(erfa.dtdb(*jd_tt(t_utc_ns), 0.0, 0.0, 0.0, 0.0))


def gast_deg(t_utc_ns: TimeLike) -> FloatArray:
    """Greenwich apparent sidereal time, 0 to 360 (IAU 2006/2000A)."""
    gast = erfa.gst06a(*jd_ut1(t_utc_ns), *jd_tt(t_utc_ns))
    return np.asarray(np.degrees(gast))


@overload
def lst_deg(longitude_deg: float, t_utc_ns: int) -> float: ...
@overload
def lst_deg(longitude_deg: float, t_utc_ns: TimeLike) -> float | FloatArray: ...
def lst_deg(longitude_deg: float, t_utc_ns: TimeLike) -> float | FloatArray:
    """Local apparent sidereal time, 0 to 360; longitude east positive."""
    lst = (gast_deg(t_utc_ns) + longitude_deg) % 360.0
    return float(lst) if np.ndim(lst) == 0 else np.asarray(lst)
