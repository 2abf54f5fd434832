"""Reading of directions from a table made by ``rso.measure`` or by the caller."""

import math
from dataclasses import dataclass, fields
from typing import Any, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from rsoconsole.base import InputError
from rsoconsole.library._given import Number, SkyCoordLike, floats_in_unit, in_unit, instants_utc_ns
from rsoconsole.records import FloatArray, Site
from rsoconsole.sky import IntArray

META = "rsoconsole"
"""Key in a table's ``meta`` under which ``rso.measure`` stores the site and the frames."""
TIMES = ("t_mid_utc", "time", "t_utc", "obstime", "t", "date_obs", "epoch")
RAS = ("ra_icrs", "ra")
DECS = ("dec_icrs", "dec")
_OBJECTS = ("object", "track_id", "target", "norad_id")


@runtime_checkable
class TableLike(Protocol):
    """An astropy ``Table`` or ``QTable``."""

    @property
    def colnames(self) -> Any: ...

    def __getitem__(self, item: Any, /) -> Any: ...


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Directions:
    """N measured directions, one for each row of a table, in the order of the rows."""

    t_utc_ns: IntArray
    """Mid-exposure of each direction, UTC nanoseconds, (N,)."""
    ra_icrs_deg: FloatArray
    dec_icrs_deg: FloatArray
    cov_sky_arcsec2: FloatArray
    """Covariance on the sky, (N, 3): east-east, east-north, north-north."""
    site: Site | None
    """Site in the table's ``meta``; None where the table has none."""


def expect_table(value: Any, what: str) -> Any:
    """Return the table; a pandas data frame is converted to a ``QTable``.

    ``what``: what the caller should give, for the error. Raises InputError for any other value.
    """
    if isinstance(value, TableLike):
        return value
    if hasattr(value, "to_records") and hasattr(value, "columns"):
        from astropy.table import QTable

        return QTable.from_pandas(value)
    raise InputError(
        f"{type(value).__name__} is no {what}: give an astropy table with the columns time, ra and"
        " dec (or a SkyCoord), as rso.measure makes it"
    )


def read_directions(table: Any, sigma: Number | None) -> Directions:
    """Read the directions of a table, one for each row.

    ``sigma``: error of the directions where the table has no column of errors, arcsec; None: such a
    table is an error. Raises InputError that names the column that is missing, has no unit or holds
    an invalid value.
    """
    count = len(table)
    if not count:
        raise InputError("the table has no rows: nothing was measured")
    ra, dec = _directions(table)
    for name, values in (("ra", ra), ("dec", dec)):
        if np.shape(values) != (count,):
            raise InputError(f"{name}: one number a row is needed, not {np.shape(values)}")
    if np.any(np.abs(dec) > 90.0) or np.any(np.abs(ra) > 360.0):
        raise InputError("ra, dec: beyond 360 or 90 degrees: is the unit right?")
    return Directions(
        t_utc_ns=mid_exposure_utc_ns(table),
        ra_icrs_deg=ra % 360.0,
        dec_icrs_deg=dec,
        cov_sky_arcsec2=_covariances(table, count, sigma),
        site=site_from_meta(table),
    )


def site_from_meta(table: Any) -> Site | None:
    """Return the site in a table's ``meta``; None where it holds none.

    Raises InputError for a site that is not valid.
    """
    # The second: an exported table.
    said = rsoconsole_meta(table).get("site") or (getattr(table, "meta", None) or {}).get("site")
    if not isinstance(said, dict):
        return None
    try:
        return Site(**{each.name: float(said[each.name]) for each in fields(Site)})
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"the table's meta has a site that is none: {said!r}") from error


def rsoconsole_meta(table: Any) -> dict[str, Any]:
    """Return the metadata that ``rso.measure`` wrote into a table; empty for other tables."""
    own = (getattr(table, "meta", None) or {}).get(META)
    return own if isinstance(own, dict) else {}


def expect_one_object(table: Any) -> None:
    """Check that all rows are directions of one object.

    Raises InputError where a column names several objects, or two rows have the same instant.
    """
    for name in _OBJECTS:
        if name in table.colnames:
            names = sorted({str(each) for each in table[name]})
            if len(names) > 1:
                listed = ", ".join(names[:8])
                raise InputError(
                    f"the table holds {len(names)} objects by its column {name!r}: {listed};"
                    f" give one of them, as in table[table[{name!r}] == ...]"
                )
    t = mid_exposure_utc_ns(table)
    if len(np.unique(t)) < len(t):
        raise InputError(
            "the table has several directions of one instant, so of several objects: rso.track"
            " tells which belong together"
        )


def mid_exposure_utc_ns(table: Any) -> IntArray:
    """Return the mid-exposure times of the rows, UTC nanoseconds, (N,). Raises InputError."""
    column = next((name for name in TIMES if name in table.colnames), None)
    if column is None:
        found = [each for each in table.colnames if hasattr(table[each], "utc")]
        column = found[0] if len(found) == 1 else None
    if column is None:
        raise InputError(
            f"the table has no times: a Time column is needed, called {' or '.join(TIMES[:2])}; it"
            f" has {_listed(table)}"
        )
    values = table[column]
    if not hasattr(values, "utc"):
        values = list(values)
    return np.atleast_1d(instants_utc_ns(values, column))


def column_in_unit(table: Any, names: tuple[str, ...], unit: str) -> FloatArray | None:
    """Return a column converted to ``unit``, (N,); None where the table has none of ``names``.

    The column is a quantity called as in ``names``, or plain numbers whose name ends in the unit
    (``ra_deg``). Raises InputError for missing values and for numbers without a unit.
    """
    for name in names:
        ending = f"{name}_{unit}"
        for each in (name, ending):
            if each not in table.colnames:
                continue
            values = table[each]
            if np.any(getattr(values, "mask", False)):
                raise InputError(f"column {each!r} has missing values: leave those rows out")
            has_unit = getattr(values, "unit", None) is not None
            if not has_unit and each != ending:
                raise InputError(
                    f"column {each!r} has no unit: table[{each!r}].unit = {unit!r} gives it one"
                )
            plain = values if has_unit else np.asarray(values, np.float64)
            return floats_in_unit(getattr(plain, "quantity", plain), unit, f"column {each!r}")
    return None


def _directions(table: Any) -> tuple[FloatArray, FloatArray]:
    sky = [name for name in table.colnames if isinstance(table[name], SkyCoordLike)]
    if sky:
        name = "direction" if "direction" in sky else sky[0]
        if len(sky) > 1 and name != "direction":
            raise InputError(f"the table has {len(sky)} SkyCoord columns: call one 'direction'")
        icrs = table[name].icrs
        ra, dec = np.asarray(icrs.ra.deg, np.float64), np.asarray(icrs.dec.deg, np.float64)
        if not (np.all(np.isfinite(ra)) and np.all(np.isfinite(dec))):
            raise InputError(f"column {name!r} holds a direction that is NaN")
        return ra, dec
    ra_deg, dec_deg = column_in_unit(table, RAS, "deg"), column_in_unit(table, DECS, "deg")
    if ra_deg is None or dec_deg is None:
        raise InputError(
            "the table has no directions: a SkyCoord column, or ra and dec with units (ra_deg and"
            f" dec_deg) are needed; it has {_listed(table)}"
        )
    return ra_deg, dec_deg


def _covariances(table: Any, count: int, sigma: Number | None) -> FloatArray:
    if {"cov_ee_arcsec2", "cov_en_arcsec2", "cov_nn_arcsec2"} <= set(table.colnames):
        parts = [column_in_unit(table, (f"cov_{axes}",), "arcsec2") for axes in ("ee", "en", "nn")]
        found = np.stack([each for each in parts if each is not None], axis=-1)
        if np.any(found[:, 0] * found[:, 2] <= found[:, 1] ** 2):
            raise InputError("cov_ee, cov_en, cov_nn: not the covariance of a direction in a row")
        return found
    both = column_in_unit(table, ("sigma",), "arcsec")
    east, north = (column_in_unit(table, (f"sigma_{axis}",), "arcsec") for axis in ("ra", "dec"))
    east, north = (both if each is None else each for each in (east, north))
    if east is None or north is None:
        if sigma is None:
            raise InputError(
                "the table states no errors: add a column 'sigma' with its unit (or sigma_ra and"
                " sigma_dec, on the sky), or say sigma="
            )
        plain = in_unit(sigma, "arcsec", "sigma")
        east = north = np.full(count, plain)
    if np.any(east <= 0.0) or np.any(north <= 0.0):
        raise InputError("sigma: every one must be above 0")
    correlation = np.zeros(count)
    if "correlation" in table.colnames:
        correlation = np.asarray(table["correlation"], np.float64)
    if not np.all(np.abs(correlation) < 1.0):
        raise InputError("correlation: every one must be within -1 and 1")
    return np.stack([east**2, correlation * east * north, north**2], axis=-1)


def plain_column(table: Any, name: str, kind: type) -> npt.NDArray[Any] | None:
    """Return a column as an array of type ``kind``; None where the table has no such column."""
    if name not in table.colnames:
        return None
    try:
        return np.asarray(table[name]).astype(kind)
    except (TypeError, ValueError) as error:
        raise InputError(f"column {name!r} holds what is no {kind.__name__}: {error}") from error


def _listed(table: Any) -> str:
    return ", ".join(map(str, table.colnames)) or "no columns"


def covariance_sigmas(cov_arcsec2: tuple[float, float, float]) -> tuple[float, float, float]:
    """Return (sigma_ra, sigma_dec, correlation) of a covariance on the sky; sigmas in arcsec.

    ``cov_arcsec2``: east-east, east-north, north-north. sigma_ra is on the sky: times cos Dec.
    """
    ee, en, nn = cov_arcsec2
    east, north = math.sqrt(ee), math.sqrt(nn)
    return east, north, en / (east * north)
