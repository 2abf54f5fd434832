"""Real frames of other observatories against whole-sky index files."""

from collections.abc import Iterator

import numpy as np
import pytest

from rsoconsole.instruments import PlateSolver, SolveHint
from rsoconsole.records import Solution
from rsoconsole.sky import pixel_to_sky, separation_deg, wcs_from_cards
from tests.drawn.plate_fields import SHARED, star_rows, whole_sky_index_dir

pytestmark = pytest.mark.shared_data

REAL = SHARED / "real"
TETRA3 = {
    "azi-135": (230.667, 11.035),
    "azi-45": (172.369, 57.649),
    "azi135": (296.757, 11.314),
    "azi45": (355.205, 58.152),
}
"""Centres published with the frames, RA and Dec in degrees."""
TWO_ARCMIN, TEN_ARCSEC = 120.0, 10.0


@pytest.fixture(scope="module")
def solver() -> Iterator[PlateSolver]:
    if not REAL.is_dir():
        pytest.skip(f"{REAL} is absent: the independent test data are not beside the project")
    with PlateSolver([whole_sky_index_dir()]) as plate_solver:
        yield plate_solver


def solve(solver: PlateSolver, pixels: np.ndarray, hint: SolveHint) -> Solution:
    height, width = pixels.shape
    found = solver.solve(
        star_rows(pixels), frame_id=1, width_px=width, height_px=height, hint=hint, deadline_s=60
    )
    assert isinstance(found, Solution), found
    return found


def off_arcsec(found: Solution, ra_deg: float, dec_deg: float) -> float:
    return 3600 * float(separation_deg(found.ra_icrs_deg, found.dec_icrs_deg, ra_deg, dec_deg))


@pytest.mark.parametrize("name", TETRA3)
@pytest.mark.parametrize(
    "hint", [SolveHint(scale_low_arcsec_px=36, scale_high_arcsec_px=44), SolveHint()]
)
def test_wide_frames_solve_with_a_scale_or_with_nothing(solver, name, hint):
    import cv2

    pixels = cv2.imread(str(REAL / f"tetra3_alt40_{name}.tiff"), cv2.IMREAD_UNCHANGED)
    found = solve(solver, pixels, hint)
    assert off_arcsec(found, *TETRA3[name]) < TWO_ARCMIN
    assert found.rms_arcsec < 0.2 * found.scale_arcsec_px
    again = solver.refit_from(found, star_rows(pixels), frame_id=2, width_px=1024, height_px=768)
    assert again is not None
    assert off_arcsec(again, found.ra_icrs_deg, found.dec_icrs_deg) < 0.05 * found.scale_arcsec_px


def pocs(name: str) -> tuple[np.ndarray, dict]:
    from astropy.io import fits

    with fits.open(REAL / name) as hdus:
        hdu = next(hdu for hdu in hdus if hdu.data is not None)
        return np.asarray(hdu.data), dict(hdu.header)


POCS_HINT = SolveHint(scale_low_arcsec_px=9.8, scale_high_arcsec_px=10.8)


def test_a_frame_solved_by_others_agrees_with_their_plate(solver):
    pixels, header = pocs("pocs_solved.fits.fz")
    ra_deg, dec_deg = pixel_to_sky(wcs_from_cards(header), 349.5, 349.5)
    found = solve(solver, pixels, POCS_HINT)
    assert off_arcsec(found, float(ra_deg), float(dec_deg)) < TEN_ARCSEC


def test_the_exposure_before_it_lies_where_the_drift_of_its_stars_says(solver):
    """The unsolved file is another exposure, two minutes earlier; the mount drifted meanwhile.

    The drift comes from the two star lists alone, without a plate.
    """
    pixels, _ = pocs("pocs_unsolved.fits")
    later_pixels, header = pocs("pocs_solved.fits.fz")
    drift_px = median_drift_px(star_rows(pixels), star_rows(later_pixels))
    assert np.hypot(*drift_px) * 10.3 > TEN_ARCSEC
    theirs = wcs_from_cards(header)
    ra_deg, dec_deg = pixel_to_sky(theirs, 349.5 + drift_px[0], 349.5 + drift_px[1])
    found = solve(solver, pixels, POCS_HINT)
    assert off_arcsec(found, float(ra_deg), float(dec_deg)) < TEN_ARCSEC
    # Their plate has residuals of 1 to 2 px; this one's stars must fit much better.
    assert found.rms_arcsec < 0.2 * 10.3


def median_drift_px(earlier: np.ndarray, later: np.ndarray) -> np.ndarray:
    """How much further right and down a star lies in the later frame."""
    difference = later[None, :, :2] - earlier[:, None, :2]
    distance = np.hypot(difference[..., 0], difference[..., 1])
    nearest = distance.argmin(axis=1)
    rows = np.flatnonzero(distance.min(axis=1) < 4.0)
    assert len(rows) > 100
    return np.median(difference[rows, nearest[rows]], axis=0)
