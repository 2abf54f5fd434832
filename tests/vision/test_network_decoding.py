"""From the network's numbers to lines, and from lines that lie on one another to one."""

import numpy as np
import pytest

from rsoconsole.vision import decode_candidates, keep_distinct

STRIDE = 4


def _streak(x: float, y: float, length: float, angle_deg: float, logit: float = 0.0) -> list[float]:
    dx = length / 2 * np.cos(np.radians(angle_deg))
    dy = length / 2 * np.sin(np.radians(angle_deg))
    return [logit, x - dx, y - dy, x + dx, y + dy]


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
    _, *wanted = _streak(x, y, length, angle_deg)
    assert found[0] == pytest.approx(2.5)
    got = sorted([tuple(found[1:3]), tuple(found[3:])])
    true = sorted([tuple(wanted[:2]), tuple(wanted[2:])])
    a_thousandth_cell = 1e-3
    if angle_deg in (90.0,):
        got.sort(key=lambda end: end[1])
        true.sort(key=lambda end: end[1])
    assert np.allclose(got, true, atol=a_thousandth_cell)


def test_decoding_orders_by_confidence_and_stops_at_the_lowest():
    answer = np.zeros((6, 4, 4), dtype=np.float32)
    answer[0] = np.arange(16, dtype=np.float32).reshape(4, 4) - 10.0
    assert [round(logit) for logit in decode_candidates(answer, 2.5)[:, 0]] == [5, 4, 3]


def test_nothing_above_the_lowest_logit_is_nothing():
    assert len(decode_candidates(np.full((6, 4, 4), -9.0, dtype=np.float32), 0.0)) == 0


def test_candidates_on_one_line_are_one_streak_the_most_confident():
    kept = keep_distinct(
        np.array(
            [
                _streak(100, 100, 15, 20, logit=1.0),
                _streak(103, 101, 13, 22, logit=3.0),
                _streak(101, 101, 30, 15, logit=2.0),
            ]
        )
    )
    assert kept[:, 0].tolist() == [3.0]


@pytest.mark.parametrize("angle_deg", [0, 30, 90, 120])
def test_parallel_neighbours_ten_cells_apart_both_stay(angle_deg):
    across = np.radians(angle_deg + 90)
    one = _streak(100, 100, 15, angle_deg)
    other = _streak(100 + 10 * np.cos(across), 100 + 10 * np.sin(across), 15, angle_deg)
    assert len(keep_distinct(np.array([one, other]))) == 2


def test_streaks_behind_one_another_on_one_line_both_stay():
    assert len(keep_distinct(np.array([_streak(100, 100, 15, 0), _streak(120, 100, 15, 0)]))) == 2
