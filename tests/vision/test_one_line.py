"""Pieces of a streak among few points of light: found where they are most of them."""

import numpy as np
import pytest

from rsoconsole.vision.stars.stars import MAX_POINTS, MIN_POINTS, is_on_one_line


def pieces(count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    along = np.sort(rng.uniform(0, 300, count))
    return 200 + 0.8 * along + rng.normal(0, 0.5, count), 100 + 0.6 * along


@pytest.mark.parametrize(("on_line", "beside"), [(5, 0), (5, 4), (12, 7), (30, 10)])
def test_the_pieces_of_a_streak_are_told_from_the_stars_beside_it(on_line, beside):
    rng = np.random.default_rng(on_line)
    x, y = pieces(on_line, rng)
    x = np.concatenate([x, rng.uniform(600, 1200, beside)])
    y = np.concatenate([y, rng.uniform(0, 900, beside)])
    found = is_on_one_line(x, y, 2.0)
    assert found[:on_line].sum() >= on_line - 1
    assert not found[on_line:].any()


@pytest.mark.parametrize("count", [MIN_POINTS - 1, MAX_POINTS + 1])
def test_too_few_and_very_many_are_left_alone(count):
    assert not is_on_one_line(*pieces(count, np.random.default_rng(1)), 2.0).any()


def test_stars_are_not_on_one_line():
    rng = np.random.default_rng(2)
    wrong = 0
    for count in (5, 8, 20, 40) * 50:
        found = is_on_one_line(rng.uniform(0, 1200, count), rng.uniform(0, 900, count), 2.0)
        wrong += bool(found.any())
    assert wrong == 0
