"""Stars of the Tycho-2 catalogue: positions at an epoch, magnitudes and colours.

The shipped stars reach VT about 12.5. Those near the geostationary belt, |dec| <= 12 deg, are in a
file of their own, because most telescopes here need no others. Positions are ICRS at J2000.0;
proper motions carry them to the requested epoch, to about 0.1 arcsec in 2026 (60 mas at the mean
epoch of Tycho-2, 2.5 mas/yr). Source: Hog et al. 2000, A&A 355, L27; licence in
``data/COPYRIGHT.tycho2``.
"""

import math
from dataclasses import dataclass, fields
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from rsoconsole.base import SolverError, resource_path
from rsoconsole.records import FloatArray
from rsoconsole.sky.angles import separation_deg
from rsoconsole.sky.stars.proper_motion import FASTEST_ARCSEC_YR, J2000_JYEAR, apply_proper_motion

RA_STEP_DEG = 360.0 / 2**32
"""Unit of stored right ascensions, deg (0.3 mas)."""
DEC_STEP_DEG = 1e-7
MAG_STEP = 1e-3
SIGMA_MAG_STEP = 1e-2
NO_COLOUR = -(2**15)
"""Stored for a star without BT or without VT."""
NO_SIGMA = 2**8 - 1
"""Stored for a star whose magnitude has no error in the catalogue."""
_SHIPPED = ("sky", "data", "tycho2_belt.npz")
_SHIPPED_REST = ("sky", "data", "tycho2_rest.npz")

_COLUMNS: dict[str, tuple[str, type[np.generic]]] = {
    "ra_counts": ("ra", np.uint32),
    "dec_counts": ("dec_steps", np.int32),
    "mmag": ("mmag", np.int16),
    "pm_ra_mas_yr": ("pm_ra", np.int16),
    "pm_dec_mas_yr": ("pm_dec", np.int16),
    "colour_mmag": ("colour_mmag", np.int16),
    "sigma_counts": ("sigma", np.uint8),
}
"""Columns of a catalogue: their names and types in the file (declinations as differences)."""

IndexArray = npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Stars:
    """Stars of one piece of sky, brightest first; arrays (N,)."""

    ra_icrs_deg: FloatArray
    dec_icrs_deg: FloatArray
    magnitude: FloatArray
    """Tycho VT magnitude."""
    pm_ra_mas_yr: FloatArray
    """Proper motion in RA times cos(dec); 0 where the catalogue has none."""
    pm_dec_mas_yr: FloatArray
    colour_mag: FloatArray
    """BT - VT; NaN where the catalogue lacks one of them."""
    sigma_mag: FloatArray
    """Standard error of VT in the catalogue; NaN where unknown."""

    @classmethod
    def without_colour(
        cls,
        ra_icrs_deg: FloatArray,
        dec_icrs_deg: FloatArray,
        magnitude: FloatArray,
        pm_ra_mas_yr: FloatArray,
        pm_dec_mas_yr: FloatArray,
    ) -> "Stars":
        """Return stars whose colour and error of magnitude are unknown (NaN)."""
        unknown = np.full(len(magnitude), np.nan)
        motions = (pm_ra_mas_yr, pm_dec_mas_yr)
        return cls(ra_icrs_deg, dec_icrs_deg, magnitude, *motions, unknown, unknown)

    @classmethod
    def without_proper_motion(
        cls, ra_icrs_deg: FloatArray, dec_icrs_deg: FloatArray, magnitude: FloatArray
    ) -> "Stars":
        """Return stars with a proper motion of zero, because they have none or it is unknown.

        Their colour and error of magnitude are unknown (NaN).
        """
        still = np.zeros(len(magnitude))
        return cls.without_colour(ra_icrs_deg, dec_icrs_deg, magnitude, still, still)

    def brightest(self, most: int) -> "Stars":
        """Return the first ``most`` stars, of which the brightest come first."""
        return Stars(*(getattr(self, each.name)[:most] for each in fields(self)))

    def __len__(self) -> int:
        """Number of stars."""
        return len(self.magnitude)


@dataclass(frozen=True, slots=True, eq=False)
class StarCatalogue:
    """Stars in order of declination, complete between two declinations.

    The columns are the integers of the file, 17 bytes a star.
    """

    ra_counts: npt.NDArray[np.uint32]
    dec_counts: npt.NDArray[np.int32]
    mmag: npt.NDArray[np.int16]
    pm_ra_mas_yr: npt.NDArray[np.int16]
    pm_dec_mas_yr: npt.NDArray[np.int16]
    colour_mmag: npt.NDArray[np.int16]
    """BT - VT; NO_COLOUR where unknown."""
    sigma_counts: npt.NDArray[np.uint8]
    """Standard error of VT in steps of SIGMA_MAG_STEP; NO_SIGMA where unknown."""
    dec_min_deg: float
    dec_max_deg: float

    def __len__(self) -> int:
        """Number of stars."""
        return len(self.mmag)

    @property
    def ra_icrs_deg(self) -> FloatArray:
        """Right ascension of every star, ICRS degrees at J2000.0."""
        return _scaled(self.ra_counts, RA_STEP_DEG)

    @property
    def dec_icrs_deg(self) -> FloatArray:
        """Declination of every star, ICRS degrees at J2000.0."""
        return _scaled(self.dec_counts, DEC_STEP_DEG)

    @property
    def magnitude(self) -> FloatArray:
        """Tycho VT of every star."""
        return _scaled(self.mmag, MAG_STEP)

    @property
    def colour_mag(self) -> FloatArray:
        """BT - VT of every star; NaN where unknown."""
        return _known(self.colour_mmag, MAG_STEP, NO_COLOUR)

    @property
    def sigma_mag(self) -> FloatArray:
        """Standard error of VT of every star; NaN where unknown."""
        return _known(self.sigma_counts, SIGMA_MAG_STEP, NO_SIGMA)

    @classmethod
    def load(cls, path: Path | None = None) -> "StarCatalogue":
        """Load the stars of the geostationary belt, |dec| <= 12 deg, or a file of the same form.

        Read once, then cached. Raises SolverError when the file cannot be read.
        """
        return _load(resource_path(*_SHIPPED) if path is None else path)

    @classmethod
    def load_whole_sky(cls) -> "StarCatalogue":
        """Load all shipped stars; read at the first call, then cached (32 MB).

        Raises SolverError when a file cannot be read.
        """
        return _load_whole_sky()

    def covers(self, dec_icrs_deg: float, radius_deg: float = 0.0) -> bool:
        """True where the catalogue is complete within ``radius_deg`` of this declination.

        Elsewhere an empty result does not mean that there are no stars.
        """
        return (
            self.dec_min_deg <= max(dec_icrs_deg - radius_deg, -90.0)
            and min(dec_icrs_deg + radius_deg, 90.0) <= self.dec_max_deg
        )

    def cone(
        self,
        ra_icrs_deg: float,
        dec_icrs_deg: float,
        radius_deg: float,
        *,
        epoch_jyear: float = J2000_JYEAR,
    ) -> Stars:
        """Stars within ``radius_deg`` of a direction, with their places at the epoch."""
        years = epoch_jyear - J2000_JYEAR
        wide_deg = radius_deg + abs(years) * FASTEST_ARCSEC_YR / 3600.0
        reach = wide_deg / max(
            math.cos(math.radians(min(abs(dec_icrs_deg) + wide_deg, 89.9))), 1e-6
        )
        index = self._box(ra_icrs_deg, dec_icrs_deg, min(reach, 180.0), wide_deg)
        index = index[np.argsort(self.mmag[index], kind="stable")]
        ra = _scaled(self.ra_counts[index], RA_STEP_DEG)
        dec = _scaled(self.dec_counts[index], DEC_STEP_DEG)
        pm_ra = self.pm_ra_mas_yr[index].astype(np.float64)
        pm_dec = self.pm_dec_mas_yr[index].astype(np.float64)
        if years:
            ra, dec = apply_proper_motion(ra, dec, pm_ra, pm_dec, years)
        near = separation_deg(ra_icrs_deg, dec_icrs_deg, ra, dec) <= radius_deg
        index = index[near]
        return Stars(
            ra_icrs_deg=ra[near],
            dec_icrs_deg=dec[near],
            magnitude=_scaled(self.mmag[index], MAG_STEP),
            pm_ra_mas_yr=pm_ra[near],
            pm_dec_mas_yr=pm_dec[near],
            colour_mag=_known(self.colour_mmag[index], MAG_STEP, NO_COLOUR),
            sigma_mag=_known(self.sigma_counts[index], SIGMA_MAG_STEP, NO_SIGMA),
        )

    def _box(
        self, ra_deg: float, dec_deg: float, half_ra_deg: float, half_dec_deg: float
    ) -> IndexArray:
        limits = np.array([dec_deg - half_dec_deg, dec_deg + half_dec_deg]) / DEC_STEP_DEG
        # Limits beyond the poles would not fit into the counts.
        lowest, highest = np.clip(np.round(limits), -(2**31), 2**31 - 1).astype(np.int32)
        first = int(np.searchsorted(self.dec_counts, lowest, side="left"))
        last = int(np.searchsorted(self.dec_counts, highest, side="right"))
        away = np.abs(_scaled(self.ra_counts[first:last], RA_STEP_DEG) - ra_deg % 360.0)
        is_near = (away <= half_ra_deg) | (away >= 360.0 - half_ra_deg)
        return np.asarray(first + np.flatnonzero(is_near), dtype=np.int64)


def _scaled(counts: npt.NDArray[np.integer[Any]], step: float) -> FloatArray:
    return np.asarray(np.multiply(counts, step, dtype=np.float64))


def _known(counts: npt.NDArray[np.integer[Any]], step: float, unknown: int) -> FloatArray:
    """Scale counts; NaN where they say that nothing is known."""
    return np.where(counts == unknown, np.nan, _scaled(counts, step))


def has_tycho2_stars(path: Path) -> bool:
    """True where a FITS file holds Tycho-2 stars, as the solver's index files do.

    Reads headers only; False where the file cannot be read.
    """
    from astropy.io import fits

    try:
        with fits.open(path) as tables:
            return any(table.header.get("TTYPE1", "") == "MAG_VT" for table in tables[1:])
    except OSError:
        return False


@lru_cache(maxsize=2)
def _load(path: Path) -> StarCatalogue:
    return _read(path)


@lru_cache(maxsize=1)
def _load_whole_sky() -> StarCatalogue:
    """Load the rest of the sky with the belt in the middle of it."""
    belt, rest = _load(resource_path(*_SHIPPED)), _read(resource_path(*_SHIPPED_REST))
    south = int(np.searchsorted(rest.dec_counts, 0))
    columns: dict[str, Any] = {}
    for name in _COLUMNS:
        outer = getattr(rest, name)
        column = np.concatenate([outer[:south], getattr(belt, name), outer[south:]])
        column.setflags(write=False)
        columns[name] = column
    return StarCatalogue(**columns, dec_min_deg=-90.0, dec_max_deg=90.0)


def _read(path: Path) -> StarCatalogue:
    columns: dict[str, Any] = {}
    try:
        with np.load(path) as stored:
            for name, (key, kind) in _COLUMNS.items():
                columns[name] = stored[key].astype(kind, copy=False)
            columns["dec_counts"] = np.cumsum(stored["dec_steps"], dtype=np.int32)
            lowest, highest = (float(v) for v in stored["dec_limits_deg"])
    except (OSError, KeyError, ValueError, EOFError) as error:
        raise SolverError(f"{path} is no star catalogue ({error}): install again") from error
    for column in columns.values():
        column.setflags(write=False)
    return StarCatalogue(**columns, dec_min_deg=lowest, dec_max_deg=highest)
