"""Every satellite of the field: the list, its cursor, the plots of one, and who leads."""

from dataclasses import replace
from pathlib import Path

import pytest
from textual.pilot import Pilot

from rsoconsole.console.actions.second_press import REPEAT_S
from rsoconsole.console.app import ConsoleApp
from rsoconsole.console.words.track_lines import _cut_name, track_list_lines
from rsoconsole.night import Night
from rsoconsole.night.current_tracks import MAX_ROWS
from rsoconsole.records import (
    Cause,
    FollowedAgain,
    LedgerName,
    Miss,
    Missed,
    Ruling,
    StateChange,
    TrackLost,
    TrackState,
)
from rsoconsole.session import SessionWriter
from tests.nights import eight_tracks as eight
from tests.nights import made_up_night
from tests.nights.made_up_night import t_of
from tests.rigs.seat_rig import FakeWire, pane, play, until

FRAMES = 12
AT_80_X_24 = (35, 17)
"""Columns and rows that the list has there; at 60 x 20 it has the whole width."""


def words(night: Night, size: tuple[int, int], chosen: int | None = None) -> list[str]:
    lines = track_list_lines(night.view(), chosen, None, *size)
    assert len(lines) <= size[1]
    said = ["".join(text for text, _ in line) for line in lines]
    assert all(len(each) <= size[0] for each in said)
    return said


def numbers(night: Night) -> list[str]:
    return [each.number_text for each in night.view().tracks]


def test_eight_tracks_are_read_in_the_narrowest_column():
    said = words(eight.night_of_eight(), AT_80_X_24)
    assert said[1].split() == ["#", "name", "state", "resid", "NIS"]
    rows = [line[1:].split() for line in said[2:10]]
    assert [row[0] for row in rows] == ["1", "2*", "3", "4", "5", "6", "7", "8"]
    assert all(len(row) >= 5 for row in rows)
    assert rows[0][-3:] == ["TRACK", "0.50″", "1.1"]
    assert "COAST" in rows[2]
    assert "1.50″" in rows[2]  # what it was measured with last
    assert "ASTRA 1KR" in said[2]
    assert rows[5][1] == "-"  # no name in the catalogue
    # The lead is told in full below: what has no column there.
    below = " ".join(said[10:])
    assert "2* ASTRA 1L" in below
    assert "SNR 20" in below
    assert "orbit free" in below


def test_where_there_is_room_brightness_age_and_orbit_have_their_columns():
    said = words(eight.night_of_eight(), (60, 17), chosen=5)
    assert said[1].split() == ["#", "name", "state", "resid", "NIS", "SNR", "age", "orbit"]
    chosen = next(line for line in said if line.startswith("▸"))
    assert chosen.split()[1] == "5"
    assert chosen.rstrip().endswith("prior")
    assert "ASTRA 19.…" in chosen or "ASTRA 19.2E" in chosen
    assert "50" in chosen.split()  # SNR
    assert "ASTRA 19.2E SPARE?" in " ".join(said)  # ambiguous, and in full below


def test_a_cut_name_keeps_the_number_by_which_satellites_of_a_series_differ():
    assert _cut_name("ECHOSTAR 16 (USA)", 8) == "ECHOSTA…"
    assert [_cut_name(f"ECHOSTAR {n}", 8) for n in (15, 16)] == ["ECHOS…15", "ECHOS…16"]


def test_a_list_longer_than_its_place_keeps_the_chosen_one_in_sight():
    for chosen in range(1, eight.COUNT + 1):
        said = words(eight.night_of_eight(), (40, 6), chosen)
        assert any(line.startswith("▸") and f" {chosen}" in line for line in said)


@pytest.mark.parametrize("lead", [True, False])
def test_one_that_is_re_acquired_leaves_the_list_with_that_frame(lead: bool):
    """Under its new number it stands there once, not beside what it was."""
    old = 2 if lead else 8
    night = Night(Path("again"), {}, None)
    for n in (1, 2, 3):
        for record in eight.story(n, since=1, lead=2, missed=(old,) if n == 3 else ()):
            night.fold_record(t_of(n), record)
            if isinstance(record, Miss):  # its streak was another's before: a new track takes it
                new = replace(eight.state_of(n, old, "initial", is_lead=lead), replaces=old)
                night.fold_record(t_of(n), replace(new, track_id=9))
    assert len(numbers(night)) == eight.COUNT
    assert f"{old}" not in {each.rstrip("*") for each in numbers(night)}
    assert ("9*" if lead else "9") in numbers(night)
    assert len(night.view().beside) == eight.COUNT - 1


def test_one_that_began_with_this_frame_is_on_trial_until_it_is_measured_once_more():
    night = Night(Path("trial"), {}, None)
    for n in (1, 2):
        for record in eight.story(n, since=1, tracks=(1, 2)):
            night.fold_record(t_of(n), record)
        assert night.view().tracks[0].is_tentative == (n == 1)
        assert not night.view().tracks[1].is_tentative  # the lead is looked for


def test_a_track_ends_with_its_loss_and_the_next_one_leads_where_it_was_the_lead():
    night = eight.night_of_eight(4, missed=())
    records = [*eight.frame(5, missed=(2,))]
    at = next(n for n, r in enumerate(records) if isinstance(r, Miss))
    lost = Missed(kind="no detection", lost=TrackLost(kind="left the field"))
    records[at] = Miss(frame_id=5, reason=lost, track_id=2)
    for record in records:
        night.fold_record(t_of(5), record)
    assert numbers(night) == ["1*", "3", "4", "5", "6", "7", "8"]


def test_one_that_a_frame_does_not_speak_of_any_more_has_ended():
    night = eight.night_of_eight(4, missed=())
    for record in eight.story(5, since=1, tracks=(1, 2, 3)):
        night.fold_record(t_of(5), record)
    assert numbers(night) == ["1", "2*", "3"]


def test_frames_that_are_followed_again_leave_what_they_come_to_and_no_more():
    night = eight.night_of_eight(6, missed=())
    for n in (5, 6):
        night.fold_record(t_of(6), FollowedAgain(frame_id=n))
        for record in eight.frame(n, lead=7, missed=(3,)):
            if type(record).__name__ in {"TrackState", "Miss"}:
                night.fold_record(t_of(6), record)
    view = night.view()
    assert [each.number_text for each in view.tracks if each.is_lead] == ["7*"]
    third = next(each for each in view.tracks if each.track_id == 3)
    assert [row.is_followed for row in third.rows] == [True] * 4 + [False] * 2
    assert [row.frame_id for row in third.rows] == [1, 2, 3, 4, 5, 6]
    assert third.rows[-1].miss


@pytest.mark.parametrize(("after", "is_kept"), [("IDLE", True), ("LOST", False)])
def test_what_ended_by_a_word_comes_back_with_the_word_to_follow_again(after, is_kept):
    night = eight.night_of_eight(4, missed=())
    cause = Cause(kind="disarmed", by="operator")
    night.fold_record(t_of(4), StateChange(frame_id=4, before="TRACK", after=after, reason=cause))
    assert night.view().tracks == ()
    cause = Cause(kind="resumed", by="operator")
    night.fold_record(t_of(4), StateChange(frame_id=4, before=after, after="COAST", reason=cause))
    assert bool(night.view().tracks) == is_kept


def test_a_name_that_a_track_keeps_is_one_line_of_the_log():
    log = eight.night_of_eight().view().log
    said = [each.text for each in log if each.words.startswith(("identified", "ambiguous"))]
    assert said[0].startswith("track 1: identified: ASTRA 1KR")
    assert len(said) == len([name for name in eight.NAMES if name])
    assert len(set(said)) == len(said)


def test_the_rows_of_a_track_are_bounded():
    night = Night(Path("long"), {}, None)
    for n in range(1, MAX_ROWS + 30):
        for record in eight.story(n, since=1, tracks=(1, 2)):
            night.fold_record(t_of(n), record)
    assert [len(each.rows) for each in night.view().tracks] == [MAX_ROWS] * 2


def of_eight(tmp_path: Path) -> SessionWriter:
    writer = made_up_night.begin(tmp_path / "eight")
    eight.write(writer, range(1, FRAMES + 1))
    made_up_night.add_previews(writer, range(FRAMES, FRAMES + 1))
    return writer


@pytest.fixture
def seat_of_eight(tmp_path: Path) -> FakeWire:
    writer = of_eight(tmp_path)
    yield FakeWire(tmp_path / "eight")
    writer.close()


def test_the_list_is_read_chosen_from_and_one_is_made_the_lead(seat_of_eight: FakeWire):
    wire = seat_of_eight

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await pilot.press("6")
        await until(pilot, lambda: "tracks: 8" in pane(app, "tracks"))
        await until(pilot, lambda: "Make it the lead" in pane(app, "keys"))
        await pilot.press("down", "down", "down")
        await until(pilot, lambda: "▸  5" in pane(app, "tracks"))
        assert not wire.sent  # the arrows are the list's, not the mount's
        await pilot.press("enter")
        await until(pilot, lambda: "choose" in wire.verbs)
        x_px, y_px = eight.place_px(5)
        assert wire.sent[-1][1] == {"frame": FRAMES, "x": x_px, "y": y_px}
        # One that coasts is chosen where it was seen last.
        await pilot.press("up", "up", "enter")
        await until(pilot, lambda: wire.verbs.count("choose") == 2)
        assert wire.sent[-1][1]["frame"] == FRAMES - 2
        # Its plots, and which they are.
        await pilot.press("1")
        await until(pilot, lambda: "track 3: RA" in pane(app, "east"))
        assert "track 3: NIS" in pane(app, "nis")
        assert "coasted" in pane(app, "east")
        assert not app.live.query_one("#tracks").display
        await pilot.press("up")  # the mount's again: they ask first
        await until(pilot, lambda: "again within" in pane(app, "keys"))

    play(wire, scene, frames=FRAMES)


def test_the_list_drops_one_by_one_press_and_the_lead_by_two(seat_of_eight: FakeWire):
    wire = seat_of_eight

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await pilot.press("6")
        await until(pilot, lambda: "▸ 2*" in pane(app, "tracks"))
        await until(pilot, lambda: "Drop" in pane(app, "keys"))
        await pilot.press("minus")
        await until(pilot, lambda: "- again within 2 s drops track 2*" in pane(app, "keys"))
        assert not wire.sent
        await pilot.pause(REPEAT_S * 2)
        await pilot.press("minus")
        await until(pilot, lambda: ("drop", {"track": 2}) in wire.sent)
        # Another track ends by one press, and what asks for a second one is asked of one alone.
        await pilot.press("minus", "down", "minus")
        await until(pilot, lambda: ("drop", {"track": 3}) in wire.sent)
        await pilot.press("down", "plus")
        await until(pilot, lambda: ("keep", {"track": 4}) in wire.sent)
        assert len(wire.sent) == 3

    play(wire, scene, frames=FRAMES)


def test_what_is_dropped_leaves_the_list_at_once_and_comes_back_as_it_was(tmp_path: Path):
    writer = of_eight(tmp_path)
    wire = FakeWire(tmp_path / "eight")

    def say(decision: Ruling, **more) -> None:
        writer.append(decision, t_of(FRAMES))
        writer.append(FollowedAgain(frame_id=FRAMES), t_of(FRAMES))
        for record in eight.frame(FRAMES, missed=(3,), **more):
            if isinstance(record, TrackState | Miss):
                writer.append(record, t_of(FRAMES))
        assert writer.flush()

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await pilot.press("6")
        await until(pilot, lambda: "tracks: 8" in pane(app, "tracks"))
        since = {each.track_id: each.since_utc_ns for each in app.live.night.tracks}
        say(Ruling(frame_id=FRAMES, dropped=(2,)), tracks=(1, 3, 4, 5, 6, 7, 8), lead=1)
        await until(pilot, lambda: "tracks: 7 · dropped: 2" in pane(app, "tracks"))
        assert "1*" in pane(app, "tracks")
        await pilot.press("u")
        await until(pilot, lambda: ("drop", {"track": 2, "off": True}) in wire.sent)
        say(Ruling(frame_id=FRAMES))
        await until(pilot, lambda: "tracks: 8" in pane(app, "tracks"))
        night = app.live.night
        assert {each.track_id: each.since_utc_ns for each in night.tracks} == since
        assert [len(each.rows) for each in night.tracks] == [FRAMES] * eight.COUNT
        assert night.dropped == ()

    play(wire, scene, frames=FRAMES)
    writer.close()


def test_what_only_the_ledger_knows_has_its_name_there():
    night = eight.night_of_eight()
    seen_before = LedgerName(
        number=7, name="UCT 7", t_last_utc_ns=t_of(1), probability=0.9, separation_arcsec=5.0
    )
    for sure, said in ((True, " UCT 7 "), (False, " UCT 7?")):
        unknown = replace(eight.name_of(FRAMES, 6, "no such name"), verdict="unknown")
        known = replace(unknown, ledger=replace(seen_before, is_sure=sure))
        night.fold_record(t_of(FRAMES), known)
        assert said in words(night, AT_80_X_24)[7]


def test_a_kept_track_says_so_in_the_list():
    night = eight.night_of_eight()
    for record in eight.frame(FRAMES + 1):
        is_fourth = isinstance(record, TrackState) and record.track_id == 4
        night.fold_record(t_of(FRAMES + 1), replace(record, is_kept=True) if is_fourth else record)
    said = words(night, AT_80_X_24, chosen=4)
    assert "+ kept" in said[0]
    assert "TRACK+" in next(line for line in said if line.startswith("▸"))
    assert "kept: no miss ends it" in " ".join(said[10:])


def test_at_60_x_20_the_list_has_the_width_and_its_columns(seat_of_eight: FakeWire):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await pilot.press("6")
        await until(pilot, lambda: "tracks: 8" in pane(app, "tracks"))
        said = pane(app, "tracks")
        assert all(f" {name[:8]}" in said for name in eight.NAMES if name)
        assert "orbit" in said.splitlines()[1]
        await pilot.press("escape")
        await until(pilot, lambda: not app.live.query_one("#tracks").display)

    play(seat_of_eight, scene, size=(60, 20), frames=FRAMES)


def log_of(night: Night) -> list[str]:
    return [f"{line.text} x{line.times}" for line in night.log]


def test_a_line_of_the_log_says_whose_miss_it_is_where_several_are_followed():
    """Tracks that miss one frame for one reason share its line; the frames are counted."""
    night = Night(Path("log"), {}, None)
    for n in range(1, 6):
        missed = {3: (3,), 4: (3, 5), 5: (5,)}.get(n, ())
        for record in eight.story(n, since=1, missed=missed):
            night.fold_record(t_of(n), record)
    assert log_of(night)[-1] == "tracks 3 5: miss: no detection x3"


def test_one_track_alone_needs_no_number_in_the_log():
    night = Night(Path("log"), {}, None)
    for n in range(1, 4):
        for record in eight.story(n, since=1, tracks=(2,), missed=(2,) if n > 1 else ()):
            night.fold_record(t_of(n), record)
    assert log_of(night)[-1] == "miss: no detection x2"


def test_the_leads_coast_does_not_hide_that_others_were_missed():
    night = Night(Path("log"), {}, None)
    for n in (1, 2):
        for record in eight.frame(n, missed=(2, 4) if n == 2 else ()):
            night.fold_record(t_of(n), record)
    cause = Cause(kind="missed", missed=Missed(kind="no detection"))
    change = StateChange(frame_id=2, before="TRACK", after="COAST", reason=cause)
    night.fold_record(t_of(2), change)
    assert log_of(night) == [
        "tracks 2 4: miss: no detection x1",
        "TRACK → COAST: no detection x1",
    ]


def test_what_ends_one_of_several_tracks_says_which():
    night = Night(Path("log"), {}, None)
    for record in eight.story(1, since=1, tracks=(1, 2)):
        night.fold_record(t_of(1), record)
    lost = Missed(kind="no detection", lost=TrackLost(kind="not confirmed"))
    night.fold_record(t_of(2), Miss(frame_id=2, track_id=1, reason=lost))
    assert night.log[-1].text.startswith("track 1: miss: no detection")
