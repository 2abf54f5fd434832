"""One of several tracks is dropped or kept by the operator: the others never notice."""

import dataclasses
from typing import Any

import pytest

from rsoconsole.night import recorded_figures
from rsoconsole.night.current_tracks import TAKEN_BACK_FRAMES
from rsoconsole.pipeline import replay
from rsoconsole.pipeline.cycle.decisions import KEPT
from rsoconsole.pipeline.replays.what_if_log import track_figures
from rsoconsole.records import (
    Miss,
    Missed,
    NotFollowed,
    OperatorAction,
    Ruling,
    SlewCommand,
    StateChange,
    TrackState,
)
from rsoconsole.session import decode, encode
from rsoconsole.tracking import Following, follow
from rsoconsole.words import text
from tests.pipeline.test_track_lead import FRAMES, SEVERAL, aims, locked, night_of_two, shown
from tests.rigs.engine_rig import command_handler_of, told
from tests.tracking.test_company import SLOT, owners, seen, settings


def walked(
    following: Following, frames: range, without: tuple[str, ...] = ()
) -> tuple[Following, list[Any]]:
    records: list[Any] = []
    for k in frames:
        left = [m for m in shown(k) if m.measurement_id.split("-")[1] not in without]
        following, more = follow(following, seen(k, left), settings())
        records += more
    return following, records


def ids(following: Following) -> list[int]:
    return [each.track.track_id for each in following.tracks]


@pytest.mark.parametrize("number", range(len(SLOT)))
def test_a_dropped_track_ends_and_its_streak_starts_none_while_the_others_go_on(number: int):
    before = locked()
    gone = before.tracks[number].track.track_id
    frame = seen(FRAMES, shown(FRAMES))
    plain, _ = walked(before, range(FRAMES, FRAMES + 8))
    after, records = follow(before, dataclasses.replace(frame, dropped=(gone,)), settings())
    assert ids(after) == [each for each in ids(before) if each != gone]
    assert [each.track.is_lead for each in after.tracks] == [True, False]
    assert not [r for r in records if isinstance(r, TrackState) and r.track_id == gone]
    assert not [r for r in records if isinstance(r, StateChange)]
    after, more = walked(after, range(FRAMES + 1, FRAMES + 8))
    assert ids(after) == [each for each in ids(before) if each != gone]
    assert after.last_track_id == before.last_track_id
    # What the others are comes to the same bits.
    theirs = {each.track.track_id: each.track.x for each in plain.tracks}
    assert {t.track.track_id: t.track.x for t in after.tracks} == {
        n: x for n, x in theirs.items() if n != gone
    }
    # Whose streak it was is on record in every frame.
    of_gone = [r for r in (*records, *more) if isinstance(r, NotFollowed) and r.track_id == gone]
    assert len(of_gone) == 8
    assert {text(r.reason) for r in of_gone} == {"of a track that the operator has dropped"}


def test_all_dropped_the_search_goes_on_and_finds_none_of_them_again():
    before = locked()
    frame = dataclasses.replace(seen(FRAMES, shown(FRAMES)), dropped=tuple(ids(before)))
    after, _ = follow(before, frame, settings())
    assert after.state == "SEARCH"
    assert not after.tracks
    after, _ = walked(after, range(FRAMES + 1, FRAMES + 6))
    assert (after.state, after.tracks, len(after.dropped)) == ("SEARCH", (), len(SLOT))


def test_another_satellite_begins_a_track_beside_a_dropped_one():
    """Of two, one is not seen until the other has been dropped."""
    following = Following()
    late, early = SLOT[0], tuple(SLOT[1:])
    following, _ = walked(following, range(FRAMES), without=(late, *early[1:]))
    (only,) = ids(following)
    frame = dataclasses.replace(seen(FRAMES, shown(FRAMES)[1:2]), dropped=(only,))
    following, _ = follow(following, frame, settings())
    following, _ = walked(following, range(FRAMES + 1, FRAMES + 5), without=early[1:])
    assert ids(following) == [only + 1]
    assert list(owners(following, FRAMES + 4).values()) == [late]


def test_what_the_frame_of_the_word_begins_never_began():
    following, _ = walked(Following(), range(1))
    frame = dataclasses.replace(seen(1, shown(1)), dropped=(2,))
    after, records = follow(following, frame, settings())
    assert 2 not in ids(after)
    assert len(after.tracks) == len(SLOT) - 1
    assert not [r for r in records if isinstance(r, TrackState) and r.track_id == 2]
    after, _ = walked(after, range(2, 6))
    assert ids(after) == ids(after)[:3]
    assert after.last_track_id == len(SLOT)


def test_a_dropped_one_that_the_operator_chooses_is_followed_again():
    before = locked()
    gone = before.tracks[1].track.track_id
    frame = dataclasses.replace(seen(FRAMES, shown(FRAMES)), dropped=tuple(ids(before)))
    after, _ = follow(before, frame, settings())
    own = before.tracks[1].taken.measurement_id.split("-")[1]
    k = FRAMES + 1
    wanted = next(m for m in shown(k) if m.measurement_id == f"{k}-{own}")
    after, _ = follow(after, dataclasses.replace(seen(k, shown(k)), chosen=wanted), settings())
    assert gone not in [each.track.track_id for each in after.dropped]
    after, _ = walked(after, range(k + 1, k + 3))
    assert list(owners(after, k + 2).values()) == [own]


def test_what_has_been_dropped_is_forgotten_once_nobody_knows_where_it_is():
    before = locked()
    gone = before.tracks[1].track.track_id
    frame = dataclasses.replace(seen(FRAMES, shown(FRAMES)), dropped=(gone,))
    after, _ = follow(before, frame, settings())
    tight = settings()
    most_s = tight.filter.model_copy(update={"max_coast_s": 60.0})
    later = dataclasses.replace(seen(FRAMES + 100, ()), measurements=())
    after, _ = follow(after, later, dataclasses.replace(tight, filter=most_s))
    assert after.dropped == ()


def test_a_kept_track_outlives_a_coast_that_ends_the_others():
    before = locked()
    kept = before.tracks[2].track.track_id
    short = settings()
    short = dataclasses.replace(
        short, filter=short.filter.model_copy(update={"max_coast_s": 100.0})
    )
    frame = dataclasses.replace(seen(FRAMES, shown(FRAMES)), kept=(kept,))
    after, records = follow(before, frame, short)
    states = [r for r in records if isinstance(r, TrackState)]
    assert {r.track_id for r in states if r.is_kept} == {kept}
    for k in range(FRAMES + 1, FRAMES + 9):
        after, records = follow(after, seen(k, []), short)
    assert ids(after) == [kept]
    assert after.state == "COAST"
    frame = dataclasses.replace(seen(FRAMES + 9, []), released=(kept,))
    after, records = follow(after, frame, short)
    assert after.state == "LOST"
    ended = [r for r in records if isinstance(r, Miss)]
    assert isinstance(ended[0].reason, Missed)
    assert ended[0].reason.lost is not None


def test_a_kept_track_of_two_streaks_outlives_more_misses_than_another():
    following, _ = walked(Following(), range(2))
    lead, kept, other = ids(following)
    frame = dataclasses.replace(seen(2, []), kept=(kept,))
    after, _ = follow(following, frame, settings())
    assert ids(after) == [lead, kept, other]
    for k in (3, 4):
        after, _ = follow(after, seen(k, []), settings())
    assert ids(after) == [lead, kept]  # the lead is looked for


def test_the_console_drops_one_and_takes_it_back_and_a_replay_agrees():
    r = night_of_two()
    lead, other = (each.track.track_id for each in r.engine.following.tracks)
    command_handler = command_handler_of(r)
    untouched = r.engine.following.tracks
    assert told(command_handler, "drop", {"track": lead}).ok
    r.engine.commands.execute_waiting()
    assert ids(r.engine.following) == [other]
    (said,) = [a for a in r.memory.of(OperatorAction) if a.outcome.kind == "ruled"]
    assert text(said.outcome).endswith(
        "dropped: its streak starts no track while it is in the field"
    )
    before = r.memory.of(SlewCommand)[-1].dec_icrs_deg
    assert aims(r, 3) - before == pytest.approx(0.05, abs=0.01)
    assert ids(r.engine.following) == [other]
    assert told(command_handler, "drop", {"track": other, "off": True}).message == (
        f"track {other} has not been dropped in the last frames:"
        " follow its streak in the picture instead"
    )
    assert told(command_handler, "drop", {"track": lead, "off": True}).ok
    r.engine.commands.execute_waiting()
    assert ids(r.engine.following) == [lead, other]
    assert r.engine.following.track.innovations > untouched[0].track.innovations
    assert aims(r, 2) - before == pytest.approx(0.0, abs=0.01)
    records = [decode(*encode(record)[::2]) for record in r.memory.records]
    frames = list(replay(records, SEVERAL))
    assert recorded_figures(records) == track_figures(frames)
    assert all(frame.is_as_recorded for frame in frames)
    assert frames[-1].after.tracks == r.engine.following.tracks


def test_of_two_dropped_with_one_frame_one_alone_is_taken_back():
    r = night_of_two()
    lead, other = ids(r.engine.following)
    command_handler = command_handler_of(r)
    for arguments in ({"track": other}, {"track": lead}, {"track": other, "off": True}):
        assert told(command_handler, "drop", arguments).ok
        r.engine.commands.execute_waiting()
    assert ids(r.engine.following) == [other]
    assert r.engine.authority.state == "TRACK"


def test_the_console_offers_to_take_back_as_long_as_the_engine_does():
    assert TAKEN_BACK_FRAMES == KEPT


def test_both_dropped_it_searches_and_a_replay_agrees():
    r = night_of_two()
    command_handler = command_handler_of(r)
    for number in ids(r.engine.following):
        assert told(command_handler, "drop", {"track": number}).ok
        r.engine.commands.execute_waiting()
    assert r.engine.authority.state == "SEARCH"
    r.engine.run(frames=r.engine.frame_id + 4)
    assert not r.engine.following.tracks
    assert [decision.dropped for decision in r.memory.of(Ruling)] == [(1,), (1, 2)]
    records = [decode(*encode(record)[::2]) for record in r.memory.records]
    frames = list(replay(records, SEVERAL))
    assert all(frame.is_as_recorded for frame in frames)
    assert frames[-1].after == r.engine.following


def test_a_word_on_a_streak_leaves_what_was_said_of_a_track():
    r = night_of_two()
    lead, other = ids(r.engine.following)
    command_handler = command_handler_of(r)
    assert told(command_handler, "drop", {"track": other}).ok
    r.engine.commands.execute_waiting()
    assert told(command_handler, "reject", {"frame": r.memory.of(Ruling)[-1].frame_id}).ok
    r.engine.commands.execute_waiting()
    assert r.memory.of(Ruling)[-1].dropped == (other,)
    assert ids(r.engine.following) == [lead]


def test_what_cannot_be_is_refused_in_one_line():
    r = night_of_two()
    command_handler = command_handler_of(r)
    outcome = told(command_handler, "drop", {"track": 7})
    assert not outcome.ok
    assert outcome.message == "no track 7 is followed: those followed are 1 2"
    assert told(command_handler, "keep", {"track": 1}).ok
    r.engine.commands.execute_waiting()
    assert told(command_handler, "keep", {"track": 1}).message == "track 1 is kept already"
    assert told(command_handler, "keep", {"track": 2, "off": True}).message == "track 2 is not kept"
    assert told(command_handler, "disarm", {}).ok
    r.engine.commands.execute_waiting()
    outcome = told(command_handler, "drop", {"track": 1})
    assert outcome.message == "nothing is followed: autonomy does not have the mount"
