"""Who is in charge: every passage between the states of the loop, as a table."""

import itertools
from typing import Any

import pytest

from rsoconsole.config import FilterConfig
from rsoconsole.engine.aim.states import (
    AUTONOMOUS,
    FAILURES_IN_A_ROW,
    Armed,
    Charge,
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
from rsoconsole.reason_text import text
from rsoconsole.records import LoopState
from rsoconsole.tracking.association.following import Following, Tracked
from rsoconsole.tracking.filters.lqe import initialise
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
HAPPENINGS = [
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


def charge_in(state: LoopState, **more: Any) -> Charge:
    tracks = (Tracked(track=TRACK_STATE),) if state in ("TRACK", "COAST") else ()
    # A FAULT of this table is one that took the mount from autonomy.
    more = {"was_autonomous": state == "FAULT", **more}
    return Charge(following=Following(state=state, tracks=tracks), **more)


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


@pytest.mark.parametrize(("before", "happening", "after", "actions"), PASSAGES)
def test_each_passage_leads_where_the_table_says(before, happening, after, actions):
    result = step(charge_in(before), happening)
    assert (result.charge.state, result.actions) == (after, actions)


@pytest.mark.parametrize(
    ("before", "happening"),
    [
        *((state, Armed(by=YOU)) for state in sorted(AUTONOMOUS)),
        *((state, Held(by=YOU)) for state in ("IDLE", "MANUAL", "FAULT")),
        *((state, Resumed(by=YOU)) for state in ("IDLE", "FAULT", "TRACK", "MANUAL")),
    ],
)
def test_what_makes_no_sense_is_refused_with_a_reason_and_changes_nothing(before, happening):
    charge = charge_in(before)
    result = step(charge, happening)
    assert result.refusal
    assert (result.charge, result.actions) == (charge, ())


@pytest.mark.parametrize(("state", "happening"), list(itertools.product(ALL, HAPPENINGS)))
def test_no_state_is_without_a_way_out(state, happening):
    """STOP, a move by hand and disarming work in every state, whatever happened before."""
    after = step(charge_in(state), happening).charge
    assert step(after, Stopped(by=YOU)).charge.state == "IDLE"
    assert step(after, Taken(by=YOU)).charge.state == "MANUAL"
    assert step(after, Disarmed(by=YOU)).charge.state == "IDLE"


@pytest.mark.parametrize(("state", "happening"), list(itertools.product(ALL, HAPPENINGS)))
def test_only_arming_and_resuming_give_autonomy_the_mount(state, happening):
    before = charge_in(state)
    after = step(before, happening).charge
    if after.is_autonomous and not before.is_autonomous:
        assert isinstance(happening, Armed | Resumed)


def test_failures_in_a_row_are_a_fault_and_a_frame_between_forgives_them():
    charge = charge_in("TRACK")
    for _ in range(FAILURES_IN_A_ROW - 1):
        charge = step(charge, Failed(words="no frame")).charge
    assert charge.state == "TRACK"
    forgiven = step(charge, Followed(after=charge.following)).charge
    assert step(forgiven, Failed(words="no frame")).charge.state == "TRACK"
    assert step(charge, Failed(words="no frame")).charge.state == "FAULT"


def test_a_limit_met_again_and_again_is_a_fault_that_names_the_way_out():
    charge = charge_in("TRACK")
    for _ in range(FAILURES_IN_A_ROW):
        result = step(charge, LimitMet(words="altitude 14.9 deg"))
        charge = result.charge
    assert charge.state == "FAULT"
    assert "altitude 14.9 deg" in text(result.reason)
    assert "arm again" in text(result.reason)


def test_a_track_is_taken_up_again_after_a_move_by_hand():
    taken = step(charge_in("TRACK"), Taken(by=YOU)).charge
    moved_again = step(taken, Taken(by=YOU)).charge
    resumed = step(moved_again, Resumed(by=YOU)).charge
    assert (resumed.state, resumed.following.track) == ("COAST", TRACK_STATE)


def test_a_search_begins_again_after_a_move_by_hand():
    resumed = step(step(charge_in("SEARCH"), Taken(by=YOU)).charge, Resumed(by=YOU))
    assert resumed.charge.state == "SEARCH"
    assert resumed.actions == ("start search", "forget plate")


@pytest.mark.parametrize("before", ["IDLE", "FAULT"])
def test_a_move_by_hand_is_no_way_round_the_checklist(before):
    taken = step(charge_in(before), Taken(by=YOU)).charge
    assert step(taken, Resumed(by=YOU)).refusal
    stopped = step(step(charge_in("TRACK"), Stopped(by=YOU)).charge, Taken(by=YOU)).charge
    assert step(stopped, Resumed(by=YOU)).refusal


def test_a_hold_ends_with_resume_and_with_arming_after_a_stop():
    held = step(charge_in("TRACK"), Held(by=YOU)).charge
    assert held.is_held
    assert not step(held, Resumed(by=YOU)).charge.is_held
    stopped = step(held, Stopped(by=YOU)).charge
    assert not step(stopped, Armed(by=YOU)).charge.is_held


def test_a_limit_leaves_a_hold_a_hold():
    """Else autonomy would slew away from where the operator has stopped it."""
    charge = step(charge_in("TRACK"), Held(by="operator", until_clear=True)).charge
    after = step(charge, LimitMet(words="pier by 0.1 deg")).charge
    assert (after.state, after.is_held, after.resumes_when_clear) == ("SEARCH", True, True)
    assert not step(after, Resumed(by="operator")).charge.is_held


def test_the_holder_is_named():
    assert {state: charge_in(state).holder for state in ALL} == {
        **dict.fromkeys(AUTONOMOUS, "autonomy"),
        "MANUAL": "operator",
        "IDLE": "nobody",
        "FAULT": "nobody",
    }


def test_what_is_unknown_is_an_error_and_no_silence():
    with pytest.raises(TypeError, match="str"):
        step(Charge(), "dance")  # type: ignore[arg-type]


@pytest.mark.parametrize("state", ALL)
def test_a_stop_that_is_not_confirmed_is_a_fault_and_moves_nothing(state):
    unsure = step(charge_in(state), Stopped(by=YOU, is_confirmed=False))
    assert (unsure.charge.state, unsure.actions) == ("FAULT", ("abort",))
    assert "NOT CONFIRMED" in text(unsure.reason)
    # Nobody parks behind the back of the operator who has stopped it.
    assert step(unsure.charge, NightEnded(words="rain", parks=True)).charge.state == "FAULT"
    assert step(unsure.charge, Stopped(by=YOU)).charge.state == "IDLE"
    assert step(unsure.charge, Armed(by=YOU)).charge.is_responsible


@pytest.mark.parametrize("state", ["IDLE", "MANUAL"])
def test_a_fault_without_autonomy_leaves_the_mount_to_its_operator(state):
    fault = step(charge_in(state), Failed(words="camera", is_final=True)).charge
    assert fault.state == "FAULT"
    # Neither dawn nor rain parks what nobody gave to autonomy.
    ended = step(fault, NightEnded(words="rain", parks=True))
    assert (ended.charge.state, ended.actions) == ("FAULT", ())


def test_a_fault_that_took_the_mount_from_autonomy_is_parked_when_the_night_ends():
    for happening in (Failed(words="camera", is_final=True), LimitMet(words="altitude")):
        charge = Charge(following=Following(state="SEARCH"), failures=FAILURES_IN_A_ROW)
        fault = step(charge, happening).charge
        ended = step(fault, NightEnded(words="rain", parks=True))
        assert (fault.state, ended.charge.state) == ("FAULT", "IDLE")
        assert ended.actions == ("abort", "park")
