"""The plate geometry against astropy.wcs."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rsoconsole.base import FrameError
from rsoconsole.records import Wcs
from rsoconsole.sky import separation_deg
from rsoconsole.sky import wcs as plate

SHARED = Path(__file__).parents[3] / "shared" / "data"
WIDTH, HEIGHT = 4656, 3520
MILLIARCSEC_DEG = 1e-3 / 3600
THOUSANDTH_PX = 1e-3


def make(ra=10.0, dec=-5.0, rotation=0.0, is_flipped=False) -> Wcs:
    return plate.tan_wcs(
        ra,
        dec,
        scale_arcsec_px=1.264,
        rotation_deg=rotation,
        is_flipped=is_flipped,
        width_px=WIDTH,
        height_px=HEIGHT,
    )


def distorted(wcs: Wcs) -> Wcs:
    """A few pixels at the corners, as a fast astrograph has it."""
    return Wcs(
        crpix_x_px=wcs.crpix_x_px + 31.5,
        crpix_y_px=wcs.crpix_y_px - 12.25,
        crval_ra_deg=wcs.crval_ra_deg,
        crval_dec_deg=wcs.crval_dec_deg,
        cd=wcs.cd,
        sip_a=((2, 0, 1.2e-7), (1, 1, -3e-7), (0, 2, 2e-7), (3, 0, 4e-10), (1, 2, 3e-10)),
        sip_b=((2, 0, -2e-7), (1, 1, 1e-7), (0, 2, 3e-7), (2, 1, 3e-10), (0, 3, 4e-10)),
    )


def astropy_wcs(wcs: Wcs):
    from astropy.io import fits
    from astropy.wcs import WCS

    header = fits.Header()
    for name, value in plate.wcs_cards(wcs, WIDTH, HEIGHT).items():
        header[name] = value
    return WCS(header)


def grid():
    x, y = np.meshgrid(np.linspace(0, WIDTH - 1, 7), np.linspace(0, HEIGHT - 1, 5))
    return x.ravel(), y.ravel()


@pytest.mark.parametrize("is_distorted", [False, True])
@pytest.mark.parametrize(
    ("ra", "dec", "rotation", "is_flipped"),
    [(10, -5, 0, False), (359.9, 0, 91, True), (303.2, 46, 200, False), (80, 89.6, 333, True)],
)
def test_pixels_and_sky_agree_with_astropy(ra, dec, rotation, is_flipped, is_distorted):
    ours = make(ra, dec, rotation, is_flipped)
    ours = distorted(ours) if is_distorted else ours
    theirs = astropy_wcs(ours)
    x, y = grid()
    ra_deg, dec_deg = plate.pixel_to_sky(ours, x, y)
    ra_theirs, dec_theirs = theirs.all_pix2world(x, y, 0)
    assert np.max(separation_deg(ra_deg, dec_deg, ra_theirs, dec_theirs)) < MILLIARCSEC_DEG
    x_back, y_back = plate.sky_to_pixel(ours, ra_theirs, dec_theirs)
    assert x_back == pytest.approx(x, abs=THOUSANDTH_PX)
    assert y_back == pytest.approx(y, abs=THOUSANDTH_PX)


def test_distortion_moves_the_corners_by_pixels():
    """The comparison above would not notice distortion being ignored unless it is this large."""
    x, y = plate.sky_to_pixel(distorted(make()), *plate.pixel_to_sky(make(), 0.0, 0.0))
    assert np.hypot(x - 31.5, y + 12.25) > 1.0


def test_the_opposite_sky_has_no_pixel():
    for wcs in (make(), distorted(make())):
        x, y = plate.sky_to_pixel(wcs, np.array([190.0, 10.0]), np.array([5.0, -5.0]))
        assert np.isnan(x[0])
        assert np.isnan(y[0])
        assert np.isfinite(x[1])


@settings(max_examples=60, deadline=None)
@given(
    ra=st.floats(0, 359.99),
    dec=st.floats(-88, 88),
    rotation=st.floats(0, 359.9),
    is_flipped=st.booleans(),
)
def test_a_plate_is_described_as_it_was_made(ra, dec, rotation, is_flipped):
    field = plate.describe_field(make(ra, dec, rotation, is_flipped), WIDTH, HEIGHT)
    assert separation_deg(field.ra_icrs_deg, field.dec_icrs_deg, ra, dec) < MILLIARCSEC_DEG
    assert field.scale_arcsec_px == pytest.approx(1.264, rel=1e-6)
    assert (field.rotation_deg - rotation + 180) % 360 - 180 == pytest.approx(0, abs=1e-4)
    assert field.is_flipped is is_flipped


def test_unflipped_and_unrotated_has_north_up_and_east_left():
    wcs = make()
    ra, dec = plate.pixel_to_sky(wcs, np.array([0.0, 2327.5]), np.array([1759.5, 3519.0]))
    assert ra[0] > 10.0
    assert dec[1] > -5.0
    jacobian = plate.jacobian_arcsec_px(wcs, 2327.5, 1759.5)
    assert jacobian == pytest.approx(np.array([[-1.264, 0], [0, 1.264]]), abs=1e-6)


def test_a_rotation_turns_plus_y_from_north_to_east():
    ra, dec = plate.pixel_to_sky(make(10.0, 0.0, rotation=90.0), 2327.5, 3519.0)
    assert ra > 10.0
    assert dec == pytest.approx(0.0, abs=1e-9)


def test_jacobian_is_the_motion_of_the_sky_under_a_pixel():
    wcs = distorted(make(200.0, 60.0, 33.0))
    x, y = 4000.0, 300.0
    ra, dec = plate.pixel_to_sky(wcs, np.array([x, x + 2.0]), np.array([y, y - 3.0]))
    east, north = plate.jacobian_arcsec_px(wcs, x, y) @ [2.0, -3.0]
    moved = [(ra[1] - ra[0]) * np.cos(np.radians(dec[0])) * 3600, (dec[1] - dec[0]) * 3600]
    assert [east, north] == pytest.approx(moved, abs=0.005)


@pytest.mark.parametrize("wcs", [make(1.0, 2.0, 30.0, True), distorted(make(350.0, -30.0, 12.0))])
def test_a_plate_survives_fits_cards(wcs):
    back = plate.wcs_from_cards(plate.wcs_cards(wcs, WIDTH, HEIGHT))
    assert back.cd == wcs.cd
    assert sorted(back.sip_a) == sorted(wcs.sip_a)
    assert sorted(back.sip_b) == sorted(wcs.sip_b)
    assert (back.crpix_x_px, back.crval_ra_deg) == pytest.approx((wcs.crpix_x_px, wcs.crval_ra_deg))
    cards = plate.wcs_cards(wcs, WIDTH, HEIGHT)
    assert cards["RADESYS"] == "ICRS"
    assert cards["CRPIX1"] == pytest.approx(wcs.crpix_x_px + 1)


@pytest.mark.parametrize(
    "linear",
    [
        {"CDELT1": -3e-4, "CDELT2": 3e-4, "CROTA2": 25.0},
        {"CDELT1": -3e-4, "CDELT2": 3e-4},
        {"CDELT1": -3e-4, "CDELT2": 3e-4, "PC1_1": 0.8, "PC1_2": -0.6, "PC2_1": 0.6, "PC2_2": 0.8},
    ],
)
def test_older_cards_mean_what_astropy_says(linear):
    from astropy.io import fits
    from astropy.wcs import WCS

    cards = {"CTYPE1": "RA---TAN", "CTYPE2": "DEC--TAN", "CRPIX1": 100.0, "CRPIX2": 80.0}
    cards |= {"CRVAL1": 33.0, "CRVAL2": -20.0, **linear}
    theirs = WCS(fits.Header(cards)).all_pix2world(10.0, 190.0, 0)
    ours = plate.pixel_to_sky(plate.wcs_from_cards(cards), 10.0, 190.0)
    assert ours == pytest.approx((float(theirs[0]), float(theirs[1])), abs=MILLIARCSEC_DEG)


@pytest.mark.parametrize(
    "cards",
    [
        {},
        {"CTYPE1": "GLON-TAN", "CTYPE2": "GLAT-TAN"},
        {"CTYPE1": "RA---TAN", "CTYPE2": "DEC--TAN"},
    ],
)
def test_a_header_without_a_plate_is_refused(cards):
    with pytest.raises(FrameError):
        plate.wcs_from_cards(cards)


@pytest.mark.shared_data
@pytest.mark.filterwarnings("ignore:'datfix' made the change")  # that header lacks MJD-OBS
def test_a_real_solved_header_agrees_with_astropy():
    path = SHARED / "real" / "pocs_solved.fits.fz"
    if not path.exists():
        pytest.skip(f"independent test data not found: {path}")
    from astropy.io import fits
    from astropy.wcs import WCS

    with fits.open(path) as hdus:
        header = next(h.header for h in hdus if "CRVAL1" in h.header)
    ours = plate.wcs_from_cards(header)
    assert ours.sip_a
    x, y = np.array([0.0, 350.0, 699.0]), np.array([699.0, 350.0, 10.0])
    ra_theirs, dec_theirs = WCS(header).all_pix2world(x, y, 0)
    ra, dec = plate.pixel_to_sky(ours, x, y)
    assert np.max(separation_deg(ra, dec, ra_theirs, dec_theirs)) < MILLIARCSEC_DEG


@pytest.mark.parametrize(
    "change",
    [
        {"A_ORDER": 10**8},
        {"CRVAL1": 10**400},
        {"CRVAL2": "nan"},
        {"CD1_1": 0.0, "CD2_2": 0.0},
        {"CD1_1": float("inf")},
    ],
)
def test_a_plate_that_is_none_is_refused_at_once(change):
    cards = {
        "CTYPE1": "RA---TAN-SIP",
        "CTYPE2": "DEC--TAN-SIP",
        "CRPIX1": 480.0,
        "CRPIX2": 384.0,
        "CRVAL1": 313.4,
        "CRVAL2": -4.7,
        "CD1_1": -0.0014,
        "CD2_2": 0.0014,
    }
    assert plate.wcs_from_cards(cards).crval_ra_deg == 313.4
    with pytest.raises(FrameError, match="the header's plate"):
        plate.wcs_from_cards(cards | change)
