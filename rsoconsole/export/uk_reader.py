"""UK lines read (also called RDE's or RGO's): fixed columns, a line a measurement, no points.

What is not said is None. Source: The Reporting of Satellite Observations, Radio and Space Research
Station, Slough 1973, as posted by D. Brierley on SeeSat-L, 5 February 1998.
"""

import re

from rsoconsole.errors import ExportError, raised_as
from rsoconsole.export.iod_reader import EPOCHS, IodObservation, angles_of, full_year
from rsoconsole.export.target import piece_letters
from rsoconsole.sky import NS_PER_S, iso_to_utc_ns

_LINE = re.compile(
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


def parse_uk(line: str) -> IodObservation:
    """The observation in one line. Raises ExportError."""
    match = _LINE.match(line.rstrip("\r\n"))
    if match is None:
        raise ExportError(f"{line.strip()[:50]!r} does not keep the columns of a UK line")
    found = match.groupdict()
    t_utc_ns, step_ns = _instant(found["date"], found["time"])
    code = int(found["code"])
    first, second = angles_of(code, found["first"], found["sign"], found["second"])
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


def is_uk(line: str) -> bool:
    """Whether it has the columns of a UK line."""
    return _LINE.match(line.rstrip("\r\n")) is not None


def _piece(number: int) -> str:
    if number == 0:
        raise ExportError("piece 00 is none: the first is 01")
    return piece_letters(number)


def _instant(day: str, clock: str) -> tuple[int, int]:
    year, fraction = full_year(day[:2]), clock[6:]
    text = f"{year}-{day[2:4]}-{day[4:]}T{clock[:2]}:{clock[2:4]}:{clock[4:6]}.{fraction or '0'}Z"
    with raised_as(ExportError):
        return iso_to_utc_ns(text), NS_PER_S // 10 ** len(fraction)


def _time_sigma_s(field: str) -> float | None:
    """``Sssss``: a digit of seconds, then decimals of them."""
    digits = field.strip()
    if not digits:
        return None
    return float(f"{field[0].strip() or '0'}.{field[1:].strip() or '0'}") or None


def _position_arcsec(code: int, field: str) -> float | None:
    """``SSSs`` of formats 1 and 4, ``MMmm`` of 2 and 5, ``Dddd`` of 3, 6 and 7."""
    if not field.strip():
        return None
    digits = field.rstrip()
    if " " in digits.strip():
        raise ExportError(f"its error of position {field!r} has a blank inside")
    digits = digits.replace(" ", "0")
    wholes = {1: 3, 2: 2, 4: 3, 5: 2}.get(code, 1)
    scale = {1: 1.0, 2: 60.0, 4: 1.0, 5: 60.0}.get(code, 3600.0)
    return float(f"{digits[:wholes]}.{digits[wholes:] or '0'}") * scale or None
