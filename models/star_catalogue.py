"""Make the shipped star catalogues from Tycho-2 and one index file of the plate solver.

``python -m models.star_catalogue TYCHO2 INDEX FOLDER``

The index file selects the stars (it thins crowded fields) and gives VT; the catalogue gives their
positions, proper motions, colours and the errors of VT. The index file's own positions are the
catalogue's at J2000.0, rounded to single precision (up to 0.055 arcsec), and at J1991.25 for the
stars of supplement 1; it also holds one entry at RA 0, Dec 0 that is no star. TYCHO2 is the folder
with ``tyc2.dat.00`` to ``tyc2.dat.19`` and ``suppl_1.dat`` (CDS I/259; Debian's source package
tycho2).
"""

import sys
from dataclasses import fields
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from rsoconsole.base import SolverError
from rsoconsole.records import FloatArray
from rsoconsole.sky import (
    DEC_STEP_DEG,
    J2000_JYEAR,
    MAG_STEP,
    NO_COLOUR,
    NO_SIGMA,
    RA_STEP_DEG,
    SIGMA_MAG_STEP,
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
_SAME_MAG = 0.01
"""VT in the index file and in the catalogue differ by no more than rounding."""
_COMPONENTS = 4
_TYC2_BYTES, _SUPPLEMENT_BYTES = 207, 123
_RA, _DEC, _PM_RA, _PM_DEC = (15, 27), (28, 40), (41, 48), (49, 56)
"""First and last byte of the columns, the same in the catalogue and its supplement."""
_BT, _VT, _SIGMA_VT = (110, 116), (123, 129), (130, 135)
"""Of the magnitudes in the catalogue; in the supplement they are 27 bytes nearer to the front."""
_SUPPLEMENT_SHIFT = 27


class Rows(NamedTuple):
    """Columns of Tycho-2; NaN where the catalogue has a blank."""

    ra_icrs_deg: FloatArray
    dec_icrs_deg: FloatArray
    pm_ra_mas_yr: FloatArray
    pm_dec_mas_yr: FloatArray
    bt_mag: FloatArray
    vt_mag: FloatArray
    sigma_mag: FloatArray
    """Standard error of VT."""


def build(tycho2: Path, index: Path, out: Path) -> tuple[StarCatalogue, StarCatalogue]:
    """Write ``tycho2_belt.npz`` and ``tycho2_rest.npz`` into ``out``; return both catalogues.

    Raises SolverError when a file cannot be read.
    """
    chosen = read_index(index)
    stars = matched(chosen, _supplemented(tycho2))
    is_belt = np.abs(stars.dec_icrs_deg) <= BELT_DEG
    written = []
    for name, kept, limit in (("belt", is_belt, BELT_DEG), ("rest", ~is_belt, 90.0)):
        columns = {each.name: getattr(stars, each.name)[kept] for each in fields(Stars)}
        catalogue = catalogue_of(Stars(**columns), -limit, limit)
        save(catalogue, out / f"tycho2_{name}.npz")
        written.append(catalogue)
    return written[0], written[1]


def catalogue_of(
    stars: Stars, dec_min_deg: float = -90.0, dec_max_deg: float = 90.0
) -> StarCatalogue:
    """Catalogue of stars given at J2000.0, rounded to 0.3 mas, 1 mmag and 1 mas/yr.

    Errors of magnitudes are rounded to 0.01 mag, those above 2.54 mag stand at that.
    Stars outside the declinations are left out.
    """
    order = np.argsort(stars.dec_icrs_deg, kind="stable")
    colour_mmag = np.round(stars.colour_mag[order] / MAG_STEP)
    sigma_counts = np.minimum(np.round(stars.sigma_mag[order] / SIGMA_MAG_STEP), NO_SIGMA - 1)
    ra_counts = np.round(stars.ra_icrs_deg[order] % 360.0 / RA_STEP_DEG).astype(np.uint64)
    return StarCatalogue(
        ra_counts.astype(np.uint32),
        np.round(stars.dec_icrs_deg[order] / DEC_STEP_DEG).astype(np.int32),
        np.round(stars.magnitude[order] / MAG_STEP).astype(np.int16),
        np.round(stars.pm_ra_mas_yr[order]).astype(np.int16),
        np.round(stars.pm_dec_mas_yr[order]).astype(np.int16),
        np.nan_to_num(colour_mmag, nan=NO_COLOUR).astype(np.int16),
        np.nan_to_num(sigma_counts, nan=NO_SIGMA).astype(np.uint8),
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
        colour_mmag=catalogue.colour_mmag,
        sigma=catalogue.sigma_counts,
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


def read_rows(path: Path, row_bytes: int) -> Rows:
    """Rows of one file of Tycho-2: 207 bytes each in the catalogue, 123 in its supplement.

    Raises SolverError when the file is not made of such rows.
    """
    try:
        content = np.fromfile(path, np.uint8)
    except OSError as error:
        raise SolverError(f"{path} cannot be read: {error}") from error
    if not len(content) or len(content) % row_bytes:
        raise SolverError(f"{path} is no file of Tycho-2: its rows have {row_bytes} bytes")
    rows = content.reshape(-1, row_bytes)
    shift = 0 if row_bytes == _TYC2_BYTES else _SUPPLEMENT_SHIFT
    photometry = [(a - shift, b - shift) for a, b in (_BT, _VT, _SIGMA_VT)]
    return Rows(*(_numbers(rows[:, a:b]) for a, b in (_RA, _DEC, _PM_RA, _PM_DEC, *photometry)))


def matched(chosen: tuple[FloatArray, FloatArray, FloatArray], source: tuple[Rows, Rows]) -> Stars:
    """The chosen stars with the catalogue's positions and motions at J2000.0, and their colours.

    ``chosen``: RA, Dec (deg) and magnitude in the index file; entries without a star in the
    catalogue are left out. ``source``: positions as the index file has them, then the same stars at
    J2000.0. Components of a close pair share one place: each is told by its magnitude.
    """
    from scipy.spatial import cKDTree

    as_indexed, at_j2000 = source
    ra, dec, magnitude = chosen
    tree = cKDTree(direction_to_unit(as_indexed.ra_icrs_deg, as_indexed.dec_icrs_deg))
    near = min(_COMPONENTS, len(as_indexed.ra_icrs_deg))
    distances, entries = tree.query(direction_to_unit(ra, dec), k=np.arange(1, near + 1))
    found = distances[:, 0] < np.radians(_ROUNDING_ARCSEC / 3600.0)
    distances, entries, magnitude = distances[found], entries[found], magnitude[found]
    rows = Rows(*(column[entries[:, 0]] for column in at_j2000))
    off_mag = np.abs(at_j2000.vt_mag[entries] - magnitude[:, None])
    is_there = distances < np.radians(_ROUNDING_ARCSEC / 3600.0)
    off_mag = np.where(is_there & np.isfinite(off_mag), off_mag, np.inf)
    of_light = entries[np.arange(len(entries)), np.argmin(off_mag, axis=1)]
    is_same = np.min(off_mag, axis=1, initial=np.inf) < _SAME_MAG
    colour = at_j2000.bt_mag[of_light] - at_j2000.vt_mag[of_light]
    return Stars(
        ra_icrs_deg=rows.ra_icrs_deg,
        dec_icrs_deg=rows.dec_icrs_deg,
        magnitude=magnitude,
        pm_ra_mas_yr=np.nan_to_num(rows.pm_ra_mas_yr),
        pm_dec_mas_yr=np.nan_to_num(rows.pm_dec_mas_yr),
        colour_mag=np.where(is_same, colour, np.nan),
        sigma_mag=np.where(is_same, at_j2000.sigma_mag[of_light], np.nan),
    )


def _supplemented(folder: Path) -> tuple[Rows, Rows]:
    """Catalogue and supplement 1 together: places as the index has them, and at J2000.0."""
    parts = [read_rows(path, _TYC2_BYTES) for path in sorted(folder.glob("tyc2.dat.*"))]
    if not parts:
        raise SolverError(f"{folder} holds no tyc2.dat.00: name the folder of CDS I/259")
    supplement = read_rows(folder / "suppl_1.dat", _SUPPLEMENT_BYTES)
    ra, dec, pm_ra, pm_dec = supplement[:4]
    motions = (np.nan_to_num(pm_ra), np.nan_to_num(pm_dec))
    brought = apply_proper_motion(ra, dec, *motions, J2000_JYEAR - SUPPLEMENT_JYEAR)

    def joined(last: Rows) -> Rows:
        table = np.concatenate([np.stack(each) for each in (*parts, last)], axis=1)
        return Rows(*table[:, np.isfinite(table[0])])

    return joined(supplement), joined(Rows(*brought, *motions, *supplement[4:]))


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
