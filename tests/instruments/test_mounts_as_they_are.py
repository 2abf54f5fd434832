"""Mounts with another epoch, tracking rate, pier convention or clock than most have."""

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from rsoconsole.base import InstrumentError
from rsoconsole.config import IndiConfig, MountConfig, WaitsConfig
from rsoconsole.instruments import MountReport
from rsoconsole.instruments.indi.indi_wire import IndiWire
from rsoconsole.instruments.indi.wire_stop import stop_mount
from rsoconsole.instruments.mount.mount import IndiMount
from rsoconsole.instruments.mount.pier_side import PierConvention
from rsoconsole.records import Site
from rsoconsole.sky import icrs_to_jnow, jnow_to_icrs, lst_deg, separation_deg
from tests.instruments.test_odd_drivers import night_of, slew
from tests.makers import T0_UTC_NS
from tests.rigs.odd_mount import (
    COORDINATES,
    DEVICE,
    J2000,
    MODE,
    TIME,
    Oddities,
)
from tests.rigs.odd_mount_server import OddMountServer
from tests.rigs.odd_sequence import OddNight

SITE = Site(latitude_deg=29.19, longitude_deg=-81.05, elevation_m=10.0)
WAITS = WaitsConfig(device_s=3.0)


def said_by(night: OddNight) -> list[str]:
    said: list[Mapping[str, Any]] = night.voice.said
    return [str(each["text"]) for each in said if each.get("event") == "message"]


# -- J2000 -----------------------------------------------------------------------------------


def test_a_mount_of_j2000_goes_where_it_is_sent_and_says_where_it_is():
    night = night_of("j2000")
    slew(night)
    [sent] = [values for _, name, values in night.model.received if name == J2000]
    night.pass_s(40.0)
    # What was ordered in coordinates of date is 20 arcmin elsewhere in those of J2000.
    of_date = icrs_to_jnow(float(sent["RA"]) * 15.0, float(sent["DEC"]), night.utc_ns())
    assert separation_deg(night.model.ra_deg, night.model.dec_deg, *of_date) < 0.01
    assert separation_deg(float(sent["RA"]) * 15.0, float(sent["DEC"]), *of_date) > 0.1
    report = night.report()
    true = jnow_to_icrs(night.model.ra_deg, night.model.dec_deg, night.utc_ns())
    assert separation_deg(report.ra_icrs_deg, report.dec_icrs_deg, *true) < 0.01
    assert report.motion.kind == "tracks"


def test_a_mount_of_j2000_is_stopped_by_both_ways(tmp_path: Path):
    with (
        OddMountServer(Oddities(j2000=True, ha_deg=-60.0)) as server,
        connected(server, tmp_path) as mount,
    ):
        for stop in (mount.abort, lambda: stop_mount("127.0.0.1", server.port, DEVICE, 2.0)):
            send(server, mount, 0.0 if server.model.ha_deg < -30.0 else -60.0)
            time.sleep(1.5)
            with server.locked() as model:
                assert model.is_moving_by_itself
            result = stop()
            assert result.is_answered
            time.sleep(3.0)  # it slows down from 4 deg/s
            with server.locked() as model:
                assert not model.is_moving_by_itself


# -- tracking rate ------------------------------------------------------------------------------


@pytest.mark.parametrize("verb", ["set_sidereal_rate", "slew", "set_tracking"])
@pytest.mark.parametrize("mode", ["CUSTOM", "LUNAR"])
def test_a_mount_left_at_another_rate_is_set_to_the_sidereal_one_and_said_to_be(
    verb: str, mode: str
):
    night = night_of(f"mode={mode}")
    if verb == "slew":
        slew(night)
    else:
        night.order(verb, **({"is_on": True} if verb == "set_tracking" else {}))
    assert [values for _, name, values in night.model.received if name == MODE] == [
        {"TRACK_SIDEREAL": "On"}
    ]
    assert said_by(night) == [
        f"the mount was set to track at the rate {mode} by another program: sidereal again"
    ]
    night.pass_s(40.0)
    assert night.model.axes.drift_arcsec_s == (0.0, 0.0)
    night.order("set_sidereal_rate")
    assert len(said_by(night)) == 1


def test_a_stop_does_not_touch_the_rate_and_a_driver_that_keeps_it_slews_all_the_same():
    night = night_of("mode=CUSTOM")
    night.order("abort")
    assert MODE not in [name for _, name, _ in night.model.received]
    night.model._left_out.add(MODE)  # it is deaf to that order from now on
    slew(night)
    assert night.model.axes.is_slewing
    assert said_by(night)[0].startswith("the mount stays at the tracking rate CUSTOM")


def test_a_mount_without_rates_or_at_the_sidereal_one_is_told_nothing():
    for oddities in ("", "mode=SIDEREAL"):
        night = night_of(oddities)
        night.order("set_sidereal_rate")
        assert said_by(night) == []
        assert MODE not in [name for _, name, _ in night.model.received]


# -- side of the pier ---------------------------------------------------------------------------


def report_of(hour_angle_deg: float, side: Any, *, is_slewing: bool = False) -> MountReport:
    ra_deg = (lst_deg(SITE.longitude_deg, T0_UTC_NS) - hour_angle_deg) % 360.0
    ra_icrs_deg, dec_icrs_deg = jnow_to_icrs(ra_deg, 20.0, T0_UTC_NS)
    return MountReport(
        t_utc_ns=T0_UTC_NS,
        ra_icrs_deg=float(ra_icrs_deg),
        dec_icrs_deg=float(dec_icrs_deg),
        is_slewing=is_slewing,
        is_parked=False,
        is_tracking=True,
        pier_side=side,
    )


def arrives(convention: PierConvention, hour_angle_deg: float, side: Any) -> Any:
    report = report_of(hour_angle_deg, side)
    convention.begin_slew(report.ra_icrs_deg, report.dec_icrs_deg)
    return convention.side(report)


NORMAL = {60.0: "east", -60.0: "west"}


@pytest.mark.parametrize("first", [60.0, -60.0])
def test_slews_to_both_sides_of_the_meridian_show_that_a_driver_names_the_sides_otherwise(
    first: float,
):
    said: list[str] = []
    convention = PierConvention("found", SITE, said.append)
    # Before it, and near the meridian, nothing is known: the driver is believed.
    assert convention.side(report_of(first, NORMAL[-first])) == NORMAL[-first]
    assert arrives(convention, first / 6.0, NORMAL[-first]) == NORMAL[-first]
    # On one side its counterweight may be up.
    for _ in range(2):
        assert arrives(convention, first, NORMAL[-first]) == NORMAL[-first]
        assert len(said) == 1
    assert "its counterweight is up, or it names the sides otherwise" in said[0]
    assert arrives(convention, -first, NORMAL[first]) == NORMAL[-first]
    assert len(said) == 2
    assert "as on the other side: it names the sides of the pier the other way round" in said[1]
    # From then on everywhere, and past the meridian too.
    assert convention.side(report_of(first, NORMAL[-first])) == NORMAL[first]
    assert convention.side(report_of(5.0, None)) is None


def test_a_mount_with_its_counterweight_up_is_not_read_the_other_way_round():
    """It has tracked far past the meridian, and is sent a little on; its driver says the truth."""
    said: list[str] = []
    convention = PierConvention("found", SITE, said.append)
    assert arrives(convention, 40.0, "west") == "west"
    assert arrives(convention, -60.0, "west") == "west"
    assert arrives(convention, 40.0, "west") == "west"
    assert len(said) == 1


def test_a_slew_that_was_stopped_shows_nothing():
    said: list[str] = []
    convention = PierConvention("found", SITE, said.append)
    report = report_of(60.0, "west")
    convention.begin_slew(report.ra_icrs_deg, report.dec_icrs_deg)
    assert convention.side(report_of(60.0, "west", is_slewing=True)) == "west"
    convention.forget_slew()
    assert convention.side(report) == "west"
    assert said == []


@pytest.mark.parametrize(
    ("setting", "read"), [("driver", "west"), ("reversed", "east"), ("none", None)]
)
def test_the_setting_is_obeyed(setting: Any, read: Any):
    said: list[str] = []
    convention = PierConvention(setting, SITE, said.append)
    assert arrives(convention, 60.0, "west") == read
    assert said == []


# -- in real time: clock, and what a device offers ---------------------------------------------


@contextmanager
def connected(server: OddMountServer, folder: Path, **indi: Any) -> Iterator[IndiMount]:
    config = IndiConfig(port=server.port, mount=DEVICE, **indi)
    mount = IndiMount(config, folder / "mount.log", MountConfig(), WAITS, site=SITE)
    try:
        mount.start()
        yield mount
    finally:
        mount.close()


def connect_by_another(server: OddMountServer) -> None:
    other = IndiWire("127.0.0.1", server.port)
    other.ask(DEVICE)
    other.new("Switch", DEVICE, "CONNECTION", {"CONNECT": "On"})
    other.ask(DEVICE, TIME)
    assert other.wait(lambda each: each.name == TIME, 5.0) is not None
    other.close()


@pytest.mark.parametrize("timeoff", [-3600.0, 7200.0])
def test_a_clock_that_is_off_is_found_where_another_program_has_connected_the_mount(
    tmp_path: Path, timeoff: float
):
    with OddMountServer(Oddities(timeoff=timeoff)) as server:
        connect_by_another(server)
        with connected(server, tmp_path) as mount:
            assert mount.utc_offset_s() == pytest.approx(timeoff, abs=3.0)


def test_a_time_that_is_only_repeated_says_nothing(tmp_path: Path):
    with OddMountServer(Oddities(stale_time=True)) as server:
        connect_by_another(server)
        with connected(server, tmp_path) as mount:
            assert mount.utc_offset_s() is None


def test_a_device_that_is_no_mount_is_told_by_what_it_offers(tmp_path: Path):
    oddities = Oddities()
    with OddMountServer(oddities) as server:
        server.model._left_out.add(COORDINATES)
        with (
            pytest.raises(InstrumentError) as raised,
            connected(server, tmp_path),
        ):
            pass
    said = str(raised.value)
    assert "has not offered EQUATORIAL_EOD_COORD in 3 s" in said
    assert "it offers GEOGRAPHIC_COORD, ON_COORD_SET, TELESCOPE_ABORT_MOTION" in said
    assert "that indi.mount should name" in said
    assert "waits.device_s" in said


def test_a_reversed_driver_is_read_right_once_both_sides_have_shown_it(tmp_path: Path):
    with (
        OddMountServer(Oddities(reversedside=True, ha_deg=-20.0, speed_deg_s=40.0)) as server,
        connected(server, tmp_path) as mount,
    ):
        for hour_angle_deg in (-50.0, 50.0):
            to = send(server, mount, hour_angle_deg)
            ends_s = time.monotonic() + 20.0
            while True:
                report = mount.report()
                off_deg = separation_deg(report.ra_icrs_deg, report.dec_icrs_deg, *to)
                if (not report.is_slewing and off_deg < 0.1) or time.monotonic() > ends_s:
                    break
                time.sleep(0.2)
        assert mount.report().pier_side == "east"
        assert any("the other way round, and is read as east" in t for t in mount.take_messages())


def send(server: OddMountServer, mount: IndiMount, hour_angle_deg: float) -> tuple[float, float]:
    """Order a slew; its direction, ICRS degrees."""
    now_ns = time.time_ns()
    ra_deg = (lst_deg(SITE.longitude_deg, now_ns) - hour_angle_deg) % 360.0
    ra_icrs_deg, dec_icrs_deg = (float(each) for each in jnow_to_icrs(ra_deg, 40.0, now_ns))
    mount.slew(ra_icrs_deg, dec_icrs_deg, now_ns)
    return ra_icrs_deg, dec_icrs_deg
