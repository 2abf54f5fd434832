"""Orbits of a large group take turns: none waits for long, and one that is missed not at all."""

from collections import defaultdict

import pytest

from rsoconsole.pipeline import OnlineOrbit
from rsoconsole.pipeline.orbits._orbit_turns import AT_ONCE
from rsoconsole.records import OrbitEstimate
from rsoconsole.tracking import Following, follow
from tests.nights.slot_of_twelve import MEMBERS, frames
from tests.pipeline.test_orbit_online import config
from tests.tracking.test_company import settings

FRAMES = 24


@pytest.fixture(scope="module")
def night() -> list[tuple[Following, list[OrbitEstimate]]]:
    """Twelve of one slot: what is followed after each frame, and the orbits put on record."""
    following, online, told = Following(), OnlineOrbit(config()), []
    for sight in frames(FRAMES):
        following, records = follow(following, sight, settings(MEMBERS))
        for record in (*sight.measurements, *records):
            online.receive(record)
        told.append((following, [each.estimate for each in online.refine()]))
    assert len(following.tracks) == MEMBERS
    return told


def last_taken(following: Following) -> dict[int, int]:
    """The last frame of each track in which it took a measurement."""
    return {t.track.track_id: t.taken.frame_id for t in following.tracks if t.taken is not None}


def test_a_frame_refines_the_lead_and_few_others(night):
    for k, (following, told) in enumerate(night[3:], 3):
        taken = last_taken(following)
        missed = [n for n in taken if taken[n] < k]
        assert len([e for e in told if e.track_id != following.track_id]) <= max(
            AT_ONCE, 1 + len(missed)
        )
        if following.track_id not in missed:
            assert following.track_id in [each.track_id for each in told]


def test_each_has_an_orbit_soon_and_none_grows_old(night):
    newest: dict[int, int] = {}
    for k, (following, told) in enumerate(night):
        newest |= {each.track_id: each.frame_id for each in told}
        if k >= MEMBERS:
            taken = last_taken(following)
            assert all(taken[n] - newest[n] < MEMBERS for n in taken)


def test_one_that_is_missed_has_its_orbit_through_all_that_it_took(night):
    """The fold asks the orbit of the very measurement that a track took last."""
    newest: dict[int, int] = {}
    asked = 0
    for k, (following, told) in enumerate(night):
        newest |= {each.track_id: each.frame_id for each in told}
        taken = last_taken(following)
        for n in [n for n in taken if taken[n] < k and n in newest]:
            asked += 1
            assert newest[n] == taken[n]
    assert asked > MEMBERS


def test_turns_leave_out_no_direction(night):
    seen: dict[int, int] = {}
    took: dict[int, int] = defaultdict(int)
    for following, told in night:
        for each in told:
            seen[each.track_id] = each.observations
        for each in following.tracks:
            if each.track.kind != "predicted":
                took[each.track.track_id] += 1
    lead = night[-1][0].track_id
    assert lead is not None
    assert seen[lead] == took[lead] + 1
    assert all(took[n] + 1 - seen[n] < MEMBERS for n in took)
