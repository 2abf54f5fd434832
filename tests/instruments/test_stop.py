"""STOP by every path: motion ends, tracking is then as configured; a mount that does not obey."""

import os
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from dataclasses import dataclass
from itertools import product
from typing import Any

import pytest

from rsoconsole.base import InstrumentError
from rsoconsole.config import Config
from rsoconsole.instruments import IndiWire, StopResult
from rsoconsole.instruments.indi.indi_client import Vector
from rsoconsole.instruments.indi.wire_stop import stop_mount
from rsoconsole.instruments.motion import tracking_after_stop
from rsoconsole.instruments.mount.mount import IndiMount
from rsoconsole.instruments.mount.mount_mirror import MountMirror
from rsoconsole.instruments.observatory.clock import SimulatedClock
from rsoconsole.records import Site
from rsoconsole.simulator import start_observatory
from rsoconsole.simulator.launch import Observatory
from tests.children.indi_clients import OTHERS_NIGHTLY

NS = 1_000_000_000
STAGE = "tests.rigs.stub_stage:open_plain"
START, FAR = (240.0, -5.0), (290.0, 8.0)
NO_FAULTS = dict.fromkeys(
    (
        "IGNORED_SLEWS",
        "IGNORED_ABORTS",
        "ABORT_ENDS_TRACKING",
        "TRACKING_RETURNS",
        "IS_SILENT",
    ),
    0,
)


# ---- what becomes of tracking --------------------------------------------------------------


@pytest.mark.parametrize("was", list(product((False, True), repeat=3)))
def test_standing_still_is_the_same_whatever_the_mount_did(was):
    was_slewing, was_parking, was_tracking = was
    facts = {"was_slewing": was_slewing, "was_parking": was_parking, "was_tracking": was_tracking}
    assert tracking_after_stop("stand still", **facts, is_parked=False) is False
    assert tracking_after_stop("stand still", **facts, is_parked=True) is None


@pytest.mark.parametrize(
    ("was_slewing", "was_parking", "was_tracking", "wanted"),
    [
        (True, False, False, True),
        (False, False, True, True),
        (False, False, False, None),
        (False, True, True, None),
    ],
)
def test_tracking_is_restored_only_where_there_was_any(
    was_slewing, was_parking, was_tracking, wanted
):
    facts = {"was_slewing": was_slewing, "was_parking": was_parking, "was_tracking": was_tracking}
    assert tracking_after_stop("track", **facts, is_parked=False) is wanted
    assert tracking_after_stop("track", **facts, is_parked=True) is None


# ---- the simulated mount, made to misbehave ------------------------------------------------


@dataclass
class Post:
    """One mount, one way to be stopped by three paths."""

    observatory: Observatory
    clock: SimulatedClock
    mount: IndiMount
    after_stop: Any

    def fault(self, **faults: float) -> None:
        """Have the mount misbehave."""
        with closing(IndiWire(self.observatory.host, self.observatory.port)) as wire:
            values = {key: str(value) for key, value in faults.items()}
            wire.new("Number", self.observatory.mount_name, "SIM_FAULTS", values)
            told = wire.wait(lambda v: v.name == "SIM_FAULTS" and not v.is_definition, 10.0)
            assert told is not None

    def slew(self) -> None:
        """Somewhere far."""
        self.mount.slew(*FAR, self.clock.now_utc_ns())

    def arrive(self) -> None:
        """Let time pass until the mount does not move."""
        while self.mount.report(self.clock.now_utc_ns()).is_slewing:
            self.clock.wait_until(self.clock.now_utc_ns() + 5 * NS)

    def stop(self, path: str) -> StopResult:
        """STOP through the mount's process, past a frozen one, or without any engine."""
        observatory = self.observatory
        where = (observatory.host, observatory.port, observatory.mount_name)
        if path == "process":
            return self.mount.abort()
        if path == "no engine":
            # Its clock stands still: what moves in it cannot be measured.
            return stop_mount(*where, after_stop=self.after_stop, measures=False)
        pid = self.mount.process.pid
        assert pid is not None
        os.kill(pid, signal.SIGSTOP)
        try:
            return self.mount.abort()
        finally:
            os.kill(pid, signal.SIGCONT)

    def says(self) -> tuple[bool, bool]:
        """(slews, tracks), by the mount's own word on the wire."""
        with closing(IndiWire(self.observatory.host, self.observatory.port)) as wire:
            found = {}
            for name in ("EQUATORIAL_EOD_COORD", "TELESCOPE_TRACK_STATE"):
                wire.ask(self.observatory.mount_name, name)
                found[name] = wire.wait(lambda v, name=name: v.name == name, 10.0)
        coordinates, tracking = found.values()
        assert coordinates is not None
        assert tracking is not None
        return coordinates.state == "Busy", tracking.values["TRACK_ON"] == "On"


@pytest.fixture(scope="module", params=OTHERS_NIGHTLY)
def posts(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[dict[str, Post]]:
    """One mount each: for a while after a STOP two processes with other ideas would argue."""
    logs = tmp_path_factory.mktemp("logs")
    with ExitStack() as open_until_the_end:
        made = {}
        for after_stop in ("track", "stand still"):
            observatory = open_until_the_end.enter_context(
                start_observatory("plain", 1, 0, stage=STAGE)
            )
            clock = SimulatedClock(observatory.host, observatory.port)
            open_until_the_end.callback(clock.close)
            config = Config.model_validate(
                {
                    "indi": {
                        "port": observatory.port,
                        "simulated": True,
                        "client": request.param,
                    },
                    "mount": {"after_stop": after_stop, "lease_s": 600},
                    # For a slew that is passed over; STOP has its own limits.
                    "waits": {"answer_s": 4.0},
                }
            )
            log = logs / f"{after_stop}.log"
            mount = IndiMount(config.indi, log, config.mount, config.waits)
            open_until_the_end.callback(mount.close)
            mount.start()
            made[after_stop] = Post(observatory, clock, mount, after_stop)
        yield made


@pytest.fixture(params=["track", "stand still"])
def post(posts: dict[str, Post], request: pytest.FixtureRequest) -> Post:
    return sound(posts[request.param])


@pytest.fixture
def standing_post(posts: dict[str, Post]) -> Post:
    return sound(posts["stand still"])


@pytest.fixture
def tracking_post(posts: dict[str, Post]) -> Post:
    return sound(posts["track"])


def sound(post: Post) -> Post:
    """Each test begins tracking at START, not slewing, with a mount that obeys."""
    post.fault(**NO_FAULTS)
    post.mount.unpark()
    post.mount.slew(*START, post.clock.now_utc_ns())
    post.arrive()
    return post


def comes_true(is_true: Callable[[], bool], timeout_s: float = 10.0) -> bool:
    """Whether it does before the time is out."""
    ends_s = time.monotonic() + timeout_s
    while time.monotonic() < ends_s:
        if is_true():
            return True
        time.sleep(0.02)
    return False


PATHS = ["process", "frozen process", "no engine"]


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("abort_ends_tracking", [0, 1])
def test_a_slew_is_ended_and_tracking_is_as_configured(post, path, abort_ends_tracking):
    post.fault(ABORT_ENDS_TRACKING=abort_ends_tracking)
    post.slew()
    result = post.stop(path)
    tracks = post.after_stop == "track"
    assert (result.is_answered, result.is_tracking, result.detail) == (True, tracks, "")
    # A process that was frozen carries out its ABORT when it thaws.
    assert comes_true(lambda: post.says() == (False, tracks))


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("abort_ends_tracking", [0, 1])
def test_so_it_is_with_a_mount_that_only_tracked(post, path, abort_ends_tracking):
    post.fault(ABORT_ENDS_TRACKING=abort_ends_tracking)
    result = post.stop(path)
    assert result.is_answered
    assert comes_true(lambda: post.says() == (False, post.after_stop == "track"))


@pytest.mark.parametrize("path", PATHS)
def test_a_mount_that_stood_still_is_not_set_tracking_by_stop(tracking_post, path):
    tracking_post.mount.set_tracking(False)
    # The second connection of 'no engine' may be quicker than what the first has ordered.
    assert comes_true(lambda: tracking_post.says() == (False, False))
    result = tracking_post.stop(path)
    assert (result.is_answered, result.is_tracking) == (True, False)
    assert comes_true(lambda: tracking_post.says() == (False, False))


@pytest.mark.parametrize("path", ["process", "no engine"])
def test_a_driver_that_goes_back_to_tracking_is_told_again(standing_post, path):
    standing_post.slew()
    standing_post.fault(TRACKING_RETURNS=1)
    assert standing_post.stop(path).is_answered
    assert comes_true(lambda: standing_post.says() == (False, False))
    time.sleep(0.5)
    assert standing_post.says() == (False, False)


@pytest.mark.parametrize("path", ["process", "no engine"])
def test_an_abort_that_is_passed_over_is_repeated(tracking_post, path):
    tracking_post.slew()
    tracking_post.fault(IGNORED_ABORTS=2)
    assert tracking_post.stop(path).is_answered
    assert comes_true(lambda: tracking_post.says() == (False, True))


@pytest.mark.parametrize("path", ["process", "no engine"])
def test_a_mount_that_does_not_stop_is_said_to_move_still(tracking_post, path):
    tracking_post.slew()
    tracking_post.fault(IGNORED_ABORTS=1000)
    result = tracking_post.stop(path)
    assert not result.is_answered
    assert result.is_tracking is None
    assert "says that it still moves after" in result.detail
    tracking_post.fault(**NO_FAULTS)
    assert tracking_post.stop("process").is_answered


def test_a_driver_that_hangs_is_not_taken_for_a_mount_that_stands(tracking_post):
    tracking_post.slew()
    tracking_post.fault(IS_SILENT=1)
    result = tracking_post.stop("no engine")
    assert not result.is_answered
    tracking_post.fault(**NO_FAULTS)


def test_a_slew_that_is_passed_over_is_an_error(tracking_post):
    tracking_post.fault(IGNORED_SLEWS=1)
    with pytest.raises(InstrumentError, match="did not start to slew"):
        tracking_post.slew()
    tracking_post.slew()
    assert tracking_post.mount.report().is_slewing


# ---- parking -------------------------------------------------------------------------------


def test_a_parked_mount_refuses_what_it_cannot_do_and_stays_parked(tracking_post):
    mount = tracking_post.mount
    mount.park()
    with pytest.raises(InstrumentError, match="on its way to its park position"):
        tracking_post.slew()
    mount.park()
    tracking_post.arrive()
    mount.park()
    for order in (tracking_post.slew, lambda: mount.set_tracking(True)):
        with pytest.raises(InstrumentError, match="unpark it first"):
            order()
    assert tracking_post.stop("process").is_answered
    assert mount.report().is_parked
    mount.unpark()
    mount.unpark()
    assert not mount.report().is_parked
    assert not mount.report().is_tracking


def test_unpark_ends_the_way_to_the_park_position(tracking_post):
    tracking_post.mount.park()
    tracking_post.mount.take_messages()
    tracking_post.mount.unpark()
    report = tracking_post.mount.report()
    assert (report.is_slewing, report.is_parked) == (False, False)
    assert any("in its park position yet" in text for text in tracking_post.mount.take_messages())
    tracking_post.slew()
    assert tracking_post.mount.report().is_slewing


# ---- what the mount believes ---------------------------------------------------------------


def test_a_mount_believes_the_site_it_is_told(tracking_post):
    elsewhere = Site(latitude_deg=52.0, longitude_deg=13.0, elevation_m=40.0)
    home = tracking_post.mount.check_site(elsewhere).reported
    tracking_post.mount.set_site(elsewhere)
    check = tracking_post.mount.check_site(elsewhere)
    assert check.is_consistent
    assert check.reported == elsewhere
    tracking_post.mount.set_site(home)
    assert tracking_post.mount.check_site(home).is_consistent


def test_the_mount_s_clock_is_held_against_the_observatory_s(tracking_post):
    one_ms = 1e-3
    assert tracking_post.mount.utc_offset_s() == pytest.approx(0.0, abs=one_ms)
    observatory = tracking_post.observatory
    with closing(IndiWire(observatory.host, observatory.port)) as wire:
        told = {"UTC": "2023-06-23T02:13:20", "OFFSET": "0"}
        wire.new("Text", observatory.mount_name, "TIME_UTC", told)
        assert wire.wait(lambda v: v.name == "TIME_UTC" and not v.is_definition, 10.0)
    told_utc_ns = 1_687_486_400 * NS
    expected_s = (told_utc_ns - tracking_post.clock.now_utc_ns()) / NS
    assert tracking_post.mount.utc_offset_s() == pytest.approx(expected_s, abs=one_ms)
    tracking_post.clock.wait_until(tracking_post.clock.now_utc_ns() + 10 * NS)
    assert tracking_post.mount.utc_offset_s() == pytest.approx(expected_s, abs=one_ms)


class Mirrored:
    """A client that has heard these vectors."""

    def __init__(self, *vectors: Vector, has_connected_device: bool = False) -> None:
        self._vectors = {vector.name: vector for vector in vectors}
        self.has_connected_device = has_connected_device

    def get(self, name: str) -> Vector | None:
        """A property as last heard of."""
        return self._vectors.get(name)


def heard(name: str, state: str, age_s: float, is_definition: bool = False, **values: Any):
    return Vector(
        name=name,
        state=state,
        values=values,
        serial=1,
        is_definition=is_definition,
        arrived_monotonic_s=time.monotonic() - age_s,
    )


def clock_told(seconds: float, age_s: float, *, is_definition: bool, is_ours: bool = False):
    """The offset of a mount whose clock, ``age_s`` ago, was so many seconds ahead."""
    at = time.gmtime(time.time() - age_s + seconds)
    vector = heard(
        "TIME_UTC", "Ok", age_s, is_definition, UTC=time.strftime("%Y-%m-%dT%H:%M:%S", at)
    )
    return MountMirror(Mirrored(vector, has_connected_device=is_ours), False).utc_offset_s()


def test_the_age_of_the_mount_s_time_is_not_taken_for_an_error():
    # The driver tells whole seconds.
    assert clock_told(3600.0, 600.0, is_definition=False) == pytest.approx(3600.0, abs=1.5)
    assert clock_told(-3600.0, 600.0, is_definition=False) == pytest.approx(-3600.0, abs=1.5)


def test_a_time_told_to_somebody_else_long_ago_says_only_that_the_mount_is_not_slow():
    assert clock_told(-3600.0, 0.0, is_definition=True) is None
    assert clock_told(3600.0, 0.0, is_definition=True) == pytest.approx(3600.0, abs=1.5)
    ours = clock_told(-3600.0, 0.0, is_definition=True, is_ours=True)
    assert ours == pytest.approx(-3600.0, abs=1.5)


@pytest.mark.parametrize("text", ["", "yesterday"])
def test_a_mount_without_a_time_has_no_offset(text):
    assert MountMirror(Mirrored(), False).utc_offset_s() is None
    vector = heard("TIME_UTC", "Idle", 0.0, UTC=text)
    assert MountMirror(Mirrored(vector), False).utc_offset_s() is None


def test_a_driver_that_falls_silent_in_the_middle_of_a_slew_is_an_error():
    def report(state: str, age_s: float) -> dict[str, Any]:
        vector = heard("EQUATORIAL_EOD_COORD", state, age_s, RA=3.0, DEC=5.0)
        return MountMirror(Mirrored(vector), False).fresh_report()

    assert report("Busy", 3.0)["age_s"] == pytest.approx(3.0, abs=0.5)
    with pytest.raises(InstrumentError, match="said nothing for 11 s in the middle of a slew"):
        report("Busy", 11.0)
    # One that only tracks has nothing to say.
    assert not report("Ok", 3000.0)["is_slewing"]
