"""Reader of observations in tables with named columns: CSV, ECSV and JSON lines.

The tables are this program's or from elsewhere. A column is identified by its name; capitals and
the spelling of the unit do not matter. Angles are in degrees unless the name says ``_rad`` or
``_hours``; sigmas are in arcsec on the sky.
"""

import csv
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rsoconsole.base import ExportError, parse_json, value_errors_as
from rsoconsole.records import Site
from rsoconsole.sky import iso_to_utc_ns


@dataclass(frozen=True, slots=True, kw_only=True)
class ObservedRow:
    """One observed direction: astrometric, ICRS."""

    where: str
    """File and line of the row, for error messages."""
    t_utc_ns: int
    ra_icrs_deg: float
    dec_icrs_deg: float
    sigma_ra_arcsec: float | None = None
    """One sigma of right ascension on the sky, arcsec; None where the file states none."""
    sigma_dec_arcsec: float | None = None
    correlation: float = 0.0
    time_sigma_s: float | None = None
    """One sigma of the time, s, to be added to the direction's error; None: nothing to add."""
    target: str | None = None
    """Name of the object in the file; None where the file names none."""
    station: str | None = None
    """Name of the station in the file; None where the file names none."""
    site: Site | None = None
    """Site of the station; None where the file does not state it."""
    is_degrees: bool = False
    """True where the column's name or the file's format leaves no doubt about the angles' unit."""
    is_horizontal: bool = False
    """True where ``ra_icrs_deg`` is an azimuth and ``dec_icrs_deg`` an elevation, as seen."""
    mag: float | None = None
    """Apparent magnitude; None where the file states none."""
    mag_sigma: float | None = None
    """One sigma of it by all causes that the file states."""
    band: str | None = None
    """Band of it in the file's own words."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadRows:
    """The directions of a file, and what of it gave none."""

    rows: tuple[ObservedRow, ...]
    not_used: tuple[str, ...] = ()
    """Each line that is not used, with its place and why."""


_YEARS = (1957, 2200)
"""Years of observations, from the first satellite on; later than 2262 nanoseconds end."""


def instant_utc_ns(text: str) -> int:
    """Return the instant of an observation. Raises ValueError, also for a year of no satellite."""
    t_utc_ns = iso_to_utc_ns(text)
    first, last = _YEARS
    if not _FIRST_UTC_NS <= t_utc_ns < _LAST_UTC_NS:
        raise ValueError(f"{text[:30]!r} is no time of a satellite: {first} to {last}")
    return t_utc_ns


_FIRST_UTC_NS, _LAST_UTC_NS = (iso_to_utc_ns(f"{year}-01-01T00:00:00Z") for year in _YEARS)
_TIME = ("t_mid_utc", "time_utc", "obtime", "utc", "time", "epoch", "date_obs", "datetime", "t")
_RA = ("ra_icrs_deg", "ra_deg", "ra", "ra_j2000_deg", "right_ascension_deg", "right_ascension")
_DEC = ("dec_icrs_deg", "dec_deg", "dec", "dec_j2000_deg", "declination_deg", "declination")
_BARE = {"ra", "right_ascension", "dec", "declination"}
"""Names that state no unit; a reading option may state it."""
_RADIANS = (("ra_rad", "ra_icrs_rad"), ("dec_rad", "dec_icrs_rad", "declination_rad"))
_HOURS = ("ra_hours", "ra_h", "ra_hour")
_RA_SCALES = {
    **{name: 1.0 for name in _RA if name not in _BARE},
    **dict.fromkeys(_RADIANS[0], math.degrees(1.0)),
    **dict.fromkeys(_HOURS, 15.0),
    **{name: 1.0 for name in _RA if name in _BARE},
}
"""Factor to degrees by column name, in order of precedence: names that state a unit first."""
_DEC_SCALES = {
    **{name: 1.0 for name in _DEC if name not in _BARE},
    **dict.fromkeys(_RADIANS[1], math.degrees(1.0)),
    **{name: 1.0 for name in _DEC if name in _BARE},
}
_SIGMA_RA = ("sigma_ra_arcsec", "ra_sigma_arcsec", "sigma_arcsec")
_SIGMA_DEC = ("sigma_dec_arcsec", "dec_sigma_arcsec", "sigma_arcsec")
_TARGET = ("object", "target", "norad_id", "norad", "norad_cat_id", "satno", "track_id", "track")
_STATION = ("station", "site", "sensor", "origsensorid")
_LATITUDE = ("lat_deg", "latitude_deg", "site_lat_deg", "latitude", "lat", "senlat")
_LONGITUDE = ("lon_deg", "longitude_deg", "site_lon_deg", "longitude", "lon", "senlon")
_HEIGHT = ("alt_m", "elevation_m", "height_m", "site_alt_m", "elev_m")
_TIME_SIGMA = ("time_sigma_s", "timing_sigma_s", "sigma_t_s")
_MAG = ("mag", "mag_v", "vmag", "apparent_magnitude", "magnitude")
_MAG_SIGMAS = (
    ("mag_sigma", "mag_unc", "magunc", "apparent_magnitude_uncertainty"),
    ("mag_sigma_colour",),
)
"""Errors that count in quadrature."""
_BAND = ("band", "passband", "observing_filter")
NEEDED = (
    "a column of times (t_mid_utc, time or utc), of right ascension (ra_deg) and of declination"
    " (dec_deg)"
)


def read_table(text: str, name: str) -> ReadRows:
    """Read the rows of a table; ``name`` is what errors call the file.

    In tables of this program, rows that no track took and streaks cut by the frame's edge are left
    out. A line that cannot be read costs itself alone. Raises ExportError where none can be.
    """
    plain = [line for line in text.splitlines() if not line.startswith("#")]
    first = next((line for line in plain if line.strip()), "")
    faults: list[ExportError] = []
    if first.lstrip().startswith("{"):
        records = list(_of_json_lines(text, name, faults))
    else:
        records = list(_of_csv(text, first, name, faults))
    if not records:
        raise (
            faults[0]
            if faults
            else ExportError(f"{name} holds no observations: no row is below its heading")
        )
    columns = _Columns(list({key: None for _, values in records for key in values}), name)
    rows: list[ObservedRow] = []
    left_out = 0
    for where, values in records:
        if not columns.is_used(values):
            left_out += 1
            continue
        try:
            rows.append(columns.row(values, where))
        except ExportError as error:
            faults.append(error)
    if not rows and faults:
        raise faults[0]
    not_used = list(map(str, faults))
    if left_out:
        not_used.append(f"{name}: {left_out} rows that no track took or the frame's edge cuts")
    return ReadRows(rows=tuple(rows), not_used=tuple(not_used))


def looks_like_table(text: str) -> bool:
    """True where the first line names columns of RA and Dec, or is a JSON object with such keys."""
    for line in text.splitlines():
        if line.startswith("#") or not line.strip():
            continue
        names = {_plain(each) for each in _first_names(line)}
        return bool(names & _RA_SCALES.keys()) and bool(names & _DEC_SCALES.keys())
    return False


def _first_names(line: str) -> Sequence[str]:
    """Columns that a first line names, or keys of the object that it is."""
    if not line.lstrip().startswith("{"):
        return re.split(r"[,;\t ]+", line)
    try:
        values = parse_json(line)
    except ValueError:
        return ()
    return list(values) if isinstance(values, dict) else ()


def _of_csv(
    text: str, head: str, name: str, faults: list[ExportError]
) -> Iterator[tuple[str, dict[str, str]]]:
    """Rows by the names of their columns; each line by itself: a stray quote costs its own line."""
    separator = max(",;\t ", key=head.count) if not head.count(",") else ","
    names: list[str] = []
    for number, line in enumerate(text.splitlines(), start=1):
        if not _is_data(line):
            continue
        where = f"{name}, line {number}"
        try:
            (fields,) = csv.reader([line], delimiter=separator, skipinitialspace=True)
        except (csv.Error, ValueError) as error:
            faults.append(ExportError(f"{where} cannot be read as CSV: {error}"))
            continue
        if not names:
            names = [each.strip() for each in fields]
            continue
        while len(fields) > len(names) and not fields[-1].strip():
            fields.pop()
        if len(fields) != len(names):
            fault = f"{where}: {len(fields)} fields where {len(names)} belong"
            faults.append(ExportError(fault))
            continue
        yield where, dict(zip(names, fields, strict=True))


def _is_data(line: str) -> bool:
    return bool(line.strip()) and not line.startswith("#")


def _of_json_lines(
    text: str, name: str, faults: list[ExportError]
) -> Iterator[tuple[str, dict[str, str]]]:
    for number, line in enumerate(text.splitlines(), start=1):
        if not _is_data(line):
            continue
        where = f"{name}, line {number}"
        try:
            values = parse_json(line)
        except ValueError as error:
            faults.append(ExportError(f"{where}: {error}"))
            continue
        if not isinstance(values, dict):
            faults.append(ExportError(f"{where}: an object belongs there"))
            continue
        yield where, {key: "" if v is None else str(v) for key, v in values.items()}


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9]+", "_", name.strip().strip('"').lower()).strip("_")


class _Columns:
    """Columns of a table by their meaning."""

    def __init__(self, names: Sequence[str], where: str) -> None:
        """Find the columns. Raises ExportError where time or direction is missing."""
        self._by_name = {_plain(each): each for each in names}
        has_direction = all(self.find(tuple(each)) for each in (_RA_SCALES, _DEC_SCALES))
        if not (has_direction and self.find(_TIME)):
            shown = ", ".join(names)[:120]
            raise ExportError(f"{where}: {NEEDED} are needed; it has {shown}")

    def find(self, wanted: Sequence[str]) -> str | None:
        """Name in the table of a wanted column; None where it has none."""
        return next((self._by_name[each] for each in wanted if each in self._by_name), None)

    def is_used(self, values: Mapping[str, str]) -> bool:
        """True where a row counts: in tables of this program, taken by a track and not clipped."""
        taken = self._by_name.get("is_taken")
        cut = self._by_name.get("is_clipped")
        is_taken = taken is None or values.get(taken, "").lower() != "false"
        return is_taken and (cut is None or values.get(cut, "").lower() != "true")

    def row(self, values: Mapping[str, str], where: str) -> ObservedRow:
        """One row of the table. Raises ExportError."""

        def text(wanted: Sequence[str]) -> str | None:
            name = self.find(wanted)
            return None if name is None else (values.get(name, "").strip() or None)

        def number(wanted: Sequence[str]) -> float | None:
            found = text(wanted)
            return None if found is None else _number(found, f"{where}, {self.find(wanted)}")

        ra, dec, is_degrees = self._direction(number, where)
        with value_errors_as(ExportError, f"{where}: "):
            t_utc_ns = instant_utc_ns((text(_TIME) or "").replace(" ", "T"))
        latitude, longitude = number(_LATITUDE), number(_LONGITUDE)
        site = None
        if latitude is not None and longitude is not None:
            if abs(latitude) > 90.0 or abs(longitude) > 360.0:
                raise ExportError(f"{where}: no place on Earth has {latitude:g}, {longitude:g}")
            site = Site(
                latitude_deg=latitude, longitude_deg=longitude, elevation_m=number(_HEIGHT) or 0.0
            )
        return ObservedRow(
            where=where,
            t_utc_ns=t_utc_ns,
            ra_icrs_deg=ra,
            dec_icrs_deg=dec,
            sigma_ra_arcsec=number(_SIGMA_RA),
            sigma_dec_arcsec=number(_SIGMA_DEC),
            correlation=number(("correlation",)) or 0.0,
            time_sigma_s=number(_TIME_SIGMA),
            target=text(_TARGET),
            station=text(_STATION),
            site=site,
            is_degrees=is_degrees,
            **self._light(text),
        )

    def _light(self, text: Callable[[Sequence[str]], str | None]) -> dict[str, Any]:
        """Magnitude, its error and band; what is no number costs the magnitude, not the row."""
        mag = _number_or_none(text(_MAG))
        if mag is None:
            return {}
        sigmas = [_number_or_none(text(names)) for names in _MAG_SIGMAS]
        known = [each for each in sigmas if each is not None]
        return {
            "mag": mag,
            "mag_sigma": math.hypot(*known) if known else None,
            "band": text(_BAND),
        }

    def _direction(
        self, number: Callable[[Sequence[str]], float | None], where: str
    ) -> tuple[float, float, bool]:
        """Both angles in degrees, by the names of their columns; whether a name states a unit."""

        def angle(scales: Mapping[str, float]) -> tuple[str, float]:
            for name, scale in scales.items():
                if (found := number((name,))) is not None:
                    return name, scale * found
            raise ExportError(f"{where}: it has no direction")

        (ra_name, ra), (dec_name, dec) = angle(_RA_SCALES), angle(_DEC_SCALES)
        bare = {ra_name, dec_name} & _BARE
        if bare and {ra_name, dec_name} & {*_RADIANS[0], *_RADIANS[1]}:
            raise ExportError(
                f"{where}: one angle is in radians and {bare.pop()} has no unit in its name: call"
                " it ra_rad or dec_rad, or ra_deg or dec_deg"
            )
        return ra, dec, len(bare) < 2


def _number_or_none(text: str | None) -> float | None:
    try:
        value = math.nan if text is None else float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _number(text: str, where: str) -> float:
    try:
        value = float(text)
    except ValueError:
        hint = ": write it in degrees" if ":" in text else ""
        raise ExportError(f"{where}: {text[:30]!r} is not a number{hint}") from None
    if not math.isfinite(value):
        raise ExportError(f"{where}: {text} is no direction and no error")
    return value


def ecsv_site(text: str) -> Site | None:
    """Return the site in the header of this program's ECSV; None where there is none."""
    found = {
        key: re.search(rf"^#.*\b{key}: (-?[0-9.]+)", text, re.MULTILINE)
        for key in ("latitude_deg", "longitude_deg", "elevation_m")
    }
    if any(each is None for each in found.values()):
        return None
    values = {key: float(each[1]) for key, each in found.items() if each is not None}
    return Site(**values)
