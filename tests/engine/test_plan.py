"""Where and when the next exposure is, and what becomes of a place that is refused."""

import dataclasses
from typing import Any

import numpy as np
import pytest

from rsoconsole.config import Config
from rsoconsole.engine.aim.instrument_controller import AimPlan
from rsoconsole.engine.aim.plan import Planner
from rsoconsole.instruments import MountReport
from rsoconsole.records import Frame, SlewCommand, SlewRefusal
from rsoconsole.sky import hour_angle_icrs_deg, icrs_of_hour_angle, separation_deg
from rsoconsole.tracking import Following
from tests.makers import NS, T0_UTC_NS
from tests.rigs.engine_rig import solution_at
from tests.tracking.test_follow import locked

SITE = Config().site.to_site()
SEARCHING, WAITING = Following(), Following(state="ACQUIRE")
TARGETS = [{"name": f"at {angle}", "hour_angle_deg": angle} for angle in (-30, 5, 20)]
LIST = {"search": {"pattern": "targets", "targets": TARGETS, "frames_per_field": 2}}


def report(hour_angle_deg: float = -40.0, **other: Any) -> MountReport:
    ra_deg, dec_deg = icrs_of_hour_angle(SITE, hour_angle_deg, -4.7, T0_UTC_NS)
    values: dict[str, Any] = {
        "t_utc_ns": T0_UTC_NS,
        "ra_icrs_deg": ra_deg,
        "dec_icrs_deg": dec_deg,
        "is_slewing": False,
        "is_parked": False,
        "is_tracking": True,
        "pier_side": "west" if hour_angle_deg < 0 else "east",
    }
    return MountReport(**(values | other))


class Loop:
    """The planner as the engine uses it, with a mount that arrives and a camera that works."""

    def __init__(self, settings: dict[str, Any], hour_angle_deg: float = -40.0) -> None:
        self.planner = Planner(Config.model_validate(settings))
        self.now_ns = T0_UTC_NS
        self.planner.start_search(report(hour_angle_deg), T0_UTC_NS)
        self.frame_id = 0

    def expose(self, plan: AimPlan, before: Following, after: Following) -> float:
        """One exposure; the hour angle that it looked at, rounded."""
        if plan.slew is not None:
            to = self.planner.command(plan.slew)
            self.planner.note_arrival(plan.slew, report(-20.0), to)
        self.frame_id += 1
        self.now_ns = plan.t_start_utc_ns + 12 * NS
        frame = Frame(frame_id=self.frame_id, name="", pixels=np.zeros((4, 4), np.uint16))
        self.planner.note_frame(frame, plan.t_start_utc_ns)
        self.planner.update_search(before, after, self.now_ns)
        return self.hour_angle(plan)

    def hour_angle(self, plan: AimPlan) -> float:
        if plan.slew is None:
            return float("nan")
        to = (plan.slew.ra_icrs_deg, plan.slew.dec_icrs_deg)
        return round(hour_angle_icrs_deg(SITE, *to, plan.t_mid_utc_ns), 1)

    def search(self, frames: int, is_refused: Any = None) -> list[float]:
        """So many exposures that show nothing."""
        return [
            self.expose(self.planner.plan(SEARCHING, self.now_ns, is_refused), SEARCHING, SEARCHING)
            for _ in range(frames)
        ]


def behind_a_tree(hour_angle_deg: float) -> SlewRefusal:
    return SlewRefusal(kind="hour angle", value_deg=round(hour_angle_deg), bound_deg=1.0)


def refuses(*hour_angles_deg: float) -> Any:
    """Limits that forbid these hour angles; notes every question."""

    def is_refused(slew: SlewCommand, until_utc_ns: int) -> SlewRefusal | None:
        angle = hour_angle_icrs_deg(SITE, slew.ra_icrs_deg, slew.dec_icrs_deg, slew.t_aim_utc_ns)
        assert until_utc_ns == slew.t_aim_utc_ns + 5 * NS
        if any(abs(angle - each) < 0.1 for each in hour_angles_deg):
            return behind_a_tree(angle)
        return None

    return is_refused


@pytest.mark.parametrize(
    ("refused", "visited"),
    [
        ((), [-30, -30, 5, 5, 20, 20, -30]),
        ((-30,), [5, 5, 20, 20, 5, 5, 20]),
        ((5,), [-30, -30, 20, 20, -30, -30, 20]),
        ((-30, 20), [5, 5, 5, 5, 5, 5, 5]),
    ],
    ids=["none refused", "the first", "the second", "all but one"],
)
def test_a_search_passes_what_is_refused_and_stays_as_long_with_the_others(refused, visited):
    assert Loop(LIST).search(7, refuses(*refused)) == visited


def test_a_refused_place_is_told_once_until_it_was_allowed_again():
    loop = Loop(LIST)
    told = []
    for limits in [refuses(-30)] * 9 + [None] * 6 + [refuses(-30)] * 6:
        plan = loop.planner.plan(SEARCHING, loop.now_ns, limits)
        told += [why for _, why in plan.refused]
        loop.expose(plan, SEARCHING, SEARCHING)
    assert told == [behind_a_tree(-30.0)] * 2


def test_where_nothing_is_left_to_search_every_refusal_is_told_each_time():
    loop = Loop(LIST)
    for _ in range(2):
        plan = loop.planner.plan(SEARCHING, loop.now_ns, refuses(-30, 5, 20))
        assert plan.slew is None
        assert len(plan.refused) == 3
        loop.expose(plan, SEARCHING, SEARCHING)
    assert loop.search(1) != [float("nan")]


@pytest.mark.parametrize(
    ("pattern", "hour_angle_deg", "seconds"),
    [
        ("belt", None, [-40.0, -41.2]),
        ("belt", -30.0, [-30.0, -30.0]),
        ("targets", None, [-30, -30]),
    ],
    ids=["in the base field", "search elsewhere", "list elsewhere"],
)
def test_the_first_look_needs_no_slew_and_counts_where_it_is_the_first_field(
    pattern, hour_angle_deg, seconds
):
    settings = {"search": {"pattern": pattern, "hour_angle_deg": hour_angle_deg}}
    settings["search"] |= {"targets": TARGETS, "belt_fields": 3}
    loop = Loop(settings)
    plan = loop.planner.plan_exposure_here(T0_UTC_NS)
    assert plan.slew is None
    assert plan.t_start_utc_ns == T0_UTC_NS
    loop.expose(plan, SEARCHING, SEARCHING)
    assert loop.search(2) == pytest.approx(seconds, abs=0.06)


def test_what_the_first_look_shows_is_waited_for_in_place():
    """Also where the search itself is elsewhere; after that it goes on there."""
    loop = Loop(LIST)
    loop.expose(loop.planner.plan_exposure_here(T0_UTC_NS), SEARCHING, WAITING)
    plan = loop.planner.plan(WAITING, loop.now_ns)
    assert plan.slew is not None
    assert plan.slew.reason == "wait for a second frame"
    assert loop.expose(plan, WAITING, SEARCHING) == pytest.approx(-40.0, abs=0.05)
    assert loop.search(2) == [-30, -30]


def test_a_place_of_the_first_look_that_is_refused_gives_way_to_the_search():
    loop = Loop({"search": {"pattern": "stay", "hour_angle_deg": -20.0}})
    loop.expose(loop.planner.plan_exposure_here(T0_UTC_NS), SEARCHING, WAITING)
    plan = loop.planner.plan(WAITING, loop.now_ns, refuses(-40.0))
    assert loop.hour_angle(plan) == -20.0


def test_a_lost_satellite_is_looked_for_where_it_was_lost_before_the_list_goes_on():
    loop = Loop(LIST)
    loop.search(1)
    loop.planner.note_solution(solution_at(report(10.0).ra_icrs_deg, -4.7))
    loop.planner.update_search(Following(state="COAST"), Following(state="LOST"), T0_UTC_NS)
    # Between the loss and the aim the sky turns; the place over the ground is kept.
    assert loop.search(5) == pytest.approx([10, 10, -30, -30, 5], abs=0.1)
    loop.planner.go_home()
    assert loop.search(3) == [-30, -30, 5]


def test_a_refused_track_keeps_the_telescope_where_it_is_and_says_why_at_every_frame():
    loop = Loop({"search": {"recentre": "every"}})
    following, tree = locked(), behind_a_tree(3.0)
    first = loop.planner.plan(following, T0_UTC_NS + 120 * NS, lambda *_: tree)
    again = loop.planner.plan(following, T0_UTC_NS + 120 * NS, lambda *_: tree)
    assert (first.slew, again.slew) == (None, None)
    assert (first.blocked, again.blocked) == (tree, tree)
    assert [len(plan.refused) for plan in (first, again)] == [1, 0]
    free = loop.planner.plan(following, T0_UTC_NS + 120 * NS, lambda *_: None)
    assert (free.blocked, free.refused) == (None, ())
    assert free.slew is not None


@pytest.mark.parametrize(
    ("meridian", "is_searching", "is_blocked"),
    [("flip", False, False), ("hold", False, True), ("hold", True, False)],
    ids=["flip", "hold", "a search may flip"],
)
def test_the_meridian_policy_holds_while_a_track_is_followed(meridian, is_searching, is_blocked):
    loop = Loop(LIST | {"mount": {"meridian": meridian}}, hour_angle_deg=-2.0)
    following = locked()
    assert following.track is not None
    now_ns = T0_UTC_NS + 120 * NS
    ra_deg, dec_deg = icrs_of_hour_angle(SITE, 5.0, -5.0, now_ns)
    x = (ra_deg, following.track.x[1], dec_deg, 0.0)
    track = dataclasses.replace(following.track, x=x, t_utc_ns=now_ns)
    lead = dataclasses.replace(following.tracks[0], track=track)
    following = dataclasses.replace(following, tracks=(lead,))
    plan = loop.planner.plan(SEARCHING if is_searching else following, now_ns, refuses(-30))
    assert (plan.blocked is not None) is is_blocked
    if is_blocked:
        assert plan.blocked is not None
        assert plan.blocked.kind == "meridian policy"
    assert loop.hour_angle(plan) == pytest.approx(5.0, abs=0.3) or is_blocked


def test_the_time_of_a_flip_is_computed_with():
    """Two axes by half a turn each at 4 deg/s: the aim is for when the mount is there."""
    loop = Loop(LIST, hour_angle_deg=-2.0)
    stays = loop.planner.plan(SEARCHING, T0_UTC_NS, refuses(5, 20))
    flips = loop.planner.plan(SEARCHING, T0_UTC_NS, refuses(-30, 20))
    assert (stays.t_start_utc_ns - T0_UTC_NS) / NS < 15.0
    assert 45.0 < (flips.t_start_utc_ns - T0_UTC_NS) / NS < 60.0


def test_the_first_look_teaches_the_offset_and_a_move_by_hand_keeps_it():
    loop = Loop(LIST)
    here = report()
    loop.expose(loop.planner.plan_exposure_here(T0_UTC_NS), SEARCHING, SEARCHING)
    loop.planner.note_solution(solution_at(here.ra_icrs_deg, here.dec_icrs_deg + 0.1))
    offset = loop.planner._pointing.last
    assert (offset.samples, offset.north_arcsec) == (1, pytest.approx(360.0, abs=0.1))
    moved = report(-38.0)
    loop.planner.moved_by_hand(moved)
    assert loop.planner._pointing.last == offset
    looks = loop.planner.looking_at(moved)
    beside = separation_deg(*looks, moved.ra_icrs_deg, moved.dec_icrs_deg + 0.1)
    assert beside * 3600.0 < 1.0


def test_a_mount_that_does_not_track_teaches_no_offset():
    loop = Loop(LIST)
    loop.planner.moved_by_hand(report(is_tracking=False))
    loop.planner.note_solution(solution_at(10.0, 10.0))
    assert loop.planner._pointing.last.samples == 0


def test_the_offset_is_that_of_the_side_the_mount_will_choose_when_it_is_told():
    """Hour angle 0.45 deg at the order, past the hysteresis at the aim: the mount stays west."""
    loop = Loop(LIST, hour_angle_deg=-0.3)
    here = report(-0.3)
    loop.expose(loop.planner.plan_exposure_here(T0_UTC_NS), SEARCHING, SEARCHING)
    loop.planner.note_solution(solution_at(here.ra_icrs_deg, here.dec_icrs_deg + 0.1))
    search = {"pattern": "targets", "targets": [{"name": "it", "hour_angle_deg": 0.55}]}
    loop.planner.configure(Config.model_validate({"search": search}))
    plan = loop.planner.plan(SEARCHING, loop.now_ns)
    assert plan.slew is not None
    sent = loop.planner.command(plan.slew)
    assert plan.slew.dec_icrs_deg - sent[1] == pytest.approx(0.1, abs=1e-3)
