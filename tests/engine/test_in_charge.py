"""The operator's hand, the limits and the end of the night, on an engine among stand-ins."""

import dataclasses
from collections.abc import Callable
from typing import Any

import pytest

from rsoconsole.base import InstrumentError
from rsoconsole.config import Config
from rsoconsole.control import Goto, Request, Sender
from rsoconsole.engine.aim.instrument_controller import Interrupted
from rsoconsole.engine.aim.states import Failed, LimitMet, NightEnded, Stopped
from rsoconsole.engine.tasks.slews import Slews
from rsoconsole.engine.tasks.watch import LOOP_SILENCE_S
from rsoconsole.instruments import MountReport, SkyReport, StopResult
from rsoconsole.instruments.motion import Motion
from rsoconsole.records import (
    Event,
    FrameTaken,
    OperatorAction,
    SlewCommand,
    SlewRefusal,
    StateChange,
)
from rsoconsole.sky import (
    altaz_to_icrs,
    icrs_of_hour_angle,
    separation_deg,
    sun_altitude_deg,
    sun_icrs,
)
from rsoconsole.words import text
from tests.makers import NS, T0_UTC_NS
from tests.rigs.engine_rig import (
    CONFIG,
    SITE,
    START_DEG,
    PlainMount,
    Rig,
    asked,
    command_handler_of,
    end_when_idle,
    heed_alarms,
    rig,
    told,
)

BESIDE = altaz_to_icrs(SITE, 50.0, 170.0, T0_UTC_NS)
UNDERGROUND = altaz_to_icrs(SITE, -20.0, 200.0, T0_UTC_NS)


def after_frames(r: Rig, frames: int, act: Callable[[], object]) -> None:
    """Do something once, when so many frames have been taken."""
    wait = r.clock.wait_until
    is_done: list[bool] = []

    def acting(t_utc_ns: int) -> bool:
        if len(r.memory.of(FrameTaken)) >= frames and not is_done:
            is_done.append(True)
            act()
        return wait(t_utc_ns)

    r.clock.wait_until = acting  # type: ignore[method-assign]


def goto(ra_deg: float, dec_deg: float) -> Request:
    command = Goto(ra_icrs_deg=ra_deg, dec_icrs_deg=dec_deg)
    return Request(command=command, sender=Sender(name="console"))


def end_when_parked(r: Rig) -> None:
    wait = r.clock.wait_until

    def leave(t_utc_ns: int) -> bool:
        if r.mount.is_parked:
            r.queue.request_shutdown()
        return wait(t_utc_ns)

    r.clock.wait_until = leave  # type: ignore[method-assign]


def states(r: Rig) -> list[str]:
    return [change.after for change in r.memory.of(StateChange)]


def alarms(r: Rig) -> str:
    return "\n".join(event.text for event in r.memory.of(Event) if event.level == "alarm")


def test_a_move_by_hand_takes_the_mount_and_autonomy_waits_for_resume():
    r = rig(set(range(1, 30)))
    command_handler = command_handler_of(r)
    r.engine.arm()
    after_frames(r, 4, lambda: command_handler.handle(goto(*BESIDE)))
    r.engine.run(frames=8)
    assert states(r) == ["SEARCH", "ACQUIRE", "TRACK", "MANUAL"]
    assert separation_deg(*r.mount.slews[-1], *BESIDE) < 1e-6
    assert r.engine.status().holder == "operator"
    slews = len(r.mount.slews)
    command_handler.handle(asked("resume"))
    r.engine.run(frames=12)
    assert states(r)[4:] == ["COAST", "TRACK"]
    assert len(r.mount.slews) > slews


def test_frames_go_on_while_the_operator_has_the_mount():
    r = rig(set())
    command_handler_of(r).handle(goto(*BESIDE))
    r.engine.run(frames=3)
    assert len(r.memory.of(FrameTaken)) == 3
    assert len(r.mount.slews) == 1


@pytest.mark.parametrize(
    ("direction", "word"),
    [
        (UNDERGROUND, "altitude"),
        ((float("nan"), 0.0), "must be a number"),
        ((10.0, 95.0), "outside -90 to 90"),
    ],
)
def test_a_move_by_hand_against_the_limits_is_refused_with_the_reason(direction, word):
    r = rig(set())
    ra_deg, dec_deg = direction
    answer = told(command_handler_of(r), "goto", {"ra_icrs_deg": ra_deg, "dec_icrs_deg": dec_deg})
    assert not answer.ok
    assert word in answer.message
    assert r.engine.status().holder == "nobody"


def test_a_nudge_moves_by_so_much_on_the_sky():
    r = rig(set())
    arguments = {"east_arcmin": 10.0, "north_arcmin": 0.0}
    command_handler_of(r).handle(asked("nudge", arguments=arguments))
    r.engine.run(frames=1)
    assert separation_deg(*r.mount.slews[-1], *START_DEG) * 60.0 == pytest.approx(10.0, abs=0.01)


def test_a_held_mount_gets_no_order_and_the_track_goes_on():
    r = rig(set(range(1, 30)), Config.model_validate({"search": {"recentre": "every"}}))
    command_handler = command_handler_of(r)
    r.engine.arm()
    after_frames(r, 5, lambda: command_handler.handle(asked("hold")))
    r.engine.run(frames=6)
    held_at = len(r.mount.slews)
    r.engine.run(frames=9)
    assert len(r.mount.slews) == held_at
    assert r.engine.status().state == "TRACK"
    command_handler.handle(asked("resume"))
    r.engine.run(frames=12)
    assert len(r.mount.slews) > held_at


def test_disarming_does_not_wait_for_the_end_of_the_exposure():
    r = rig(set())
    command_handler = command_handler_of(r)
    r.engine.arm()
    expose = r.camera.start_exposure

    def disarmed_meanwhile(exposure_s: float, frame_id: int) -> None:
        expose(exposure_s, frame_id)
        if frame_id == 3:
            command_handler.handle(asked("disarm"))

    r.camera.start_exposure = disarmed_meanwhile  # type: ignore[method-assign]
    end_when_idle(r)
    r.engine.run()
    assert states(r)[-1] == "IDLE"
    assert len(r.memory.of(FrameTaken)) == 2
    assert r.camera.aborts == 1


def test_parking_disarms_first():
    r = rig(set())
    command_handler = command_handler_of(r)
    r.engine.arm()
    after_frames(r, 2, lambda: command_handler.handle(asked("park")))
    end_when_parked(r)
    r.engine.run()
    assert r.mount.is_parked
    assert states(r)[-1] == "IDLE"


def test_what_was_acknowledged_is_on_record_before_the_answer():
    r = rig(set())
    flushed: list[int] = []
    command_handler = command_handler_of(r)
    command_handler._flush = lambda _: (
        bool(flushed.append(len(r.memory.of(OperatorAction)))) or True
    )
    assert command_handler.handle(asked("set", arguments={"name": "detector.tau", "value": 0.2})).ok
    assert flushed == [1]


def low_in_the_west(r: Rig) -> None:
    """Stand where sidereal tracking meets the horizon some ten minutes later."""
    r.mount.at_deg = altaz_to_icrs(SITE, 2.0, 265.0, T0_UTC_NS)
    r.mount.pier_side = "east"


def test_sidereal_tracking_into_a_limit_is_stopped_whichever_has_the_mount():
    """Nobody has armed anything: the watch alone keeps the telescope from setting."""
    r = rig(set())
    low_in_the_west(r)
    r.engine.watch.look()
    ahead = r.engine.watch.next_limit
    assert ahead is not None
    assert ahead[1].limit == "horizon"
    wait = r.clock.wait_until

    def until_past(t_utc_ns: int) -> bool:
        if r.clock.t_utc_ns > ahead[0] + 5 * NS:
            r.queue.request_shutdown()
        return wait(t_utc_ns)

    r.clock.wait_until = until_past  # type: ignore[method-assign]
    r.engine.run()
    assert not r.mount.is_tracking
    assert r.mount.aborts >= 1
    assert "below the horizon" in alarms(r)
    assert abs(r.clock.t_utc_ns - ahead[0]) < 10 * NS


def test_a_search_goes_home_when_a_limit_is_met():
    r = rig(set())
    r.engine.arm()
    abort = r.mount.abort

    def meet_a_limit() -> None:
        r.queue.stop(LimitMet(words="altitude 14.9 deg"), abort)

    after_frames(r, 3, meet_a_limit)
    r.engine.run(frames=5)
    assert r.engine.status().state == "SEARCH"
    assert "altitude 14.9 deg" in alarms(r)


def test_no_exposure_begins_that_would_end_behind_a_limit():
    r = rig(set())
    low_in_the_west(r)
    r.engine.watch.look()
    ahead = r.engine.watch.next_limit
    assert ahead is not None
    r.clock.t_utc_ns = ahead[0] - 5 * NS
    command_handler_of(r)
    assert r.engine.watch.limit_before(r.clock.t_utc_ns + 10 * NS) is not None
    assert r.engine.watch.limit_before(r.clock.t_utc_ns + 2 * NS) is None


def test_a_search_that_is_refused_everywhere_is_a_fault_that_says_why():
    west = {"pattern": "stay", "hour_angle_deg": 100.0, "declination_deg": -30.0}
    r = rig(set(), Config.model_validate({"search": west}))
    r.engine.arm()
    end_when_idle(r)
    r.engine.run()
    assert "FAULT" in states(r)
    assert "nowhere to search" in alarms(r)
    assert r.mount.slews == []


class Weather:
    """A station that says what it is told to."""

    def __init__(self) -> None:
        self.report = SkyReport(weather="ok", dome="open")

    def look(self) -> SkyReport:
        return self.report

    def close(self) -> None:
        pass


@pytest.mark.parametrize(
    ("report", "word"),
    [
        (SkyReport(weather="alert", dome="open", detail="rain"), "rain"),
        (SkyReport(weather="ok", dome="closed"), "closed"),
        (SkyReport(weather="silent", dome="open"), "silent"),
    ],
)
def test_bad_weather_stops_and_parks_and_nothing_resumes_by_itself(report, word):
    config = Config.model_validate({"indi": {"weather": "Station", "dome": "Dome"}})
    station = Weather()
    r = rig(set(), config, safety_monitor=station)
    r.engine.arm()

    def turn() -> None:
        station.report = report

    after_frames(r, 2, turn)
    wait = r.clock.wait_until

    def clears_up(t_utc_ns: int) -> bool:
        if r.engine.authority.state == "IDLE" and r.mount.is_parked:
            station.report = SkyReport(weather="ok", dome="open")
        if r.clock.t_utc_ns > T0_UTC_NS + 1200 * NS:
            r.queue.request_shutdown()
        return wait(t_utc_ns)

    r.clock.wait_until = clears_up  # type: ignore[method-assign]
    r.engine.run()
    assert r.mount.is_parked
    assert states(r) == ["SEARCH", "IDLE"]
    assert word in alarms(r)
    assert len(r.memory.of(FrameTaken)) == 2


@pytest.mark.parametrize("taken_by", ["disarm", "goto"])
@pytest.mark.parametrize(
    ("report", "word"),
    [
        (SkyReport(weather="alert", dome="open", detail="rain"), "rain"),
        (SkyReport(weather="ok", dome="closed"), "closed"),
        (None, "the Sun stands at"),
    ],
)
def test_resume_is_no_way_round_dome_weather_and_daylight(report, word, taken_by):
    config = Config.model_validate({"indi": {"weather": "Station", "dome": "Dome"}})
    station = Weather()
    r = rig(set(range(1, 60)), config, safety_monitor=station)
    r.engine.arm()
    r.engine.run(frames=6)
    assert r.engine.authority.state == "TRACK"
    arguments = {"ra_icrs_deg": BESIDE[0], "dec_icrs_deg": BESIDE[1]} if taken_by == "goto" else {}
    assert command_handler_of(r).handle(asked(taken_by, arguments)).ok
    r.engine.commands.execute_waiting()
    assert r.engine.authority.is_resumable
    if report is None:
        r.clock.t_utc_ns = T0_UTC_NS + 8 * 3600 * NS
    else:
        station.report = report
    slews = len(r.mount.slews)
    answer = told(command_handler_of(r), "resume", {})
    assert not answer.ok
    assert word in answer.message
    # The loop, too, which comes to it later.
    with pytest.raises(ValueError, match=word):
        r.engine.resume("operator")
    assert not r.engine.authority.is_autonomous
    assert (len(r.mount.slews), r.mount.is_parked) == (slews, False)


def test_no_slew_s_seconds_are_counted_while_the_mount_parks():
    r = rig(set())
    r.engine.arm()
    r.engine.run(frames=3)
    plain = r.mount.report

    def report(not_before_utc_ns: int | None = None, timeout_s: float = 10.0) -> MountReport:
        return dataclasses.replace(plain(), is_slewing=True)

    r.mount.report = report  # type: ignore[method-assign]
    r.engine.watch.last_report = report()
    assert r.engine.status().slew_left_s is not None
    r.engine.instrument_controller.order_park()
    assert r.engine.status().slew_left_s is None


def test_dawn_ends_the_night():
    r = rig(set())
    r.engine.arm()
    after_frames(r, 2, lambda: setattr(r.clock, "t_utc_ns", T0_UTC_NS + 8 * 3600 * NS))
    end_when_parked(r)
    r.engine.run()
    assert sun_altitude_deg(SITE, r.clock.t_utc_ns) > CONFIG.limits.twilight_deg
    assert r.mount.is_parked
    assert "Sun" in alarms(r)


def test_a_run_of_so_many_frames_ends_well_at_dawn():
    """A night of 2,000 exposures is over when the Sun is: no fault, and its summary comes."""
    r = rig(set())
    r.engine.arm()
    after_frames(r, 2, lambda: setattr(r.clock, "t_utc_ns", T0_UTC_NS + 8 * 3600 * NS))
    r.engine.run(frames=2000)
    assert r.mount.is_parked
    assert states(r) == ["SEARCH", "IDLE"]
    assert len(r.memory.of(FrameTaken)) == 2


def test_where_only_the_sun_is_in_the_searchs_way_the_night_has_ended(monkeypatch):
    """The last exposures would end in twilight before the watch calls it dawn."""
    r = rig(set())
    r.engine.arm()
    too_light = SlewRefusal.beyond("twilight", -11.9, -12.0)
    after_frames(r, 2, lambda: monkeypatch.setattr(Slews, "_refusal_of", lambda *_: too_light))
    r.engine.run(frames=2000)
    assert r.mount.is_parked
    assert states(r) == ["SEARCH", "IDLE"]
    [ended] = [c for c in r.memory.of(StateChange) if c.after == "IDLE"]
    assert ended.reason.kind == "night ended"


def test_a_search_that_a_wall_surrounds_is_a_fault_all_the_same(monkeypatch):
    r = rig(set())
    r.engine.arm()
    wall = SlewRefusal.beyond("altitude", 12.0, 25.0)
    after_frames(r, 2, lambda: monkeypatch.setattr(Slews, "_refusal_of", lambda *_: wall))
    with pytest.raises(InstrumentError, match="nowhere to search"):
        r.engine.run(frames=2000)


def test_arming_is_refused_with_the_check_that_failed_and_can_be_overridden_by_name():
    r = rig(set())
    r.mount.is_parked = True
    command_handler = command_handler_of(r)
    refused = command_handler.handle(asked("arm"))
    assert not refused.ok
    assert "unparked" in refused.message
    failed = [check["name"] for check in refused.data["checks"] if not check["ok"]]
    assert "unparked" in failed
    accepted = command_handler.handle(asked("arm", arguments={"override": failed}, by="console"))
    assert accepted.ok
    r.engine.run(frames=1)
    assert r.engine.status().state == "SEARCH"
    assert not r.mount.is_parked
    assert any("armed without" in event.text for event in r.memory.of(Event))


def test_an_override_of_what_does_not_exist_is_refused():
    answer = command_handler_of(rig(set())).handle(asked("arm", arguments={"override": ["moon"]}))
    assert not answer.ok
    assert "moon" in answer.message


def test_a_first_frame_that_disagrees_with_the_mount_disarms():
    """The mount says one thing, the stars another: 20 degrees apart."""
    r = rig(set())
    elsewhere = icrs_of_hour_angle(SITE, 20.0, -5.0, T0_UTC_NS)
    plain = r.mount.report

    def lies(*asked: object) -> MountReport:
        return plain()

    r.mount.report = lies  # type: ignore[method-assign]
    r.reducer.mount = rig(set()).mount
    r.reducer.mount.at_deg = (float(elsewhere[0]), float(elsewhere[1]))
    r.engine.arm()
    end_when_idle(r)
    r.engine.run()
    assert states(r) == ["SEARCH", "IDLE"]
    assert "not armed" in alarms(r)
    assert r.mount.slews == []


def test_a_run_of_so_many_frames_ends_where_autonomy_gives_up():
    """Nobody arms it again: it would wait for ever."""
    r = rig(set())
    r.reducer.mount = rig(set()).mount
    r.reducer.mount.at_deg = (START_DEG[0] + 20.0, START_DEG[1])
    r.engine.arm()
    with pytest.raises(InstrumentError, match=r"the run ended early: pointing offset 1194"):
        r.engine.run(frames=5)
    assert states(r) == ["SEARCH", "IDLE"]


def test_an_overridden_pointing_check_lets_the_night_go_on():
    r = rig(set())
    r.reducer.mount = rig(set()).mount
    r.reducer.mount.at_deg = (START_DEG[0] + 20.0, START_DEG[1])
    r.engine.arm(lifted=frozenset({"pointing"}))
    r.engine.run(frames=2)
    assert r.engine.status().state == "SEARCH"
    assert r.engine.status().lifted == ("pointing",)


def test_the_first_frame_is_taken_where_the_telescope_stands():
    r = rig(set())
    r.engine.arm()
    r.engine.run(frames=1)
    frame_at = [type(record) for record in r.memory.records].index(FrameTaken)
    slew_at = [type(record) for record in r.memory.records].index(SlewCommand)
    assert frame_at < slew_at


def test_a_loop_that_hangs_is_told_and_the_service_manager_hears_no_more(monkeypatch):
    r = rig(set())
    watch = r.engine.watch
    heard: list[str] = []
    monkeypatch.setattr("rsoconsole.engine.tasks.watch.notify_systemd", heard.append)
    watch.look()
    assert heard == ["WATCHDOG=1"]
    watch._loop_alive_s -= LOOP_SILENCE_S
    watch.look()
    assert heard == ["WATCHDOG=1"]
    assert "loop hangs" in alarms(r)


def test_what_is_wished_while_a_stop_talks_to_the_mount_waits_until_it_is_over():
    r = rig(set())
    command_handler = command_handler_of(r)
    abort = r.mount.abort
    order: list[str] = []

    def slow_abort(timeout_s: float = 2.0, **_: Any) -> StopResult:
        if not order:
            order.append("stop begins")
            command_handler.handle(asked("park"))
            # The loop turns meanwhile.
            with pytest.raises(Interrupted):
                r.engine.commands.heed_alarms()
            order.append("stop ends")
        return abort(timeout_s)

    r.mount.abort = slow_abort  # type: ignore[method-assign]
    command_handler.handle(asked("stop"))
    assert order == ["stop begins", "stop ends"]
    assert not r.mount.is_parked


def test_a_mount_that_somebody_else_stops_is_left_to_them():
    """A hand controller's stop in the middle of a slew must not be overruled."""
    r = rig(set())
    go = r.mount.slew

    def stopped_on_the_way(ra_icrs_deg: float, dec_icrs_deg: float, now_utc_ns: int) -> None:
        go(ra_icrs_deg, dec_icrs_deg, now_utc_ns)
        r.mount.at_deg = (ra_icrs_deg, dec_icrs_deg - 3.0)

    r.mount.slew = stopped_on_the_way  # type: ignore[method-assign]
    r.engine.arm()
    r.engine.run(frames=4)
    assert len(r.mount.slews) == 1
    assert states(r) == ["SEARCH", "MANUAL"]
    assert "somebody else" in alarms(r)


def test_a_mount_that_somebody_else_moves_is_left_to_them():
    r = rig(set(range(1, 30)))
    r.engine.arm()
    after_frames(r, 5, lambda: setattr(r.mount, "at_deg", BESIDE))
    r.engine.run(frames=9)
    assert states(r)[-1] == "MANUAL"
    assert r.engine.status().holder == "operator"


def test_a_failed_first_frame_does_not_spare_the_pointing_check():
    r = rig(set())
    r.camera.broken_for = 1
    r.reducer.mount = rig(set()).mount
    r.reducer.mount.at_deg = (START_DEG[0] + 20.0, START_DEG[1])
    r.engine.arm()
    end_when_idle(r)
    r.engine.run()
    assert r.mount.slews == []
    assert states(r) == ["SEARCH", "IDLE"]


def test_a_fault_is_parked_when_the_weather_turns():
    station = Weather()
    r = rig(set(), Config.model_validate({"indi": {"weather": "Station"}}), safety_monitor=station)
    r.camera.broken_for = 999
    r.engine.arm()
    wait = r.clock.wait_until

    def rains_later(t_utc_ns: int) -> bool:
        if r.engine.authority.state == "FAULT":
            station.report = SkyReport(weather="alert", dome=None, detail="rain")
        if r.mount.is_parked:
            r.queue.request_shutdown()
        return wait(t_utc_ns)

    r.clock.wait_until = rains_later  # type: ignore[method-assign]
    r.engine.run()
    assert r.mount.is_parked
    assert states(r)[:3] == ["SEARCH", "FAULT", "IDLE"]


def test_parking_at_the_night_s_end_is_tried_until_it_is_done():
    r = rig(set())
    park, calls = r.mount.park, []

    def stubborn() -> None:
        calls.append(r.clock.t_utc_ns)
        if len(calls) < 4:
            raise InstrumentError("the mount refused to park")
        park()

    r.mount.park = stubborn  # type: ignore[method-assign]
    r.engine.arm()
    after_frames(r, 2, lambda: setattr(r.clock, "t_utc_ns", T0_UTC_NS + 8 * 3600 * NS))
    end_when_parked(r)
    r.engine.run()
    assert len(calls) == 4
    assert "the night ends" in alarms(r)
    assert "refused to park" in alarms(r)


def test_a_telescope_that_stands_is_told_when_the_sun_comes_to_where_it_looks():
    r = rig(set())
    noon_ns = T0_UTC_NS + 15 * 3600 * NS
    r.clock.t_utc_ns = noon_ns
    r.mount.is_tracking = False
    r.mount.at_deg = sun_icrs(noon_ns)
    r.engine.watch.look()
    r.engine.watch.look()
    told = [event.text for event in r.memory.of(Event) if "Sun" in event.text]
    assert len(told) == 1


def test_a_hold_in_a_slew_waits_for_the_mount_before_it_exposes():
    r = rig(set(range(1, 30)), Config.model_validate({"search": {"recentre": "every"}}))
    command_handler = command_handler_of(r)
    r.engine.arm()
    go, report, expose = r.mount.slew, r.mount.report, r.camera.start_exposure
    rests_at: list[int] = []
    exposed_slewing: list[bool] = []

    def slow(*where: float) -> None:
        go(*where)  # type: ignore[arg-type]
        if len(r.memory.of(FrameTaken)) == 5 and not rests_at:
            rests_at.append(r.clock.t_utc_ns + 8 * NS)
            command_handler.handle(asked("hold"))

    def slewing(*asked: object) -> MountReport:
        is_slewing = bool(rests_at) and r.clock.t_utc_ns < rests_at[0]
        return dataclasses.replace(report(), is_slewing=is_slewing)

    def seen(exposure_s: float, frame_id: int) -> None:
        exposed_slewing.append(bool(rests_at) and r.clock.t_utc_ns < rests_at[0])
        expose(exposure_s, frame_id)

    r.mount.slew, r.mount.report, r.camera.start_exposure = slow, slewing, seen  # type: ignore
    r.engine.run(frames=8)
    assert rests_at
    assert not any(exposed_slewing)


def test_a_forgotten_target_is_never_gone_to():
    r = rig(set())
    command_handler = command_handler_of(r)
    command_handler.handle(goto(*BESIDE))
    after_frames(r, 1, lambda: command_handler.handle(asked("disarm")))
    end_when_idle(r)
    r.engine.run()
    assert r.engine.hand_move is None


def test_a_parked_mount_is_not_sent_anywhere_by_hand():
    r = rig(set())
    r.mount.is_parked = True
    answer = command_handler_of(r).handle(goto(*BESIDE))
    assert not answer.ok
    assert "parked" in answer.message


def test_nudges_add_up_while_the_mount_is_on_its_way():
    r = rig(set())
    command_handler = command_handler_of(r)
    for _ in range(3):
        arguments = {"east_arcmin": 0.0, "north_arcmin": 10.0}
        assert command_handler.handle(asked("nudge", arguments=arguments)).ok
    r.engine.run(frames=1)
    assert r.mount.slews[-1][1] - START_DEG[1] == pytest.approx(0.5, abs=1e-3)


def test_a_limit_is_heard_of_although_the_mount_refuses_to_stop_tracking():
    r = rig(set())
    low_in_the_west(r)

    def refuses(is_on: bool) -> None:
        raise InstrumentError("the mount refused to set TELESCOPE_TRACK_STATE")

    r.mount.set_tracking = refuses  # type: ignore[method-assign]
    r.mount.at_deg = UNDERGROUND
    r.engine.watch.look()
    end_when_idle(r)
    r.engine.run()
    assert "altitude" in alarms(r)


def test_what_waits_when_the_engine_ends_is_dropped_and_said():
    r = rig(set())
    command_handler = command_handler_of(r)
    command_handler.handle(goto(*BESIDE))
    command_handler.handle(asked("shutdown"))
    r.engine.run()
    assert r.mount.slews == []
    outcomes = {action.verb: text(action.outcome) for action in r.memory.of(OperatorAction)}
    assert "dropped" in outcomes["goto"]


# ---- what a passage of the state sends to the mount ---------------------------------------


@pytest.mark.parametrize(
    "trigger",
    [
        Stopped(by="operator"),
        Failed(words="the camera gave no frame", is_final=True),
        NightEnded(words="rain", parks=False),
    ],
    ids=lambda trigger: type(trigger).__name__,
)
def test_what_ends_autonomy_sends_abort_to_the_mount(trigger: Any):
    r = rig(set())
    r.engine.arm()
    assert r.mount.aborts == 0
    r.engine.handle(trigger)
    assert r.mount.aborts == 1


class LateMeasured(PlainMount):
    """Answers ABORT at once; how it moves is measured later."""

    def abort(self, timeout_s: float = 2.0, *, on_news: Any = None) -> StopResult:
        self.result = StopResult(is_answered=True, ms=1.0, path="mount")
        self.on_news = on_news or (lambda _: None)
        self.on_news(self.result)
        return self.result

    def measure(self, motion: Motion) -> None:
        self.on_news(dataclasses.replace(self.result, motion=motion, measured_ms=5000.0))


@pytest.mark.parametrize(
    ("measured", "state"),
    [
        (Motion(kind="tracks"), "IDLE"),
        (Motion(kind="stands", ra_rate_arcsec_s=15.04), "IDLE"),
        (Motion(kind="moves", ra_rate_arcsec_s=14400.0), "FAULT"),
        (Motion(), "FAULT"),
    ],
    ids=lambda each: getattr(each, "kind", each),
)
def test_after_a_stop_the_state_is_calm_only_where_the_mount_was_measured_to_rest(
    measured: Motion, state: str
):
    r = rig(set(), make_mount=LateMeasured)
    assert isinstance(r.mount, LateMeasured)
    r.engine.arm()
    assert told(command_handler_of(r), "stop", {}).ok
    on_news = r.mount.on_news
    heed_alarms(r)
    assert r.engine.authority.state == "IDLE"
    r.mount.on_news = on_news  # the loop has sent ABORT once more, for nobody to be answered
    r.mount.measure(measured)
    heed_alarms(r)
    assert r.engine.authority.state == state
    assert r.engine.authority.is_stopped == (state == "FAULT")
