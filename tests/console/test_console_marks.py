"""A mark by hand on the main screen: what is said when, and what its frame's details are."""

import dataclasses
from typing import Any

import pytest
from textual.pilot import Pilot
from textual.widgets import Static

from rsoconsole.console.app import ConsoleApp
from rsoconsole.console.dialogs.candidates import (
    CandidatesDialog,
    candidate_lines,
    detection_outcome,
)
from rsoconsole.console.dialogs.dialogs import ConfirmDialog
from rsoconsole.console.frame._sheet_marks import marks_beyond_streak_ends
from rsoconsole.console.panes.frame_pane import FramePane
from rsoconsole.console.picture.marks import Mark
from rsoconsole.control import MarkByHand, Outcome
from rsoconsole.night import NightFrame
from rsoconsole.records import CommandResult, Detections, OperatorAction, Ruling, mark_id_of
from rsoconsole.session import SessionWriter
from tests.makers import geo_measurement, straight_detection
from tests.nights import made_up_night as night
from tests.rigs.seat_rig import FRAMES, FakeWire, pane, play, until

USED = CommandResult(
    kind="ruled",
    ruled="taken by hand",
    frame_id=FRAMES,
    left_alone=1,
    sigma_arcsec=(0.29, 0.14),
    off_arcsec=0.6,
)
LARGE = 120, 40
WORDS = "used: ±0.29″ RA ±0.14″ Dec, 0.6″ from the automatic measurement, which is set aside"


def said(app: ConsoleApp) -> str:
    return " ".join(pane(app, "keys").split())


def action(app: ConsoleApp, verb: str, outcome: CommandResult, **arguments: Any) -> OperatorAction:
    by = f"console {app.live.seat_name}"
    return OperatorAction(verb=verb, arguments=arguments, outcome=outcome, by=by)


async def mark(app: ConsoleApp, pilot: Pilot[str], wire: FakeWire) -> None:
    await until(pilot, lambda: app.live.engine.is_attached)
    await pilot.press("m", "enter", *["right"] * 5, "enter")
    await until(pilot, lambda: wire.verbs == ["mark"])


def test_the_engine_is_asked_to_keep_the_frame_and_to_let_it_go(wire: FakeWire):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        await pilot.press("m")
        await until(pilot, lambda: wire.begun == [(FRAMES, True)])
        assert "stays markable meanwhile, for 600 frames" in said(app)
        await pilot.press("escape")
        await until(pilot, lambda: wire.begun == [(FRAMES, True), (FRAMES, False)])
        assert wire.verbs == []

    play(wire, scene, LARGE)


def test_a_frame_that_the_engine_does_not_keep_ends_the_mark_where_it_begins(wire: FakeWire):
    wire.outcomes["begin_mark"] = Outcome(ok=False, message="too old, only frames 30 to 41")

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        await pilot.press("m")
        await until(pilot, lambda: "too old, only frames 30 to 41" in said(app))
        assert app.live.marking is None

    play(wire, scene, LARGE)


def test_what_came_of_a_mark_is_said_and_is_in_the_log(wire: FakeWire, writer: SessionWriter):
    how = "taken up with the next frame: ±0.29″, refined on the light beneath it"
    wire.outcomes["mark"] = Outcome(ok=True, message=how)

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await mark(app, pilot, wire)
        await until(pilot, lambda: f"your mark in frame {FRAMES} is {how}" in said(app))
        t = night.t_of(FRAMES + 1)
        writer.append(action(app, "begin_mark", CommandResult(kind="done"), frame=FRAMES), t)
        writer.append(action(app, "mark", USED, frame=FRAMES), t)
        await until(pilot, lambda: f"your mark in frame {FRAMES} is {WORDS}" in said(app))
        log = [line.text for line in app.live.night.log]
        assert any(f"mark in frame {FRAMES} is {WORDS}" in text for text in log)
        assert not any("begin a mark" in text for text in log)

    play(wire, scene, LARGE, seat_name="a@b")


def test_the_details_after_a_mark_are_those_of_its_frame(wire: FakeWire, writer: SessionWriter):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await mark(app, pilot, wire)
        night.add_frames(writer, [FRAMES + 1])
        night.add_previews(writer, range(FRAMES + 1, FRAMES + 2))
        await until(pilot, lambda: app.live.picture.frame_id == FRAMES + 1)
        marked = f"streaks of frame {FRAMES:04d}, the frame you marked"
        newest = f"streaks of frame {FRAMES + 1:04d}"
        for first, second in ((marked, newest), (newest, marked), (newest, marked)):
            await pilot.press("v")
            await until(pilot, lambda: isinstance(app.screen, CandidatesDialog))
            box = app.screen.query_one(Static).parent
            assert box.border_title == first
            await pilot.press("tab")
            assert box.border_title == second
            await pilot.press("tab")
            assert box.border_title == first
            await pilot.press("escape")
            await until(pilot, lambda: app.screen is app.live)

    play(wire, scene, LARGE)


def test_a_mark_that_is_not_taken_or_is_old_changes_nothing_of_the_details(
    wire: FakeWire, writer: SessionWriter, monkeypatch: pytest.MonkeyPatch
):
    def title(app: ConsoleApp) -> str:
        return app.screen.query_one(Static).parent.border_title

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        wire.outcomes["mark"] = Outcome(ok=False, message="no", data={"asks": "replaces"})
        await mark(app, pilot, wire)
        await until(pilot, lambda: isinstance(app.screen, ConfirmDialog))
        await pilot.press("escape")
        night.add_frames(writer, [FRAMES + 1])
        night.add_previews(writer, range(FRAMES + 1, FRAMES + 2))
        await until(pilot, lambda: app.live.picture.frame_id == FRAMES + 1)
        await pilot.press("v")
        await until(pilot, lambda: isinstance(app.screen, CandidatesDialog))
        assert title(app) == f"streaks of frame {FRAMES + 1:04d}"
        await pilot.press("escape")
        app.live.report_mark_accepted(
            MarkByHand(frame_id=FRAMES, x_a_px=1.0, y_a_px=1.0, x_b_px=9.0, y_b_px=1.0),
            Outcome(ok=True),
        )
        later_s = app.live.now_s() + 61.0
        monkeypatch.setattr(app.live, "now_s", lambda: later_s)
        await pilot.press("v")
        await until(pilot, lambda: isinstance(app.screen, CandidatesDialog))
        assert title(app) == f"streaks of frame {FRAMES + 1:04d}"

    play(wire, scene, LARGE)


def test_far_off_a_streak_that_is_marked_keeps_a_point_beyond_each_end():
    streak = Mark(x_px=500.0, y_px=300.0, kind="followed", ends_px=((450.0, 300.0), (550.0, 300.0)))
    (faint,) = marks_beyond_streak_ends([streak], 8.0)
    assert faint.outline_px == ((434.0, 300.0), (566.0, 300.0))
    assert marks_beyond_streak_ends([streak], 2.0) == ()
    assert marks_beyond_streak_ends([Mark(x_px=1.0, y_px=1.0, kind="predicted")], 8.0) == ()


def test_the_automatic_streak_of_a_marked_frame_is_set_aside_not_followed():
    automatic = geo_measurement(4)
    streak = straight_detection(frame_id=4, x_px=automatic.x_px, y_px=automatic.y_px)
    other = dataclasses.replace(streak, x_px=streak.x_px + 900.0)
    found = Detections(frame_id=4, width_px=4656, height_px=3520, detections=(streak, other))
    by_hand = dataclasses.replace(
        automatic, measurement_id=mark_id_of(4, 0), source="operator", x_px=automatic.x_px + 0.3
    )
    detail = NightFrame(detections=found, measurements=(automatic,))
    marked = dataclasses.replace(detail, decision=Ruling(frame_id=4, taken=by_hand))
    assert detection_outcome(streak, marked)[0] == "set aside"
    assert detection_outcome(other, marked)[0] == "not measured"
    assert any("by your hand" in line for line in candidate_lines(marked, 0.1))
    chosen = dataclasses.replace(detail, decision=Ruling(frame_id=4, taken=automatic))
    assert detection_outcome(streak, chosen)[0] == "followed"


def test_signs_give_way_to_the_mark_that_is_made(wire: FakeWire):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        frame = app.live.query_one("#frame", FramePane)

        def signs() -> list[Mark]:
            return [each for each in frame._shown_marks() if each.kind != "cursor"]

        before = signs()
        assert before
        await pilot.press("m")
        assert signs() == []
        await pilot.press("O")
        assert signs() == before
        await pilot.press("escape")
        assert signs() == before

    play(wire, scene, LARGE)
