"""Limits hold for every motion of the mount, whatever its driver says of it: measured, and ahead.

The mount of these tests has two axes that speed up and slow down; the watch looks once a second.
"""

import contextlib
import dataclasses
import math
import random

import pytest

from rsoconsole.config import Config
from rsoconsole.engine.aim.instrument_controller import Interrupted, Ordered
from rsoconsole.engine.aim.states import LimitMet, Taken
from rsoconsole.engine.tasks.watch import Watch
from rsoconsole.instruments import MountAbilities, MountReport, PierSide, StopResult
from rsoconsole.instruments.motion import DirectionReport, Motion, MotionMeter
from rsoconsole.records import Event, Site
from rsoconsole.simulator.mount.mount_model import MountModel, MountTraits
from rsoconsole.sky import (
    Limits,
    Pose,
    altaz_to_icrs,
    icrs_of_hour_angle,
    icrs_to_altaz,
    icrs_to_jnow,
    jnow_to_icrs,
    sun_icrs,
    wrap_180,
)
from tests.makers import NS, T0_UTC_NS
from tests.rigs.engine_rig import CONFIG, SITE, PlainMount, Rig, StillClock, rig
from tests.tiers import plain_first

SPEED_DEG_S, BRAKES_DEG_S2 = 4.0, 2.0
NEEDS_TO_STOP_DEG = SPEED_DEG_S**2 / (2.0 * BRAKES_DEG_S2)
SIDEREAL_DEG_S = 15.041067 / 3600.0
NOON_NS = T0_UTC_NS + 15 * 3600 * NS
FORK = {"mount": {"type": "fork"}}
STEP_S = 0.05


class Axes(PlainMount):
    """A mount that anybody may move; it obeys ABORT, unless it is told not to."""

    def __init__(self, clock: StillClock) -> None:
        super().__init__(clock)
        self.goes_to: tuple[float, float] | None = None
        self.rates_deg_s = [0.0, 0.0]
        self.obeys = True
        self.claims_slewing = True
        self.is_measured = True
        self.parks = 0
        self.lowest_deg = 90.0
        self.meter = MotionMeter(period_s=0.5)
        self._since_s = 0.0

    @property
    def is_moving(self) -> bool:
        return any(abs(rate) > 1e-9 for rate in self.rates_deg_s) or self.goes_to is not None

    def pass_time(self, seconds: float) -> None:
        for _ in range(round(seconds / STEP_S)):
            self._step()
            self.clock.t_utc_ns += round(STEP_S * NS)
            self._since_s += STEP_S
            if self._since_s > 0.499:
                self._since_s = 0.0
                t_s = (self.clock.t_utc_ns - T0_UTC_NS) / NS
                self.meter.add(
                    DirectionReport(
                        t_s=t_s, host_s=t_s, ra_deg=self.at_deg[0], dec_deg=self.at_deg[1]
                    )
                )
                self.lowest_deg = min(self.lowest_deg, self.altitude_deg)

    def _step(self) -> None:
        at = list(self.at_deg)
        for axis in (0, 1):
            wanted = 0.0
            if self.goes_to is not None:
                left = self.goes_to[axis] - at[axis]
                left = wrap_180(left) if axis == 0 else left
                wanted = math.copysign(
                    min(SPEED_DEG_S, math.sqrt(2.0 * BRAKES_DEG_S2 * abs(left))), left
                )
            change = BRAKES_DEG_S2 * STEP_S
            rate = self.rates_deg_s[axis]
            self.rates_deg_s[axis] = rate + min(max(wanted - rate, -change), change)
            at[axis] += self.rates_deg_s[axis] * STEP_S
        if not self.is_moving and (self.is_parked or not self.is_tracking):
            at[0] += SIDEREAL_DEG_S * STEP_S
        self.at_deg = (at[0] % 360.0, min(max(at[1], -90.0), 90.0))
        if self.goes_to is not None and max(map(abs, self.rates_deg_s)) < 0.06:
            ra_left = abs(wrap_180(self.goes_to[0] - at[0]))
            if max(ra_left, abs(self.goes_to[1] - at[1])) < 0.02:
                self.goes_to, self.rates_deg_s = None, [0.0, 0.0]

    @property
    def altitude_deg(self) -> float:
        return icrs_to_altaz(SITE, *self.at_deg, self.clock.t_utc_ns)[0]

    def report(self, not_before_utc_ns: int | None = None, timeout_s: float = 10.0) -> MountReport:
        t_s = (self.clock.t_utc_ns - T0_UTC_NS) / NS
        measured = self.measured or self.meter.motion(t_s)
        return dataclasses.replace(
            super().report(),
            is_slewing=self.is_moving and self.claims_slewing,
            motion=measured if self.is_measured else Motion(),
        )

    def abort(self, timeout_s: float = 2.0, **_: object) -> StopResult:
        self.aborts += 1
        if self.obeys:
            self.goes_to = None
        return StopResult(is_answered=True, ms=1.0, path="mount")

    def park(self) -> None:
        self.parks += 1


def watched(config: Config = CONFIG, at: tuple[float, float] = (50.0, 180.0)) -> tuple[Rig, Axes]:
    """An engine whose loop does not run, and a mount at an altitude and azimuth."""
    made: list[Axes] = []

    def make(clock: StillClock) -> Axes:
        made.append(Axes(clock))
        return made[0]

    r = rig(set(), config, make_mount=make)
    mount = made[0]
    mount.at_deg = altaz_to_icrs(SITE, *at, r.clock.t_utc_ns)
    mount.pier_side = None
    return r, mount


def pass_looks(r: Rig, mount: Axes, seconds: int) -> None:
    """The watch looks at 1 Hz; the loop takes notice of what it is told."""
    for _ in range(seconds):
        mount.pass_time(1.0)
        r.engine.watch.look()
        alarms_of(r)


def alarms_of(r: Rig) -> list[str]:
    """What the loop would say of the limits met since it was asked last."""
    heard = getattr(r, "heard", [])
    for alarm in r.queue.take_alarms():
        assert isinstance(alarm.trigger, LimitMet)
        heard.append(alarm.trigger.words)
    r.heard = heard  # type: ignore[attr-defined]
    return heard


def said(r: Rig) -> list[str]:
    return [event.text for event in r.memory.of(Event)]


# --- somebody else's slews


@pytest.mark.parametrize("claims_slewing", [True, False])
@pytest.mark.parametrize("is_measured", [True, False])
@pytest.mark.parametrize("to", [(-20.0, 180.0), (-20.0, 230.0), (-60.0, 110.0)])
@pytest.mark.parametrize("at", [(50.0, 180.0), (30.0, 120.0), (75.0, 250.0)])
def test_another_client_s_slew_below_the_horizon_ends_above_it(at, to, is_measured, claims_slewing):
    """It was let go until it had arrived, 20 degrees below."""
    r, mount = watched(at=at)
    mount.claims_slewing, mount.is_measured = claims_slewing, is_measured
    pass_looks(r, mount, 8)
    mount.goes_to = altaz_to_icrs(SITE, *to, mount.clock.t_utc_ns)
    pass_looks(r, mount, 40)
    assert mount.lowest_deg > -NEEDS_TO_STOP_DEG
    if is_measured:
        assert mount.lowest_deg > 0.0
    assert mount.aborts == 1
    assert not mount.is_moving
    [words] = alarms_of(r)
    assert "off any way ordered here" in words
    assert "below the horizon" in words
    assert "ABORT sent" in words
    assert r.engine.authority.state == "IDLE"


def test_what_the_mount_did_after_its_abort_is_measured_and_told():
    r, mount = watched()
    pass_looks(r, mount, 8)
    mount.goes_to = altaz_to_icrs(SITE, -20.0, 180.0, mount.clock.t_utc_ns)
    pass_looks(r, mount, 40)
    [line] = [text for text in said(r) if "after ABORT" in text]
    assert "tracks (measured)" in line
    on_deg = float(line.split(", ")[-1].removesuffix(" deg on"))
    # The place at the order is where the last report and its rate have it.
    assert on_deg == pytest.approx(NEEDS_TO_STOP_DEG, abs=2.0)


def test_what_this_mount_needs_to_stop_is_learned_from_its_stops():
    r, mount = watched()
    distance = r.engine.watch._stop.distance
    assert distance.at(SPEED_DEG_S) == pytest.approx(5.0)
    pass_looks(r, mount, 8)
    mount.goes_to = altaz_to_icrs(SITE, -20.0, 180.0, mount.clock.t_utc_ns)
    pass_looks(r, mount, 40)
    assert distance.is_learned
    assert 3.0 < distance.at(SPEED_DEG_S) < 6.5


def test_a_stop_teaches_too():
    r, mount = watched(at=(80.0, 180.0))
    pass_looks(r, mount, 8)
    mount.goes_to = altaz_to_icrs(SITE, 20.0, 180.0, mount.clock.t_utc_ns)
    pass_looks(r, mount, 5)
    r.engine.watch.abort_ordered()
    mount.abort()
    pass_looks(r, mount, 15)
    assert r.engine.watch._stop.distance.is_learned
    assert alarms_of(r) == []
    assert not any("after ABORT" in text for text in said(r))


def test_a_mount_that_goes_on_is_told_twice_a_minute_and_the_alarm_is_said_once():
    r, mount = watched()
    mount.obeys = False
    pass_looks(r, mount, 8)
    mount.goes_to = altaz_to_icrs(SITE, -85.0, 180.0, mount.clock.t_utc_ns)
    pass_looks(r, mount, 30)
    assert mount.aborts == 1
    assert len(alarms_of(r)) == 1
    [line] = [text for text in said(r) if "10 s after ABORT" in text]
    assert "still moves at 4.0 deg/s" in line
    assert "cut its power" in line


def test_a_new_motion_beyond_a_limit_is_stopped_again():
    r, mount = watched()
    pass_looks(r, mount, 8)
    for count in (1, 2):
        mount.goes_to = altaz_to_icrs(SITE, -20.0, 180.0, mount.clock.t_utc_ns)
        pass_looks(r, mount, 25)
        assert mount.aborts == count
        assert len(alarms_of(r)) == count
        mount.goes_to = altaz_to_icrs(SITE, 50.0, 180.0, mount.clock.t_utc_ns)
        pass_looks(r, mount, 25)


def test_a_slew_that_leads_out_from_below_the_horizon_is_let_be():
    r, mount = watched(at=(-4.0, 180.0))
    mount.is_tracking = False
    pass_looks(r, mount, 8)
    mount.goes_to = altaz_to_icrs(SITE, 40.0, 200.0, mount.clock.t_utc_ns)
    pass_looks(r, mount, 30)
    assert mount.aborts == 0
    assert mount.altitude_deg > 35.0


def test_a_slow_move_is_let_nearer_than_a_fast_one():
    """By hand at an eighth of a degree a second: stopped within its own second."""
    r, mount = watched(at=(6.0, 180.0))
    pass_looks(r, mount, 8)
    for _ in range(80):
        mount.rates_deg_s = [0.0, -0.125] if mount.aborts == 0 else [0.0, 0.0]
        mount._step = lambda: _drift(mount)  # type: ignore[method-assign]
        pass_looks(r, mount, 1)
    assert mount.aborts == 1
    assert 0.0 < mount.lowest_deg < 1.5


def _drift(mount: Axes) -> None:
    mount.at_deg = (mount.at_deg[0], mount.at_deg[1] + mount.rates_deg_s[1] * STEP_S)


@pytest.mark.parametrize(
    ("config", "side", "start", "rates", "limit"),
    [
        (FORK, None, (60.0, 70.0), (-4.0, 0.0), "hour angle"),
        ({}, "west", (-40.0, 20.0), (-4.0, 0.0), "polar axis"),
        ({}, "east", (40.0, 20.0), (4.0, 0.0), "polar axis"),
        ({"limits": {"horizon": ((0.0, 30.0),)}}, None, (-10.0, 20.0), (0.0, -4.0), "horizon"),
    ],
)
def test_every_limit_is_held_ahead_of_a_foreign_motion(config, side, start, rates, limit):
    r, mount = watched(Config.model_validate(config))
    mount.at_deg = icrs_of_hour_angle(SITE, *start, mount.clock.t_utc_ns)
    mount.pier_side = side
    pass_looks(r, mount, 8)
    ra_deg, dec_deg = mount.at_deg
    mount.goes_to = ((ra_deg + 30.0 * rates[0]) % 360.0, dec_deg + 30.0 * rates[1])
    margins = []
    for _ in range(40):
        pass_looks(r, mount, 1)
        pose = pose_of(mount)
        margins.append(
            min(m for name, m in r.engine.watch.limits.margins_deg(pose) if name != "altitude")
        )
    [words] = alarms_of(r)
    assert limit in words
    assert mount.aborts == 1
    assert min(margins) > -0.1


def test_the_sun_is_held_ahead_by_day():
    r, mount = watched(Config.model_validate(FORK))
    r.clock.t_utc_ns = NOON_NS
    ra_deg, dec_deg = sun_icrs(NOON_NS)
    mount.at_deg = ((ra_deg + 75.0) % 360.0, dec_deg)
    pass_looks(r, mount, 8)
    mount.goes_to = (ra_deg, dec_deg)
    pass_looks(r, mount, 30)
    [words] = alarms_of(r)
    assert "from the Sun" in words
    assert abs(wrap_180(mount.at_deg[0] - ra_deg)) * math.cos(math.radians(dec_deg)) > 40.0


def test_autonomy_s_least_altitude_is_held_ahead_of_a_foreign_motion_too():
    r, mount = watched()
    r.engine.watch.take_over(True)
    pass_looks(r, mount, 8)
    mount.goes_to = altaz_to_icrs(SITE, 5.0, 180.0, mount.clock.t_utc_ns)
    pass_looks(r, mount, 30)
    assert mount.lowest_deg > CONFIG.limits.min_altitude_deg
    assert "below the limit of 15.0" in alarms_of(r)[0]


# --- slews that were ordered here


def order(r: Rig, mount: Axes, to: tuple[float, float]) -> None:
    r.engine.instrument_controller.ordered = Ordered(t_utc_ns=r.clock.t_utc_ns, to_icrs_deg=to)
    mount.goes_to = to


def order_park(r: Rig, mount: Axes) -> None:
    r.engine.instrument_controller.ordered = Ordered(t_utc_ns=r.clock.t_utc_ns, to_icrs_deg=None)
    mount.is_tracking = False


def test_a_slew_that_was_ordered_here_reaches_a_place_just_above_the_limit():
    r, mount = watched()
    pass_looks(r, mount, 8)
    order(r, mount, altaz_to_icrs(SITE, 1.0, 180.0, mount.clock.t_utc_ns))
    pass_looks(r, mount, 30)
    assert mount.aborts == 0
    assert mount.altitude_deg == pytest.approx(1.0, abs=0.3)


def test_the_same_slew_of_somebody_else_ends_before_it():
    r, mount = watched()
    pass_looks(r, mount, 8)
    mount.goes_to = altaz_to_icrs(SITE, 1.0, 180.0, mount.clock.t_utc_ns)
    pass_looks(r, mount, 30)
    assert mount.aborts == 1


def test_a_slew_that_somebody_else_turns_away_from_its_end_is_nobody_s_here():
    r, mount = watched(at=(40.0, 180.0))
    pass_looks(r, mount, 8)
    order(r, mount, altaz_to_icrs(SITE, 80.0, 180.0, mount.clock.t_utc_ns))
    pass_looks(r, mount, 4)
    mount.goes_to = altaz_to_icrs(SITE, -30.0, 180.0, mount.clock.t_utc_ns)
    pass_looks(r, mount, 40)
    assert mount.aborts == 1
    assert mount.lowest_deg > 0.0


def test_a_slew_goes_on_beyond_its_end_only_within_the_limits():
    r, mount = watched(at=(40.0, 180.0))
    pass_looks(r, mount, 8)
    order(r, mount, altaz_to_icrs(SITE, 25.0, 180.0, mount.clock.t_utc_ns))
    mount.goes_to = altaz_to_icrs(SITE, -30.0, 180.0, mount.clock.t_utc_ns)
    pass_looks(r, mount, 40)
    assert mount.aborts == 1
    assert mount.lowest_deg > 0.0


@pytest.mark.parametrize("alt_deg", [-3.0, 0.0, 29.0])
def test_parking_may_lead_to_a_level_place(alt_deg):
    r, mount = watched()
    pass_looks(r, mount, 8)
    order_park(r, mount)
    mount.goes_to = altaz_to_icrs(SITE, alt_deg, 180.0, mount.clock.t_utc_ns)
    pass_looks(r, mount, 40)
    assert mount.aborts == 0


def test_parking_does_not_lead_deep_below_the_horizon():
    r, mount = watched()
    pass_looks(r, mount, 8)
    order_park(r, mount)
    mount.goes_to = altaz_to_icrs(SITE, -40.0, 180.0, mount.clock.t_utc_ns)
    pass_looks(r, mount, 40)
    assert mount.aborts == 1


# --- what the driver says is a claim


def test_a_mount_that_says_parked_and_tracks_is_stopped_once_and_told():
    r, mount = watched()
    mount.is_parked, mount.measured = True, Motion(kind="tracks")
    pass_looks(r, mount, 25)
    alarms = [text for text in said(r) if "says that it is parked and tracks (measured)" in text]
    assert len(alarms) == 1
    assert mount.aborts == 1
    assert mount.is_tracking is False


def test_a_mount_that_says_parked_and_moves_is_stopped_once_and_told():
    r, mount = watched()
    mount.is_parked = True
    mount.claims_slewing = mount.obeys = False
    pass_looks(r, mount, 10)
    mount.goes_to = altaz_to_icrs(SITE, 80.0, 0.0, mount.clock.t_utc_ns)
    mount._step = lambda: _turn(mount)  # type: ignore[method-assign]
    pass_looks(r, mount, 20)
    alarms = [text for text in said(r) if "says that it is parked and moves (measured)" in text]
    assert len(alarms) == 1
    assert mount.aborts == 1


def _turn(mount: Axes) -> None:
    mount.at_deg = ((mount.at_deg[0] + 0.5 * STEP_S) % 360.0, mount.at_deg[1])


@pytest.mark.parametrize("measured", [Motion(kind="stands", ra_rate_arcsec_s=15.04), Motion()])
@pytest.mark.parametrize("at", [(55.0, 180.0), (-6.0, 180.0), (2.0, 300.0)])
def test_a_parked_mount_at_rest_is_let_be_wherever_that_is(at, measured):
    r, mount = watched(at=at)
    mount.is_parked, mount.measured = True, measured
    pass_looks(r, mount, 25)
    assert mount.aborts == 0
    assert said(r) == alarms_of(r) == []


def test_a_mount_that_has_just_parked_is_not_taken_for_one_that_moves():
    r, mount = watched()
    pass_looks(r, mount, 8)
    order_park(r, mount)
    mount.goes_to = altaz_to_icrs(SITE, 30.0, 0.0, mount.clock.t_utc_ns)
    while mount.is_moving:
        pass_looks(r, mount, 1)
    mount.is_parked = True
    pass_looks(r, mount, 40)
    assert mount.aborts == 0
    assert said(r) == []


def test_a_standing_mount_below_the_horizon_is_let_be_and_one_that_tracks_there_is_not():
    r, mount = watched(at=(-3.0, 200.0))
    mount.is_tracking = False
    pass_looks(r, mount, 10)
    assert (mount.aborts, alarms_of(r)) == (0, [])
    # Its driver says that it stands.
    mount.measured = Motion(kind="tracks")
    pass_looks(r, mount, 3)
    assert mount.aborts == 1
    [words] = alarms_of(r)
    assert "below the horizon" in words
    assert "tracking switched off" in words


# --- the least altitude is autonomy's affair


def test_a_mount_by_hand_below_the_least_altitude_is_let_be_and_told_once():
    r, mount = watched(at=(14.0, 180.0))
    pass_looks(r, mount, 20)
    assert (mount.aborts, alarms_of(r)) == (0, [])
    [line] = [text for text in said(r) if "altitude" in text]
    assert "let be" in line
    assert r.engine.watch.next_limit is None or r.engine.watch.next_limit[1].limit != "altitude"
    r.engine.watch.take_over(True)
    pass_looks(r, mount, 2)
    assert mount.aborts == 1
    assert "below the limit of 15.0" in alarms_of(r)[0]


def test_the_sun_acts_on_a_tracking_mount_although_nobody_is_armed():
    r, mount = watched()
    r.clock.t_utc_ns = NOON_NS
    mount.at_deg = sun_icrs(NOON_NS)
    pass_looks(r, mount, 6)
    assert mount.aborts >= 1
    assert "from the Sun" in alarms_of(r)[0]


def test_an_exposure_that_would_end_behind_a_limit_ends_tracking_once():
    config = Config.model_validate({"limits": {"past_meridian_deg": 20}})
    r, mount = watched(config)
    mount.at_deg = icrs_of_hour_angle(SITE, 19.98, 10.0, r.clock.t_utc_ns)
    mount.pier_side, mount.measured = "west", Motion(kind="tracks")
    r.engine.handle(Taken(by="operator"))
    r.engine.watch.look()
    assert r.engine.watch.next_limit is not None
    mount.measured = None
    for _ in range(5):  # no second has passed in which the watch could look again
        with contextlib.suppress(Interrupted):
            r.engine.commands.heed_alarms()
            r.engine._one_turn(is_bounded=False)
        if r.engine.frame_id:
            break
    assert r.engine.frame_id == 1
    assert not mount.is_tracking
    assert sum("before the end of this exposure" in text for text in said(r)) == 1


# --- a mount that cannot be told to stand


def low_without_tracking_state(able: MountAbilities) -> tuple[Rig, Axes]:
    r, mount = watched(at=(-1.0, 260.0))
    mount.able = able
    mount.measured = Motion(kind="tracks")
    return r, mount


def test_a_mount_without_tracking_state_is_parked_at_a_limit():
    r, mount = low_without_tracking_state(MountAbilities(can_set_tracking=False))
    pass_looks(r, mount, 5)
    assert (mount.aborts, mount.parks, mount.is_tracking) == (1, 1, True)
    [words] = alarms_of(r)
    assert "cannot be told not to track" in words
    assert "the order to park" in words


def test_it_is_not_parked_before_the_loop_has_sent_its_own_abort():
    """Which would end the park."""
    r, mount = low_without_tracking_state(MountAbilities(can_set_tracking=False))
    for _ in range(3):
        mount.pass_time(1.0)
        r.engine.watch.look()
    assert mount.parks == 0
    alarms_of(r)
    pass_looks(r, mount, 1)
    assert mount.parks == 1


def test_a_mount_that_cannot_park_either_gets_abort_and_an_alarm():
    able = MountAbilities(can_set_tracking=False, can_park=False)
    r, mount = low_without_tracking_state(able)
    pass_looks(r, mount, 25)
    assert (mount.aborts, mount.parks) == (1, 0)
    [words] = alarms_of(r)
    assert "park it, or cut its power" in words


def test_autonomy_leads_such_a_mount_away_itself_before_it_is_parked():
    r, mount = low_without_tracking_state(MountAbilities(can_set_tracking=False))
    r.engine.watch.take_over(True)
    pass_looks(r, mount, 20)
    assert (mount.aborts, mount.parks) == (1, 0)
    pass_looks(r, mount, 20)
    assert (mount.aborts, mount.parks) == (2, 1)


# --- no slew that was allowed is ever ended


def pose_of(mount: PlainMount) -> Pose:
    report = mount.report()
    return Pose(
        t_utc_ns=report.t_utc_ns,
        ra_icrs_deg=report.ra_icrs_deg,
        dec_icrs_deg=report.dec_icrs_deg,
        pier_side=report.pier_side,
    )


class Modelled(PlainMount):
    """A mount as the simulator has it, whose axes end one after the other."""

    model: MountModel
    site: Site
    tells_side = True

    def report(self, not_before_utc_ns: int | None = None, timeout_s: float = 10.0) -> MountReport:
        now, motions = self.model.instant(self.clock.t_utc_ns), Motion(kind="tracks")
        if now.is_slewing:
            before = self.model.instant(self.clock.t_utc_ns - NS // 2)
            motions = Motion(
                kind="moves",
                ra_rate_arcsec_s=wrap_180(now.ra_date_deg - before.ra_date_deg) * 7200.0,
                dec_rate_arcsec_s=(now.dec_date_deg - before.dec_date_deg) * 7200.0,
            )
        ra_deg, dec_deg = jnow_to_icrs(now.ra_date_deg, now.dec_date_deg, self.clock.t_utc_ns)
        side: PierSide | None = now.pier_side if self.tells_side else None
        return dataclasses.replace(
            super().report(),
            ra_icrs_deg=ra_deg,
            dec_icrs_deg=dec_deg,
            is_slewing=now.is_slewing,
            pier_side=side,
            motion=motions,
        )


def random_place(site: Site, draw: random.Random, t_utc_ns: int) -> tuple[float, float]:
    return altaz_to_icrs(site, draw.uniform(15.0, 89.0), draw.uniform(0.0, 360.0), t_utc_ns)


@pytest.mark.parametrize("seed", plain_first(2, range(10)))
def test_a_thousand_slews_that_were_allowed_are_let_be(seed, monkeypatch):
    """Flips among them; over walls; also where nobody tells the side of the pier."""
    monkeypatch.setattr(Watch, "_look_at_the_sky", lambda *_: None)
    draw = random.Random(seed)
    walls = ((0.0, 20.0), (90.0, 45.0), (180.0, 0.0), (270.0, 35.0)) if seed % 2 else ()
    latitude_deg = (29.19, 5.0, 60.0, -33.0)[seed % 4]
    config = Config.model_validate(
        {"limits": {"horizon": walls}, "site": {"latitude_deg": latitude_deg}}
    )
    made: list[Modelled] = []

    def make(clock: StillClock) -> Modelled:
        made.append(Modelled(clock))
        return made[0]

    r = rig(set(), config, make_mount=make)
    mount = made[0]
    mount.tells_side = seed % 3 != 0
    mount.site = site = config.site.to_site()
    limits = Limits(site, config.limits, config.mount)
    begin_elsewhere(r, mount, draw)
    slews = 0
    while slews < 100:
        to = random_place(site, draw, r.clock.t_utc_ns)
        now_ns = r.clock.t_utc_ns
        refused = limits.refuse_slew(
            pose_of(mount),
            *to,
            t_aim_utc_ns=now_ns,
            t_until_utc_ns=now_ns + 60 * NS,
            lifted=("twilight",),
        )
        if refused is not None:
            # Somewhere else: from here little may be allowed.
            begin_elsewhere(r, mount, draw)
            continue
        slews += 1
        r.engine.instrument_controller.ordered = Ordered(t_utc_ns=now_ns, to_icrs_deg=to)
        length_s = mount.model.slew(*icrs_to_jnow(*to, now_ns), now_ns)
        begun = pose_of(mount)
        for _ in range(int(length_s) + 3):
            r.clock.t_utc_ns += NS
            r.engine.watch.look()
            assert mount.aborts == 0, (begun, to, alarms_of(r))
    assert slews == 100


def begin_elsewhere(r: Rig, mount: Modelled, draw: random.Random) -> None:
    """Also where it must not stay: it is told to stand then, and may be led out all the same."""
    t_utc_ns = r.clock.t_utc_ns
    ra_deg, dec_deg = icrs_to_jnow(*random_place(mount.site, draw, t_utc_ns), t_utc_ns)
    mount.model = MountModel(
        latitude_deg=mount.site.latitude_deg,
        longitude_deg=mount.site.longitude_deg,
        seed=1,
        t_utc_ns=t_utc_ns,
        ra_date_deg=ra_deg,
        dec_date_deg=dec_deg,
        traits=MountTraits(acceleration_deg_s2=draw.choice([0.8, 2.0, 20.0])),
    )
    r.engine.watch.look()
    mount.aborts = 0
    r.queue.take_alarms()
