"""One frame at full resolution, as an operator uses it: what keys change, and what is said."""

import asyncio
import os
import re
import shutil
import sys
from collections.abc import Awaitable, Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from textual.pilot import Pilot

from rsoconsole.config import Config, with_setting
from rsoconsole.console.app import ConsoleApp
from rsoconsole.console.dialogs.help import help_text
from rsoconsole.console.frame._sheet import FrameScreenState
from rsoconsole.console.frame.frame_sheet import FrameSheet
from rsoconsole.console.frame.sheet_actions import MarkCallbacks
from rsoconsole.console.panes.last_line import MARKABLE
from rsoconsole.console.panes.panes import LinesPane
from rsoconsole.console.picture.marking import FAR
from rsoconsole.console.picture.sheet_pixels import STEPS
from rsoconsole.console.watches.sheet_worker import FrameOpened
from rsoconsole.control import MarkByHand
from rsoconsole.instruments import read_frame
from rsoconsole.night import NightFrame
from rsoconsole.pipeline import HELD, ReprocessedFrame, Reprocessor, read_frame_records
from rsoconsole.pipeline.cycle.decisions import KEPT as KEPT_FRAMES
from rsoconsole.pipeline.replays import reprocess
from rsoconsole.session import SessionReader
from rsoconsole.vision import Network
from tests.console.test_graphics import kitty_pictures
from tests.nights.samples import SAMPLE
from tests.rigs.screen_text import expect_as_agreed, screen_text
from tests.rigs.seat_rig import PATIENCE_S, FakeWire, opened, until
from tests.rigs.terminal import Terminal
from tests.rigs.whole_engine import wait_for

KEPT, LEFT_OUT, ALSO_KEPT, NEWEST = 9, 8, 13, 36
STREAK_PX = (983, 891)
PINK = (255, 135, 215)

Act = Callable[[ConsoleApp, FrameSheet, Pilot[str]], Awaitable[None]]


@pytest.fixture(autouse=True)
def read_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """The sample's frame is read once for all tests, and the network loaded: they take a second."""

    def read(path: Path, frame_id: int):
        return _read(path, frame_id) if path.is_relative_to(SAMPLE) else read_frame(path, frame_id)

    def load(path: Path | None, threads: int):
        return _network(threads) if path is None else Network.load(path, threads)

    monkeypatch.setattr(reprocess, "read_frame", read)
    monkeypatch.setattr(reprocess, "Network", SimpleNamespace(load=load))
    monkeypatch.setattr(Reprocessor, "run", _once)


@cache
def _read(path: Path, frame_id: int):
    return read_frame(path, frame_id)


_run = Reprocessor.run
_SEEN: dict[tuple[object, ...], ReprocessedFrame] = {}


def _once(self: Reprocessor, *settings: object, **named: object) -> ReprocessedFrame:
    """A frame with the same settings is the same for all tests."""
    recorded = self._recorded
    key = (repr(recorded), settings, *sorted(named.items()))
    if key not in _SEEN:
        _SEEN[key] = _run(self, *settings, **named)  # type: ignore[arg-type]
    return replace(_SEEN[key], stage_ms=dict(_SEEN[key].stage_ms))


@cache
def _network(threads: int) -> Network:
    return Network.load(None, threads)


def look(
    act: Act,
    *,
    folder: Path = SAMPLE,
    frame_id: int = KEPT,
    config: Config | None = None,
    size: tuple[int, int] = (80, 24),
    wire: FakeWire | None = None,
    mark_to: MarkCallbacks | None = None,
    **of_app: object,
) -> None:
    """Open a frame over a seat, wait until all is said of it, and act."""

    async def run() -> None:
        the_wire = wire or FakeWire(folder)
        session = None if wire is not None else folder
        app = ConsoleApp(lambda: the_wire, session=session, **of_app)
        async with opened(app, size) as pilot:
            await until(pilot, lambda: app.live.picture is not None)
            sheet = FrameSheet(
                folder,
                frame_id,
                config,
                keymap=app.live.keymap,
                mark_to=mark_to,
                seat=app.live,
            )
            app.push_screen(sheet)
            await calm(pilot, sheet)
            await act(app, sheet, pilot)
        # The network is not for two threads at once.
        await asyncio.to_thread(sheet._worker._thread.join, PATIENCE_S)
        assert not sheet._worker._thread.is_alive()

    asyncio.run(run())


async def calm(pilot: Pilot[str], sheet: FrameSheet) -> None:
    """Until the pixels are processed, or it is said why not."""
    state = sheet.sheet
    await until(
        pilot,
        lambda: bool(state.fault) or (state.pixels is not None and state.wanted is None),
    )


async def press(pilot: Pilot[str], sheet: FrameSheet, *keys: str) -> None:
    await pilot.press(*keys)
    await calm(pilot, sheet)


class Engine:
    """Takes the marks of an opened frame, or says why not."""

    def __init__(self) -> None:
        self.sent: list[MarkByHand] = []
        self.begun: list[int] = []
        self.left: list[int] = []
        self.refusal = ""
        self.refuses_late = ""

    def begin(self, frame_id: int, refused: Callable[[str], None]) -> None:
        self.begun.append(frame_id)
        if self.refuses_late:
            refused(self.refuses_late)

    def send(self, mark: MarkByHand) -> str:
        self.sent.append(mark)
        return f"mark sent, frame {mark.frame_id} …"

    @property
    def mark_callbacks(self) -> MarkCallbacks:
        return MarkCallbacks(
            send=self.send,
            begin=self.begin,
            leave=self.left.append,
            refusal=lambda _frame_id: self.refusal,
        )


def words(sheet: FrameSheet, name: str) -> str:
    return sheet.query_one(f"#{name}", LinesPane).text


def caption(sheet: FrameSheet) -> str:
    return "".join(
        segment.text for segment in sheet.picture.render_line(sheet.picture.size.height - 1)
    )


def title(sheet: FrameSheet) -> str:
    return "".join(segment.text for segment in sheet.picture.render_line(0))


def drawn(sheet: FrameSheet) -> str:
    lines = (sheet.picture.render_line(row) for row in range(sheet.picture.size.height))
    return "\n".join("".join(segment.text for segment in strip) for strip in lines)


# -- what it shows -----------------------------------------------------------------------------


def test_the_kept_frame_shows_its_streak_between_its_marks(impatient_seat: None):
    async def act(app: ConsoleApp, sheet: FrameSheet, pilot: Pilot[str]) -> None:
        view = sheet.sheet.view
        assert view is not None, sheet.sheet.fault
        assert view.zoom == 0
        # The view fills its room, and is of the streak.
        assert (view.window.columns, view.window.rows) == sheet.picture.room
        await press(pilot, sheet, *["minus"] * 9)
        assert "whole field" in title(sheet)
        # The cross is on the streak: signs above and below it, none upon it.
        assert re.search(r"\{\[[ ▖-▟▀-▐]+\]\}", drawn(sheet))
        assert "▾" in drawn(sheet)
        await press(pilot, sheet, "d")
        view = sheet.sheet.view
        assert view is not None
        assert view.zoom == 0
        assert abs(view.x_px - STREAK_PX[0]) < 1
        drawing = sheet.picture.drawing
        assert drawing is not None
        greys = drawing.greys.astype(float)
        # The line fit's two ends, on record.
        along = np.linspace(0.05, 0.95, 90)
        x = 953.20 + along * (1012.90 - 953.20)
        y = 892.07 + along * (890.13 - 892.07)
        across, down = drawing.blocks.across, drawing.blocks.down / 2
        columns = np.floor((x - drawing.window.x0_px) * across).astype(int)
        rows = np.floor((y - drawing.window.y0_px) * down).astype(int)
        on = greys[rows, columns].mean()
        beside = np.concatenate([greys[rows + k, columns] for k in (-9, -6, 6, 9)])
        assert on > beside.mean() + 0.5 * beside.std()

    look(act, size=(200, 60))


def test_it_is_said_what_was_recorded_and_what_is_said_now(impatient_seat: None):
    async def act(app: ConsoleApp, sheet: FrameSheet, pilot: Pilot[str]) -> None:
        panel = " ".join(words(sheet, "panel").split())
        assert "1.00 → 1.00 at 983,891" in panel
        assert "60×1.9 px, SNR 16" in panel
        assert "followed, NIS 1.4; now the same" in panel
        assert "on the sky +0.00″ E +0.00″ N of then, ±2.07″" in panel

    look(act)


def test_the_cross_reads_pixel_light_and_direction(impatient_seat: None):
    path = SessionReader(SAMPLE).frame_path(KEPT)
    assert path is not None
    pixels = _read(path, KEPT).pixels

    async def act(app: ConsoleApp, sheet: FrameSheet, pilot: Pilot[str]) -> None:
        # The streak's measured place is 20:57:13.72 -4:47:06.2.
        assert f"{pixels[891, 983]} ADU" in caption(sheet)
        assert "α 20:57:13.8 δ -04:47:06" in caption(sheet)
        await press(pilot, sheet, "d", "plus")
        while STEPS[sheet.sheet.step] > 1:
            await pilot.press("left_square_bracket")
        await press(pilot, sheet, "right", "right", "down")
        assert "╋ 985,892" in caption(sheet)
        assert f" {pixels[892, 985]} ADU" in caption(sheet)
        await pilot.press("right_square_bracket", "left")
        assert "╋ 981,892" in caption(sheet)

    look(act, size=(120, 40))


def test_zoom_goes_from_the_whole_field_to_a_quarter_pixel_and_back(impatient_seat: None):
    async def act(app: ConsoleApp, sheet: FrameSheet, pilot: Pilot[str]) -> None:
        seen = [title(sheet)]
        for _ in range(15):
            await pilot.press("z")
            seen.append(title(sheet))
        text = " ".join(seen)
        for said in ("32 px a square", "2 px a square", "pixel by pixel", "4×4 squares a px"):
            assert said in text
        assert text.count("whole field") >= 2
        await pilot.press("minus")
        assert title(sheet) != seen[-1] or "whole field" in seen[-1]

    look(act)


def test_the_stretch_changes_the_light_and_not_the_place(impatient_seat: None):
    async def act(app: ConsoleApp, sheet: FrameSheet, pilot: Pilot[str]) -> None:
        await press(pilot, sheet, "d", "minus")
        before = sheet.picture.drawing
        await pilot.press("f")
        after = sheet.picture.drawing
        assert before is not None
        assert after is not None
        assert before.window == after.window
        assert not np.array_equal(before.greys, after.greys)
        assert "asinh" in title(sheet)

    look(act)


def test_marks_can_be_put_away_to_see_what_they_cover(impatient_seat: None):
    async def act(app: ConsoleApp, sheet: FrameSheet, pilot: Pilot[str]) -> None:
        assert "[" in drawn(sheet)
        await pilot.press("O")
        assert "[" not in drawn(sheet)
        assert "▾" in drawn(sheet)

    look(act)


# -- with other settings -----------------------------------------------------------------------


def test_another_tau_says_what_the_detector_would_have_said(impatient_seat: None):
    async def act(app: ConsoleApp, sheet: FrameSheet, pilot: Pilot[str]) -> None:
        await press(pilot, sheet, "comma", "comma", "comma")
        panel = " ".join(words(sheet, "panel").split())
        assert "τ 0.1 → 0.0512" in panel
        assert sheet.sheet.done is not None
        assert sheet.sheet.done.result.tau == 0.0512
        await press(pilot, sheet, "full_stop")
        assert "τ 0.1 → 0.064" in " ".join(words(sheet, "panel").split())
        await press(pilot, sheet, "R")
        assert sheet.sheet.tau == sheet.sheet.recorded_tau == 0.1
        assert "→ 0." not in words(sheet, "panel")

    look(act)


def test_tau_stops_at_its_bounds_and_comes_back_by_the_same_steps():
    sheet = FrameScreenState(frame_id=KEPT)
    recorded = read_frame_records(SessionReader(SAMPLE), KEPT)
    sheet.opened = FrameOpened(
        recorded=recorded, detail=NightFrame(), preview=None, bytes=0, candidates=()
    )
    seen = []
    for sheet.tau_steps in range(-40, 41):
        seen.append(sheet.tau)
    assert seen == sorted(seen)
    assert (seen[0], seen[40], seen[-1]) == (0.001, 0.1, 0.99)


def test_with_the_paper_map_the_streak_is_less_sure_and_it_says_so(impatient_seat: None):
    async def act(app: ConsoleApp, sheet: FrameSheet, pilot: Pilot[str]) -> None:
        await press(pilot, sheet, "M")
        panel = " ".join(words(sheet, "panel").split())
        assert "map fast → paper" in panel
        now = re.search(r"1\.00 → (1?\.\d\d) at 983,891", panel)
        assert now is not None, panel
        assert float(now[1]) < 1.0
        assert "then followed, NIS 1.4 now detected" in panel
        await press(pilot, sheet, "M")
        assert "now the same" in " ".join(words(sheet, "panel").split())
        assert "{" in drawn(sheet)

    look(act)


def test_what_the_network_sees_is_shown_as_a_picture(impatient_seat: None):
    async def act(app: ConsoleApp, sheet: FrameSheet, pilot: Pilot[str]) -> None:
        frame = sheet.picture.drawing
        await press(pilot, sheet, "V")
        assert "network's map" in title(sheet)
        assert re.search(r"[3-9]\.\dσ", caption(sheet))
        graded = sheet.picture.drawing
        assert frame is not None
        assert graded is not None
        assert not np.array_equal(frame.greys, graded.greys)
        await press(pilot, sheet, "M")
        hard = sheet.picture.drawing
        assert hard is not None
        assert len(np.unique(hard.greys)) < len(np.unique(graded.greys))
        await press(pilot, sheet, "M", "V")
        again = sheet.picture.drawing
        assert again is not None
        assert np.array_equal(again.greys, frame.greys)

    look(act)


def test_a_plate_from_its_own_stars(impatient_seat: None):
    async def act(app: ConsoleApp, sheet: FrameSheet, pilot: Pilot[str]) -> None:
        await press(pilot, sheet, "P")
        panel = " ".join(words(sheet, "panel").split())
        assert "plate found again" in panel
        assert re.search(r"plate \d+", panel)
        shift = re.search(r"on the sky ([+-][\d.]+)″ E ([+-][\d.]+)″ N", panel)
        assert shift is not None
        assert max(abs(float(part)) for part in shift.groups()) < 0.5
        await press(pilot, sheet, "P")
        assert "plate as recorded" in " ".join(words(sheet, "panel").split())

    look(act)


# -- frames that cannot be ---------------------------------------------------------------------


def test_a_frame_that_was_not_kept_says_why_and_shows_its_preview(impatient_seat: None):
    async def act(app: ConsoleApp, sheet: FrameSheet, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: "preview" in words(sheet, "alert"))
        alert = " ".join(words(sheet, "alert").split())
        assert "frame 8 was not kept: pruned on 2023-06-23" in alert
        assert "▀" in drawn(sheet)
        assert "1.00  at 1161,886" in words(sheet, "panel")
        await press(pilot, sheet, "M", "full_stop", "P", "V", "plus", "up", "d")
        assert "→" not in words(sheet, "panel")
        whole = drawn(sheet)
        await pilot.press("z")
        assert drawn(sheet) != whole

    look(act, frame_id=LEFT_OUT)


@pytest.mark.parametrize("harm", ["truncated", "empty", "no frame", "no session"])
def test_what_cannot_be_read_is_one_clear_line(tmp_path: Path, impatient_seat: None, harm: str):
    folder = Path(shutil.copytree(SAMPLE, tmp_path / "night"))
    path = folder / "frames" / "000009.fits.fz"
    said = {
        "truncated": "is truncated",
        "empty": "is empty (0 bytes)",
        "no frame": "holds no frame 777",
        "no session": "does not exist",
    }[harm]
    if harm in {"truncated", "empty"}:
        path.write_bytes(path.read_bytes()[: 1_000_000 if harm == "truncated" else 0])
    asked = tmp_path / "gone" if harm == "no session" else folder

    async def run() -> None:
        app = ConsoleApp(lambda: FakeWire(folder), session=folder)
        async with opened(app, (80, 24)) as pilot:
            await until(pilot, lambda: app.live.picture is not None)
            sheet = FrameSheet(asked, 777 if harm == "no frame" else KEPT)
            app.push_screen(sheet)
            await calm(pilot, sheet)
            await until(pilot, lambda: said in " ".join(words(sheet, "alert").split()))
            await pilot.press("M", "d", "plus", "z", "V", "L", "escape", "escape")
            assert app.screen is app.live

    asyncio.run(run())


def test_a_missing_network_is_said_and_the_pixels_are_shown(tmp_path: Path, impatient_seat: None):
    config = with_setting(Config(), "detector.model", tmp_path / "none.tflite")

    async def act(app: ConsoleApp, sheet: FrameSheet, pilot: Pilot[str]) -> None:
        panel = " ".join(words(sheet, "panel").split())
        assert "cannot be read" in panel
        assert "reinstall rsoconsole" in panel
        await press(pilot, sheet, "minus")
        assert "4 px a square" in title(sheet)

    look(act, config=config, size=(120, 40))


# -- the seat around it ------------------------------------------------------------------------


def test_enter_opens_the_frame_that_is_shown_and_escape_goes_back(impatient_seat: None):
    async def run() -> None:
        app = ConsoleApp(lambda: FakeWire(SAMPLE), session=SAMPLE)
        async with opened(app, (80, 24)) as pilot:
            await until(pilot, lambda: app.live.picture is not None)
            await pilot.press("enter")
            sheet = app.screen
            assert isinstance(sheet, FrameSheet)
            await calm(pilot, sheet)
            assert "frame 0036" in title(sheet)
            await until(pilot, lambda: "frame 36 was not kept" in words(sheet, "alert"))
            assert "RECORDED" in words(sheet, "status")
            await pilot.press("escape")
            assert app.screen is app.live

    asyncio.run(run())


@pytest.mark.parametrize("size", [(80, 24), (120, 40)])
def test_a_streak_is_marked_at_full_resolution(impatient_seat: None, size: tuple[int, int]):
    engine = Engine()

    async def act(app: ConsoleApp, sheet: FrameSheet, pilot: Pilot[str]) -> None:
        await press(pilot, sheet, "d", "plus", "plus", "plus", "left_square_bracket")
        await pilot.press("m")
        await pilot.pause()
        assert "mark the first end" in title(sheet), sheet.sheet.fault
        said = " ".join(words(sheet, "keys").split())
        assert f"frame {KEPT} stays markable meanwhile, for {HELD} frames" in said
        assert "enter Set" in said
        assert "esc Leave off" in said
        assert "Next candidate" not in said
        await pilot.press("escape")
        assert app.screen is sheet
        assert "mark" not in title(sheet)
        assert "enter Set" not in words(sheet, "keys")
        view = sheet.sheet.view
        assert view is not None
        await pilot.press("m", "enter")
        assert "mark the second end" in title(sheet)
        assert "1" in drawn(sheet)
        await pilot.press(*["right"] * 6, "enter")
        (mark,) = engine.sent
        assert mark.frame_id == KEPT
        assert (mark.x_a_px, mark.y_a_px) == (view.x_px, view.y_px)
        assert mark.x_b_px - mark.x_a_px == pytest.approx(6 * view.px_per_square)
        # As finely as one can point there: the picture's squares are 48 px.
        assert mark.sigma_px == 1.0
        assert f"mark sent, frame {KEPT} …" in words(sheet, "keys")
        assert engine.begun == [KEPT, KEPT]
        assert engine.left == [KEPT]
        # It is still said on the screen below.
        await pilot.press("escape")
        assert app.screen is app.live
        assert app.live.notice[0] == f"mark sent, frame {KEPT} …"

    look(act, size=size, mark_to=engine.mark_callbacks)


def test_a_frame_that_is_too_old_to_mark_says_so_before_anything_is_done(impatient_seat: None):
    engine = Engine()
    too_old = "frame 3 is too old to mark"

    async def act(_app: ConsoleApp, sheet: FrameSheet, pilot: Pilot[str]) -> None:
        engine.refusal = too_old
        await pilot.press("m")
        assert too_old in words(sheet, "keys")
        assert not sheet.sheet.is_marking
        # The engine's own word may come a moment later.
        engine.refusal, engine.refuses_late = "", "no mark in frame 3: too late"
        await pilot.press("m")
        assert "too late" in words(sheet, "keys")
        assert not sheet.sheet.is_marking
        # It may have forgotten the frame: a limit, a STOP.
        engine.refuses_late = ""
        await pilot.press("m")
        assert sheet.sheet.is_marking
        engine.refusal = too_old
        await pilot.press("enter")
        assert too_old in words(sheet, "keys")
        assert not sheet.sheet.is_marking
        assert not engine.sent

    look(act, mark_to=engine.mark_callbacks)


def test_while_a_mark_is_made_no_sign_lies_over_the_streak(impatient_seat: None):
    engine = Engine()

    async def act(_app: ConsoleApp, sheet: FrameSheet, pilot: Pilot[str]) -> None:
        assert "[" in drawn(sheet)
        await pilot.press("m")
        assert "[" not in drawn(sheet)
        await pilot.press("O")
        assert "[" in drawn(sheet)
        await pilot.press("O")
        assert "[" not in drawn(sheet)
        await pilot.press("escape")
        assert "[" in drawn(sheet)

    look(act, mark_to=engine.mark_callbacks)


def test_a_shifted_arrow_moves_the_cross_further(impatient_seat: None):
    async def act(_app: ConsoleApp, sheet: FrameSheet, pilot: Pilot[str]) -> None:
        await press(pilot, sheet, "d", "plus")
        before = sheet.sheet.view
        assert before is not None
        await pilot.press("shift+right")
        after = sheet.sheet.view
        assert after is not None
        step = STEPS[sheet.sheet.step] * before.px_per_square
        assert after.x_px - before.x_px == pytest.approx(FAR * step)
        assert f"╋ {after.x_px:.0f}" in caption(sheet)

    look(act, size=(120, 40))


@pytest.mark.parametrize("size", [(80, 24), (120, 40)])
def test_a_step_is_said_in_squares_and_in_pixels(impatient_seat: None, size: tuple[int, int]):
    async def act(_app: ConsoleApp, sheet: FrameSheet, pilot: Pilot[str]) -> None:
        await press(pilot, sheet, "d")
        view = sheet.sheet.view
        assert view is not None
        sheet.sheet.view = replace(view, zoom=2)
        await pilot.press("right_square_bracket", "left_square_bracket")
        assert "step 4 squares = 16 px ([ smaller, ] larger)" in words(sheet, "keys")
        assert "step 16 px" in caption(sheet)
        await pilot.press("plus", "plus")
        assert "step 4 px" in caption(sheet)

    look(act, size=size)


def test_the_other_kept_frames_are_reached_from_an_opened_one(impatient_seat: None):
    async def act(app: ConsoleApp, sheet: FrameSheet, pilot: Pilot[str]) -> None:
        await press(pilot, sheet, "d", "plus", "f")
        await until(pilot, lambda: sheet.sheet.view is not None)
        view, stretch = sheet.sheet.view, sheet.sheet.stretch
        assert view is not None, sheet.sheet.fault
        await pilot.press("pageup")
        assert f"frame {KEPT} is the oldest" in words(sheet, "keys")
        await pilot.press("pagedown")
        await until(pilot, lambda: app.screen is not sheet)
        other = app.screen
        assert isinstance(other, FrameSheet)
        await calm(pilot, other)
        assert other.sheet.frame_id == ALSO_KEPT
        assert "frame 0013" in title(other)
        # As near, with the cross on that frame's own streak: so two are compared.
        assert other.sheet.opened is not None
        own = other.sheet.opened.detail.accepted_measurement
        assert own is not None
        assert view is not None
        its = other.sheet.view
        assert its is not None
        assert (its.x_px, its.y_px, its.zoom) == (own.x_px, own.y_px, view.zoom)
        assert (own.x_px, own.y_px) != (view.x_px, view.y_px)
        assert other.sheet.stretch == stretch
        await pilot.press("pagedown")
        assert f"frame {ALSO_KEPT} is the newest" in words(other, "keys")
        await pilot.press("escape")
        assert app.screen is app.live
        await asyncio.to_thread(other._worker._thread.join, PATIENCE_S)
        assert not other._worker._thread.is_alive()

    look(act, size=(120, 40))


def test_where_nothing_can_be_marked_no_mark_is_offered(impatient_seat: None):
    async def act(app: ConsoleApp, sheet: FrameSheet, pilot: Pilot[str]) -> None:
        assert "m Mark" not in words(sheet, "keys")
        await pilot.press("m")
        assert "no marks in a night that is over" in words(sheet, "keys")

    look(act, size=(120, 40))


def test_a_frame_whose_pixels_were_not_kept_offers_no_mark(impatient_seat: None):
    engine = Engine()

    async def act(app: ConsoleApp, sheet: FrameSheet, pilot: Pilot[str]) -> None:
        assert "m Mark" not in words(sheet, "keys")
        await pilot.press("m")
        assert "its pixels were not kept" in words(sheet, "keys")

    look(act, frame_id=LEFT_OUT, mark_to=engine.mark_callbacks)


def test_enter_sets_an_end_while_a_mark_is_made(wire: FakeWire):
    async def run() -> None:
        app = ConsoleApp(lambda: wire)
        async with opened(app, (120, 40)) as pilot:
            await until(pilot, lambda: app.live.picture is not None)
            await until(pilot, lambda: app.live.engine.is_attached)
            await pilot.press("m", "enter", "right", "right")
            assert app.screen is app.live
            assert app.live.marking is not None
            assert app.live.marking.first_px is not None

    asyncio.run(run())


@pytest.mark.parametrize("key", ["x", "ctrl+x"])
def test_stop_works_over_a_frame_and_shows_what_came_of_it(impatient_seat: None, key: str):
    wire = FakeWire(SAMPLE)

    async def act(app: ConsoleApp, sheet: FrameSheet, pilot: Pilot[str]) -> None:
        await pilot.press(key)
        await until(pilot, lambda: "stop" in wire.verbs)
        assert app.screen is app.live
        await until(pilot, lambda: app.live.stop_news is not None)
        # Nothing holds the frame's 8 MB any more.
        assert sheet.sheet.pixels is None

    look(act, wire=wire)


def test_a_frame_opened_after_a_stop_does_not_hide_what_came_of_it(wire: FakeWire):
    """STOP overtakes keys that wait: one typed before it may open a frame after it."""

    async def run() -> None:
        app = ConsoleApp(lambda: wire)
        async with opened(app, (80, 24)) as pilot:
            await until(pilot, lambda: app.live.picture is not None)
            await pilot.press("x", "enter")
            sheet = app.screen
            assert isinstance(sheet, FrameSheet)
            await until(pilot, lambda: "STOP the mount tracks" in words(sheet, "alert"))

    asyncio.run(run())


def test_leaving_leaves_from_here_too(impatient_seat: None):
    async def act(app: ConsoleApp, sheet: FrameSheet, pilot: Pilot[str]) -> None:
        await pilot.press("q")
        await pilot.pause()
        assert app.screen is not sheet
        assert app.return_value == "quit"

    look(act, frame_id=LEFT_OUT)


def test_the_telescopes_state_stands_above_and_changes_by_itself(wire: FakeWire):
    async def run() -> None:
        app = ConsoleApp(lambda: wire)
        async with opened(app, (80, 24)) as pilot:
            await until(pilot, lambda: app.live.picture is not None)
            await until(pilot, lambda: app.live.engine.is_attached)
            await pilot.press("enter")
            sheet = app.screen
            assert isinstance(sheet, FrameSheet)
            await until(pilot, lambda: "AUTO has the mount" in words(sheet, "status"))
            wire.status |= {"state": "FAULT", "holder": "nobody", "faults": ["the mount is gone"]}
            await until(pilot, lambda: "FAULT the mount is gone" in words(sheet, "alert"))
            assert "FAULT" in words(sheet, "status")

    asyncio.run(run())


def test_keys_of_ones_own_hold_here_too(impatient_seat: None):
    async def act(app: ConsoleApp, sheet: FrameSheet, pilot: Pilot[str]) -> None:
        before = title(sheet)
        await pilot.press("z")
        assert title(sheet) == before
        await pilot.press("f5")
        assert title(sheet) != before

    look(act, keymap={"zoom": "f5"})


def test_help_tells_this_screens_keys(impatient_seat: None):
    async def act(app: ConsoleApp, sheet: FrameSheet, pilot: Pilot[str]) -> None:
        await pilot.press("f1")
        text = app.export_screenshot().replace("&#x27;", "'").replace("&#160;", " ")
        assert "the map that the network looks at" in text
        assert "step by which arrows move the mount" in " ".join(help_text(mode="sheet").split())
        assert f"in the last {MARKABLE} frames" in " ".join(help_text(mode="sheet").split())
        assert KEPT_FRAMES == MARKABLE
        await pilot.press("escape")
        assert app.screen is sheet

    look(act, size=(120, 40))


def test_every_key_of_the_screen_is_in_the_palette(impatient_seat: None):
    async def act(app: ConsoleApp, sheet: FrameSheet, pilot: Pilot[str]) -> None:
        offered = list(app.get_system_commands(sheet))
        assert {"Frame: smaller tau", "Frame: map mode", "STOP"} <= {c.title for c in offered}
        tau = next(c for c in offered if c.title == "Frame: larger tau")
        tau.callback()
        await calm(pilot, sheet)
        assert "0.1 → 0.125" in " ".join(words(sheet, "panel").split())

    look(act)


def test_in_the_smallest_terminal_the_streak_is_found_and_the_list_opens(impatient_seat: None):
    async def act(app: ConsoleApp, sheet: FrameSheet, pilot: Pilot[str]) -> None:
        assert "then 1, now 1: as recorded" in words(sheet, "panel")
        assert "x STOP" in words(sheet, "keys")
        await press(pilot, sheet, "d")
        assert "[" in drawn(sheet)
        assert "]" in drawn(sheet)
        await pilot.press("L")
        await pilot.pause()
        assert "1.00 → 1.00" in words(sheet, "panel")
        assert not sheet.picture.display
        await pilot.press("escape")
        await pilot.pause()
        assert sheet.picture.display
        assert app.screen is sheet

    look(act, size=(40, 12))


def test_a_click_puts_the_cross_there(impatient_seat: None):
    async def act(app: ConsoleApp, sheet: FrameSheet, pilot: Pilot[str]) -> None:
        await pilot.press(*["minus"] * 9)  # to the whole field, which a cross does not move
        await pilot.click("#picture", offset=(10, 5))
        view = sheet.sheet.view
        assert view is not None
        assert view.window.cell(view.x_px, view.y_px) == (10, 4)

    look(act)


@pytest.mark.nightly("drives a terminal")
def test_kitty_is_sent_the_frame_with_what_is_seen_now(tmp_path: Path):
    folder = Path(shutil.copytree(SAMPLE, tmp_path / "night"))
    # The newest frame, which the console shows, gets the pixels and records of the kept one.
    _keep_as_newest(folder)
    command = [sys.executable, "-c", "from rsoconsole.cli import main; main()", "console"]
    command += ["--session", str(folder), "--graphics", "kitty"]

    def is_pink(written: bytes) -> bool:
        pictures = kitty_pictures(written)
        return any((np.asarray(p) == PINK).all(axis=2).sum() > 20 for p in pictures)

    with Terminal(command, os.environ, (120, 40)) as terminal:
        wait_for(lambda: kitty_pictures(terminal.written), "the live picture")
        assert not is_pink(terminal.written)
        terminal.press("\r")
        wait_for(lambda: is_pink(terminal.written), "the mark of what is seen now")


def _keep_as_newest(folder: Path) -> None:
    import sqlite3
    from contextlib import closing

    with closing(sqlite3.connect(folder / "session.db")) as database, database:
        database.execute("DELETE FROM log WHERE frame_id > ?", (KEPT,))
        database.execute("DELETE FROM files WHERE frame_id > ?", (KEPT,))


@pytest.mark.parametrize("size", [(80, 24), (120, 40), (200, 60)], ids=lambda s: f"{s[0]}x{s[1]}")
def test_the_screen_looks_as_it_was_agreed(
    impatient_seat: None, monkeypatch: pytest.MonkeyPatch, size: tuple[int, int]
):
    """Set RSOCONSOLE_WRITE_SNAPSHOTS to write the screens again, then look at the diff."""
    run = Reprocessor.run

    def timed(self: Reprocessor, *arguments: object, **named: object):
        found = run(self, *arguments, **named)
        stages = {"background": 60.0, "map": 2.0, "network": 30.0, "stars": 20.0, "fit": 50.0}
        found.stage_ms.clear()
        found.stage_ms.update(stages, total=150.0)
        return found

    monkeypatch.setattr(Reprocessor, "run", timed)
    seen = ""

    async def act(app: ConsoleApp, sheet: FrameSheet, pilot: Pilot[str]) -> None:
        nonlocal seen
        await press(pilot, sheet, "d")
        assert "now the same" in " ".join(words(sheet, "panel").split())
        await pilot.pause(0.05)
        seen = screen_text(app)

    look(act, size=size)
    expect_as_agreed(seen, f"frame-sheet_{size[0]}x{size[1]}")
