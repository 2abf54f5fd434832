"""A mount that nobody watches: slews are ended, tracking ends at its limit, claims are heeded."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from rsoconsole.config import Config, WaitsConfig
from rsoconsole.instruments import IndiWire
from rsoconsole.instruments.indi.indi_wire import IndiVector
from rsoconsole.instruments.mount._mount_owner import MountOwner
from rsoconsole.instruments.mount.mount import IndiMount
from rsoconsole.instruments.mount.mount_lease import Lease
from rsoconsole.instruments.observatory.clock import SimulatedClock
from rsoconsole.simulator import start_observatory
from rsoconsole.simulator.launch import Observatory
from tests.children.indi_clients import OTHERS_NIGHTLY
from tests.rigs.stub_stage import T_START_UTC_NS

NS = 1_000_000_000
STAGE = "tests.rigs.stub_stage:open_plain"
FAR = (290.0, 8.0)
SHORT_S = 0.4


# ---- the rule ------------------------------------------------------------------------------


def test_nothing_lapses_before_the_first_slew():
    lease = Lease(5.0)
    lease.renew(100.0)
    assert not lease.has_lapsed(1e9)


def test_a_lease_lapses_and_every_order_renews_it():
    lease = Lease(5.0)
    lease.begin(100.0)
    assert not lease.has_lapsed(104.9)
    assert lease.has_lapsed(105.0)
    lease.renew(104.0)
    assert not lease.has_lapsed(108.9)
    assert lease.has_lapsed(109.0)


def test_a_lease_is_as_long_as_was_last_said():
    lease = Lease(5.0)
    lease.begin(100.0, 20.0)
    lease.renew(110.0)
    assert not lease.has_lapsed(129.0)
    assert lease.has_lapsed(130.0)


def test_a_limit_is_acted_on_once_and_a_later_one_again():
    lease = Lease(5.0)
    assert not lease.is_past_limit(10**30)
    lease.set_limit(1000)
    assert not lease.is_past_limit(999)
    assert lease.is_past_limit(1000)
    lease.close_limit()
    assert not lease.is_past_limit(2000)
    assert lease.open_limit_utc_ns() is None
    lease.set_limit(3000)
    assert not lease.is_past_limit(2999)
    assert lease.is_past_limit(3000)
    lease.set_limit(None)
    assert not lease.is_past_limit(10**30)


def test_who_claims_a_mount_last_has_it(tmp_path):
    first, second = (MountOwner("here", 7624, "My Mount", tmp_path) for _ in range(2))
    other = MountOwner("here", 7624, "Another Mount", tmp_path)
    first.claim()
    other.claim()
    assert first.is_ours()
    second.claim()
    assert not first.is_ours()
    assert second.is_ours()
    first.release()
    assert second.is_ours()
    second.release()
    other.release()
    assert list(tmp_path.iterdir()) == []


def test_a_claim_outlives_its_file_because_nobody_else_wrote_one(tmp_path):
    owner = MountOwner("here", 7624, "My Mount", tmp_path)
    assert not owner.is_ours()
    owner.claim()
    for path in tmp_path.iterdir():
        path.unlink()
    assert owner.is_ours()


def test_without_a_folder_there_is_no_claim(tmp_path):
    owner = MountOwner("here", 7624, "My Mount", tmp_path / "nowhere")
    owner.claim()
    assert not owner.has_claimed


# ---- a living parent -----------------------------------------------------------------------


@pytest.fixture(autouse=True)
def runtime(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Claims of these tests are nobody else's."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))


@pytest.fixture(scope="module")
def shared() -> Iterator[Observatory]:
    with start_observatory("plain", 1, 0, stage=STAGE) as running:
        yield running


def is_coordinates(vector: IndiVector) -> bool:
    return vector.name == "EQUATORIAL_EOD_COORD" and vector.is_definition


@pytest.fixture
def observatory(shared: Observatory) -> Observatory:
    """One observatory for many tests: each begins in the east, tracking, not slewing."""
    mount = shared.mount_name
    with (
        closing(SimulatedClock(shared.host, shared.port)) as clock,
        closing(IndiWire(shared.host, shared.port)) as wire,
    ):
        wire.new("Switch", mount, "TELESCOPE_PARK", {"UNPARK": "On"})
        wire.new("Number", mount, "EQUATORIAL_EOD_COORD", {"RA": "16", "DEC": "-5"})
        wire.ask(mount, "EQUATORIAL_EOD_COORD")
        assert wire.wait(is_coordinates, 20.0)
        pass_s(clock, 120)
    return shared


@pytest.fixture
def clock(observatory: Observatory) -> Iterator[SimulatedClock]:
    clock = SimulatedClock(observatory.host, observatory.port)
    yield clock
    clock.close()


def pass_s(clock: SimulatedClock, seconds: float) -> None:
    """Let so much time pass."""
    clock.wait_until(clock.now_utc_ns() + round(seconds * NS))


@pytest.fixture(params=OTHERS_NIGHTLY)
def mount(
    request: pytest.FixtureRequest, observatory: Observatory, tmp_path: Path
) -> Iterator[IndiMount]:
    there = {"port": observatory.port, "simulated": True, "client": request.param}
    config = Config.model_validate({"indi": there})
    mount = IndiMount(config.indi, tmp_path / "mount.log", config.mount)
    mount.start()
    yield mount
    mount.close()


def comes_true(is_true: Callable[[], bool], timeout_s: float = 10.0) -> bool:
    """Whether it does before the time is out."""
    ends_s = time.monotonic() + timeout_s
    while time.monotonic() < ends_s:
        if is_true():
            return True
        time.sleep(0.02)
    return False


def test_a_slew_that_nobody_watches_is_ended_and_said_so(mount, clock, tmp_path):
    mount.slew(*FAR, clock.now_utc_ns())
    mount.keep(SHORT_S, None)
    assert mount.report().is_slewing
    assert comes_true(lambda: not mount.report().is_slewing)
    assert mount.report().is_tracking
    said: list[str] = []
    assert comes_true(lambda: bool(said.extend(mount.take_messages()) or said))
    assert said[0].startswith("nobody has watched this slew for 0.")
    assert said[0] in (tmp_path / "mount.log").read_text()


def test_a_slew_that_is_watched_goes_on(mount, clock):
    mount.slew(*FAR, clock.now_utc_ns())
    for _ in range(15):
        mount.keep(SHORT_S, None)
        time.sleep(0.1)
    assert mount.report().is_slewing
    assert mount.take_messages() == ()


def test_the_way_to_the_park_position_needs_no_watch(mount, clock):
    mount.park()
    mount.keep(0.1, None)
    time.sleep(3 * SHORT_S)
    assert mount.report().is_slewing
    while not mount.report(clock.now_utc_ns()).is_parked:
        clock.wait_until(clock.now_utc_ns() + 10 * NS)
    assert mount.take_messages() == ()


def test_tracking_ends_at_the_limit_unless_a_later_one_is_given(mount, clock):
    t0_utc_ns = clock.now_utc_ns()
    mount.keep(100.0, t0_utc_ns + 60 * NS)
    clock.wait_until(t0_utc_ns + 59 * NS)
    mount.keep(100.0, t0_utc_ns + 120 * NS)
    # An order that waits for its answer: the limit has been heard before.
    mount.utc_offset_s()
    clock.wait_until(t0_utc_ns + 119 * NS)
    time.sleep(0.5)
    assert mount.report(t0_utc_ns + 119 * NS).is_tracking
    clock.wait_until(t0_utc_ns + 121 * NS)
    assert comes_true(lambda: not mount.report().is_tracking)
    mount.set_tracking(True)
    time.sleep(0.5)
    assert mount.report().is_tracking


def test_keep_waits_for_nobody_and_starts_nothing(mount):
    pid = mount.process.pid
    os.kill(pid, signal.SIGSTOP)
    try:
        # More than the pipe to a frozen process holds.
        renew = [
            mount.process.send("keep", lease_s=1.0, track_until_utc_ns=None) for _ in range(3000)
        ]
        assert renew[0]
        assert not renew[-1]
        mount.keep(1.0, None)
    finally:
        os.kill(pid, signal.SIGKILL)
    assert comes_true(lambda: mount.process.pid is None)
    mount.keep(1.0, None)
    assert mount.process.pid is None


# ---- a parent that hangs or is gone --------------------------------------------------------


class Child:
    """A mount's process whose parent does as a test likes."""

    def __init__(self, observatory: Observatory, log: Path, client: str) -> None:
        with log.open("ab") as errors:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "rsoconsole.instruments.mount.mount_child"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=errors,
            )
        self.number = 0
        self.order(
            "start",
            client=client,
            host=observatory.host,
            port=observatory.port,
            device=observatory.mount_name,
            setting="indi.mount",
            **WaitsConfig().model_dump(include={"device_s", "quiet_s", "answer_s"}),
            simulated=True,
            after_stop="track",
            lease_s=10.0,
        )

    def order(self, verb: str, *, awaits: bool = True, **arguments: Any) -> None:
        """Give an order; wait for its answer."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.number += 1
        line = json.dumps({"id": self.number, "verb": verb, **arguments})
        self.process.stdin.write(line.encode() + b"\n")
        self.process.stdin.flush()
        while awaits:
            answer = json.loads(self.process.stdout.readline())
            if answer.get("id") == self.number:
                assert "error" not in answer
                return

    def slew(self) -> None:
        """Somewhere far."""
        ra_icrs_deg, dec_icrs_deg = FAR
        self.order(
            "slew", ra_icrs_deg=ra_icrs_deg, dec_icrs_deg=dec_icrs_deg, now_utc_ns=T_START_UTC_NS
        )

    def keep(self, clock: SimulatedClock, seconds: float) -> None:
        """Watch; the limit in seconds from now."""
        limit_utc_ns = clock.now_utc_ns() + round(seconds * NS)
        self.order("keep", lease_s=10.0, track_until_utc_ns=limit_utc_ns)

    def lose_parent(self) -> None:
        """What the kernel does to the pipe when the parent is killed in the middle of an order."""
        assert self.process.stdin is not None
        self.process.stdin.write(b'{"id": 99, "ve')
        self.process.stdin.close()

    def close(self) -> None:
        """End it."""
        self.process.kill()
        self.process.wait()
        for stream in (self.process.stdin, self.process.stdout):
            assert stream is not None
            stream.close()


@pytest.fixture(params=OTHERS_NIGHTLY)
def client(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def children(
    client: str, observatory: Observatory, tmp_path: Path
) -> Iterator[Callable[[], Child]]:
    made: list[Child] = []

    def make() -> Child:
        made.append(Child(observatory, tmp_path / "mount.log", client))
        return made[-1]

    yield make
    for child in made:
        child.close()


def told(observatory: Observatory, name: str) -> IndiVector:
    with closing(IndiWire(observatory.host, observatory.port)) as wire:
        wire.ask(observatory.mount_name, name)
        vector = wire.wait(lambda each: each.name == name, 20.0)
    assert vector is not None
    return vector


def stands(observatory: Observatory) -> bool:
    return told(observatory, "EQUATORIAL_EOD_COORD").state == "Ok"


def tracks(observatory: Observatory) -> bool:
    return told(observatory, "TELESCOPE_TRACK_STATE").values["TRACK_ON"] == "On"


def test_a_parent_that_reads_nothing_does_not_hold_up_the_watch(children, observatory):
    child = children()
    child.slew()
    with closing(IndiWire(observatory.host, observatory.port)) as wire:
        # Each makes the child report; together far more than a pipe holds.
        for _ in range(400):
            wire.new("Switch", observatory.mount_name, "SIM_REPORT", {"NOW": "On"})
        child.order("keep", awaits=False, lease_s=SHORT_S, track_until_utc_ns=None)
        assert not stands(observatory)
        assert comes_true(lambda: stands(observatory), 30.0)
    assert tracks(observatory)


def test_a_child_that_lost_its_parent_stops_the_mount_and_ends_where_no_limit_is_known(
    children, observatory
):
    child = children()
    child.slew()
    child.lose_parent()
    assert child.process.wait(10.0) == 0
    assert stands(observatory)
    assert tracks(observatory)


def test_a_child_that_lost_its_parent_stays_until_the_limit(children, observatory, clock):
    child = children()
    child.keep(clock, 60.0)
    child.lose_parent()
    pass_s(clock, 59)
    time.sleep(0.5)
    assert child.process.poll() is None
    assert tracks(observatory)
    pass_s(clock, 2)
    assert child.process.wait(10.0) == 0
    assert not tracks(observatory)


def test_it_leaves_the_mount_to_a_new_watch(children, observatory, clock):
    old, new = children(), children()
    old.keep(clock, 60.0)
    old.lose_parent()
    time.sleep(0.5)
    assert old.process.poll() is None
    new.keep(clock, 3600.0)
    assert old.process.wait(10.0) == 0
    pass_s(clock, 61)
    assert tracks(observatory)


def test_it_leaves_the_mount_to_whichever_moves_it(children, observatory, clock):
    child = children()
    child.keep(clock, 60.0)
    child.lose_parent()
    time.sleep(0.5)
    with closing(IndiWire(observatory.host, observatory.port)) as wire:
        wire.new("Number", observatory.mount_name, "EQUATORIAL_EOD_COORD", {"RA": "17", "DEC": "5"})
        assert child.process.wait(10.0) == 0
    assert not stands(observatory)


def test_it_ends_with_the_server(client, tmp_path):
    with start_observatory("plain", 1, 0, stage=STAGE) as own:
        clock = SimulatedClock(own.host, own.port)
        child = Child(own, tmp_path / "mount.log", client)
        child.keep(clock, 60.0)
        child.lose_parent()
        clock.close()
        own.process.kill()
        child.process.wait(10.0)
        child.close()


def test_a_parent_that_takes_its_leave_leaves_no_guard(children, observatory, clock):
    child = children()
    child.keep(clock, 60.0)
    child.order("end", awaits=False)
    assert child.process.wait(10.0) == 0
    assert tracks(observatory)


def test_a_mount_on_its_way_to_park_is_let_go_there(children, observatory, clock):
    child = children()
    child.order("park")
    child.lose_parent()
    assert child.process.wait(10.0) == 0
    pass_s(clock, 300)
    assert told(observatory, "TELESCOPE_PARK").values["PARK"] == "On"


def test_a_mount_that_stood_still_is_left_standing(children, observatory):
    child = children()
    child.order("set_tracking", is_on=False)
    child.lose_parent()
    assert child.process.wait(10.0) == 0
    assert not tracks(observatory)


def test_signals_meant_for_the_parent_are_left_to_it(children, observatory):
    """A service manager signals all processes at once: the engine needs this one for its STOP."""
    child = children()
    child.slew()
    child.process.send_signal(signal.SIGTERM)
    child.order("abort")
    assert stands(observatory)
