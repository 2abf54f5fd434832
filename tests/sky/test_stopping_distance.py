"""How far a mount moves on after ABORT, learned from its own stops."""

import pytest

from rsoconsole.sky import StoppingDistance
from rsoconsole.sky.limits.way_ahead import MAX_DEG, MIN_DEG, UNLEARNED_DEG


def learned(*stops: tuple[float, float]) -> StoppingDistance:
    """Of ways in degrees and the rates at which it was told."""
    distance = StoppingDistance()
    for way_deg, rate_deg_s in stops:
        distance.learn(way_deg, rate_deg_s)
    return distance


def test_nothing_is_known_of_a_mount_that_was_never_stopped():
    distance = learned()
    assert not distance.is_learned
    assert distance.at(4.0) == UNLEARNED_DEG
    # Five seconds of its motion, where that is less.
    assert distance.at(0.1) == pytest.approx(0.5)


def test_the_largest_is_kept():
    assert learned((4.0, 4.0), (1.0, 4.0), (3.0, 4.0)).at(4.0) == 4.0


@pytest.mark.parametrize(
    ("rate_deg_s", "way_deg"),
    [(4.0, 4.0), (2.0, 2.0), (1.0, 1.0), (0.1, MIN_DEG), (6.0, 9.0), (8.0, MAX_DEG)],
)
def test_a_slower_motion_needs_less_and_a_faster_one_more(rate_deg_s, way_deg):
    assert learned((4.0, 4.0)).at(rate_deg_s) == pytest.approx(way_deg)


def test_a_slow_stop_teaches_nothing_of_a_fast_one():
    assert learned((0.6, 0.3)).at(4.0) == UNLEARNED_DEG
    assert not learned((0.3, 0.004)).is_learned


@pytest.mark.parametrize(("way_deg", "kept_deg"), [(0.0, MIN_DEG), (28.0, MAX_DEG)])
def test_it_is_never_taken_for_nothing_nor_for_the_whole_sky(way_deg, kept_deg):
    """One that moved on for 28 deg had not heard of ABORT."""
    assert learned((way_deg, 4.0)).at(4.0) == kept_deg
