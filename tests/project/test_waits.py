"""Slow machines: what is waited for is named, and slow is not taken for wrong."""

import asyncio
import contextlib
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from rsoconsole.base import ControlError, InstrumentError, LongWait, report_waits_to, waits
from rsoconsole.config import IndiConfig, WaitsConfig
from rsoconsole.control import AskStatus, ControlClient, EngineLock
from rsoconsole.instruments.indi._device_search import DeviceSearch
from rsoconsole.instruments.indi.indi_process import IndiProcess
from rsoconsole.instruments.mount.mount import IndiMount
from rsoconsole.simulator.devices.clock_device import CATCH_UP, MAX_BEHIND_S, VirtualClock

NS = 1_000_000_000
WANTED = "EQMod Mount"
FAR_TOO_LONG_S = 600.0


class Wall:
    """A clock that a test moves on."""

    def __init__(self) -> None:
        self.s = 0.0

    def __call__(self) -> float:
        return self.s


class StandIn:
    """An INDI server that announces what a test lets it announce, to all who are connected."""

    def __init__(self) -> None:
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._changed = threading.Condition()
        self._told = b""
        self.clients = 0
        threading.Thread(target=self._accept, daemon=True).start()

    @property
    def port(self) -> int:
        return int(self._listener.getsockname()[1])

    def announce(self, device: str) -> None:
        """The device, with what a mount offers."""
        switch = '<defSwitch name="{0}">{1}</defSwitch>'
        number = '<defNumber name="{0}" format="%g" min="0" max="360" step="0">1</defNumber>'
        head = f'device="{device}" name="{{}}" state="Ok" perm="rw"'
        connection = switch.format("CONNECT", "On") + switch.format("DISCONNECT", "Off")
        rule = 'rule="OneOfMany"'
        text = (
            f"<defSwitchVector {head.format('CONNECTION')} {rule}>{connection}</defSwitchVector>"
            f"<defSwitchVector {head.format('ON_COORD_SET')} {rule}>"
            f"{switch.format('TRACK', 'On')}</defSwitchVector>"
            f"<defNumberVector {head.format('EQUATORIAL_EOD_COORD')}>"
            f"{number.format('RA')}{number.format('DEC')}</defNumberVector>"
        )
        with self._changed:
            self._told += text.encode()
            self._changed.notify_all()

    def close(self) -> None:
        self._listener.close()

    def _accept(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                wire, _ = self._listener.accept()
                with self._changed:
                    self.clients += 1
                    self._changed.notify_all()
                threading.Thread(target=self._serve, args=(wire,), daemon=True).start()

    def _serve(self, wire: socket.socket) -> None:
        sent = 0
        with contextlib.suppress(OSError):
            while True:
                with self._changed:
                    while len(self._told) == sent:
                        self._changed.wait()
                    news = self._told[sent:]
                wire.sendall(news)
                sent += len(news)


@pytest.fixture
def server() -> Iterator[StandIn]:
    running = StandIn()
    yield running
    running.close()


def waiting_for(server: StandIn, wall: Wall) -> DeviceSearch:
    order = {
        "host": "127.0.0.1",
        "port": server.port,
        "setting": "indi.mount",
        "device_s": 40.0,
        "quiet_s": 10.0,
    }
    return DeviceSearch(WANTED, order, wall)


# ---- what a server announces -----------------------------------------------------------------


def test_a_server_with_other_devices_that_has_gone_quiet_has_a_wrong_name_in_the_settings(server):
    wall = Wall()
    server.announce("Telescope Simulator")
    with contextlib.closing(waiting_for(server, wall)) as there:
        there.check_announced()
        wall.s = 9.0
        there.check_announced()
        wall.s = 11.0
        with pytest.raises(InstrumentError) as caught:
            there.check_announced()
    assert f"no device '{WANTED}' within 11 s (it has: Telescope Simulator)" in str(caught.value)
    assert "set indi.mount to one of these" in str(caught.value)


def test_a_server_that_announces_nothing_is_given_all_the_time_and_no_setting_is_blamed(server):
    wall = Wall()
    with contextlib.closing(waiting_for(server, wall)) as there:
        wall.s = 39.0
        there.check_announced()
        wall.s = 41.0
        with pytest.raises(InstrumentError) as caught:
            there.check_announced()
    assert "no device at all within 41 s" in str(caught.value)
    assert "indi." not in str(caught.value)


def test_a_device_that_is_announced_but_held_up_is_not_taken_for_a_wrong_name(server):
    wall = Wall()
    server.announce("Telescope Simulator")
    server.announce(WANTED)
    with contextlib.closing(waiting_for(server, wall)) as there:
        there.check_announced()
        wall.s = 39.0
        there.check_announced()
        wall.s = 41.0
        with pytest.raises(InstrumentError) as caught:
            there.check_announced()
    assert f"has a device '{WANTED}'" in str(caught.value)
    assert "indi." not in str(caught.value)


def test_what_waits_unread_is_read_before_a_server_counts_as_quiet(server):
    wall = Wall()
    server.announce("CCD Simulator")
    with contextlib.closing(waiting_for(server, wall)) as there:
        there.check_announced()
        # This process was held up for a long time, and the server spoke meanwhile.
        server.announce("Focuser Simulator")
        wall.s = 30.0
        there.check_announced()
        assert there.others == ("CCD Simulator", "Focuser Simulator")


# ---- the mount's process ----------------------------------------------------------------------


@pytest.mark.timeout(60)
def test_a_mount_that_is_announced_late_is_waited_for_in_words(server, tmp_path, monkeypatch):
    monkeypatch.setattr(waits, "SAY_EVERY_S", 0.0)
    config = IndiConfig(port=server.port, mount=WANTED)
    patient = WaitsConfig(process_s=FAR_TOO_LONG_S, device_s=FAR_TOO_LONG_S)
    mount = IndiMount(config, tmp_path / "mount.log", waits=patient)
    heard: list[str] = []
    is_named, others_are_named = threading.Event(), threading.Event()

    def receive(words: str) -> None:
        heard.append(words)
        if f"mount '{WANTED}'" in words:
            is_named.set()
        if "has announced CCD Simulator until now" in words:
            others_are_named.set()

    with contextlib.closing(mount), report_waits_to(receive), ThreadPoolExecutor(1) as aside:
        started = aside.submit(mount.start)
        assert is_named.wait(FAR_TOO_LONG_S)
        server.announce("CCD Simulator")
        assert others_are_named.wait(FAR_TOO_LONG_S)
        assert not started.done()
        server.announce(WANTED)
        started.result()
    assert heard[0].startswith("waiting for ")


def test_a_mount_with_a_wrong_name_fails_with_the_right_ones(server, tmp_path):
    server.announce("Telescope Simulator")
    config = IndiConfig(port=server.port, mount=WANTED)
    mount = IndiMount(config, tmp_path / "mount.log", waits=WaitsConfig(quiet_s=0.5))
    with (
        contextlib.closing(mount),
        pytest.raises(InstrumentError, match=r"it has: Telescope Simulator\): set indi\.mount"),
    ):
        mount.start()


def test_a_process_that_is_not_ready_in_time_says_what_it_waited_for(tmp_path: Path):
    process = IndiProcess(
        name="camera",
        module="tests.children.faltering_child",
        settings={"awaits": "the lens cap"},
        log_path=tmp_path / "camera.log",
        on_event=lambda _: None,
        start_s=3.0,
    )
    with contextlib.closing(process), pytest.raises(InstrumentError) as caught:
        process.start()
    assert "waited 3 s for" in str(caught.value)
    assert "waits.process_s" in str(caught.value)


# ---- words ------------------------------------------------------------------------------------


def test_a_long_wait_says_what_for_and_how_long_and_only_now_and_then():
    wall, heard = Wall(), list[str]()
    with report_waits_to(heard.append):
        wait = LongWait("the camera's process to start", wall)
        for wall.s in (0.0, 4.9, 5.0, 6.0, 9.9, 10.5):
            wait.log_if_due()
    wait.log_if_due()
    assert heard == [
        "waiting for the camera's process to start ... 5 s",
        "waiting for the camera's process to start ... 10 s",
    ]


# ---- the simulated observatory's pace ------------------------------------------------------------


@pytest.fixture
def pauses(monkeypatch: pytest.MonkeyPatch) -> tuple[Wall, list[float]]:
    """A wall clock that only the virtual clock's own pauses move, and those."""
    wall, lasted = Wall(), list[float]()

    async def pause(awaitable, timeout_s: float) -> None:
        awaitable.close()
        lasted.append(timeout_s)
        wall.s += timeout_s
        raise TimeoutError

    monkeypatch.setattr(asyncio, "wait_for", pause)
    return wall, lasted


def advance(clock: VirtualClock, seconds: float) -> None:
    async def nobody() -> None:
        pass

    asyncio.run(clock.advance(clock.now_utc_ns + round(seconds * NS), nobody))


def test_paced_time_catches_up_what_the_engine_spent_between_two_waits(pauses):
    wall, _ = pauses
    clock = VirtualClock(0, 1.0, wall)
    advance(clock, 10.0)
    assert wall.s == pytest.approx(10.0)
    wall.s += 3.0
    advance(clock, 2.0)
    assert wall.s == pytest.approx(13.0 + 2.0 / CATCH_UP)
    advance(clock, 18.0)
    assert wall.s == pytest.approx(30.0)


def test_time_that_cannot_be_caught_up_is_late_by_the_wall(pauses):
    wall, _ = pauses
    clock = VirtualClock(0, 1.0, wall)
    advance(clock, 10.0)
    wall.s += 20.0
    advance(clock, 20.0)
    assert wall.s == pytest.approx(30.0 + 20.0 / CATCH_UP)
    wall.s += 1000.0
    advance(clock, 100.0 + MAX_BEHIND_S)
    assert wall.s > 1000.0 + 100.0


# ---- an engine that is only starting ---------------------------------------------------------


HOLD = """
import sys, pathlib
from rsoconsole.control import EngineLock
with EngineLock(pathlib.Path(sys.argv[1])):
    print("held", flush=True)
    sys.stdin.read()
"""


def test_an_engine_that_does_not_listen_yet_is_not_taken_for_none(tmp_path: Path):
    path = tmp_path / "engine.sock"
    client = ControlClient(path)
    with pytest.raises(ControlError, match="no engine is running"):
        client.send(AskStatus())
    with subprocess.Popen(
        [sys.executable, "-c", HOLD, str(path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as engine:
        assert engine.stdout is not None
        assert engine.stdout.readline() == b"held\n"
        with pytest.raises(ControlError, match=rf"is starting \(process {engine.pid}\)"):
            client.send(AskStatus())
        with pytest.raises(ControlError, match="already running"), EngineLock(path):
            pass
        engine.communicate()
    with pytest.raises(ControlError, match="no engine is running"):
        client.send(AskStatus())
