"""What a mount's driver does not offer is found, and told with what follows from it."""

import contextlib
import socket
import threading
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from rsoconsole.base import InstrumentError
from rsoconsole.config import Config, MountConfig
from rsoconsole.engine.doctor import doctor
from rsoconsole.engine.doctor.mount_lacks import PROPERTIES, MissingAbility, missing_abilities
from rsoconsole.engine.service import service
from rsoconsole.engine.service._command_handler import CommandHandler
from rsoconsole.engine.service.machine_watch import driver_health
from rsoconsole.instruments import MountAbilities, SiteCheck
from rsoconsole.records import Event, Site
from tests.rigs.engine_rig import asked, rig

WHOLE = {"EQUATORIAL_EOD_COORD", *PROPERTIES.values()}
BARE = MountAbilities(
    can_abort=False,
    can_park=False,
    can_set_tracking=False,
    has_pier_side=False,
    has_site=False,
    has_time=False,
)
UNTOLD = SiteCheck(is_consistent=True, reported=None, detail="not told")
Serve = Callable[[set[str]], int]


@pytest.fixture
def server() -> Iterator[Serve]:
    """Servers of one mount each, whose driver defines these properties one by one."""
    with contextlib.ExitStack() as stack:

        def serve(properties: set[str]) -> int:
            listener = stack.enter_context(socket.create_server(("127.0.0.1", 0)))

            def define() -> None:
                with contextlib.suppress(OSError):
                    peer, _ = listener.accept()
                    with peer:
                        peer.recv(1000)
                        for name in ["CONNECTION", *sorted(properties)]:
                            told = f'device="Telescope Simulator" name="{name}"'
                            peer.sendall(f"<defNumberVector {told}/>".encode())
                        peer.recv(1000)  # a server does not hang up

            threading.Thread(target=define, daemon=True).start()
            return int(listener.getsockname()[1])

        yield serve


def names(abilities: MountAbilities, mount: MountConfig | None = None) -> list[str]:
    return [lack.name for lack in missing_abilities(abilities, mount or MountConfig())]


def test_a_mount_that_offers_all_lacks_nothing():
    assert names(MountAbilities()) == []


def test_each_lack_is_told_with_what_follows():
    found = missing_abilities(BARE, MountConfig())
    assert [lack.name for lack in found] == list(PROPERTIES)
    told = {lack.name: lack.text for lack in found}
    assert told["abort"] == "the mount has no ABORT: STOP cannot end a slew: cut its power"
    assert "dawn only stops it" in told["park"]
    assert [lack.name for lack in found if lack.needs_override] == ["abort", "tracking"]


def test_a_mount_that_parks_at_a_limit_may_be_armed_without_a_tracking_switch():
    (lack,) = missing_abilities(MountAbilities(can_set_tracking=False), MountConfig())
    assert not lack.needs_override
    assert lack.follows == "tracking cannot be ended at a limit: it parks there"


def test_a_fork_has_no_side_of_the_pier_to_tell():
    fork = MountConfig.model_validate({"type": "fork"})
    assert names(MountAbilities(has_pier_side=False)) == ["pier side"]
    assert names(MountAbilities(has_pier_side=False), fork) == []


# ---- the doctor ---------------------------------------------------------------------------------


def diagnosed(port: int) -> doctor.CheckResult:
    config = Config.model_validate({"indi": {"port": port}, "waits": {"quiet_s": 0.3}})
    return doctor.check_mount_driver(config)


@pytest.mark.parametrize(
    ("missing", "ok", "says"),
    [
        (set(), True, "offers all that is used"),
        ({"TELESCOPE_ABORT_MOTION"}, False, "STOP cannot end a slew"),
        ({"TELESCOPE_TRACK_STATE"}, None, "it parks there"),
        ({"TELESCOPE_TRACK_STATE", "TELESCOPE_PARK"}, False, "stay at its power switch"),
        ({"TELESCOPE_PARK"}, None, "dawn only stops it"),
        ({"TELESCOPE_PIER_SIDE"}, None, "from the hour angle"),
        ({"GEOGRAPHIC_COORD"}, None, "by hand"),
        ({"TIME_UTC"}, None, "by hand"),
        ({"EQUATORIAL_EOD_COORD"}, None, "is its driver connected"),
    ],
)
def test_the_doctor_asks_the_driver_what_it_offers(
    server: Serve, missing: set[str], ok: bool | None, says: str
):
    check = diagnosed(server(WHOLE - missing))
    assert check.ok is ok
    assert says in check.detail
    for name in missing - {"EQUATORIAL_EOD_COORD"}:
        assert name in check.detail
    assert bool(check.remedy) == (ok is False)


def test_an_unsafe_driver_is_told_with_the_override_that_arming_needs(server: Serve):
    check = diagnosed(server(WHOLE - {"TELESCOPE_ABORT_MOTION"}))
    assert "--override abort" in check.remedy


def test_without_a_server_nothing_is_said_of_the_driver():
    with socket.create_server(("127.0.0.1", 0)) as unused:
        port = unused.getsockname()[1]
    assert diagnosed(port).ok is None


# ---- the engine ---------------------------------------------------------------------------------


class BareMount:
    """Tells no site; takes one where it is said to."""

    def __init__(self, abilities: MountAbilities, refuses: bool = False) -> None:
        self.able, self.refuses = abilities, refuses
        self.sites: list[Site] = []

    def abilities(self) -> MountAbilities:
        return self.able

    def check_site(self, _site: Site) -> SiteCheck:
        return UNTOLD

    def set_site(self, site: Site) -> None:
        self.sites.append(site)
        if self.refuses:
            raise InstrumentError("the mount did not take its site in 15 s")


def test_an_engine_starts_with_a_mount_that_has_no_site():
    """It waited for 15 s for an answer to a property that is not there, and ended."""
    mount: Any = BareMount(MountAbilities(has_site=False))
    assert service._site_fault(mount, Config()) is None
    assert mount.sites == []


@pytest.mark.parametrize("refuses", [False, True])
def test_a_mount_that_knows_no_site_is_told_it_and_may_refuse(refuses: bool):
    mount: Any = BareMount(MountAbilities(), refuses)
    fault = service._site_fault(mount, Config())
    assert mount.sites == [Config().site.to_site()]
    assert (fault is not None) == refuses
    assert "did not take its site" in (fault or "did not take its site")


def test_a_driver_that_defines_its_properties_bit_by_bit_is_waited_for(monkeypatch):
    monkeypatch.setattr(service, "DEFINED_S", 0.2)
    asked_for: list[int] = []

    class Slow(BareMount):
        def abilities(self) -> MountAbilities:
            asked_for.append(1)
            return MountAbilities() if len(asked_for) > 3 else BARE

    slow: Any = Slow(BARE)
    assert service._mount_lacks(slow, Config()) == ()
    bare: Any = BareMount(BARE)
    assert len(service._mount_lacks(bare, Config())) == len(PROPERTIES)


def test_status_and_health_tell_what_the_mount_cannot(tmp_path):
    r = rig(set())
    lacks = missing_abilities(BARE, MountConfig())
    status = CommandHandler(r.engine, r.queue, tmp_path, lacks=lacks).status()
    assert status.mount_lacks == tuple(lack.text for lack in lacks)
    (driver,) = [each for each in status.health if each.name == "driver"]
    assert (driver.ok, driver.text) == (False, "no ABORT, no tracking switch, no park position")


def test_what_a_mount_only_does_not_tell_is_no_matter_of_health():
    lacks = missing_abilities(MountAbilities(has_time=False, has_site=False), MountConfig())
    assert len(lacks) == 2
    assert driver_health(lacks) == ()
    assert driver_health(()) == ()


@pytest.mark.parametrize(
    ("able", "name"),
    [
        (MountAbilities(can_abort=False), "abort"),
        (MountAbilities(can_set_tracking=False, can_park=False), "tracking"),
    ],
)
def test_arming_an_unsafe_mount_needs_its_override_by_name(tmp_path, able, name):
    r = rig(set())
    handler = CommandHandler(r.engine, r.queue, tmp_path)
    r.mount.able = able
    found = handler.handle(asked("arm")).data["checks"]
    others = [c["name"] for c in found if not c["ok"] and c["name"] != name]  # of this machine
    refused = handler.handle(asked("arm", {"override": others}))
    assert not refused.ok
    assert f"--override {name}" in refused.message
    assert handler.status().mount_lacks == tuple(
        e.text for e in missing_abilities(able, MountConfig())
    )
    assert handler.handle(asked("arm", {"override": [*others, name]})).ok
    r.engine.run(frames=2)
    assert r.engine.authority.is_autonomous
    assert name in r.engine.status().lifted
    assert any("without these checks: " in e.text and name in e.text for e in r.memory.of(Event))


def test_a_lack_is_a_line():
    assert "\n" not in MissingAbility(name="time", what="no time", follows="compare it").text
