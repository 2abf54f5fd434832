"""Weather and dome as the safety monitor sees them, and as the simulated observatory makes them."""

import time
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import pytest

from rsoconsole.base import InstrumentError
from rsoconsole.config import Config, IndiConfig
from rsoconsole.instruments import IndiWire, SkyReport, connect_instruments
from rsoconsole.instruments.indi.indi_wire import IndiVector
from rsoconsole.instruments.indi.safety_monitor import IndiSafetyMonitor
from rsoconsole.instruments.observatory.clock import SimulatedClock
from rsoconsole.simulator import start_observatory
from rsoconsole.simulator.launch import Observatory
from tests.rigs.stub_stage import T_START_UTC_NS

NS = 1_000_000_000
STAGE = "tests.rigs.stub_stage:open_plain"
WEATHER = ((60.0, "warning"), (120.0, "alert"), (180.0, "ok"))
DOME = ((100.0, "moving"), (110.0, "closed"))


def comes_true(is_true: Callable[[], bool], timeout_s: float = 10.0) -> bool:
    """Whether it does before the time is out."""
    ends_s = time.monotonic() + timeout_s
    while time.monotonic() < ends_s:
        if is_true():
            return True
        time.sleep(0.02)
    return False


def monitoring(port: int, *, weather: str | None = "Weather Simulator", dome: str | None = None):
    return IndiSafetyMonitor(IndiConfig(port=port, weather=weather, dome=dome))


# ---- one word of a device ------------------------------------------------------------------


def told(safety_monitor: IndiSafetyMonitor, name: str, state: str, **values: str) -> SkyReport:
    """What the safety monitor makes of one vector."""
    device = safety_monitor._config.weather or safety_monitor._config.dome
    assert device is not None
    kind = "Light" if name == "WEATHER_STATUS" else "Switch"
    safety_monitor._received_s[device] = time.monotonic()
    safety_monitor._vectors = {
        (device, name): IndiVector(
            device=device,
            name=name,
            kind=kind,
            is_definition=False,
            state=state,
            timestamp="",
            values=values,
        )
    }
    return safety_monitor.look()


@pytest.mark.parametrize(
    ("state", "word"), [("Ok", "ok"), ("Busy", "warning"), ("Alert", "alert"), ("Idle", "silent")]
)
def test_the_light_of_the_station_is_the_weather(state, word):
    report = told(monitoring(1), "WEATHER_STATUS", state, WEATHER_RAIN_HOUR=state)
    assert (report.weather, report.dome) == (word, None)
    assert ("WEATHER_RAIN_HOUR" in report.detail) == (word in ("warning", "alert"))


@pytest.mark.parametrize(
    ("state", "is_open", "is_closed", "word"),
    [
        ("Ok", "On", "Off", "open"),
        ("Ok", "Off", "On", "closed"),
        ("Idle", "On", "Off", "open"),
        ("Busy", "On", "Off", "moving"),
        ("Alert", "On", "Off", "silent"),
        ("Ok", "Off", "Off", "silent"),
    ],
)
def test_the_shutter_is_what_a_dome_says(state, is_open, is_closed, word):
    safety_monitor = monitoring(1, weather=None, dome="Dome")
    report = told(
        safety_monitor, "DOME_SHUTTER", state, SHUTTER_OPEN=is_open, SHUTTER_CLOSE=is_closed
    )
    assert (report.weather, report.dome) == (None, word)


def test_a_roll_off_roof_is_closed_when_it_is_parked():
    safety_monitor = monitoring(1, weather=None, dome="Roof")
    assert told(safety_monitor, "DOME_PARK", "Ok", PARK="On", UNPARK="Off").dome == "closed"
    assert told(safety_monitor, "DOME_PARK", "Ok", PARK="Off", UNPARK="On").dome == "open"
    assert told(safety_monitor, "DOME_PARK", "Busy", PARK="On", UNPARK="Off").dome == "moving"


def test_a_station_that_has_said_nothing_for_a_minute_is_silent():
    safety_monitor = monitoring(1)
    assert told(safety_monitor, "WEATHER_STATUS", "Ok").weather == "ok"
    safety_monitor._received_s["Weather Simulator"] -= 59.0
    assert safety_monitor.look().weather == "ok"
    safety_monitor._received_s["Weather Simulator"] -= 2.0
    report = safety_monitor.look()
    assert report.weather == "silent"
    assert "has said nothing for 61 s" in report.detail


# ---- the simulated observatory ---------------------------------------------------------------


@pytest.fixture(scope="module")
def observatory() -> Iterator[Observatory]:
    with start_observatory("plain", 1, 0, stage=STAGE, weather=WEATHER, dome=DOME) as running:
        yield running


@pytest.fixture(scope="module")
def clock(observatory: Observatory) -> Iterator[SimulatedClock]:
    with closing(SimulatedClock(observatory.host, observatory.port)) as clock:
        yield clock


@pytest.fixture
def safety_monitor(observatory: Observatory) -> Iterator[IndiSafetyMonitor]:
    with closing(monitoring(observatory.port, dome="Dome Simulator")) as safety_monitor:
        safety_monitor.start()
        yield safety_monitor


def test_a_fine_night_is_known_at_once(safety_monitor):
    assert safety_monitor.look() == SkyReport(weather="ok", dome="open")


def test_weather_and_dome_follow_the_night_s_schedule(safety_monitor, clock):
    for seconds, weather, dome in (
        (59, "ok", "open"),
        (61, "warning", "open"),
        (105, "warning", "moving"),
        (111, "warning", "closed"),
        (121, "alert", "closed"),
        (181, "ok", "closed"),
    ):
        clock.wait_until(T_START_UTC_NS + seconds * NS)

        def is_so(weather: str = weather, dome: str = dome) -> bool:
            seen = safety_monitor.look()
            return (seen.weather, seen.dome) == (weather, dome)

        assert comes_true(is_so), (seconds, safety_monitor.look())


def test_a_client_may_make_the_weather_and_open_the_dome(safety_monitor, observatory):
    with closing(IndiWire(observatory.host, observatory.port)) as wire:
        wire.new("Text", "Weather Simulator", "SIM_WEATHER", {"STATE": "alert"})
        wire.new("Switch", "Dome Simulator", "DOME_SHUTTER", {"SHUTTER_OPEN": "On"})
        assert comes_true(
            lambda: (safety_monitor.look().weather, safety_monitor.look().dome) == ("alert", "open")
        )
        assert "WEATHER_WIND_SPEED alert" in safety_monitor.look().detail
        wire.new("Text", "Weather Simulator", "SIM_WEATHER", {"STATE": "ok"})
        assert comes_true(lambda: safety_monitor.look().weather == "ok")


def test_a_device_that_is_not_there_is_silent(observatory):
    with closing(monitoring(observatory.port, weather="Weather Station")) as safety_monitor:
        # Nothing is waited for: as good as started and heard of nobody.
        safety_monitor._thread.start()
        assert comes_true(
            lambda: "announced no device 'Weather Station'" in safety_monitor.look().detail
        )
        assert safety_monitor.look().weather == "silent"


@pytest.mark.slow("waits until a silent server is given up")
def test_a_server_that_goes_is_silence_after_a_while_and_one_that_comes_is_heard():
    with start_observatory("plain", 1, 0, stage=STAGE) as first:
        config = IndiConfig(port=first.port, weather="Weather Simulator")
        safety_monitor = IndiSafetyMonitor(config, silence_s=2.0)
        safety_monitor.start()
        assert safety_monitor.look().weather == "ok"
        time.sleep(3.0)
        assert safety_monitor.look().weather == "ok"
    with closing(safety_monitor):
        assert comes_true(lambda: safety_monitor.look().weather == "silent")
        assert "start" in safety_monitor.look().detail
        with start_observatory("plain", 1, 0, stage=STAGE, weather=((0, "warning"),)) as second:
            # Another port: only where it listens has changed.
            safety_monitor._config = config.model_copy(update={"port": second.port})
            with closing(SimulatedClock(second.host, second.port)) as clock:
                clock.wait_until(T_START_UTC_NS + NS)
            assert comes_true(lambda: safety_monitor.look().weather == "warning")


def test_the_guard_comes_with_the_instruments_where_something_is_to_be_watched(
    observatory, tmp_path: Path
):
    indi = {"port": observatory.port, "simulated": True}
    with connect_instruments(Config.model_validate({"indi": indi}), log_dir=tmp_path) as without:
        assert without.safety_monitor is None
    indi["dome"] = "Dome Simulator"
    with connect_instruments(
        Config.model_validate({"indi": indi}), log_dir=tmp_path
    ) as instruments:
        assert instruments.safety_monitor is not None
        assert instruments.safety_monitor.look().weather is None
        assert instruments.safety_monitor.look().dome in ("open", "closed")


def test_a_schedule_with_an_unknown_word_is_refused_in_words():
    with pytest.raises(InstrumentError, match="the weather is ok, warning, alert; not 'awful'"):
        start_observatory("plain", 1, 0, stage=STAGE, weather=((0.0, "awful"),))
