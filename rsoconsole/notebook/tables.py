"""Rows as tables for analysis: astropy's with units, times and directions, or pandas'.

A column is named as in the session's views and its unit is the one in that name, with two
exceptions: an instant ``*_utc_ns`` becomes a ``Time`` (pandas: a timestamp) named ``*_utc``, and
where a row is a direction there is also ``direction``, a ``SkyCoord``.
Missing is masked, never NaN.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from rsoconsole.notebook.extra import needed
from rsoconsole.notebook.rows import Row
from rsoconsole.sky.times import jd_utc

NS = "_utc_ns"
_UNITS = (
    ("_arcsec_px", "arcsec / pix"),
    ("_deg_s", "deg / s"),
    ("_arcsec2", "arcsec2"),
    ("_arcsec", "arcsec"),
    ("_bytes", "byte"),
    ("_deg", "deg"),
    ("_px", "pix"),
    ("_s", "s"),
)
_WHOLE = frozenset(("seq", "frame_id", "number", "matched", "misses", "track_id"))
_NUMBERS = frozenset(("confidence", "snr", "unevenness", "nis"))
_NOT_PLAIN = frozenset(("covariance", "ends_icrs_deg"))
_SHAPES = {"covariance": (4, 4), "ends_icrs_deg": (2, 2)}


def unit_of(column: str) -> str | None:
    """The unit that a column's name says, as astropy writes it; None for a number without."""
    if column == "ms":
        return "ms"
    return next((unit for ending, unit in _UNITS if column.endswith(ending)), None)


def as_table(columns: Sequence[str], rows: Sequence[Row], meta: dict[str, Any]) -> Any:
    """An astropy ``QTable``: quantities, times in UTC (to the nanosecond), ICRS directions."""
    from astropy.table import QTable

    table = QTable(meta=meta)
    for column in columns:
        values = [row[column] for row in rows]
        if column.endswith(NS):
            table[column.removesuffix("_ns")] = _times(values)
        else:
            table[column] = _column(column, values)
    if {"ra_icrs_deg", "dec_icrs_deg"} <= set(columns):
        from astropy.coordinates import SkyCoord

        table["direction"] = SkyCoord(table["ra_icrs_deg"], table["dec_icrs_deg"], frame="icrs")
    return table


def _times(values: Sequence[int | None]) -> Any:
    from astropy.time import Time

    present = np.array([0 if value is None else value for value in values], np.int64)
    times = Time(*jd_utc(present), format="jd", scale="utc")
    times.format = "isot"
    times.precision = 9  # what is written as text is as exact
    missing = np.array([value is None for value in values], bool)
    if missing.any():
        times[missing] = np.ma.masked
    return times


def _column(column: str, values: Sequence[Any]) -> Any:
    """A quantity where the name says a unit, else a plain column; masked where values miss."""
    from astropy import units
    from astropy.table import Column, MaskedColumn
    from astropy.utils.masked import Masked

    missing = np.array([value is None for value in values], bool)
    unit = unit_of(column)
    if column in _SHAPES:
        shape = _SHAPES[column]
        filled = [np.zeros(shape) if value is None else value for value in values]
        data = np.array(filled, float).reshape(len(values), *shape)
        missing = np.broadcast_to(missing[:, None, None], data.shape)
    elif unit is not None or column in _NUMBERS:
        data = np.array([0.0 if value is None else value for value in values], float)
    elif column in _WHOLE:
        data = np.array([0 if value is None else value for value in values], np.int64)
    elif column.startswith("is_"):
        data = np.array([bool(value) for value in values], bool)
    else:
        data = np.array(["" if value is None else str(value) for value in values], str)
    if unit is not None:
        quantity = data * units.Unit(unit)
        return Masked(quantity, mask=missing) if missing.any() else quantity
    return MaskedColumn(data, mask=missing) if missing.any() else Column(data)


def as_frame(columns: Sequence[str], rows: Sequence[Row]) -> Any:
    """A pandas ``DataFrame``. Raises RsoconsoleError where pandas is not installed."""
    pandas = needed("pandas", "a data frame")
    series = {}
    for column in columns:
        values = [row[column] for row in rows]
        if column.endswith(NS):
            series[column.removesuffix("_ns")] = _timestamps(pandas, values)
        elif column in _WHOLE or column.endswith("_bytes"):
            is_whole = all(value is not None for value in values)
            series[column] = pandas.Series(values, dtype="int64" if is_whole else "Int64")
        elif column not in _NOT_PLAIN and (unit_of(column) or column in _NUMBERS):
            series[column] = pandas.Series(values, dtype="float64")
        elif column.startswith("is_"):
            series[column] = pandas.Series(map(bool, values), dtype="bool")
        else:
            series[column] = pandas.Series(values, dtype="object")
    return pandas.DataFrame(series, columns=list(series))


def _timestamps(pandas: Any, values: Sequence[int | None]) -> Any:
    nothing = np.datetime64("NaT", "ns").astype(np.int64)
    whole = np.array([nothing if value is None else value for value in values], np.int64)
    return pandas.Series(whole.view("datetime64[ns]")).dt.tz_localize("UTC")
