"""What two streaks began may be chance: how it is tried, how it ends, what its streaks are then.

Chance would hardly make two streaks that go the way of what is followed beside them; a way of
their own it makes more often.
"""

from collections.abc import Sequence
from dataclasses import replace

import pytest

from rsoconsole.records import HiddenBy, Measurement, Miss, Missed, TrackState
from rsoconsole.tracking import Following, FrameInput, follow
from rsoconsole.tracking.initiation.chains import APART_ON_TRIAL
from tests.makers import GEO_RATE_DEG_S, NS, T0_UTC_NS, geo_measurement
from tests.tracking.test_company import settings

# Degrees east and north of the first one, deg/s relative to it.
LEAD = (0.0, 0.0, 0.0)
BESIDE = (0.05, 0.03, 0.0)
OWN_WAY = (-0.05, 0.04, 0.4 * GEO_RATE_DEG_S)
Way = tuple[float, float, float]


def streak(k: int, way: Way) -> Measurement:
    east, north, faster = way
    return geo_measurement(
        k + 1,
        ra_deg=150.0 + east,
        dec_deg=-5.0 + north,
        rate_deg_s=GEO_RATE_DEG_S + faster,
        measurement_id=f"{k}-{east}",
        confidence=0.9 if way == LEAD else 0.8,
    )


def seen(k: int, ways: Sequence[Way]) -> FrameInput:
    return FrameInput(
        frame_id=k + 1,
        t_mid_utc_ns=T0_UTC_NS + 30 * k * NS,
        exposure_s=10.0,
        measurements=tuple(streak(k, way) for way in ways),
        absence=Missed(kind="no detection"),
    )


def night(shown: Sequence[Sequence[Way]]) -> list[tuple[Following, tuple[object, ...]]]:
    """After each frame of one that shows these."""
    following, told = Following(), []
    for k, ways in enumerate(shown):
        following, records = follow(following, seen(k, ways), settings())
        told.append((following, records))
    return told


def lost(records: Sequence[object]) -> list[str]:
    reasons = [r.reason for r in records if isinstance(r, Miss)]
    return [r.lost.kind for r in reasons if r.lost is not None]


def tracks(of: Following) -> int:
    return len(of.tracks)


def test_what_moves_as_another_does_outlives_a_miss_from_its_second_streak_on() -> None:
    both, one = [LEAD, BESIDE], [LEAD]
    told = night([both, both, one, both])
    assert [tracks(following) for following, _ in told] == [0, 2, 2, 2]
    assert told[3][0].tracks[1].taken.frame_id == 4
    assert not any(lost(records) for _, records in told)


@pytest.mark.parametrize("streaks", [2, 3])
def test_what_goes_a_way_of_its_own_needs_two_more(streaks: int) -> None:
    shown = [[LEAD], [LEAD], *[[LEAD, OWN_WAY]] * streaks, [LEAD]]
    told = night(shown)
    assert tracks(told[-2][0]) == 2
    assert tracks(told[-1][0]) == 1
    assert lost(told[-1][1]) == ["not confirmed"]


def test_and_outlives_a_miss_then() -> None:
    shown = [[LEAD], [LEAD], *[[LEAD, OWN_WAY]] * (2 + APART_ON_TRIAL), [LEAD], [LEAD, OWN_WAY]]
    told = night(shown)
    assert [tracks(following) for following, _ in told[-2:]] == [2, 2]


def test_the_last_streak_of_a_pair_that_ended_is_free_for_the_right_partner() -> None:
    """A false one before it made a wrong pair; the frame after it hid it."""
    false = (OWN_WAY[0] - 30.0 * GEO_RATE_DEG_S * 0.2, *OWN_WAY[1:])
    shown = [[LEAD], [LEAD], [LEAD, false], [LEAD, OWN_WAY], [LEAD], *[[LEAD, OWN_WAY]] * 3]
    told = night(shown)
    begun = [
        (k, record.begun_with)
        for k, (_, records) in enumerate(told)
        for record in records
        if isinstance(record, TrackState) and record.kind == "initial" and not record.is_lead
    ]
    assert [k for k, _ in begun] == [3, 5]
    assert [name.split("-", 1)[0] for name in begun[1][1]] == ["3", "5"]
    assert lost(told[4][1]) == ["not confirmed"]
    assert tracks(told[-1][0]) == 2


def test_what_was_seldom_seen_is_not_waited_for_as_long_as_what_was_seen_all_night() -> None:
    seldom = [[LEAD, BESIDE]] * 3 + [[LEAD]] * 8
    often = [[LEAD, BESIDE]] * 12 + [[LEAD]] * 8
    ends = {}
    for name, shown in (("seldom", seldom), ("often", often)):
        told = night(shown)
        ends[name] = [(k, lost(records)) for k, (_, records) in enumerate(told) if lost(records)]
    # Three streaks: more than four frames that should show it.
    assert ends == {"seldom": [(7, ["seen too seldom"])], "often": []}


def test_a_cloud_is_no_frame_that_should_show_it() -> None:
    """Where a cloud hides it nothing is held against it."""
    following = Following()
    for k in range(14):
        shown = [LEAD, BESIDE] if k < 3 else []
        frame = seen(k, shown)
        if k >= 3:
            cloud = HiddenBy(kind="fewer stars", stars=3, usual_stars=400)
            frame = replace(frame, absence=Missed(kind="no detection", hidden_by=(cloud,)))
        following, records = follow(following, frame, settings())
        assert lost(records) == []
    assert tracks(following) == 2
