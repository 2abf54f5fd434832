"""Mount, camera and clock ports against the simulated observatory, through their processes."""

import gc
import os
import re
import signal
import socket
import time
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from rsoconsole.base import InstrumentError
from rsoconsole.config import Config, WaitsConfig
from rsoconsole.instruments import ARRIVED_KEY, IndiWire, Instruments, connect_instruments
from rsoconsole.instruments.camera.camera import IndiCamera
from rsoconsole.instruments.indi.indi_wire import IndiVector
from rsoconsole.instruments.indi.wire_stop import stop_mount
from rsoconsole.instruments.observatory.clock import SimulatedClock, SystemClock
from rsoconsole.records import Site
from rsoconsole.simulator import start_observatory
from rsoconsole.simulator.launch import Observatory
from rsoconsole.sky import hours_to_deg, separation_deg, wrap_180
from tests.children.indi_clients import OTHERS_NIGHTLY
from tests.rigs.stub_stage import SITE, T_START_UTC_NS

NS = 1_000_000_000
ONE_ARCSEC = 1 / 3600
STAGE = "tests.rigs.stub_stage:open_plain"
START = (240.0, -5.0)


def config_for(observatory: Observatory, client: str = "auto") -> Config:
    return Config.model_validate(
        {
            "indi": {"port": observatory.port, "simulated": True, "client": client},
            "optics": {"width_px": 256, "height_px": 192},
        }
    )


@pytest.fixture(scope="module", params=OTHERS_NIGHTLY)
def client(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(scope="module")
def shared(
    client: str, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[tuple[Observatory, Instruments]]:
    folder = tmp_path_factory.mktemp("logs")
    with (
        start_observatory("plain", 1, 0, stage=STAGE) as observatory,
        connect_instruments(config_for(observatory, client), log_dir=folder) as instruments,
    ):
        yield observatory, instruments


@pytest.fixture
def observatory(shared: tuple[Observatory, Instruments]) -> Observatory:
    return shared[0]


@pytest.fixture
def instruments(shared: tuple[Observatory, Instruments]) -> Instruments:
    """One observatory for many tests: each begins tracking at START, not slewing."""
    _, instruments = shared
    instruments.mount.unpark()
    instruments.mount.slew(*START, instruments.clock.now_utc_ns())
    arrive(instruments)
    return instruments


@pytest.fixture
def own_observatory() -> Iterator[Observatory]:
    with start_observatory("plain", 1, 0, stage=STAGE) as running:
        yield running


@pytest.fixture
def own_instruments(
    client: str, own_observatory: Observatory, tmp_path: Path
) -> Iterator[Instruments]:
    """For tests that break something for good."""
    with connect_instruments(config_for(own_observatory, client), log_dir=tmp_path) as connected:
        yield connected


def arrive(instruments: Instruments) -> None:
    """Let time pass until the mount does not slew."""
    while instruments.mount.report(instruments.clock.now_utc_ns()).is_slewing:
        instruments.clock.wait_until(instruments.clock.now_utc_ns() + NS)


def take_frame(instruments: Instruments, frame_id: int, exposure_s: float = 10.0):
    instruments.camera.start_exposure(exposure_s, frame_id)
    end_utc_ns = instruments.clock.now_utc_ns() + round((exposure_s + 0.5) * NS)
    instruments.clock.wait_until(end_utc_ns)
    return instruments.camera.wait_frame(20.0)


def coordinates_on_the_wire(observatory: Observatory) -> IndiVector:
    wire = IndiWire(observatory.host, observatory.port)
    wire.ask(observatory.mount_name, "EQUATORIAL_EOD_COORD")
    vector = wire.wait(lambda each: each.name == "EQUATORIAL_EOD_COORD", 5.0)
    wire.close()
    assert vector is not None
    return vector


# ---- time ----------------------------------------------------------------------------------


def test_simulated_time_stands_still_until_somebody_waits(instruments):
    t0_utc_ns = instruments.clock.now_utc_ns()
    assert instruments.clock.is_simulated
    time.sleep(0.05)
    assert instruments.clock.now_utc_ns() == t0_utc_ns
    assert instruments.clock.wait_until(t0_utc_ns + 3600 * NS)
    assert instruments.clock.now_utc_ns() == t0_utc_ns + 3600 * NS


def test_an_advance_brings_a_report_of_that_very_instant(instruments):
    t0_utc_ns = instruments.clock.now_utc_ns()
    for step in range(1, 6):
        t_utc_ns = t0_utc_ns + step * 1_234_567_891
        instruments.clock.wait_until(t_utc_ns)
        report = instruments.mount.report(instruments.clock.now_utc_ns())
        # INDI's finest stamp is a microsecond.
        assert 0 <= report.t_utc_ns - t_utc_ns < 1000
        assert report.t_utc_ns == instruments.clock.now_utc_ns()


def test_waiting_for_the_past_returns_at_once(instruments):
    t0_utc_ns = instruments.clock.now_utc_ns()
    assert instruments.clock.wait_until(t0_utc_ns - NS)
    assert instruments.clock.now_utc_ns() == t0_utc_ns


def test_a_paced_wait_is_cut_short_by_wake(tmp_path):
    with (
        start_observatory("plain", 1, 1.0, stage=STAGE) as observatory,
        connect_instruments(config_for(observatory), log_dir=tmp_path) as instruments,
    ):
        import threading

        clock = instruments.clock
        threading.Timer(0.3, clock.wake).start()
        assert not clock.wait_until(T_START_UTC_NS + 600 * NS)
        assert T_START_UTC_NS < clock.now_utc_ns() < T_START_UTC_NS + 60 * NS


def test_the_system_clock_is_woken_too():
    clock = SystemClock()
    clock.wake()
    assert not clock.wait_until(clock.now_utc_ns() + 3600 * NS)
    assert clock.wait_until(clock.now_utc_ns() + 1000)


def test_without_a_simulated_clock_the_error_names_the_setting():
    with socket.create_server(("127.0.0.1", 0)) as deaf:
        waits = WaitsConfig(device_s=0.2)
        with pytest.raises(InstrumentError, match=r"indi\.simulated"):
            SimulatedClock(*deaf.getsockname(), waits)


# ---- mount ---------------------------------------------------------------------------------


def test_the_mount_arrives_where_it_was_sent(instruments):
    instruments.mount.slew(250.0, 8.0, instruments.clock.now_utc_ns())
    assert instruments.mount.report().is_slewing
    arrive(instruments)
    report = instruments.mount.report()
    # The apparent place is that of the command's instant; seconds later it is the same.
    assert separation_deg(250.0, 8.0, report.ra_icrs_deg, report.dec_icrs_deg) < 0.1 * ONE_ARCSEC
    assert report.is_tracking
    assert report.pier_side == "west"


def test_the_driver_is_told_hours_in_epoch_of_date(instruments, observatory):
    instruments.mount.slew(250.0, 8.0, instruments.clock.now_utc_ns())
    arrive(instruments)
    vector = coordinates_on_the_wire(observatory)
    ra_date_deg, dec_date_deg = (
        hours_to_deg(float(vector.values["RA"])),
        float(vector.values["DEC"]),
    )
    # astropy 8.0: ICRS (250, 8) in TETE (true equator and equinox) of 2023-06-22T02:13:20.
    assert wrap_180(ra_date_deg - 250.286888) == pytest.approx(0, abs=2 * ONE_ARCSEC)
    assert dec_date_deg - 7.954307 == pytest.approx(0, abs=2 * ONE_ARCSEC)


def test_a_parked_mount_takes_no_orders_until_it_is_unparked(instruments):
    instruments.mount.park()
    arrive(instruments)
    assert instruments.mount.report().is_parked
    with pytest.raises(InstrumentError, match="unpark it first"):
        instruments.mount.slew(250.0, 8.0, instruments.clock.now_utc_ns())
    instruments.mount.unpark()
    instruments.mount.slew(250.0, 8.0, instruments.clock.now_utc_ns())
    arrive(instruments)
    assert instruments.mount.report().dec_icrs_deg == pytest.approx(8.0, abs=ONE_ARCSEC)


def test_tracking_off_lets_the_sky_drift(instruments):
    t0_utc_ns = instruments.clock.now_utc_ns()
    before = instruments.mount.report()
    instruments.mount.set_tracking(False)
    instruments.clock.wait_until(t0_utc_ns + 60 * NS)
    after = instruments.mount.report(t0_utc_ns + 60 * NS)
    assert not after.is_tracking
    drift_arcsec = wrap_180(after.ra_icrs_deg - before.ra_icrs_deg) * 3600
    assert drift_arcsec == pytest.approx(15.04 * 60, abs=1.0)


def test_the_site_is_compared_and_a_wrong_one_is_named(instruments):
    assert instruments.mount.check_site(SITE).is_consistent
    elsewhere = Site(latitude_deg=52.0, longitude_deg=13.0, elevation_m=40.0)
    check = instruments.mount.check_site(elsewhere)
    assert not check.is_consistent
    # Spherical law of cosines, by hand.
    told_km = re.search(r"(\d+) km from the configured site", check.detail)
    assert told_km is not None
    assert float(told_km[1]) == pytest.approx(7754, rel=0.01)
    assert "km from the configured site" in check.detail


# ---- stop ----------------------------------------------------------------------------------


def test_stop_through_the_mounts_process(instruments):
    instruments.mount.slew(290.0, 8.0, instruments.clock.now_utc_ns())
    result = instruments.mount.abort()
    assert result.is_answered
    assert not instruments.mount.report().is_slewing
    assert instruments.mount.report().is_tracking


def test_stop_reaches_the_mount_past_a_frozen_process(instruments, observatory):
    instruments.mount.slew(290.0, 8.0, instruments.clock.now_utc_ns())
    pid = instruments.mount.process.pid
    os.kill(pid, signal.SIGSTOP)
    try:
        result = instruments.mount.abort()
        assert (result.is_answered, result.path) == (True, "indi")
        assert coordinates_on_the_wire(observatory).state == "Ok"
    finally:
        os.kill(pid, signal.SIGCONT)


def test_stop_reaches_the_mount_past_a_dead_process(instruments, observatory):
    """By the plain connection, or by a fresh process where that is up within the 100 ms."""
    instruments.mount.slew(290.0, 8.0, instruments.clock.now_utc_ns())
    os.kill(instruments.mount.process.pid, signal.SIGKILL)
    result = instruments.mount.abort()
    assert result.is_answered
    assert result.ms < 2000
    assert coordinates_on_the_wire(observatory).state == "Ok"


def test_stop_without_a_server_says_so_and_does_not_raise():
    with socket.create_server(("127.0.0.1", 0)) as gone:
        port = gone.getsockname()[1]
    result = stop_mount("127.0.0.1", port, "Telescope Simulator", 0.5)
    assert not result.is_answered
    assert "start indiserver" in result.detail


def test_stop_does_not_take_a_deaf_servers_silence_for_success():
    with socket.create_server(("127.0.0.1", 0)) as deaf:
        result = stop_mount("127.0.0.1", deaf.getsockname()[1], "Telescope Simulator", 0.3)
    assert not result.is_answered


def test_a_mount_whose_parent_leaves_is_stopped_and_tracks(own_instruments, own_observatory):
    own_instruments.mount.slew(290.0, 8.0, own_instruments.clock.now_utc_ns())
    own_instruments.mount.set_tracking(False)
    assert coordinates_on_the_wire(own_observatory).state == "Busy"
    # What the kernel does to the pipe when this process dies.
    own_instruments.mount.process.close()
    assert coordinates_on_the_wire(own_observatory).state == "Ok"
    wire = IndiWire(own_observatory.host, own_observatory.port)
    wire.ask(own_observatory.mount_name, "TELESCOPE_TRACK_STATE")
    tracking = wire.wait(lambda each: each.name == "TELESCOPE_TRACK_STATE", 5.0)
    wire.close()
    assert tracking.values["TRACK_ON"] == "On"


# ---- camera --------------------------------------------------------------------------------


def test_a_frame_comes_with_all_its_bits_and_its_header(instruments):
    t0_utc_ns = instruments.clock.now_utc_ns()
    frame = take_frame(instruments, 42)
    assert (frame.frame_id, frame.pixels.shape, frame.pixels.dtype) == (42, (192, 256), np.uint16)
    expected = np.random.default_rng([1, frame.t_start_utc_ns]).integers(
        0, 65536, (192, 256), dtype=np.uint16
    )
    expected[0, :2] = 0, 65535
    assert np.array_equal(frame.pixels, expected)
    assert frame.t_start_utc_ns == t0_utc_ns + 300_000_000
    assert frame.exposure_s == 10.0
    assert frame.scale_arcsec_px == pytest.approx(1.2642, abs=1e-4)
    assert frame.header["SITELAT"] == pytest.approx(29.19)
    assert frame.pointing_ra_icrs_deg == pytest.approx(240.0, abs=ONE_ARCSEC)
    assert frame.pointing_dec_icrs_deg == pytest.approx(-5.0, abs=ONE_ARCSEC)


def test_a_frame_says_when_its_last_byte_had_come(instruments):
    instruments.camera.start_exposure(10.0, 5)
    ordered_s = time.monotonic()
    instruments.clock.wait_until(instruments.clock.now_utc_ns() + 11 * NS)
    frame = instruments.camera.wait_frame(20.0)
    assert ordered_s < frame.header[ARRIVED_KEY] < time.monotonic()


def test_the_driver_s_words_reach_parent_and_log_before_the_frame_and_once_a_change(
    own_instruments, tmp_path
):
    camera, said = own_instruments.camera, []
    for frame_id, dec_deg in enumerate((15.0, 22.0, 23.0, 15.0, 24.0), start=1):
        own_instruments.mount.slew(250.0, dec_deg, own_instruments.clock.now_utc_ns())
        arrive(own_instruments)
        take_frame(own_instruments, frame_id, exposure_s=1.0)
        said.append(camera.take_messages())
    assert [len(words) for words in said] == [0, 1, 0, 0, 1]
    assert said[1] == ("nothing shines at 22 deg",)
    log_lines = (tmp_path / "camera.log").read_text().splitlines()
    logged = [line for line in log_lines if "nothing shines" in line]
    assert len(logged) == 2
    assert all(line.endswith(words[0]) for line, words in zip(logged, said[1::3], strict=True))


def test_a_frame_is_the_callers_own(instruments):
    first = take_frame(instruments, 1)
    kept = first.pixels.copy()
    for frame_id in range(2, 6):
        take_frame(instruments, frame_id)
    assert np.array_equal(first.pixels, kept)


def test_an_aborted_exposure_never_comes_and_the_next_does(instruments):
    instruments.camera.start_exposure(10.0, 1)
    instruments.camera.abort()
    frame = take_frame(instruments, 2, exposure_s=5.0)
    assert (frame.frame_id, frame.exposure_s) == (2, 5.0)


def test_a_camera_without_a_frame_is_an_error_that_names_the_cable(instruments):
    instruments.camera.start_exposure(10.0, 1)
    # Nobody lets time pass: the exposure cannot end.
    with pytest.raises(InstrumentError, match=r"no frame in 0 s: check its USB power"):
        instruments.camera.wait_frame(0.3)
    assert take_frame(instruments, 2).frame_id == 2


@pytest.mark.parametrize("is_noticed", [False, True])
def test_a_killed_camera_process_is_an_error_and_then_works_again(instruments, is_noticed):
    take_frame(instruments, 1)
    instruments.camera.start_exposure(10.0, 2)
    pid = instruments.camera.process.pid
    os.kill(pid, signal.SIGKILL)
    if is_noticed:
        while instruments.camera.process.pid is not None:
            time.sleep(0.01)
    with pytest.raises(InstrumentError, match="process ended"):
        instruments.camera.wait_frame(5.0)
    assert take_frame(instruments, 3).frame_id == 3


def test_a_frame_larger_than_the_configured_sensor_is_refused_in_words(client, shared, tmp_path):
    observatory, instruments = shared
    config = config_for(observatory, client)
    small = config.optics.model_copy(update={"width_px": 64, "height_px": 64})
    camera = IndiCamera(config.indi, small, tmp_path / "camera.log")
    try:
        camera.start()
        camera.start_exposure(1.0, 1)
        instruments.clock.wait_until(instruments.clock.now_utc_ns() + 2 * NS)
        with pytest.raises(InstrumentError, match=r"optics\.width_px"):
            camera.wait_frame(10.0)
    finally:
        camera.close()


# ---- processes -----------------------------------------------------------------------------


def test_children_and_observatory_end_with_their_parents(client, tmp_path):
    with start_observatory("plain", 1, 0, stage=STAGE) as observatory:
        with connect_instruments(config_for(observatory, client), log_dir=tmp_path) as instruments:
            pids = [instruments.mount.process.pid, instruments.camera.process.pid]
        pids.append(observatory.process.pid)
    for pid in pids:
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)


def test_a_dead_server_is_an_error_in_words(own_instruments, own_observatory):
    own_observatory.process.kill()
    own_observatory.process.wait()
    with pytest.raises(InstrumentError, match=r"server went away|start indiserver"):
        own_instruments.mount.report(T_START_UTC_NS + NS, timeout_s=3.0)
    with pytest.raises(InstrumentError, match="start indiserver"):
        own_instruments.mount.slew(250.0, 8.0, T_START_UTC_NS)
    with pytest.raises(InstrumentError):
        own_instruments.clock.wait_until(T_START_UTC_NS + NS)


def test_nothing_to_connect_to_is_an_error_that_says_what_to_start(client, tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as gone:
        port = gone.getsockname()[1]
    config = Config.model_validate({"indi": {"port": port, "client": client}})
    with (
        pytest.raises(InstrumentError, match="start indiserver"),
        connect_instruments(config, log_dir=tmp_path),
    ):
        pass


def test_a_wire_keeps_nothing_of_what_it_has_read():
    """A night's worth of vectors must not stay in memory."""
    vector = (
        '<setNumberVector device="Clock" name="NOW" state="Ok" timestamp="2023-06-22T00:00:00">'
        '<oneNumber name="T">1</oneNumber></setNumberVector>'
    )
    with socket.create_server(("127.0.0.1", 0)) as listener:
        wire = IndiWire(*listener.getsockname())
        served, _ = listener.accept()
        with served, closing(wire):
            for _ in range(5):
                served.sendall(vector.encode() * 200)
                for _ in range(200):
                    assert wire.wait(lambda heard: heard.name == "NOW", 5.0) is not None
            gc.collect()
            kept = sum(isinstance(each, ET.Element) for each in gc.get_objects())
    assert kept < 20
