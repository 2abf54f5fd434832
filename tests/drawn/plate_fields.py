"""Star fields for the solver's tests: shipped Tycho-2 stars, or frames of another simulator."""

import bz2
import functools
import io
import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rsoconsole.instruments import list_index_files
from rsoconsole.instruments.solver.index_files import SYSTEM_DIR
from rsoconsole.records import FloatArray, Wcs
from rsoconsole.sky import StarCatalogue, tan_wcs, wcs_cards
from rsoconsole.vision import find_stars

SHARED = Path(__file__).resolve().parents[3] / "shared" / "data"
CACHE = Path(__file__).resolve().parents[2] / ".cache" / "index"
WIDTH, HEIGHT, SCALE = 4656, 3520, 1.2642
SIZE = {"width_px": WIDTH, "height_px": HEIGHT}


def belt_plate(ra_deg: float, dec_deg: float, *, is_flipped: bool = False) -> Wcs:
    """A plate of the paper's telescope."""
    return tan_wcs(
        ra_deg, dec_deg, scale_arcsec_px=SCALE, rotation_deg=33.0, is_flipped=is_flipped, **SIZE
    )


def belt_stars(wcs: Wcs, seed: int = 0, false_stars: int = 40) -> FloatArray:
    """(N, 3) x, y, flux of the shipped stars as astropy projects them, noise and strays added."""
    from astropy.wcs import WCS

    rng = np.random.default_rng(seed)
    stars = StarCatalogue.load().cone(wcs.crval_ra_deg, wcs.crval_dec_deg, 1.1)
    radec = np.stack([stars.ra_icrs_deg, stars.dec_icrs_deg], axis=1)
    xy = WCS(wcs_cards(wcs, WIDTH, HEIGHT)).all_world2pix(radec, 0)
    rows = np.column_stack([xy, 10 ** (-0.4 * (stars.magnitude - 20.0))])
    inside = (xy > 0).all(axis=1) & (xy < (WIDTH - 1, HEIGHT - 1)).all(axis=1)
    rows = rows[inside]
    rows[:, :2] += rng.normal(0.0, 0.1, (len(rows), 2))
    strays = np.column_stack(
        [
            rng.uniform((0, 0), (WIDTH, HEIGHT), (false_stars, 2)),
            rng.choice(rows[:, 2], false_stars),
        ]
    )
    return np.concatenate([rows, strays])


@functools.cache
def satsim_frame(sequence: str, index: int) -> tuple[FloatArray, dict[str, Any]]:
    """Stars that ``find_stars`` sees in a frame of SatSim, and the frame's truth."""
    folder = SHARED / "simulated" / sequence
    if not folder.is_dir():
        pytest.skip(f"{folder} is absent: the independent test data are not beside the project")
    from astropy.io import fits

    truth = json.loads((folder / "truth.json").read_text(encoding="utf-8"))["frames"][index]
    with bz2.open(folder / truth["file"]) as packed, fits.open(io.BytesIO(packed.read())) as hdus:
        return star_rows(np.asarray(hdus[0].data)), truth


def star_rows(pixels: np.ndarray) -> FloatArray:
    """(N, 3) x, y, flux."""
    stars = find_stars(np.ascontiguousarray(pixels.astype(np.uint16)))
    return np.stack([stars.x_px, stars.y_px, stars.flux], axis=1)


def whole_sky_index_dir() -> Path:
    """Debian's index files: installed, named by the environment, or fetched; skips without."""
    named = os.environ.get("RSOCONSOLE_TEST_INDEX")
    roots = [Path(named)] if named else [SYSTEM_DIR, CACHE]
    for root in roots:
        for folder in sorted({path.parent for path in root.rglob("index-*.fits")}):
            scales = {file.scale for file in list_index_files([folder]) if file.is_healthy}
            if {8, 9, 10, 12, 14} <= scales:
                return folder
    pytest.skip("no whole-sky index files: tests/fetch_debian_index.sh gets Debian's")
