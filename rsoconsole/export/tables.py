"""Measurements as tables: CSV (RFC 4180), ECSV (astropy's, with units), JSON lines.

All three carry every float in its shortest exact form, so that what is read is what was written.
Missing is an empty field in CSV, a masked one in ECSV, null in JSON.
"""

import csv
import io
import json
import warnings
from collections.abc import Iterable, Sequence
from typing import Any

from rsoconsole.export.night import ExportedNight
from rsoconsole.export.rows import COLUMNS, MeasuredRow
from rsoconsole.sky import jd_utc

_NAMES = tuple(column.name for column in COLUMNS)
TIME, DIRECTION = "t_mid_utc", "direction"


def to_csv(rows: Iterable[MeasuredRow]) -> str:
    """A head line with the columns' names, then a line a measurement."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(_NAMES)
    for row in rows:
        writer.writerow([_csv_field(row.value(name)) for name in _NAMES])
    return text.getvalue()


def to_jsonl(rows: Iterable[MeasuredRow]) -> str:
    """One object a measurement, a line each."""
    return "".join(
        json.dumps({name: row.value(name) for name in _NAMES}, allow_nan=False) + "\n"
        for row in rows
    )


def to_ecsv(night: ExportedNight) -> str:
    """A table with units, descriptions and, as ``meta``, what ``ExportedNight.facts`` tells.

    Read back by astropy, ``t_mid_utc`` is a ``Time`` and ``direction`` a ``SkyCoord``.
    """
    from astropy.table import MaskedColumn, Table

    types = {"integer": "int64", "real": "float64", "truth": "bool"}
    table = Table(meta=night.facts())
    for column in COLUMNS:
        if column.name == TIME:
            table[TIME] = _times([row.t_mid_utc_ns for row in night.rows])
            table[TIME].info.description = column.meaning
            continue
        values = [row.value(column.name) for row in night.rows]
        blank: Any = "" if column.type == "text" else 0
        filled = [blank if value is None else value for value in values]
        table[column.name] = MaskedColumn(
            filled,
            mask=[value is None for value in values],
            dtype=types.get(column.type, str),
            unit=column.unit,
            description=column.meaning,
        )
    table[DIRECTION] = _directions(night.rows)
    table[DIRECTION].info.description = "ra_icrs_deg and dec_icrs_deg"
    text = io.StringIO()
    with warnings.catch_warnings():
        # Astropy doubts UTC some years ahead, where leap seconds are not yet decided.
        warnings.filterwarnings("ignore", message=".*dubious year")
        table.write(text, format="ascii.ecsv")
    return text.getvalue()


def _times(t_utc_ns: Sequence[int]) -> Any:
    import numpy as np
    from astropy.time import Time

    found = Time(*jd_utc(np.array(t_utc_ns, np.int64)), format="jd", scale="utc")
    found.format, found.precision = "isot", 9  # what is written as text is as exact
    return found


def _directions(rows: Sequence[MeasuredRow]) -> Any:
    import numpy as np
    from astropy.coordinates import SkyCoord

    ra = np.array([row.ra_icrs_deg for row in rows], float)
    dec = np.array([row.dec_icrs_deg for row in rows], float)
    return SkyCoord(ra, dec, unit="deg", frame="icrs")


def _csv_field(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    return repr(value) if isinstance(value, float) else str(value)
