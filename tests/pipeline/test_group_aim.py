"""Where the telescope looks for several satellites: the lead, as many as possible, or all."""

import itertools

import numpy as np
import pytest

from rsoconsole.config import Config
from rsoconsole.pipeline import group_direction
from rsoconsole.pipeline.aim.group_aim import GroupMember, best_centre
from rsoconsole.sky import separation_deg
from rsoconsole.tracking import Following, follow
from tests.makers import geo_measurement
from tests.tracking.test_follow import SETTINGS, seen

RADIUS_DEG = 0.3
FIELD_DEG = (0.8, 0.6)


def member(x: float, y: float, *, weight: float = 1.0, reach_deg: float = 0.02) -> GroupMember:
    return GroupMember(x=x, y=y, reach_deg=reach_deg, weight=weight)


def held(centre: np.ndarray, members: list[GroupMember]) -> list[GroupMember]:
    return [
        m
        for m in members
        if np.hypot(m.x - centre[0], m.y - centre[1]) + m.reach_deg <= RADIUS_DEG + 1e-6
    ]


LEAD = member(0.0, 0.0, weight=1.5)
TRIPLE = [member(0.7, 0.0), member(0.75, 0.05), member(0.7, 0.1)]


def test_all_are_in_the_field_as_long_as_they_fit_and_in_its_middle():
    members = [LEAD, member(0.4, 0.0), member(0.2, 0.3)]
    centre = best_centre(members, RADIUS_DEG, "group")
    assert held(centre, members) == members
    ways = [np.hypot(m.x - centre[0], m.y - centre[1]) for m in members]
    assert max(ways) == pytest.approx(sorted(ways)[-2], abs=0.01)


def test_a_group_that_does_not_fit_keeps_the_lead_and_the_most_goes_where_more_are():
    members = [LEAD, member(-0.3, 0.0), *TRIPLE]
    assert LEAD in held(best_centre(members, RADIUS_DEG, "group"), members)
    most = held(best_centre(members, RADIUS_DEG, "most"), members)
    assert most == TRIPLE


def test_of_two_fields_with_as_many_the_one_with_the_lead_is_looked_at():
    members = [LEAD, member(0.1, 0.0), member(0.9, 0.0), member(0.95, 0.0)]
    assert LEAD in held(best_centre(members, RADIUS_DEG, "most"), members)


def test_no_other_place_of_a_fine_grid_holds_more():
    random = np.random.default_rng(5)
    for _ in range(20):
        places = random.uniform(-0.6, 0.6, (7, 2))
        members = [LEAD, *(member(x, y) for x, y in places)]
        got = sum(m.weight for m in held(best_centre(members, RADIUS_DEG, "most"), members))
        grid = itertools.product(np.linspace(-0.7, 0.7, 57), repeat=2)
        best = max(sum(m.weight for m in held(np.array(at), members)) for at in grid)
        assert got >= best - 1e-9


def test_what_needs_more_than_the_field_counts_for_nothing():
    wide = member(0.2, 0.0, weight=5.0, reach_deg=0.4)
    centre = best_centre([LEAD, wide], RADIUS_DEG, "most")
    assert np.hypot(*centre) < 1e-9


@pytest.mark.parametrize(
    ("policy", "inside", "north_deg"), [("lead", 1, 0.0), ("most", 2, 0.15), ("group", 2, 0.15)]
)
def test_two_of_a_slot_stand_about_the_middle_of_the_field(policy, inside, north_deg):
    following = Following()
    for n in range(1, 6):
        both = geo_measurement(n), geo_measurement(n, dec_deg=-4.7, confidence=0.5)
        following, _ = follow(following, seen(n, *both), SETTINGS)
    settings = SETTINGS.filter
    lead, other = (each.track for each in following.tracks)
    assert lead.x[2] == pytest.approx(-5.0, abs=1e-3)
    then = geo_measurement(6)
    at, found = group_direction(
        (lead, other),
        (then.ra_icrs_deg, -5.0),
        then.t_mid_utc_ns,
        policy,
        field_deg=FIELD_DEG,
        exposure_s=10.0,
        settings=settings,
    )
    assert found == inside
    assert separation_deg(*at, then.ra_icrs_deg, -5.0 + north_deg) < 0.01


def test_the_policy_is_a_setting_with_three_words():
    assert Config().aim.policy == "lead"
    with pytest.raises(ValueError, match="most"):
        Config.model_validate({"aim": {"policy": "all"}})
