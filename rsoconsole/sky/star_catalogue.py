"""Stars of the Tycho-2 catalogue: where they are and how bright.

The shipped cut holds the belt of the geostationary satellites, |dec| <= 12 deg, down to VT about
12.5; a few stars brighter than third magnitude are missing, as Tycho-2 keeps them in a supplement.
Positions are those of the astrometry.net index files: ICRS, observed around 1991, without
proper motion. Source: Hog et al. 2000, A&A 355, L27; licence in ``data/COPYRIGHT.tycho2``.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from rsoconsole.errors import SolverError
from rsoconsole.records import FloatArray
from rsoconsole.resources import resource
from rsoconsole.sky.angles import separation_deg, unit_to_direction, wrap_180

RA_STEP_DEG = 360.0 / 2**32
"""Stored right ascensions count these (0.3 mas)."""
DEC_STEP_DEG = 1e-7
MAG_STEP = 1e-3
_SHIPPED = ("sky", "data", "tycho2_belt.npz")


@dataclass(frozen=True, slots=True, eq=False)
class Stars:
    """Stars of one piece of sky, brightest first; arrays of one length."""

    ra_icrs_deg: FloatArray
    dec_icrs_deg: FloatArray
    magnitude: FloatArray
    """Tycho VT."""

    def __len__(self) -> int:
        """Number of stars."""
        return len(self.magnitude)


@dataclass(frozen=True, slots=True, eq=False)
class StarCatalogue:
    """Stars in order of declination, and the declinations within which none is missing."""

    ra_icrs_deg: FloatArray
    dec_icrs_deg: FloatArray
    magnitude: FloatArray
    dec_min_deg: float
    dec_max_deg: float

    def __len__(self) -> int:
        """Number of stars."""
        return len(self.magnitude)

    @classmethod
    def load(cls, path: Path | None = None) -> "StarCatalogue":
        """The shipped cut, or a file written by ``save``; read once, then kept.

        Raises SolverError when the file cannot be read.
        """
        return _load(resource(*_SHIPPED) if path is None else path)

    @classmethod
    def from_index(
        cls, path: Path, dec_min_deg: float = -90.0, dec_max_deg: float = 90.0
    ) -> "StarCatalogue":
        """All stars of an astrometry.net Tycho-2 index file within these declinations.

        Raises SolverError when the file holds no stars with MAG_VT.
        """
        ra, dec, magnitude = _read_index(path)
        kept = (dec >= dec_min_deg) & (dec <= dec_max_deg) & np.isfinite(magnitude)
        order = np.flatnonzero(kept)[np.argsort(dec[kept], kind="stable")]
        return cls(ra[order], dec[order], magnitude[order], dec_min_deg, dec_max_deg)

    def save(self, path: Path) -> None:
        """Write a compact file that ``load`` reads: 0.3 mas and 1 mmag steps."""
        np.savez_compressed(
            path,
            ra=np.round(self.ra_icrs_deg / RA_STEP_DEG).astype(np.uint64).astype(np.uint32),
            dec=np.round(self.dec_icrs_deg / DEC_STEP_DEG).astype(np.int32),
            mmag=np.round(self.magnitude / MAG_STEP).astype(np.int16),
            dec_limits_deg=np.array([self.dec_min_deg, self.dec_max_deg]),
        )

    def covers(self, dec_icrs_deg: float, radius_deg: float = 0.0) -> bool:
        """False where the catalogue is cut off: an empty sky there says nothing of the sky."""
        return (
            self.dec_min_deg <= max(dec_icrs_deg - radius_deg, -90.0)
            and min(dec_icrs_deg + radius_deg, 90.0) <= self.dec_max_deg
        )

    def cone(
        self,
        ra_icrs_deg: float,
        dec_icrs_deg: float,
        radius_deg: float,
        faintest_magnitude: float = 99.0,
    ) -> Stars:
        """Stars within a great-circle distance, brightest first."""
        reach = radius_deg / max(
            math.cos(math.radians(min(abs(dec_icrs_deg) + radius_deg, 89.9))), 1e-6
        )
        index = self._box(ra_icrs_deg, dec_icrs_deg, min(reach, 180.0), radius_deg)
        index = index[self.magnitude[index] <= faintest_magnitude]
        distance = separation_deg(
            ra_icrs_deg, dec_icrs_deg, self.ra_icrs_deg[index], self.dec_icrs_deg[index]
        )
        return self._take(index[np.asarray(distance) <= radius_deg])

    def box(
        self,
        ra_icrs_deg: float,
        dec_icrs_deg: float,
        half_ra_deg: float,
        half_dec_deg: float,
        faintest_magnitude: float = 99.0,
    ) -> Stars:
        """Stars within these differences of right ascension and declination, brightest first."""
        index = self._box(ra_icrs_deg, dec_icrs_deg, half_ra_deg, half_dec_deg)
        return self._take(index[self.magnitude[index] <= faintest_magnitude])

    def _box(
        self, ra_deg: float, dec_deg: float, half_ra_deg: float, half_dec_deg: float
    ) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
        limits = np.array([dec_deg - half_dec_deg, dec_deg + half_dec_deg])
        first = int(np.searchsorted(self.dec_icrs_deg, limits[0], side="left"))
        last = int(np.searchsorted(self.dec_icrs_deg, limits[1], side="right"))
        dra = wrap_180(self.ra_icrs_deg[first:last] - ra_deg)
        return np.asarray(first + np.flatnonzero(np.abs(dra) <= half_ra_deg), dtype=np.int64)

    def _take(self, index: np.ndarray[tuple[int], np.dtype[np.int64]]) -> Stars:
        index = index[np.argsort(self.magnitude[index], kind="stable")]
        return Stars(self.ra_icrs_deg[index], self.dec_icrs_deg[index], self.magnitude[index])


def holds_stars(path: Path) -> bool:
    """Whether ``from_index`` can read this file: a Tycho-2 one. Quick: it looks at headers."""
    from astropy.io import fits

    try:
        with fits.open(path) as tables:
            return any(table.header.get("TTYPE1", "") == "MAG_VT" for table in tables[1:])
    except OSError:
        return False


@lru_cache(maxsize=2)
def _load(path: Path) -> StarCatalogue:
    try:
        with np.load(path) as stored:
            ra = stored["ra"].astype(np.float64) * RA_STEP_DEG
            dec = stored["dec"].astype(np.float64) * DEC_STEP_DEG
            magnitude = stored["mmag"].astype(np.float64) * MAG_STEP
            lowest, highest = (float(v) for v in stored["dec_limits_deg"])
    except (OSError, KeyError, ValueError, EOFError) as error:
        raise SolverError(f"{path} is no star catalogue ({error}): build it anew") from error
    for column in (ra, dec, magnitude):
        column.setflags(write=False)
    return StarCatalogue(ra, dec, magnitude, lowest, highest)


def _read_index(path: Path) -> tuple[FloatArray, FloatArray, FloatArray]:
    """RA, Dec (deg) and VT of every star in an index file: its kd-tree holds unit vectors.

    The tree stores u32 counts of (value - lowest) times a scale; its leaves keep the order of the
    tag-along table.
    """
    from astropy.io import fits

    try:
        with fits.open(path) as tables:
            data: dict[str, bytes] = {}
            magnitude: FloatArray | None = None
            for table in tables[1:]:
                name = str(table.header.get("TTYPE1", "")).strip()
                if name in {"kdtree_data_stars", "kdtree_range_stars"}:
                    data[name] = np.ascontiguousarray(table.data).tobytes()
                elif name == "MAG_VT":
                    magnitude = np.asarray(table.data["MAG_VT"], dtype=np.float64)
    except OSError as error:
        raise SolverError(f"{path} cannot be read as an index file: {error}") from error
    if magnitude is None or len(data) != 2:
        raise SolverError(f"{path} holds no stars with MAG_VT: take a Tycho-2 (4100) index file")
    scaling = np.frombuffer(data["kdtree_range_stars"], dtype="<f8")
    counts = np.frombuffer(data["kdtree_data_stars"], dtype="<u4").reshape(-1, 3)
    ra, dec = unit_to_direction(counts / scaling[6] + scaling[:3])
    return ra, dec, magnitude
