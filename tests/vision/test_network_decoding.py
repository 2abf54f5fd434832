"""From the network's numbers to lines, and from lines that lie on one another to one."""

import numpy as np
import pytest

from rsoconsole.vision import MapStreak, decode_candidates, keep_distinct

STRIDE = 4


def _streak(x: float, y: float, length: float, angle_deg: float, logit: float = 0.0) -> MapStreak:
    dx = length / 2 * np.cos(np.radians(angle_deg))
    dy = length / 2 * np.sin(np.radians(angle_deg))
    return MapStreak(logit=logit, x_a=x - dx, y_a=y - dy, x_b=x + dx, y_b=y + dy)


@pytest.mark.parametrize("angle_deg", [0.0, 1.0, 45.0, 89.0, 90.0, 135.0, 179.0])
def test_decoding_returns_the_ends_that_were_encoded(angle_deg):
    answer = np.full((6, 20, 30), -9.0, dtype=np.float32)
    row, column, x, y, length = 7, 11, 47.3, 29.1, 23.5
    answer[:, row, column] = [
        2.5,
        x / STRIDE - column - 0.5,
        y / STRIDE - row - 0.5,
        np.log(length / 16),
        np.cos(2 * np.radians(angle_deg)),
        np.sin(2 * np.radians(angle_deg)),
    ]
    (found,) = decode_candidates(answer, 0.0)
    wanted = _streak(x, y, length, angle_deg)
    assert found.logit == pytest.approx(2.5)
    got = sorted([(found.x_a, found.y_a), (found.x_b, found.y_b)])
    true = sorted([(wanted.x_a, wanted.y_a), (wanted.x_b, wanted.y_b)])
    a_thousandth_cell = 1e-3
    if angle_deg in (90.0,):
        got.sort(key=lambda end: end[1])
        true.sort(key=lambda end: end[1])
    assert np.allclose(got, true, atol=a_thousandth_cell)


def test_decoding_orders_by_confidence_and_stops_at_the_lowest():
    answer = np.zeros((6, 4, 4), dtype=np.float32)
    answer[0] = np.arange(16, dtype=np.float32).reshape(4, 4) - 10.0
    assert [round(s.logit) for s in decode_candidates(answer, 2.5)] == [5, 4, 3]


def test_nothing_above_the_lowest_logit_is_nothing():
    assert decode_candidates(np.full((6, 4, 4), -9.0, dtype=np.float32), 0.0) == []


def test_candidates_on_one_line_are_one_streak_the_most_confident():
    kept = keep_distinct(
        [
            _streak(100, 100, 15, 20, logit=1.0),
            _streak(103, 101, 13, 22, logit=3.0),
            _streak(101, 101, 30, 15, logit=2.0),
        ]
    )
    assert [s.logit for s in kept] == [3.0]


@pytest.mark.parametrize("angle_deg", [0, 30, 90, 120])
def test_parallel_neighbours_ten_cells_apart_both_stay(angle_deg):
    across = np.radians(angle_deg + 90)
    one = _streak(100, 100, 15, angle_deg)
    other = _streak(100 + 10 * np.cos(across), 100 + 10 * np.sin(across), 15, angle_deg)
    assert len(keep_distinct([one, other])) == 2


def test_streaks_behind_one_another_on_one_line_both_stay():
    assert len(keep_distinct([_streak(100, 100, 15, 0), _streak(120, 100, 15, 0)])) == 2
