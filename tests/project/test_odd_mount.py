"""The odd mount of the tests: it does what its oddities say, and says what it does not do."""

import math
from typing import Any
from xml.etree import ElementTree as ET

import pytest

from rsoconsole.instruments import IndiWire
from rsoconsole.instruments.indi.indi_wire import IndiVector
from tests.rigs.odd_mount import (
    ABORT,
    AT_REST_ARCSEC_S,
    CONNECTION,
    COORDINATES,
    DEVICE,
    LATITUDE_DEG,
    ON_SET,
    PARK,
    PARK_DEC_DEG,
    PARK_HA_DEG,
    PERIOD,
    SIDE,
    SIDEREAL_ARCSEC_S,
    SITE,
    TIME,
    TRACKING,
    Oddities,
    OddMount,
)
from tests.rigs.odd_mount_server import ElementReader, OddMountServer

T0_UTC_NS = 1_790_000_000_000_000_000
TICK_S = 0.1
ONE_ARCSEC = 1.0 / 3600.0


class Night:
    """A mount, a clock that a test moves on, and what a client has been sent."""

    def __init__(self, **oddities: Any) -> None:
        self.now_s = 1000.0
        self.sent: list[ET.Element] = []
        self.model = OddMount(
            oddities,
            monotonic_s=lambda: self.now_s,
            utc_ns=lambda: T0_UTC_NS + round(self.now_s * 1e9),
            emit=self._keep,
        )
        self.order("Switch", CONNECTION, CONNECT="On")

    def _keep(self, text: str) -> None:
        # What is no UTF-8 is read as the product does.
        data = text.encode("utf-8", "surrogateescape").decode("latin-1").encode()
        self.sent += ElementReader().feed(data)

    def order(self, kind: str, name: str, **values: object) -> list[ET.Element]:
        """Send it; what was answered at once."""
        vector = ET.Element(f"new{kind}Vector", device=DEVICE, name=name)
        for key, value in values.items():
            ET.SubElement(vector, f"one{kind}", name=key).text = str(value)
        return self._answers(vector)

    def ask(self, name: str) -> list[ET.Element]:
        return self._answers(ET.Element("getProperties", device=DEVICE, name=name))

    def _answers(self, element: ET.Element) -> list[ET.Element]:
        before = len(self.sent)
        self.model.receive(element)
        return self.sent[before:]

    def go(self, ra_off_deg: float, dec_deg: float) -> float:
        """Another place, by so much of right ascension; returns that of the goal, degrees."""
        ra_deg = (self.model.ra_deg + ra_off_deg) % 360.0
        self.order("Number", COORDINATES, RA=ra_deg / 15.0, DEC=dec_deg)
        return ra_deg

    def abort(self) -> list[ET.Element]:
        return self.order("Switch", ABORT, ABORT="On")

    def park(self) -> list[ET.Element]:
        return self.order("Switch", PARK, PARK="On")

    def track(self) -> list[ET.Element]:
        return self.order("Switch", TRACKING, TRACK_ON="On")

    def wait(self, seconds: float) -> list[ET.Element]:
        """What comes meanwhile."""
        before = len(self.sent)
        for _ in range(round(seconds / TICK_S)):
            self.now_s += TICK_S
            self.model.advance()
        return self.sent[before:]

    def state(self, name: str = COORDINATES) -> str:
        """As last sent."""
        return [each.get("state", "") for each in self.sent if each.get("name") == name][-1]

    def value(self, member: str, name: str = COORDINATES) -> str:
        vector = [each for each in self.sent if each.get("name") == name][-1]
        return next(each.text or "" for each in vector if each.get("name") == member)

    def words(self) -> list[str]:
        return [each.get("message", "") for each in self.sent if each.tag == "message"]


def named(elements: list[ET.Element], name: str = COORDINATES) -> list[ET.Element]:
    return [each for each in elements if each.get("name") == name]


def test_a_mount_slews_arrives_and_tracks() -> None:
    night = Night()
    ra_deg = night.go(40.0, 30.0)
    assert (night.state(), night.state(TRACKING)) == ("Busy", "Idle")
    night.wait(5.0)
    # Forty degrees at 4 deg/s, with 2 s to get up to speed and 2 to slow down: 12 s.
    assert night.model.dec_rate_arcsec_s == pytest.approx(-4.0 * 3600.0)
    assert night.model.is_moving_by_itself
    night.wait(6.5)
    assert night.model.is_moving_by_itself
    night.wait(1.5)
    assert not night.model.is_moving_by_itself
    assert (night.state(), night.state(TRACKING)) == ("Ok", "Busy")
    assert night.model.ra_deg == pytest.approx(ra_deg, abs=0.1 * ONE_ARCSEC)
    assert night.model.dec_deg == pytest.approx(30.0)
    assert night.model.ra_rate_arcsec_s == pytest.approx(0.0, abs=1e-6)


def test_the_shortest_way_leads_across_right_ascension_zero() -> None:
    night = Night()
    begin_deg = night.model.ra_deg
    night.go(-(begin_deg + 5.0), 60.0)
    night.wait(2.0)
    way_deg = (begin_deg + 5.0 + 180.0) % 360.0 - 180.0
    assert math.copysign(1.0, night.model.ra_rate_arcsec_s) == -math.copysign(1.0, way_deg)


def test_a_standing_mount_gains_right_ascension_and_keeps_its_altitude() -> None:
    night = Night()
    assert night.model.altitude_deg == pytest.approx(90.0 - (60.0 - LATITUDE_DEG))
    ra_deg = night.model.ra_deg
    night.wait(60.0)
    gained_arcsec = (night.model.ra_deg - ra_deg) * 3600.0
    assert gained_arcsec == pytest.approx(60.0 * SIDEREAL_ARCSEC_S, abs=0.1)
    assert night.model.ra_rate_arcsec_s == SIDEREAL_ARCSEC_S
    assert night.model.axis_rates_arcsec_s == (0.0, 0.0)
    assert night.model.altitude_deg == pytest.approx(90.0 - (60.0 - LATITUDE_DEG))


def test_abort_takes_its_stopping_distance_while_the_driver_says_idle_at_once() -> None:
    night = Night()
    night.go(0.0, 0.0)
    night.wait(4.0)
    dec_deg, stopping_deg = night.model.dec_deg, night.model.stopping_deg
    assert stopping_deg == pytest.approx(4.0)  # 4 deg/s against 2 deg/s2
    night.abort()
    assert night.state() == "Idle"
    night.wait(1.0)
    assert night.model.is_moving_by_itself
    night.wait(1.5)
    assert not night.model.is_moving_by_itself
    assert night.model.dec_deg == pytest.approx(dec_deg - stopping_deg)
    assert night.model.ra_rate_arcsec_s == SIDEREAL_ARCSEC_S


def test_a_goal_behind_is_reached_after_a_turn() -> None:
    night = Night()
    night.go(0.0, 0.0)
    night.wait(4.0)
    dec_deg = night.model.dec_deg
    night.go(0.0, dec_deg - 1.0)
    night.wait(1.6)
    assert night.model.dec_deg < dec_deg - 2.0
    night.wait(8.0)
    assert night.model.dec_deg == pytest.approx(dec_deg - 1.0)


def test_motion_does_not_depend_on_how_often_it_is_looked_at() -> None:
    often, once = Night(), Night()
    for night in (often, once):
        night.go(30.0, 10.0)
    often.wait(20.0)
    once.now_s = often.now_s
    once.model.advance()
    assert once.model.dec_deg == pytest.approx(often.model.dec_deg)
    assert once.model.ra_deg == pytest.approx(often.model.ra_deg, abs=1e-6)
    assert len(named(once.sent)) < len(named(often.sent))


def test_a_start_may_be_late() -> None:
    night = Night(start_delay_s=3.0)
    night.go(0.0, 20.0)
    assert night.state() == "Busy"
    night.wait(2.9)
    assert not night.model.is_moving_by_itself
    night.wait(2.0)
    assert night.model.is_moving_by_itself
    night.wait(11.0)
    assert night.model.dec_deg == pytest.approx(20.0)


@pytest.mark.parametrize("oddity", ["abortignored", "lieabort", "abortalert", "noabort"])
def test_these_drive_on_after_abort(oddity: str) -> None:
    night = Night(**{oddity: True})
    night.go(0.0, 0.0)
    night.wait(4.0)
    answers = night.abort()
    states = [each.get("state") for each in named(answers, ABORT)]
    assert states == {"abortalert": ["Alert"], "noabort": []}.get(oddity, ["Ok"])
    assert night.state() == ("Idle" if oddity == "lieabort" else "Busy")
    night.wait(4.0)
    assert night.model.is_moving_by_itself
    night.wait(10.0)
    assert night.model.dec_deg == pytest.approx(0.0, abs=1e-9)
    assert [each[1:] for each in night.model.received][-1] == (ABORT, {"ABORT": "On"})


def test_the_first_aborts_may_be_ignored() -> None:
    night = Night(aborts_ignored=2)
    night.go(0.0, 0.0)
    night.wait(3.0)
    for is_moving in (True, True, False):
        night.abort()
        night.wait(2.5)
        assert night.model.is_moving_by_itself is is_moving


def test_abort_leaves_tracking_alone_or_ends_it() -> None:
    for ends in (False, True):
        night = Night(abort_ends_tracking=ends)
        night.track()
        night.abort()
        night.wait(1.0)
        assert night.model.ra_rate_arcsec_s == pytest.approx(SIDEREAL_ARCSEC_S if ends else 0.0)
        assert night.state(TRACKING) == ("Idle" if ends else "Busy")


def test_states_that_say_nothing() -> None:
    night = Night(busyforever=True)
    night.track()
    assert night.state() == "Busy"
    night = Night(noidle=True)
    night.go(0.0, 0.0)
    night.wait(2.0)
    assert {each.get("state") for each in named(night.sent)} <= {"Idle", "Ok"}
    assert night.model.is_moving_by_itself


def test_a_parked_mount_refuses_and_says_why() -> None:
    night = Night(startparked=True)
    night.go(30.0, 10.0)
    assert night.state() == "Alert"
    assert "unpark" in night.words()[-1]
    night.wait(2.0)
    assert not night.model.is_moving_by_itself
    assert night.state() == "Idle"
    assert [each.get("state") for each in named(night.track(), TRACKING)] == ["Alert"]
    night.order("Switch", PARK, UNPARK="On")
    night.go(30.0, 10.0)
    assert night.state() == "Busy"


@pytest.mark.parametrize("oddity", ["", "trackwhileparked", "parklies", "parkok_instant"])
def test_parking(oddity: str) -> None:
    night = Night(**({oddity: True} if oddity else {}))
    night.track()
    night.park()
    at_once = {"": "Busy", "trackwhileparked": "Busy"}.get(oddity, "Ok")
    assert (night.state(PARK), night.value("PARK", PARK)) == (at_once, "On")
    assert night.state() == ("Idle" if oddity == "parklies" else "Busy")
    night.wait(3.0)
    assert night.model.is_moving_by_itself
    night.wait(30.0)
    assert (night.state(PARK), night.value("PARK", PARK)) == ("Ok", "On")
    rate = 0.0 if oddity == "trackwhileparked" else SIDEREAL_ARCSEC_S
    assert night.model.ra_rate_arcsec_s == pytest.approx(rate, abs=1e-6)
    assert night.state(TRACKING) == ("Busy" if oddity == "trackwhileparked" else "Idle")
    assert night.model.dec_deg == pytest.approx(PARK_DEC_DEG)
    if oddity != "trackwhileparked":
        assert night.model.ha_deg == pytest.approx(PARK_HA_DEG)


def test_a_parking_that_fails_and_one_that_is_given_up() -> None:
    night = Night(parkfails=True)
    assert [each.get("state") for each in named(night.park(), PARK)] == ["Alert"]
    assert "failed" in night.words()[-1]
    assert not night.model.is_moving_by_itself
    night = Night()
    night.park()
    night.wait(3.0)
    night.order("Switch", PARK, UNPARK="On")  # libindi: aborted, with Alert
    assert (night.state(PARK), night.value("PARK", PARK)) == ("Alert", "Off")
    night.wait(3.0)
    assert not night.model.is_moving_by_itself
    night.park()
    night.wait(3.0)
    night.abort()
    assert (night.state(PARK), night.value("PARK", PARK)) == ("Ok", "Off")


@pytest.mark.parametrize(
    ("oddity", "name"),
    [
        ("nopark", PARK),
        ("notrackstate", TRACKING),
        ("noabort", ABORT),
        ("noside", SIDE),
        ("nogeo", SITE),
        ("notime", TIME),
        ("nopollingperiod", PERIOD),
    ],
)
def test_what_a_driver_lacks_is_neither_defined_nor_obeyed(oddity: str, name: str) -> None:
    for is_there, night in ((True, Night()), (False, Night(**{oddity: True}))):
        night.ask("")
        assert bool(named(night.sent, name)) is is_there
        assert bool(night.ask(name)) is is_there
        night.track()
        night.park()
        night.wait(40.0)
        assert bool(named(night.sent, name)) is is_there


def test_reports_come_by_period_and_the_client_may_set_it() -> None:
    night = Night()
    assert len(named(night.wait(10.0))) == 20
    night.order("Number", PERIOD, PERIOD_MS=2000)
    night.wait(2.0)
    assert len(named(night.wait(10.0))) == 5
    night = Night(slowreport=5.0)
    assert float(night.value("PERIOD_MS", PERIOD) if night.ask(PERIOD) else 0.0) == 5000.0
    assert len(named(night.wait(10.0))) == 2
    assert night.model.next_event_s == pytest.approx(night.now_s + 5.0, abs=TICK_S)


def test_a_threshold_keeps_a_tracking_mount_silent() -> None:
    night = Night(threshold_arcsec=1.5)
    assert len(named(night.wait(10.0))) == 20  # it stands: 7.5 arcsec from look to look
    night.track()
    night.wait(1.0)
    assert named(night.wait(60.0)) == []
    night = Night(threshold_arcsec=33.0)
    assert len(named(night.wait(10.0))) == 4  # every 2.5 s, when it is 37 arcsec off


def test_asked_it_answers_with_what_it_last_sent_unless_it_looks() -> None:
    night, fresh = Night(threshold_arcsec=1.5), Night(getproperties_fresh=True)
    for each in (night, fresh):
        each.wait(1.0)
        before = each.value("RA")
        each.now_s += 0.3
        each.ask(COORDINATES)
        assert (each.value("RA") == before) is (each is night)


@pytest.mark.parametrize(("ra_step", "dec_step"), [(1.5, 1.5), (15.0, 1.0), (90.0, 60.0)])
def test_reports_are_rounded_to_steps(ra_step: float, dec_step: float) -> None:
    night = Night(step_arcsec=ra_step, ha_deg=12.3456789, dec_deg=34.5678912)
    night.wait(1.0)
    for member, per_arcsec, step in (("RA", 54000.0, ra_step), ("DEC", 3600.0, dec_step)):
        steps = float(night.value(member)) * per_arcsec / step
        assert steps == pytest.approx(round(steps), abs=1e-4)
    assert abs(float(night.value("DEC")) - night.model.dec_deg) <= dec_step * ONE_ARCSEC / 2.0


def test_a_custom_rate_drifts_while_it_tracks() -> None:
    night = Night(drift_arcsec_s=(20.0, -5.0))
    night.track()
    night.wait(1.0)
    ra_deg, dec_deg = night.model.ra_deg, night.model.dec_deg
    night.wait(10.0)
    assert (night.model.ra_deg - ra_deg) * 3600.0 == pytest.approx(200.0, abs=0.1)
    assert (night.model.dec_deg - dec_deg) * 3600.0 == pytest.approx(-50.0, abs=0.1)
    assert night.model.ra_rate_arcsec_s == pytest.approx(20.0)
    assert not night.model.is_moving_by_itself


def test_a_slew_without_tracking_stands_where_it_arrives() -> None:
    night = Night()
    night.order("Switch", ON_SET, SLEW="On")
    night.go(0.0, 40.0)
    night.wait(15.0)
    assert night.model.ra_rate_arcsec_s == pytest.approx(SIDEREAL_ARCSEC_S)
    assert night.state() == "Idle"


def test_a_deaf_driver_neither_answers_nor_obeys_and_the_mount_moves() -> None:
    night = Night()
    night.go(0.0, 0.0)
    night.wait(3.0)
    night.model.deaf = True
    assert night.abort() == night.ask("") == []
    assert night.wait(5.0) == []
    assert night.model.is_moving_by_itself
    assert night.model.received[-1][1] == ABORT
    night.model.deaf = False
    assert named(night.wait(1.0))


def test_a_killed_drivers_mount_goes_on_and_a_new_driver_knows_nothing_of_it() -> None:
    night = Night()
    night.go(0.0, 0.0)
    night.wait(3.0)
    night.model.end_driver()
    assert night.sent[-1].tag == "delProperty"
    assert night.abort() == []
    assert night.wait(2.0) == []
    night.model.start_driver()
    assert night.value("CONNECT", CONNECTION) == "Off"
    assert night.wait(1.0) == []
    night.order("Switch", CONNECTION, CONNECT="On")
    assert night.state() == "Idle"
    assert night.model.is_moving_by_itself
    night.abort()
    night.wait(3.0)
    assert not night.model.is_moving_by_itself


def test_a_mount_may_be_found_moving_when_its_driver_comes_back() -> None:
    night = Night(returns_moving=True)
    night.model.end_driver()
    night.model.start_driver()
    night.wait(2.0)
    assert night.model.is_moving_by_itself
    assert not night.model.received[1:]


def test_site_time_and_bytes() -> None:
    night = Night(wrongsite=True, badutf8=True)
    night.ask("")
    assert float(night.value("LAT", SITE)) == 47.0
    altitude_deg = night.model.altitude_deg
    night.order("Number", SITE, LAT=LATITUDE_DEG, LONG=278.95, ELEV=3)
    assert float(night.value("LAT", SITE)) == LATITUDE_DEG
    assert night.model.altitude_deg == altitude_deg
    assert night.value("UTC", TIME) == "2026-09-21T14:30:00"
    night.abort()
    assert night.words()[-1].endswith("\xcf\xfe")


def test_another_clients_slew_is_not_on_record_as_received() -> None:
    night = Night()
    night.model.go_to(night.model.ra_deg + 20.0, 50.0)
    assert night.state() == "Busy"
    assert [each[1] for each in night.model.received] == [CONNECTION]


def test_oddities_are_read_from_a_line() -> None:
    text = "lieabort slowreport=3 aborts_ignored=2 drift_arcsec_s=20,-1 threshold_arcsec=1.5"
    assert Oddities.parse(text) == Oddities(
        lieabort=True,
        slowreport=3.0,
        aborts_ignored=2,
        drift_arcsec_s=(20.0, -1.0),
        threshold_arcsec=1.5,
    )
    with pytest.raises(KeyError):
        Oddities.parse("altaz")


def test_the_server_serves_kills_and_freezes() -> None:
    def is_place(vector: IndiVector) -> bool:
        return vector.name == COORDINATES

    with OddMountServer({"period_s": 0.05}) as server:
        wire, other = (IndiWire("127.0.0.1", server.port) for _ in range(2))
        wire.ask(DEVICE)
        assert wire.wait(lambda vector: vector.name == CONNECTION, 2.0)
        # One that has not asked is told nothing, and is obeyed.
        other.new("Switch", DEVICE, CONNECTION, {"CONNECT": "On"})
        assert wire.wait(is_place, 2.0)
        assert other.wait(is_place, 0.1) is None
        with server.locked() as model:
            ra_deg = model.ra_deg
        server.foreign(ra_deg, 0.0)
        assert wire.wait(lambda vector: vector.state == "Busy" and is_place(vector), 2.0)
        server.freeze()
        wire.wait(is_place, 0.05)
        wire.ask(DEVICE)
        assert wire.wait(is_place, 0.2) is None
        server.thaw()
        assert wire.wait(lambda vector: is_place(vector) and vector.is_definition, 2.0)
        server.kill_driver(restart_s=0.1)
        gone = wire.wait(lambda vector: vector.name == CONNECTION, 2.0)
        assert gone is not None
        assert gone.values["CONNECT"] == "Off"
        assert (DEVICE, "") in wire.deleted
        with server.locked() as model:
            assert abs(model.dec_rate_arcsec_s) > AT_REST_ARCSEC_S
        wire.close()
        other.close()
