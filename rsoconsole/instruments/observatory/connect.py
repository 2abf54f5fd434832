"""Clock, mount, camera and safety monitor of one observatory, connected and surely released."""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from pathlib import Path

import platformdirs

from rsoconsole.config import APP, Config
from rsoconsole.instruments import Clock, Instruments
from rsoconsole.instruments.indi import open_safety_monitor
from rsoconsole.instruments.observatory.clock import SimulatedClock, SystemClock
from rsoconsole.instruments.observatory.protocols import Connection, camera_by, mount_by


@contextmanager
def connect_instruments(
    config: Config, *, clock: Clock | None = None, log_dir: Path | None = None
) -> Iterator[Instruments]:
    """Connect the configured mount and camera, each in a process of its own, and a clock.

    Where a weather station or a dome is configured, a safety monitor watches them.

    The clock is the simulated observatory's where ``indi.simulated`` says so, else the machine's,
    unless one is given. ``log_dir`` gets what libindi prints; None: the user's log folder.
    Raises InstrumentError when server, mount or camera cannot be reached, or are of a protocol that
    is not installed.
    """
    folder = log_dir or platformdirs.user_log_path(APP)
    with ExitStack() as release:
        connection = Connection(config=config, log_dir=folder)
        mount = mount_by(connection)
        release.callback(mount.close)
        camera = camera_by(connection)
        release.callback(camera.close)
        with ThreadPoolExecutor(2) as both:
            starts = [both.submit(mount.start), both.submit(camera.start)]
        for start in starts:
            start.result()
        if clock is None:
            own = (
                SimulatedClock(config.indi.host, config.indi.port, config.waits)
                if config.indi.simulated
                else SystemClock()
            )
            release.callback(own.close)
            clock = own
        safety_monitor = open_safety_monitor(config.indi, release, config.waits)
        yield Instruments(
            clock=clock,
            mount=mount,
            camera=camera,
            host=config.indi.host,
            port=config.indi.port,
            mount_name=_named(config.instruments.mount, config.indi.mount),
            camera_name=_named(config.instruments.camera, config.indi.camera),
            safety_monitor=safety_monitor,
        )


def _named(protocol: str, indi_name: str) -> str:
    """A device as words for people have it: by its INDI name, else by the protocol's."""
    return indi_name if protocol == "indi" else protocol
