"""The seat says what is so and which key comes next, in words that need no second look."""

import dataclasses
import re
import threading
from pathlib import Path

import pytest
from textual.pilot import Pilot
from textual.widgets import Button

from rsoconsole.config import Config
from rsoconsole.console.actions import seat
from rsoconsole.console.actions.mark_actions import late_mark_reason
from rsoconsole.console.actions.second_press import WITHIN_S
from rsoconsole.console.app import ConsoleApp
from rsoconsole.console.drawing.plot import Line
from rsoconsole.console.night.engine_view import EngineView, read_engine_view
from rsoconsole.console.panes.last_line import live_keys
from rsoconsole.console.watches.messages import StopNewsCame
from rsoconsole.console.words.facts import figure_lines
from rsoconsole.console.words.leaving import coast_words, kept_words
from rsoconsole.console.words.words import top_lines
from rsoconsole.control import Outcome, StopNews
from rsoconsole.engine.aim.states import Taken
from rsoconsole.night import FollowedTrack, FrameRow, Night, NightView
from rsoconsole.pipeline import Reduction
from rsoconsole.records import Frame
from rsoconsole.words import utc_text
from tests.makers import NS
from tests.nights.made_up_night import state_of, t_of
from tests.rigs.engine_rig import CONFIG, Rig, asked, command_handler_of, rig
from tests.rigs.seat_rig import FRAMES, FakeWire, can_answer, pane, play, stop_text, until
from tests.tiers import plain_first

LARGE = (120, 40)
NOW = t_of(FRAMES) + 7 * NS
STOPPED = {"state": "IDLE", "holder": "nobody", "kept": "INTELSAT 14", "is_resumable": False}
REFUSED = Outcome(
    ok=False,
    message="not armed. weather: it rains",
    data={"checks": [{"name": "weather", "ok": False, "detail": "it rains", "remedy": "wait"}]},
)


def top(engine: EngineView, width: int, *, is_simulated: bool = False) -> str:
    night = NightView(is_simulated=is_simulated)
    return "".join(text for text, _ in top_lines(night, engine, False, width, 1)[0])


def plain(lines: list[Line]) -> list[str]:
    return ["".join(text for text, _ in line) for line in lines]


def tracking(**other: object) -> EngineView:
    told = {"state": "TRACK", "holder": "autonomy", "now_utc_ns": NOW}
    return read_engine_view(told | other)


# -- the first line -------------------------------------------------------------------------------


def test_the_badge_of_a_demo_says_how_fast_it_runs():
    assert top(tracking(simulated_speed=10.0), 80, is_simulated=True).startswith(" DEMO ×10  TRACK")
    wide = top(tracking(simulated_speed=2.5), 120, is_simulated=True)
    assert wide.startswith(" DEMO ×2.5 SIMULATED  TRACK")
    for plain in (0.0, 1.0, None):
        engine = tracking(simulated_speed=plain)
        assert top(engine, 80, is_simulated=True).startswith(" DEMO  TRACK")
    assert "DEMO" not in top(tracking(), 80)


def test_an_engine_says_how_fast_its_simulated_clock_runs():
    r = rig({1})
    r.clock.speed = 10.0
    assert r.engine.status().simulated_speed == 10.0
    r.clock.is_simulated = False
    assert r.engine.status().simulated_speed is None


def test_held_contradicts_nobody_s_having_the_mount():
    held = top(tracking(is_held=True, target="INTELSAT 14"), 100)
    assert "TRACK HELD  AUTO watches, moves nothing  target INTELSAT 14" in held
    assert "has the mount" not in held
    assert "AUTO has the mount" in top(tracking(), 100)


# -- what is kept ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("left_s", "words"),
    [(12 * 60.0, "12 min"), (119.0, "119 s"), (0.4, "0 s"), (-3.0, "0 s")],
)
def test_what_is_kept_says_for_how_long(left_s: float, words: str):
    until = NOW + round(left_s * NS)
    for resumable in (True, False):
        told = STOPPED | {"kept_until_utc_ns": until, "is_resumable": resumable}
        said = kept_words(read_engine_view(told), {}, NOW)
        assert said[0] == f"INTELSAT 14 kept for {words} more: u follows it again"
        assert [len(each) for each in said] == sorted((len(each) for each in said), reverse=True)
    assert kept_words(read_engine_view(STOPPED), {"undo": "f5"}, NOW)[0] == (
        "INTELSAT 14 kept: f5 follows it again"
    )


async def _stopped(app: ConsoleApp, pilot: Pilot[str], wire: FakeWire) -> None:
    """STOP was given long enough ago."""
    wire.status |= STOPPED
    await until(pilot, lambda: app.live.engine.state == "IDLE")
    app.live.telescope.at_rest_since_s -= WITHIN_S


@pytest.mark.parametrize("key", ["u", "h"])
def test_after_a_stop_one_key_arms_and_follows_again(wire: FakeWire, key: str):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await _stopped(app, pilot, wire)
        assert "INTELSAT 14 kept: u follows it again" in pane(app, "top")
        assert ("u", "Follow again") in [each[:2] for each in app.live.keys]
        await pilot.press(key)
        await until(pilot, lambda: wire.verbs == ["arm", "resume"])
        assert not wire.sent[0][1].get("override")

    play(wire, scene, LARGE)


def test_the_operators_turn_shows_both_keys_that_give_it_back():
    engine = tracking(state="MANUAL", holder="operator", kept="INTELSAT 14", is_resumable=True)
    keys = [each[:2] for each in live_keys(engine, can_act=True)]
    assert ("u", "Follow again") in keys
    assert ("h", "Give back") in keys
    stopped = [each.name for each in live_keys(read_engine_view(STOPPED), can_act=True)]
    assert "Give back" not in stopped  # nobody has it


def test_what_the_checklist_refuses_is_followed_only_after_an_override_by_name(wire: FakeWire):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await _stopped(app, pilot, wire)
        wire.outcomes["arm"] = REFUSED
        await pilot.press("u")
        await can_answer(app, pilot)
        assert type(app.screen).__name__ == "ArmDialog"
        await pilot.press("escape")
        await until(pilot, lambda: app.screen is app.live)
        assert wire.verbs == ["arm"]
        await pilot.press("u")
        await can_answer(app, pilot)
        wire.outcomes["arm"] = Outcome(ok=True, message="armed from the next cycle")
        await pilot.press("space")
        app.screen.query_one("#arm", Button).focus()
        await pilot.press("enter")
        await until(pilot, lambda: wire.verbs == ["arm", "arm", "arm", "resume"])
        assert list(wire.sent[2][1]["override"]) == ["weather"]

    play(wire, scene, LARGE)


def test_a_stop_between_leaves_the_track_where_it_is(wire: FakeWire):
    """The arming that was on its way is answered after the STOP: nothing goes behind it."""

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await _stopped(app, pilot, wire)
        wire.hangs["arm"] = threading.Event()
        await pilot.press("u", "u", "u")
        await until(pilot, lambda: wire.verbs == ["arm"])
        await pilot.press("x")
        wire.hangs["arm"].set()
        await until(pilot, lambda: "tracks, measured" in stop_text(app))
        await until(pilot, lambda: not app.live.telescope.is_arming)
        await pilot.press("h")  # it may have meant Hold
        await until(pilot, lambda: "autonomy has just lost the mount" in pane(app, "keys"))
        await pilot.pause(WITHIN_S + 0.2)
        assert wire.verbs == ["arm", "stop"]

    play(wire, scene, LARGE)


async def _stopped_here(app: ConsoleApp, pilot: Pilot[str], wire: FakeWire) -> None:
    """STOP was given by the key, and its banner names the next one."""
    await until(pilot, lambda: app.live.engine.holder == "autonomy")
    wire.status |= STOPPED
    await pilot.press("x")
    await until(pilot, lambda: "u follows it again" in stop_text(app))


def test_a_key_that_the_banner_names_is_carried_out_when_no_other_one_comes_behind(wire: FakeWire):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await _stopped_here(app, pilot, wire)
        began_s = app.live.now_s()
        await pilot.press("u")
        await until(pilot, lambda: "u: follows it again in 2 s" in pane(app, "keys"))
        assert wire.verbs == ["stop"]
        await until(pilot, lambda: wire.verbs == ["stop", "arm", "resume"])
        assert app.live.now_s() - began_s > 0.5 * WITHIN_S

    play(wire, scene, LARGE)


@pytest.mark.parametrize("key", plain_first(1, ["x", "z", "g"]))
def test_stop_or_another_key_behind_it_leaves_the_track_where_it_is(wire: FakeWire, key: str):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await _stopped_here(app, pilot, wire)
        await pilot.press("u", key)
        await pilot.pause(WITHIN_S + 0.3)
        assert wire.verbs == (["stop", "stop"] if key == "x" else ["stop"])

    play(wire, scene, LARGE)


def test_what_is_on_its_way_is_said_in_place_of_the_key(wire: FakeWire):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await _stopped(app, pilot, wire)
        await pilot.press("u")
        await until(pilot, lambda: wire.verbs == ["arm", "resume"])
        assert "INTELSAT 14 is being followed again" in pane(app, "top")
        assert "u follows it" not in pane(app, "top")
        await pilot.press("u")
        await until(pilot, lambda: "already being followed again" in pane(app, "keys"))
        wire.status |= {"state": "COAST", "holder": "autonomy", "kept": None}
        await until(pilot, lambda: app.live.engine.state == "COAST")
        await pilot.press("u")
        await until(pilot, lambda: "already being followed: " in pane(app, "keys"))
        assert wire.verbs == ["arm", "resume"]

    play(wire, scene, LARGE)


def test_what_was_refused_can_be_asked_for_once_more(wire: FakeWire):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await _stopped(app, pilot, wire)
        wire.outcomes["resume"] = Outcome(ok=False, message="it is day")
        await pilot.press("u")
        await can_answer(app, pilot)
        await pilot.press("escape")
        await until(pilot, lambda: "u follows it again" in pane(app, "top"))

    play(wire, scene, LARGE)


def test_a_press_from_before_somebody_else_s_stop_arms_nothing(wire: FakeWire):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.holder == "autonomy")
        wire.status |= STOPPED
        await until(pilot, lambda: app.live.engine.holder == "nobody")
        await pilot.press("h")
        await until(pilot, lambda: "wait 2 s, then press u" in pane(app, "keys"))
        assert wire.verbs == []

    play(wire, scene, LARGE)


# -- STOP -----------------------------------------------------------------------------------------


def test_a_stop_says_how_things_stand_and_the_next_key(wire: FakeWire):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        await pilot.press("x")
        await until(pilot, lambda: "tracks, measured" in stop_text(app))
        assert "kept" not in stop_text(app)  # the engine has not said so yet
        wire.status |= STOPPED | {"kept_until_utc_ns": NOW + 900 * NS}
        await until(pilot, lambda: "u follows it again" in stop_text(app))
        assert "IDLE: disarmed. INTELSAT 14 kept for 15 min more: u follows it again" in stop_text(
            app
        )
        wire.status |= {"kept": None, "kept_until_utc_ns": None}
        await until(pilot, lambda: "a arms it again" in stop_text(app))

    play(wire, scene, LARGE)


def test_from_the_press_on_the_first_line_says_stop(wire: FakeWire):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: "AUTO has the mount" in pane(app, "top"))
        app.live.show_stop(StopNews(phase="sent", text="sent to the engine"))
        assert "STOP given" in pane(app, "top")
        assert "AUTO" not in pane(app, "top")
        wire.status |= STOPPED
        await pilot.press("x")
        await until(pilot, lambda: "tracks, measured" in stop_text(app))
        await until(pilot, lambda: "nobody has the mount" in pane(app, "top"))
        assert "STOP given" not in pane(app, "top")

    play(wire, scene, LARGE)


def test_a_stop_that_is_measured_is_not_told_by_a_word_from_before_it(
    wire: FakeWire, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(seat, "BANNER_S", 1.0)

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        app.live.on_stop_news_came(StopNewsCame(StopNews(phase="stopped", text="it stands")))
        assert "STOP given" in pane(app, "top")  # the engine's last word is TRACK
        await until(pilot, lambda: "AUTO has the mount" in pane(app, "top"))

    play(wire, scene, LARGE)


def test_a_stop_that_the_engine_knows_is_over_only_once_nobody_has_the_mount(wire: FakeWire):
    """Its command handler answers at once, its loop ends the track with its next turn."""
    known = {"last_stop": {"t_utc_ns": NOW, "motion": "stands", "is_over": True}}

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: "AUTO has the mount" in pane(app, "top"))
        wire.status |= known
        await pilot.press("x")
        await until(pilot, lambda: "tracks, measured" in stop_text(app))
        await until(pilot, lambda: app.live.engine.last_stop is not None)
        assert "STOP given" in pane(app, "top")
        assert "AUTO" not in pane(app, "top")
        await pilot.press("u")
        assert "follows it again in" in app.live.notice[0]
        wire.status |= STOPPED
        await until(pilot, lambda: "nobody has the mount" in pane(app, "top"))

    play(wire, scene, LARGE)


# -- a coast --------------------------------------------------------------------------------------

SEEN = NOW - 60 * NS
COAST = dataclasses.replace(state_of(FRAMES, 150.0, -5.0, "predicted"), misses=2, t_utc_ns=NOW)
COASTING = NightView(
    config=CONFIG,
    state="COAST",
    track=COAST,
    tracks=(
        FollowedTrack(
            state=COAST, is_lead=True, began_frame_id=2, since_utc_ns=0, measured_utc_ns=SEEN
        ),
    ),
)


def with_coast_s(seconds: float) -> Config:
    settings = CONFIG.filter.model_copy(update={"max_coast_s": seconds})
    return CONFIG.model_copy(update={"filter": settings})


def night_of(r: Rig) -> NightView:
    night = Night(Path("night"), {}, CONFIG)
    for record in r.memory.records:
        night.fold_record(r.clock.t_utc_ns, record)
    return night.view()


def test_a_coast_says_when_it_was_last_seen_and_counts_down_to_its_end():
    """The count is no promise: it is held against the frame that the engine gives it up in."""
    r = rig(set(range(1, 6)))
    r.engine.arm()
    r.engine.run(frames=5)
    assert coast_words(night_of(r), r.clock.t_utc_ns) == ""
    seen_ns = r.engine.following.lead_measured.t_mid_utc_ns
    left: dict[int, int] = {}
    for frame in range(6, 80):
        r.engine.run(frames=frame)
        view, now = night_of(r), r.clock.t_utc_ns
        if view.state != "COAST":
            break
        coasted, end, seen = coast_words(view, now).split(" · ")
        assert seen.startswith(f"last seen {utc_text(seen_ns)}, ")
        # The rig's plates say the pole: no frame of theirs has it in its field.
        assert coasted.startswith(f"coasted {frame - 5}, {frame - 5} not pointed at it")
        found = re.fullmatch(r"given up after (\d+) more", end)
        if found is not None:
            left[frame] = int(found[1])
    assert view.state == "LOST"
    off = {at: at + more - frame for at, more in left.items()}
    # The filter alone is believed for three frames; then the orbit predicts, which errs less.
    assert all(each <= 0 for at, each in off.items() if at < 9)
    late = [each for at, each in off.items() if at >= 9]
    assert len(late) > 20
    assert max(map(abs, late)) <= 1


def test_a_coast_that_ends_by_time_says_so():
    view = dataclasses.replace(COASTING, config=with_coast_s(120.0))
    assert coast_words(view, NOW) == (
        f"coasted 2 · given up after 3 more · last seen {utc_text(SEEN)}, 60 s ago"
    )
    long = coast_words(dataclasses.replace(COASTING, config=CONFIG), NOW + 600 * NS)
    end = utc_text(SEEN + round(CONFIG.filter.max_coast_s * NS))
    assert long.startswith(f"coasted 2 · given up by {end} · last seen")
    assert long.endswith("11 min ago")
    assert coast_words(dataclasses.replace(COASTING, config=None), None) == (
        f"coasted 2 · last seen {utc_text(SEEN)}"
    )


def test_the_coast_s_words_come_first_in_the_line_on_the_motion():
    engine = tracking(state="COAST", ra=150.0, dec=-5.0)
    for size in ((80, 3), (120, 5)):
        rows = plain(figure_lines(COASTING, engine, None, *size))
        assert rows[1].startswith(" coasted 2  given up by ")


def test_what_is_followed_is_predicted_to_now_and_dated_where_that_is_guesswork():
    track = dataclasses.replace(COAST, misses=0, t_utc_ns=NOW)
    night = dataclasses.replace(COASTING, track=track, state="TRACK")
    told = {"state": "TRACK", "ra": 150.0, "dec": -5.0, "t_utc_ns": NOW}

    def said(after_s: float) -> str:
        engine = tracking(**told | {"now_utc_ns": NOW + round(after_s * NS)})
        return " ".join(plain(figure_lines(night, engine, None, 120, 5)))

    assert "now α 10:00:00.0" in said(0.0)
    assert "now α 10:01:00.2" in said(60.0)  # as the stars go by in a minute
    assert "as of" not in said(60.0)
    old = said(400.0)
    assert f"last α 10:00:00.0 δ -05:00:00  as of {utc_text(NOW, zone='')}" in old
    assert "as of " + utc_text(NOW, zone="") in old.partition("3σ")[2]
    assert "prediction 3σ" in said(60.0)


def test_what_is_followed_again_is_not_said_to_be_nothing():
    engine = tracking(state="COAST", ra=150.0, dec=-5.0)
    said = " ".join(plain(figure_lines(NightView(state="MANUAL"), engine, None, 120, 5)))
    assert "followed again: its first frame is to come" in said
    at_rest = tracking(state="IDLE", holder="nobody")
    assert "nothing is followed" in " ".join(
        plain(figure_lines(NightView(state="IDLE"), at_rest, None, 120, 5))
    )


# -- holding until it clears ----------------------------------------------------------------------


def test_a_hold_until_it_clears_is_refused_in_a_clear_sky_and_taken_under_cloud():
    r = rig(set(range(1, 30)))
    stars = [400]
    reduce = r.reducer.reduce

    def with_stars(frame: Frame) -> Reduction:
        plain = reduce(frame)
        counted = dataclasses.replace(plain.detections, star_count=stars[0])
        return dataclasses.replace(plain, detections=counted)

    r.reducer.reduce = with_stars  # type: ignore[method-assign]
    r.engine.arm()
    r.engine.run(frames=8)
    refused = command_handler_of(r).handle(asked("hold", {"until": "clear"}))
    assert not refused.ok
    assert refused.message.startswith("no cloud now: 400 stars")
    assert command_handler_of(r).handle(asked("hold")).ok  # a plain hold is none of the sky's
    r.engine.commands.execute_waiting()
    assert command_handler_of(r).handle(asked("resume")).ok
    r.engine.commands.execute_waiting()
    stars[0] = 30
    r.engine.run(frames=9)
    assert command_handler_of(r).handle(asked("hold", {"until": "clear"})).ok
    r.engine.commands.execute_waiting()
    assert r.engine.authority.resumes_when_clear
    stars[0] = 400
    r.engine.run(frames=12)
    assert not r.engine.authority.is_held


# -- where the telescope really looks -------------------------------------------------------------


def test_a_plate_solution_says_where_the_frame_looks_beside_the_mount_s_word():
    row = FrameRow(
        frame_id=7, is_solved=True, plate_icrs_deg=(150.0, -5.0), mount_icrs_deg=(150.0, -5.1)
    )
    night = NightView(rows=(row,))
    by_hand = {"state": "MANUAL", "holder": "operator", "mount_ra": 150.0, "mount_dec": -5.1}
    solved = "solved RA 10:00:00.0 Dec -05:00:00 (0007)"
    for size in ((80, 3), (120, 5), (60, 14)):
        said = " ".join(plain(figure_lines(night, tracking(**by_hand), None, *size)))
        assert solved in said
        assert ("the mount reports a place 6.0′ off" in said) == (size[0] > 80 or size[1] > 3)
        assert "mount RA 10:00:00.0 Dec -05:06:00" in said
    for stale in (
        dataclasses.replace(night, rows=(row, FrameRow(frame_id=8, is_solved=False))),
        NightView(),
    ):
        assert "solved RA" not in " ".join(
            plain(figure_lines(stale, tracking(**by_hand), None, 120, 5))
        )
    slewing = tracking(**by_hand | {"is_slewing": True})
    assert "solved RA" not in " ".join(plain(figure_lines(night, slewing, None, 120, 5)))


# -- a mark that comes too late -------------------------------------------------------------------


def test_a_mark_in_a_frame_that_takes_none_any_more_is_refused_at_its_first_end(wire: FakeWire):
    too_late = f"frame {FRAMES} is too old to mark: only frames 22, 24 can be"

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        wire.status |= {"markable_frames": [FRAMES]}
        await until(pilot, lambda: app.live.engine.markable_frames == (FRAMES,))
        await pilot.press("m")
        assert "mark the first end" in pane(app, "keys")
        # Meanwhile the engine forgets the frame.
        wire.status |= {"markable_frames": [22, 24]}
        await until(pilot, lambda: app.live.engine.markable_frames == (22, 24))
        await pilot.press("enter")
        assert too_late in pane(app, "keys")
        assert app.live.marking is None
        app.live.say("")
        await pilot.press("m")
        assert too_late in pane(app, "keys")
        assert app.live.marking is None
        assert app.live.mark_refusal(FRAMES).startswith(too_late)
        assert app.live.mark_refusal(22) == ""
        assert wire.verbs == []

    play(wire, scene, LARGE)


def test_which_frames_take_a_mark_is_said_shortly():
    def said(*frames: int, newest: int = 40) -> str:
        return late_mark_reason(tracking(markable_frames=frames, frame_id=newest), 3)

    next_key = "; on the main screen enter opens the newest"
    too_old = "frame 3 is too old to mark: only"
    assert said(*range(20, 32)) == f"{too_old} frames 20 to 31 can be{next_key}"
    assert said(20) == f"{too_old} frame 20 can be{next_key}"
    assert said() == "no mark in frame 3: the next one takes one"
    assert said(2, 3) == ""
    # The record is ahead of the engine's last word.
    assert said(1, 2, newest=2) == ""
    assert said(newest=3) == ""
    assert late_mark_reason(tracking(), 3) == ""  # an engine that does not say it
    assert late_mark_reason(EngineView(reach="gone", markable_frames=(9,)), 3) == ""


def test_the_engine_says_which_frames_take_a_mark():
    r = rig(set(range(1, 40)))
    r.engine.arm()
    r.engine.run(frames=20)
    ends = {"x_a": 900.0, "y_a": 700.0, "x_b": 1000.0, "y_b": 720.0}
    for _ in range(2):
        frames = r.engine.status().markable_frames
        assert frames
        for frame in range(1, r.engine.frame_id + 2):
            answer = command_handler_of(r).handle(asked("mark", {"frame": frame, **ends}))
            is_known = not re.search("nothing can be said|none of those looked", answer.message)
            assert is_known == (frame in frames), (frame, frames, answer.message)
        r.engine.handle(Taken(by="operator"))  # by hand other frames count
