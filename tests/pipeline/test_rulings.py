"""The operator's word on frames already followed: what it does to the track, and its replay."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from rsoconsole.cli.judge.summary import summarise
from rsoconsole.config import Config
from rsoconsole.control import Outcome
from rsoconsole.library.notebook.night.night import read_drawn_night
from rsoconsole.night import Night, recorded_figures
from rsoconsole.pipeline import Reduction, replay
from rsoconsole.pipeline.cycle.decisions import KEPT
from rsoconsole.pipeline.replays.what_if_log import track_figures
from rsoconsole.records import (
    Event,
    FollowedAgain,
    Frame,
    FrameTaken,
    Miss,
    NotFollowed,
    NotTaken,
    OperatorAction,
    ParameterChange,
    Ruling,
    SlewRefusal,
    StateChange,
    TrackState,
)
from rsoconsole.session import SessionReader, decode, encode
from rsoconsole.words import text
from tests.nights import made_up_night
from tests.nights.engine_nights import Misleading
from tests.rigs.engine_rig import Rig, asked, command_handler_of, rig, told

CONFIG = Config.model_validate({"search": {"recentre": "every"}})


def night(frames: set[int], misled: frozenset[int] = frozenset()) -> Rig:
    r = rig(frames, CONFIG)
    r.reducer.__class__ = Misleading
    r.reducer.misled = misled
    r.engine.arm()
    return r


def say(r: Rig, verb: str, **arguments: Any) -> Outcome:
    """To the command handler, and executed at once."""
    outcome = told(command_handler_of(r), verb, arguments)
    r.engine.commands.execute_waiting()
    return outcome


def replayed(r: Rig) -> list[Any]:
    records = [decode(*encode(record)[::2]) for record in r.memory.records]
    frames = list(replay(records, CONFIG))
    assert recorded_figures(records) == track_figures(frames)
    return frames


def test_a_streak_marked_by_hand_measures_a_frame_that_had_missed():
    r = night({*range(1, 9), *range(10, 14)})
    r.engine.run(frames=9)
    assert r.engine.following.state == "COAST"
    assert say(r, "mark", x_a=0.0, y_a=0.0, x_b=3.0, y_b=3.0).ok
    after = r.engine.following
    assert after.state == "TRACK"
    assert after.lead_measured.source == "operator"
    assert after.lead_measured.frame_id == 9
    assert after.track.misses == 0
    (change,) = [c for c in r.memory.of(StateChange) if c.before == "COAST"]
    assert text(change.reason) == "frame 9: taken by the operator's hand"
    r.engine.run(frames=13)
    assert r.engine.following.state == "TRACK"
    frames = replayed(r)
    assert all(frame.is_as_recorded for frame in frames)
    assert frames[-1].after == r.engine.following


def test_a_rejected_measurement_is_as_if_it_had_never_been():
    r, plain = night(set(range(1, 12))), night({*range(1, 8), *range(9, 12)})
    for each in (r, plain):
        each.engine.run(frames=8)
    assert say(r, "reject").ok
    assert r.engine.following.state == plain.engine.following.state == "COAST"
    assert r.engine.following.track == plain.engine.following.track
    (no,) = [n for n in r.memory.of(NotFollowed) if n.reason == NotTaken(kind="refused")]
    assert no.frame_id == 8
    for each in (r, plain):
        each.engine.run(frames=11)
    assert r.engine.following.track.x == plain.engine.following.track.x
    assert all(frame.is_as_recorded for frame in replayed(r))


def test_a_second_rejection_is_of_the_measurement_before():
    r = night(set(range(1, 12)))
    r.engine.run(frames=8)
    for _ in range(2):
        assert say(r, "reject").ok
    assert r.engine.following.lead_measured.frame_id == 6
    assert r.engine.following.track.misses == 2
    assert all(frame.is_as_recorded for frame in replayed(r))


def test_what_the_gate_refused_is_taken_when_the_operator_accepts_it():
    r = night(set(range(1, 12)), misled=frozenset({8}))
    r.engine.run(frames=8)
    assert r.engine.following.state == "COAST"
    assert say(r, "accept").ok
    # Ten sigmas off it is another object: two frames must agree on its motion first.
    assert r.engine.following.state == "ACQUIRE"
    assert [m.frame_id for m in r.engine.following.candidates] == [8]
    assert all(frame.is_as_recorded for frame in replayed(r))


def test_a_word_on_an_earlier_frame_follows_all_later_ones_again():
    r, plain = night(set(range(1, 12))), night({*range(1, 7), *range(8, 12)})
    for each in (r, plain):
        each.engine.run(frames=10)
    seventh = r.engine.cycle.folds.shown(7).measurements[0]
    decision = Ruling(frame_id=7, refused=(seventh,))
    after, records = r.engine.cycle.apply_decision(decision)
    assert after.track.x == plain.engine.following.track.x
    assert after.track.P == plain.engine.following.track.P
    assert [f.frame_id for f in records if isinstance(f, FollowedAgain)] == [7, 8, 9, 10]
    assert isinstance(records[0], Ruling)
    assert any(isinstance(record, Miss) for record in records)


def test_a_candidate_below_tau_may_be_chosen_where_it_lies():
    r = night(set(range(1, 8)))
    r.engine.run(frames=8)
    assert say(r, "choose", x=3.0, y=0.0).ok
    assert r.engine.following.lead_measured.source == "operator"
    assert (r.engine.following.lead_measured.x_px, r.engine.following.lead_measured.y_px) == (
        2.0,
        1.0,
    )
    assert all(frame.is_as_recorded for frame in replayed(r))


@pytest.mark.parametrize(
    ("verb", "arguments", "words"),
    [
        ("mark", {"x_a": 0.0, "y_a": 0.0, "x_b": 1.0, "y_b": 1.0}, "same place"),
        ("mark", {"x_a": 0.0, "y_a": 0.0, "x_b": 90.0, "y_b": 1.0}, "in the frame"),
        ("mark", {"x_a": 0.0, "y_a": 0.0, "x_b": 9.0}, "mark needs y_b, a number"),
        ("mark", {"x_a": 0.0, "y_a": 0.0, "x_b": 9.0, "y_b": 9.0, "sigma_px": 0.0}, "sigma_px"),
        ("choose", {"x": 60.0, "y": 60.0}, "no streak at 60, 60"),
        ("accept", {"frame": "x"}, "frame must be a whole number"),
        ("accept", {"frame": 99}, "frame 99"),
    ],
)
def test_what_cannot_be_is_refused_at_once_with_the_reason(verb, arguments, words):
    r = night(set(range(1, 9)))
    r.engine.run(frames=5)
    before = r.engine.following
    outcome = say(r, verb, **arguments)
    assert not outcome.ok
    assert words in outcome.message
    assert r.engine.following is before
    assert not r.memory.of(Ruling)


def test_without_autonomy_and_after_a_change_from_outside_there_is_nothing_to_say():
    r = night(set(range(1, 20)))
    r.engine.run(frames=6)
    say(r, "disarm")
    assert "nothing has been taken" in say(r, "reject").message
    r.engine.arm()
    assert "nothing has been taken" in say(r, "reject").message
    assert "no frame has been followed" in say(r, "accept").message


def test_only_the_last_frames_are_kept():
    r = night(set(range(1, 60)))
    r.engine.run(frames=KEPT + 6)
    folds = r.engine.cycle.folds
    assert folds.shown(KEPT + 6)
    with pytest.raises(ValueError, match=f"only on frames 7 to {KEPT + 6}"):
        folds.shown(6)


def test_what_if_a_frame_was_ruled_on_that_is_not_followed_then():
    """Under other settings the record's ruling may have nothing to be said on."""
    r = night(set(range(1, 12)))
    r.engine.run(frames=8)
    say(r, "reject")
    r.engine.run(frames=11)
    records = [decode(*encode(record)[::2]) for record in r.memory.records]
    changes = list(replay(records, CONFIG, changes={"filter.r_multiplier": 3.0}))
    assert changes[-1].after.state in {"TRACK", "COAST"}
    assert changes[-1].after.track != r.engine.following.track


def test_a_note_is_on_record_with_its_words():
    r = night(set())
    assert (
        command_handler_of(r).handle(asked("note", arguments={"text": " clouds from the west "})).ok
    )
    (action,) = [a for a in r.memory.of(OperatorAction) if a.verb == "note"]
    assert action.arguments == {"text": "clouds from the west"}
    for nothing in ({}, {"text": "  "}, {"text": 3}):
        assert not told(command_handler_of(r), "note", nothing).ok


def test_the_track_on_record_is_the_one_that_was_ruled():
    r = night(set(range(1, 12)))
    r.engine.run(frames=8)
    say(r, "reject")
    last = r.memory.of(TrackState)[-1]
    assert (last.frame_id, last.kind) == (8, "predicted")


# -- said while the sky goes on ---------------------------------------------------------------


def test_a_word_is_on_the_frame_it_was_said_of_though_a_newer_one_was_followed_meanwhile():
    r = night(set(range(1, 14)))
    r.engine.run(frames=8)
    assert command_handler_of(r).handle(asked("reject", arguments={"frame": 8})).ok
    r.engine.run(frames=9)
    r.engine.commands.execute_waiting()
    (decision,) = r.memory.of(Ruling)
    assert decision.frame_id == 8
    assert [m.frame_id for m in decision.refused] == [8]
    assert r.engine.following.lead_measured.frame_id == 9


def test_accept_takes_what_was_not_taken():
    r = night(set(range(1, 14)))
    r.engine.run(frames=8)
    assert say(r, "accept").ok
    (decision,) = r.memory.of(Ruling)
    assert (decision.taken.x_px, decision.taken.source) == (2.0, "operator")


def test_accept_takes_no_stranger_where_the_track_has_taken_a_streak_below_tau(monkeypatch):
    r = night(set(range(1, 14)))
    r.engine.run(frames=8)
    folds = r.engine.cycle.folds
    taken = folds.accepted_measurement(8)
    assert taken is not None
    monkeypatch.setattr(folds, "accepted_measurement", lambda _: replace(taken, source="faint"))
    assert "likeliest candidate of frame 8 already" in say(r, "accept").message
    assert not r.memory.of(Ruling)


def test_accept_never_takes_what_was_rejected():
    r = night(set(range(1, 14)))
    r.engine.run(frames=8)
    assert say(r, "reject").ok
    assert say(r, "accept").ok
    decision = r.memory.of(Ruling)[-1]
    assert [m.frame_id for m in decision.refused] == [8]
    assert (decision.taken.x_px, decision.taken.y_px) == (2.0, 1.0)
    assert "no candidate" in say(r, "accept").message


@pytest.mark.parametrize("words", [("reject", "accept"), ("reject", "reject"), ("reject",) * 8])
def test_words_one_after_the_other_are_replayed_each_in_its_place(words):
    r = night(set(range(1, 14)))
    r.engine.run(frames=8)
    for verb in words:
        say(r, verb)
    r.engine.run(frames=10)
    frames = replayed(r)
    assert all(frame.is_as_recorded for frame in frames)
    assert frames[-1].after == r.engine.following


def test_a_camera_that_fails_after_a_word_adds_nothing_to_the_frame_it_was_said_of():
    r = night(set(range(1, 14)))
    r.engine.run(frames=8)
    say(r, "reject")
    r.camera.broken_for = 1
    r.engine.run(frames=11)
    assert all(frame.is_as_recorded for frame in replayed(r))


def test_a_hold_while_a_frame_is_reduced_leaves_words_and_loans_in_their_frames():
    r = night(set(range(1, 40)))
    r.engine.run(frames=6)
    say(r, "set", name="detector.tau", value=0.3, frames=2)
    plain = r.reducer.reduce

    def reduce(frame: Frame) -> Reduction:
        if frame.frame_id == 8:
            r.queue.put(asked("hold"))
            r.queue.put(asked("reject"))
        return plain(frame)

    r.reducer.reduce = reduce
    r.engine.run(frames=10)
    records = r.memory.records
    back = next(
        n
        for n, each in enumerate(records)
        if isinstance(each, ParameterChange) and n > 0 and each.after == CONFIG.detector.tau
    )
    last_before = [each.frame_id for each in records[:back] if isinstance(each, FrameTaken)][-1]
    assert last_before == 8
    assert all(frame.is_as_recorded for frame in replayed(r))


def test_another_header_latency_moves_what_was_ruled_on_too():
    r = night(set(range(1, 12)))
    r.engine.run(frames=8)
    say(r, "reject")
    records = [decode(*encode(record)[::2]) for record in r.memory.records]
    changes = list(replay(records, CONFIG, changes={"exposure.header_latency_s": 0.1}))
    assert changes[-1].after.state == "COAST"
    r = night(set(range(1, 12)))
    r.engine.run(frames=8)
    say(r, "mark", x_a=0.0, y_a=0.0, x_b=3.0, y_b=3.0, replaces=True)
    records = [decode(*encode(record)[::2]) for record in r.memory.records]
    changes = list(replay(records, CONFIG, changes={"exposure.header_latency_s": 0.1}))
    assert changes[-1].after.lead_measured.source == "operator"
    assert (
        changes[-1].after.lead_measured.t_mid_utc_ns
        == r.engine.following.lead_measured.t_mid_utc_ns + 10**8
    )


# -- what others make of it -------------------------------------------------------------------


def kept(r: Rig, folder: Path) -> Path:
    """The rig's records as a session."""
    writer = made_up_night.begin(folder)
    for number, record in enumerate(r.memory.records):
        writer.append(record, made_up_night.t_of(1) + number)
    writer.close()
    return folder


def test_figures_and_summary_know_what_counts_no_more(tmp_path: Path):
    r = night(set(range(1, 14)))
    r.engine.run(frames=8)
    assert summarise(r.memory.records, [])["misses"] == 0
    say(r, "reject")
    r.engine.run(frames=9)
    assert summarise(r.memory.records, [])["misses"] == 1
    session = kept(r, tmp_path / "night")
    (eighth,) = [frame for frame in read_drawn_night(session).frames if frame.frame_id == 8]
    assert (eighth.lead_measured, eighth.updated) == (None, None)
    assert eighth.lead_miss_reason == "refused by the operator" or eighth.lead_miss_reason
    rows = [row for row in SessionReader(session).view_rows("track") if row["frame_id"] == 8]
    assert [row["is_superseded"] for row in rows if row["step"] == "updated"] == [1]
    assert [row["is_superseded"] for row in rows if row["step"] == "predicted"] == [1, 0]
    assert {row["is_superseded"] for row in SessionReader(session).view_rows("misses")} == {0}


def test_a_mark_on_a_missed_frame_is_no_miss_any_more():
    r = night({*range(1, 9), *range(10, 14)})
    r.engine.run(frames=9)
    assert summarise(r.memory.records, [])["misses"] == 1
    say(r, "mark", x_a=0.0, y_a=0.0, x_b=3.0, y_b=3.0)
    assert summarise(r.memory.records, [])["misses"] == 0


def test_the_console_follows_the_last_of_two_marks():
    r = night(set(range(1, 14)))
    r.engine.run(frames=8)
    say(r, "mark", x_a=0.0, y_a=0.0, x_b=4.0, y_b=4.0, replaces=True)
    say(r, "mark", x_a=6.0, y_a=6.0, x_b=10.0, y_b=10.0, replaces=True)
    folded = Night(Path("night"), {}, CONFIG)
    for number, record in enumerate(r.memory.records):
        folded.fold_record(made_up_night.t_of(1) + number, record)
    detail = folded.frame(8)
    assert (detail.accepted_measurement.x_px, detail.accepted_measurement.y_px) == (8.0, 8.0)
    by_hand = [m for m in detail.measurements if m.source == "operator"]
    assert [(m.x_px, m.y_px) for m in by_hand] == [(8.0, 8.0)]


# -- looked for again -------------------------------------------------------------------------


def test_nothing_is_looked_for_while_held_nor_where_it_must_not_be_looked():
    r = night(set(range(1, 30)))
    r.engine.run(frames=6)
    say(r, "hold")
    assert "resume first" in say(r, "seek").message
    assert r.engine.following.state == "TRACK"
    say(r, "resume")
    r.engine.slews.refusal = lambda *_, **__: SlewRefusal.beyond("altitude", 3.0, 15.0)
    refused = say(r, "seek")
    assert not refused.ok
    assert "altitude 3.0 deg" in refused.message
    assert r.engine.following.state == "TRACK"


def test_a_spiral_without_a_place_left_goes_home_and_ends_nothing():
    r = night(set(range(1, 7)))
    r.engine.run(frames=6)
    assert say(r, "seek").ok
    plain, spiral = r.engine.slews.refusal, r.engine.planner._search
    wall = SlewRefusal.beyond("altitude", 3.0, 15.0)
    r.engine.slews.refusal = lambda *a, **k: wall if spiral.is_spiral else plain(*a, **k)
    r.engine.run(frames=9)
    assert r.engine.authority.state == "SEARCH"
    assert any("nothing left to look at" in event.text for event in r.memory.of(Event))
