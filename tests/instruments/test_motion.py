"""A mount's motion is measured from its reports: what they can tell, and what they cannot."""

import dataclasses
import random
from dataclasses import dataclass

import pytest

from rsoconsole.instruments import SIDEREAL_ARCSEC_S
from rsoconsole.instruments.indi.indi_wire import IndiVector
from rsoconsole.instruments.indi.reported_motion import ReportedMotion
from rsoconsole.instruments.motion import DirectionReport, Motion, MotionMeter, StopMeasure

SEEDS = range(20)
PLACE_H = 3.30012345
"""No multiple of a second: drivers that read those know no better."""
NS = 1_000_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Driver:
    """How a driver reports: each ``period_s``, in steps, only what has changed by more."""

    period_s: float = 0.5
    step_arcsec: float = 0.0
    threshold_arcsec: float = 1.5
    late_s: float = 0.05


def seen(
    driver: Driver, ra_arcsec_s: float, dec_arcsec_s: float, *, seconds: float, seed: int
) -> list[tuple[float, Motion]]:
    """What a meter says, look by look, of a mount at a constant rate; its silence is asked for."""
    draw = random.Random(seed)
    meter = MotionMeter(driver.period_s)
    ra0, dec0 = draw.uniform(0.0, 360.0) * 3600.0, draw.uniform(-60.0, 85.0) * 3600.0
    looks = [n * driver.period_s + draw.random() * 0.01 for n in range(int(seconds / 0.1))]
    events = [(t, "look") for t in looks] + [(0.5 * n + 0.25, "ask") for n in range(200)]
    if driver.step_arcsec:
        # Where it was before shows in which steps the driver tells.
        before = (round(ra0 / 90.0) * 90.0 + driver.step_arcsec) / 3600.0 % 360.0
        meter.add(DirectionReport(t_s=-99.0, host_s=-99.0, ra_deg=before, dec_deg=0.0))
        meter.begin_at(0.0)
    told: tuple[float, float] | None = None
    told_s, found = -9.0, list[tuple[float, Motion]]()
    for t_s, what in sorted(events):
        if t_s > seconds:
            break
        if what == "look":
            ra, dec = ra0 + ra_arcsec_s * t_s, dec0 + dec_arcsec_s * t_s
            if driver.step_arcsec:
                ra = round(ra / driver.step_arcsec) * driver.step_arcsec
                dec = float(round(dec))
            if told is None or max(abs(ra - told[0]), abs(dec - told[1])) > driver.threshold_arcsec:
                told, told_s = (ra, dec), t_s + draw.random() * driver.late_s
                report = DirectionReport(
                    t_s=told_s, host_s=told_s, ra_deg=ra / 3600.0 % 360.0, dec_deg=dec / 3600.0
                )
                meter.add(report)
        elif t_s - told_s > 0.4:
            meter.hold(t_s, t_s)
        found.append((t_s, meter.motion(t_s)))
    return found


DRIVERS = {
    "usual": Driver(),
    "tells everything": Driver(threshold_arcsec=0.0),
    "looks each second": Driver(period_s=1.0, late_s=0.2),
    "reads seconds": Driver(period_s=1.0, step_arcsec=15.0, threshold_arcsec=0.0),
    "reads tenths of minutes": Driver(period_s=1.0, step_arcsec=90.0, threshold_arcsec=0.0),
    "looks each 5 s": Driver(period_s=5.0),
}
KNOWN_BY_S = {
    "usual": 5.0,
    "tells everything": 5.0,
    "looks each second": 6.0,
    "reads seconds": 10.0,
    "reads tenths of minutes": 40.0,
    "looks each 5 s": 30.0,
}


@pytest.mark.parametrize("name", DRIVERS)
@pytest.mark.parametrize(("kind", "rate"), [("stands", SIDEREAL_ARCSEC_S), ("tracks", 0.0)])
def test_rest_is_recognised_and_never_taken_for_motion(name: str, kind: str, rate: float):
    for seed in SEEDS:
        found = seen(DRIVERS[name], rate, 0.0, seconds=KNOWN_BY_S[name] + 20.0, seed=seed)
        assert {motion.kind for _, motion in found} == {"unknown", kind}
        late = [motion.kind for t_s, motion in found if t_s > KNOWN_BY_S[name]]
        assert late.count(kind) >= 0.95 * len(late)


@pytest.mark.parametrize(
    "rates", [(SIDEREAL_ARCSEC_S + 5.0, 0.0), (-5.0, 0.0), (0.0, 5.0), (7.5, 0.0), (0.0, 12.0)]
)
@pytest.mark.parametrize("name", ["usual", "tells everything", "looks each second"])
def test_a_drift_of_five_arcsec_a_second_is_no_rest(name: str, rates: tuple[float, float]):
    for seed in SEEDS:
        found = seen(DRIVERS[name], *rates, seconds=30.0, seed=seed)
        assert not any(motion.is_at_rest or motion.is_fast for _, motion in found)
        if DRIVERS[name].late_s < 0.1:
            assert found[-1][1].kind == "moves"


@pytest.mark.parametrize("name", [*DRIVERS])
def test_a_slew_shows_in_two_reports(name: str):
    driver = DRIVERS[name]
    for seed in SEEDS:
        found = seen(driver, 4.0 * 3600.0, -2.0 * 3600.0, seconds=30.0, seed=seed)
        assert not any(motion.is_at_rest for _, motion in found)
        soon = [motion for t_s, motion in found if t_s > 2.0 * driver.period_s + 0.5]
        assert all(motion.is_fast for motion in soon)
        assert soon[-1].rate_deg_s == pytest.approx(4.0, rel=0.4)


def test_a_lunar_rate_counts_as_tracking():
    found = seen(Driver(), 0.55, 0.0, seconds=60.0, seed=1)
    assert {motion.kind for _, motion in found} == {"unknown", "tracks"}


def test_a_machine_that_is_held_up_shows_no_motion_and_rest_only_after_longer():
    meter = MotionMeter(0.5)
    for n in range(20):
        t_s = 0.5 * n
        late_s = 0.4 if n % 3 == 0 else 0.0
        report = DirectionReport(
            t_s=t_s + late_s,
            host_s=t_s + late_s,
            ra_deg=100.01234 + SIDEREAL_ARCSEC_S * t_s / 3600.0,
            dec_deg=10.0,
        )
        meter.add(report)
        # In six seconds so much lateness is less than the least motion.
        assert meter.motion(t_s + late_s).kind in ("unknown", "stands")
        assert meter.motion(t_s + late_s).kind == "unknown" or t_s >= 6.0


def test_reports_from_before_an_order_tell_nothing():
    meter = MotionMeter(0.5)
    for n in range(10):
        meter.add(DirectionReport(t_s=0.5 * n, host_s=0.5 * n, ra_deg=100.01234, dec_deg=10.0))
    assert meter.motion(4.5).kind == "tracks"
    meter.begin_at(4.6)
    assert meter.motion(4.7).kind == "unknown"


def test_a_simulated_sky_that_runs_fast_needs_its_time_on_the_host_too():
    meter = MotionMeter(0.0)
    for n in range(30):
        meter.add(DirectionReport(t_s=1.0 * n, host_s=0.05 * n, ra_deg=100.01234, dec_deg=10.0))
    assert meter.motion(29.0).kind == "unknown"
    meter.add(DirectionReport(t_s=31.0, host_s=2.0, ra_deg=100.01234, dec_deg=10.0))
    assert meter.motion(31.0).kind == "tracks"


# ---- what a driver says ---------------------------------------------------------------------


class Wire:
    """A driver's words at an injected clock."""

    def __init__(self) -> None:
        self.now_s = 100.0
        self.motion = ReportedMotion(lambda: self.now_s)

    def say(
        self, ra_hours: float, dec_deg: float = 20.0, *, state: str = "Ok", asked: bool = False
    ) -> None:
        values = {"RA": repr(ra_hours), "DEC": repr(dec_deg)}
        self.tell("EQUATORIAL_EOD_COORD", values, state=state, asked=asked)

    def tell(
        self, name: str, values: dict[str, str], *, state: str = "Ok", asked: bool = False
    ) -> None:
        self.motion.take(
            IndiVector(
                device="Mount",
                name=name,
                kind="Number",
                is_definition=asked,
                state=state,
                timestamp="",
                values=values,
            )
        )

    def pass_s(self, seconds: float, *, answers: bool, ra_hours: float = PLACE_H) -> None:
        """Time in which the driver is silent but where it is asked."""
        for _ in range(round(seconds / 0.1)):
            self.now_s += 0.1
            if self.motion.wants_word() and answers:
                self.say(ra_hours, asked=True)


def test_silence_counts_only_where_the_driver_answers():
    wire = Wire()
    wire.tell("POLLING_PERIOD", {"PERIOD_MS": "500"})
    wire.say(PLACE_H)
    wire.pass_s(10.0, answers=False)
    assert wire.motion.motion().kind == "unknown"
    wire.pass_s(5.0, answers=True)
    assert wire.motion.motion().kind == "tracks"


def test_a_driver_in_alert_tells_nothing():
    wire = Wire()
    wire.tell("POLLING_PERIOD", {"PERIOD_MS": "500"})
    wire.say(PLACE_H)
    wire.pass_s(5.0, answers=True)
    assert wire.motion.motion().kind == "tracks"
    wire.say(PLACE_H, state="Alert")
    assert wire.motion.motion().kind == "unknown"


def test_a_mount_that_stands_is_told_by_its_right_ascension_at_the_pole_too():
    wire = Wire()
    for n in range(20):
        wire.now_s += 0.5
        wire.say(PLACE_H + SIDEREAL_ARCSEC_S * 0.5 * n / 15.0 / 3600.0, 90.0)
    assert wire.motion.motion().kind == "stands"


def test_a_place_that_is_said_again_with_another_state_is_of_the_last_look():
    """Drivers repeat the last place with what they say of ABORT: it is old by then."""
    wire = Wire()
    wire.tell("POLLING_PERIOD", {"PERIOD_MS": "500"})
    for n in range(20):
        wire.now_s += 0.25
        ra_hours = PLACE_H + SIDEREAL_ARCSEC_S * 0.5 * (n // 2) / 15.0 / 3600.0
        wire.say(ra_hours)
    assert wire.motion.motion().kind == "stands"


def test_sexagesimal_coordinates_are_read():
    wire = Wire()
    wire.tell("POLLING_PERIOD", {"PERIOD_MS": "500"})
    for _ in range(10):
        wire.now_s += 0.5
        values = {"RA": "3:18:00.173", "DEC": "-0:30:00"}
        wire.tell("EQUATORIAL_EOD_COORD", values)
    assert wire.motion.motion().kind == "tracks"


# ---- ABORT until it rests -------------------------------------------------------------------

MOVES, TRACKS, UNKNOWN = (
    Motion(kind="moves", dec_rate_arcsec_s=9e3),
    Motion(kind="tracks"),
    Motion(),
)


def steps(motion: Motion, *, seconds: float, is_answered: bool) -> tuple[int, list[str], bool]:
    """(further ABORTs, news, whether it ended) of a STOP in which the motion stays that."""
    measure, aborts, news = StopMeasure(0.0), 0, list[str]()
    step = measure.step(0.0, UNKNOWN, is_answered=is_answered)
    for n in range(1, round(seconds / 0.2) + 1):
        step = measure.step(0.2 * n, motion, is_answered=is_answered)
        aborts += step.sends_abort
        news += [] if step.news is None else [step.news.kind]
    return aborts, news, step.is_over


def test_abort_is_repeated_once_a_second_for_half_a_minute_while_it_moves():
    assert steps(MOVES, seconds=60.0, is_answered=True) == (29, ["moves"], True)


def test_a_driver_that_does_not_answer_is_told_again_until_something_is_known():
    assert steps(UNKNOWN, seconds=60.0, is_answered=False) == (29, ["unknown"], True)
    assert steps(UNKNOWN, seconds=60.0, is_answered=True) == (0, ["unknown"], True)


def test_rest_that_is_measured_ends_it_whatever_the_driver_says():
    assert steps(TRACKS, seconds=0.2, is_answered=False) == (0, ["tracks"], True)


def test_a_mount_that_is_still_on_its_way_to_rest_is_no_news():
    assert steps(MOVES, seconds=4.4, is_answered=True)[1] == []
    assert steps(MOVES, seconds=4.8, is_answered=True)[1] == ["moves"]
    assert steps(UNKNOWN, seconds=9.8, is_answered=True)[1] == []


def test_a_slow_driver_s_motion_across_the_stop_is_not_known_and_abort_is_repeated():
    """Its two reports lie on both sides of the way that the mount needs to stop."""
    braking = dataclasses.replace(MOVES, host_since_s=0.4)
    assert steps(braking, seconds=9.8, is_answered=True)[:2] == (9, [])
    assert steps(braking, seconds=10.2, is_answered=True)[1] == ["unknown"]
    later = dataclasses.replace(MOVES, host_since_s=2.6)
    assert steps(later, seconds=4.8, is_answered=True)[1] == ["moves"]
