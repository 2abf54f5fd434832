"""The last plate shifted onto what cloud leaves of the stars; projected by astropy, not by us."""

from dataclasses import replace

import numpy as np
import pytest

from rsoconsole.records import FloatArray
from rsoconsole.vision import refit_moved_plate, shift_plate
from tests.vision.test_plate_fit import (
    HEIGHT,
    SCALE,
    SIZE,
    WIDTH,
    centre_error_arcsec,
    plate,
    seen,
    stars_around,
)

RMS_ARCSEC = 0.5


def false_stars(count: int, rng: np.random.Generator) -> FloatArray:
    """What stands out of the noise of a clouded frame: hot clusters, rows."""
    return rng.uniform((0.0, 0.0), (WIDTH, HEIGHT), (count, 2))


def among(real: FloatArray, false: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Mixed as their light would have it: the order among them says nothing."""
    return rng.permutation(np.concatenate([real, false]))


@pytest.mark.parametrize("count", [3, 4, 5])
def test_few_stars_among_many_that_are_none_give_the_plate(count: int):
    rng = np.random.default_rng(count)
    ratios = []
    for _ in range(60):
        before = plate(rotation_deg=float(rng.uniform(0.0, 360.0)))
        away = rng.uniform(-80.0, 80.0, 2) / 3600.0
        truth = replace(before, crval_ra_deg=150.0 + away[0], crval_dec_deg=-5.0 + away[1])
        catalogue = stars_around(before, 60, rng)
        visible = seen(truth, catalogue, rng, sigma_px=RMS_ARCSEC / SCALE)[:count]
        stars = among(visible, false_stars(30, rng), rng)
        assert refit_moved_plate(before, stars, catalogue, **SIZE) is None
        found = shift_plate(before, stars, catalogue, rms_arcsec=RMS_ARCSEC, **SIZE)
        if found is None:  # more than a pixel or two off by their own noise
            continue
        assert found.matched <= count + 1
        ratios.append(centre_error_arcsec(found, truth) / (found.rms_arcsec / found.matched**0.5))
    # Three stars of 0.4 px noise in both axes lie within 2 px of each other as a rule.
    assert len(ratios) >= 55
    # Never less than the last plate's residuals are believed, so the errors are stated on the
    # large side; the mean square of two axes would be 2.
    assert 0.6 < np.mean(np.square(ratios)) < 2.6
    assert max(ratios) < 5.0


def test_what_agrees_by_chance_is_no_plate():
    rng = np.random.default_rng(5)
    before = plate()
    catalogue = stars_around(before, 100, rng)
    accepted = [
        shift_plate(before, false_stars(count, rng), catalogue, rms_arcsec=RMS_ARCSEC, **SIZE)
        for count in (4, 15, 60, 400)
        for _ in range(250)
    ]
    assert accepted == [None] * 1000


def test_stars_of_another_field_are_no_plate():
    rng = np.random.default_rng(6)
    before, other = plate(), plate(170.0, 3.0)
    catalogue = stars_around(before, 60, rng)
    elsewhere = seen(other, stars_around(other, 60, rng), rng, 0.3)
    assert shift_plate(before, elsewhere, catalogue, rms_arcsec=RMS_ARCSEC, **SIZE) is None
    nothing = np.empty((0, 2))
    assert shift_plate(before, nothing, catalogue, rms_arcsec=RMS_ARCSEC, **SIZE) is None
    assert shift_plate(before, elsewhere, nothing, rms_arcsec=RMS_ARCSEC, **SIZE) is None


def test_two_stars_are_enough_among_the_brightest_alone():
    rng = np.random.default_rng(8)
    before = plate()
    catalogue = stars_around(before, 60, rng)
    two = seen(before, catalogue, rng, 0.1)[:2]
    bright = np.concatenate([two, false_stars(8, rng)])
    found = shift_plate(before, bright, catalogue, rms_arcsec=RMS_ARCSEC, **SIZE)
    assert found is not None
    assert found.matched == 2
    assert centre_error_arcsec(found, before) < 0.5
    faint = np.concatenate([false_stars(30, rng), two, false_stars(28, rng)])
    assert shift_plate(before, faint, catalogue, rms_arcsec=RMS_ARCSEC, **SIZE) is None


def test_one_star_that_pairs_with_three_is_one_witness():
    """A close group in the catalogue, or one star found in pieces."""
    before = plate()
    group = np.array([[150.0, -5.0], [150.0002, -5.0], [150.0, -4.9998], [150.3, -5.1]])
    rng = np.random.default_rng(7)
    one = seen(before, group[:1], rng, 0.1)
    pieces = np.concatenate([one, one + 0.4, one - 0.4, false_stars(3, rng)])
    assert shift_plate(before, pieces, group[:1], rms_arcsec=RMS_ARCSEC, **SIZE) is None
    assert shift_plate(before, one, group, rms_arcsec=RMS_ARCSEC, **SIZE) is None
