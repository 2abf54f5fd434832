"""The short words for machine and instruments: each follows what was read."""

from pathlib import Path
from typing import Any

import pytest

from rsoconsole.config import Config
from rsoconsole.control import Machine
from rsoconsole.engine import troubles_of
from rsoconsole.engine.doctor.doctor_system import ClockReading
from rsoconsole.engine.loop.interruptions import ClockTrouble
from rsoconsole.engine.machine.medium import RecordingMedium
from rsoconsole.engine.machine.time_source import TimeSource
from rsoconsole.engine.service import machine_watch as health
from rsoconsole.engine.service.machine_watch import HealthMeter, MachineState
from rsoconsole.instruments import ClockFault, MountReport
from rsoconsole.instruments.motion import Motion
from tests.makers import NS, T0_UTC_NS


class StandingClock:
    """A clock that stands where a test puts it."""

    is_simulated = False

    def now_utc_ns(self) -> int:
        return T0_UTC_NS

    def wait_until(self, t_utc_ns: int) -> bool:
        raise AssertionError("a reading waits for nothing")

    def wake(self) -> None:
        raise AssertionError("a reading wakes nobody")

    def take_faults(self) -> tuple[ClockFault, ...]:
        raise AssertionError("the loop alone asks for that")

    is_steady = True


def report(age_s: float = 1.0, **other: Any) -> MountReport:
    values: dict[str, Any] = {"is_slewing": False, "is_tracking": True, "is_parked": False} | other
    return MountReport(
        t_utc_ns=T0_UTC_NS - round(age_s * NS),
        ra_icrs_deg=10.0,
        dec_icrs_deg=0.0,
        pier_side=None,
        **values,
    )


def read(folder: Path, of: MountReport | None, **machine: object) -> dict[str, tuple]:
    state = seen(**machine) if machine else None
    meter = HealthMeter(Config, StandingClock(), folder, lambda: state)
    return {each.name: (each.ok, each.text) for each in meter.read(of)}


def seen(**machine: object) -> MachineState:
    reading = Machine(model="Raspberry Pi 4 Model B Rev 1.4", **machine)
    return MachineState(
        reading=reading,
        troubles=troubles_of(reading),
        medium=RecordingMedium(kind="SD card"),
        time_source=TimeSource(kind="NTP", detail="", rtc=None),
    )


@pytest.mark.parametrize(
    ("of", "said"),
    [
        (None, (False, "has not been heard of")),
        (report(), (True, "tracks")),
        (report(motion=Motion(kind="stands")), (True, "stands")),
        (report(motion=Motion(kind="moves")), (True, "moves")),
        (report(is_slewing=True), (True, "slewing")),
        (report(is_parked=True, is_tracking=False), (True, "parked")),
        (report(is_tracking=False), (True, "stands")),
        (report(25.0), (False, "silent for 25 s")),
    ],
)
def test_the_mount_is_told_by_its_last_report(tmp_path, of, said):
    assert read(tmp_path, of)["mount"] == said


@pytest.mark.parametrize(
    ("reading", "said"),
    [
        (ClockReading(is_synchronised=True, offset_s=-0.0021), (True, "NTP ±2.1 ms")),
        (ClockReading(is_synchronised=True), (True, "synchronised")),
        (ClockReading(is_synchronised=False), (False, "not synchronised")),
        (ClockReading(is_synchronised=None), (False, "not synchronised")),
    ],
)
def test_the_clock_is_told_with_its_offset(tmp_path, monkeypatch, reading, said):
    monkeypatch.setattr(health, "read_clock", lambda: reading)
    assert read(tmp_path, None)["clock"] == said


@pytest.mark.parametrize(("free", "ok"), [(200e9, True), (1e9, False)])
def test_the_disk_is_told_in_hours_of_exposures(tmp_path, monkeypatch, free, ok):
    monkeypatch.setattr(health, "free_bytes", lambda _folder: free)
    is_well, text = read(tmp_path, None)["disk"]
    assert is_well is ok
    assert text.startswith(f"{free / 1e9:.0f} GB, ")


@pytest.mark.parametrize(
    ("machine", "said"),
    [
        ({"cpu_temperature_c": 52.3}, {"CPU": (True, "52 °C")}),
        ({"cpu_temperature_c": 84.0}, {"CPU": (False, "84 °C, hot")}),
        (
            {"cpu_temperature_c": 84.0, "is_throttled": True},
            {"CPU": (False, "84 °C, hot, throttled")},
        ),
        ({"is_throttled": True}, {"CPU": (False, "throttled")}),
        ({"is_throttled": False, "is_under_voltage": False}, {}),
        ({"is_under_voltage": True}, {"power": (False, "UNDER-VOLTAGE")}),
    ],
)
def test_the_machine_is_told_by_what_was_seen_of_it(tmp_path, machine, said):
    told = read(tmp_path, None, **machine)
    assert {name: told[name] for name in told if name in {"CPU", "power"}} == said


def test_a_machine_that_tells_nothing_is_left_out(tmp_path):
    assert set(read(tmp_path, None)) == {"mount", "clock", "disk"}


def test_what_was_read_is_told_again_for_a_while(tmp_path, monkeypatch):
    readings = iter([ClockReading(is_synchronised=True), ClockReading(is_synchronised=False)])
    monkeypatch.setattr(health, "read_clock", lambda: next(readings))
    meter = HealthMeter(Config, StandingClock(), tmp_path)
    first = meter.read(report())
    assert meter.read(report(25.0))[1:] == first[1:]
    assert meter.read(report(25.0))[0].ok is False


def test_what_happened_to_the_clock_is_said_for_a_while(tmp_path: Path):
    meter = HealthMeter(Config, StandingClock(), tmp_path)
    now_ns = StandingClock().now_utc_ns()

    def said(ago_s: int) -> list[tuple[bool, str]]:
        trouble = ClockTrouble(t_utc_ns=now_ns - ago_s * NS, text="set by -5.0 s")
        return [(h.ok, h.text) for h in meter.read(None, trouble) if "set by" in h.text]

    assert said(60) == [(False, "set by -5.0 s")]
    assert said(3600) == []


def test_a_clock_that_runs_wrong_is_said_as_long_as_it_does(tmp_path: Path):
    clock = StandingClock()
    clock.is_steady = False
    meter = HealthMeter(Config, clock, tmp_path)
    trouble = ClockTrouble(t_utc_ns=clock.now_utc_ns() - 3600 * NS, text="runs 2.00 times as fast")
    assert any(h.text == trouble.text and not h.ok for h in meter.read(None, trouble))
