"""The seat as an operator meets it: what it shows of a real session, what it sends and when."""

import asyncio
import io
import os
import re
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from textual.pilot import Pilot
from textual.screen import Screen
from textual.widgets import Button, Input, Static

from rsoconsole.base import ControlError, RsoconsoleError, SessionError
from rsoconsole.config import Config
from rsoconsole.console import run_console
from rsoconsole.console.actions import seat
from rsoconsole.console.actions.second_press import RELEASED_S
from rsoconsole.console.app import ConsoleApp
from rsoconsole.console.dialogs.dialogs import LeaveDialog, Tick
from rsoconsole.console.drawing.pane_layout import banner_box, pane_boxes
from rsoconsole.console.drawing.plot import PlotColumn, residual_axis_limit, residual_plot
from rsoconsole.console.night.engine_view import read_engine_view
from rsoconsole.console.panes.frame_pane import FramePane
from rsoconsole.console.panes.last_line import key_line, live_keys
from rsoconsole.console.panes.log_pane import LogPane, log_rows
from rsoconsole.console.panes.panes import StopBanner
from rsoconsole.console.watches import watch
from rsoconsole.console.watches.messages import StopNewsCame
from rsoconsole.console.words.facts import figure_lines
from rsoconsole.console.words.words import wrap_to_rows
from rsoconsole.control import (
    ControlClient,
    ControlServer,
    Found,
    Outcome,
    Request,
    Sender,
    StopNews,
)
from rsoconsole.control.wire import read_outcome
from rsoconsole.night import LogLine, Night, NightView, line_of
from rsoconsole.night.log_lines import append_line
from rsoconsole.records import (
    ACCEPTED,
    DONE,
    Cause,
    CommandResult,
    Event,
    Miss,
    Missed,
    NotFollowed,
    NotTaken,
    OperatorAction,
    Site,
    SlewCommand,
    StateChange,
    done_result,
)
from rsoconsole.session import SessionReader, SessionWriter
from tests.makers import NS, geo_measurement
from tests.nights import made_up_night as night
from tests.rigs.seat_rig import (
    ANSWERED,
    FRAMES,
    FULL,
    PATIENCE_S,
    FakeWire,
    can_answer,
    has_outlook,
    opened,
    pane,
    play,
    screen_text,
    stop_text,
    until,
)

SNAPSHOTS = Path(__file__).parents[1] / "snapshots"


# -- what it shows ---------------------------------------------------------------------------


@pytest.mark.parametrize("size", [(80, 24), (120, 40), (200, 60), (60, 20), (40, 12)])
def test_the_screen_reads_as_it_was_agreed(wire: FakeWire, size: tuple[int, int]) -> None:
    """Set RSOCONSOLE_WRITE_SNAPSHOTS to write the pictures again, then read them."""
    seen = ""

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        nonlocal seen
        await until(pilot, lambda: "TRACK 3m37" in pane(app, "top"))
        await until(pilot, lambda: has_outlook(app))
        if app.live.query_one("#tune").display:
            await until(pilot, lambda: "…" not in pane(app, "tune"))
        seen = screen_text(app)

    play(wire, scene, size)
    agreed = SNAPSHOTS / f"console_{size[0]}x{size[1]}.txt"
    if "RSOCONSOLE_WRITE_SNAPSHOTS" in os.environ:
        agreed.write_text(seen, encoding="utf-8")
    assert seen == agreed.read_text(encoding="utf-8")


def test_state_holder_and_clock_are_words_in_the_first_line(wire: FakeWire) -> None:
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: "AUTO has the mount" in pane(app, "top"))
        for holder, said in (("operator", "YOU have the mount"), ("nobody", "nobody has the")):
            wire.status |= {"holder": holder, "state": "MANUAL", "target": "INTELSAT 14"}
            await until(pilot, lambda said=said: said in pane(app, "top"))
        assert "MANUAL" in pane(app, "top")
        assert "INTELSAT 14" in pane(app, "top")
        assert pane(app, "top").rstrip().endswith("Z")

    play(wire, scene)


def test_where_the_field_shows_no_streak_the_close_up_has_its_place(wire: FakeWire):
    """In 80 x 24 the followed streak is one cell of the field wide; z goes on from there."""

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        frame = app.live.query_one("#frame", FramePane)
        assert "─ frame 0020 · 10 s · close-up" in screen_text(app)
        shown = frame.drawing
        assert shown is not None
        # Not all of the light in the streak's row is that of the sky.
        middle = shown.greys.shape[0] // 2
        assert shown.greys[middle - 2 : middle + 2].mean() > shown.greys.mean() + 2
        await pilot.press("z")
        assert "picture: full resolution" in screen_text(app)
        await pilot.press("z")
        assert "─ frame 0020 · 10 s ─" in screen_text(app)
        await pilot.resize_terminal(120, 40)
        assert "─ frame 0020" in screen_text(app)

    play(wire, scene)


@pytest.mark.parametrize("size", [(120, 40), (200, 60)])
def test_with_room_for_both_the_close_up_is_the_main_picture(wire: FakeWire, size):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        main, beside = app.live.picture_panes()
        assert main.id == "closeup"
        assert re.match("─ frame 0020 · .* close-up", main.render_line(0).text)
        assert beside.render_line(0).text.startswith("─ field ─")
        if size == (200, 60):
            assert main.size.width * main.size.height > beside.size.width * beside.size.height
        await pilot.press("z", "z")
        assert re.match("─ frame 0020 · ", main.render_line(0).text)
        assert beside.render_line(0).text.startswith("─ close-up 0020")

    play(wire, scene, size)


def test_the_picture_marks_what_is_followed_and_how_sure_that_is(wire: FakeWire) -> None:
    async def scene(app: ConsoleApp, _pilot: Pilot[str]) -> None:
        picture = app.live.query_one("#frame", FramePane).picture
        assert picture is not None
        followed = [mark for mark in picture.marks if mark.kind == "followed"]
        assert len(followed) == 1
        assert (followed[0].x_px, followed[0].y_px) == (2000.0, 1500.0)
        assert re.search(rf"\[[^\]]*\]{re.escape(followed[0].label)}", screen_text(app))

    play(wire, scene)


def test_a_miss_is_a_sign_of_its_own_and_a_line_of_the_log(wire: FakeWire) -> None:
    async def scene(app: ConsoleApp, _pilot: Pilot[str]) -> None:
        missed = [row for row in app.live.night.rows if row.frame_id == night.MISSED]
        assert missed[0].confidence is None
        assert missed[0].miss == "no detection"
        assert missed[0].residual_arcsec is None
        assert missed[0].sigma_arcsec is not None
        assert "○" in pane(app, "confidence").splitlines()[-1]
        assert "TRACK → COAST: no detection" in screen_text(app)

    play(wire, scene)


def test_a_frame_that_is_not_reduced_yet_is_no_miss(wire: FakeWire, writer: SessionWriter) -> None:
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        signs = pane(app, "confidence").count("○")
        writer.append(night.taken(FRAMES + 1, 150.0, -5.0), night.t_of(FRAMES + 1))
        assert writer.flush()
        await until(pilot, lambda: len(app.live.night.rows) == FRAMES + 1)
        assert pane(app, "confidence").count("○") == signs
        assert "no detection" not in pane(app, "confidence")

    play(wire, scene)


def test_wide_bounds_after_a_miss_do_not_flatten_the_residuals() -> None:
    usual = [PlotColumn(value=0.5, bound=2.0)] * 9
    assert residual_axis_limit([*usual, PlotColumn(value=1.0, bound=40.0)]) < 4.0
    assert residual_axis_limit([*usual[:3], PlotColumn(value=-30.0, bound=40.0)]) > 30.0
    assert residual_axis_limit([PlotColumn(bound=12.0, mark="○")]) > 12.0


def test_a_residual_beyond_its_bound_stands_out() -> None:
    lines = residual_plot(
        [PlotColumn(value=3.0, bound=1.0), PlotColumn(value=0.0, bound=1.0)], 8, 3
    )
    inks = {ink for line in lines for text, ink in line[1:] if text.strip()}
    assert "alarm" in inks
    assert "good" in inks


def test_new_frames_appear_by_themselves(wire: FakeWire, writer: SessionWriter) -> None:
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        night.add_frames(writer, range(FRAMES + 1, FRAMES + 4))
        night.add_previews(writer, range(FRAMES + 3, FRAMES + 4))
        await until(pilot, lambda: len(app.live.night.rows) == FRAMES + 3)
        await until(pilot, lambda: f"frame {FRAMES + 3:04d} · 10 s" in screen_text(app))

    play(wire, scene)


def test_faults_and_lifted_limits_cannot_be_missed(wire: FakeWire) -> None:
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        assert not app.live.query_one("#alert").display
        wire.status |= {"faults": ["camera gave no frame in 12 s"], "lifted": ["sun"]}
        await until(pilot, lambda: "FAULT camera gave no frame" in screen_text(app))
        assert "overridden: sun" in screen_text(app)
        wire.status |= {"faults": [], "lifted": []}
        await until(pilot, lambda: not app.live.query_one("#alert").display)

    play(wire, scene)


def test_every_pane_lies_in_the_terminal_while_it_is_resized(wire: FakeWire) -> None:
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        for width, height in ((200, 60), (40, 12), (61, 17), (20, 5), (80, 24)):
            await pilot.resize_terminal(width, height)
            await pilot.pause()
            lines = screen_text(app).splitlines()
            assert len(lines) <= height
            assert all(len(line) <= width for line in lines)
            assert "TRACK" in lines[0]
            assert "STOP" in lines[-1]

    play(wire, scene)


def test_misses_in_a_row_are_one_line() -> None:
    log: list[LogLine] = []
    cloud = Missed(kind="nothing fits")
    records = [
        *(Miss(frame_id=n, reason=Missed(kind="no detection")) for n in range(1, 6)),
        Miss(frame_id=6, reason=cloud),
        StateChange(
            frame_id=6, before="COAST", after="LOST", reason=Cause(kind="missed", missed=cloud)
        ),
    ]
    for record in records:
        line = line_of(record, night.T0_UTC_NS)
        assert line is not None
        append_line(log, line)
    assert [(line.frame_id, line.text, line.times) for line in log] == [
        (5, "miss: no detection", 5),
        (6, "COAST → LOST: nothing fits the prediction", 1),
    ]


def test_a_neighbour_that_is_not_taken_frame_after_frame_is_one_line() -> None:
    log: list[LogLine] = []
    far, near = NotTaken.by_gate(254.1, 11.8), NotTaken.by_gate(328.9, 11.8)
    other = NotTaken(kind="clipped at start")
    for frame_id, reason in ((7, far), (8, near), (9, other), (10, near)):
        refused = NotFollowed(
            frame_id=frame_id, measurement=geo_measurement(frame_id), reason=reason
        )
        line = line_of(refused, night.T0_UTC_NS)
        assert line is not None
        append_line(log, line)
    assert [(line.frame_id, line.times) for line in log] == [(8, 2), (9, 1), (10, 1)]
    assert log[0].text == "not taken: NIS 328.9 above the gate 11.8"


def _asked(outcome: CommandResult, verb: str = "goto", **arguments: Any) -> LogLine:
    record = OperatorAction(verb=verb, arguments=arguments, outcome=outcome, by="console")
    line = line_of(record, night.T0_UTC_NS)
    assert line is not None
    return line


def test_the_log_says_what_came_of_a_wish_first_and_leaves_out_what_says_nothing() -> None:
    direction = {"ra_icrs_deg": 285.0, "dec_icrs_deg": -5.5}
    plain = _asked(done_result("on its way"), **direction, override=[])
    assert plain.text == "console: go to α 19:00:00.0 δ -05:30:00: on its way"
    lifted = _asked(done_result("on its way"), **direction, override=["sun", "wall"])
    assert lifted.text.endswith("δ -05:30:00, overriding sun, wall: on its way")
    assert _asked(DONE, "hold", override=[]).text == "console: hold"
    assert _asked(DONE, "hold", until="clear").text == "console: hold until it clears"
    assert _asked(DONE, "set", name="detector.tau", value=0).text == "console: detector.tau 0"
    lent = _asked(DONE, "set", name="detector.tau", value=0.05, frames=5)
    assert lent.text == "console: detector.tau 0.05 for 5 frames"
    nudged = _asked(
        done_result("on its way"), "nudge", east_arcmin=-0.029663, north_arcmin=-0.99956
    )
    assert nudged.text == "console: nudge 1′ south: on its way"
    assert _asked(DONE, "nudge", east_arcmin=0.0).text == "console: nudge, east_arcmin 0.0"
    log: list[LogLine] = []
    for line in (_asked(ACCEPTED, **direction), _asked(ACCEPTED, "hold"), plain):
        append_line(log, line)
    assert [line.text for line in log] == ["console: hold: accepted", plain.text]


def test_nothing_that_is_written_in_the_log_reaches_the_terminal_as_a_command() -> None:
    for record in (
        OperatorAction(
            verb="note",
            arguments={"text": "a\x1b]0;b\x07\x9b2J"},
            outcome=done_result("noted"),
            by="x",
        ),
        Event(level="warning", text="driver says \x1b[2J"),
    ):
        line = line_of(record, night.T0_UTC_NS)
        assert line is not None
        assert line.text.isprintable()
    view = read_engine_view({"faults": ["driver says \x1b[2J"], "target": "\x9b2J"})
    assert all(text.isprintable() for text in (*view.faults, view.target or ""))
    outcome = read_outcome(b'{"ok": false, "message": "no: \\u001b[2J\\nwhy", "data": {}}')
    assert outcome.message == "no:  [2J\nwhy"


def test_a_long_line_of_the_log_goes_on_below_and_keeps_every_word() -> None:
    line = _asked(
        CommandResult.refused("the way there passes the Sun at 11 degrees"), ra_icrs_deg=1.0
    )
    for width in (30, 39, 79):
        rows = log_rows(line, width)
        assert all(len(row) <= width for row in rows)
        assert " ".join("".join(rows).split()).count("refused") == 1
        assert all(row.startswith(" " * 10) for row in rows[1:])
    assert " ".join(" ".join(log_rows(line, 39)).split()[1:]) == line.text


# -- the figures -----------------------------------------------------------------------------


def facts(view: NightView, **status: Any) -> str:
    lines = figure_lines(view, read_engine_view(status), None, 80, 3)
    return "\n".join("".join(text for text, _ in line) for line in lines)


def test_where_the_mount_looks_is_shown_when_nothing_is_followed() -> None:
    folded = Night(Path("night"), {}, Config())
    ra, dec, t_utc_ns = 150.0, -5.0, night.t_of(1)
    folded.fold_record(t_utc_ns, night.taken(1, ra, dec))
    shown = facts(folded.view(), now_utc_ns=t_utc_ns)
    sky = altaz_by_astropy(Config().site.to_site(), ra, dec, t_utc_ns - 12 * NS)
    assert "pointing α 10:00:00.0 δ -05:00:00" in shown
    assert f"alt {sky[0]:.1f} az {sky[1]:.1f}" in shown
    assert "as of" not in shown
    assert "as of 02:13:38" in facts(folded.view(), now_utc_ns=t_utc_ns + 600 * NS)
    assert "last pointing α" in facts(folded.view(), now_utc_ns=t_utc_ns + 600 * NS)
    order = SlewCommand(
        frame_id=1, ra_icrs_deg=ra + 15, dec_icrs_deg=dec, t_aim_utc_ns=t_utc_ns, reason="search"
    )
    folded.fold_record(t_utc_ns, order)
    assert "sent to α 11:00:00.0" in facts(folded.view(), now_utc_ns=t_utc_ns)
    assert "pointing" not in facts(folded.view(), ra=150.0, dec=-5.0, now_utc_ns=t_utc_ns)


def altaz_by_astropy(site: Site, ra: float, dec: float, t_utc_ns: int) -> tuple[float, float]:
    from astropy import units
    from astropy.coordinates import AltAz, EarthLocation, SkyCoord
    from astropy.time import Time

    place = EarthLocation.from_geodetic(site.longitude_deg, site.latitude_deg, site.elevation_m)
    frame = AltAz(obstime=Time(t_utc_ns / 1e9, format="unix"), location=place)
    sky = SkyCoord(ra * units.deg, dec * units.deg).transform_to(frame)
    return float(sky.alt.deg), float(sky.az.deg)


def test_a_limit_is_named_when_it_is_near_and_as_what_it_is() -> None:
    def said(limit: str, minutes: int) -> str:
        at_ns = night.t_of(1) + minutes * 60 * NS
        now = {"now_utc_ns": night.t_of(1)}
        return facts(NightView(), next_limit=limit, next_limit_utc_ns=at_ns, **now)

    assert "limit if tracking: pier in 52 min" in said("pier", 52)
    assert "limit" not in said("pier", 203)
    assert "limit if tracking: wall" in said("wall", -1)


def test_panes_never_overlap_and_the_last_to_go_are_state_and_stop() -> None:
    for width in range(20, 210, 7):
        for height in range(3, 70, 3):
            for alert_rows in (0, 1, 2):
                boxes = pane_boxes(width, height, alert_rows=alert_rows)
                cells = [
                    (x, y)
                    for box in boxes.values()
                    for x in range(box.x, box.x + box.width)
                    for y in range(box.y, box.y + box.height)
                ]
                assert len(cells) == len(set(cells)), (width, height)
                assert all(0 <= x < width and 0 <= y < height for x, y in cells)
                assert {"top", "keys"} <= boxes.keys()


def test_a_smaller_terminal_loses_plots_then_picture_then_log() -> None:
    def rows(width: int, height: int) -> dict[str, int]:
        return {name: box.height for name, box in pane_boxes(width, height).items()}

    assert rows(80, 24)["confidence"] > 1
    assert rows(79, 24)["confidence"] == 1
    assert "frame" in rows(60, 16)
    assert "frame" not in rows(59, 16)
    assert "log" in rows(40, 12)
    assert "log" not in rows(40, 9)
    assert "facts" in rows(40, 9)


# -- STOP ------------------------------------------------------------------------------------


def test_stop_is_sent_at_once_and_its_end_is_said_loudly(wire: FakeWire) -> None:
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await pilot.press("x")
        await until(pilot, lambda: "tracks, measured" in stop_text(app))
        assert wire.verbs == ["stop"]
        await pilot.press("escape")
        assert stop_text(app) == ""

    play(wire, scene)


def measuring(wire: FakeWire) -> None:
    """The mount's driver takes the next STOP; how the mount moves is yet to be measured."""
    wire.outcomes["stop"] = Outcome(ok=True, data=ANSWERED | {"ordered_ms": 4.0})
    wire.status |= {"last_stop": {"number": 1, "motion": None}}


@pytest.mark.parametrize(
    ("measured", "words", "is_good"),
    [
        ({"motion": "tracks"}, "STOP the mount tracks, measured in", True),
        ({"motion": "stands"}, "STOP the mount stands, measured in", True),
        (
            {"motion": "moves", "rate_deg_s": 3.96},
            "STOP the mount STILL MOVES at 4.0 deg/s: cut the mount's power",
            False,
        ),
        (
            {"motion": "unknown", "detail": "nothing was heard of it"},
            "STOP NOT KNOWN whether the mount moves (nothing was heard of it): run 'rsoconsole"
            " stop' in another terminal; cut the mount's power if it moves",
            False,
        ),
    ],
)
def test_a_stop_is_answered_and_then_measured(
    wire: FakeWire, measured: dict[str, Any], words: str, is_good: bool
) -> None:
    measuring(wire)

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        banner = app.live.query_one("#stop", StopBanner)
        await pilot.press("x")
        await until(pilot, lambda: "ABORT answered" in stop_text(app))
        assert re.fullmatch(
            r"STOP ABORT answered in \d+ ms by the mount's own process; ordered in \d+ ms:"
            r" measuring \(counted from the key\)",
            stop_text(app),
        )
        await pilot.press("escape")
        assert "measuring" in stop_text(app)  # only what has ended is put away
        assert not banner.has_class("-stopped")
        wire.status |= {"last_stop": {"number": 1, **measured}}
        await until(pilot, lambda: stop_text(app).startswith(words))
        assert banner.has_class("-stopped") is is_good

    play(wire, scene)


def test_another_order_ends_a_stop_that_is_being_measured_and_is_no_alarm(wire: FakeWire) -> None:
    measuring(wire)
    superseded = {"number": 1, "motion": "unknown", "is_over": True, "is_superseded": True}

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await pilot.press("x")
        await until(pilot, lambda: "measuring" in stop_text(app))
        wire.status |= {"last_stop": superseded}
        await until(pilot, lambda: "another order came before STOP" in pane(app, "keys"))
        assert stop_text(app) == ""

    play(wire, scene)


def test_what_an_earlier_press_came_to_is_not_told_of_the_last_one(wire: FakeWire) -> None:
    measuring(wire)

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await pilot.press("x", "x")
        await until(pilot, lambda: "measuring" in stop_text(app))
        news = StopNews(phase="failed", text="NOT KNOWN")
        app.live.on_stop_news_came(StopNewsCame(news, 1))
        assert "measuring" in stop_text(app)
        app.live.on_stop_news_came(StopNewsCame(news, 2))
        assert "NOT KNOWN" in stop_text(app)

    play(wire, scene)


@pytest.mark.parametrize(
    ("dialog", "key"),
    [("f1", "x"), ("q", "ctrl+x"), ("a", "x"), ("p", "x"), ("ctrl+p", "ctrl+x"), ("g", "alt+x")],
)
def test_stop_works_in_every_dialog_and_puts_it_away(wire: FakeWire, dialog: str, key: str) -> None:
    wire.status |= {"holder": "nobody", "state": "IDLE"}
    wire.outcomes["arm"] = Outcome(ok=False, message="not yet", data={"checks": [FAILED_CHECK]})

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.holder == "nobody")
        await pilot.press(dialog)
        await until(pilot, lambda: app.screen is not app.live)
        await pilot.press(key)
        await until(pilot, lambda: "tracks, measured" in stop_text(app))
        assert app.screen is app.live
        assert wire.verbs[-1] == "stop"

    play(wire, scene)


def test_the_letter_is_a_letter_in_a_field_and_ctrl_x_stops_there(wire: FakeWire) -> None:
    class FieldScreen(Screen[None]):
        def compose(self) -> Iterator[Input]:  # type: ignore[override]
            yield Input("cut me")

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await app.push_screen(FieldScreen())
        field = app.screen.query_one(Input)
        field.focus()
        await pilot.press("end", "x")
        assert field.value == "cut mex"
        assert wire.verbs == []
        await pilot.press("ctrl+x")
        await until(pilot, lambda: "tracks, measured" in stop_text(app))
        assert wire.verbs == ["stop"]

    play(wire, scene)


def test_a_late_stop_says_so_and_names_the_way_without_the_engine(wire: FakeWire) -> None:
    wire.hangs["stop"] = threading.Event()

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await pilot.press("x")
        await until(pilot, lambda: "NO ANSWER YET" in stop_text(app))
        assert "rsoconsole stop" in stop_text(app)
        wire.hangs["stop"].set()
        await until(pilot, lambda: "tracks, measured" in stop_text(app))

    play(wire, scene)


def test_a_stop_that_is_not_answered_is_never_called_a_stop(wire: FakeWire) -> None:
    wire.outcomes["stop"] = Outcome(ok=False, message="the mount moves on", data={})

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await pilot.press("x")
        await until(pilot, lambda: "NOT KNOWN" in stop_text(app))
        assert "the mount moves on" in stop_text(app)
        assert "measured" not in stop_text(app)

    play(wire, scene)


def test_stop_goes_past_an_engine_that_hangs(wire: FakeWire) -> None:
    wire.hangs["stop"] = threading.Event()
    asked: list[Any] = []
    is_measured = threading.Event()

    def directly(on_found: Callable[[Found], None], indi: Any) -> None:
        asked.append(indi)
        found = {"is_answered": True, "path": "indi"}
        on_found(found)
        is_measured.wait(PATIENCE_S)
        on_found(found | {"motion": "tracks"})

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await pilot.press("x")
        await until(pilot, lambda: "past the engine" in stop_text(app) and asked != [])
        await until(pilot, lambda: "ABORT answered in" in stop_text(app))
        assert stop_text(app).endswith(
            "by a connection past the engine (a second INDI connection): measuring"
        )
        is_measured.set()
        await until(pilot, lambda: "tracks, measured" in stop_text(app))
        assert asked[0].port == 7624
        wire.hangs["stop"].set()

    play(wire, scene, stop_directly=directly)


def test_a_stop_that_fails_on_both_ways_is_not_known(wire: FakeWire) -> None:
    wire.outcomes["stop"] = Outcome(ok=False, message="the mount's process is gone")

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await pilot.press("x")
        await until(pilot, lambda: "NOT KNOWN" in stop_text(app))
        assert "process is gone" in stop_text(app)
        assert "no server" in stop_text(app)

    def directly(on_found: Callable[[Found], None], _indi: Any) -> None:
        on_found({"is_answered": False, "path": "indi", "detail": "no server"})

    play(wire, scene, stop_directly=directly)


def test_stop_ends_every_notice_and_what_was_asked_before_it_is_not_reported_after_it(
    wire: FakeWire,
) -> None:
    wire.status |= {"holder": "nobody", "state": "IDLE"}
    wire.outcomes["arm"] = Outcome(ok=True, message="armed from the next cycle")
    wire.hangs["arm"] = threading.Event()

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.holder == "nobody")
        await pilot.press("a")
        assert "arm …" in pane(app, "keys")
        await pilot.press("x")
        await until(pilot, lambda: "tracks, measured" in stop_text(app))
        assert "arm …" not in pane(app, "keys")
        wire.hangs["arm"].set()
        await pilot.pause(0.3)
        assert "armed from" not in screen_text(app)
        assert "tracks, measured" in stop_text(app)
        assert pane(app, "keys").split() == screen_text(app).splitlines()[-1].split()
        assert "F1 Help" in pane(app, "keys")

    play(wire, scene)


@pytest.mark.parametrize("is_measured", [True, False])
def test_state_and_holder_are_seen_beside_a_stop_and_only_a_measured_one_goes_by_itself(
    wire: FakeWire, monkeypatch: pytest.MonkeyPatch, is_measured: bool
) -> None:
    monkeypatch.setattr(seat, "BANNER_S", 2.0)
    wire.status |= {"lifted": ["sun"]}
    if not is_measured:
        wire.outcomes["stop"] = Outcome(ok=False, message="the mount moves on", data={})
    end, first = ("tracks, measured", "the mount") if is_measured else ("NOT KNOWN", "NOT")

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await pilot.press("x")
        await until(pilot, lambda: end in stop_text(app))
        # What the engine said last is from before the STOP: its next word is waited for.
        shown = ("TRACK", "AUTO has the mount", "a Disarm")
        if is_measured:
            wire.status |= {"state": "IDLE", "holder": "nobody"}
            shown = ("IDLE", "nobody has the mount", "a Arm")
        await until(pilot, lambda: shown[1] in pane(app, "top"))
        text = screen_text(app)
        for words in (*shown, f"STOP {first}"):
            assert words in text
        if is_measured:
            await until(pilot, lambda: stop_text(app) == "")
        else:
            await pilot.pause(0.7)
            assert end in stop_text(app)

    play(wire, scene, (60, 20) if is_measured else (40, 12))


def test_what_came_of_a_stop_never_covers_the_first_lines_nor_the_keys() -> None:
    for width in (20, 40, 60, 71, 72, 80, 200):
        for height in range(4, 61):
            for alert_rows in (0, 1, 2):
                boxes = pane_boxes(width, height, alert_rows=alert_rows)
                banner = banner_box(width, height, alert_rows=alert_rows)
                assert banner.height >= 1
                assert banner.y >= boxes["top"].height
                assert banner.y + banner.height <= boxes["keys"].y
                if "alert" in boxes and height >= 12:
                    assert banner.y >= boxes["alert"].y + boxes["alert"].height


# -- the keys --------------------------------------------------------------------------------


def test_in_a_narrow_terminal_the_weighty_keys_stay_and_a_notice_leaves_what_it_can() -> None:
    def said(width: int, notice: str = "", **status: Any) -> str:
        engine = read_engine_view({"holder": "autonomy", **status})
        build = key_line(live_keys(engine, can_act=True), (notice, "title"))
        (line,) = build(width, 1)
        text = "".join(text for text, _ in line)
        assert len(text) <= width
        return text

    assert said(40).split() == ["x", "STOP", "a", "Disarm", "q", "Leave", "F1", "Help"]
    assert "g Go to" in said(80)
    assert "^p More" in said(120)
    assert "h Resume" in said(80, is_held=True)
    # In a terminal of a few lines alone a notice takes the place of keys.
    assert said(40, "hold: done").split() == ["x", "STOP", "hold:", "done"]
    assert all("x" in said(width).split() for width in range(4, 80))


def test_a_notice_stands_over_the_keys_and_eats_none(wire: FakeWire) -> None:
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: "a Disarm" in pane(app, "keys"))
        keys = pane(app, "keys")
        await pilot.press("f")
        await until(pilot, lambda: pane(app, "keys") == f" stretch: asinh\n{keys}")
        await pilot.press("f")
        await until(pilot, lambda: "stretch: linear" in pane(app, "keys"))
        rows = screen_text(app).splitlines()
        assert rows[-2].startswith(" stretch: linear")
        assert rows[-1] == keys.rstrip()
        await pilot.press("escape")
        await until(pilot, lambda: pane(app, "keys") == keys)

    play(wire, scene)


def test_what_was_said_of_a_pane_ends_with_it(wire: FakeWire) -> None:
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        await pilot.press("t", "enter")
        await until(pilot, lambda: "nothing is tried" in pane(app, "keys"))
        await pilot.press("escape")
        await until(pilot, lambda: "nothing is tried" not in pane(app, "keys"))

    play(wire, scene)


def test_what_is_too_long_loses_its_middle_and_never_the_remedy() -> None:
    text = (
        "FAULT frame 12 is not solved: 3 stars, 8 needed, and so on for quite a while -> lens cap, "
        "focus, cloud? Check optics.focal_length_mm"
    )
    for width in (40, 60):
        rows = ["".join(text for text, _ in row) for row in wrap_to_rows(text, width, 2)]
        assert len(rows) == 2
        assert all(len(row) <= width for row in rows)
        assert rows[0].startswith("FAULT frame 12")
        assert rows[1].endswith("optics.focal_length_mm")
        assert "…" in " ".join(rows)
    assert wrap_to_rows("short", 20, 1) == [[("short", "")]]
    assert len(wrap_to_rows("x" * 90, 20, 2)) == 2


def test_h_holds_and_resumes_and_the_first_line_says_held(wire: FakeWire) -> None:
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: "h Hold" in pane(app, "keys"))
        await pilot.press("h")
        await until(pilot, lambda: wire.verbs == ["hold"])
        wire.status |= {"is_held": True}
        await until(pilot, lambda: "TRACK 3m37 HELD" in pane(app, "top"))
        await pilot.press("h")
        await until(pilot, lambda: wire.verbs == ["hold", "resume"])
        wire.status |= {"is_held": False, "holder": "nobody", "state": "IDLE"}
        await until(pilot, lambda: app.live.engine.holder == "nobody")
        assert "HELD" not in pane(app, "top")
        await pilot.press("h")
        assert "nothing to hold" in pane(app, "keys")
        assert wire.verbs == ["hold", "resume"]

    play(wire, scene)


def test_p_parks_only_after_it_has_asked(wire: FakeWire) -> None:
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        for keys in (["p", "escape"], ["enter"]):
            await pilot.press("p")
            await can_answer(app, pilot)
            await pilot.press(*keys)
            await until(pilot, lambda: app.screen is app.live)
            assert wire.verbs == []
        await pilot.press("p")
        await can_answer(app, pilot)
        await pilot.press("y")
        await until(pilot, lambda: wire.verbs == ["park"])
        await until(pilot, lambda: "park: done" in pane(app, "keys"))

    play(wire, scene)


# -- arming ----------------------------------------------------------------------------------

FAILED_CHECK = {
    "name": "sun",
    "ok": False,
    "detail": "the Sun stands 4 deg below the horizon",
    "remedy": "wait 40 min",
}


def test_a_arms_an_idle_engine_and_disarms_an_armed_one(wire: FakeWire) -> None:
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: "a Disarm" in pane(app, "keys"))
        wire.status |= {"state": "SEARCH"}
        await until(pilot, lambda: app.live.engine.state == "SEARCH")
        await pilot.press("a")
        await until(pilot, lambda: wire.verbs == ["disarm"])
        wire.status |= {"holder": "nobody", "state": "IDLE"}
        await until(pilot, lambda: app.live.engine.holder == "nobody")
        await asyncio.sleep(RELEASED_S)
        await pilot.press("a")
        await until(pilot, lambda: wire.verbs == ["disarm", "arm"])
        await until(pilot, lambda: "arm: done" in pane(app, "keys"))

    play(wire, scene)


def test_refused_arming_shows_the_checks_and_overrides_those_that_are_ticked(
    wire: FakeWire,
) -> None:
    wire.status |= {"holder": "nobody", "state": "IDLE"}
    passed = {"name": "site", "ok": True, "detail": "equal", "remedy": ""}
    disk = {"name": "disk", "ok": False, "detail": "3 GB free", "remedy": "free 40 GB"}
    wire.outcomes["arm"] = Outcome(
        ok=False, message="2 checks failed", data={"checks": [passed, FAILED_CHECK, disk]}
    )

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.holder == "nobody")
        await pilot.press("a")
        await until(pilot, lambda: app.screen is not app.live)
        boxes = list(app.screen.query(Tick))
        assert len(boxes) == 2
        assert "wait 40 min" in "\n".join(str(s.render()) for s in app.screen.query(".remedy"))
        boxes[0].focus()
        await can_answer(app, pilot)
        await pilot.press("space")
        assert str(boxes[0].render()).startswith("[x] sun")
        assert str(boxes[1].render()).startswith("[ ] disk")
        wire.outcomes["arm"] = Outcome(ok=True, message="armed from the next cycle")
        app.screen.query_one("#arm", Button).focus()
        await pilot.press("enter")
        await until(pilot, lambda: wire.sent[-1] == ("arm", {"override": ["sun"]}))
        await until(pilot, lambda: app.screen is app.live)

    play(wire, scene)


def test_a_seat_that_only_looks_sends_nothing_but_stop(wire: FakeWire) -> None:
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await pilot.press("a")
        assert "this console only looks" in pane(app, "keys")
        await until(pilot, lambda: "(read only)" in pane(app, "top"))
        await pilot.press("x")
        await until(pilot, lambda: "tracks, measured" in stop_text(app))
        assert wire.verbs == ["stop"]
        await pilot.press("q")

    assert play(wire, scene, read_only=True) == "quit"


# -- leaving ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("keys", "sent", "ending"),
    [
        (["q", "enter"], [], "quit"),
        (["q", "l"], [], "quit"),
        (["q", "s"], ["shutdown"], "stop engine"),
        (["q", "escape"], [], None),
        (["ctrl+c", "down", "down", "enter"], [], None),
    ],
)
def test_leaving_asks_what_becomes_of_the_engine(
    wire: FakeWire, keys: list[str], sent: list[str], ending: str | None
) -> None:
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        await pilot.press(keys[0])
        await can_answer(app, pilot)
        await pilot.press(*keys[1:])
        await until(pilot, lambda: wire.verbs == sent)
        if ending is not None:
            await until(pilot, lambda: app.return_value is not None)

    assert play(wire, scene) == ending


def test_the_palette_knows_every_action_and_quits_nothing_unasked(wire: FakeWire) -> None:
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        names = {command.title for command in app.get_system_commands(app.live)}
        assert names >= {"STOP", "Arm or disarm", "Log", "Leave", "Help", "Colours"}
        await until(pilot, lambda: app.live.engine.is_attached)
        await pilot.press("ctrl+p", *"leave")
        await pilot.pause(0.3)
        await pilot.press("enter")
        await until(pilot, lambda: isinstance(app.screen, LeaveDialog))
        assert wire.verbs == []
        # What it says of the engine is as new as the first line.
        wire.status |= {"state": "IDLE", "holder": "nobody"}
        state = app.screen.query_one("#state", Static)
        await until(pilot, lambda: "IDLE, nobody has the mount" in str(state.render()))

    play(wire, scene)


def test_an_engine_that_does_not_end_keeps_the_seat_open(wire: FakeWire) -> None:
    wire.outcomes["shutdown"] = Outcome(ok=False, message="not while the dome moves")

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        await pilot.press("q")
        await can_answer(app, pilot)
        await pilot.press("s")
        await until(pilot, lambda: wire.verbs == ["shutdown"] and app.screen is not app.live)
        assert app.return_value is None

    assert play(wire, scene) is None


# -- an engine that vanishes -----------------------------------------------------------------


def test_a_vanished_engine_is_said_and_its_night_stays(wire: FakeWire) -> None:
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        wire.is_gone = True
        await until(pilot, lambda: "ENGINE GONE" in pane(app, "top"))
        assert "was TRACK" in pane(app, "top")
        assert "AUTO has the mount" not in pane(app, "top")
        await until(pilot, lambda: "rsoconsole engine" in screen_text(app))
        assert len(app.live.night.rows) == FRAMES
        await pilot.press("a")
        assert wire.verbs == []
        await pilot.press("x")
        await until(pilot, lambda: "NOT KNOWN" in stop_text(app))

    play(wire, scene)


def test_an_engine_that_only_starts_is_waited_for(wire: FakeWire) -> None:
    wire.is_gone = True

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: "waiting for the engine" in pane(app, "top"))
        await pilot.pause(0.2)
        assert "GONE" not in screen_text(app)
        wire.is_gone = False
        await until(pilot, lambda: "AUTO has the mount" in pane(app, "top"))

    play(wire, scene)


def test_an_engine_that_never_comes_is_called_gone(
    wire: FakeWire, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(watch, "STARTING_S", 0.2)
    wire.is_gone = True

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: "ENGINE GONE" in pane(app, "top"))

    play(wire, scene)


def test_a_dead_and_a_hanging_engine_are_told_apart_on_the_real_wire(
    wire: FakeWire, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(watch, "ANSWER_S", 0.1)
    hangs = threading.Event()

    def handle(_request: Request) -> Outcome:
        if hangs.is_set():
            time.sleep(1.0)
        return Outcome(ok=True, data=dict(wire.status))

    socket = tmp_path / "engine.sock"
    server = ControlServer(socket, handle)
    server.start()

    async def run() -> None:
        app = ConsoleApp(lambda: ControlClient(socket, sender=Sender(name="console")))
        async with opened(app, FULL) as pilot:
            await until(pilot, lambda: "AUTO has the mount" in pane(app, "top"))
            hangs.set()
            await until(pilot, lambda: "ENGINE SILENT" in pane(app, "top"))
            hangs.clear()
            await until(pilot, lambda: "AUTO has the mount" in pane(app, "top"))
            server.close()
            await until(pilot, lambda: "ENGINE GONE" in pane(app, "top"))

    asyncio.run(run())


def test_a_new_engine_brings_its_new_session(wire: FakeWire, tmp_path: Path) -> None:
    second = night.begin(tmp_path / "second")
    second.append(
        StateChange(
            frame_id=0,
            before="IDLE",
            after="SEARCH",
            reason=Cause(kind="instrument", detail="the second night"),
        ),
        night.t_of(100),
    )
    assert second.flush()

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        wire.is_gone = True
        await until(pilot, lambda: "ENGINE GONE" in pane(app, "top"))
        wire.status |= {"session": str(second.folder), "state": "SEARCH"}
        wire.is_gone = False
        await until(pilot, lambda: "the second night" in screen_text(app))
        assert app.live.night.rows == ()
        assert app.live.picture is None
        assert "SEARCH" in pane(app, "top")

    play(wire, scene)
    second.close()


def test_a_session_that_vanishes_is_said_and_the_seat_goes_on(wire: FakeWire) -> None:
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        wire.status |= {"session": "/nowhere/at/all"}
        await until(pilot, lambda: "does not exist" in screen_text(app))
        assert "TRACK" in pane(app, "top")

    play(wire, scene)


def test_a_fault_that_is_over_is_said_no_more(
    wire: FakeWire, monkeypatch: pytest.MonkeyPatch
) -> None:
    plain, broken = SessionReader.records, [True]

    def records(self: SessionReader, *arguments: Any, **named: Any) -> Any:
        if broken[0]:
            raise SessionError("the disk hangs")
        return plain(self, *arguments, **named)

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.night.is_read)
        monkeypatch.setattr(SessionReader, "records", records)
        await until(pilot, lambda: "the disk hangs" in pane(app, "alert"))
        broken[0] = False
        await until(pilot, lambda: not app.live.query_one("#alert").display)

    play(wire, scene)


def test_without_an_engine_the_console_says_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(ControlError, match=r"'rsoconsole engine'.*'rsoconsole demo'"):
        run_console(socket=tmp_path / "engine.sock")


def test_a_folder_without_a_session_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SessionError, match="holds no"):
        run_console(session=tmp_path)


def test_without_a_terminal_the_console_names_what_works_there(
    told_night: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO())
    with pytest.raises(RsoconsoleError, match="rsoconsole status"):
        run_console(session=told_night)


# -- a recorded session ----------------------------------------------------------------------


def test_a_named_session_is_shown_without_asking_any_engine(
    wire: FakeWire, writer: SessionWriter
) -> None:
    wire.is_gone = True

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        assert "read only" in pane(app, "top")
        writer.close()
        await until(pilot, lambda: "RECORDED: TRACK" in pane(app, "top"))
        await pilot.press("q")

    assert play(wire, scene, session=writer.folder) == "quit"


# -- the log ---------------------------------------------------------------------------------


def test_the_log_opens_over_all_panes_and_scrolls(wire: FakeWire) -> None:
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await pilot.resize_terminal(80, 6)
        await pilot.press("l")
        log = app.live.query_one("#log", LogPane)
        assert not app.live.query_one("#frame").display
        assert "measured again" in screen_text(app)
        assert "armed by operator" not in screen_text(app)
        await pilot.press("end")
        await until(pilot, lambda: "armed by operator" in screen_text(app))
        await pilot.press("l")
        await pilot.resize_terminal(*FULL)
        await pilot.pause()
        assert app.live.query_one("#frame").display
        assert log.scroll_offset.y == 0

    play(wire, scene)
