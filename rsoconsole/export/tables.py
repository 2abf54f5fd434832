"""Measurements as tables: CSV (RFC 4180), ECSV (astropy's, with units), JSON lines; both ways.

All three carry every float in its shortest exact form, so that what is read is what was written.
Missing is an empty field in CSV, a masked one in ECSV, null in JSON.
"""

import csv
import io
import json
import math
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from rsoconsole.errors import ExportError
from rsoconsole.export.night import ExportedNight
from rsoconsole.export.rows import COLUMNS, DERIVED, MeasuredRow
from rsoconsole.foreign_text import MOST_DATA_BYTES, json_of, read_foreign
from rsoconsole.records import Column
from rsoconsole.sky import jd_utc

_NAMES = tuple(column.name for column in COLUMNS)
_NEEDED = frozenset(_NAMES) & {*MeasuredRow.__dataclass_fields__, *DERIVED}
"""What another version has beside them may be missing."""
TIME, DIRECTION = "t_mid_utc", "direction"
_TRUTH = {"true": True, "false": False}
_OPTIONAL = frozenset(
    name for name, hint in MeasuredRow.__annotations__.items() if "None" in str(hint)
)


def to_csv(rows: Iterable[MeasuredRow]) -> str:
    """A head line with the columns' names, then a line a measurement."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(_NAMES)
    for row in rows:
        writer.writerow([_csv_field(row.value(name)) for name in _NAMES])
    return text.getvalue()


def read_csv(path: Path) -> tuple[MeasuredRow, ...]:
    """The measurements of such a file. Raises ExportError naming the line that is none."""
    lines = csv.reader(io.StringIO(_text(path), newline=""))
    try:
        names = next(lines, None)
        if names is None or _NEEDED - set(names):
            missing = sorted(_NEEDED - set(names or ()))
            raise ExportError(f"{path} is no table of measurements: it has no {', '.join(missing)}")
        rows = []
        for fields in lines:
            where = f"{path}, line {lines.line_num}"
            if len(fields) != len(names):
                raise ExportError(f"{where}: {len(fields)} fields where {len(names)} belong")
            texts = dict(zip(names, fields, strict=True))
            rows.append(
                _row({c.name: _parsed(c, texts.get(c.name, ""), where) for c in COLUMNS}, where)
            )
    except csv.Error as error:
        raise ExportError(f"{path} cannot be read as CSV: {error}") from error
    return tuple(rows)


def to_jsonl(rows: Iterable[MeasuredRow]) -> str:
    """One object a measurement, a line each."""
    return "".join(
        json.dumps({name: row.value(name) for name in _NAMES}, allow_nan=False) + "\n"
        for row in rows
    )


def read_jsonl(path: Path) -> tuple[MeasuredRow, ...]:
    """The measurements of such a file. Raises ExportError naming the line that is none."""
    return tuple(_json_rows(path))


def _json_rows(path: Path) -> Iterator[MeasuredRow]:
    for number, line in enumerate(_text(path).split("\n"), start=1):
        if not line.strip():
            continue
        where = f"{path}, line {number}"
        try:
            values = json_of(line)
        except ValueError as error:
            raise ExportError(f"{where}: {error}") from error
        if not isinstance(values, dict):
            raise ExportError(f"{where}: an object belongs there")
        yield _row(values, where)


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


def read_ecsv(path: Path) -> tuple[tuple[MeasuredRow, ...], dict[str, Any]]:
    """(measurements, meta) of such a file. Raises ExportError when it is none."""
    import numpy as np
    from astropy.io.ascii import InconsistentTableError
    from astropy.table import Table

    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message=".*dubious year")
            table = Table.read(_text(path), format="ascii.ecsv")
    except (ValueError, InconsistentTableError, StopIteration, IndexError) as error:
        raise ExportError(f"{path} cannot be read as ECSV: {error}") from error
    rows = []
    for number, each in enumerate(table, start=1):
        values = {
            name: None if np.ma.is_masked(each[name]) else np.asarray(each[name]).item()
            for name in table.colnames
            if name in _NAMES and name not in DERIVED
        }
        rows.append(_row(values, f"{path}, row {number}"))
    return tuple(rows), dict(table.meta)


def _csv_field(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    return repr(value) if isinstance(value, float) else str(value)


def _parsed(column: Column, text: str, where: str) -> Any:
    if text == "":
        return None
    try:
        if column.type == "integer":
            return int(text)
        if column.type == "real":
            return float(text)
        return _TRUTH[text] if column.type == "truth" else text
    except (ValueError, KeyError) as error:
        raise ExportError(f"{where}: {text!r} is no {column.name}") from error


def _row(values: Mapping[str, Any], where: str) -> MeasuredRow:
    """The row of values by column; other columns are passed over."""
    found: dict[str, Any] = {}
    beside: list[tuple[str, Any]] = []
    for column in COLUMNS:
        if column.name in DERIVED:
            continue
        value = values.get(column.name)
        if column.name not in MeasuredRow.__dataclass_fields__:
            beside.append((column.name, _checked(column, value, where)))
            continue
        if value is None and column.name not in _OPTIONAL:
            raise ExportError(f"{where} has no {column.name}")
        found[column.name] = _checked(column, value, where)
    return MeasuredRow(**found, beside=tuple(beside))


def _checked(column: Column, value: Any, where: str) -> Any:
    expected: dict[str, type | tuple[type, ...]] = {
        "integer": int,
        "real": (int, float),
        "text": str,
        "truth": bool,
    }
    if value is None:
        return None
    is_truth = isinstance(value, bool)
    if not isinstance(value, expected[column.type]) or is_truth != (column.type == "truth"):
        raise ExportError(f"{where}: {value!r} is no {column.name}")
    if isinstance(value, float) and not math.isfinite(value):
        raise ExportError(f"{where}: {column.name} is {value}")
    return float(value) if isinstance(value, int) and column.type == "real" else value


def _text(path: Path) -> str:
    try:
        return read_foreign(path, most_bytes=MOST_DATA_BYTES)
    except (OSError, UnicodeDecodeError) as error:
        raise ExportError(f"{path} cannot be read: {error}") from error
