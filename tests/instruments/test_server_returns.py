"""A server that dies and comes back, and one that stops reading: with either INDI client."""

import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from rsoconsole.base import InstrumentError
from rsoconsole.config import Config
from rsoconsole.instruments import Instruments, connect_instruments
from rsoconsole.instruments.observatory.clock import SimulatedClock
from rsoconsole.simulator import start_observatory
from rsoconsole.simulator.launch import Observatory
from tests.children.indi_clients import OTHERS_NIGHTLY
from tests.children.relay import Relay

NS = 1_000_000_000
PATIENCE_S = 20.0
START = (240.0, -5.0)


@pytest.fixture(scope="module")
def observatory() -> Iterator[Observatory]:
    with start_observatory("plain", 1, 0, stage="tests.rigs.stub_stage:open_plain") as running:
        yield running


@pytest.fixture
def clock(observatory: Observatory) -> Iterator[SimulatedClock]:
    """Not by the relay: time goes on."""
    clock = SimulatedClock(observatory.host, observatory.port)
    yield clock
    clock.close()


@pytest.fixture(params=OTHERS_NIGHTLY)
def behind_relay(
    request: pytest.FixtureRequest,
    observatory: Observatory,
    clock: SimulatedClock,
    tmp_path: Path,
) -> Iterator[tuple[Relay, Instruments]]:
    relay = Relay(observatory.port)
    indi = {"port": relay.port, "simulated": True, "client": request.param}
    optics = {"width_px": 256, "height_px": 192}
    config = Config.model_validate({"indi": indi, "optics": optics})
    with connect_instruments(config, clock=clock, log_dir=tmp_path) as instruments:
        yield relay, instruments
    relay.go()


def frame_of(instruments: Instruments, frame_id: int) -> int:
    instruments.camera.start_exposure(1.0, frame_id)
    instruments.clock.wait_until(instruments.clock.now_utc_ns() + 2 * NS)
    return instruments.camera.wait_frame(PATIENCE_S).frame_id


def test_a_server_that_comes_back_is_used_again_by_mount_and_camera(behind_relay, observatory):
    relay, instruments = behind_relay
    mount, clock = instruments.mount, instruments.clock
    mount.slew(*START, clock.now_utc_ns())
    assert frame_of(instruments, 1) == 1
    relay.go()
    with pytest.raises(InstrumentError, match=r"server went away|start indiserver"):
        mount.slew(250.0, 8.0, clock.now_utc_ns())
    with pytest.raises(InstrumentError, match=r"server went away|start indiserver"):
        frame_of(instruments, 2)
    relay.come(observatory.port)
    begun_s = time.monotonic()
    mount.slew(260.0, 8.0, clock.now_utc_ns())
    assert frame_of(instruments, 3) == 3
    assert time.monotonic() - begun_s < PATIENCE_S
    assert mount.abort().is_answered


@pytest.mark.parametrize("client", OTHERS_NIGHTLY)
def test_a_server_that_accepts_and_hangs_up_at_once_is_an_error_in_words(client, tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as listener:
        host, port = listener.getsockname()
        listener.settimeout(PATIENCE_S)
        waits = {"device_s": 3.0, "quiet_s": 1.0, "process_s": 60.0}
        indi = {"host": host, "port": port, "client": client}
        config = Config.model_validate({"indi": indi, "waits": waits})

        def hang_up() -> None:
            while True:
                try:
                    listener.accept()[0].close()
                except OSError:
                    return

        thread = threading.Thread(target=hang_up, daemon=True)
        thread.start()
        with (
            pytest.raises(InstrumentError, match="INDI server"),
            connect_instruments(config, log_dir=tmp_path),
        ):
            pass
        listener.shutdown(socket.SHUT_RDWR)
        thread.join(PATIENCE_S)
