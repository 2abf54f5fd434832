"""Plates from matched stars; the truth is projected by astropy, not by the code under test."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rsoconsole.records import FloatArray, Wcs
from rsoconsole.sky import describe_field, pixel_to_sky, separation_deg, tan_wcs, wcs_cards
from rsoconsole.vision import PlateFit, refit, refit_moved_plate, solution_from

WIDTH, HEIGHT, SCALE = 4656, 3520, 1.2642
SIZE = {"width_px": WIDTH, "height_px": HEIGHT}
CENTRE = ((WIDTH - 1) / 2, (HEIGHT - 1) / 2)


def plate(ra_deg: float = 150.0, dec_deg: float = -5.0, rotation_deg: float = 12.0) -> Wcs:
    return tan_wcs(
        ra_deg,
        dec_deg,
        scale_arcsec_px=SCALE,
        rotation_deg=rotation_deg,
        is_flipped=False,
        width_px=WIDTH,
        height_px=HEIGHT,
    )


def stars_around(wcs: Wcs, count: int, rng: np.random.Generator, margin: float = 0.3) -> FloatArray:
    """Catalogue stars strewn over the field and beyond it."""
    x = rng.uniform(-margin * WIDTH, (1 + margin) * WIDTH, count)
    y = rng.uniform(-margin * HEIGHT, (1 + margin) * HEIGHT, count)
    return np.stack(pixel_to_sky(wcs, x, y), axis=1)


def seen(wcs: Wcs, catalogue: FloatArray, rng: np.random.Generator, sigma_px: float) -> FloatArray:
    """What a camera with this plate sees of them, by astropy, brightness order kept."""
    from astropy.wcs import WCS

    xy = WCS(wcs_cards(wcs, WIDTH, HEIGHT)).all_world2pix(catalogue, 0)
    inside = (np.abs(xy - np.array(CENTRE)) < np.array(CENTRE)).all(axis=1)
    return xy[inside] + rng.normal(0.0, sigma_px, (int(inside.sum()), 2))


def centre_error_arcsec(found: PlateFit | None, truth: Wcs) -> float:
    assert found is not None
    a, b = pixel_to_sky(found.wcs, *CENTRE), pixel_to_sky(truth, *CENTRE)
    return 3600 * separation_deg(float(a[0]), float(a[1]), float(b[0]), float(b[1]))


def test_plate_is_recovered_as_well_as_its_stars_and_their_residuals_say():
    rng = np.random.default_rng(1)
    ratios = []
    for _ in range(40):
        truth = plate(rotation_deg=float(rng.uniform(0, 360)))
        catalogue = stars_around(truth, 120, rng)
        xy = seen(truth, catalogue, rng, sigma_px=0.3)
        found = refit(xy, catalogue, truth, **SIZE)
        assert found is not None
        ratios.append(centre_error_arcsec(found, truth) / (found.rms_arcsec / found.matched**0.5))
    # The error has two axes: its mean square is 2 sigma^2; 25 % is 3 sigma for 40 trials.
    assert np.sqrt(np.mean(np.square(ratios)) / 2) == pytest.approx(1.0, rel=0.25)


def test_a_start_that_is_a_quads_guess_away_still_finds_every_star():
    rng = np.random.default_rng(2)
    truth = plate()
    catalogue = stars_around(truth, 150, rng)
    xy = seen(truth, catalogue, rng, sigma_px=0.1)
    start = tan_wcs(
        150.0 + 8 / 3600,
        -5.0 - 8 / 3600,
        scale_arcsec_px=SCALE * 1.002,
        rotation_deg=12.1,
        is_flipped=False,
        **SIZE,
    )
    found = refit(xy, catalogue, start, **SIZE)
    assert found is not None
    assert found.matched >= 0.95 * len(xy)
    assert centre_error_arcsec(found, truth) < 0.1


def test_a_third_of_false_stars_does_not_pull_the_plate():
    rng = np.random.default_rng(3)
    truth = plate()
    catalogue = stars_around(truth, 120, rng)
    xy = seen(truth, catalogue, rng, sigma_px=0.1)
    false = rng.uniform((0, 0), (WIDTH, HEIGHT), (len(xy) // 2, 2))
    found = refit(np.concatenate([false, xy]), catalogue, truth, **SIZE)
    assert centre_error_arcsec(found, truth) < 0.1


def test_distortion_is_fitted_only_where_there_is_some():
    rng = np.random.default_rng(4)
    straight = plate()
    bend = 2e-9  # 25 px at the middle of the left and right edges
    bent = Wcs(
        crpix_x_px=straight.crpix_x_px,
        crpix_y_px=straight.crpix_y_px,
        crval_ra_deg=straight.crval_ra_deg,
        crval_dec_deg=straight.crval_dec_deg,
        cd=straight.cd,
        sip_a=((3, 0, bend), (1, 2, bend)),
        sip_b=((2, 1, bend), (0, 3, bend)),
    )
    catalogue = stars_around(straight, 200, rng)
    flat = refit(seen(straight, catalogue, rng, 0.2), catalogue, straight, **SIZE)
    curved = refit(seen(bent, catalogue, rng, 0.2), catalogue, straight, **SIZE)
    assert flat is not None
    assert curved is not None
    assert flat.wcs.sip_a == ()
    assert curved.wcs.sip_a != ()
    assert curved.rms_arcsec == pytest.approx(0.2 * SCALE, rel=0.25)
    found, true = pixel_to_sky(curved.wcs, 0, 0), pixel_to_sky(bent, 0, 0)
    corner_deg = separation_deg(float(found[0]), float(found[1]), float(true[0]), float(true[1]))
    assert 3600 * corner_deg < 1.0


def test_few_stars_never_buy_distortion():
    rng = np.random.default_rng(5)
    truth = plate()
    catalogue = stars_around(truth, 14, rng, margin=0.0)
    found = refit(seen(truth, catalogue, rng, 0.5), catalogue, truth, **SIZE)
    assert found is not None
    assert found.wcs.sip_a == ()


def test_random_stars_are_no_plate():
    rng = np.random.default_rng(6)
    truth = plate()
    for _ in range(20):
        xy = rng.uniform((0, 0), (WIDTH, HEIGHT), (200, 2))
        assert refit(xy, stars_around(truth, 200, rng), truth, **SIZE) is None


@settings(max_examples=25, deadline=None)
@given(
    centre_deg=st.tuples(st.floats(0, 360), st.floats(-75, 75)),
    shift_arcmin=st.tuples(st.floats(-10, 10), st.floats(-10, 10)),
    miss=st.tuples(st.floats(0, 60), st.floats(0, 6.28)),
    seed=st.integers(0, 1000),
)
def test_the_last_plate_follows_a_commanded_shift_and_an_unknown_minute_of_arc(
    centre_deg, shift_arcmin, miss, seed
):
    (ra_deg, dec_deg), (east_arcmin, north_arcmin) = centre_deg, shift_arcmin
    miss_arcsec, miss_angle = miss
    rng = np.random.default_rng(seed)
    before = plate(ra_deg, dec_deg)
    cos_dec = np.cos(np.radians(dec_deg))
    shift = (east_arcmin / 60 / cos_dec, north_arcmin / 60)
    after = plate(
        (ra_deg + shift[0] + miss_arcsec * np.cos(miss_angle) / 3600 / cos_dec) % 360,
        dec_deg + shift[1] + miss_arcsec * np.sin(miss_angle) / 3600,
    )
    catalogue = stars_around(after, 150, rng)
    found = refit_moved_plate(
        before, seen(after, catalogue, rng, 0.1), catalogue, shift_deg=shift, **SIZE
    )
    assert centre_error_arcsec(found, after) < 0.3


def test_the_fast_path_refuses_a_wrong_field():
    rng = np.random.default_rng(7)
    before = plate()
    for _ in range(20):
        elsewhere = plate(ra_deg=float(rng.uniform(200, 300)))
        xy = seen(elsewhere, stars_around(elsewhere, 150, rng), rng, 0.1)
        assert refit_moved_plate(before, xy, stars_around(before, 150, rng), **SIZE) is None


def test_the_fast_path_refuses_a_shift_beyond_its_search():
    rng = np.random.default_rng(8)
    before, after = plate(), plate(dec_deg=-5.0 + 10 / 60)
    catalogue = stars_around(after, 200, rng)
    xy = seen(after, catalogue, rng, 0.1)
    assert refit_moved_plate(before, xy, catalogue, **SIZE) is None
    assert refit_moved_plate(before, xy, catalogue, shift_deg=(0.0, 10 / 60), **SIZE) is not None


def test_the_fast_path_refuses_another_camera_angle():
    rng = np.random.default_rng(9)
    before, after = plate(rotation_deg=12.0), plate(rotation_deg=192.0)
    catalogue = stars_around(after, 200, rng)
    assert refit_moved_plate(before, seen(after, catalogue, rng, 0.1), catalogue, **SIZE) is None


def test_clouded_field_with_a_dozen_stars_still_follows():
    rng = np.random.default_rng(10)
    before, after = plate(), plate(dec_deg=-5.0 + 40 / 3600)
    catalogue = stars_around(after, 300, rng)
    xy = seen(after, catalogue, rng, 0.2)[:12]
    assert centre_error_arcsec(refit_moved_plate(before, xy, catalogue, **SIZE), after) < 0.3


def test_a_solution_is_of_the_images_centre():
    rng = np.random.default_rng(11)
    truth = plate()
    catalogue = stars_around(truth, 200, rng)
    fit = refit(seen(truth, catalogue, rng, 0.3), catalogue, truth, **SIZE)
    assert fit is not None
    solution = solution_from(fit, frame_id=1, path="full", ms=1.0, **SIZE)
    assert solution.ra_icrs_deg == pytest.approx(describe_field(fit.wcs, **SIZE).ra_icrs_deg)
