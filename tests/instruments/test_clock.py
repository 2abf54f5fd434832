"""The machine's clocks held against each other: set, wrong, asleep, a process that stood still."""

import time
from contextlib import closing

import pytest

from rsoconsole.instruments import ClockFault
from rsoconsole.instruments.clock_watch import ClockReadings, ClockWatch
from rsoconsole.instruments.observatory import clock as clock_module
from rsoconsole.instruments.observatory.clock import SystemClock, read_clocks
from rsoconsole.sky import iso_to_utc_ns

NS = 1_000_000_000
EVENING_NS = iso_to_utc_ns("2026-11-25T19:00:00Z")
HUNDREDTH_S = 0.01


class Machine:
    """Three clocks that a test drives."""

    def __init__(self, utc_ns: int = EVENING_NS) -> None:
        self.utc_s, self.monotonic_s, self.boottime_s = utc_ns / NS, 1000.0, 1500.0
        self.base_ns = utc_ns
        self._utc_off_s = 0.0
        self._elapsed_s = 0.0
        self._slept_s = 0.0

    def read(self) -> ClockReadings:
        since_s = self._elapsed_s + self._slept_s
        return ClockReadings(
            utc_ns=self.base_ns + round((since_s + self._utc_off_s) * NS),
            monotonic_ns=round((1000.0 + self._elapsed_s) * NS),
            boottime_ns=round((1500.0 + since_s) * NS),
        )

    def run(self, seconds: float, *, rate: float = 1.0) -> None:
        """Live; ``rate``: seconds of UTC in one."""
        self._elapsed_s += seconds
        self._utc_off_s += (rate - 1.0) * seconds

    def step(self, seconds: float) -> None:
        self._utc_off_s += seconds

    def sleep(self, seconds: float) -> None:
        self._slept_s += seconds


def looked(
    machine: Machine, watch: ClockWatch, seconds: float, *, rate: float = 1.0, every_s: float = 0.25
) -> list[ClockFault]:
    """All that a watch finds while a machine runs for so long."""
    found: list[ClockFault] = []
    for _ in range(round(seconds / every_s)):
        machine.run(every_s, rate=rate)
        found += watch.find_faults(machine.read())
    return found


@pytest.fixture
def machine() -> Machine:
    return Machine()


@pytest.fixture
def watch(machine: Machine) -> ClockWatch:
    watch = ClockWatch(machine.read())
    assert looked(machine, watch, 20.0) == []
    return watch


@pytest.mark.parametrize("step_s", [3600.0, -3600.0, 1.0, -1.0, 0.2])
def test_a_clock_that_is_set_says_so_once(machine: Machine, watch: ClockWatch, step_s: float):
    machine.step(step_s)
    (fault,) = looked(machine, watch, 60.0)
    assert fault.kind == "set"
    assert fault.seconds == pytest.approx(step_s, abs=HUNDREDTH_S)
    assert watch.is_steady


def test_a_clock_that_is_drawn_in_is_not_set(machine: Machine, watch: ClockWatch):
    as_a_time_service_does = 1.0005
    assert looked(machine, watch, 1000.0, rate=as_a_time_service_does) == []


@pytest.mark.parametrize("rate", [0.5, 2.0, 1.08, 0.99])
def test_a_clock_that_runs_wrong_is_named_once_and_believed_again_when_it_runs_right(
    machine: Machine, watch: ClockWatch, rate: float
):
    found = looked(machine, watch, 60.0, rate=rate)
    kinds = [each.kind for each in found]
    assert kinds[-1:] == ["runs wrong"]
    assert kinds[:-1] in ([], ["set"])
    assert found[-1].rate == pytest.approx(rate, abs=0.15 * abs(rate - 1.0))
    assert not watch.is_steady
    assert looked(machine, watch, 9.0) == []
    assert not watch.is_steady
    (right,) = looked(machine, watch, 60.0)
    assert right.kind == "runs right"
    assert right.seconds == pytest.approx((rate - 1.0) * 60.0, abs=1.0)
    assert watch.is_steady


def test_two_steps_in_a_row_are_two_steps(machine: Machine, watch: ClockWatch):
    machine.step(1.0)
    found = looked(machine, watch, 1.0)
    machine.step(3600.0)
    found += looked(machine, watch, 3.0)
    machine.step(-3601.0)
    found += looked(machine, watch, 30.0)
    assert [(each.kind, round(each.seconds)) for each in found] == [
        ("set", 1),
        ("set", 3600),
        ("set", -3601),
    ]


def test_looks_right_behind_each_other_make_no_speed_of_a_step(machine: Machine, watch: ClockWatch):
    """The loop looks whenever it likes, beside the clock's own thread."""
    found: list[ClockFault] = []
    for step_s, apart_s in ((1.0, 0.001), (0.0, 1.0), (3600.0, 3.0)):
        machine.run(apart_s)
        machine.step(step_s)
        found += watch.find_faults(machine.read())
    assert [(each.kind, round(each.seconds)) for each in found] == [("set", 1), ("set", 3600)]


@pytest.mark.parametrize("rate", [0.5, 2.0])
def test_looks_at_uneven_intervals_find_it_too(machine: Machine, watch: ClockWatch, rate: float):
    found: list[ClockFault] = []
    for every_s in (0.25, 0.7, 0.3, 0.25, 0.9, 0.25) * 3:
        machine.run(every_s, rate=rate)
        found += watch.find_faults(machine.read())
    assert [each.kind for each in found] == ["set", "runs wrong"]


@pytest.mark.parametrize("rate", [0.5, 2.0])
def test_half_and_twice_the_speed_are_found_within_two_seconds(
    machine: Machine, watch: ClockWatch, rate: float
):
    found = looked(machine, watch, 2.0, rate=rate)
    assert [each.kind for each in found] == ["set", "runs wrong"]


def test_a_step_while_it_runs_wrong_is_part_of_that(machine: Machine, watch: ClockWatch):
    looked(machine, watch, 10.0, rate=2.0)
    machine.step(-3600.0)
    (right,) = looked(machine, watch, 60.0)
    assert right.kind == "runs right"
    assert right.seconds == pytest.approx(10.0 - 3600.0, abs=1.0)
    machine.step(1.0)
    assert [each.kind for each in looked(machine, watch, 5.0)] == ["set"]


def test_a_machine_that_slept_was_not_set(machine: Machine, watch: ClockWatch):
    machine.sleep(60.0)
    (fault,) = looked(machine, watch, 30.0)
    assert (fault.kind, fault.seconds) == ("slept", pytest.approx(60.0, abs=HUNDREDTH_S))


def test_a_process_that_stood_still_was_not_set(machine: Machine, watch: ClockWatch):
    machine.run(60.0)
    found = [*watch.find_faults(machine.read()), *looked(machine, watch, 30.0)]
    (fault,) = found
    assert (fault.kind, fault.seconds) == ("stood still", pytest.approx(60.0, abs=0.5))


def test_a_machine_that_slept_and_was_set_says_both(machine: Machine, watch: ClockWatch):
    machine.sleep(60.0)
    machine.step(5.0)
    found = looked(machine, watch, 30.0)
    assert [(each.kind, round(each.seconds)) for each in found] == [("set", 5), ("slept", 60)]


@pytest.mark.parametrize(
    ("instant", "step_s", "kind"),
    [
        ("2027-01-01T00:00:00Z", -1.0, "leap second"),
        ("2026-07-01T00:00:00Z", -1.0, "leap second"),
        ("2027-01-01T00:00:00Z", 1.0, "leap second"),
        ("2027-01-01T00:00:00Z", -2.0, "set"),
        ("2026-11-01T00:00:00Z", -1.0, "set"),
        ("2027-01-01T12:00:00Z", -1.0, "set"),
    ],
)
def test_a_leap_second_is_called_one(instant: str, step_s: float, kind: str):
    machine = Machine(iso_to_utc_ns(instant) - 10 * NS)
    watch = ClockWatch(machine.read())
    assert looked(machine, watch, 10.0) == []
    machine.step(step_s)
    (fault,) = looked(machine, watch, 30.0)
    assert (fault.kind, fault.seconds) == (kind, pytest.approx(step_s, abs=HUNDREDTH_S))


# ---- the machine's own clock ---------------------------------------------------------------


@pytest.fixture
def wall(monkeypatch: pytest.MonkeyPatch) -> dict[str, int]:
    """What is added to this machine's time."""
    added = {"ns": 0}
    plain = time.time_ns
    monkeypatch.setattr(time, "time_ns", lambda: plain() + added["ns"])
    return added


@pytest.mark.parametrize("step_s", [3600.0, -3600.0, 1.0, -1.0])
def test_the_system_clock_says_once_that_it_was_set(wall, step_s: float):
    with closing(SystemClock()) as clock:
        assert clock.take_faults() == ()
        wall["ns"] += round(step_s * NS)
        (fault,) = clock.take_faults()
        tenth = 0.1
        assert (fault.kind, fault.seconds) == ("set", pytest.approx(step_s, abs=tenth))
        assert clock.take_faults() == ()


def test_a_step_ends_a_wait_at_once(wall, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(clock_module, "_LOOK_EVERY_S", 0.01)
    with closing(SystemClock()) as clock:
        began_s = time.monotonic()
        wall["ns"] -= 3600 * NS
        assert not clock.wait_until(clock.now_utc_ns() + 20 * NS)
        assert time.monotonic() - began_s < 10.0
        assert [each.kind for each in clock.take_faults()] == ["set"]


def test_a_step_that_is_set_back_before_anybody_asks_is_found(
    wall, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(clock_module, "_LOOK_EVERY_S", 0.01)
    with closing(SystemClock()) as clock:
        wall["ns"] += 3600 * NS
        # The next wait is cut short by what the clock's own thread has seen.
        assert not clock.wait_until(clock.now_utc_ns() + 20 * NS)
        wall["ns"] -= 3600 * NS
        faults = clock.take_faults()
        assert faults[0].kind == "set"
        assert faults[0].seconds == pytest.approx(3600.0, abs=1.0)


def test_the_readings_of_this_machine_go_together():
    first, second = read_clocks(), read_clocks()
    a_tenth_ns = NS // 10
    assert second.monotonic_ns >= first.monotonic_ns
    assert second.boottime_ns - first.boottime_ns < a_tenth_ns
    assert abs(second.utc_ns - time.time_ns()) < a_tenth_ns
