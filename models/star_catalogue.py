"""Make the shipped star catalogues from Tycho-2 and one index file of the plate solver.

``python -m models.star_catalogue TYCHO2 INDEX FOLDER``

The index file selects the stars (it thins crowded fields); the catalogue gives their positions and
proper motions. The index file's own positions are the catalogue's at J2000.0, rounded to single
precision (up to 0.055 arcsec), and at J1991.25 for the stars of supplement 1; it also holds one
entry at RA 0, Dec 0 that is no star. TYCHO2 is the folder with ``tyc2.dat.00`` to ``tyc2.dat.19``
and ``suppl_1.dat`` (CDS I/259; Debian's source package tycho2).
"""

import sys
from pathlib import Path

import numpy as np
import numpy.typing as npt

from rsoconsole.base import SolverError
from rsoconsole.records import FloatArray
from rsoconsole.sky import (
    DEC_STEP_DEG,
    J2000_JYEAR,
    MAG_STEP,
    RA_STEP_DEG,
    StarCatalogue,
    Stars,
    apply_proper_motion,
    direction_to_unit,
    unit_to_direction,
)

USAGE = "usage: python -m models.star_catalogue TYCHO2_FOLDER INDEX OUT_FOLDER"
BELT_DEG = 12.0
SUPPLEMENT_JYEAR = 1991.25
_ROUNDING_ARCSEC = 0.1
_TYC2_BYTES, _SUPPLEMENT_BYTES = 207, 123
_RA, _DEC, _PM_RA, _PM_DEC = (15, 27), (28, 40), (41, 48), (49, 56)
"""First and last byte of the columns, the same in the catalogue and its supplement."""

Places = tuple[FloatArray, FloatArray, FloatArray, FloatArray]


def build(tycho2: Path, index: Path, out: Path) -> tuple[StarCatalogue, StarCatalogue]:
    """Write ``tycho2_belt.npz`` and ``tycho2_rest.npz`` into ``out``; return both catalogues.

    Raises SolverError when a file cannot be read.
    """
    chosen = read_index(index)
    stars = matched(chosen, _supplemented(tycho2))
    is_belt = np.abs(stars.dec_icrs_deg) <= BELT_DEG
    written = []
    for name, kept, limit in (("belt", is_belt, BELT_DEG), ("rest", ~is_belt, 90.0)):
        columns = (
            stars.ra_icrs_deg,
            stars.dec_icrs_deg,
            stars.magnitude,
            stars.pm_ra_mas_yr,
            stars.pm_dec_mas_yr,
        )
        catalogue = catalogue_of(Stars(*(each[kept] for each in columns)), -limit, limit)
        save(catalogue, out / f"tycho2_{name}.npz")
        written.append(catalogue)
    return written[0], written[1]


def catalogue_of(
    stars: Stars, dec_min_deg: float = -90.0, dec_max_deg: float = 90.0
) -> StarCatalogue:
    """Catalogue of stars given at J2000.0, rounded to 0.3 mas, 1 mmag and 1 mas/yr.

    Stars outside the declinations are left out.
    """
    order = np.argsort(stars.dec_icrs_deg, kind="stable")
    ra_counts = np.round(stars.ra_icrs_deg[order] % 360.0 / RA_STEP_DEG).astype(np.uint64)
    return StarCatalogue(
        ra_counts.astype(np.uint32),
        np.round(stars.dec_icrs_deg[order] / DEC_STEP_DEG).astype(np.int32),
        np.round(stars.magnitude[order] / MAG_STEP).astype(np.int16),
        np.round(stars.pm_ra_mas_yr[order]).astype(np.int16),
        np.round(stars.pm_dec_mas_yr[order]).astype(np.int16),
        dec_min_deg,
        dec_max_deg,
    )


def save(catalogue: StarCatalogue, path: Path) -> None:
    """Write a compact file that ``StarCatalogue.load`` reads.

    Declinations are stored as differences from star to star.
    """
    np.savez_compressed(
        path,
        ra=catalogue.ra_counts,
        dec_steps=np.diff(catalogue.dec_counts, prepend=np.int32(0)),
        mmag=catalogue.mmag,
        pm_ra=catalogue.pm_ra_mas_yr,
        pm_dec=catalogue.pm_dec_mas_yr,
        dec_limits_deg=np.array([catalogue.dec_min_deg, catalogue.dec_max_deg]),
    )


def read_index(path: Path) -> tuple[FloatArray, FloatArray, FloatArray]:
    """RA, Dec (deg) and VT of every star in an index file: its kd-tree holds unit vectors.

    The tree stores u32 counts of (value - lowest) times a scale; its leaves keep the order of the
    tag-along table. Raises SolverError when the file holds no stars with MAG_VT.
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


def read_places(path: Path, row_bytes: int) -> Places:
    """RA, Dec (deg) and proper motions (mas/yr) in one file of Tycho-2; NaN where blank.

    Raises SolverError when the file is not made of such rows.
    """
    try:
        content = np.fromfile(path, np.uint8)
    except OSError as error:
        raise SolverError(f"{path} cannot be read: {error}") from error
    if not len(content) or len(content) % row_bytes:
        raise SolverError(f"{path} is no file of Tycho-2: its rows have {row_bytes} bytes")
    rows = content.reshape(-1, row_bytes)
    ra, dec, pm_ra, pm_dec = (_numbers(rows[:, a:b]) for a, b in (_RA, _DEC, _PM_RA, _PM_DEC))
    return ra, dec, pm_ra, pm_dec


def matched(chosen: tuple[FloatArray, FloatArray, FloatArray], source: tuple[Places, ...]) -> Stars:
    """The chosen stars with the catalogue's positions and motions at J2000.0.

    ``chosen``: RA, Dec (deg) and magnitude in the index file; entries without a star in the
    catalogue are left out. ``source``: positions as the index file has them, then the same stars at
    J2000.0.
    """
    from scipy.spatial import cKDTree

    as_indexed, at_j2000 = source
    ra, dec, magnitude = chosen
    tree = cKDTree(direction_to_unit(as_indexed[0], as_indexed[1]))
    distance, entry = tree.query(direction_to_unit(ra, dec))
    found = distance < np.radians(_ROUNDING_ARCSEC / 3600.0)
    ra, dec, pm_ra, pm_dec = (column[entry[found]] for column in at_j2000)
    return Stars(ra, dec, magnitude[found], np.nan_to_num(pm_ra), np.nan_to_num(pm_dec))


def _supplemented(folder: Path) -> tuple[Places, Places]:
    """Catalogue and supplement 1 together: places as the index has them, and at J2000.0."""
    parts = [read_places(path, _TYC2_BYTES) for path in sorted(folder.glob("tyc2.dat.*"))]
    if not parts:
        raise SolverError(f"{folder} holds no tyc2.dat.00: name the folder of CDS I/259")
    supplement = read_places(folder / "suppl_1.dat", _SUPPLEMENT_BYTES)
    ra, dec, pm_ra, pm_dec = supplement
    motions = (np.nan_to_num(pm_ra), np.nan_to_num(pm_dec))
    brought = apply_proper_motion(ra, dec, *motions, J2000_JYEAR - SUPPLEMENT_JYEAR)

    def joined(last: Places) -> Places:
        table = np.concatenate([np.stack(each) for each in (*parts, last)], axis=1)
        known = table[:, np.isfinite(table[0])]
        return known[0], known[1], known[2], known[3]

    return joined(supplement), joined((*brought, *motions))


def _numbers(characters: npt.NDArray[np.uint8]) -> FloatArray:
    """One column of text as numbers, NaN where blank."""
    width = characters.shape[1]
    words = np.char.strip(np.ascontiguousarray(characters).view(f"S{width}")[:, 0])
    numbers = np.full(len(words), np.nan)
    is_given = words != b""
    numbers[is_given] = words[is_given].astype(np.float64)
    return numbers


def main(arguments: list[str]) -> int:
    """Run the command line; exit status 0 after writing, 2 for wrong usage."""
    if len(arguments) != 3:
        sys.stderr.write(USAGE + "\n")
        return 2
    tycho2, index, out = (Path(each) for each in arguments)
    belt, rest = build(tycho2, index, out)
    sys.stdout.write(f"{out}: {len(belt)} stars of the belt, {len(rest)} of the rest of the sky\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
