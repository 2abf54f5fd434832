"""What a review does: every command by its effect, on nights whole, growing and damaged."""

import contextlib
import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest
from textual.pilot import Pilot

from rsoconsole.console.commands.command import BOTH
from rsoconsole.console.commands.commands import commands_in
from rsoconsole.console.dialogs.candidates import CandidatesDialog
from rsoconsole.console.dialogs.help import HelpDialog, help_text
from rsoconsole.console.dialogs.session_list import SessionListDialog
from rsoconsole.console.panes.frame_pane import FramePane
from rsoconsole.console.panes.panes import LinesPane, MomentField
from rsoconsole.console.screens._compare import CompareDialog
from rsoconsole.console.screens._review_log import ReviewLogPane
from rsoconsole.console.screens.review import ReviewScreen
from rsoconsole.console.timeline.lines import strip_columns
from rsoconsole.console.tuning.tuning_pane import TunePane
from tests.nights import eventful_night, made_up_night
from tests.rigs.review_rig import frame_shown, is_there, play_review, press
from tests.rigs.seat_rig import FULL, FakeWire, play, until

FRAMES = 110
LARGE = (120, 40)


@pytest.fixture(scope="module")
def eventful(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A night in which much comes to pass, closed."""
    folder = tmp_path_factory.mktemp("review") / "night"
    eventful_night.write(folder, FRAMES, pictures=range(50, 53)).close()
    return folder


@pytest.fixture(autouse=True)
def _impatient(impatient_seat: None) -> None:
    """A pilot that does not sleep."""


def text_of(review: ReviewScreen, name: str) -> str:
    return review.query_one(f"#{name}", LinesPane).text


# -- through time -------------------------------------------------------------------------------

MOVES: list[tuple[list[str], int]] = [
    (["full_stop"], 51),
    (["comma"], 49),
    (["right"], 60),
    (["left"], 40),
    (["pagedown"], FRAMES),
    (["pageup"], 1),
    (["home"], 1),
    (["end"], FRAMES),
    (["home", "comma"], 1),
    (["end", "full_stop"], FRAMES),
    (["g", *"72", "enter"], 72),
    (["colon", *"03:00", "enter"], 93),
    (["g", *"nonsense", "enter"], 50),
    (["g", *"999", "enter"], 50),
    (["g", "escape"], 50),
]


def test_keys_go_to_another_frame_from_the_fiftieth(eventful: Path):
    async def scene(review: ReviewScreen, pilot: Pilot[str]) -> None:
        for keys, frame_id in MOVES:
            review.go_to_text("50")
            await until(pilot, lambda: is_there(review, 50))
            await press(review, pilot, *keys)
            assert frame_shown(review) == frame_id, keys
            assert f"frame {frame_id} of {FRAMES}" in text_of(review, "timeline")
            title, _ = review.picture_words(review.picture, "field", None)
            assert title[0] == f"frame {frame_id:04d}"

    play_review(eventful, scene)


JUMPS: dict[str, list[int]] = {
    "any": [51, 68, 73, 80, 85, 90, 102],
    "miss": [51, 68, 80, 85, 102],
    "rejection": [51, 102],
    "operator": [80, 90],
    "note": [73],
}
"""After frame 50: at 80 the operator has rejected what was measured in 78, which is a miss now."""


def test_a_jump_goes_from_event_to_event_of_the_chosen_kind_and_back(eventful: Path):
    async def scene(review: ReviewScreen, pilot: Pilot[str]) -> None:
        for kind, frames in JUMPS.items():
            while review.kind != kind:
                await pilot.press("E")
            review.go_to_text("50")
            places, seen = [], []
            while True:
                before = review.seq
                await press(review, pilot, "greater_than_sign")
                if review.seq == before:
                    break
                places.append(review.seq)
                seen.append(frame_shown(review))
            assert "no later" in text_of(review, "keys")
            assert list(dict.fromkeys(seen)) == frames
            for seq in places[-2::-1]:
                await press(review, pilot, "less_than_sign")
                assert review.seq == seq

    play_review(eventful, scene, LARGE, start="50")


def test_an_event_is_named_where_it_is_gone_to(eventful: Path):
    async def scene(review: ReviewScreen, pilot: Pilot[str]) -> None:
        await press(review, pilot, "greater_than_sign")
        assert frame_shown(review) == 51
        assert "miss, rejection" in text_of(review, "keys")
        assert review.night.rows[-1].miss is not None
        assert review.night.log[-1].text.startswith("not taken: NIS 31")

    play_review(eventful, scene, LARGE, start="50")


def test_a_moment_shows_nothing_of_what_came_later(eventful: Path):
    async def scene(review: ReviewScreen, pilot: Pilot[str]) -> None:
        night = review.night
        assert len(night.rows) == 50
        assert night.log
        assert all(line.t_utc_ns <= made_up_night.t_of(51) for line in night.log)
        assert night.state == "TRACK"
        assert night.tau == 0.1
        await press(review, pilot, "g", *"95", "enter")
        assert review.night.tau == 0.11  # changed in frame 90

    play_review(eventful, scene, LARGE, start="50")


def test_a_moment_is_typed_in_the_last_line_and_the_sky_stays_in_view(eventful: Path):
    async def scene(review: ReviewScreen, pilot: Pilot[str]) -> None:
        field = review.query_one(MomentField)
        assert not field.display
        await pilot.press("g", "5")
        assert field.display
        assert field.region.y == FULL[1] - 1
        assert field.value == "5"
        assert pilot.app.screen is review
        await pilot.press("escape")
        assert not field.display
        await pilot.press("full_stop")  # keys are the review's again
        await until(pilot, lambda: is_there(review, 51))
        await pilot.press("g")
        review.action_tune()  # from the palette, say
        await pilot.pause()
        assert not field.display

    play_review(eventful, scene, start="50")


def test_playing_shows_frame_after_frame_until_it_is_stopped(eventful: Path):
    async def scene(review: ReviewScreen, pilot: Pilot[str]) -> None:
        assert "paused ×30" in text_of(review, "timeline")
        await pilot.press("right_square_bracket", "plus", "right_square_bracket")
        assert review.player.speed == 300.0
        await pilot.press("left_square_bracket")
        assert "×120" in text_of(review, "timeline")
        await pilot.press("space")
        assert "play ×120" in text_of(review, "timeline")
        assert "space Pause" in text_of(review, "keys")
        await until(pilot, lambda: (frame_shown(review) or 0) >= 55)
        await pilot.press("space")
        assert "paused" in text_of(review, "timeline")
        await until(pilot, lambda: is_there(review))
        at = frame_shown(review)
        await pilot.pause(0.4)
        assert frame_shown(review) == at

    play_review(eventful, scene, LARGE, start="50")


def test_playing_ends_with_the_night_and_begins_again_from_its_start(eventful: Path):
    async def scene(review: ReviewScreen, pilot: Pilot[str]) -> None:
        for _ in range(12):
            await pilot.press("plus")
        await pilot.press("space")
        await until(pilot, lambda: not review.player.is_playing)
        await until(pilot, lambda: is_there(review, FRAMES))
        await pilot.press("minus", *["minus"] * 12, "space")
        await until(pilot, lambda: is_there(review, 1))

    play_review(eventful, scene, start="105")


def test_a_step_by_hand_ends_playing(eventful: Path):
    async def scene(review: ReviewScreen, pilot: Pilot[str]) -> None:
        await pilot.press("space")
        assert review.player.is_playing
        await press(review, pilot, "full_stop")
        assert not review.player.is_playing

    play_review(eventful, scene, start="50")


def test_the_mouse_goes_where_it_is_clicked_and_drawn_on_the_time_line(eventful: Path):
    async def scene(review: ReviewScreen, pilot: Pilot[str]) -> None:
        x, columns = strip_columns(LARGE[0])
        await pilot.click("#timeline", offset=(x + columns // 2, 1))
        await until(pilot, lambda: is_there(review))
        assert abs((frame_shown(review) or 0) - FRAMES // 2) <= 2
        await pilot.mouse_down("#timeline", offset=(x, 1))
        await pilot.hover("#timeline", offset=(x + columns - 1, 1))
        await pilot.mouse_up("#timeline", offset=(x + columns - 1, 1))
        await until(pilot, lambda: is_there(review, FRAMES))

    play_review(eventful, scene, LARGE)


def test_beginning_at_a_frame_that_is_not_there_says_so_and_shows_the_first(eventful: Path):
    async def scene(review: ReviewScreen, pilot: Pilot[str]) -> None:
        assert frame_shown(review) == 1
        assert "no frame 500" in text_of(review, "keys")

    play_review(eventful, scene, LARGE, start="500")


# -- two moments --------------------------------------------------------------------------------


def test_two_moments_are_compared_side_by_side_with_what_lies_between(eventful: Path):
    async def scene(review: ReviewScreen, pilot: Pilot[str]) -> None:
        await pilot.press("K")
        assert "A frame 50" in text_of(review, "timeline")
        await press(review, pilot, "g", *"95", "enter")
        await pilot.press("K")
        await pilot.pause()
        assert isinstance(pilot.app.screen, CompareDialog)
        text = pilot.app.screen.query_one("#compared", LinesPane).text
        rows = {line[:12].strip(): line[12:] for line in text.splitlines()}
        assert rows["frame"].split() == ["0050", "0095", "+45"]
        assert rows["τ"].split() == [".10", ".11"]
        assert "+22m" in rows["time"]
        assert (
            rows["residual α"].split()[0] == f"{review.kept.view.rows[-1].residual_arcsec[0]:+.2f}″"
        )
        assert "45 frames · ○ 4 misses · × 1 rejection" in text
        assert "detector.tau: 0.1 → 0.11" in text
        await pilot.press("escape")
        assert pilot.app.screen is review

    play_review(eventful, scene, LARGE, start="50")


def test_what_is_asked_for_before_the_moment_is_there_is_compared_once_it_is(eventful: Path):
    async def scene(review: ReviewScreen, pilot: Pilot[str]) -> None:
        await pilot.press("K")
        kept = review.kept
        review.go(review.timeline.step(review.seq, 1))
        review.action_compare()
        assert not isinstance(pilot.app.screen, CompareDialog)
        await until(pilot, lambda: isinstance(pilot.app.screen, CompareDialog))
        assert review.kept is kept
        assert review.moment.seq == review.seq

    play_review(eventful, scene, LARGE, start="50")


def test_b_blinks_the_whole_screen_between_the_two(eventful: Path):
    async def scene(review: ReviewScreen, pilot: Pilot[str]) -> None:
        await pilot.press("B")
        assert "keeps a moment" in text_of(review, "keys")
        await pilot.press("K")
        await press(review, pilot, "g", *"95", "enter")
        for frame_id in (50, 95, 50, 95):
            await press(review, pilot, "B")
            assert frame_shown(review) == frame_id
        await pilot.press("K")
        await pilot.pause()
        await press(review, pilot, "B")  # from the table too
        assert pilot.app.screen is review
        assert frame_shown(review) == 50
        await pilot.press("U")
        assert review.kept is None
        assert " A frame" not in text_of(review, "timeline")

    play_review(eventful, scene, LARGE, start="50")


def test_k_in_the_table_keeps_this_moment_as_the_new_a(eventful: Path):
    async def scene(review: ReviewScreen, pilot: Pilot[str]) -> None:
        await pilot.press("K", "K")
        assert "this is A" in text_of(review, "keys")
        await press(review, pilot, "right")
        await pilot.press("K")
        await pilot.pause()
        await pilot.press("K")
        await pilot.pause()
        assert review.kept.view.frame.frame_id == 60

    play_review(eventful, scene, LARGE, start="50")


def test_the_hint_of_the_tuning_pane_names_the_key_that_changes_its_frames(eventful: Path):
    async def scene(review: ReviewScreen, pilot: Pilot[str]) -> None:
        await pilot.press("t")
        pane = text_of(review, "tune")
        assert "A all frames" in pane
        await pilot.press("A")
        assert "A the last frames" in text_of(review, "tune")

    play_review(eventful, scene, LARGE, start="50")


# -- the log ------------------------------------------------------------------------------------


def test_the_open_log_is_that_of_the_whole_night_and_enter_goes_to_a_line(eventful: Path):
    async def scene(review: ReviewScreen, pilot: Pilot[str]) -> None:
        pane = review.query_one("#log", ReviewLogPane)
        assert all(line.seq <= review.seq for line in pane.lines)
        await pilot.press("l")
        assert "enter Go there" in text_of(review, "keys")
        assert any(line.seq > review.seq for line in pane.lines)
        assert pane.chosen.seq <= review.seq  # the last that had been said by then
        above = [line for line in pane.found if line.seq > pane.chosen.seq][-1]
        await pilot.press("up")
        assert pane.chosen == above
        await press(review, pilot, "enter")
        assert not review.is_log_open
        assert review.night.log[-1].seq >= above.seq
        assert above.frame_id in {None, frame_shown(review)}

    play_review(eventful, scene, LARGE, start="50")


def test_a_search_finds_lines_of_all_the_night_and_jumps_among_them(eventful: Path):
    async def scene(review: ReviewScreen, pilot: Pilot[str]) -> None:
        await pilot.press("slash", *"clouds", "enter")
        await pilot.pause()
        pane = review.query_one("#log", ReviewLogPane)
        assert [line.text for line in pane.found] == ["NOTE: clouds in the west, frame 73"]
        await press(review, pilot, "enter")
        assert frame_shown(review) == 73
        assert review.night.log[-1].text.endswith("frame 73")  # just when it was said
        await pilot.press("slash", *["backspace"] * 6, *"reject", "enter", "escape")
        assert "'reject'" in text_of(review, "timeline")
        await press(review, pilot, "home", "greater_than_sign")
        assert "reject" in review.night.log[-1].text
        first = review.seq
        await press(review, pilot, "greater_than_sign")
        assert review.seq > first
        await pilot.press("slash", *["backspace"] * 6, "enter", "escape")
        assert review.kind == "any"

    play_review(eventful, scene, LARGE, start="50")


# -- the seat's other keys ----------------------------------------------------------------------


def test_every_command_of_a_review_has_an_action_words_and_a_place_in_help_and_palette(
    eventful: Path,
):
    async def scene(review: ReviewScreen, pilot: Pilot[str]) -> None:
        app = pilot.app
        titles = {command.title for command in app.get_system_commands(review)}
        text = help_text(place="review")
        for command in commands_in("review"):
            owner = app if command.is_everywhere else review
            assert callable(getattr(owner, f"action_{command.name}")), command.name
            assert command.title in text
            if command.name not in {"stop_by_letter", "put_away"} and not command.acts:
                assert command.title in titles
        assert "Arm or disarm" not in text
        assert "Arm or disarm" not in titles
        bound = {binding.id for _, binding in review._bindings if binding.id}
        bound |= {binding.id for _, binding in app._bindings if binding.id}
        assert bound == {command.name for command in commands_in("review")}

    play_review(eventful, scene)


@pytest.mark.parametrize("place", BOTH)
def test_no_key_does_two_things_on_one_screen(place):
    keys = [key for command in commands_in(place) for key in command.keys.split(",")]
    assert len(keys) == len(set(keys))


def test_help_verdicts_zoom_stretch_and_the_frame_work_as_in_the_seat(eventful: Path):
    async def scene(review: ReviewScreen, pilot: Pilot[str]) -> None:
        await pilot.press("f1")
        await pilot.pause()
        assert isinstance(pilot.app.screen, HelpDialog)
        await pilot.press("escape", "v")
        await pilot.pause()
        assert isinstance(pilot.app.screen, CandidatesDialog)
        await pilot.press("escape", "z")
        assert "picture: close-up" in text_of(review, "keys")
        await pilot.press("f")
        assert "stretch: asinh" in text_of(review, "keys")

    play_review(eventful, scene, LARGE, start="50")


def test_tuning_computes_up_to_the_moment_and_applies_nothing(eventful: Path):
    async def scene(review: ReviewScreen, pilot: Pilot[str]) -> None:
        await pilot.press("t", "right")
        await until(pilot, lambda: review.tune.figures[1] is not None)
        pane = text_of(review, "tune")
        assert "frames to here" in pane
        assert "apply" not in pane
        assert review.tune.figures[0].frames == 40
        await pilot.press("enter")
        assert "nothing is changed here" in text_of(review, "keys")
        await pilot.press("A")
        await until(pilot, lambda: review.tune.figures[0].frames == 50)
        assert "all frames so far" in text_of(review, "tune")
        await pilot.press("escape")
        assert not review.query_one("#tune", TunePane).display

    play_review(eventful, scene, LARGE, start="50")


def test_leaving_a_review_that_was_opened_alone_ends_the_console(eventful: Path):
    async def scene(review: ReviewScreen, pilot: Pilot[str]) -> None:
        await pilot.press("q")

    assert play_review(eventful, scene) == "quit"


# -- nights of all kinds ------------------------------------------------------------------------


def test_a_night_that_goes_on_grows_and_end_follows_it(tmp_path: Path):
    writer = eventful_night.write(tmp_path / "night", 20)

    async def scene(review: ReviewScreen, pilot: Pilot[str]) -> None:
        assert frame_shown(review) == 1
        eventful_night.go_on(writer, range(21, 24))
        await until(pilot, lambda: "of 23" in text_of(review, "timeline"))
        assert frame_shown(review) == 1
        await press(review, pilot, "end")
        assert "follows the live night" in text_of(review, "timeline")
        eventful_night.go_on(writer, range(24, 26))
        await until(pilot, lambda: is_there(review, 25))
        await press(review, pilot, "comma")
        assert "follows" not in text_of(review, "timeline")

    play_review(tmp_path / "night", scene, LARGE)
    writer.close()


def test_one_frame_is_a_night_too(tmp_path: Path):
    eventful_night.write(tmp_path / "night", 1, pictures=range(1, 2)).close()

    async def scene(review: ReviewScreen, pilot: Pilot[str]) -> None:
        for key in ("full_stop", "comma", "home", "end", "greater_than_sign", "space", "right"):
            await press(review, pilot, key)
            assert frame_shown(review) == 1
        assert "frame 1 of 1" in text_of(review, "timeline")
        assert review.picture is not None

    play_review(tmp_path / "night", scene)


def test_a_session_without_frames_says_so_and_every_key_is_harmless(tmp_path: Path):
    writer = made_up_night.begin(tmp_path / "night")
    made_up_night.armed(writer)
    writer.close()

    async def scene(review: ReviewScreen, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: review.night.state == "SEARCH")
        assert "no frames" in text_of(review, "timeline")
        for command in commands_in("review"):
            if command.is_everywhere or command.name in {"leave", "sessions"} or command.acts:
                continue
            getattr(review, f"action_{command.name}")()
            await pilot.pause()
            while pilot.app.screen is not review:
                await pilot.press("escape")
                await pilot.pause()
        assert review.night.state == "SEARCH"

    play_review(tmp_path / "night", scene, is_read=False)


def test_a_night_without_pictures_says_that_none_was_kept(tmp_path: Path):
    eventful_night.write(tmp_path / "night", 5).close()

    async def scene(review: ReviewScreen, pilot: Pilot[str]) -> None:
        assert review.query_one("#frame", FramePane).absent == "no picture of it was kept"
        assert review.picture is None

    play_review(tmp_path / "night", scene)


def test_a_database_that_breaks_while_it_is_shown_is_said_and_heals(tmp_path: Path):
    folder = tmp_path / "night"
    eventful_night.write(folder, 20).close()
    with closing(sqlite3.connect(folder / "session.db")) as database:
        database.execute("UPDATE meta SET value = 'false' WHERE key = 'is_closed'")
        database.commit()

    async def scene(review: ReviewScreen, pilot: Pilot[str]) -> None:
        whole = (folder / "session.db").read_bytes()
        (folder / "session.db").write_bytes(b"no database at all" * 100)
        await until(
            pilot, lambda: "damaged" in review.alert_words or "no session" in review.alert_words
        )
        assert frame_shown(review) == 1  # what was shown stays
        (folder / "session.db").write_bytes(whole)
        await until(pilot, lambda: not review.alert_words)

    play_review(folder, scene, LARGE)


# -- over a live seat ---------------------------------------------------------------------------


def reviewed(app) -> ReviewScreen:
    screen = app.screen
    assert isinstance(screen, ReviewScreen)
    return screen


def test_from_a_live_seat_the_past_is_opened_and_leaving_comes_back_to_the_present(
    wire: FakeWire, writer
):
    async def scene(app, pilot: Pilot[str]) -> None:
        await pilot.press("r")
        await pilot.pause()
        assert isinstance(app.screen, SessionListDialog)
        await until(pilot, lambda: bool(app.screen.matching_rows))
        await pilot.press("enter")
        await pilot.pause()
        review = reviewed(app)
        await until(pilot, lambda: review.timeline.is_whole and is_there(review))
        assert review.is_at_head  # the present night is opened at its head
        assert "q Live" in text_of(review, "keys")
        assert "live: TRACK" in text_of(review, "top")
        await press(review, pilot, "home")
        assert frame_shown(review) == 1
        made_up_night.add_frames(writer, range(21, 23))
        await until(pilot, lambda: len(app.live.night.rows) == 22)  # the seat behind goes on
        assert frame_shown(review) == 1
        await pilot.press("q")
        await pilot.pause()
        assert app.screen is app.live
        assert app.live.night.rows[-1].frame_id == 22
        assert wire.verbs == []

    play(wire, scene, LARGE)


def test_stop_works_over_a_review_and_shows_the_live_seat(wire: FakeWire):
    async def scene(app, pilot: Pilot[str]) -> None:
        for key in ("x", "ctrl+x"):
            app.live.open_session(app.live.night.folder)
            await pilot.pause()
            await pilot.press(key)
            await pilot.pause()
            assert app.screen is app.live
            await until(pilot, lambda: app.live.stop_news is not None)
        await until(pilot, lambda: wire.verbs.count("stop") == 2)

    play(wire, scene)


def test_what_the_live_engine_raises_is_seen_over_a_review(wire: FakeWire):
    async def scene(app, pilot: Pilot[str]) -> None:
        app.live.open_session(app.live.night.folder)
        await pilot.pause()
        review = reviewed(app)
        assert review.alert_words == ""
        wire.status["faults"] = ["the disk is full"]
        wire.status["state"] = "LOST"
        await until(pilot, lambda: "LIVE: FAULT the disk is full" in text_of(review, "alert"))
        assert "live: LOST" in text_of(review, "top")
        wire.is_gone = True
        await until(pilot, lambda: "live: ENGINE GONE" in text_of(review, "top"))

    play(wire, scene, LARGE)


@pytest.mark.slow("presses every key")
def test_no_key_of_a_review_reaches_the_engine(wire: FakeWire):
    async def scene(app, pilot: Pilot[str]) -> None:
        app.live.open_session(app.live.night.folder)
        await pilot.pause()
        review = reviewed(app)
        await until(pilot, lambda: is_there(review))
        acting = [c for c in commands_in("live") if c.acts]
        for key in dict.fromkeys(key for c in acting for key in c.keys.split(",")):
            await pilot.press(key, "y", "enter")
            await pilot.pause()
            while app.screen is not review:
                await pilot.press("escape")
                await pilot.pause()
        await pilot.pause(0.1)
        assert wire.verbs == []

    play(wire, scene)


def test_a_terminal_that_was_resized_under_a_review_fits_the_live_seat_again(wire: FakeWire):
    async def scene(app, pilot: Pilot[str]) -> None:
        app.live.open_session(app.live.night.folder)
        await pilot.pause()
        await pilot.resize_terminal(80, 24)
        await until(pilot, lambda: is_there(reviewed(app)))
        await pilot.press("q")
        await pilot.pause()
        assert app.live.size == (80, 24)
        assert not app.live.query_one("#closeup").display

    play(wire, scene, LARGE)


def test_stop_of_a_review_alone_goes_to_the_engine_all_the_same(eventful: Path):
    wire = FakeWire(eventful)

    async def scene(review: ReviewScreen, pilot: Pilot[str]) -> None:
        await pilot.press("g", "x")
        assert wire.verbs == []  # a letter, where one types
        await pilot.press("ctrl+x")
        await until(pilot, lambda: "stop" in wire.verbs)
        await until(pilot, lambda: review.stop_news is not None)
        assert pilot.app.screen is review

    play_review(eventful, scene, wire=wire)


# -- sessions -----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Nights of every kind under one root."""
    root = tmp_path_factory.mktemp("sessions")
    for n, name in enumerate(("20240301-ses-10", "20240302-intelsat"), start=1):
        eventful_night.write(root / name, 4 * n).close()
    cut = eventful_night.write(root / "20240303-cut", 3)
    cut.flush()
    with contextlib.closing(sqlite3.connect(root / "20240303-cut" / "session.db")) as database:
        # Its engine is dead, as far as anybody can tell.
        database.execute("DELETE FROM meta WHERE key = 'writer'")
        database.commit()
    branch = root / "20240302-intelsat" / "branches" / "larger-q"
    branch.mkdir(parents=True)
    shutil.copy(root / "20240302-intelsat" / "session.db", branch / "session.db")
    (root / "20240304-damaged").mkdir()
    (root / "20240304-damaged" / "session.db").write_bytes(b"nothing" * 200)
    return root


async def asked(pilot: Pilot[str]) -> SessionListDialog:
    await until(pilot, lambda: isinstance(pilot.app.screen, SessionListDialog))
    dialog = pilot.app.screen
    assert isinstance(dialog, SessionListDialog)
    return dialog


async def listed(review: ReviewScreen, pilot: Pilot[str]) -> SessionListDialog:
    dialog = await asked(pilot)
    await until(
        pilot,
        lambda: bool(dialog.matching_rows) and all(each.state for each in dialog.matching_rows),
    )
    return dialog


def test_without_a_session_the_list_is_asked_and_shows_what_each_is(root: Path):
    async def scene(review: ReviewScreen, pilot: Pilot[str]) -> None:
        dialog = await listed(review, pilot)
        states = {each.name: (each.is_branch, each.state) for each in dialog.matching_rows}
        assert states == {
            "20240301-ses-10": (False, "closed"),
            "20240302-intelsat": (False, "closed"),
            "larger-q": (True, "closed"),
            "20240303-cut": (False, "cut off"),
            "20240304-damaged": (False, "damaged"),
        }
        names = [each.name for each in dialog.matching_rows]
        assert names.index("larger-q") == names.index("20240302-intelsat") + 1
        text = dialog.query_one("#rows", LinesPane).text
        assert "└ larger-q" in text
        await pilot.press(*"ses 10")
        assert [each.name for each in dialog.matching_rows] == ["20240301-ses-10"]
        await pilot.press("enter")
        await until(pilot, lambda: review.timeline.is_whole and is_there(review))
        assert review.folder == root / "20240301-ses-10"
        assert len(review.timeline.frames) == 4

    play_review(None, scene, LARGE, is_read=False, sessions_root=root)


def test_from_a_review_another_session_or_a_branch_is_opened(root: Path):
    async def scene(review: ReviewScreen, pilot: Pilot[str]) -> None:
        await pilot.press("K", "r")
        dialog = await listed(review, pilot)
        assert dialog.matching_rows[dialog._at].folder == review.folder
        await pilot.press(*"larger", "enter")
        await until(pilot, lambda: len(review.timeline.frames) == 8 and is_there(review))
        assert review.folder.name == "larger-q"
        assert review.kept is None  # of another night
        await pilot.press("r")
        await listed(review, pilot)
        await pilot.press("escape")
        assert review.folder.name == "larger-q"

    play_review(root / "20240301-ses-10", scene, LARGE, sessions_root=root)


def test_a_path_may_be_typed_and_what_is_none_rings(root: Path, tmp_path: Path):
    async def scene(review: ReviewScreen, pilot: Pilot[str]) -> None:
        dialog = await asked(pilot)
        rows = dialog.query_one("#rows", LinesPane)
        await until(pilot, lambda: "no session lies in" in rows.text)
        dialog.query_one("#wanted").value = str(tmp_path / "nothing")
        await pilot.press("enter")
        assert pilot.app.screen is dialog
        dialog.query_one("#wanted").value = str(root / "20240301-ses-10")
        await pilot.press("enter")
        await until(pilot, lambda: review.folder == root / "20240301-ses-10")

    play_review(None, scene, is_read=False, sessions_root=tmp_path / "empty")


def test_a_damaged_session_that_is_chosen_says_what_is_wrong(root: Path):
    async def scene(review: ReviewScreen, pilot: Pilot[str]) -> None:
        await listed(review, pilot)
        await pilot.press(*"damaged", "enter")
        await until(pilot, lambda: "damaged" in text_of(review, "alert"))

    play_review(None, scene, LARGE, is_read=False, sessions_root=root)


def test_the_list_goes_by_keys_and_mouse_at_any_size(root: Path):
    async def scene(review: ReviewScreen, pilot: Pilot[str]) -> None:
        dialog = await listed(review, pilot)
        await pilot.press("down", "down", "up")
        assert dialog._at == 1
        await pilot.press("pagedown")
        assert dialog._at == 4
        rows = dialog.query_one("#rows", LinesPane)
        assert all(len(line) <= rows.size.width for line in rows.text.splitlines())
        await pilot.click("#rows", offset=(3, 1))
        assert dialog._at == 0

    for size in ((40, 12), (80, 24)):
        play_review(None, scene, size, is_read=False, sessions_root=root)
