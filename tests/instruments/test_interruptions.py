"""What nobody ordered: clocks that are set or run wrong, sleep, slews ended by their own watch."""

import dataclasses
from collections.abc import Callable
from typing import Any

import pytest

from rsoconsole.base import InstrumentError
from rsoconsole.config import Config
from rsoconsole.engine.tasks.exposures import FrameTimes
from rsoconsole.instruments import ClockFault, SlewEnd
from rsoconsole.pipeline import Reduction
from rsoconsole.records import Event, Frame, FrameTaken, SlewCommand, StateChange, TrackState
from rsoconsole.sky import altaz_to_icrs
from tests.makers import NS
from tests.rigs.engine_rig import SITE, Rig, asked, command_handler_of, end_when_idle, rig
from tests.rigs.kept_sun import kept_sun

__all__ = ["kept_sun"]
MINUTE = ClockFault(kind="stood still", seconds=60.0)
ENDED = SlewEnd(unwatched_s=61.0, lease_s=10.0)


def said(r: Rig, level: str = "alarm") -> list[str]:
    return [each.text for each in r.memory.of(Event) if each.level == level]


def states(r: Rig) -> list[str]:
    return [change.after for change in r.memory.of(StateChange)]


class TrueSky:
    """The satellite is where true time has it, whatever the clock says."""

    def __init__(self, r: Rig) -> None:
        self.off_s = 0.0
        """The clock against true time."""
        self._reduce = r.reducer.reduce
        r.reducer.reduce = self.reduce  # type: ignore[method-assign]

    def reduce(self, frame: Frame) -> Reduction:
        assert frame.t_start_utc_ns is not None
        true_ns = frame.t_start_utc_ns - round(self.off_s * NS)
        seen = self._reduce(dataclasses.replace(frame, t_start_utc_ns=true_ns))
        told = tuple(
            dataclasses.replace(each, t_mid_utc_ns=each.t_mid_utc_ns + round(self.off_s * NS))
            for each in seen.measurements
        )
        return dataclasses.replace(seen, measurements=told)


def set_clock(r: Rig, sky: TrueSky, step_s: float, *, is_found: bool = True) -> None:
    """Somebody sets the clock."""
    r.clock.t_utc_ns += round(step_s * NS)
    sky.off_s += step_s
    if is_found:
        r.clock.set_by(step_s)


def worst_innovation_arcsec(r: Rig, since: int) -> float:
    """Of what the filter took, from a frame on."""
    taken = [s for s in r.memory.of(TrackState) if s.innovation_arcsec and s.frame_id >= since]
    return max((max(map(abs, s.innovation_arcsec)) for s in taken), default=0.0)


STEPS = [1.0, -1.0, 3600.0, -3600.0]
ONE_ARCSEC = 1.0


@pytest.mark.parametrize("step_s", STEPS)
def test_no_track_goes_on_across_a_clock_that_was_set(step_s: float):
    # An hour is 15 deg and much of a twilight: by its clock the telescope would have to end.
    wide = {"past_meridian_deg": 45.0, "twilight_deg": 0.0}
    config = Config.model_validate({"limits": wide})
    r = rig(set(range(1, 60)), config)
    sky = TrueSky(r)
    r.engine.arm()
    r.engine.run(frames=8)
    assert r.engine.authority.state == "TRACK"
    before = {each.track_id for each in r.memory.of(TrackState)}
    set_clock(r, sky, step_s)
    r.engine.run(frames=16)
    after = {each.track_id for each in r.memory.of(TrackState) if each.frame_id > 8}
    assert r.engine.authority.state == "TRACK"
    assert after
    assert not after & before
    assert worst_innovation_arcsec(r, 9) < ONE_ARCSEC
    assert sum("has set the clock by" in words for words in said(r)) == 1


def test_a_step_that_nobody_finds_would_show_in_the_innovations():
    """The tests above can fail: a second is 15 arcsec of a geostationary satellite."""
    r = rig(set(range(1, 60)))
    sky = TrueSky(r)
    r.engine.arm()
    r.engine.run(frames=8)
    set_clock(r, sky, 1.0, is_found=False)
    r.engine.run(frames=10)
    assert worst_innovation_arcsec(r, 9) > ONE_ARCSEC


def test_a_clock_that_is_set_while_the_camera_is_read_out_spoils_that_frame():
    r = rig(set(range(1, 60)))
    sky = TrueSky(r)
    r.engine.arm()
    r.engine.run(frames=8)
    plain = r.camera.wait_frame
    wrong: list[int] = []

    def read_out(timeout_s: float) -> Frame:
        frame = plain(timeout_s)
        if not wrong:
            # The driver writes its time when it has read the frame.
            set_clock(r, sky, 1.0)
            wrong.append(frame.frame_id)
            assert frame.t_start_utc_ns is not None
            frame = dataclasses.replace(frame, t_start_utc_ns=frame.t_start_utc_ns + NS)
        return frame

    r.camera.wait_frame = read_out  # type: ignore[method-assign]
    r.engine.run(frames=16)
    assert wrong[0] not in {each.frame_id for each in r.memory.of(FrameTaken)}
    assert worst_innovation_arcsec(r, 9) < ONE_ARCSEC
    assert r.engine.authority.state == "TRACK"


def test_a_leap_second_ends_what_is_followed_and_blames_nobody():
    r = rig(set(range(1, 60)))
    sky = TrueSky(r)
    r.engine.arm()
    r.engine.run(frames=8)
    set_clock(r, sky, -1.0, is_found=False)
    r.clock.faults.append(ClockFault(kind="leap second", seconds=-1.0))
    r.engine.run(frames=16)
    (words,) = said(r)
    assert words.startswith("a leap second has come (-1 s)")
    assert "both are right" in words
    assert worst_innovation_arcsec(r, 9) < ONE_ARCSEC
    assert r.engine.authority.state == "TRACK"


@pytest.mark.parametrize("rate", [0.5, 2.0])
def test_no_frame_is_taken_while_the_clock_runs_wrong_and_the_night_goes_on_after_it(rate: float):
    r = rig(set(range(1, 60)))
    sky = TrueSky(r)
    r.engine.arm()
    r.engine.run(frames=8)
    set_clock(r, sky, rate - 1.0)
    r.clock.faults.append(ClockFault(kind="runs wrong", seconds=rate - 1.0, rate=rate))
    r.clock.is_steady = False
    wait, waits = r.clock.wait_until, [0]
    frames_before = r.engine.frame_id

    def live(t_utc_ns: int) -> bool:
        waits[0] += 1
        if waits[0] == 30:
            assert r.engine.frame_id == frames_before
            assert any(
                not h.ok and "times as fast" in h.text
                for h in command_handler_of(r).status().health
            )
            sky.off_s += 20.0
            r.clock.t_utc_ns += 20 * NS
            r.clock.is_steady = True
            r.clock.faults.append(ClockFault(kind="runs right", seconds=20.0))
        return wait(t_utc_ns)

    r.clock.wait_until = live  # type: ignore[method-assign]
    r.engine.run(frames=18)
    assert waits[0] > 30
    assert any(f"runs {rate:.2f} times as fast" in words for words in said(r))
    assert any("runs right again" in words for words in said(r, "warning"))
    assert worst_innovation_arcsec(r, 9) < ONE_ARCSEC
    assert r.engine.authority.state == "TRACK"


def test_what_the_mount_s_own_clock_says_is_told():
    r = rig(set())
    r.mount.utc_offset_s = lambda: -3600.0  # type: ignore[method-assign]
    r.engine.arm()
    r.engine.run(frames=2)
    r.clock.set_by(3600.0)
    r.engine.run(frames=3)
    assert said(r)[0].endswith("; the mount's own clock is -3600 s off this one")


# ---- nothing ran for a while ---------------------------------------------------------------


@pytest.mark.parametrize("kind", ["slept", "stood still"])
def test_a_minute_in_which_nothing_ran_gives_up_the_exposure_and_keeps_the_track(kind: Any):
    r = rig(set(range(1, 60)))
    sky = TrueSky(r)
    r.engine.arm()
    r.engine.run(frames=8)
    (track,) = r.engine.following.tracks
    start, asleep = r.camera.start_exposure, [True]

    def start_and_sleep(exposure_s: float, frame_id: int) -> None:
        start(exposure_s, frame_id)
        if asleep.pop() if asleep else False:
            r.clock.t_utc_ns += 60 * NS
            r.clock.faults.append(ClockFault(kind=kind, seconds=60.0))

    r.camera.start_exposure = start_and_sleep  # type: ignore[method-assign]
    r.engine.run(frames=16)
    del sky
    assert r.camera.aborts == 1
    assert 9 not in {each.frame_id for each in r.memory.of(FrameTaken)}
    assert [each.track.track_id for each in r.engine.following.tracks] == [track.track.track_id]
    assert worst_innovation_arcsec(r, 9) < ONE_ARCSEC
    (words,) = said(r)
    assert "for 60 s and watched nothing" in words
    assert any("the mount tracks at altitude" in text for text in said(r, "info"))


def test_a_slew_that_ended_meanwhile_is_explained_and_the_search_goes_on():
    r = rig(set())
    r.engine.arm()
    r.engine.run(frames=2)
    slews = len(r.mount.slews)
    r.clock.faults.append(MINUTE)
    r.mount.slew_end = ENDED
    r.engine.run(frames=6)
    assert any(
        "the mount's own process has ended the slew, because the engine had not renewed its lease"
        " for 61 s (10 s are allowed)" in words
        for words in said(r)
    )
    assert states(r) == ["SEARCH"]
    assert len(r.mount.slews) > slews
    assert not any("somebody else" in words for words in said(r))


def test_a_mount_stopped_on_its_way_by_its_own_process_is_sent_on_without_being_asked():
    """No pause was noticed, only the watch hung: the loop finds the mount short of its place."""
    r = rig(set())
    go = r.mount.slew

    def stopped_on_the_way(ra_icrs_deg: float, dec_icrs_deg: float, now_utc_ns: int) -> None:
        go(ra_icrs_deg, dec_icrs_deg, now_utc_ns)
        if len(r.mount.slews) == 1:
            r.mount.at_deg = (ra_icrs_deg, dec_icrs_deg - 3.0)
            r.mount.slew_end = ENDED

    r.mount.slew = stopped_on_the_way  # type: ignore[method-assign]
    r.engine.arm()
    r.engine.run(frames=5)
    assert states(r) == ["SEARCH"]
    assert len(r.mount.slews) > 1
    assert sum("its lease for 61 s" in words for words in said(r)) == 1
    assert any("within its limits: autonomy goes on" in text for text in said(r, "info"))


def test_after_it_a_mount_below_its_limit_is_stopped_and_not_sent_on():
    r = rig(set())
    r.engine.arm()
    r.engine.run(frames=2)
    r.mount.at_deg = altaz_to_icrs(SITE, 5.0, 180.0, r.clock.t_utc_ns)
    r.mount.slew_end = ENDED
    r.clock.faults.append(MINUTE)
    # The watch would find it a second later.
    r.engine.watch.look = lambda: None  # type: ignore[method-assign]
    aborts = r.mount.aborts
    r.engine.run(frames=3)
    assert r.mount.aborts > aborts
    assert not r.mount.is_tracking
    assert any("after nobody watched the mount" in words for words in said(r))


def test_a_move_by_hand_that_was_ended_is_to_be_asked_for_again():
    r = rig(set())
    command_handler = command_handler_of(r)
    r.engine.arm()
    r.engine.run(frames=2)
    go = r.mount.slew

    def stopped_on_the_way(ra_icrs_deg: float, dec_icrs_deg: float, now_utc_ns: int) -> None:
        go(ra_icrs_deg, dec_icrs_deg, now_utc_ns)
        r.mount.at_deg = (ra_icrs_deg, dec_icrs_deg - 3.0)
        r.mount.slew_end = ENDED

    r.mount.slew = stopped_on_the_way  # type: ignore[method-assign]
    ra_deg, dec_deg = altaz_to_icrs(SITE, 50.0, 150.0, r.clock.t_utc_ns)
    assert command_handler.handle(
        asked("goto", {"ra_icrs_deg": ra_deg, "dec_icrs_deg": dec_deg})
    ).ok
    r.engine.run(frames=4)
    assert states(r)[-1] == "MANUAL"
    assert r.engine.hand_move is None
    assert any("ask for it again" in text for text in said(r, "info"))
    assert not any("somebody else" in words for words in said(r))


def test_an_idle_engine_only_says_how_the_mount_stands():
    r = rig(set())
    r.clock.faults.append(MINUTE)
    ticks: list[int] = []
    wait = r.clock.wait_until

    def leave(t_utc_ns: int) -> bool:
        ticks.append(t_utc_ns)
        if len(ticks) > 5:
            r.queue.request_shutdown()
        return wait(t_utc_ns)

    r.clock.wait_until = leave  # type: ignore[method-assign]
    r.engine.run()
    assert r.mount.slews == []
    assert any("as it was left" in text for text in said(r, "info"))


def in_an_idle_engine(
    r: Rig, *, until: Callable[[], bool] = lambda: False, turns: int = 12
) -> None:
    """Let it live for some seconds, and end it there."""
    wait, ticks = r.clock.wait_until, [0]

    def leave(t_utc_ns: int) -> bool:
        ticks[0] += 1
        if ticks[0] > turns or until():
            r.queue.request_shutdown()
        return wait(t_utc_ns)

    r.clock.wait_until = leave  # type: ignore[method-assign]
    r.engine.run()


def test_a_disarmed_engine_beside_a_mount_that_is_off_stays_idle_and_parks_nothing():
    """The machine slept, the mount is off; at dawn it is on again, and nobody asked for it."""
    r = rig(set())
    r.engine.arm()
    r.engine.run(frames=2)
    assert command_handler_of(r).handle(asked("disarm")).ok
    silent = [True]
    plain = r.mount.report

    def report(not_before_utc_ns: int | None = None, timeout_s: float = 10.0) -> Any:
        if silent[0]:
            raise InstrumentError("the mount is silent: check its power")
        return plain(not_before_utc_ns, timeout_s)

    r.mount.report = report  # type: ignore[method-assign]
    r.clock.faults.append(MINUTE)
    in_an_idle_engine(r, turns=6)
    assert "FAULT" not in states(r)
    assert sum("how the mount stands" in words for words in said(r)) == 1
    assert not r.engine.authority.is_responsible
    silent[0] = False
    r.queue._is_shutdown = False
    r.clock.t_utc_ns += 8 * 3600 * NS
    in_an_idle_engine(r, until=lambda: r.mount.is_parked)
    assert not r.mount.is_parked
    assert "FAULT" not in states(r)


def test_a_mount_that_stands_below_a_limit_after_a_pause_is_left_standing():
    r = rig(set())
    r.mount.at_deg = altaz_to_icrs(SITE, 5.0, 180.0, r.clock.t_utc_ns)
    r.mount.is_tracking = False
    r.clock.faults.append(MINUTE)
    in_an_idle_engine(r, turns=5)
    assert not any("after nobody watched the mount" in words for words in said(r))
    assert any(
        "the mount stands still at altitude 5" in text and "within its limits" not in text
        for text in said(r, "info")
    )


def test_a_clock_that_has_moved_while_it_ran_wrong_ends_what_is_followed():
    r = rig(set(range(1, 60)))
    sky = TrueSky(r)
    r.engine.arm()
    r.engine.run(frames=8)
    set_clock(r, sky, 0.3, is_found=False)
    r.clock.faults += [
        ClockFault(kind="runs wrong", seconds=0.2, rate=1.2),
        ClockFault(kind="runs right", seconds=0.3),
    ]
    r.engine.run(frames=16)
    before = {each.track_id for each in r.memory.of(TrackState) if each.frame_id <= 8}
    after = {each.track_id for each in r.memory.of(TrackState) if each.frame_id > 8}
    assert after
    assert not after & before
    assert "clock set" in {change.reason.kind for change in r.memory.of(StateChange)}
    assert worst_innovation_arcsec(r, 9) < ONE_ARCSEC


def test_a_clock_that_runs_right_where_it_was_keeps_what_is_followed():
    r = rig(set(range(1, 60)))
    r.engine.arm()
    r.engine.run(frames=8)
    r.clock.faults += [
        ClockFault(kind="runs wrong", seconds=0.2, rate=1.2),
        ClockFault(kind="runs right", seconds=0.02),
    ]
    r.engine.run(frames=16)
    assert {each.track_id for each in r.memory.of(TrackState)} == {1}


def test_a_slew_that_its_own_process_ended_is_no_fault_of_the_clock():
    r = rig(set())
    r.engine.arm()
    r.engine.run(frames=2)
    r.clock.faults.append(MINUTE)
    r.mount.slew_end = ENDED
    r.engine.run(frames=4)
    (ended,) = (each for each in r.memory.of(Event) if "its lease" in each.text)
    assert ended.topic == ""


# ---- the camera's own time -----------------------------------------------------------------


def with_camera_time(r: Rig, off_s: Callable[[int], float]) -> None:
    """The camera's clock is so far off in each frame."""
    plain = r.camera.wait_frame

    def wait_frame(timeout_s: float) -> Frame:
        frame = plain(timeout_s)
        assert frame.t_start_utc_ns is not None
        shifted_ns = frame.t_start_utc_ns + round(off_s(frame.frame_id) * NS)
        return dataclasses.replace(frame, t_start_utc_ns=shifted_ns)

    r.camera.wait_frame = wait_frame  # type: ignore[method-assign]


@pytest.mark.parametrize("off_s", [1.0, -1.0, 3600.0, -3600.0])
def test_a_frame_whose_own_time_jumps_is_not_followed(off_s: float):
    r = rig(set(range(1, 60)))
    with_camera_time(r, lambda frame_id: off_s if frame_id == 9 else 0.0)
    r.engine.arm()
    r.engine.run(frames=14)
    assert 9 not in {each.frame_id for each in r.memory.of(FrameTaken)}
    (words,) = said(r)
    assert words == f"frame 9 is not followed: by the camera's clock it began {off_s:+.1f} s" + (
        " from when it was ordered"
    )
    assert states(r)[-1] == "TRACK"
    assert worst_innovation_arcsec(r, 9) < ONE_ARCSEC


def test_a_camera_whose_clock_was_set_ends_the_track_and_is_believed_again():
    r = rig(set(range(1, 60)))
    with_camera_time(r, lambda frame_id: 3600.0 if frame_id >= 9 else 0.0)
    r.engine.arm()
    r.engine.run(frames=20)
    taken = {each.frame_id for each in r.memory.of(FrameTaken)}
    assert not taken & {9, 10, 11}
    assert {12, 13, 14} <= taken
    assert any("the camera's clock was set by +3600.0 s" in words for words in said(r))
    before = {each.track_id for each in r.memory.of(TrackState) if each.frame_id <= 8}
    after = {each.track_id for each in r.memory.of(TrackState) if each.frame_id >= 12}
    assert after
    assert not before & after


def test_a_frame_that_errs_right_after_the_camera_s_clock_was_set_is_not_believed():
    r = rig(set(range(1, 60)))
    with_camera_time(r, lambda frame_id: 3600.0 if frame_id >= 9 and frame_id != 12 else 0.0)
    r.engine.arm()
    r.engine.run(frames=15)
    taken = {each.frame_id for each in r.memory.of(FrameTaken)}
    assert not taken & {9, 10, 11, 12}
    assert {13, 14, 15} <= taken


def test_cameras_that_write_whole_seconds_or_are_late_at_random_are_believed():
    times = FrameTimes()
    for number, late_s in enumerate((0.0, 0.9, 0.4, 0.7, 0.1, 0.95, 0.5, 1.4, 0.2, 0.8)):
        opened_ns = number * 30 * NS
        assert times.check_frame_time(opened_ns - round(late_s * NS), opened_ns).is_believed


def test_a_camera_s_clock_that_was_always_off_is_its_own_affair():
    times = FrameTimes()
    for number in range(10):
        opened_ns = number * 30 * NS
        assert times.check_frame_time(opened_ns + 7200 * NS, opened_ns).is_believed


def test_slews_go_on_being_recorded_in_order_after_the_clock_went_back():
    r = rig(set())
    r.engine.arm()
    r.engine.run(frames=3)
    r.clock.t_utc_ns -= 3600 * NS
    r.clock.set_by(-3600.0)
    end_when_idle(r)
    r.engine.run(frames=6)
    assert [each.frame_id for each in r.memory.of(FrameTaken)] == sorted(
        each.frame_id for each in r.memory.of(FrameTaken)
    )
    assert r.memory.of(SlewCommand)
