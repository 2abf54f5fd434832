"""Zero point of a frame, against stars made with a known one."""

import numpy as np
import pytest

from rsoconsole.pipeline.photometry.zero_point import (
    SUN_COLOUR_MAG,
    ZeroPointStars,
    fit_zero_point,
)
from rsoconsole.records import FloatArray

SIZE_PX = (4656, 3520)
MIDDLE = np.array([[2328.0, 1760.0]])


def stars_of(
    rng: np.random.Generator,
    *,
    count: int = 40,
    term: float = 0.0,
    sigma_mag: float = 0.02,
    cloud_mag: FloatArray | None = None,
) -> ZeroPointStars:
    """Stars over the frame with a zero point of 22 at the Sun's colour."""
    places = rng.uniform(0.0, 1.0, (count, 2)) * SIZE_PX
    colour = rng.normal(0.8, 0.4, count)
    zero = 22.0 + term * (colour - SUN_COLOUR_MAG) + rng.normal(0.0, sigma_mag, count)
    if cloud_mag is not None:
        zero = zero - places / SIZE_PX @ cloud_mag
    return ZeroPointStars(
        places_px=places,
        zero_mag=zero,
        sigma_mag=np.full(count, sigma_mag),
        colour_mag=colour,
    )


def test_zero_point_and_colour_term_lie_within_their_errors_as_often_as_these_say() -> None:
    pulls, of_term = [], []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        term = float(rng.uniform(-0.3, 0.3))
        found = fit_zero_point(stars_of(rng, term=term), SIZE_PX)
        assert found is not None
        pulls.append((found.mag - 22.0) / found.sigma_mag)
        of_term.append((found.colour_term - term) / found.colour_term_sigma)
    for each in (pulls, of_term):
        assert 0.5 < float(np.sqrt(np.mean(np.square(each)))) < 1.4


def test_cloud_that_thins_out_over_the_field_is_followed() -> None:
    """A magnitude from side to side: at any place the zero point is within a tenth."""
    rng = np.random.default_rng(3)
    found = fit_zero_point(stars_of(rng, cloud_mag=np.array([1.0, 0.2])), SIZE_PX)
    assert found is not None
    for share in (0.15, 0.5, 0.85):
        mag, sigma = found.along(MIDDLE * 2.0 * share)
        assert mag == pytest.approx(22.0 - 1.2 * share, abs=max(0.1, 3.0 * sigma))
        assert sigma < 0.1


def test_a_variable_star_among_the_others_changes_nothing() -> None:
    rng = np.random.default_rng(5)
    stars = stars_of(rng)
    stars.zero_mag[4] += 1.5
    found = fit_zero_point(stars, SIZE_PX)
    assert found is not None
    assert found.stars == 39
    assert found.mag == pytest.approx(22.0, abs=0.015)


def test_stars_of_unknown_colour_count_and_four_stars_are_too_few() -> None:
    rng = np.random.default_rng(7)
    stars = stars_of(rng)
    stars.colour_mag[:20] = np.nan
    found = fit_zero_point(stars, SIZE_PX)
    assert found is not None
    assert found.mag == pytest.approx(22.0, abs=0.03)
    assert fit_zero_point(stars_of(rng, count=4), SIZE_PX) is None
