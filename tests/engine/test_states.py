"""Who is in charge: every passage between the states of the loop, as a table."""

import itertools
from typing import Any

import pytest

from rsoconsole.config import FilterConfig
from rsoconsole.engine.aim.states import (
    AUTONOMOUS,
    FAILURES_IN_A_ROW,
    Armed,
    Authority,
    ClockSet,
    Disarmed,
    Failed,
    Followed,
    Held,
    LimitMet,
    NightEnded,
    NotPointing,
    Resumed,
    Stopped,
    Taken,
    step,
)
from rsoconsole.records import LoopState
from rsoconsole.tracking import Following
from rsoconsole.tracking import LiveTrack as Tracked
from rsoconsole.tracking.filters.lqe import initialise
from rsoconsole.words import text
from tests.makers import geo_measurement

TRACK_STATE = initialise(geo_measurement(0), geo_measurement(1), FilterConfig())
ALL: tuple[LoopState, ...] = (
    "IDLE",
    "SEARCH",
    "ACQUIRE",
    "TRACK",
    "COAST",
    "LOST",
    "MANUAL",
    "FAULT",
)
YOU = "operator"
TRIGGERS = [
    Armed(by=YOU),
    Disarmed(by=YOU),
    Stopped(by=YOU),
    Taken(by=YOU),
    Held(by=YOU),
    Resumed(by=YOU),
    Followed(after=Following(state="SEARCH")),
    Failed(words="no frame"),
    Failed(words="broken", is_final=True),
    LimitMet(words="altitude"),
    ClockSet(step_s=3600.0),
    NightEnded(words="dawn", parks=True),
    NotPointing(words="2 deg off"),
]


def authority_in(state: LoopState, **more: Any) -> Authority:
    tracks = (Tracked(track=TRACK_STATE),) if state in ("TRACK", "COAST") else ()
    # A FAULT of this table is one that took the mount from autonomy.
    more = {"was_autonomous": state == "FAULT", **more}
    return Authority(following=Following(state=state, tracks=tracks), **more)


# state, what happens, the state after it, what the hands must do
PASSAGES = [
    ("IDLE", Armed(by=YOU), "SEARCH", ("start search", "forget plate")),
    ("MANUAL", Armed(by=YOU), "SEARCH", ("start search", "forget plate")),
    ("FAULT", Armed(by=YOU), "SEARCH", ("start search", "forget plate")),
    ("TRACK", Disarmed(by=YOU), "IDLE", ()),
    ("MANUAL", Disarmed(by=YOU), "IDLE", ()),
    ("FAULT", Disarmed(by=YOU), "IDLE", ()),
    ("TRACK", Stopped(by=YOU), "IDLE", ("abort",)),
    ("MANUAL", Stopped(by=YOU), "IDLE", ("abort",)),
    ("IDLE", Stopped(by=YOU), "IDLE", ("abort",)),
    ("FAULT", Stopped(by=YOU), "IDLE", ("abort",)),
    ("IDLE", Taken(by=YOU), "MANUAL", ("forget plate",)),
    ("SEARCH", Taken(by=YOU), "MANUAL", ("forget plate",)),
    ("TRACK", Taken(by=YOU), "MANUAL", ("forget plate",)),
    ("FAULT", Taken(by=YOU), "MANUAL", ("forget plate",)),
    ("TRACK", Held(by=YOU), "TRACK", ()),
    ("SEARCH", Followed(after=Following(state="ACQUIRE")), "ACQUIRE", ()),
    ("COAST", Followed(after=Following(state="LOST")), "LOST", ()),
    ("MANUAL", Followed(after=Following(state="TRACK")), "MANUAL", ()),
    ("IDLE", Followed(after=Following(state="TRACK")), "IDLE", ()),
    ("TRACK", Failed(words="no frame"), "TRACK", ()),
    ("TRACK", Failed(words="broken", is_final=True), "FAULT", ("abort",)),
    ("FAULT", Failed(words="no frame"), "FAULT", ()),
    ("TRACK", LimitMet(words="altitude"), "SEARCH", ("search home", "forget plate")),
    ("MANUAL", LimitMet(words="altitude"), "MANUAL", ()),
    ("TRACK", ClockSet(step_s=-5.0), "SEARCH", ("start search", "forget plate")),
    ("MANUAL", ClockSet(step_s=-5.0), "MANUAL", ()),
    ("IDLE", ClockSet(step_s=-5.0), "IDLE", ()),
    ("IDLE", LimitMet(words="altitude"), "IDLE", ()),
    ("TRACK", NightEnded(words="dawn", parks=True), "IDLE", ("abort", "park")),
    ("TRACK", NightEnded(words="dawn", parks=False), "IDLE", ("abort",)),
    ("MANUAL", NightEnded(words="rain", parks=True), "MANUAL", ()),
    ("FAULT", NightEnded(words="rain", parks=True), "IDLE", ("abort", "park")),
    ("SEARCH", NotPointing(words="2 deg off"), "IDLE", ()),
    ("MANUAL", NotPointing(words="2 deg off"), "MANUAL", ()),
]


@pytest.mark.parametrize(("before", "trigger", "after", "actions"), PASSAGES)
def test_each_passage_leads_where_the_table_says(before, trigger, after, actions):
    result = step(authority_in(before), trigger)
    assert (result.authority.state, result.actions) == (after, actions)


@pytest.mark.parametrize(
    ("before", "trigger"),
    [
        *((state, Armed(by=YOU)) for state in sorted(AUTONOMOUS)),
        *((state, Held(by=YOU)) for state in ("IDLE", "MANUAL", "FAULT")),
        *((state, Resumed(by=YOU)) for state in ("IDLE", "FAULT", "TRACK", "MANUAL")),
    ],
)
def test_what_makes_no_sense_is_refused_with_a_reason_and_changes_nothing(before, trigger):
    authority = authority_in(before)
    result = step(authority, trigger)
    assert result.refusal
    assert (result.authority, result.actions) == (authority, ())


@pytest.mark.parametrize(("state", "trigger"), list(itertools.product(ALL, TRIGGERS)))
def test_no_state_is_without_a_way_out(state, trigger):
    """STOP, a move by hand and disarming work in every state, whatever happened before."""
    after = step(authority_in(state), trigger).authority
    assert step(after, Stopped(by=YOU)).authority.state == "IDLE"
    assert step(after, Taken(by=YOU)).authority.state == "MANUAL"
    assert step(after, Disarmed(by=YOU)).authority.state == "IDLE"


@pytest.mark.parametrize(("state", "trigger"), list(itertools.product(ALL, TRIGGERS)))
def test_only_arming_and_resuming_give_autonomy_the_mount(state, trigger):
    before = authority_in(state)
    after = step(before, trigger).authority
    if after.is_autonomous and not before.is_autonomous:
        assert isinstance(trigger, Armed | Resumed)


def test_failures_in_a_row_are_a_fault_and_a_frame_between_forgives_them():
    authority = authority_in("TRACK")
    for _ in range(FAILURES_IN_A_ROW - 1):
        authority = step(authority, Failed(words="no frame")).authority
    assert authority.state == "TRACK"
    forgiven = step(authority, Followed(after=authority.following)).authority
    assert step(forgiven, Failed(words="no frame")).authority.state == "TRACK"
    assert step(authority, Failed(words="no frame")).authority.state == "FAULT"


def test_a_limit_met_again_and_again_is_a_fault_that_names_the_way_out():
    authority = authority_in("TRACK")
    for _ in range(FAILURES_IN_A_ROW):
        result = step(authority, LimitMet(words="altitude 14.9 deg"))
        authority = result.authority
    assert authority.state == "FAULT"
    assert "altitude 14.9 deg" in text(result.reason)
    assert "arm again" in text(result.reason)


def test_a_track_is_taken_up_again_after_a_move_by_hand():
    taken = step(authority_in("TRACK"), Taken(by=YOU)).authority
    moved_again = step(taken, Taken(by=YOU)).authority
    resumed = step(moved_again, Resumed(by=YOU)).authority
    assert (resumed.state, resumed.following.track) == ("COAST", TRACK_STATE)


def test_a_search_begins_again_after_a_move_by_hand():
    resumed = step(step(authority_in("SEARCH"), Taken(by=YOU)).authority, Resumed(by=YOU))
    assert resumed.authority.state == "SEARCH"
    assert resumed.actions == ("start search", "forget plate")


@pytest.mark.parametrize("before", ["IDLE", "FAULT"])
def test_a_move_by_hand_is_no_way_round_the_checklist(before):
    taken = step(authority_in(before), Taken(by=YOU)).authority
    assert step(taken, Resumed(by=YOU)).refusal
    stopped = step(step(authority_in("TRACK"), Stopped(by=YOU)).authority, Taken(by=YOU)).authority
    assert step(stopped, Resumed(by=YOU)).refusal


def test_a_hold_ends_with_resume_and_with_arming_after_a_stop():
    held = step(authority_in("TRACK"), Held(by=YOU)).authority
    assert held.is_held
    assert not step(held, Resumed(by=YOU)).authority.is_held
    stopped = step(held, Stopped(by=YOU)).authority
    assert not step(stopped, Armed(by=YOU)).authority.is_held


def test_a_limit_leaves_a_hold_a_hold():
    """Else autonomy would slew away from where the operator has stopped it."""
    authority = step(authority_in("TRACK"), Held(by="operator", until_clear=True)).authority
    after = step(authority, LimitMet(words="pier by 0.1 deg")).authority
    assert (after.state, after.is_held, after.resumes_when_clear) == ("SEARCH", True, True)
    assert not step(after, Resumed(by="operator")).authority.is_held


def test_the_holder_is_named():
    assert {state: authority_in(state).holder for state in ALL} == {
        **dict.fromkeys(AUTONOMOUS, "autonomy"),
        "MANUAL": "operator",
        "IDLE": "nobody",
        "FAULT": "nobody",
    }


def test_what_is_unknown_is_an_error_and_no_silence():
    with pytest.raises(TypeError, match="str"):
        step(Authority(), "dance")  # type: ignore[arg-type]


@pytest.mark.parametrize("state", ALL)
def test_a_stop_that_is_not_obeyed_is_a_fault_and_moves_nothing(state):
    unsure = step(authority_in(state), Stopped(by=YOU, is_obeyed=False))
    assert (unsure.authority.state, unsure.actions) == ("FAULT", ("abort",))
    assert "NOT OBEYED" in text(unsure.reason)
    # Nobody parks behind the back of the operator who has stopped it.
    assert step(unsure.authority, NightEnded(words="rain", parks=True)).authority.state == "FAULT"
    assert step(unsure.authority, Stopped(by=YOU)).authority.state == "IDLE"
    assert step(unsure.authority, Armed(by=YOU)).authority.is_responsible


@pytest.mark.parametrize("state", ["IDLE", "MANUAL"])
def test_a_fault_without_autonomy_leaves_the_mount_to_its_operator(state):
    fault = step(authority_in(state), Failed(words="camera", is_final=True)).authority
    assert fault.state == "FAULT"
    # Neither dawn nor rain parks what nobody gave to autonomy.
    ended = step(fault, NightEnded(words="rain", parks=True))
    assert (ended.authority.state, ended.actions) == ("FAULT", ())


def test_a_fault_that_took_the_mount_from_autonomy_is_parked_when_the_night_ends():
    for trigger in (Failed(words="camera", is_final=True), LimitMet(words="altitude")):
        authority = Authority(following=Following(state="SEARCH"), failures=FAILURES_IN_A_ROW)
        fault = step(authority, trigger).authority
        ended = step(fault, NightEnded(words="rain", parks=True))
        assert (fault.state, ended.authority.state) == ("FAULT", "IDLE")
        assert ended.actions == ("abort", "park")
