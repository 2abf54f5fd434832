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
    MAX_DATA_BYTES,
    ExportError,
    OrbitError,
    parse_json,
    read_foreign_text,
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
    ecsv_site,
    looks_like_table,
    read_station_sites,
    read_table,
)
from rsoconsole.library.formats._observed_tdm import observed_rows_of_tdm
from rsoconsole.library.formats._tdm_reader import parse_tdm
from rsoconsole.orbits import reduce_directions
from rsoconsole.pipeline import ObservedTrack, read_observed_tracks
from rsoconsole.records import FloatArray, Site
from rsoconsole.sky import equinox_to_icrs
from rsoconsole.words import NS_PER_S, direction_fault

_LISTED = 8
_SITE_LINE = re.compile(r"# (\w{4}) (-?\d+\.\d+) (-?\d+\.\d+) (-?\d+) m \(WGS84, east positive\)")
"""Comment line with a station's place, as ``iod`` writes it."""
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
    rows = _rows(text, path)
    if rows is None:
        if ask.is_radians:
            raise OrbitError(f"{path} is JSON, whose angles are degrees: write them so")
        return (read_observed_tracks(path, sigma_arcsec=ask.sigma_arcsec, site=ask.site),)
    rows = _in_degrees(rows, path, ask)
    rows = _of_one(rows, path, ask.target)
    stations: dict[tuple[str | None, Site | None], list[ObservedRow]] = {}
    for each in rows:
        stations.setdefault((each.station, each.site), []).append(each)
    return tuple(_of_station(path, name, own, ask) for (name, _), own in stations.items())


def _text(path: Path) -> str:
    with value_errors_as(OrbitError, f"{path} cannot be read: ", (OSError, UnicodeDecodeError)):
        return read_foreign_text(path, most_bytes=MAX_DATA_BYTES).removeprefix("\ufeff")


def _rows(text: str, path: Path) -> tuple[ObservedRow, ...] | None:
    """The file's rows, by what it is; None for the program's own JSON."""
    name = str(path)
    start = text.lstrip()
    if start.startswith(("CCSDS_TDM_VERS", "<")):
        return observed_rows_of_tdm(parse_tdm(text, name), name)
    if start.startswith("[") and '"obTime"' in start:
        return _of_udl(start, name)
    if looks_like_table(text):
        site = ecsv_site(text) if "%ECSV" in text[:200] else None
        return tuple(
            each if each.site is not None else replace(each, site=site)
            for each in read_table(text, name)
        )
    if start.startswith(("{", "[")):
        return None
    return _of_lines(text, name)


def _of_lines(text: str, name: str) -> tuple[ObservedRow, ...]:
    """Rows of IOD and UK lines, also among the other text of a mail."""
    found: list[tuple[IodObservation, str, Site | None]] = []
    fault: str | None = None
    places: dict[str, Site] = {}
    for number, line in enumerate(text.splitlines(), start=1):
        if (line_found := _SITE_LINE.match(line)) is not None:
            latitude, longitude, height = (float(line_found[n]) for n in (2, 3, 4))
            places[line_found[1]] = Site(
                latitude_deg=latitude, longitude_deg=longitude, elevation_m=height
            )
        if not line.strip() or line.startswith("#"):
            continue
        where = f"{name}, line {number}"
        try:
            each = parse_uk_line(line) if is_uk_line(line) else parse_iod_line(line)
        except ExportError as error:
            fault = fault or f"{where}: {error}"
            continue
        if each.angle_format in HORIZONTAL:
            horizontal = "only right ascension and declination are read"
            fault = fault or f"{where}: azimuth and elevation: {horizontal}"
        elif each.first_deg is not None:
            found.append((each, where, places.get(each.station)))
    if not found:
        raise ExportError(
            fault
            or f"{name} holds no observations: TDM, IOD or UK lines, CSV with named columns, and"
            " JSON are read"
        )
    ra, dec = _directions([each for each, _, _ in found])
    return tuple(
        _of_line(each, where, site, (float(ra[n]), float(dec[n])))
        for n, (each, where, site) in enumerate(found)
    )


def _directions(lines: Sequence[IodObservation]) -> tuple[FloatArray, FloatArray]:
    """ICRS directions, (N,) degrees each, of lines on charts of any equinox."""
    ra = np.array([each.first_deg for each in lines], np.float64)
    dec = np.array([each.second_deg for each in lines], np.float64)
    t_utc_ns = np.array([each.t_utc_ns for each in lines], np.int64)
    for year in {each.epoch_year for each in lines}:
        of_it = np.array([each.epoch_year == year for each in lines])
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
    )


def _of_udl(text: str, name: str) -> tuple[ObservedRow, ...]:
    """Rows of EOObservation records, by the names of their fields."""
    import json

    with value_errors_as(ExportError, f"{name} is not JSON: "):
        records = parse_json(text)
    lines = [json.dumps(_plain_record(each, name, n)) for n, each in enumerate(records, 1)]
    return read_table("\n".join(lines), name)


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
        }
        height_km = record.get("senalt")
        row["alt_m"] = None if height_km is None else 1000.0 * float(height_km)
        for key, axis, scale in (("raUnc", "ra", cos_dec), ("declinationUnc", "dec", 1.0)):
            value = record.get(key)
            row[f"sigma_{axis}_arcsec"] = None if value is None else 3600.0 * scale * float(value)
    except (KeyError, TypeError, ValueError) as error:
        raise ExportError(f"{name}, record {number}: {error!r} is missing or no number") from error
    return row


def _in_degrees(
    rows: tuple[ObservedRow, ...], path: Path, ask: ReadOptions
) -> tuple[ObservedRow, ...]:
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
    for each in rows:
        if fault := direction_fault(each.ra_icrs_deg, each.dec_icrs_deg):
            raise ExportError(f"{each.where}: {fault}")
    if ask.is_radians is None and not all(each.is_degrees for each in rows):
        is_small = all(
            each.ra_icrs_deg <= 2.0 * math.pi and abs(each.dec_icrs_deg) <= 0.5 * math.pi
            for each in rows
        )
        if len(rows) > 1 and is_small:
            raise OrbitError(
                f"{path}: every RA is below 6.284 and every Dec within 1.571, as radians are: say"
                " --radians or --degrees"
            )
    return tuple(replace(each, ra_icrs_deg=each.ra_icrs_deg % 360.0) for each in rows)


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
    path: Path, station: str | None, rows: Sequence[ObservedRow], ask: ReadOptions
) -> tuple[ObservedTrack, ...]:
    site = _site(path, station, rows, ask)
    t = np.array([each.t_utc_ns for each in rows], np.int64)
    ra = np.array([each.ra_icrs_deg for each in rows])
    dec = np.array([each.dec_icrs_deg for each in rows])
    cov = np.array([_covariance(each, ask.sigma_arcsec) for each in rows])
    late_s = np.array([each.time_sigma_s or 0.0 for each in rows])
    name = path.name if station is None else f"{path.name}, station {station}"
    with value_errors_as(OrbitError, f"{path}: "):
        seen = reduce_directions(site, t, ra, dec, cov, time_sigma_s=late_s)
    return (ObservedTrack(name=name, site=site, limits=None, seen=seen),)


def _site(path: Path, station: str | None, rows: Sequence[ObservedRow], ask: ReadOptions) -> Site:
    if rows[0].site is not None:
        return rows[0].site
    if ask.stations is not None and station is not None:
        places = read_station_sites(ask.stations, _text(ask.stations))
        if station in places:
            return places[station]
    if ask.site is not None:
        return ask.site
    who = "its station" if station is None else f"station {station}"
    raise OrbitError(f"{path} does not say where {who} stands: {SITE_USAGE}")


def _covariance(row: ObservedRow, sigma_arcsec: float) -> tuple[float, float, float]:
    east = sigma_arcsec if row.sigma_ra_arcsec is None else row.sigma_ra_arcsec
    north = east if row.sigma_dec_arcsec is None else row.sigma_dec_arcsec
    if east <= 0.0 or north <= 0.0 or abs(row.correlation) >= 1.0:
        raise ExportError(f"{row.where}: a sigma must be above 0, a correlation within 1")
    return east**2, row.correlation * east * north, north**2
