"""A moment of a recorded night is what the live seat showed then; the time line has its place."""

import random
import sqlite3
from collections.abc import Collection
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rsoconsole.console import parse_place
from rsoconsole.console.timeline import moments as moments_module
from rsoconsole.console.timeline.lines import (
    FILLS,
    SIGNS,
    TimelineMarks,
    cell_end_utc_ns,
    timeline_lines,
)
from rsoconsole.console.timeline.moments import MomentReader
from rsoconsole.console.timeline.timeline import (
    SPEEDS,
    FrameStart,
    Player,
    StateStart,
    Timeline,
    TimelineEvent,
    TypedPlace,
    typed_place_seq,
)
from rsoconsole.console.watches.watch import SessionWatch
from rsoconsole.night import Night, NightFrame, NightView
from rsoconsole.records import FollowedAgain, Ruling
from rsoconsole.session import SessionReader
from tests.makers import NS
from tests.nights import eventful_night, made_up_night

FRAMES = 260


@pytest.fixture(scope="module")
def eventful(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A night with misses, refusals, rulings, notes, changes and losses, closed."""
    folder = tmp_path_factory.mktemp("review") / "night"
    eventful_night.write(folder, FRAMES, pictures=range(100, 104)).close()
    return folder


def opened(folder: Path) -> MomentReader:
    reader = SessionReader(folder)
    return MomentReader(reader, reader.read_meta(), reader.config())


@pytest.fixture(scope="module")
def read(eventful: Path) -> MomentReader:
    moments = opened(eventful)
    assert moments.read_for(60.0)
    return moments


def folded(folder: Path, seqs: Collection[int]) -> dict[int, tuple[NightView, NightFrame]]:
    """What one fold of the log from its beginning, as the live seat's, has at these places."""
    reader = SessionReader(folder)
    night = Night(folder, reader.read_meta(), reader.config())
    night.mark_past_read()
    seen = {}
    for at, t_utc_ns, record in reader.records():
        night.fold_record(t_utc_ns, record, at)
        if at in seqs:
            view = night.view()
            number = view.frame.frame_id if view.frame is not None else 0
            seen[at] = (view, night.frame(number))
    return seen


# -- moments ------------------------------------------------------------------------------------


def test_any_moment_is_the_fold_of_the_log_up_to_it(eventful: Path, read: MomentReader):
    kinds = {type(record) for _, _, record in SessionReader(eventful).records()}
    assert {Ruling, FollowedAgain} <= kinds  # what changes earlier rows is in the log
    last = read.timeline().last_seq
    chosen = random.Random(3).sample(range(1, last + 1), 40)
    order = [*chosen, 1, last, 1, *sorted(chosen)[-5:]]
    expected = folded(eventful, set(order))
    for seq in order:
        moment = read.at(seq)
        assert (moment.view, moment.detail) == expected[seq]
        assert moment.seq == moment.view.seq == seq


def test_a_ruling_changes_an_earlier_frame_only_from_its_own_moment_on(
    eventful: Path, read: MomentReader
):
    ruled_at = next(
        (seq, record.frame_id)
        for seq, _, record in SessionReader(eventful).records(kinds=(Ruling,))
    )
    seq, frame_id = ruled_at

    def row(at: int):
        return next(row for row in read.at(at).view.rows if row.frame_id == frame_id)

    end = read.timeline().frame_end_seq(read.timeline().frame_index(seq))
    assert row(seq - 1).is_followed
    assert row(seq - 1).miss is None
    assert not row(end).is_followed
    assert row(end).miss == "nothing fits the prediction"
    assert row(seq - 1).is_followed  # and going back takes it back


def test_a_moment_is_what_a_live_seat_showed_when_the_log_had_come_so_far(tmp_path: Path):
    folder = tmp_path / "live"
    writer = made_up_night.begin(folder)
    made_up_night.armed(writer)
    seen: dict[int, tuple[NightView, object]] = {}
    watch = SessionWatch(lambda night, picture: seen.__setitem__(night.seq, (night, picture)))
    watch.follow(folder)
    for n in range(1, 31):
        eventful_night.go_on(writer, range(n, n + 1))
        if n % 10 == 0:
            made_up_night.add_previews(writer, range(n, n + 1))
            assert writer.flush()
        watch._look()  # as its thread does four times a second
    writer.close()
    moments = opened(folder)
    assert moments.read_for(60.0)
    for seq, (live, picture) in seen.items():
        if seq == 0 or not live.is_read:
            continue
        moment = moments.at(seq)
        assert moment.view == replace(live, is_closed=True)
        frame = live.frame
        if picture is not None and frame is not None and picture.frame_id == frame.frame_id:
            assert moment.picture is not None
            assert moment.picture.detail == picture.detail
            assert moment.picture.marks == picture.marks
            assert (moment.picture.codes == picture.codes).all()
    assert len(seen) > 30


def test_a_jump_before_the_log_is_read_looks_for_no_frames_pixels(
    eventful: Path, monkeypatch: pytest.MonkeyPatch
):
    """A folder of thousands of frames on a card or a share takes its time."""
    moments = opened(eventful)
    seq = moments.timeline().frame_end_seq(200)
    monkeypatch.setattr(SessionReader, "frames_with_pixels", lambda _: pytest.fail("it looked"))
    assert not moments.at(seq).is_whole


def test_what_has_not_been_read_yet_is_shown_from_near_before_and_said_to_be_so(eventful: Path):
    moments = opened(eventful)
    timeline = moments.timeline()
    assert len(timeline.frames) == FRAMES  # before a single record has been folded
    assert timeline.read_seq == 0
    seq = timeline.frame_end_seq(200)
    partly = moments.at(seq)
    assert not partly.is_whole
    assert moments.read_for(60.0)
    whole = moments.at(seq)
    assert whole.is_whole
    assert partly.view.frame == whole.view.frame
    assert partly.view.state == whole.view.state
    assert partly.view.tau == whole.view.tau
    assert partly.view.changed == whole.view.changed
    assert partly.detail == whole.detail
    near = {row.frame_id: row for row in partly.view.rows}
    assert len(near) <= moments_module.FRAMES_BEFORE + 2
    # A frame just before the first one may have been ruled on; all others are as they were.
    assert all(near[row.frame_id] == row for row in whole.view.rows[-55:])
    assert {line.seq for line in partly.view.log} <= {line.seq for line in whole.view.log}


def test_a_frame_without_a_picture_gets_no_other_frames_picture(read: MomentReader):
    timeline = read.timeline()
    assert read.at(timeline.frame_end_seq(101 - 1)).picture is not None
    assert read.at(timeline.frame_end_seq(101 - 1)).picture.frame_id == 101
    assert read.at(timeline.frame_end_seq(104 - 1)).picture is None


def test_a_log_that_grows_is_read_on_and_its_moments_with_it(tmp_path: Path):
    folder = tmp_path / "live"
    writer = eventful_night.write(folder, 60)
    moments = opened(folder)
    assert moments.read_for(60.0)
    before = moments.timeline()
    early = moments.at(before.frame_end_seq(20)).view
    eventful_night.go_on(writer, range(61, 121))
    assert moments.read_for(60.0)
    after = moments.timeline()
    writer.close()
    whole = opened(folder)
    whole.read_for(60.0)
    expected = whole.timeline()
    assert (len(before.frames), len(after.frames)) == (60, 120)
    assert after.frames == expected.frames
    assert after.states == expected.states
    missed = [h for h in expected.events if h.kind == "miss"]
    assert [h for h in after.events if h.kind == "miss"] == missed
    assert moments.at(after.frame_end_seq(20)).view == early
    seq = after.frame_end_seq(100)
    assert replace(moments.at(seq).view, is_closed=True) == folded(folder, {seq})[seq][0]


def test_a_damaged_record_is_an_alarm_in_its_place_and_the_rest_is_there(tmp_path: Path):
    folder = tmp_path / "night"
    eventful_night.write(folder, 30).close()
    with closing(sqlite3.connect(folder / "session.db")) as database:
        taken = database.execute(
            "SELECT seq FROM log WHERE kind = 'Detections' AND frame_id = 15"
        ).fetchone()[0]
        database.execute("UPDATE log SET body = '{}' WHERE seq = ?", (taken,))
        database.commit()
    moments = opened(folder)
    assert moments.read_for(60.0)
    timeline = moments.timeline()
    assert len(timeline.frames) == 30
    line = next(line for line in moments.log() if line.level == "alarm")
    assert line.seq == taken
    assert "damaged" in line.text
    assert moments.at(timeline.frame_end_seq(29)).view.frame.frame_id == 30


# -- the time line ------------------------------------------------------------------------------


def frames_at(*times_s: float) -> tuple[FrameStart, ...]:
    """Frames of ten records each, at these seconds."""
    return tuple(FrameStart(10 * n, round(t * NS) + NS, n) for n, t in enumerate(times_s, start=1))


THREE = Timeline(
    frames=frames_at(0, 30, 60),
    events=(
        TimelineEvent(15, NS, "miss"),
        TimelineEvent(25, NS, "note"),
        TimelineEvent(36, NS, "miss"),
    ),
    states=(StateStart(2, NS, "SEARCH"), StateStart(20, 31 * NS, "TRACK")),
    first_utc_ns=NS,
    last_utc_ns=91 * NS,
    last_seq=40,
    read_seq=40,
)


def test_a_step_goes_from_frames_end_to_frames_end():
    assert [THREE.frame_end_seq(index) for index in range(3)] == [19, 29, 40]
    assert THREE.step(3, 1) == 19  # before the first frame
    assert THREE.step(19, 1) == 29
    assert THREE.step(25, 1) == 29  # from within a frame: its own end first
    assert THREE.step(25, -1) == 19
    assert THREE.step(40, 1) == 40
    assert THREE.step(19, -1) == 19
    assert THREE.step(19, 100) == 40
    assert Timeline().step(0, 1) is None


def test_a_jump_goes_to_where_the_event_is_seen_and_never_stays():
    kinds = ("miss", "note")
    miss = THREE.next_event(0, kinds, is_on=True)
    assert THREE.moment_seq(miss) == 19  # a miss: with all that its frame led to
    note = THREE.next_event(19, kinds, is_on=True)
    assert THREE.moment_seq(note) == 25  # a note: when it was made
    assert THREE.moment_seq(THREE.next_event(25, kinds, is_on=True)) == 40
    assert THREE.next_event(40, kinds, is_on=True) is None
    assert THREE.moment_seq(THREE.next_event(40, kinds, is_on=False)) == 25
    assert THREE.moment_seq(THREE.next_event(40, ("miss",), is_on=False)) == 19
    assert THREE.next_event(19, kinds, is_on=False) is None


@given(st.integers(0, 45), st.integers(-5, 5))
def test_steps_stay_among_the_frames_and_go_the_way_they_are_meant(seq: int, by: int):
    there = THREE.step(seq, by)
    assert there in {19, 29, 40}
    if by > 0 and there is not None:
        assert there > seq or there == 40
    if by < 0 and there is not None:
        assert there < seq or there == 19


def test_every_kind_of_event_of_a_night_is_on_its_time_line(read: MomentReader):
    events = read.timeline().events
    count = {kind: sum(h.kind == kind for h in events) for kind in SIGNS}
    refused = [n for n in range(1, FRAMES + 1) if n % eventful_night.REFUSALS == 0]
    assert count["rejection"] == len(refused)
    by_hand = FRAMES // eventful_night.RULINGS
    assert count["miss"] == len(eventful_night.missed_in(range(1, FRAMES + 1))) + by_hand
    assert count["loss"] == FRAMES // eventful_night.LOSSES
    assert count["note"] == FRAMES // eventful_night.NOTES
    assert count["operator"] == FRAMES // eventful_night.CHANGES + by_hand
    assert list(events) == sorted(events)


def test_the_time_line_shows_states_as_words_events_as_signs_and_where_one_is():
    place = TimelineMarks(seq=40, words=("frame 2 of 3", "paused"))
    ticks, strip, words = [
        "".join(t for t, _ in line) for line in timeline_lines(THREE, place, 66, 3)
    ]
    assert "SEARCH" in strip
    assert "TRACK" in strip
    assert strip.count("┃") == 1
    kept = timeline_lines(THREE, replace(place, kept_seq=29), 66, 3)[1]
    assert "A" in "".join(t for t, _ in kept).replace("SEARCH", "").replace("TRACK", "")
    assert strip.startswith(" 00:00 ")
    assert strip.rstrip().endswith("00:01Z")
    assert "○" in ticks or "✎" in ticks
    assert words == " frame 2 of 3 · paused"
    assert all(len(line) <= 66 for line in (ticks, strip, words))


@given(st.integers(1, 220), st.integers(1, 3), st.integers(0, 45))
@settings(max_examples=60)
def test_the_time_line_fits_any_width_and_always_says_where_one_is(width: int, rows: int, seq: int):
    place = TimelineMarks(seq=seq, words=("frame 2 of 3", "00:00:31Z", "paused ×30"))
    lines = ["".join(t for t, _ in line) for line in timeline_lines(THREE, place, width, rows)]
    assert len(lines) == rows
    assert all(len(line) <= width for line in lines)
    if width >= 40:
        assert "frame 2 of 3" in "\n".join(lines)
        assert "┃" in "\n".join(lines)


def test_no_two_signs_of_the_time_line_are_the_same_not_even_in_ascii():
    from rsoconsole.console.drawing.plain import to_ascii

    assert len({to_ascii(sign) for sign in SIGNS.values()}) == len(SIGNS)
    lasting = {
        to_ascii(fill)
        for state, (fill, _) in FILLS.items()
        if state in {"TRACK", "COAST", "SEARCH", "ACQUIRE", "MANUAL"}
    }
    assert len(lasting) == 5


@given(st.integers(1, 200), st.floats(0, 1))
def test_a_click_on_a_cell_goes_to_a_time_within_it(columns: int, share: float):
    column = min(int(share * columns), columns - 1)
    t = cell_end_utc_ns(THREE, column, columns)
    assert t is not None
    cell = (t - NS) / (90 * NS) * columns
    assert column <= cell <= column + 1.001


# -- moments as they are typed ------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "typed"),
    [
        ("2", 29),
        ("0002", 29),
        ("00:00:31", 29),
        ("0:00", 19),
        ("00:01Z", 29),
        ("1970-01-01T00:01", 29),
    ],
)
def test_a_frame_or_a_time_is_understood(text: str, typed: int):
    assert typed_place_seq(parse_place(text), THREE) == typed


@pytest.mark.parametrize("text", ["", "frame", "25:00", "03:61", "-3", "1.5", "2024-13-01T00:00"])
def test_what_is_neither_is_said_to_be_neither(text: str):
    with pytest.raises(ValueError, match=r"no frame and no UTC time|is no time"):
        parse_place(text)


@pytest.mark.parametrize("text", ["7", "12:00", "2020-01-01T00:00"])
def test_what_the_night_does_not_have_is_refused_with_what_it_has(text: str):
    with pytest.raises(ValueError, match=r"frames are 1 to 3|goes from 00:00:01Z to 00:01:31Z"):
        typed_place_seq(parse_place(text), THREE)


def test_a_night_over_midnight_has_its_times_on_both_days():
    day = 86400 * NS
    late = Timeline(
        frames=(FrameStart(1, 23 * 3600 * NS, 1), FrameStart(5, day + 3 * 3600 * NS, 2)),
        first_utc_ns=23 * 3600 * NS,
        last_utc_ns=day + 4 * 3600 * NS,
        last_seq=9,
    )
    assert typed_place_seq(parse_place("23:30"), late) == 4
    assert typed_place_seq(parse_place("03:30"), late) == 9
    assert parse_place("2024-03-01 03:14") == parse_place("2024-03-01T03:14Z")
    assert isinstance(parse_place("128"), TypedPlace)


# -- playing ------------------------------------------------------------------------------------


def test_playing_goes_as_fast_as_it_says_and_stops_at_the_end():
    night = replace(THREE, is_closed=True)
    player = Player()
    player.settle(night)
    assert player.speed == 30.0  # frames each 30 s: about one a second
    player.begin(night, 19)
    assert player.after(night, 19, 0.5) == 19
    assert player.after(night, 19, 0.5) == 29
    assert player.after(night, 29, 1.0) == 40
    assert player.is_playing
    assert player.after(night, 40, 1.0) == 40
    assert not player.is_playing


def test_a_long_time_without_frames_is_not_waited_through():
    gap = Timeline(
        frames=frames_at(0, 30, 60, 7200), first_utc_ns=NS, last_utc_ns=7300 * NS, last_seq=50
    )
    player = Player()
    player.settle(gap)
    player.begin(gap, 39)
    assert player.after(gap, 39, 0.1) == 50


def test_a_night_that_goes_on_is_waited_for():
    player = Player()
    player.begin(THREE, 40)
    assert player.after(THREE, 40, 1.0) == 40
    assert player.is_playing


def test_speeds_go_from_half_to_a_thousand_and_no_further():
    player = Player()
    for _ in range(50):
        player.change(1)
    assert player.speed == SPEEDS[-1] == 1000.0
    for _ in range(50):
        player.change(-1)
    assert player.speed == SPEEDS[0] == 0.5


def test_a_session_without_frames_has_a_time_line_all_the_same(tmp_path: Path):
    writer = made_up_night.begin(tmp_path / "night")
    made_up_night.armed(writer)
    writer.close()
    moments = opened(tmp_path / "night")
    assert moments.read_for(10.0)
    timeline = moments.timeline()
    assert not timeline.frames
    assert timeline.step(0, 1) is None
    assert moments.at(timeline.last_seq).view.state == "SEARCH"
    assert timeline_lines(timeline, TimelineMarks(seq=1), 80, 3)
