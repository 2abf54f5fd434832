"""Writer of CCSDS Tracking Data Messages 2.0 (503.0-B-2): the measurements of tracks.

One segment a track, in keyword = value form: right ascension and declination in degrees at
mid-exposure, UTC. The standard has no keyword for the error of an angle; here the errors of each
epoch stand in a comment of the data section, ``SIGMA epoch sigma_ra_arcsec sigma_dec_arcsec
correlation`` (sigma_ra on the sky, times cos Dec), which ``_tdm_reader`` reads and every other
reader ignores. Magnitudes in V are ``MAG`` records of the same epochs, as observed: nothing is
corrected for distance or phase, so there is no ``CORRECTION_MAG``. Their errors stand in comments
``SIGMA_MAG epoch sigma``.

Directions are ICRS but called EME2000, the name that readers of angles expect: the two differ by
0.02 arcsec, less than any error here. The directions are relative to catalogue stars, so that they
contain no annual and no diurnal aberration; the keywords say so and state the size of both.
"""

import math
import re
import unicodedata
from collections.abc import Iterator
from pathlib import PurePath
from xml.etree import ElementTree
from xml.sax.saxutils import escape

import numpy as np

from rsoconsole.base import ExportError
from rsoconsole.library.formats.night import ExportedNight
from rsoconsole.library.formats.rows import MeasuredRow
from rsoconsole.library.formats.target import Target, identification_words
from rsoconsole.records import Site
from rsoconsole.sky import (
    LIGHT_KM_S,
    day_of,
    direction_to_unit,
    earth_velocity_km_s,
    hour_angle_icrs_deg,
    wrap_360,
)
from rsoconsole.words import shutter_words, utc_ns_to_iso

VERSION = "2.0"
ANGLE_DECIMALS = 9
MAG_DECIMALS = 4
LONGEST_LINE = 254
ORIGINATOR = "RSOCONSOLE"
EQUATOR_KM_S = 7.292115e-5 * 6378.137
"""Speed of the Earth's surface at the equator, km/s."""


def to_tdm(
    night: ExportedNight,
    tracks: tuple[int, ...],
    *,
    target: Target,
    created_utc_ns: int,
    originator: str = ORIGINATOR,
) -> str:
    """Return a message with the measurements assigned to these tracks, one segment for each.

    Streaks cut by the frame's edge are left out: their position along the streak is not
    measured.
    """
    lines = [
        f"CCSDS_TDM_VERS = {VERSION}",
        f"COMMENT Session {night.name}: {night.title}",
        *(["COMMENT SIMULATED: no telescope observed this"] if night.is_simulated else []),
        *(f"COMMENT CLOCK {each}" for each in night.clock_notes),
        f"CREATION_DATE = {_epoch(created_utc_ns, 3)}",
        f"ORIGINATOR = {_name(originator)}",
    ]
    for track in tracks:
        rows = unclipped_rows(night.track_measurements(track))
        if rows:
            lines.extend(_segment(night, track, rows, target))
    return "".join(_ascii(line)[:LONGEST_LINE].rstrip() + "\n" for line in lines)


def unclipped_rows(rows: tuple[MeasuredRow, ...]) -> tuple[MeasuredRow, ...]:
    """Return the measurements of streaks that are not cut by the frame's edge."""
    return tuple(row for row in rows if not row.is_clipped)


def _segment(
    night: ExportedNight, track: int, rows: tuple[MeasuredRow, ...], target: Target
) -> Iterator[str]:
    yield "META_START"
    yield from _metadata(night, track, rows, target)
    yield "META_STOP"
    yield "DATA_START"
    for row in rows:
        errors = f"{row.sigma_ra_arcsec:.6g} {row.sigma_dec_arcsec:.6g} {row.correlation:.4f}"
        yield f"COMMENT SIGMA {_epoch(row.t_mid_utc_ns)} {errors}"
    yield from _magnitude_comments(rows)
    for row in rows:
        epoch = _epoch(row.t_mid_utc_ns)
        yield f"ANGLE_1 = {epoch} {_ra(row.ra_icrs_deg)}"
        yield f"ANGLE_2 = {epoch} {_dec(row.dec_icrs_deg)}"
        if row.mag_v is not None:
            yield f"MAG = {epoch} {row.mag_v:.{MAG_DECIMALS}f}"
    yield "DATA_STOP"


def _magnitude_comments(rows: tuple[MeasuredRow, ...]) -> Iterator[str]:
    if any(row.mag_v is not None for row in rows):
        yield "COMMENT MAG: apparent magnitude in Johnson V by catalogue stars in the same frame"
    for row in rows:
        if row.mag_v is not None and row.sigma_mag is not None:
            yield f"COMMENT SIGMA_MAG {_epoch(row.t_mid_utc_ns)} {row.sigma_mag:.{MAG_DECIMALS}f}"


def _metadata(
    night: ExportedNight, track: int, rows: tuple[MeasuredRow, ...], target: Target
) -> Iterator[str]:
    site, optics = night.config.site.to_site(), night.config.optics
    middle = rows[len(rows) // 2]
    annual_deg, diurnal_deg = aberration_deg(
        site, middle.ra_icrs_deg, middle.dec_icrs_deg, middle.t_mid_utc_ns
    )
    exposure_s = next((row.exposure_s for row in rows if row.exposure_s is not None), None)
    yield (
        f"COMMENT Site WGS84: latitude {site.latitude_deg:.6f} deg, longitude"
        f" {site.longitude_deg:.6f} deg east, height {site.elevation_m:.1f} m"
    )
    yield (
        f"COMMENT Telescope: focal length {optics.focal_length_mm:g} mm, pixels of"
        f" {optics.pixel_um:g} um; angles by streaks against catalogue stars"
    )
    if night.config.exposure.calibrated:
        yield f"COMMENT Times: {_shutter_words(night, rows)}"
    time_sigma_s = night.time_sigma_s(middle)
    yield f"COMMENT Times: mid-exposure; one sigma of the shutter {time_sigma_s:.3g} s"
    if track in night.names:
        yield f"COMMENT Track {track} {identification_words(night.names[track])}"
    yield "COMMENT Angles are astrometric and along ICRS axes; EME2000 differs by 0.02 arcsec"
    yield "COMMENT CORRECTION_ABERRATION: size on the sky of what was taken out, deg"
    yield "COMMENT SIGMA in the data section: epoch, RA times cos Dec (arcsec), Dec (arcsec),"
    yield "COMMENT correlation of both"
    yield f"TRACK_ID = {_name(PurePath(night.name).name)}_{track}"
    has_magnitudes = any(row.mag_v is not None for row in rows)
    yield f"DATA_TYPES = ANGLE_1,ANGLE_2{',MAG' if has_magnitudes else ''}"
    yield "TIME_SYSTEM = UTC"
    yield f"START_TIME = {_epoch(rows[0].t_mid_utc_ns)}"
    yield f"STOP_TIME = {_epoch(rows[-1].t_mid_utc_ns)}"
    yield f"PARTICIPANT_1 = {_name(night.config.site.name) or 'SITE'}"
    yield f"PARTICIPANT_2 = {target.tdm_name(track)}"
    yield "MODE = SEQUENTIAL"
    yield "PATH = 2,1"
    yield "TIMETAG_REF = RECEIVE"
    if exposure_s is not None:
        yield f"INTEGRATION_INTERVAL = {exposure_s:.6f}"
    yield "INTEGRATION_REF = MIDDLE"
    yield "ANGLE_TYPE = RADEC"
    yield "REFERENCE_FRAME = EME2000"
    yield "DATA_QUALITY = VALIDATED"
    yield f"CORRECTION_ABERRATION_YEARLY = {annual_deg:.7f}"
    yield f"CORRECTION_ABERRATION_DIURNAL = {diurnal_deg:.7f}"
    yield "CORRECTIONS_APPLIED = YES"


def _shutter_words(night: ExportedNight, rows: tuple[MeasuredRow, ...]) -> str:
    words = shutter_words(night.config.exposure, day_of(rows[0].t_mid_utc_ns))
    return words.replace("±", "+-").replace("µs", "us")


def aberration_deg(
    site: Site, ra_icrs_deg: float, dec_icrs_deg: float, t_utc_ns: int
) -> tuple[float, float]:
    """Return the (annual, diurnal) aberration of a star in a direction, degrees on the sky."""
    line = direction_to_unit(ra_icrs_deg, dec_icrs_deg)
    velocity = earth_velocity_km_s(t_utc_ns)
    across_km_s = velocity - np.dot(velocity, line) * line
    hour_angle_deg = hour_angle_icrs_deg(site, ra_icrs_deg, dec_icrs_deg, t_utc_ns)
    to_east = math.cos(math.radians(dec_icrs_deg)) * math.sin(math.radians(hour_angle_deg))
    speed_km_s = EQUATOR_KM_S * math.cos(math.radians(site.latitude_deg))
    diurnal = speed_km_s * math.sqrt(max(1.0 - to_east**2, 0.0)) / LIGHT_KM_S
    return math.degrees(float(np.linalg.norm(across_km_s)) / LIGHT_KM_S), math.degrees(diurnal)


def _epoch(t_utc_ns: int, decimals: int = 9) -> str:
    """Epoch without trailing zeros, but with milliseconds; it reads back as the same instant."""
    whole_s, point, digits = utc_ns_to_iso(t_utc_ns, decimals).removesuffix("Z").partition(".")
    return f"{whole_s}{point}{digits.rstrip('0').ljust(3, '0')}"


def _ra(ra_deg: float) -> str:
    text = f"{wrap_360(ra_deg):.{ANGLE_DECIMALS}f}"
    return f"{0.0:.{ANGLE_DECIMALS}f}" if text.startswith("360") else text


def _dec(dec_deg: float) -> str:
    text = f"{dec_deg:.{ANGLE_DECIMALS}f}"
    return text.removeprefix("-") if not text.strip("-0.") else text


def _name(text: str) -> str:
    """Text as a keyword's value: capitals, no blanks."""
    return re.sub(r"[^A-Z0-9.+-]+", "_", _ascii(text).upper()).strip("_")


def _ascii(text: str) -> str:
    """Text without accents, in one line: a line break in a title would end it."""
    bare = "".join(c for c in unicodedata.normalize("NFKD", text) if not unicodedata.combining(c))
    plain = bare.encode("ascii", "replace").decode()
    return "".join(c if c.isprintable() else " " for c in plain)


_NAMESPACES = (
    'xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"'
    ' xsi:noNamespaceSchemaLocation="https://sanaregistry.org/files/ndmxml_unqualified/'
    'ndmxml-3.0.0-master-3.0.xsd"'
)
_DEG = {"ANGLE_1", "ANGLE_2"}


def tdm_to_xml(text: str) -> str:
    """Convert a message of ``to_tdm`` from keyword = value form to XML."""
    out: list[str] = ['<?xml version="1.0" encoding="UTF-8"?>']
    section = "header"
    header: list[str] = []
    for line in text.splitlines():
        keyword, _, value = (part.strip() for part in line.partition("="))
        if keyword == "CCSDS_TDM_VERS":
            out.append(f'<tdm {_NAMESPACES} id="CCSDS_TDM_VERS" version="{value}">')
        elif line == "META_START":
            if section == "header":
                out += ["<header>", *header, "</header>", "<body>"]
            out += ["<segment>", "<metadata>"]
            section = "metadata"
        elif line in _MARKS:
            out += _MARKS[line]
            section = "data" if line == "DATA_START" else section
        elif line.startswith("COMMENT"):
            comment = f"<COMMENT>{escape(line.removeprefix('COMMENT').strip())}</COMMENT>"
            (header if section == "header" else out).append(comment)
        elif section == "data":
            epoch, number = value.split()
            unit = ' units="deg"' if keyword in _DEG else ""
            datum = f"<{keyword}{unit}>{number}</{keyword}>"
            out.append(f"<observation><EPOCH>{epoch}</EPOCH>{datum}</observation>")
        else:
            element = f"<{keyword}>{escape(value)}</{keyword}>"
            (header if section == "header" else out).append(element)
    return "\n".join([*out, "</body>", "</tdm>", ""])


_MARKS = {
    "META_STOP": ["</metadata>"],
    "DATA_START": ["<data>"],
    "DATA_STOP": ["</data>", "</segment>"],
}


def tdm_lines_from_xml(text: str, name: str) -> list[str]:
    """Convert a message in XML to lines of keyword = value; ``name`` is what errors call it.

    Raises ExportError for a text that is no such message.
    """
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise ExportError(f"{name}: a document type has no place in a Tracking Data Message")
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError, RecursionError) as error:
        raise ExportError(f"{name} is no XML: {error}") from error
    found = root if _tag(root) == "tdm" else next((e for e in root if _tag(e) == "tdm"), None)
    if found is None:
        raise ExportError(f"{name} holds no Tracking Data Message: its root is <{_tag(root)}>")
    return list(_lines(found))


def _lines(tdm: ElementTree.Element) -> Iterator[str]:
    yield f"CCSDS_TDM_VERS = {tdm.get('version') or 'none'}"
    for part in tdm:
        if _tag(part) == "header":
            yield from map(_line, part)
        elif _tag(part) == "body":
            for segment in part:
                yield from _of_segment(segment)


def _of_segment(segment: ElementTree.Element) -> Iterator[str]:
    for part in segment:
        kind = "META" if _tag(part) == "metadata" else "DATA"
        yield f"{kind}_START"
        for each in part:
            if _tag(each) != "observation":
                yield _line(each)
                continue
            epoch = next((_text(e) for e in each if _tag(e) == "EPOCH"), "none")
            yield from (f"{_tag(e)} = {epoch} {_text(e)}" for e in each if _tag(e) != "EPOCH")
        yield f"{kind}_STOP"


def _line(element: ElementTree.Element) -> str:
    if _tag(element) == "COMMENT":
        return f"COMMENT {_text(element)}".strip()
    return f"{_tag(element)} = {_text(element)}"


def _tag(element: ElementTree.Element) -> str:
    return str(element.tag).rpartition("}")[2]


def _text(element: ElementTree.Element) -> str:
    return " ".join((element.text or "").split())
