"""Zero point and colour term of a frame, fitted to stars whose truth is drawn."""

import math

import numpy as np
import pytest

from rsoconsole.pipeline.photometry.zero_point import (
    SUN_COLOUR_MAG,
    ZeroPoint,
    ZeroPointStars,
    fit_zero_point,
)

SIZE_PX = (2000, 1500)
ZERO_MAG = 21.5


def drawn(
    seed: int, count: int, term: float, scatter_mag: float = 0.02
) -> tuple[ZeroPointStars, np.random.Generator]:
    """Stars with the catalogue's errors, which grow with magnitude."""
    rng = np.random.default_rng(seed)
    colour = rng.normal(0.8, 0.4, count)
    sigma = rng.uniform(0.01, 0.15, count)
    off = rng.normal(0.0, 1.0, count) * np.hypot(sigma, scatter_mag)
    stars = ZeroPointStars(
        places_px=rng.uniform(0.0, 1.0, (count, 2)) * SIZE_PX,
        zero_mag=ZERO_MAG + term * (colour - SUN_COLOUR_MAG) + off,
        sigma_mag=sigma,
        colour_mag=colour,
    )
    return stars, rng


def fitted(stars: ZeroPointStars) -> ZeroPoint:
    found = fit_zero_point(stars, SIZE_PX)
    assert found is not None
    return found


@pytest.mark.parametrize("term", [-0.4, 0.0, 0.35])
def test_colour_term_and_zero_point_are_found_within_their_errors(term: float) -> None:
    pulls = []
    for seed in range(20):
        found = fitted(drawn(seed, 25, term)[0])
        pulls.append(
            (
                (found.colour_term - term) / found.colour_term_sigma,
                (found.mag - ZERO_MAG) / found.sigma_mag,
            )
        )
    rms = np.sqrt(np.mean(np.square(pulls), axis=0))
    # Of 20 draws the root mean square of honest pulls is 0.7 to 1.4 in 98 of 100.
    assert np.all(rms > 0.5)
    assert np.all(rms < 1.4)


@pytest.mark.parametrize("seed", range(4))
def test_two_stars_far_off_neither_move_the_zero_point_nor_widen_its_error(seed: int) -> None:
    """Each hides the other: with both the scatter is so wide that none is beyond its sigmas."""
    stars, rng = drawn(100 + seed, 15, 0.3)
    zero_mag = stars.zero_mag.copy()
    zero_mag[rng.choice(15, 2, replace=False)] -= (0.65, 0.9)
    found = fitted(
        ZeroPointStars(
            places_px=stars.places_px,
            zero_mag=zero_mag,
            sigma_mag=stars.sigma_mag,
            colour_mag=stars.colour_mag,
        )
    )
    assert found.stars < 15
    assert found.sigma_mag < 0.05
    assert abs(found.mag - ZERO_MAG) < 3.0 * found.sigma_mag


@pytest.mark.parametrize("seed", range(4))
def test_good_stars_are_not_left_out(seed: int) -> None:
    assert fitted(drawn(200 + seed, 40, -0.2)[0]).stars >= 38


def test_few_stars_are_no_cloud() -> None:
    """Eight stars with one far off have a scatter, not a cloud over one corner."""
    stars, _ = drawn(7, 8, 0.0)
    zero_mag = stars.zero_mag.copy()
    zero_mag[3] -= 0.9
    found = fitted(
        ZeroPointStars(
            places_px=stars.places_px,
            zero_mag=zero_mag,
            sigma_mag=stars.sigma_mag,
            colour_mag=stars.colour_mag,
        )
    )
    corner, other = (
        found.along(np.array([place]))[0] for place in ((50.0, 50.0), (1900.0, 1400.0))
    )
    assert math.isclose(corner, other, abs_tol=0.05)
