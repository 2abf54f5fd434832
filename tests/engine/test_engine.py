"""The loop against instruments that live in this test: failures, STOP, tunables, pointing."""

import dataclasses
from typing import Any

import pytest

from rsoconsole.base import InstrumentError
from rsoconsole.config import Config
from rsoconsole.control import Seek
from rsoconsole.engine.tasks.pace import config_with_setting
from rsoconsole.instruments import MountReport, StopResult
from rsoconsole.instruments.motion import Motion
from rsoconsole.pipeline import Reduction
from rsoconsole.records import (
    CommandResult,
    Event,
    Frame,
    FrameTaken,
    NotSolved,
    OperatorAction,
    ParameterChange,
    SlewCommand,
    StateChange,
)
from rsoconsole.sky import hour_angle_icrs_deg, separation_deg
from rsoconsole.words import text
from tests.makers import NS, T0_UTC_NS, geo_measurement
from tests.rigs.engine_rig import (
    CONFIG,
    SITE,
    START_DEG,
    Rig,
    asked,
    command_handler_of,
    end_when_idle,
    heed_alarms,
    rig,
    solution_at,
    told,
)


def test_it_searches_locks_follows_and_coasts():
    r = rig({3, 4, 5, 6, 8})
    r.engine.arm()
    r.engine.run(frames=8)
    states = [change.after for change in r.memory.of(StateChange)]
    assert states == ["SEARCH", "ACQUIRE", "TRACK", "COAST", "TRACK"]


def test_the_slew_meets_the_satellite_at_the_middle_of_the_exposure():
    """The aim of a slew, against where the satellite is when the shutter is half way."""
    config = Config.model_validate({"search": {"recentre": "every"}})
    r = rig(set(range(1, 10)), config)
    r.engine.arm()
    r.engine.run(frames=9)
    aims = [slew for slew in r.memory.of(SlewCommand) if slew.reason == "filter"]
    assert len(aims) >= 5
    for aim in aims:
        since_s = (aim.t_aim_utc_ns - T0_UTC_NS) / NS
        true = geo_measurement(2, ra_deg=START_DEG[0], dec_deg=START_DEG[1], cadence_s=since_s)
        off = separation_deg(aim.ra_icrs_deg, aim.dec_icrs_deg, true.ra_icrs_deg, START_DEG[1])
        assert off * 3600.0 < 1.0


STOP_MOMENTS = ["reduce", "expose", "slew", "arrival"]


@pytest.mark.parametrize("moment", STOP_MOMENTS)
def test_after_stop_no_order_reaches_the_mount_any_more(moment):
    """STOP in the middle of anything: the last thing the mount hears is the abort."""
    r = rig(set())
    command_handler = command_handler_of(r)
    heard: list[str] = []
    slew, abort, report = r.mount.slew, r.mount.abort, r.mount.report

    def stop_now() -> None:
        if not any(word == "abort" for word in heard):
            assert command_handler.handle(asked("stop", by="console")).ok

    def heard_slew(*where: Any) -> None:
        heard.append("slew")
        slew(*where)
        if moment == "slew":
            stop_now()

    def heard_abort(timeout_s: float = 2.0, **_: Any) -> StopResult:
        heard.append("abort")
        return abort(timeout_s)

    def heard_report(*asked: Any) -> MountReport:
        if moment == "arrival" and heard:
            stop_now()
        return report(*asked)

    r.mount.slew, r.mount.abort, r.mount.report = heard_slew, heard_abort, heard_report
    reduce, expose = r.reducer.reduce, r.camera.start_exposure

    def stopped_reduce(frame: Frame) -> Reduction:
        if moment == "reduce":
            stop_now()
        return reduce(frame)

    def stopped_expose(exposure_s: float, frame_id: int) -> None:
        expose(exposure_s, frame_id)
        if moment == "expose":
            stop_now()

    r.reducer.reduce, r.camera.start_exposure = stopped_reduce, stopped_expose
    r.engine.arm()
    end_when_idle(r)
    r.engine.run()
    assert heard[-1] == "abort"
    assert "slew" not in heard[heard.index("abort") :]
    assert r.engine.following.state == "IDLE"
    (action,) = r.memory.of(OperatorAction)
    assert (action.verb, action.by) == ("stop", "console")


def test_stop_undoes_an_arming_that_still_waits():
    r = rig(set())
    command_handler = command_handler_of(r)
    command_handler.handle(asked("arm"))
    command_handler.handle(asked("stop"))
    end_when_idle(r)
    r.engine.run()
    assert r.mount.slews == []
    outcomes = [text(action.outcome) for action in r.memory.of(OperatorAction)]
    assert outcomes[-1] == "dropped by STOP"


def test_a_stop_that_the_driver_does_not_answer_is_an_alarm():
    r = rig(set())
    r.mount.abort = lambda **_: StopResult(  # type: ignore[method-assign]
        is_answered=False, ms=2000.0, path="indi", detail="still moving"
    )
    command_handler = command_handler_of(r)
    r.engine.arm()
    assert not command_handler.handle(asked("stop")).ok
    end_when_idle(r)
    r.engine.run()
    assert any("STOP was not answered" in event.text for event in r.memory.of(Event))


def test_a_stop_that_was_not_obeyed_is_a_fault_until_the_mount_is_measured_to_rest():
    r = rig(set())
    r.mount.abort = lambda **_: StopResult(  # type: ignore[method-assign]
        is_answered=False, ms=2000.0, path="indi", detail="still moving"
    )
    r.mount.motion = Motion(kind="moves", ra_rate_arcsec_s=14_400.0)
    command_handler_of(r).handle(asked("stop"))
    heed_alarms(r)
    states = []
    wait = r.clock.wait_until

    def rests_later(t_utc_ns: int) -> bool:
        states.append(r.engine.status().state)
        if len(states) == 5:
            r.mount.motion = Motion(kind="tracks")
        if len(states) == 10:
            r.queue.request_shutdown()
        return wait(t_utc_ns)

    r.clock.wait_until = rests_later  # type: ignore[method-assign]
    r.engine.run()
    assert set(states[:5]) == {"FAULT"}
    assert states[-1] == "IDLE"
    over = [each.text for each in r.memory.of(Event) if "STOP is over" in each.text]
    assert over == ["the mount tracks, measured: STOP is over"]


def test_one_lost_frame_is_a_miss_and_the_loop_goes_on():
    r = rig(set())
    r.camera.broken_for = 1
    r.engine.arm()
    r.engine.run(frames=3)
    assert r.engine.status().state == "SEARCH"
    assert [e.level for e in r.memory.of(Event) if e.level != "info"] == ["alarm"]


def test_a_camera_that_stays_silent_is_a_fault_and_the_mount_is_stopped():
    r = rig(set())
    r.camera.broken_for = 99
    r.engine.arm()
    end_when_idle(r)
    r.engine.run()
    assert r.mount.aborts >= 1
    assert "USB" in r.engine.status().faults[0]
    assert "FAULT" in [change.after for change in r.memory.of(StateChange)]


def test_a_run_of_so_many_frames_ends_with_the_fault_it_cannot_pass():
    r = rig(set())
    r.camera.broken_for = 99
    r.engine.arm()
    with pytest.raises(InstrumentError, match="USB"):
        r.engine.run(frames=10)


def test_an_observatory_that_is_gone_ends_the_run_and_not_the_memory():
    r = rig(set())
    r.engine.arm()

    def gone(t_utc_ns: int) -> bool:
        raise InstrumentError("the simulated observatory does not answer")

    r.clock.wait_until = gone  # type: ignore[method-assign]
    with pytest.raises(InstrumentError, match="does not answer"):
        r.engine.run()
    assert len(r.memory.records) < 50


def test_a_clock_that_somebody_sets_is_an_alarm_and_the_loop_goes_on_by_the_new_time():
    r = rig(set(range(1, 30)))
    r.engine.arm()
    r.engine.run(frames=5)
    r.clock.set_by(-300.0)
    r.clock.t_utc_ns -= 300 * NS
    r.engine.run(frames=8)
    assert any("set the clock by -300.0 s" in event.text for event in r.memory.of(Event))
    starts = {f.frame_id: f.t_start_utc_ns for f in r.memory.of(FrameTaken)}
    assert starts[8] < starts[5]
    assert r.engine.authority.state != "FAULT"
    health = command_handler_of(r).handle(asked("status")).data["health"]
    assert any("set by -300.0 s" in each["text"] for each in health)


def test_a_clock_that_is_set_while_the_mount_slews_waits_for_it_and_takes_nothing_away():
    r = rig(set())
    r.engine.arm()
    r.engine.run(frames=2)
    plain, slewing_for = r.mount.report, 12
    opened: list[bool] = []

    def report(*arguments: Any, **named: Any) -> MountReport:
        nonlocal slewing_for
        slewing_for -= 1
        told = plain(*arguments, **named)
        ra_deg = told.ra_icrs_deg + max(slewing_for, 0)
        return dataclasses.replace(told, is_slewing=slewing_for > 0, ra_icrs_deg=ra_deg % 360.0)

    start = r.camera.start_exposure
    r.camera.start_exposure = lambda *a: (opened.append(slewing_for > 0), start(*a))[1]
    r.mount.report = report
    r.clock.set_by(30.0)
    r.engine.run(frames=5)
    assert any("set the clock" in event.text for event in r.memory.of(Event))
    assert opened
    assert not any(opened)
    assert r.engine.authority.state == "SEARCH"


def test_a_clock_that_is_set_under_cloud_ends_no_night_and_leaves_nothing_to_seek():
    r = rig(set(range(1, 6)))
    r.engine.arm()
    r.engine.run(frames=5)
    assert r.engine.following.state == "TRACK"
    plain = r.reducer.reduce

    def clouded(frame):
        solved = plain(frame)
        reason = NotSolved(frame_id=frame.frame_id, reason="no stars", ms=1.0)
        return dataclasses.replace(solved, solution=reason)

    r.reducer.reduce = clouded
    r.clock.set_by(-60.0)
    r.engine.run(frames=8)
    assert r.engine.authority.state == "SEARCH"
    answer = command_handler_of(r).handle(asked("seek"))
    assert not answer.ok
    assert "nothing has been followed" in answer.message


def test_what_nobody_foresaw_stops_the_mount_and_is_a_fault():
    r = rig(set())

    def broken(frame: Frame) -> Reduction:
        raise ZeroDivisionError("nobody foresaw this")

    r.reducer.reduce = broken  # type: ignore[method-assign]
    r.engine.arm()
    end_when_idle(r)
    r.engine.run()
    assert r.mount.aborts >= 1
    assert "nobody foresaw this" in r.engine.status().faults[0]


def test_a_mount_that_never_quite_arrives_is_told_with_how_far_it_is_off():
    r = rig(set())
    go = r.mount.slew

    def always_short(ra_icrs_deg: float, dec_icrs_deg: float, now_utc_ns: int) -> None:
        go(ra_icrs_deg, dec_icrs_deg, now_utc_ns)
        r.mount.at_deg = (ra_icrs_deg, dec_icrs_deg - 0.2)

    r.mount.slew = always_short  # type: ignore[method-assign]
    r.engine.arm()
    with pytest.raises(InstrumentError, match=r"12\.0 arcmin off"):
        r.engine.run(frames=5)
    assert len(r.mount.slews) == 9  # three orders for each of three failures in a row


def test_a_mount_that_stops_beside_the_place_is_sent_again():
    """Debian's simulator loses the sky's motion on a long slew: 3.4 arcmin after 14 s."""
    r = rig(set())
    go = r.mount.slew

    def short_of_it(ra_icrs_deg: float, dec_icrs_deg: float, now_utc_ns: int) -> None:
        go(ra_icrs_deg, dec_icrs_deg, now_utc_ns)
        if len(r.mount.slews) == 1:
            r.mount.at_deg = (ra_icrs_deg + 3.4 / 60.0, dec_icrs_deg)

    r.mount.slew = short_of_it  # type: ignore[method-assign]
    r.engine.arm()
    r.engine.run(frames=2)
    assert r.mount.slews[0] == r.mount.slews[1]
    assert r.engine.frame_id == 2


def test_a_tunable_takes_effect_and_is_on_record_with_old_and_new():
    r = rig(set())
    r.engine.arm()
    r.queue.put(asked("set", arguments={"name": "detector.tau", "value": 0.25}, by="console"))
    r.engine.run(frames=1)
    assert r.reducer.config.detector.tau == 0.25
    (change,) = r.memory.of(ParameterChange)
    assert (change.before, change.after, change.by) == (0.10, 0.25, "console")


def test_another_exposure_reaches_the_camera_and_the_aim():
    r = rig(set())
    r.engine.arm()
    r.queue.put(asked("set", arguments={"name": "exposure.exposure_s", "value": 2.0}))
    r.engine.run(frames=2)
    assert r.camera.taken[2] == 2.0
    slew = r.memory.of(SlewCommand)[-2]
    taken = r.memory.of(FrameTaken)[-1]
    middle_ns = taken.t_start_utc_ns + NS + round(CONFIG.exposure.start_latency_s * NS)
    assert slew.t_aim_utc_ns == pytest.approx(middle_ns, abs=NS)


def test_the_same_false_streak_in_every_frame_does_not_hold_the_search():
    r = rig(set())
    plain = r.reducer.reduce

    def junk(frame: Frame) -> Reduction:
        hour = geo_measurement(1, ra_deg=10.0 + 7.0 * frame.frame_id)
        measurement = dataclasses.replace(
            hour, frame_id=frame.frame_id, t_mid_utc_ns=frame.t_mid_utc_ns
        )
        return dataclasses.replace(plain(frame), measurements=(measurement,))

    r.reducer.reduce = junk  # type: ignore[method-assign]
    r.engine.arm()
    r.engine.run(frames=8)
    hour_angles = {
        round(hour_angle_icrs_deg(SITE, s.ra_icrs_deg, s.dec_icrs_deg, s.t_aim_utc_ns), 1)
        for s in r.memory.of(SlewCommand)
    }
    assert len(hour_angles) >= 4


@pytest.mark.parametrize(
    ("name", "value", "word"),
    [("site.latitude_deg", 10.0, "write it into"), ("detector.tau", 2.0, "below 1")],
)
def test_what_cannot_be_set_is_refused_with_the_reason(name, value, word):
    with pytest.raises(ValueError, match=word):
        config_with_setting(CONFIG, name, value)


def test_a_verb_that_there_is_not_is_refused_with_those_that_there_are():
    answer = told(command_handler_of(rig(set())), "dance", {})
    assert not answer.ok
    assert answer.message.startswith("the engine knows no 'dance'; it knows stop, status, arm,")


def test_shutdown_stops_the_mount():
    r = rig(set())
    r.engine.arm()
    r.queue.request_shutdown()
    r.engine.run()
    assert r.mount.aborts == 1
    assert r.engine.status().state == "IDLE"
    assert is_told_to_have_ended(r)


def is_told_to_have_ended(r: Rig) -> bool:
    return "engine ended" in [event.topic for event in r.memory.of(Event)]


def test_an_engine_at_rest_puts_its_end_on_record_behind_the_stop_of_the_mount():
    r = rig(set())
    told_before: list[bool] = []
    plain = r.mount.abort

    def abort(*_: Any, **__: Any) -> StopResult:
        told_before.append(is_told_to_have_ended(r))
        return plain()

    r.mount.abort = abort  # type: ignore[method-assign]
    r.queue.request_shutdown()
    r.engine.run()
    assert told_before == [False]
    assert r.memory.of(StateChange) == []
    assert is_told_to_have_ended(r)


def test_an_end_at_which_the_mount_did_not_stop_is_an_alarm_and_none_that_went_well():
    r = rig(set())
    failed = StopResult(is_answered=False, ms=900.0, path="mount", detail="no answer")
    r.mount.abort = lambda *_, **__: failed  # type: ignore[method-assign]
    r.queue.request_shutdown()
    r.engine.run()
    said = "the engine ends, the mount's driver did not answer ABORT: no answer"
    assert r.memory.of(Event)[-1].text == said
    assert not is_told_to_have_ended(r)


def test_a_mount_that_points_wrong_is_corrected_by_what_the_frames_show():
    """It looks 5 arcmin north of where it is sent: from the second exposure on it is sent south."""
    r = rig(set(), Config.model_validate({"search": {"pattern": "stay"}}))
    plain = r.reducer.reduce

    def reduce(frame: Frame) -> Reduction:
        ra, dec = r.mount.at_deg
        return dataclasses.replace(plain(frame), solution=solution_at(ra, dec + 5.0 / 60.0))

    r.reducer.reduce = reduce  # type: ignore[method-assign]
    r.engine.arm()
    r.engine.run(frames=4)
    wanted = r.memory.of(SlewCommand)
    assert wanted[-1].dec_icrs_deg - r.mount.slews[-1][1] == pytest.approx(5.0 / 60.0, abs=1e-4)


def test_a_fault_in_one_command_costs_none_of_those_behind_it(monkeypatch):
    r = rig(set())
    broken = r.engine.handlers[Seek]

    def breaks(_command: Seek, _by: str) -> CommandResult:
        raise RuntimeError("a fault of ours")

    monkeypatch.setitem(r.engine.handlers, Seek, dataclasses.replace(broken, execute=breaks))
    r.queue.put(asked("seek"))
    r.queue.put(asked("set", arguments={"name": "detector.tau", "value": 0.25}))
    with pytest.raises(RuntimeError, match="a fault of ours"):
        r.engine.commands.execute_waiting()
    (failed,) = r.memory.of(OperatorAction)
    assert (failed.verb, failed.outcome.kind) == ("seek", "failed")
    r.engine.commands.execute_waiting()
    assert [each.verb for each in r.memory.of(OperatorAction)] == ["seek", "set"]
