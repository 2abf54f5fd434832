"""An alarm is said once, names the state, and ends with its cause."""

import dataclasses
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from textual.pilot import Pilot

from rsoconsole.base import InstrumentError
from rsoconsole.console.app import ConsoleApp
from rsoconsole.console.dialogs.dialogs import ArmDialog, MessageDialog
from rsoconsole.console.words.facts import figure_lines
from rsoconsole.console.words.words import alert_text
from rsoconsole.control import ON_RECORD, Outcome, Seek, mount_words, read_status
from rsoconsole.engine.tasks.watch import Watch
from rsoconsole.instruments import MountReport, StopResult
from rsoconsole.instruments.motion import Motion
from rsoconsole.instruments.ports import ignore_stop_result
from rsoconsole.night import LogLine, line_of
from rsoconsole.night.log_lines import append_line
from rsoconsole.records import (
    CommandResult,
    Event,
    HiddenBy,
    Miss,
    Missed,
    NotSolved,
    OperatorAction,
    ParameterChange,
    done_result,
)
from rsoconsole.session import SessionWriter
from tests.makers import NS
from tests.nights import made_up_night as night
from tests.rigs.engine_rig import Rig, asked, command_handler_of, heed_alarms, rig
from tests.rigs.seat_rig import FRAMES, FakeWire, pane, play, stop_text, until

SERVER_IS_GONE = "no INDI server answers at 127.0.0.1:7624: start indiserver"


@pytest.fixture
def tracking() -> Rig:
    r = rig(set(range(1, 60)))
    r.engine.arm()
    r.engine.run(frames=6)
    return r


def lines_of(r: Rig) -> list[LogLine]:
    log: list[LogLine] = []
    for record in r.memory.records:
        line = line_of(record, 0)
        if line is not None:
            append_line(log, line)
    return log


def lose_the_server(r: Rig) -> Any:
    """Neither mount nor camera answers; gives what brings them back."""
    report, start = r.mount.report, r.camera.start_exposure

    def dead(*_: Any, **__: Any) -> Any:
        raise InstrumentError(SERVER_IS_GONE)

    r.mount.report = r.camera.start_exposure = dead  # type: ignore[method-assign]

    def back() -> None:
        r.mount.report, r.camera.start_exposure = report, start  # type: ignore[method-assign]

    return back


def test_a_server_that_is_gone_is_said_once_and_over_when_it_is_back(tracking: Rig):
    back = lose_the_server(tracking)
    with pytest.raises(InstrumentError, match="FAULT"):
        tracking.engine.run(frames=20)
    status = command_handler_of(tracking).status()
    assert (status.state, status.faults) == ("FAULT", (SERVER_IS_GONE,))
    said = [line for line in lines_of(tracking) if SERVER_IS_GONE in line.text]
    passage = [line for line in said if "FAULT" in line.text]
    assert [line.level for line in passage] == ["alarm"]
    assert len(said) <= 3  # the watch's word, the first failure, the fault
    tracking.engine.watch.look()
    tracking.engine._see_whether_over()
    back()
    tracking.engine.watch.look()
    tracking.engine._see_whether_over()
    status = command_handler_of(tracking).status()
    assert (status.state, status.faults, status.kept) == ("FAULT", (), "track 1")
    told = read_status(command_handler_of(tracking).handle(asked("status")).data)
    assert told.mount_ra_icrs_deg == pytest.approx(tracking.mount.at_deg[0])
    tracking.engine.arm()
    assert tracking.engine.status().state == "SEARCH"


def test_a_fault_of_the_camera_is_not_over_because_the_mount_answers(tracking: Rig):
    tracking.camera.broken_for = 3
    with pytest.raises(InstrumentError, match="FAULT"):
        tracking.engine.run(frames=20)
    tracking.engine.watch.look()
    tracking.engine._see_whether_over()
    assert len(tracking.engine.status().faults) == 1
    tell(tracking, "disarm")
    assert tracking.engine.status().faults == ()


def tell(r: Rig, verb: str) -> Outcome:
    answer = command_handler_of(r).handle(asked(verb))
    r.engine.commands.execute_waiting()
    return answer


def test_a_stop_that_is_not_answered_is_a_fault_until_the_mount_is_measured_to_stand(tracking: Rig):
    abort = tracking.mount.abort

    def unsure(
        *_: Any, on_news: Callable[[StopResult], None] = ignore_stop_result, **__: Any
    ) -> StopResult:
        silent = StopResult(is_answered=False, ms=800.0, path="mount", detail="the mount is silent")
        on_news(dataclasses.replace(silent, motion=Motion(), measured_ms=10_000.0))
        return silent

    tracking.mount.abort = unsure  # type: ignore[method-assign]
    command_handler = command_handler_of(tracking)
    assert not command_handler.handle(asked("stop")).ok
    heed_alarms(tracking)
    status = command_handler.status()
    assert (status.state, status.holder) == ("FAULT", "nobody")
    assert "power" in status.faults[0]
    assert status.last_stop is not None
    assert not status.last_stop.is_over
    tracking.mount.abort = abort  # type: ignore[method-assign]
    tracking.clock.t_utc_ns += 2 * NS
    tracking.engine.watch.look()
    tracking.engine._see_whether_over()
    status = command_handler.status()
    assert (status.state, status.faults, status.kept) == ("IDLE", (), "track 1")
    assert status.last_stop is not None
    assert status.last_stop.is_over


def test_a_watch_that_sees_nothing_says_so(tracking: Rig):
    watch: Watch = tracking.engine.watch
    back = lose_the_server(tracking)
    watch.look()
    assert watch.is_blind
    back()
    watch.look()
    assert not watch.is_blind


def test_the_banner_of_a_stop_ends_when_the_mount_is_measured_to_stand(wire: FakeWire):
    wire.outcomes["stop"] = Outcome(ok=False, message="the mount is silent")
    wire.status |= {"mount_ra_icrs_deg": 150.0, "mount_dec_icrs_deg": 20.0, "is_slewing": False}
    wire.status |= {"mount_motion": "moves", "mount_rate_deg_s": 0.5}

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        at_ns = wire.status["now_utc_ns"]
        wire.status |= {"mount_t_utc_ns": at_ns}
        await pilot.press("x")
        await until(pilot, lambda: "NOT KNOWN" in stop_text(app))
        wire.status |= {"now_utc_ns": at_ns + 3 * NS}
        await until(pilot, lambda: app.live.engine.now_utc_ns == at_ns + 3 * NS)
        assert "NOT KNOWN" in stop_text(app)
        wire.status |= {"mount_t_utc_ns": at_ns + 3 * NS}
        await until(pilot, lambda: app.live.engine.mount_t_utc_ns == at_ns + 3 * NS)
        # Its driver says that it does not slew: that is a claim.
        assert "NOT KNOWN" in stop_text(app)
        wire.status |= {"mount_motion": "stands", "mount_rate_deg_s": None}
        await until(pilot, lambda: "the mount is at rest" in stop_text(app))
        assert "RA 10:00:00.0 Dec +20:00:00" in stop_text(app)

    play(wire, scene)


def test_the_banner_says_a_fault_once_and_that_it_is_over():
    from rsoconsole.console.night.engine_view import read_engine_view
    from rsoconsole.night import NightView

    fault = {"state": "FAULT", "faults": [SERVER_IS_GONE] * 3, "session": "/n"}
    assert alert_text(NightView(), read_engine_view(fault)).count("start indiserver") == 1
    said = alert_text(NightView(), read_engine_view(fault | {"faults": []}))
    assert "the cause of the FAULT is over" in said


def test_the_mount_s_own_word_is_told_with_its_age():
    slewing = {
        "mount_ra": 46.6304,
        "mount_dec": 15.0786,
        "mount_alt_deg": 55.0,
        "mount_az_deg": 150.0,
        "mount_t_utc_ns": night.t_of(3),
        "now_utc_ns": night.t_of(3) + NS,
        "is_slewing": True,
        "slew_left_s": 23.4,
    }
    assert mount_words(read_status(slewing)) == (
        "mount RA 03:06:31.3 Dec +15:04:43",
        "alt 55.0 az 150.0",
        "slewing, 23 s left",
    )
    silent = mount_words(read_status(slewing | {"now_utc_ns": night.t_of(3) + 30 * NS}))
    assert "silent since " in silent[-1]
    assert mount_words(read_status({})) == ()


@pytest.mark.parametrize(("width", "rows"), [(80, 3), (120, 5), (60, 12)])
def test_where_the_mount_stands_is_on_the_screen_also_when_nothing_is_followed(
    width: int, rows: int
):
    from rsoconsole.console.night.engine_view import read_engine_view
    from rsoconsole.night import NightView

    at_rest = {
        "state": "IDLE",
        "mount_ra": 46.6304,
        "mount_dec": 15.0786,
        "mount_alt_deg": 55.0,
        "mount_az_deg": 150.0,
        "mount_t_utc_ns": night.t_of(3),
        "now_utc_ns": night.t_of(3) + NS,
        "mount_motion": "stands",
    }
    lines = figure_lines(NightView(), read_engine_view(at_rest), None, width, rows)
    text = "\n".join("".join(part for part, _ in line) for line in lines)
    assert "mount RA 03:06:31.3 Dec +15:04:43" in text
    assert "stands, measured" in text


def test_the_mount_says_how_long_a_slew_still_takes():
    r = rig(set())
    r.engine.arm()
    r.engine.run(frames=2)
    there = r.mount.at_deg
    sent, _ = r.engine.instrument_controller.sent or ((0.0, 0.0), 0)
    r.engine.watch.last_report = MountReport(
        t_utc_ns=r.clock.t_utc_ns,
        ra_icrs_deg=there[0],
        dec_icrs_deg=sent[1] + 20.0,
        is_slewing=True,
        is_parked=False,
        is_tracking=False,
        pier_side=r.mount.pier_side,
    )
    rate = r.engine.config.mount.slew_rate_deg_s
    assert r.engine.status().slew_left_s == pytest.approx(20.0 / rate, rel=0.01)


def test_one_thing_is_one_line_of_the_log():
    change = ParameterChange(name="detector.tau", before=0.1, after=0.2, by="console a@b")
    arguments = {"name": "detector.tau", "value": 0.2}
    log: list[LogLine] = []
    for record in (
        OperatorAction(
            verb="set",
            arguments=arguments,
            outcome=CommandResult(kind="accepted"),
            by="console a@b",
        ),
        change,
        OperatorAction(verb="set", arguments=arguments, outcome=done_result(""), by="console a@b"),
    ):
        line = line_of(record, 0)
        assert line is not None
        append_line(log, line)
    assert [line.text for line in log] == ["a@b: detector.tau 0.1 → 0.2"]


def test_a_track_in_cloud_writes_one_line_however_many_stars_are_left():
    log: list[LogLine] = []
    for number, stars in enumerate((4, 3, 0, 5), start=7):
        cloud = HiddenBy(kind="fewer stars", stars=stars, usual_stars=400)
        missed = Missed(kind="no detection", hidden_by=(cloud,))
        for record in (
            NotSolved(frame_id=number, reason=f"{stars} stars, 8 needed", ms=1.0),
            Miss(frame_id=number, reason=missed),
        ):
            line = line_of(record, 0)
            assert line is not None
            append_line(log, line)
    assert [(line.text, line.times, line.frame_id) for line in log] == [
        ("miss: cloud: 5 stars where 400 were; no detection", 4, 10)
    ]


def test_clouds_write_one_line_for_all_frames_in_a_row_that_were_not_solved():
    log: list[LogLine] = []
    for number, stars in enumerate((4, 3, 0, 5), start=7):
        line = line_of(NotSolved(frame_id=number, reason=f"{stars} stars, 8 needed", ms=1.0), 0)
        assert line is not None
        append_line(log, line)
    told = line_of(Event(level="info", text="on it goes"), 0)
    assert told is not None
    append_line(log, told)
    assert [(line.text, line.times, line.frame_id) for line in log] == [
        ("not plate-solved: 5 stars, 8 needed", 4, 10),
        ("on it goes", 1, None),
    ]


def test_a_command_that_is_refused_later_is_said_over_the_keys(
    wire: FakeWire, writer: SessionWriter, tmp_path: Path
):
    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached)
        await until(pilot, lambda: app.live.night.is_read)
        for by in ("console other@tty", "console me@tty"):
            writer.append(
                OperatorAction(
                    verb="choose",
                    arguments={"frame": FRAMES, "x": 1.0, "y": 2.0},
                    outcome=CommandResult.refused("the frame was not solved"),
                    by=by,
                ),
                night.t_of(FRAMES) + 9 * NS,
            )
        await until(pilot, lambda: "refused: the frame was not solved" in pane(app, "keys"))
        writer.append(Event(level="info", text="on it goes"), night.t_of(FRAMES) + 10 * NS)

    play(wire, scene, seat_name="me@tty")


def refused_on_record(verb: str, why: str, by: str = "console me@tty", **arguments: Any) -> Any:
    outcome = CommandResult.refused(why)
    return OperatorAction(verb=verb, arguments=arguments, outcome=outcome, by=by)


@pytest.mark.parametrize("is_read_first", [False, True])
def test_a_refusal_that_a_dialog_has_said_is_not_said_again_when_it_is_read(
    wire: FakeWire, writer: SessionWriter, is_read_first: bool
):
    """Neither where its record is read after the answer came, nor where it is read before."""
    wire.status |= {"holder": "nobody", "state": "IDLE"}
    why = "sun: it is day"
    wire.outcomes["arm"] = Outcome(ok=False, message=why, data={ON_RECORD: True, "checks": []})
    if is_read_first:
        wire.hangs["arm"] = threading.Event()
    t_ns = night.t_of(FRAMES) + 9 * NS

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.holder == "nobody" and app.live.night.is_read)
        await pilot.press("a")
        if is_read_first:
            await until(pilot, lambda: "arm" in wire.verbs)
        else:
            await until(pilot, lambda: isinstance(app.screen, ArmDialog))
        writer.append(refused_on_record("arm", why, override=[]), t_ns)
        writer.append(refused_on_record("seek", "another's", "console somebody-me@tty"), t_ns)
        writer.append(Event(level="info", text="on it goes"), t_ns)
        await until(pilot, lambda: any("on it goes" in x.text for x in app.live.night.log))
        if is_read_first:
            wire.hangs["arm"].set()
            await until(pilot, lambda: isinstance(app.screen, ArmDialog))
        assert app.live.notice[0] == "not armed"
        # What was asked for before, and is refused now, is news.
        writer.append(refused_on_record("arm", "the dome moves", override=[]), t_ns + NS)
        await until(pilot, lambda: "the dome moves" in app.live.notice[0])

    play(wire, scene, seat_name="me@tty")


def test_what_never_goes_on_record_hides_no_refusal_to_come(wire: FakeWire, writer: SessionWriter):
    wire.outcomes["seek"] = Outcome(ok=False, message="out of reach")

    async def scene(app: ConsoleApp, pilot: Pilot[str]) -> None:
        await until(pilot, lambda: app.live.engine.is_attached and app.live.night.is_read)
        app.live.send(Seek())
        await until(pilot, lambda: isinstance(app.screen, MessageDialog))
        writer.append(refused_on_record("seek", "nothing was followed"), night.t_of(FRAMES) + NS)
        await until(pilot, lambda: "nothing was followed" in app.live.notice[0])

    play(wire, scene, seat_name="me@tty")
