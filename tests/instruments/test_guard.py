"""Weather and dome as the guard sees them, and as the simulated observatory makes them."""

import time
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import pytest

from rsoconsole.config import Config, IndiConfig
from rsoconsole.errors import InstrumentError
from rsoconsole.instruments.indi.guard import IndiGuard
from rsoconsole.instruments.indi.indi_wire import IndiVector, IndiWire
from rsoconsole.instruments.observatory.clock import SimulatedClock
from rsoconsole.instruments.observatory.connect import connect_instruments
from rsoconsole.instruments.ports import SkyReport
from rsoconsole.simulator.launch import Observatory, start_observatory
from tests.stub_stage import T_START_UTC_NS

NS = 1_000_000_000
STAGE = "tests.stub_stage:open_plain"
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


def guarding(port: int, *, weather: str | None = "Weather Simulator", dome: str | None = None):
    return IndiGuard(IndiConfig(port=port, weather=weather, dome=dome))


# ---- one word of a device ------------------------------------------------------------------


def told(guard: IndiGuard, name: str, state: str, **values: str) -> SkyReport:
    """What the guard makes of one vector."""
    device = guard._config.weather or guard._config.dome
    assert device is not None
    kind = "Light" if name == "WEATHER_STATUS" else "Switch"
    guard._heard_s[device] = time.monotonic()
    guard._told = {
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
    return guard.look()


@pytest.mark.parametrize(
    ("state", "word"), [("Ok", "ok"), ("Busy", "warning"), ("Alert", "alert"), ("Idle", "silent")]
)
def test_the_light_of_the_station_is_the_weather(state, word):
    report = told(guarding(1), "WEATHER_STATUS", state, WEATHER_RAIN_HOUR=state)
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
    guard = guarding(1, weather=None, dome="Dome")
    report = told(guard, "DOME_SHUTTER", state, SHUTTER_OPEN=is_open, SHUTTER_CLOSE=is_closed)
    assert (report.weather, report.dome) == (None, word)


def test_a_roll_off_roof_is_closed_when_it_is_parked():
    guard = guarding(1, weather=None, dome="Roof")
    assert told(guard, "DOME_PARK", "Ok", PARK="On", UNPARK="Off").dome == "closed"
    assert told(guard, "DOME_PARK", "Ok", PARK="Off", UNPARK="On").dome == "open"
    assert told(guard, "DOME_PARK", "Busy", PARK="On", UNPARK="Off").dome == "moving"


def test_a_station_that_has_said_nothing_for_a_minute_is_silent():
    guard = guarding(1)
    assert told(guard, "WEATHER_STATUS", "Ok").weather == "ok"
    guard._heard_s["Weather Simulator"] -= 59.0
    assert guard.look().weather == "ok"
    guard._heard_s["Weather Simulator"] -= 2.0
    report = guard.look()
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
def guard(observatory: Observatory) -> Iterator[IndiGuard]:
    with closing(guarding(observatory.port, dome="Dome Simulator")) as guard:
        guard.start()
        yield guard


def test_a_fine_night_is_known_at_once(guard):
    assert guard.look() == SkyReport(weather="ok", dome="open")


def test_weather_and_dome_follow_the_night_s_schedule(guard, clock):
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
            seen = guard.look()
            return (seen.weather, seen.dome) == (weather, dome)

        assert comes_true(is_so), (seconds, guard.look())


def test_a_client_may_make_the_weather_and_open_the_dome(guard, observatory):
    with closing(IndiWire(observatory.host, observatory.port)) as wire:
        wire.new("Text", "Weather Simulator", "SIM_WEATHER", {"STATE": "alert"})
        wire.new("Switch", "Dome Simulator", "DOME_SHUTTER", {"SHUTTER_OPEN": "On"})
        assert comes_true(lambda: (guard.look().weather, guard.look().dome) == ("alert", "open"))
        assert "WEATHER_WIND_SPEED alert" in guard.look().detail
        wire.new("Text", "Weather Simulator", "SIM_WEATHER", {"STATE": "ok"})
        assert comes_true(lambda: guard.look().weather == "ok")


def test_a_device_that_is_not_there_is_silent(observatory):
    with closing(guarding(observatory.port, weather="Weather Station")) as guard:
        # Nothing is waited for: as good as started and heard of nobody.
        guard._thread.start()
        assert comes_true(lambda: "announced no device 'Weather Station'" in guard.look().detail)
        assert guard.look().weather == "silent"


def test_a_server_that_goes_is_silence_after_a_while_and_one_that_comes_is_heard():
    with start_observatory("plain", 1, 0, stage=STAGE) as first:
        config = IndiConfig(port=first.port, weather="Weather Simulator")
        guard = IndiGuard(config, silence_s=2.0)
        guard.start()
        assert guard.look().weather == "ok"
        time.sleep(3.0)
        assert guard.look().weather == "ok"
    with closing(guard):
        assert comes_true(lambda: guard.look().weather == "silent")
        assert "start" in guard.look().detail
        with start_observatory("plain", 1, 0, stage=STAGE, weather=((0, "warning"),)) as second:
            # Another port: only where it listens has changed.
            guard._config = config.model_copy(update={"port": second.port})
            with closing(SimulatedClock(second.host, second.port)) as clock:
                clock.wait_until(T_START_UTC_NS + NS)
            assert comes_true(lambda: guard.look().weather == "warning")


def test_the_guard_comes_with_the_instruments_where_something_is_to_be_watched(
    observatory, tmp_path: Path
):
    indi = {"port": observatory.port, "simulated": True}
    with connect_instruments(Config.model_validate({"indi": indi}), log_dir=tmp_path) as without:
        assert without.guard is None
    indi["dome"] = "Dome Simulator"
    with connect_instruments(
        Config.model_validate({"indi": indi}), log_dir=tmp_path
    ) as instruments:
        assert instruments.guard is not None
        assert instruments.guard.look().weather is None
        assert instruments.guard.look().dome in ("open", "closed")


def test_a_schedule_with_an_unknown_word_is_refused_in_words():
    with pytest.raises(InstrumentError, match="the weather is ok, warning, alert; not 'awful'"):
        start_observatory("plain", 1, 0, stage=STAGE, weather=((0.0, "awful"),))
