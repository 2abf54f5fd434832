"""Directions of one object from any file of observations, for ``orbit`` and ``identify``.

``pipeline.read_observed_tracks`` reads sessions and the program's own JSON; this module adds TDM
(both forms), IOD and UK lines, tables, and EOObservation records.
"""

import math
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rsoconsole.base import (
    ExportError,
    OrbitError,
    parse_json,
    read_named_bytes,
    value_errors_as,
)
from rsoconsole.library.formats._iod_reader import (
    HORIZONTAL,
    IodObservation,
    is_uk_line,
    parse_iod_line,
    parse_uk_line,
)
from rsoconsole.library.formats._observed_csv import (
    ObservedRow,
    ReadRows,
    ecsv_site,
    looks_like_table,
    read_table,
)
from rsoconsole.library.formats._observed_tdm import observed_rows_of_tdm
from rsoconsole.library.formats._stations import Stations, read_stations
from rsoconsole.library.formats._tdm_reader import parse_tdm
from rsoconsole.orbits import element_text, reduce_directions
from rsoconsole.pipeline import ObservedTrack, read_observed_tracks
from rsoconsole.records import FloatArray, Site
from rsoconsole.sky import IntArray, altaz_to_icrs, equinox_to_icrs, refraction_deg
from rsoconsole.words import NS_PER_S, direction_fault

_LISTED = 8
_SITE_LINE = re.compile(r"# (\w{4}) (-?\d+\.\d+) (-?\d+\.\d+) (-?\d+) m \(WGS84, east positive\)")
"""Comment line with a station's place, as ``iod`` writes it."""
_MAX_TIME_SIGMA_S = 3600.0
_MIN_ELEVATION_DEG = -1.0
SITE_USAGE = "--site LATITUDE,LONGITUDE,METRES (east positive), or --stations FILE"


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadOptions:
    """Reading options: values for what a file does not state."""

    sigma_arcsec: float = 1.0
    """One sigma of observations that state none, arcsec."""
    site: Site | None = None
    stations: Path | None = None
    """File with the places of stations."""
    target: str | None = None
    """Name in the file of the object to read; None where the file holds a single object."""
    is_radians: bool | None = None
    """True: angles whose unit neither name nor format states are radians; None: not specified."""


def read_observations(
    path: Path, ask: ReadOptions, *, track: int | None = None
) -> tuple[tuple[ObservedTrack, ...], ...]:
    """Read the tracks of a session, or the directions of one object in a file.

    Returns groups: of a session one group, its tracks, the longest first; of a file one group for
    each station. ``ask``: options of reading; ``track``: id of the only track to read of a session.
    Raises SessionError, OrbitError or ExportError that names the fault.
    """
    if path.is_dir() or path.name == "session.db" or not path.exists():
        return (read_observed_tracks(path, sigma_arcsec=ask.sigma_arcsec, track=track),)
    text = _text(path)
    read = parse_observations(text, path)
    if read is None:
        if ask.is_radians:
            raise OrbitError(f"{path} is JSON, whose angles are degrees: write them so")
        return (read_observed_tracks(path, sigma_arcsec=ask.sigma_arcsec, site=ask.site),)
    read = _sound(_in_degrees(read, path, ask))
    rows = _of_one(read.rows, path, ask.target)
    known = None if ask.stations is None else read_stations(ask.stations, _text(ask.stations))
    by_station: dict[tuple[str | None, Site | None], list[ObservedRow]] = {}
    for each in rows:
        by_station.setdefault((each.station, each.site), []).append(each)
    found = [_of_station(path, name, own, (ask, known)) for (name, _), own in by_station.items()]
    not_used = (*read.not_used, *(known.not_used if known is not None else ()))
    found[0] = replace(found[0], not_used=not_used)
    return tuple((each,) for each in found)


def _text(path: Path) -> str:
    """Text of a file, packed by gzip too."""
    content = read_named_bytes(path, OrbitError, "name a file of observations or stations")
    with value_errors_as(OrbitError, f"{path} cannot be read: ", (OrbitError,)):
        text = element_text(content)
    if "\0" in text:
        raise OrbitError(f"{path} cannot be read: it is no text")
    return text


def parse_observations(text: str, path: Path) -> ReadRows | None:
    """The file's rows, by what it is; None for the program's own JSON."""
    name = str(path)
    start = text.lstrip()
    if start.startswith(("CCSDS_TDM_VERS", "<")):
        return observed_rows_of_tdm(parse_tdm(text, name), name)
    if start.startswith("[") and '"obTime"' in start:
        return _of_udl(start, name)
    if looks_like_table(text):
        site = ecsv_site(text) if "%ECSV" in text[:200] else None
        read = read_table(text, name)
        placed = (each if each.site is not None else replace(each, site=site) for each in read.rows)
        return replace(read, rows=tuple(placed))
    if start.startswith(("{", "[")):
        return None
    return _of_lines(text, name)


_QUOTED = re.compile(r"^(?:> ?)+")
"""Marks of a quoted mail."""
_RDE_LINE = re.compile(r"\d{7} \d{6}(?:\.\d+)? \d{6,8}[+-]\d{4,7} ", re.ASCII)
_READ = "TDM, IOD or UK lines, CSV with named columns, and JSON are read"
_DATED = re.compile(r"\d{8}", re.ASCII)
"""Digits that every line of observations has."""
_RDE = "RDE reports are not read: give IOD or UK lines, TDM or CSV"


def _of_lines(text: str, name: str) -> ReadRows:
    """Rows of IOD and UK lines, also among the other text of a mail."""
    found: list[tuple[IodObservation, str, Site | None]] = []
    faults: list[str] = []
    places: dict[str, Site] = {}
    for number, raw in enumerate(text.splitlines(), start=1):
        line = _QUOTED.sub("", raw).expandtabs()
        if (line_found := _SITE_LINE.match(line)) is not None:
            latitude, longitude, height = (float(line_found[n]) for n in (2, 3, 4))
            places[line_found[1]] = Site(
                latitude_deg=latitude, longitude_deg=longitude, elevation_m=height
            )
        if not line.strip() or line.startswith("#"):
            continue
        where = f"{name}, line {number}"
        try:
            if _RDE_LINE.match(line):
                raise ExportError(_RDE)
            each = parse_uk_line(line) if is_uk_line(line) else parse_iod_line(line)
            if each.first_deg is None:
                raise ExportError("it states no direction")
        except ExportError as error:
            faults.append(f"{where}: {error}")
            continue
        found.append((each, where, places.get(each.station)))
    if not found:
        reports = [each for each in faults if each.endswith(_RDE)]
        if not reports and not _DATED.search(text):
            raise ExportError(f"{name} is none of what is read: {_READ}")
        raise ExportError((reports or faults or [f"{name} holds no observations: {_READ}"])[0])
    numbers = {each.cospar: each.norad_id for each, _, _ in found if each.norad_id is not None}
    found = [
        (replace(each, norad_id=numbers.get(each.cospar, each.norad_id)), where, site)
        for each, where, site in found
    ]
    first, second = _directions([each for each, _, _ in found])
    rows = tuple(
        _of_line(each, where, site, (float(first[n]), float(second[n])))
        for n, (each, where, site) in enumerate(found)
    )
    return ReadRows(rows=rows, not_used=tuple(faults))


def _directions(lines: Sequence[IodObservation]) -> tuple[FloatArray, FloatArray]:
    """Both angles (N,), degrees: ICRS of lines on charts of any equinox; azimuth and elevation."""
    ra = np.array([each.first_deg for each in lines], np.float64)
    dec = np.array([each.second_deg for each in lines], np.float64)
    t_utc_ns = np.array([each.t_utc_ns for each in lines], np.int64)
    is_equatorial = np.array([each.angle_format not in HORIZONTAL for each in lines])
    for year in {each.epoch_year for each in lines}:
        of_it = np.array([each.epoch_year == year for each in lines]) & is_equatorial
        ra[of_it], dec[of_it] = equinox_to_icrs(ra[of_it], dec[of_it], year, t_utc_ns[of_it])
    return ra, dec


def _of_line(
    each: IodObservation, where: str, site: Site | None, icrs_deg: tuple[float, float]
) -> ObservedRow:
    ra, dec = icrs_deg
    name = each.cospar if each.norad_id is None else str(each.norad_id)
    step_s = each.t_step_ns / NS_PER_S / math.sqrt(12.0)
    return ObservedRow(
        where=where,
        t_utc_ns=each.t_utc_ns,
        ra_icrs_deg=ra,
        dec_icrs_deg=dec,
        sigma_ra_arcsec=each.position_sigma_arcsec,
        sigma_dec_arcsec=each.position_sigma_arcsec,
        time_sigma_s=math.hypot(each.time_sigma_s or 0.0, step_s),
        target=name,
        station=each.station,
        site=site,
        is_degrees=True,
        is_horizontal=each.angle_format in HORIZONTAL,
    )


def _of_udl(text: str, name: str) -> ReadRows:
    """Rows of EOObservation records, by the names of their fields."""
    import json

    with value_errors_as(ExportError, f"{name} is not JSON: "):
        records = parse_json(text)
    if not isinstance(records, list):
        raise ExportError(f"{name}: a list of records belongs there")
    lines: list[str] = []
    faults: list[str] = []
    for number, each in enumerate(records, start=1):
        try:
            lines.append(json.dumps(_plain_record(each, name, number)))
        except ExportError as error:
            faults.append(str(error))
    if not lines and faults:
        raise ExportError(faults[0])
    read = read_table("\n".join(lines), name)
    return replace(read, not_used=(*faults, *read.not_used))


def _plain_record(record: object, name: str, number: int) -> dict[str, object]:
    if not isinstance(record, dict):
        raise ExportError(f"{name}, record {number}: an object belongs there")
    if record.get("referenceFrame") not in (None, "J2000", "GCRF"):
        raise ExportError(f"{name}, record {number}: only J2000 and GCRF are read")
    try:
        dec = float(record["declination"])
        cos_dec = math.cos(math.radians(dec))
        row: dict[str, object] = {
            "time": str(record["obTime"]),
            "ra_deg": float(record["ra"]),
            "dec_deg": dec,
            "object": record.get("satNo") or record.get("origObjectId"),
            "station": record.get("origSensorId") or record.get("idSensor"),
            "lat_deg": record.get("senlat"),
            "lon_deg": record.get("senlon"),
            "mag": record.get("mag"),
            "mag_sigma": record.get("magUnc"),
        }
        height_km = record.get("senalt")
        row["alt_m"] = None if height_km is None else 1000.0 * float(height_km)
        for key, axis, scale in (("raUnc", "ra", cos_dec), ("declinationUnc", "dec", 1.0)):
            value = record.get(key)
            row[f"sigma_{axis}_arcsec"] = None if value is None else 3600.0 * scale * float(value)
    except (KeyError, TypeError, ValueError) as error:
        raise ExportError(f"{name}, record {number}: {error!r} is missing or no number") from error
    return row


def _in_degrees(read: ReadRows, path: Path, ask: ReadOptions) -> ReadRows:
    rows = read.rows
    if ask.is_radians and any(each.is_degrees for each in rows):
        raise OrbitError(
            f"{path} says its unit itself, by its form or its columns' names: leave --radians out"
        )
    if ask.is_radians:
        rows = tuple(
            replace(
                each,
                ra_icrs_deg=math.degrees(each.ra_icrs_deg),
                dec_icrs_deg=math.degrees(each.dec_icrs_deg),
            )
            for each in rows
        )
    if ask.is_radians is None and not all(each.is_degrees for each in rows):
        is_small = all(
            abs(each.ra_icrs_deg) <= 2.0 * math.pi and abs(each.dec_icrs_deg) <= 0.5 * math.pi
            for each in rows
        )
        if len(rows) > 1 and is_small:
            raise OrbitError(
                f"{path}: every RA is below 6.284 and every Dec within 1.571, as radians are: say"
                " --radians or --degrees"
            )
    return replace(read, rows=rows)


def _sound(read: ReadRows) -> ReadRows:
    """The rows that are directions with errors. Raises ExportError where none is."""
    sound: list[ObservedRow] = []
    faults: list[str] = []
    known: dict[ObservedRow, str] = {}
    for each in read.rows:
        fault = _fault(each)
        key = replace(each, where="", mag=None, mag_sigma=None, band=None)
        if fault:
            faults.append(f"{each.where}: {fault}")
        elif key in known:
            faults.append(f"{each.where}: the same observation as {known[key]}")
        else:
            known[key] = each.where
            sound.append(replace(each, ra_icrs_deg=each.ra_icrs_deg % 360.0))
    if faults and not sound:
        raise ExportError(faults[0])
    return replace(read, rows=tuple(sound), not_used=(*read.not_used, *faults))


def _fault(row: ObservedRow) -> str:
    """What keeps a row from use; empty where nothing does."""
    if fault := direction_fault(row.ra_icrs_deg, row.dec_icrs_deg):
        return fault
    sigmas = (row.sigma_ra_arcsec, row.sigma_dec_arcsec)
    if any(each is not None and not each > 0.0 for each in sigmas) or abs(row.correlation) >= 1.0:
        return "a sigma must be above 0, a correlation within 1"
    if row.time_sigma_s is not None and not 0.0 <= row.time_sigma_s <= _MAX_TIME_SIGMA_S:
        return f"an error of time is from 0 to {_MAX_TIME_SIGMA_S:.0f} s"
    if row.is_horizontal and row.dec_icrs_deg < _MIN_ELEVATION_DEG:
        return f"an elevation of {row.dec_icrs_deg:.1f} deg is below the horizon"
    return ""


def _of_one(
    rows: tuple[ObservedRow, ...], path: Path, wanted: str | None
) -> tuple[ObservedRow, ...]:
    """Rows of one object. Raises OrbitError that lists the objects of several."""
    counted = Counter(each.target for each in rows)
    if wanted is not None:
        chosen = tuple(each for each in rows if each.target == wanted)
        if chosen:
            return chosen
        raise OrbitError(f"{path} has no object {wanted!r}: it has {_listed(counted)}")
    if len(counted) > 1:
        raise OrbitError(
            f"{path} holds {len(counted)} objects: {_listed(counted)}; say which with --object"
        )
    return rows


def _listed(counted: "Counter[str | None]") -> str:
    words = [f"{name or 'unnamed'} ({count})" for name, count in counted.most_common(_LISTED)]
    more = len(counted) - len(words)
    return ", ".join(words) + (f" and {more} more" if more > 0 else "")


def _of_station(
    path: Path,
    station: str | None,
    rows: Sequence[ObservedRow],
    known: tuple[ReadOptions, Stations | None],
) -> ObservedTrack:
    """``known``: options of reading, and the list of stations."""
    ask, stations = known
    site = _site(path, (station, rows[0].site), ask, stations)
    t = np.array([each.t_utc_ns for each in rows], np.int64)
    ra = np.array([each.ra_icrs_deg for each in rows])
    dec = np.array([each.dec_icrs_deg for each in rows])
    seen_high = np.array([each.is_horizontal for each in rows])
    if np.any(seen_high):
        ra[seen_high], dec[seen_high] = _of_horizon(
            site, ra[seen_high], dec[seen_high], t[seen_high]
        )
    cov = np.array([_covariance(each, ask.sigma_arcsec) for each in rows])
    late_s = np.array([each.time_sigma_s or 0.0 for each in rows])
    name = path.name if station is None else f"{path.name}, station {station}"
    with value_errors_as(OrbitError, f"{path}: "):
        seen = reduce_directions(site, t, ra, dec, cov, time_sigma_s=late_s)
    return ObservedTrack(name=name, site=site, limits=None, seen=seen)


def _of_horizon(
    site: Site, azimuth_deg: FloatArray, elevation_deg: FloatArray, t_utc_ns: IntArray
) -> tuple[FloatArray, FloatArray]:
    """ICRS directions, (N,) degrees each, of azimuths and elevations as seen: refraction is removed
    as of air at 10 C.
    """
    altitude_deg = elevation_deg
    for _ in range(4):
        altitude_deg = elevation_deg - refraction_deg(altitude_deg)
    return altaz_to_icrs(site, altitude_deg, azimuth_deg, t_utc_ns)


def _site(
    path: Path, seer: tuple[str | None, Site | None], ask: ReadOptions, stations: Stations | None
) -> Site:
    """``seer``: the station's number, and its site where the file itself states one."""
    station, site = seer
    if site is not None:
        return site
    if stations is not None and station is not None:
        listed = stations.site(station)
        if listed is not None:
            return listed
        if stations.not_used and not stations.sites:
            raise ExportError(stations.not_used[0])
    if ask.site is not None:
        return ask.site
    who = "its station" if station is None else f"station {station}"
    raise OrbitError(f"{path} does not say where {who} stands: {SITE_USAGE}")


def _covariance(row: ObservedRow, sigma_arcsec: float) -> tuple[float, float, float]:
    east = sigma_arcsec if row.sigma_ra_arcsec is None else row.sigma_ra_arcsec
    north = east if row.sigma_dec_arcsec is None else row.sigma_dec_arcsec
    return east**2, row.correlation * east * north, north**2
