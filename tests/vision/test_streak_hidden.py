"""Ends behind stars, at their borders: nothing breaks where the cutout ends."""

import numpy as np
import pytest

from rsoconsole.vision.lines.streak_search import Cutout
from rsoconsole.vision.streaks._streak_hidden import with_masked_ends_moved
from rsoconsole.vision.streaks._streak_model import LineFit, StreakModel

NOISE, WIDTH, HEIGHT = 20.0, 60, 21


def hidden_end(
    u_b: float,
    masked: tuple[int, int],
    level_adu: float,
    *,
    variance: float = 1.0,
    wing_adu: float = 0.0,
    lit_to: float | None = None,
) -> LineFit:
    """A line from u = -25 to ``u_b`` in a cutout that ends at u = 29, masked between two u.

    ``wing_adu``: of a masked star, in the column next to its mask; ``lit_to``: where the light
    really ends.
    """
    v, u = np.mgrid[-10:11, -30:30].astype(float)
    is_used = ~((u >= masked[0]) & (u <= masked[1]))
    light = level_adu / np.sqrt(2.0 * np.pi) * np.exp(-0.5 * v**2)
    light *= (u > -25) & (u < (u_b if lit_to is None else lit_to))
    light += wing_adu * np.exp(-0.5 * v**2) * (u == masked[1] + 1)
    cutout = Cutout(
        x0=0,
        y0=0,
        values=light + np.random.default_rng(1).normal(0.0, NOISE, light.shape),
        is_good=np.ones(light.shape, dtype=bool),
        noise=NOISE,
        frame_width=WIDTH,
        frame_height=HEIGHT,
    )
    line = StreakModel(
        u_a=-25.0,
        u_b=u_b,
        offset=0.0,
        slope=0.0,
        sigma=1.0,
        amplitudes=(level_adu,),
        knot_range=(-25.0, 25.0),
    )
    covariance = np.diag([1.0, variance, 1.0, 1.0])
    fit = LineFit(line=line, covariance=covariance, excess=0.0, model=light)
    return with_masked_ends_moved(cutout, (u, v), fit, is_used)


@pytest.mark.parametrize("level_adu", [30.0, 90.0, 400.0])
@pytest.mark.parametrize("masked", [(18, 26), (24, 29), (20, 27)])
@pytest.mark.parametrize("u_b", [14.0, 22.0, 27.0, 29.4, 31.0, 33.5])
def test_an_end_near_the_cutouts_rim_stays_finite(u_b, masked, level_adu):
    moved = hidden_end(u_b, masked, level_adu)
    assert moved.line.u_b is not None
    assert abs(moved.line.u_b - u_b) < 12.0
    assert np.isfinite(moved.covariance).all()
    assert min(moved.hidden_variance) >= 0.0


def test_an_end_far_from_what_is_hidden_is_left_alone():
    moved = hidden_end(10.0, (22, 27), 400.0)
    assert moved.line.u_b == 10.0
    assert moved.hidden_variance == (0.0, 0.0)


def test_a_masked_stars_wing_is_not_taken_for_the_streak_coming_out_behind_it():
    moved = hidden_end(18.5, (10, 16), 90.0, wing_adu=150.0, lit_to=13.0)
    assert moved.line.u_b == pytest.approx(13.0, abs=1.0)
    assert moved.hidden_variance[1] >= 9.0


def test_what_is_read_off_elsewhere_is_known_there_and_not_from_the_fit():
    moved = hidden_end(22.0, (18, 26), 400.0)
    assert moved.hidden_variance[1] > 0.0
    assert moved.covariance[1].tolist() == moved.covariance[:, 1].tolist() == [0.0] * 4
    assert moved.covariance[0, 0] == 1.0


@pytest.mark.filterwarnings("error")
def test_an_end_of_which_the_fit_knows_nothing_leaves_the_rest_as_it_is():
    moved = hidden_end(22.0, (18, 26), 400.0, variance=1e200)
    assert np.diag(moved.covariance).tolist() == [1.0, 0.0, 1.0, 1.0]
    assert moved.hidden_variance[1] < 20.0
