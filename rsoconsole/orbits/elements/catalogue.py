"""Catalogues as people publish them: two-line elements, or OMM as XML, JSON or CSV. Pure.

Source of OMM: CCSDS 502.0-B-3, as CelesTrak and Space-Track write it; its fields are read by the
package sgp4. An OMM may carry catalogue numbers that two lines have no room for.
"""

import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from sgp4 import omm
from sgp4.api import Satrec, SatrecArray

from rsoconsole.errors import OrbitError
from rsoconsole.foreign_text import json_of
from rsoconsole.orbits.elements.elements import ElementSet, parse_elements
from rsoconsole.records import FloatArray, Site
from rsoconsole.sky import (
    IntArray,
    Places,
    astrometric_places,
    iso_to_utc_ns,
    jd_utc,
    teme_to_gcrs_rotation,
    utc_ns_to_iso,
)

_OF_TWO_LINES = {
    "CLASSIFICATION_TYPE": "U",
    "OBJECT_ID": "",
    "EPHEMERIS_TYPE": "0",
    "ELEMENT_SET_NO": "0",
    "REV_AT_EPOCH": "0",
    "MEAN_MOTION_DDOT": "0",
}
"""What an OMM may leave out, and SGP4 does without."""
_MOST_ALPHA_5 = 339_999
MOST_SETS = 200_000
"""Everything ever catalogued three times over; of more every answer would take minutes."""
_SGP4_THEORIES = {"SGP4", "SGP/SGP4", "SGP"}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CatalogueEntry:
    """One element set of one object, ready for SGP4."""

    name: str
    norad_id: int
    epoch_utc_ns: int
    record: Satrec

    @property
    def revolutions_a_day(self) -> float:
        """Mean motion as published."""
        return float(self.record.no_kozai) * 720.0 / np.pi

    @property
    def eccentricity(self) -> float:
        """As published."""
        return float(self.record.ecco)


def parse_catalogue(text: str, source: str = "catalogue") -> tuple[CatalogueEntry, ...]:
    """Every element set of a text, whichever of the formats it is in.

    Raises OrbitError, naming ``source`` and the line or the object, for a text that cannot be read
    and for one without any element set.
    """
    text = text.removeprefix("\ufeff")
    start = text.lstrip()
    _expect_so_many(start, source)
    if start.startswith("<"):
        found = _of_messages(_xml(start, source), source)
    elif start.startswith(("[", "{")):
        found = _of_messages(_json(start, source), source)
    elif _is_table(start):
        found = _of_messages(omm.parse_csv(io.StringIO(start)), source)
    else:
        found = tuple(_of_lines(each) for each in parse_elements(text, source))
    if not found:
        raise OrbitError(f"{source} holds no element set: fetch it again, as TLE or OMM")
    return found


def nearest_in_epoch_of_each(
    entries: Iterable[CatalogueEntry], t_utc_ns: int
) -> tuple[CatalogueEntry, ...]:
    """One entry for each object, the nearest in epoch, in order of catalogue number."""
    best: dict[int, CatalogueEntry] = {}
    for each in entries:
        rival = best.get(each.norad_id)
        if rival is None or abs(each.epoch_utc_ns - t_utc_ns) < abs(rival.epoch_utc_ns - t_utc_ns):
            best[each.norad_id] = each
    return tuple(best[number] for number in sorted(best))


def states_gcrs(
    entries: Sequence[CatalogueEntry], t_utc_ns: IntArray
) -> tuple[FloatArray, FloatArray]:
    """GCRS positions and velocities (M, N, 3) of M objects at N instants, km and km/s.

    NaN where SGP4 fails (decayed, or elements that it refuses).
    """
    t = np.atleast_1d(np.asarray(t_utc_ns, np.int64))
    if not entries:
        return np.empty((0, len(t), 3)), np.empty((0, len(t), 3))
    jd_1, jd_2 = jd_utc(t)
    failed, r_teme, v_teme = SatrecArray([each.record for each in entries]).sgp4(
        np.ascontiguousarray(jd_1), np.ascontiguousarray(jd_2)
    )
    rotation = teme_to_gcrs_rotation(t)
    is_good = (failed == 0)[..., None]
    r = np.einsum("nij,mnj->mni", rotation, r_teme)
    v = np.einsum("nij,mnj->mni", rotation, v_teme)
    return np.where(is_good, r, np.nan), np.where(is_good, v, np.nan)


def places_of(entry: CatalogueEntry, site: Site, t_utc_ns: IntArray) -> Places:
    """Where one object is seen at instants (N,), as a plate solution measures it; NaN as above."""

    def position_of(at: IntArray) -> tuple[FloatArray, FloatArray]:
        r, v = states_gcrs((entry,), at)
        return r[0], v[0]

    return astrometric_places(position_of, site, t_utc_ns)


def _expect_so_many(start: str, source: str) -> None:
    """Raises OrbitError before the work where there are too many sets; nothing is parsed yet."""
    if start.startswith(("<", "[", "{")):
        mark = "<NORAD_CAT_ID" if start.startswith("<") else '"NORAD_CAT_ID"'
        found = start.count(mark)
    else:
        found = start.rstrip().count("\n" if _is_table(start) else "\n2 ")
    if found > MOST_SETS:
        raise OrbitError(
            f"{source} holds {found:,} element sets, {MOST_SETS:,} at most can be used: keep those"
            " of the last days, one for each object"
        )


def _is_table(start: str) -> bool:
    return "NORAD_CAT_ID" in start.partition("\n")[0]


def _of_lines(element_set: ElementSet) -> CatalogueEntry:
    try:
        record = Satrec.twoline2rv(element_set.line_1, element_set.line_2)
    except ValueError as error:
        raise OrbitError(f"satellite {element_set.norad_id}: {error}; fetch it again") from error
    return CatalogueEntry(
        name=element_set.name,
        norad_id=element_set.norad_id,
        epoch_utc_ns=element_set.epoch_utc_ns,
        record=record,
    )


def _xml(text: str, source: str) -> Sequence[Mapping[str, Any]]:
    from xml.etree.ElementTree import ParseError

    try:
        return list(omm.parse_xml(io.StringIO(text)))
    except (ParseError, AttributeError, TypeError) as error:
        raise OrbitError(f"{source} is no OMM in XML: {error}; fetch it again") from error


def _json(text: str, source: str) -> Sequence[Mapping[str, Any]]:
    try:
        read = json_of(text)
    except ValueError as error:
        raise OrbitError(f"{source} is no OMM in JSON: {error}; fetch it again") from error
    messages = read if isinstance(read, list) else [read]
    if not all(isinstance(each, dict) for each in messages):
        raise OrbitError(f"{source} is no OMM in JSON: a list of objects is needed; fetch it again")
    return messages


def _of_messages(messages: Iterable[Mapping[str, Any]], source: str) -> tuple[CatalogueEntry, ...]:
    return tuple(
        _of_message(each, f"{source}, object {number}")
        for number, each in enumerate(messages, start=1)
    )


def _of_message(message: Mapping[str, Any], where: str) -> CatalogueEntry:
    fields = {str(key): str(value).strip() for key, value in message.items() if value is not None}
    for key, allowed in (("MEAN_ELEMENT_THEORY", _SGP4_THEORIES), ("TIME_SYSTEM", {"UTC"})):
        if fields.get(key) and fields[key].upper() not in allowed:
            raise OrbitError(f"{where}: {key} is {fields[key]}; only {min(allowed)} can be used")
    fields = {**_OF_TWO_LINES, **{key: value for key, value in fields.items() if value}}
    try:
        norad_id = int(fields["NORAD_CAT_ID"])
        epoch_utc_ns = iso_to_utc_ns(fields["EPOCH"])
        fields["EPOCH"] = utc_ns_to_iso(epoch_utc_ns, 6).removesuffix("Z")
        fields["NORAD_CAT_ID"] = str(norad_id if norad_id <= _MOST_ALPHA_5 else 0)
        record = Satrec()
        omm.initialize(record, fields)
    except KeyError as error:
        raise OrbitError(f"{where}: {error.args[0]} is missing; fetch it again") from error
    except ValueError as error:
        raise OrbitError(f"{where}: {error}; fetch it again") from error
    return CatalogueEntry(
        name=fields.get("OBJECT_NAME", ""),
        norad_id=norad_id,
        epoch_utc_ns=epoch_utc_ns,
        record=record,
    )
