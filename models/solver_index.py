"""Make the shipped index files of the plate solver out of one of Debian's, cut to the belt.

``python -m models.solver_index INDEX FOLDER``; needs astrometry.net's ``build-astrometry-index``.
"""

import argparse
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np
from astropy.table import Table

from models.star_catalogue import read_index


def build(source: Path, out: Path, max_dec_deg: float, scales: list[int]) -> list[Path]:
    """Build one index file per scale in ``out`` from the stars of ``source``; return their paths.

    Stars beyond |dec| = ``max_dec_deg`` are left out. ``scales``: astrometry.net's preset numbers.
    """
    ra_deg, dec_deg, mag_vt = read_index(source)
    inside = np.abs(dec_deg) <= max_dec_deg
    built = []
    with tempfile.TemporaryDirectory() as work:
        stars = Path(work) / "stars.fits"
        Table(
            {"RA": ra_deg[inside], "DEC": dec_deg[inside], "MAG_VT": mag_vt[inside].astype("f4")}
        ).write(stars)
        for scale in scales:
            name = f"index-tycho2-belt-{scale:02d}.fits"
            command = ["build-astrometry-index", "-i", stars.name, "-o", name, "-P", str(scale)]
            command += ["-S", "MAG_VT", "-E", "-d", "4", "-r", "1", "-I", str(4100 + scale), "-M"]
            # The command line is written into the file: keep it free of folders.
            subprocess.run(command, check=True, cwd=work)
            built.append(Path(shutil.move(Path(work) / name, out / name)))
    return built


def main() -> None:
    """Run the command line: build the index files that a release ships."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("source", type=Path, help="index-tycho2-08.littleendian.fits of Debian")
    parser.add_argument("out", type=Path)
    parser.add_argument("--max-dec", type=float, default=12.0)
    parser.add_argument("--scales", type=int, nargs="+", default=[8, 9, 10])
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    for path in build(options.source, options.out, options.max_dec, options.scales):
        print(path, path.stat().st_size)


if __name__ == "__main__":
    main()
