"""Reader of IOD and UK lines, all angle formats; a missing value is None.

The columns are checked strictly: a line that is one column off is no IOD line, even where the fault
is in a field that is not read (sky, behaviour, magnitude, flash period). Missing digits at the end
of a time or an angle count as zeros; ``t_step_ns`` is the step of the last digit given.
"""

import math
import re
from collections.abc import Callable
from dataclasses import dataclass

from rsoconsole.base import ExportError, value_errors_as
from rsoconsole.library.formats._observed_csv import instant_utc_ns
from rsoconsole.library.formats.target import piece_letters
from rsoconsole.words import NS_PER_S

_LINE = re.compile(
    r"""
    (?:(?P<norad>\d{5})[ ](?P<year>\d{2})[ ](?P<launch>\d{3})
       (?P<piece>[A-Z]{3}|[A-Z]{2}[ ]|[A-Z][ ][ ])[ ]|[ ]{16})
    (?P<station>[0-9A-HJ-NP-Z]{4})[ ]
    [EGFPBTCO ][ ]
    (?P<date>\d{8})
    (?:(?P<short_time>\d{0,9})[ ]*$
       |(?=[\d ]{9}[ ])(?P<time>\d{0,9})[ ]*(?<=^.{41})
        (?P<time_mx>\d{2}|[ ]{2})[ ]
        (?:(?P<code>[1-7])(?P<epoch>[0-6 ])[ ]
           (?=[\d ]{7}[+-])(?P<first>\d{1,7})[ ]*
           (?P<sign>[+-])(?=[\d ]{6}(?:[ ]|$))(?P<second>\d{1,6})[ ]*(?<=^.{62})
           (?P<position_mx>\d{2})
           |[ ]{20})
        (?:[ ][EFIRSXBHPADMNV]
           (?:[+-](?=[\d ]{3}(?:[ ]|$))\d{1,3}[ ]*(?<=^.{70})
              (?:[ ](?=[\d ]{2}|\d$)\d{1,2}[ ]*
                 (?:(?<=^.{74})(?=[\d ]{1,6}[ ]*$)[ ]*\d{1,6})?
              )?
           )?
        )?[ ]*$
    )
    """,
    re.VERBOSE | re.ASCII,
)
EPOCHS = {"1": 1855, "2": 1875, "3": 1900, "4": 1950, "5": 2000, "6": 2050}
"""Year of the equinox by the line's code; codes 0 and blank mean the equinox of date."""
_FIRST_SATELLITE = 57
"""Two-digit years from this one on are of the 1900s, smaller ones of the 2000s."""
_ARCSEC_BY_CODE = {1: 1.0, 2: 60.0, 3: 3600.0, 4: 1.0, 5: 60.0, 6: 3600.0, 7: 3600.0}
"""Unit of the position's uncertainty by angle format, arcsec."""
HORIZONTAL = (4, 5, 6)
"""Angle formats whose two angles are azimuth and elevation."""


@dataclass(frozen=True, slots=True, kw_only=True)
class IodObservation:
    """One observation from an IOD or UK line; None for what the line does not state."""

    norad_id: int | None
    cospar: str | None
    """International designator, e.g. ``1998-123A``."""
    station: str
    t_utc_ns: int
    t_step_ns: int
    """Step of the last digit given of the time, nanoseconds."""
    time_sigma_s: float | None
    angle_format: int | None
    """Angle format, 1 to 7: 4 to 6 are azimuth and elevation, the others RA and Dec."""
    epoch_year: int | None
    """Year of the equinox; None for the equinox of date, and for a line without angles."""
    first_deg: float | None
    """Right ascension (in formats 4 to 6 azimuth), degrees."""
    second_deg: float | None
    """Declination (in formats 4 to 6 elevation), degrees."""
    position_sigma_arcsec: float | None


def parse_iod_line(line: str) -> IodObservation:
    """Parse one IOD line. Raises ExportError for a line of another form."""
    match = _LINE.match(line.rstrip("\r\n"))
    if match is None:
        raise ExportError(
            f"{line.strip()[:50]!r} does not keep the columns of an IOD line{_first_fault(line)}"
        )
    found = match.groupdict()
    t_utc_ns, t_step_ns = _instant(found["date"], found["time"] or found["short_time"] or "")
    code = None if found["code"] is None else int(found["code"])
    first, second = None, None
    if code is not None:
        first, second = parse_angles_deg(code, found["first"], found["sign"], found["second"])
    cospar = None
    if found["norad"] is not None:
        cospar = f"{full_year(found['year'])}-{found['launch']}{found['piece'].strip()}"
    position = None if code is None else _mx(found["position_mx"]) * _ARCSEC_BY_CODE[code] or None
    return IodObservation(
        norad_id=None if found["norad"] is None else int(found["norad"]),
        cospar=cospar,
        station=found["station"],
        t_utc_ns=t_utc_ns,
        t_step_ns=t_step_ns,
        time_sigma_s=_mx(found["time_mx"]) if (found["time_mx"] or "").strip() else None,
        angle_format=code,
        epoch_year=EPOCHS.get(found["epoch"] or ""),
        first_deg=first,
        second_deg=second,
        position_sigma_arcsec=position,
    )


_FIELDS = (
    (24, 31, "the date", r"\d{8}"),
    (1, 5, "a catalogue number", r"\d{5}| {5}"),
    (7, 15, "a designation (yy nnnAAA)", r"\d\d \d{3}[A-Z]{1,3} *| {9}"),
    (17, 20, "a station", r"[0-9A-HJ-NP-Z]{4}"),
    (22, 22, "a condition of the sky", r"[EGFPBTCO ]"),
    (32, 40, "a time (hhmmsssss)", r"\d* *"),
    (42, 43, "an uncertainty of the time", r"\d{2}| *"),
    (45, 46, "codes of angles and equinox", r"[1-7][0-6 ]| *"),
    (48, 61, "two angles", r"\d+ *[+-]\d+ *| *"),
    (63, 64, "an uncertainty of the place", r"\d{2}| *"),
)
"""Columns of a line from 1, what they hold, and its form; the first shows that it is a line."""


def _first_fault(line: str) -> str:
    """The first columns that are wrong, in words; empty for what has no date in its columns."""
    for n, (first, last, what, form) in enumerate(_FIELDS):
        text = line.rstrip("\r\n")[first - 1 : last]
        if re.fullmatch(form, text, re.ASCII) is None:
            return f": columns {first}-{last}: {text!r} is not {what}" if n else ""
    return ""


def full_year(two_digits: str) -> int:
    """Return the full year of two digits: 57 to 99 are 1957 to 1999, 00 to 56 are 2000 to 2056."""
    year = int(two_digits)
    return year + (1900 if year >= _FIRST_SATELLITE else 2000)


def _instant(day: str, clock: str) -> tuple[int, int]:
    full = clock.ljust(9, "0")
    text = f"{day[:4]}-{day[4:6]}-{day[6:]}T{full[:2]}:{full[2:4]}:{full[4:6]}.{full[6:]}Z"
    with value_errors_as(ExportError):
        t_utc_ns = instant_utc_ns(text)
    steps_s = (86_400.0, 36_000.0, 3600.0, 600.0, 60.0, 10.0, 1.0, 0.1, 0.01, 0.001)
    return t_utc_ns, round(steps_s[len(clock)] * NS_PER_S)


def _mx(text: str) -> float:
    return int(text[0]) * 10.0 ** (int(text[1]) - 8)


def parse_angles_deg(code: int, first: str, sign: str, second: str) -> tuple[float, float]:
    """Return both angles of an IOD or UK line, degrees.

    ``code``: the angle format; ``sign``: of the second angle. Missing digits at the end count as
    zeros; minutes and seconds above 59 are carried over as written. Raises ExportError for an angle
    out of range.
    """
    first_of, second_of = _FORMATS[code]
    one = first_of(first)
    other = math.copysign(second_of(second), float(sign + "1"))
    what = "azimuth and elevation" if code in HORIZONTAL else "right ascension and declination"
    if not (0.0 <= one < 360.0 and abs(other) <= 90.0):
        raise ExportError(f"{what} of {one:.4f} and {other:+.4f} deg are beyond their range")
    return one, other


def _sexagesimal(text: str, wholes: int) -> float:
    """Value of wholes, two digits of minutes, two of seconds, then decimals of these."""
    text = text.ljust(wholes + 4, "0")
    minutes, seconds = int(text[wholes : wholes + 2]), text[wholes + 2 : wholes + 4]
    decimals = text[wholes + 4 :] or "0"
    return int(text[:wholes]) + minutes / 60.0 + float(f"{seconds}.{decimals}") / 3600.0


def _minutes(text: str, wholes: int) -> float:
    """Value of wholes, two digits of minutes, then decimals of these."""
    text = text.ljust(wholes + 2, "0")
    minutes, decimals = text[wholes : wholes + 2], text[wholes + 2 :] or "0"
    return int(text[:wholes]) + float(f"{minutes}.{decimals}") / 60.0


def _decimal(text: str, wholes: int) -> float:
    text = text.ljust(wholes, "0")
    return float(f"{text[:wholes]}.{text[wholes:] or '0'}")


_Read = Callable[[str], float]
_FORMATS: dict[int, tuple[_Read, _Read]] = {
    1: (lambda t: 15.0 * _sexagesimal(t, 2), lambda t: _sexagesimal(t, 2)),
    2: (lambda t: 15.0 * _minutes(t, 2), lambda t: _minutes(t, 2)),
    3: (lambda t: 15.0 * _minutes(t, 2), lambda t: _decimal(t, 2)),
    4: (lambda t: _sexagesimal(t, 3), lambda t: _sexagesimal(t, 2)),
    5: (lambda t: _minutes(t, 3), lambda t: _minutes(t, 2)),
    6: (lambda t: _decimal(t, 3), lambda t: _decimal(t, 2)),
    7: (lambda t: 15.0 * _sexagesimal(t, 2), lambda t: _decimal(t, 2)),
}
"""Readers of both angles, by angle format."""


_UK_LINE = re.compile(
    r"""
    (?P<year>\d{2})(?P<launch>\d{3})(?P<piece>\d{2})
    (?P<station>[0-9A-HJ-NP-Z]{4})
    (?P<date>\d{6})(?=[\d ]{10})(?P<time>\d{6,10})[ ]*(?<=^.{27})
    (?:(?=[\d ]{5})\d{1,5}[ ]*|[ ]{5})(?<=^.{32})
    (?P<standard>[1-3 ])
    (?P<code>[1-7])
    (?=[\d ]{8})(?P<first>\d{4,8})[ ]*(?<=^.{42})
    (?P<sign>[+-])(?=[\d ]{7})(?P<second>\d{2,7})[ ]*(?<=^.{50})
    (?P<position>[\d ]\d[\d ]{2}|\d[ ]{3}|[ ]{3}\d|[ ]{4})
    (?P<epoch>[0-6 ])
    (?:[ \d]{0,13}
      |[ \d]{13}(?:[+-]\d[ \d]|[ ]{2}\d|[ ]\d[ \d]|\d{3}|\d\d[ ]|\d[ ]{2}|[ ]{3})
       (?:[+-]\d[ \d]|[ ]{2}\d|[ ]\d[ \d]|\d{3}|\d\d[ ]|\d[ ]{2}|INV|[ ]{3})
       (?:(?=[\d ]{5})(?:[ ]{0,3}\d{2,5}[ ]{0,3}|[ ]{5})(?<=^.{79})[EFIRSXBHPADMNV]?|[ ]{0,4})
    )[ ]*$
    """,
    re.VERBOSE | re.ASCII,
)


def parse_uk_line(line: str) -> IodObservation:
    """Parse one UK line. Raises ExportError for a line of another form."""
    match = _UK_LINE.match(line.rstrip("\r\n"))
    if match is None:
        raise ExportError(f"{line.strip()[:50]!r} does not keep the columns of a UK line")
    found = match.groupdict()
    t_utc_ns, step_ns = _uk_instant(found["date"], found["time"])
    code = int(found["code"])
    first, second = parse_angles_deg(code, found["first"], found["sign"], found["second"])
    return IodObservation(
        norad_id=None,
        cospar=f"{full_year(found['year'])}-{found['launch']}{_piece(int(found['piece']))}",
        station=found["station"],
        t_utc_ns=t_utc_ns,
        t_step_ns=step_ns,
        time_sigma_s=_time_sigma_s(match.string[27:32]),
        angle_format=code,
        epoch_year=EPOCHS.get(found["epoch"]),
        first_deg=first,
        second_deg=second,
        position_sigma_arcsec=_position_arcsec(code, found["position"]),
    )


def is_uk_line(line: str) -> bool:
    """True where a line has the columns of a UK line."""
    return _UK_LINE.match(line.rstrip("\r\n")) is not None


def _piece(number: int) -> str:
    if number == 0:
        raise ExportError("piece 00 is none: the first is 01")
    return piece_letters(number)


def _uk_instant(day: str, clock: str) -> tuple[int, int]:
    year, fraction = full_year(day[:2]), clock[6:]
    text = f"{year}-{day[2:4]}-{day[4:]}T{clock[:2]}:{clock[2:4]}:{clock[4:6]}.{fraction or '0'}Z"
    with value_errors_as(ExportError):
        return instant_utc_ns(text), NS_PER_S // 10 ** len(fraction)


def _time_sigma_s(field: str) -> float | None:
    """One sigma of the time, s, from ``Sssss``: a digit of seconds, then decimals of them."""
    digits = field.strip()
    if not digits:
        return None
    return float(f"{field[0].strip() or '0'}.{field[1:].strip() or '0'}") or None


def _position_arcsec(code: int, field: str) -> float | None:
    """Uncertainty, arcsec: ``SSSs`` of formats 1 and 4, ``MMmm`` of 2 and 5, ``Dddd`` of others."""
    if not field.strip():
        return None
    digits = field.rstrip()
    if " " in digits.strip():
        raise ExportError(f"its error of position {field!r} has a blank inside")
    digits = digits.replace(" ", "0")
    wholes = {1: 3, 2: 2, 4: 3, 5: 2}.get(code, 1)
    scale = {1: 1.0, 2: 60.0, 4: 1.0, 5: 60.0}.get(code, 3600.0)
    return float(f"{digits[:wholes]}.{digits[wholes:] or '0'}") * scale or None
