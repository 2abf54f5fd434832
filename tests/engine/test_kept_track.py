"""A track that was ended by a word can be followed again: for some minutes, and on record."""

import dataclasses

import pytest

from rsoconsole.base import InstrumentError
from rsoconsole.engine import CHECKS
from rsoconsole.engine.aim.states import ClockSet, LimitMet, Marked
from rsoconsole.pipeline import Reduction, replay
from rsoconsole.pipeline.cycle.track_assignment import KEPT_S, NS
from rsoconsole.pipeline.replays.refold import ReplayState
from rsoconsole.records import Event, Frame, NotSolved, OperatorAction, StateChange
from rsoconsole.session import decode, encode
from rsoconsole.words import text
from tests.rigs.engine_rig import CONFIG, Rig, asked, command_handler_of, heed_alarms, rig

FRAMES = set(range(1, 60))


@pytest.fixture
def tracking() -> Rig:
    """An engine whose track is six frames old."""
    r = rig(FRAMES)
    r.engine.arm()
    r.engine.run(frames=6)
    assert r.engine.status().state == "TRACK"
    return r


def tell(r: Rig, verb: str, **arguments: object) -> tuple[bool, str]:
    """Ask for it, and have the loop do it."""
    answer = command_handler_of(r).handle(asked(verb, arguments))
    r.engine.commands.execute_waiting()
    return answer.ok, answer.message


def causes(r: Rig) -> list[str]:
    return [text(change.reason) for change in r.memory.of(StateChange)]


def idle_for(r: Rig, seconds: float) -> None:
    """The engine is at rest for so long, a turn at its end."""
    r.clock.t_utc_ns += round(seconds * NS)
    r.engine._one_turn(is_bounded=False)


@pytest.mark.parametrize("verb", ["disarm", "seek"])
def test_what_a_word_has_ended_is_followed_again_as_the_same_track(tracking: Rig, verb: str):
    before = tracking.engine.following.track
    assert before is not None
    assert tell(tracking, verb)[0]
    ended = tracking.engine.status()
    assert (ended.kept, ended.is_resumable, ended.ra_icrs_deg) == ("track 1", True, None)
    assert ended.kept_until_utc_ns > tracking.clock.t_utc_ns
    assert tell(tracking, "resume")[0]
    again = tracking.engine.status()
    assert (again.state, again.holder, again.kept) == ("COAST", "autonomy", None)
    tracking.engine.run(frames=9)
    track = tracking.engine.following.track
    assert track is not None
    assert (tracking.engine.status().state, track.track_id) == ("TRACK", before.track_id)
    assert "resumed by operator" in causes(tracking)


def test_a_search_between_gives_its_own_track_another_number(tracking: Rig):
    """What was seen meanwhile and what is followed again are never taken for one."""
    tracking.reducer.frames = set()
    tell(tracking, "seek")
    tracking.engine.run(frames=8)
    tell(tracking, "resume")
    tracking.reducer.frames = FRAMES
    tracking.engine.run(frames=12)
    assert tracking.engine.following.track_id == 1
    tell(tracking, "seek")
    tracking.engine.run(frames=16)
    assert tracking.engine.following.track_id == 2
    assert tracking.engine.status().kept is None


def test_what_is_kept_is_too_old_after_a_while(tracking: Rig):
    tell(tracking, "disarm")
    idle_for(tracking, KEPT_S - 60.0)
    assert tracking.engine.status().kept
    idle_for(tracking, 120.0)
    status = tracking.engine.status()
    assert (status.kept, status.is_resumable) == (None, False)
    assert tell(tracking, "resume") == (False, "nothing is held: there is nothing to resume")


def test_after_a_stop_the_checklist_comes_first(tracking: Rig):
    tell(tracking, "stop")
    heed_alarms(tracking)
    assert tracking.engine.status().kept == "track 1"
    assert tell(tracking, "resume") == (
        False,
        "arm it first: then what was followed can be resumed",
    )
    tracking.engine.arm()
    assert tracking.engine.status().is_resumable
    assert tell(tracking, "resume")[0]
    assert tracking.engine.status().state == "COAST"


def test_after_an_instrument_s_fault_too(tracking: Rig):
    tracking.camera.broken_for = 3
    with pytest.raises(InstrumentError, match="FAULT"):
        tracking.engine.run(frames=12)
    assert (tracking.engine.status().kept, tracking.engine.status().is_resumable) == (
        "track 1",
        False,
    )
    tracking.engine.arm()
    tell(tracking, "resume")
    tracking.engine.run(frames=15)
    assert (tracking.engine.status().state, tracking.engine.following.track_id) == ("TRACK", 1)


@pytest.mark.parametrize("is_resumed_at_once", [True, False])
def test_a_first_look_under_a_cap_or_clouds_leaves_what_was_kept(
    tracking: Rig, is_resumed_at_once: bool
):
    tell(tracking, "stop")
    heed_alarms(tracking)
    plain = tracking.reducer.reduce

    def capped(frame: Frame) -> Reduction:
        unsolved = NotSolved(frame_id=frame.frame_id, reason="0 stars, 8 needed", ms=1.0)
        return dataclasses.replace(plain(frame), solution=unsolved)

    tracking.reducer.reduce = capped  # type: ignore[method-assign]
    tracking.engine.arm()
    if is_resumed_at_once:
        tell(tracking, "resume")
    with pytest.raises(InstrumentError, match="not solved"):
        tracking.engine.run(frames=8)
    status = tracking.engine.status()
    assert (status.state, status.kept, status.is_resumable) == ("IDLE", "track 1", False)
    tracking.reducer.reduce = plain  # type: ignore[method-assign]
    tracking.engine.arm()
    assert tell(tracking, "resume")[0]
    tracking.engine.run(frames=12)
    assert (tracking.engine.status().state, tracking.engine.following.track_id) == ("TRACK", 1)
    records = [decode(*encode(record)[::2]) for record in tracking.memory.records]
    assert all(frame.is_as_recorded for frame in replay(records, CONFIG))


def test_a_parked_mount_is_not_given_back(tracking: Rig):
    tell(tracking, "park")
    assert not tracking.engine.status().is_resumable
    tracking.engine.arm()
    tell(tracking, "disarm")
    tracking.mount.is_parked = True
    tell(tracking, "resume")
    came = tracking.memory.of(OperatorAction)[-1].outcome
    assert (came.kind, came.detail) == ("refused", "the mount is parked: unpark it first")
    assert tracking.engine.status().holder == "nobody"


def test_what_was_overridden_stands_as_long_as_the_mount_can_be_given_back():
    r = rig(FRAMES)
    r.engine.arm(lifted=frozenset({"disk"}))
    r.engine.run(frames=6)
    tell(r, "disarm")
    assert r.engine.status().lifted == ("disk",)
    idle_for(r, KEPT_S + 1.0)
    assert r.engine.status().lifted == ()


def test_a_night_with_tracks_followed_again_is_replayed_bit_for_bit(tracking: Rig):
    for verb, frames in (("disarm", 6), ("seek", 14), ("seek", 22)):
        tell(tracking, verb)
        tracking.engine.run(frames=frames)
        tell(tracking, "resume")
        tracking.engine.run(frames=frames + 4)
    records = [decode(*encode(record)[::2]) for record in tracking.memory.records]
    replayed = list(replay(records, CONFIG))
    assert len(replayed) > 20
    assert all(frame.is_as_recorded for frame in replayed)


def test_arming_and_following_again_at_once_checks_the_pointing_first(tracking: Rig):
    """As the console's one key asks it: both wait for the loop, and the first frame is no slew."""
    tell(tracking, "stop")
    heed_alarms(tracking)
    command_handler = command_handler_of(tracking)
    for verb in ("arm", "resume"):
        answer = command_handler.handle(
            asked(verb, {"override": list(CHECKS)} if verb == "arm" else {})
        )
        assert answer.ok, answer.message
    tracking.engine.commands.execute_waiting()
    assert (tracking.engine.status().state, tracking.engine.status().kept) == ("COAST", None)
    tracking.engine._one_turn(is_bounded=False)
    said = [event.text for event in tracking.memory.of(Event)]
    assert any(words.startswith("pointing offset") for words in said)
    tracking.engine.run(frames=12)
    assert (tracking.engine.status().state, tracking.engine.following.track_id) == ("TRACK", 1)


def kept_by_replay(r: Rig) -> int | None:
    """What a replay of the log so far holds to be followed again, by its track id."""
    walk = ReplayState.begin(CONFIG)
    for record in r.memory.records:
        list(walk.receive(decode(*encode(record)[::2])))
    return None if walk.kept is None else walk.kept.track_id


def assert_given_up_on_record(r: Rig) -> None:
    said = [event for event in r.memory.of(Event) if event.topic == "kept"]
    assert [event.text for event in said] == ["track 1 can no longer be followed again"]
    assert r.engine.authority.kept is None
    assert kept_by_replay(r) is None


@pytest.mark.parametrize("verb", ["disarm", "seek"])
def test_what_grew_too_old_is_given_up_on_record_and_a_replay_gives_it_up_too(
    tracking: Rig, verb: str
):
    tracking.reducer.frames = set()
    tell(tracking, verb)
    assert kept_by_replay(tracking) == 1
    idle_for(tracking, KEPT_S + 60.0)
    assert_given_up_on_record(tracking)


@pytest.mark.parametrize("verb", ["disarm", "seek"])
def test_what_a_set_clock_makes_worthless_is_given_up_on_record(tracking: Rig, verb: str):
    tracking.reducer.frames = set()
    tell(tracking, verb)
    tracking.engine.handle(ClockSet(step_s=3600.0))
    assert_given_up_on_record(tracking)


def test_a_limit_met_in_a_search_gives_up_what_was_kept_on_record(tracking: Rig):
    tell(tracking, "seek")
    tracking.engine.handle(LimitMet(words="altitude 5 deg, below 20"))
    assert_given_up_on_record(tracking)


def test_a_change_of_state_says_which_track_can_be_followed_again(tracking: Rig):
    tell(tracking, "disarm")
    tell(tracking, "resume")
    assert [change.kept_track_id for change in tracking.memory.of(StateChange)[-2:]] == [1, 0]
    # A passage of the fold's own is the same in every session.
    assert {c.kept_track_id for c in tracking.memory.of(StateChange) if c.after == "TRACK"} == {
        None
    }


def test_what_the_engine_keeps_longer_than_the_frames_say_is_kept_by_a_replay_too(tracking: Rig):
    """By hand the time counts again with every word; a replay of frames alone lost the track."""
    tell(tracking, "disarm")
    tell(tracking, "nudge", east_arcmin=0.0, north_arcmin=0.01)
    for _ in range(2):
        idle_for(tracking, 0.6 * KEPT_S)
        tracking.engine.handle(Marked(kept=tracking.engine.authority.kept))
    assert tracking.engine.authority.kept is not None
    assert kept_by_replay(tracking) == 1
