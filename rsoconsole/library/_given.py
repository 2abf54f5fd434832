"""Conversion of the caller's arguments: numbers with units, times, places, configurations.

Units of arguments are converted in this module alone.
"""

import math
from collections.abc import Mapping, Sequence
from datetime import datetime
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias, runtime_checkable

import numpy as np

from rsoconsole.base import InputError
from rsoconsole.config import Config, load_config, with_changes
from rsoconsole.library.formats.tables import as_table
from rsoconsole.night import Row, public_table_rows
from rsoconsole.records import TABLES, Column, Record, Site
from rsoconsole.sky import IntArray, iso_to_utc_ns


@runtime_checkable
class QuantityLike(Protocol):
    """An astropy ``Quantity`` (or ``Angle``, ``Longitude``, a column with a unit)."""

    @property
    def unit(self) -> Any: ...

    def to_value(self, unit: Any, /) -> Any: ...


@runtime_checkable
class TimeLike(Protocol):
    """An astropy ``Time``."""

    @property
    def scale(self) -> Any: ...

    @property
    def jd1(self) -> Any: ...

    @property
    def jd2(self) -> Any: ...


@runtime_checkable
class SkyCoordLike(Protocol):
    """An astropy ``SkyCoord``."""

    @property
    def icrs(self) -> Any: ...


@runtime_checkable
class EarthLocationLike(Protocol):
    """An astropy ``EarthLocation``."""

    @property
    def geodetic(self) -> Any: ...


Number: TypeAlias = float | QuantityLike
"""A quantity, or a plain number in the unit that the parameter's description names."""
Instant: TypeAlias = TimeLike | datetime
"""An astropy ``Time``, or a ``datetime`` with a time zone."""
Place: TypeAlias = EarthLocationLike | Site | tuple[float, float, float]
"""``EarthLocation``, ``Site``, or (latitude deg, longitude deg east positive, height m)."""
ConfigLike: TypeAlias = Config | str | PathLike[str] | None
"""A configuration, the path of its file, or None for the user's own file where there is one."""


def resolve_config(config: ConfigLike, overrides: dict[str, Any] | None = None) -> Config:
    """Return the configuration that ``config`` stands for, with some settings replaced.

    ``overrides``: values by dotted name of the setting; those that are None are ignored. Raises
    ConfigError that lists every fault.
    """
    wanted = {name: value for name, value in (overrides or {}).items() if value is not None}
    if isinstance(config, Config):
        return with_changes(config, wanted)
    return load_config(None if config is None else Path(config).expanduser(), wanted)


def in_unit(value: Number, unit: str, name: str) -> float:
    """Convert one value to a finite float in ``unit``.

    A plain number counts as being in it. ``name``: the argument's name, for error messages. Raises
    InputError.
    """
    found = floats_in_unit(value, unit, name)
    if found.ndim:
        raise InputError(f"{name}: one value is needed, not {found.size}")
    return float(found)


def floats_in_unit(value: Any, unit: str, name: str) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Convert values to an array of finite floats in ``unit``.

    Plain numbers count as being in it. ``name``: the argument's name, for error messages. Raises
    InputError.
    """
    if isinstance(value, QuantityLike) and value.unit is not None:
        from astropy.units import UnitConversionError

        try:
            value = value.to_value(unit)
        except UnitConversionError as error:
            raise InputError(
                f"{name} is in {value.unit or 'no unit'}: give it in {unit}, or what converts to it"
            ) from error
    try:
        if value is None or isinstance(value, str | bytes | bool) or np.ma.is_masked(value):
            raise TypeError(value)
        found = np.asarray(value, np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name}: {value!r} is no number of {unit}") from error
    if not np.all(np.isfinite(found)):
        raise InputError(f"{name} is NaN or infinite")
    return found


def instants_utc_ns(value: Any, name: str) -> IntArray:
    """Convert instants to UTC nanoseconds: () for a single instant, (N,) for several.

    ``name``: their name in errors. Raises InputError for times without time scale or zone.
    """
    if isinstance(value, TimeLike):
        return _of_time(value, name)
    if isinstance(value, datetime):
        return np.asarray(_of_datetime(value, name), np.int64)
    if isinstance(value, Sequence | np.ndarray) and not isinstance(value, str | bytes):
        return np.array([int(instants_utc_ns(each, name)) for each in value], np.int64)
    raise InputError(
        f"{name}: {value!r} has no time scale: give an astropy Time, such as"
        " Time('2026-01-01T00:00:00', scale='utc')"
    )


def _of_time(value: Any, name: str) -> IntArray:
    from astropy.time import ScaleValueError

    if np.any(value.mask):
        raise InputError(f"{name} is missing (masked)")
    try:
        utc = value.utc.copy(format="isot")
    except ScaleValueError as error:
        raise InputError(
            f"{name} is of the scale {value.scale!r}, which is not tied to UTC: give UTC or TAI"
        ) from error
    utc.precision = 9
    texts = np.asarray(utc.value)
    whole = [iso_to_utc_ns(str(each)) for each in texts.ravel()]
    return np.array(whole, np.int64).reshape(texts.shape)


def _of_datetime(value: datetime, name: str) -> int:
    if value.tzinfo is None:
        raise InputError(
            f"{name}: {value.isoformat()} has no time zone: write"
            " datetime(..., tzinfo=timezone.utc), or give an astropy Time"
        )
    since = value - datetime.fromisoformat("1970-01-01T00:00:00+00:00")
    return (since.days * 86_400 + since.seconds) * 10**9 + since.microseconds * 1000


def direction_deg(value: SkyCoordLike, name: str) -> tuple[float, float]:
    """Return (RA, Dec) of one direction, ICRS, degrees.

    ``name``: its name in errors. Raises InputError for a value that is not one ``SkyCoord``.
    """
    try:
        icrs = value.icrs
        if icrs.size != 1:
            raise InputError(f"{name}: one direction is needed, not {icrs.size}")
        return float(np.ravel(icrs.ra.deg)[0]), float(np.ravel(icrs.dec.deg)[0])
    except (AttributeError, TypeError) as error:
        raise InputError(f"{name}: {value!r} is no SkyCoord") from error


def site_of(place: Place, name: str = "site") -> Site:
    """Convert a place to a ``Site``.

    ``name``: its name in errors. Raises InputError for a value that is no place on the Earth.
    """
    if isinstance(place, Site):
        return place
    if isinstance(place, EarthLocationLike):
        lon, lat, height = place.geodetic
        if np.ndim(lat):
            raise InputError(f"{name}: one place is needed, not {np.size(lat)}")
        triple = (float(lat.deg), float(lon.deg), float(height.to_value("m")))
    else:
        try:
            latitude, longitude, metres = place
        except (TypeError, ValueError) as error:
            raise InputError(
                f"{name}: {place!r}: give an EarthLocation, or (latitude, longitude, metres)"
            ) from error
        triple = (
            in_unit(latitude, "deg", f"{name}, latitude"),
            in_unit(longitude, "deg", f"{name}, longitude"),
            in_unit(metres, "m", f"{name}, height"),
        )
    latitude_deg, longitude_deg, elevation_m = triple
    if not (abs(latitude_deg) <= 90.0 and abs(longitude_deg) <= 360.0):
        raise InputError(
            f"{name}: latitude {latitude_deg:g}, longitude {longitude_deg:g} deg is no place:"
            " latitude comes first, -90 to 90"
        )
    if not (math.isfinite(elevation_m) and abs(elevation_m) < 1e5):
        raise InputError(f"{name}: a height of {elevation_m:g} m is on no ground: metres are meant")
    return Site(
        latitude_deg=latitude_deg,
        longitude_deg=(longitude_deg + 180.0) % 360.0 - 180.0,
        elevation_m=elevation_m,
    )


def required_site(given: Place | None, own: Site | None, config: ConfigLike) -> Site:
    """Return the caller's site, else that of the observations, else the configured one.

    ``given``: of the caller; ``own``: of the observations. Raises InputError where none is
    known.
    """
    site = own if given is None else site_of(given)
    site = configured_site(config) if site is None else site
    if site is None:
        raise InputError(
            "nobody says where this was seen from: site=EarthLocation.of_site(...), or (latitude,"
            " longitude, metres)"
        )
    return site


def configured_site(config: ConfigLike) -> Site | None:
    """Return the configured site; None where the configuration has only the default coordinates."""
    site = resolve_config(config).site
    return site.to_site() if site.is_set else None


if TYPE_CHECKING:
    from astropy.table import QTable

_LOG_COLUMNS = ("seq", "t_utc_ns", "is_superseded")
FRAME = Column(name="frame", type="text", meaning="The frame by its name.")


def records_table(
    name: str,
    records: Sequence[Record],
    meta: dict[str, Any],
    *,
    names: Mapping[int, str] | None = None,
    extra: Sequence[Column] = (),
    more: Sequence[Row] = (),
) -> "QTable":
    """Return records as a ``QTable`` with the columns of a session's table ``name``.

    The columns ``seq``, ``t_utc_ns`` and ``is_superseded`` are left out. ``sessions/README.md``
    describes these tables. ``names``: frame names by frame number, for an added first column
    ``frame``. ``extra``: columns to append; ``more``: their values, one mapping for each row.
    """
    rows = public_table_rows(
        name, [(seq, 0, record) for seq, record in enumerate(records, start=1)]
    )
    columns = [each for each in TABLES[name].columns if each.name not in _LOG_COLUMNS]
    if names is not None:
        columns.insert(0, FRAME)
        rows = [{**row, "frame": names.get(row["frame_id"])} for row in rows]
    if extra:
        rows = [{**row, **added} for row, added in zip(rows, more, strict=True)]
    return as_table((*columns, *extra), rows, meta)
