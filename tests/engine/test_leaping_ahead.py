"""The next slew before the frame: as the shutter closes, or after a look at the frame's middle."""

import numpy as np
import pytest

from rsoconsole.base import InstrumentError
from rsoconsole.config import Config
from rsoconsole.engine.aim.instrument_controller import (
    InstrumentController,
    Interrupted,
    StoppedElsewhere,
)
from rsoconsole.engine.aim.states import Held
from rsoconsole.engine.leaps._leap_times import LeapTimes
from rsoconsole.engine.tasks.slews import Slews
from rsoconsole.instruments import MountReport
from rsoconsole.records import Event, Frame, FrameTaken, LeapDone, LowPass, SlewCommand, SlewRefusal
from tests.makers import NS
from tests.rigs import engine_rig
from tests.rigs.engine_rig import Rig
from tests.rigs.leap_rig import config_with, leap_rig, orbit_over

LATE = {"at_close": False}


def run(r: Rig, frames: int) -> Rig:
    r.engine.arm()
    r.engine.run(frames=frames)
    return r


def words(r: Rig) -> list[str]:
    return [event.text for event in r.memory.of(Event)]


def leaps(r: Rig) -> list[SlewCommand]:
    return [slew for slew in r.memory.of(SlewCommand) if slew.reason == "leap"]


def met(r: Rig) -> int:
    return sum(text.startswith("leap ") and " met:" in text for text in words(r))


def waits_s(r: Rig) -> list[float]:
    """From the end of each frame's exposure to the next order, of the leaps."""
    ends = {
        each.frame_id: each.t_start_utc_ns + round(each.exposure_s * NS)
        for each in r.memory.of(FrameTaken)
    }
    slews = r.memory.of(SlewCommand)
    return [
        (ordered_ns - ends[each.frame_id]) / NS
        for each, ordered_ns in zip(slews, r.mount.ordered_ns, strict=True)
        if each.reason == "leap"
    ]


@pytest.fixture(scope="module")
def ahead() -> Rig:
    return run(leap_rig(orbit_over(heading_deg=50.0)), 40)


def test_once_the_orbit_is_known_the_mount_leaves_as_the_shutter_closes(ahead) -> None:
    waits = waits_s(ahead)
    assert min(waits[:3]) > 0.4  # the first ones wait for what their frame shows
    assert max(waits[3:]) < 0.2
    assert max(waits[10:]) < 0.1  # four sigmas of what the streaks have told of the shutter
    assert met(ahead) >= len(leaps(ahead)) - 1


def test_no_shutter_is_open_while_the_mount_moves(ahead) -> None:
    assert ahead.camera.moved == set()
    assert min(waits_s(ahead)) > 0.0


def test_no_shutter_opens_before_the_mount_has_settled(ahead) -> None:
    """The exposure is ordered while it settles, by as much as the shutter takes to open."""
    opened = {each.frame_id: each.t_start_utc_ns for each in ahead.memory.of(FrameTaken)}
    settled = [
        (opened[frame] - arrived_ns) / NS for frame, arrived_ns in ahead.camera.arrived_ns.items()
    ]
    assert min(settled) >= ahead.engine.config.mount.settle_s
    assert np.median(settled[-10:]) < ahead.engine.config.mount.settle_s + 0.35


def test_a_mount_whose_stars_stay_sharp_is_given_less_time_to_settle(ahead) -> None:
    r = run(leap_rig(orbit_over(heading_deg=50.0), config_with(leap={"learns_settle": True})), 60)
    settled = [each.settle_s for each in r.memory.of(LeapDone)]
    assert settled[0] == 1.0
    # While what is kept is held against the configured time, every second leap has that.
    assert sorted(settled[-8:])[2] < 0.7
    # What was planned with is what was given: none comes late by it, and every one is met.
    assert met(r) >= len(leaps(r)) - 1
    assert r.camera.moved == set()
    for each in r.memory.of(LeapDone):
        named = each.slew_s + each.settle_s + each.shutter_s + each.open_s + each.readout_s
        assert each.total_s == pytest.approx(named + each.wait_s, abs=1e-6)
    said = [text for text in words(r) if text.startswith("the mount is given")]
    assert said[0].startswith(
        "the mount is given 0.8 s to settle: stars are as sharp as after 1.0 s"
    )


@pytest.fixture(scope="module")
def late() -> Rig:
    """Each order waits for what its frame shows."""
    return run(leap_rig(orbit_over(heading_deg=50.0), config_with(leap=LATE)), 40)


def test_more_leaps_fit_into_a_pass(ahead, late) -> None:
    assert min(waits_s(late)) > 0.4

    def middle_s(r: Rig) -> float:
        return float(np.median(np.diff([each.t_aim_utc_ns for each in leaps(r)]))) / NS

    assert middle_s(ahead) < middle_s(late) - 0.5


def test_frames_are_on_record_where_the_mount_stood_not_where_it_went(ahead) -> None:
    stood = ahead.camera.looked_deg
    told = [each for each in ahead.memory.of(FrameTaken) if each.pointing_ra_icrs_deg is not None]
    for each in told:
        assert each.pointing_ra_icrs_deg == pytest.approx(stood[each.frame_id][0])


def test_after_a_miss_it_waits_for_what_the_frame_shows() -> None:
    r = leap_rig(orbit_over(heading_deg=50.0))
    r.reducer.blind = {20}
    run(r, 26)
    by_frame = dict(zip([each.frame_id for each in leaps(r)], waits_s(r), strict=True))
    assert by_frame[20] < 0.15  # ordered before anybody knew
    assert by_frame[21] > 0.4
    assert by_frame[25] < 0.15
    assert r.engine.leaping.track is not None


@pytest.mark.parametrize("moment", ["open", "closed"])
def test_a_stop_in_an_exposure_leaves_the_mount_standing(moment) -> None:
    r = leap_rig(orbit_over(heading_deg=50.0))
    command_handler = engine_rig.command_handler_of(r)
    slews_at_stop: list[int] = []

    def stop() -> None:
        command_handler.handle(engine_rig.asked("stop"))
        slews_at_stop.append(len(r.mount.slews))

    start, report = r.camera.start_exposure, r.mount.report

    def started(exposure_s: float, frame_id: int) -> None:
        start(exposure_s, frame_id)
        if frame_id == 20 and moment == "open":
            stop()
        elif frame_id == 20:
            r.mount.report = stopped_report

    def stopped_report(*asked):
        if not slews_at_stop:
            stop()
        return report(*asked)

    r.camera.start_exposure = started
    r.engine.arm()
    engine_rig.end_when_idle(r)
    r.engine.run()
    assert len(r.mount.slews) == slews_at_stop[0]
    assert r.mount.aborts > 0
    assert r.engine.following.state == "IDLE"


def test_every_slew_that_is_ordered_ahead_is_held_against_the_limits(monkeypatch) -> None:
    """A wall comes up while the satellite is followed: nothing is ordered through it."""
    r = leap_rig(orbit_over(heading_deg=50.0))
    r.engine.arm()
    r.engine.run(frames=20)
    before = len(r.mount.slews)
    assert waits_s(r)[-1] < 0.15
    asked: list[SlewCommand] = []

    def walled(_self, slew: SlewCommand, _t_until_utc_ns: int) -> SlewRefusal:
        asked.append(slew)
        return SlewRefusal(kind="horizon", value_deg=20.0, bound_deg=50.0)

    # Of the order alone: the choice of a place knows of no wall, so that it is asked for.
    monkeypatch.setattr(Slews, "_refusal_of", walled)
    r.engine.run(frames=24)
    assert any(slew.reason.startswith("leap") for slew in asked)
    assert len(r.mount.slews) == before


def test_a_hold_behind_an_order_at_the_close_teaches_no_pointing_offset() -> None:
    """The mount arrives while the camera reads out; the next exposure is taken where it stands."""
    r = leap_rig(orbit_over(heading_deg=50.0))
    r.engine.arm()
    r.engine.run(frames=20)
    closed, held = r.engine.instrument_controller.on_closed, []

    def hold_after() -> MountReport | None:
        looked = closed()
        if looked is not None and not held:
            held.append(r.mount.slews[-1])
            r.clock.wait_until(r.clock.now_utc_ns() + 20 * NS)  # it has arrived long since
            r.engine.handle(Held(by="operator"))
            raise Interrupted
        return looked

    r.engine.instrument_controller.on_closed = hold_after
    r.engine.run(frames=23)
    assert held
    offset = r.engine.planner._pointing.last
    assert max(abs(offset.east_arcsec), abs(offset.north_arcsec)) < 60.0


@pytest.mark.parametrize("error", [InstrumentError("it is silent"), StoppedElsewhere("by hand")])
def test_an_exposure_whose_order_at_the_close_fails_is_given_up(error: Exception) -> None:
    """Or its frame would come while the next one is exposed, and pass for that one's."""
    r = leap_rig(orbit_over(heading_deg=50.0))
    r.engine.arm()
    r.engine.run(frames=20)
    aborts: list[int] = []
    r.camera.abort = lambda: aborts.append(1)
    failing = [error]
    closed = r.engine.instrument_controller.on_closed

    def fails() -> MountReport | None:
        if failing:
            raise failing.pop()
        return closed()

    r.engine.instrument_controller.on_closed = fails
    r.engine.run(frames=21)
    assert aborts == [1]


def test_a_look_at_the_middle_is_enough_for_the_order(late) -> None:
    config = config_with(leap=LATE)
    r = leap_rig(orbit_over(heading_deg=50.0), config)
    r.reducer.sees_middle = True
    run(r, 30)
    processing_s = config.indi.simulated_latency_s
    waits = waits_s(r)
    assert max(waits[1:]) < 0.4 + processing_s - 0.2  # the first frame is of the stare
    assert met(r) >= len(leaps(r)) - 1
    assert min(waits_s(late)) > 0.4 + processing_s - 0.1


def test_what_the_middle_does_not_show_the_whole_frame_tells() -> None:
    r = run(leap_rig(orbit_over(heading_deg=50.0), config_with(leap=LATE)), 24)
    assert len(r.reducer.glances) >= 5
    assert met(r) >= len(leaps(r)) - 1


def test_pixels_are_joined_for_the_leaps_alone() -> None:
    r = leap_rig(orbit_over(heading_deg=50.0), config_with(leap={"binning": 2}))
    r.engine.arm()
    r.engine.run(frames=3)
    assert r.camera.binned == [2]
    terms = r.engine.leaping.telescope().terms
    assert terms.scale_arcsec_px == pytest.approx(2 * r.engine.config.optics.scale_arcsec_px)
    assert terms.field_deg == r.engine.config.optics.field_deg
    engine_rig.told(engine_rig.command_handler_of(r), "disarm", {})
    engine_rig.end_when_idle(r)
    r.engine.run()
    assert r.camera.binned == [2, 1]


def test_a_camera_that_cannot_join_pixels_is_said_once_and_used() -> None:
    r = leap_rig(orbit_over(heading_deg=50.0), config_with(leap={"binning": 2}))

    def cannot(binning: int) -> int:
        raise InstrumentError("the camera's driver cannot join pixels: set leap.binning to 1")

    r.camera.set_binning = cannot
    run(r, 14)
    assert sum("leaps without binning" in text for text in words(r)) == 1
    assert r.engine.leaping.telescope().terms.binning == 1
    assert met(r) >= 1


# ---- a part of the sensor

FINE = {"pixel_um": 3.8, "width_px": 4656, "height_px": 3520}


def slow_camera(subframe: float, readout_s: float = 6.0, *, leap=None) -> Rig:
    config = config_with(
        optics=FINE, exposure={"readout_s": readout_s}, leap={"subframe": subframe, **(leap or {})}
    )
    return leap_rig(orbit_over(heading_deg=50.0), config)


@pytest.fixture(scope="module")
def parted() -> Rig:
    """Half of each side is read."""
    return run(slow_camera(0.5), 24)


def test_a_part_of_the_sensor_is_read_where_the_streak_surely_is(parted) -> None:
    r = parted
    assert r.camera.shares[0] == 0.5
    done = r.memory.of(LeapDone)
    assert [each.subframe for each in done[:2]] == [1.0, 1.0]  # its orbit is not known yet
    parts = [each for each in done if each.subframe == 0.5]
    assert len(parts) > 10
    assert all(each.result == "met" for each in parts)
    sizes = {each.frame_id: (each.width_px, each.height_px) for each in r.memory.of(FrameTaken)}
    assert {sizes[each.frame_id] for each in parts} == {(2328, 1760)}


def test_half_of_each_side_is_read_where_the_whole_keeps_leaps_waiting() -> None:
    slow, quick, whole = (
        run(slow_camera(subframe, readout_s), 20)
        for subframe, readout_s in ((0.0, 6.0), (0.0, 0.4), (1.0, 6.0))
    )
    assert set(slow.camera.shares) == {0.5}
    assert not quick.camera.shares
    assert not whole.camera.shares
    took_s = [
        np.median([each.total_s for each in r.memory.of(LeapDone)[-8:]]) for r in (slow, whole)
    ]
    assert took_s[0] < 0.75 * took_s[1]


def test_after_a_miss_the_whole_sensor_is_read() -> None:
    r, number = slow_camera(0.5), 14
    r.reducer.blind = {number}
    run(r, 20)
    by_frame = {each.frame_id: each for each in r.memory.of(LeapDone)}
    assert by_frame[number].subframe == 0.5
    assert by_frame[number].result == "not in the frame"
    assert by_frame[number + 1].subframe == 1.0
    assert r.memory.of(LeapDone)[-1].subframe == 0.5


def test_a_stop_gives_the_whole_sensor_back() -> None:
    r = slow_camera(0.5)
    r.engine.arm()
    r.engine.run(frames=16)
    assert r.camera.shares == [0.5]
    engine_rig.told(engine_rig.command_handler_of(r), "disarm", {})
    engine_rig.end_when_idle(r)
    r.engine.run()
    assert r.camera.shares == [0.5, 1.0]


def test_a_camera_that_reads_no_parts_is_said_once_and_read_whole() -> None:
    r = slow_camera(0.5)

    def cannot(share: float) -> float:
        raise InstrumentError("the camera's driver cannot read a part of the sensor")

    r.camera.set_subframe = cannot
    run(r, 20)
    assert sum("leaps without subframes" in text for text in words(r)) == 1
    assert {each.subframe for each in r.memory.of(LeapDone)} == {1.0}
    assert met(r) >= 10


def test_a_part_that_may_be_in_force_though_it_was_refused_is_given_back() -> None:
    """The driver took it and answered too late."""
    r, asked = slow_camera(0.5), []

    def late(share: float) -> float:
        asked.append(share)
        if share < 1.0:
            raise InstrumentError("the camera did not take 2328 x 1760 pixels")
        return share

    r.camera.set_subframe = late
    run(r, 14)
    assert asked == [0.5, 1.0]


def test_a_whole_sensor_that_is_not_given_back_is_asked_for_again_and_said_once() -> None:
    r, asked = slow_camera(0.5), []

    def stuck(share: float) -> float:
        asked.append(share)
        if share == 1.0 and len(asked) < 4:
            raise InstrumentError("an exposure is under way")
        return share

    r.camera.set_subframe = stuck
    r.reducer.blind = {14}
    run(r, 24)
    assert asked[:2] == [0.5, 1.0]
    assert sum("still reads a part" in text for text in words(r)) == 1
    assert r.memory.of(LeapDone)[-1].subframe == 0.5


def test_a_part_with_too_few_stars_for_a_plate_is_not_read() -> None:
    config = config_with(leap={"subframe": 0.5})  # 880 px high: 440 are too few
    r = run(leap_rig(orbit_over(heading_deg=50.0), config), 16)
    assert not r.camera.shares
    assert met(r) >= 10


# ---- when the shutter has surely closed


def times_of(r: Rig) -> LeapTimes:
    instrument_controller: InstrumentController = r.engine.instrument_controller
    return LeapTimes(Config, instrument_controller, r.engine.watch)


def frame_of(opened_ns: int, later_s: float) -> Frame:
    return Frame(
        frame_id=1,
        name="",
        pixels=np.zeros((4, 4), np.uint16),
        t_start_utc_ns=opened_ns + round(later_s * NS),
        exposure_s=0.2,
    )


def test_a_shutter_has_closed_after_the_latest_that_was_seen() -> None:
    times = times_of(leap_rig(orbit_over(heading_deg=50.0)))
    latencies = np.random.default_rng(1).normal(0.5, 0.03, 200)
    late = 0
    for n, latency_s in enumerate(latencies):
        closed_s = times.shutter_closed_after_s(0.2)
        if n >= 6 and closed_s is not None:
            late += closed_s < latency_s + 0.2
        times.learn_shutter_delay(frame_of(NS * n, latency_s), NS * n)
    assert late <= 2
    closed_s = times.shutter_closed_after_s(0.2)
    assert closed_s is not None
    assert closed_s < 0.5 + 0.2 + 0.15


@pytest.mark.parametrize("off_s", [-8.0, 8.0])
def test_a_camera_whose_clock_is_off_does_not_tell_when_its_shutter_closes(off_s) -> None:
    times = times_of(leap_rig(orbit_over(heading_deg=50.0)))
    for n in range(8):
        times.learn_shutter_delay(frame_of(NS * n, off_s), NS * n)
    assert times.shutter_closed_after_s(0.2) is None


def test_what_the_streaks_tell_of_the_shutter_is_waited_for_unless_the_frame_comes_sooner() -> None:
    times = times_of(leap_rig(orbit_over(heading_deg=50.0)))
    for n in range(8):
        times.learn_shutter_delay(frame_of(NS * n, 0.5), NS * n)
    steady_s, scattered_s = (
        times.shutter_closed_after_s(0.2),
        times.shutter_closed_after_s(0.2, 0.1),
    )
    assert steady_s is not None
    assert scattered_s is not None
    assert scattered_s == pytest.approx(0.5 + 0.2 + 4 * 0.1, abs=0.01)
    times.learn_processing_time(7 * NS + round(0.9 * NS))  # 0.2 s after the last shutter closed
    assert times.shutter_closed_after_s(0.2, 0.1) is None
    assert times.shutter_closed_after_s(0.2) == steady_s


# ---- on record


def test_each_leap_is_on_record_with_what_came_of_it_and_what_it_took(ahead) -> None:
    done = ahead.memory.of(LeapDone)
    assert len(done) == len(leaps(ahead)) - 1  # the last one's frame is not yet taken
    assert [each.number for each in done] == list(range(1, len(done) + 1))
    assert {each.ordered for each in done[:3]} == {"by the frame"}
    assert {each.ordered for each in done[4:]} == {"at close"}
    assert sum(each.result == "met" for each in done) == met(ahead)
    for each in done:
        named = each.slew_s + each.settle_s + each.shutter_s + each.open_s + each.readout_s
        assert named + each.wait_s == pytest.approx(each.total_s)
    late = [each for each in done[5:] if each.result == "met"]
    beside = [each.total_s - each.slew_s - each.settle_s - each.open_s for each in late]
    assert np.median(beside) < 0.5
    off = np.array([(each.off_along_arcsec, each.off_across_arcsec) for each in late])
    sigma = np.array([(each.sigma_along_arcsec, each.sigma_across_arcsec) for each in late])
    assert np.sqrt(np.mean((off[:, 1] / np.hypot(sigma[:, 1], 2.0)) ** 2)) < 2.0
    assert np.all(np.abs(off[:, 0]) < 600.0)


def test_a_miss_is_on_record_with_its_reason() -> None:
    r = leap_rig(orbit_over(heading_deg=50.0))
    r.reducer.blind, r.reducer.unsolved = {18}, {22}
    run(r, 26)
    by_frame = {each.frame_id: each for each in r.memory.of(LeapDone)}
    assert by_frame[18].result == "not in the frame"
    assert by_frame[18].off_along_arcsec is None
    assert by_frame[22].result == "not solved"


def test_a_pass_that_is_cut_off_is_on_record_too() -> None:
    r = leap_rig(orbit_over(heading_deg=50.0))
    r.engine.arm()
    r.engine.run(frames=18)
    engine_rig.told(engine_rig.command_handler_of(r), "disarm", {})
    engine_rig.end_when_idle(r)
    r.engine.run()
    [found] = r.memory.of(LowPass)
    assert found.ended == "autonomy has lost the mount"
    assert found.r_gcrs_km is not None
