"""Streaks that run together: trains of satellites, neighbours in a slot, lights of an aircraft."""

import numpy as np
import pytest

from rsoconsole.vision import corrected_by_neighbours
from rsoconsole.vision.streaks.streak_classes import SLOWEST_DEG_S
from tests.makers import straight_detection

STARLINK = 1e-3
"""Degrees a second for each pixel of a streak's length."""


def line(y: float, angle_deg: float = 20.0, **other):
    values = {"kind": "crossing", "sigma_angle_deg": 0.02, "length_px": 900.0} | other
    return straight_detection(x_px=450.0, y_px=y, angle_deg=angle_deg, **values)


@pytest.mark.parametrize("seed", range(6))
def test_parallel_crossings_are_a_train_and_what_crosses_them_is_none(seed):
    rng = np.random.default_rng(seed)
    count, angle = int(rng.integers(2, 12)), rng.uniform(0.0, 180.0)
    train = [line(y, angle + rng.normal(0.0, 0.2)) for y in rng.uniform(0, 900, count)]
    found = corrected_by_neighbours([line(50.0, angle + 40.0), *train])
    assert [each.train for each in found] == [0, *[count] * count]
    assert [each.y_px for each in found[1:]] == [each.y_px for each in train]


def test_one_alone_is_no_train():
    assert [each.train for each in corrected_by_neighbours([line(10.0)])] == [0]


def test_neighbours_in_a_slot_are_no_train_and_fast_ones_are():
    whole = [line(y, kind="streak", length_px=118.0) for y in (100.0, 200.0, 300.0)]
    slow = 0.5 * SLOWEST_DEG_S / 118.0
    assert {each.train for each in corrected_by_neighbours(whole)} == {0}
    assert {each.train for each in corrected_by_neighbours(whole, slow)} == {0}
    assert {each.train for each in corrected_by_neighbours(whole, STARLINK)} == {3}
    assert {each.train for each in corrected_by_neighbours(whole[:2], STARLINK)} == {0}


def test_what_runs_beside_an_aircraft_is_another_of_its_lights():
    strobe = line(100.0, object_class="aircraft", class_probability=0.9)
    beside, apart = line(130.0, object_class="satellite", class_probability=0.6), line(800.0)
    found = corrected_by_neighbours([strobe, beside, apart])
    told = [(each.object_class, each.class_probability, each.train) for each in found]
    assert told == [("aircraft", 0.9, 0), ("aircraft", 0.9, 0), ("undetermined", 1.0, 0)]


def test_what_the_operator_marked_keeps_its_name():
    strobe = line(100.0, object_class="aircraft", class_probability=0.9)
    mark = line(120.0, method="operator", kind="streak")
    assert corrected_by_neighbours([strobe, mark])[1] == mark
