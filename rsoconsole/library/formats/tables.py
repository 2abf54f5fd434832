"""Conversion of rows to tables for analysis: of astropy, or data frames of pandas.

A column is named as in the session's views, with its type and unit (``records/columns.py``), with
two exceptions: an instant ``*_utc_ns`` becomes a ``Time`` (in pandas a timestamp) named ``*_utc``,
and a table with RA and Dec also has ``direction``, a ``SkyCoord``. Missing values are masked, never
NaN.
"""

from collections.abc import Sequence
from importlib import import_module
from typing import Any

import numpy as np

from rsoconsole.base import RsoconsoleError
from rsoconsole.night import Row
from rsoconsole.records import Column
from rsoconsole.sky import jd_utc

NS = "_utc_ns"


def as_table(columns: Sequence[Column], rows: Sequence[Row], meta: dict[str, Any]) -> Any:
    """Return an astropy ``QTable``: quantities, UTC times to the nanosecond, ICRS directions."""
    from astropy.table import QTable

    table = QTable(meta=meta)
    for column in columns:
        values = [row[column.name] for row in rows]
        if column.name.endswith(NS):
            table[column.name.removesuffix("_ns")] = _times(values)
        else:
            table[column.name] = _column(column, values)
    if {"ra_icrs_deg", "dec_icrs_deg"} <= {column.name for column in columns}:
        from astropy.coordinates import SkyCoord

        table["direction"] = SkyCoord(table["ra_icrs_deg"], table["dec_icrs_deg"], frame="icrs")
    return table


def to_astropy_time(t_utc_ns: Any) -> Any:
    """Convert UTC nanoseconds, () or (N,), to an astropy ``Time`` exact to the nanosecond."""
    from astropy.time import Time

    found = Time(*jd_utc(t_utc_ns), format="jd", scale="utc")
    found.format, found.precision = "isot", 9
    return found


def _times(values: Sequence[int | None]) -> Any:
    times = to_astropy_time(np.array([0 if value is None else value for value in values], np.int64))
    missing = np.array([value is None for value in values], bool)
    if missing.any():
        times[missing] = np.ma.masked
    return times


def _column(column: Column, values: Sequence[Any]) -> Any:
    """A quantity where there is a unit, else a plain column; masked where values miss."""
    from astropy import units
    from astropy.table import Column as Plain
    from astropy.table import MaskedColumn
    from astropy.utils.masked import Masked

    missing = np.array([value is None for value in values], bool)
    data = _array(column, values)
    missing = np.broadcast_to(missing.reshape(-1, *(1 for _ in column.shape)), data.shape)
    if column.unit is not None and not column.shape:
        quantity = data * units.Unit(column.unit)
        return Masked(quantity, mask=missing) if missing.any() else quantity
    return MaskedColumn(data, mask=missing) if missing.any() else Plain(data)


def _array(column: Column, values: Sequence[Any]) -> Any:
    """Values as an array of the column's type; missing ones are zero, False or empty."""
    if column.shape:
        filled = [np.zeros(column.shape) if value is None else value for value in values]
        return np.array(filled, float).reshape(len(values), *column.shape)
    if column.type == "real" or (column.type == "integer" and column.unit is not None):
        return np.array([0.0 if value is None else value for value in values], float)
    if column.type == "integer":
        return np.array([0 if value is None else value for value in values], np.int64)
    if column.type == "truth":
        return np.array([bool(value) for value in values], bool)
    return np.array(["" if value is None else str(value) for value in values], str)


def as_data_frame(columns: Sequence[Column], rows: Sequence[Row]) -> Any:
    """Return the rows as a pandas ``DataFrame``.

    Raises RsoconsoleError where pandas is not installed.
    """
    pandas = import_notebook_extra("pandas", "a data frame")
    series = {}
    for column in columns:
        name = column.name
        values = [row[name] for row in rows]
        if name.endswith(NS):
            series[name.removesuffix("_ns")] = _timestamps(pandas, values)
        elif column.type == "integer":
            is_whole = all(value is not None for value in values)
            series[name] = pandas.Series(values, dtype="int64" if is_whole else "Int64")
        elif column.type == "real" and not column.shape:
            series[name] = pandas.Series(values, dtype="float64")
        elif column.type == "truth":
            series[name] = pandas.Series(map(bool, values), dtype="bool")
        else:
            series[name] = pandas.Series(values, dtype="object")
    return pandas.DataFrame(series, columns=list(series))


def _timestamps(pandas: Any, values: Sequence[int | None]) -> Any:
    nothing = np.datetime64("NaT", "ns").astype(np.int64)
    whole = np.array([nothing if value is None else value for value in values], np.int64)
    return pandas.Series(whole.view("datetime64[ns]")).dt.tz_localize("UTC")


def import_notebook_extra(library: str, what: str) -> Any:
    """Import a library of the extra ``notebook`` and return its module.

    ``what``: the purpose, for errors. Raises RsoconsoleError where the library is missing.
    """
    try:
        return import_module(library)
    except ImportError as error:
        raise RsoconsoleError(
            f"{what} needs {library} ({error}): pip install 'rsoconsole[notebook]'"
        ) from error
