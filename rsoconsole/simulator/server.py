"""The simulated observatory: a process that serves INDI on 127.0.0.1 until its parent ends.

It reads one JSON line of settings from stdin, prints one JSON line with its port, and runs until
stdin closes, so that it never outlives its parent process.
"""

import asyncio
import contextlib
import importlib
import json
import logging
import socket
import sys
import threading
from collections.abc import Coroutine
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from indipydriver import IPyDriver, getProperties
from indipyserver import IPyServer

from rsoconsole.config import OpticsConfig
from rsoconsole.records import Site
from rsoconsole.simulator.camera.indi_fits import camera_traits
from rsoconsole.simulator.devices.camera_device import CameraDevice
from rsoconsole.simulator.devices.clock_device import ClockDevice, VirtualClock
from rsoconsole.simulator.devices.mount_device import MountDevice
from rsoconsole.simulator.devices.weather_and_dome import DomeDevice, WeatherDevice
from rsoconsole.simulator.launch import (
    CAMERA_NAME,
    DOME_NAME,
    HOST,
    MOUNT_NAME,
    WEATHER_NAME,
    ObservatorySettings,
)
from rsoconsole.simulator.mount.indi_vectors import indi_timestamp
from rsoconsole.simulator.mount.mount_model import MountCreepAndJumps, MountModel, MountTraits
from rsoconsole.simulator.nights.night_plan import (
    load_stars_for_plan,
    plan_of_table,
    scenario_from_plan,
)
from rsoconsole.simulator.nights.scenarios import scenario_named
from rsoconsole.simulator.scene.scene import Scene
from rsoconsole.simulator.scene.world_scene import binned_optics
from rsoconsole.simulator.world.world import DEFAULT_WORLD, World, world_from
from rsoconsole.sky import icrs_of_hour_angle, icrs_to_jnow


@dataclass(frozen=True, slots=True, kw_only=True)
class ObservatorySetup:
    """Site, time, telescope and sky of a simulated night."""

    site: Site
    optics: OpticsConfig
    t_start_utc_ns: int
    start_ra_icrs_deg: float
    """Right ascension at which the mount points when the night begins, by its own coordinates."""
    start_dec_icrs_deg: float
    scene: Scene
    world: World = DEFAULT_WORLD
    """Imperfections; ``scene`` was made with the same world."""


def make_observatory_setup(settings: ObservatorySettings) -> ObservatorySetup:
    """Return the stage of a scenario, of a plan, or from the function that the settings name.

    Raises ConfigError for an unknown scenario and for an invalid world.
    """
    if settings.stage is None:
        return _scenario_stage(settings)
    module, _, function = settings.stage.partition(":")
    stage: ObservatorySetup = getattr(importlib.import_module(module), function)(settings)
    return stage


def _scenario_stage(settings: ObservatorySettings) -> ObservatorySetup:
    plan = None if settings.plan is None else plan_of_table(settings.plan)
    scenario = scenario_named(settings.scenario) if plan is None else scenario_from_plan(plan)
    world = world_from(settings.world)
    standard = OpticsConfig()
    optics = standard.model_copy(
        update={
            "width_px": settings.width_px or standard.width_px,
            "height_px": settings.height_px or standard.height_px,
        }
    )
    optics = binned_optics(optics, world)
    ra_icrs_deg, dec_icrs_deg = icrs_of_hour_angle(
        scenario.site,
        scenario.start_hour_angle_for(optics.field_deg[0]),
        scenario.start_declination_deg,
        scenario.t_start_utc_ns,
    )
    return ObservatorySetup(
        site=scenario.site,
        optics=optics,
        t_start_utc_ns=scenario.t_start_utc_ns,
        start_ra_icrs_deg=float(ra_icrs_deg),
        start_dec_icrs_deg=float(dec_icrs_deg),
        scene=Scene(
            scenario,
            settings.seed,
            optics=optics,
            catalogue=None if plan is None else load_stars_for_plan(plan),
            world=world,
        ),
        world=world,
    )


_QUICK_ACK: int | None = getattr(socket, "TCP_QUICKACK", None)


class ObservatoryDriver(IPyDriver):  # type: ignore[misc]
    """INDI driver of all simulated devices; it passes each request to its device."""

    def __init__(self, stage: ObservatorySetup, settings: ObservatorySettings) -> None:
        self._tasks: set[asyncio.Task[None]] = set()
        site, optics = stage.site, stage.optics
        self._clock = VirtualClock(stage.t_start_utc_ns, settings.speed)
        ra_date_deg, dec_date_deg = icrs_to_jnow(
            stage.start_ra_icrs_deg, stage.start_dec_icrs_deg, self._clock.now_utc_ns
        )
        own, arrival = stage.world.mount, stage.world.mount.arrival_arcsec
        model = MountModel(
            latitude_deg=site.latitude_deg,
            longitude_deg=site.longitude_deg,
            seed=settings.seed,
            t_utc_ns=self._clock.now_utc_ns,
            ra_date_deg=float(ra_date_deg),
            dec_date_deg=float(dec_date_deg),
            traits=MountTraits() if arrival is None else MountTraits(random_arcsec=arrival),
            unrest=MountCreepAndJumps(
                settings.seed,
                self._clock.now_utc_ns,
                own.settle_s,
                own.settle_arcsec,
                own.jump_arcsec,
                own.jump_every_s,
            ),
        )
        self._mount = MountDevice(
            MOUNT_NAME, model, site, optics.focal_length_mm, self._present_utc_ns
        )
        self._camera = CameraDevice(
            name=CAMERA_NAME,
            traits=camera_traits(optics, stage.world),
            scene=stage.scene,
            mount=model,
            site=site,
            now_utc_ns=self._present_utc_ns,
            truth_path=Path(settings.truth_path) if settings.truth_path else None,
            mount_name=MOUNT_NAME,
            spawn=self._spawn,
            world=stage.world,
            seed=settings.seed,
        )
        night = (stage.t_start_utc_ns, self._present_utc_ns)
        self._weather = WeatherDevice(WEATHER_NAME, settings.weather, *night)
        self._dome = DomeDevice(DOME_NAME, settings.dome, *night)
        self._timekeeper = ClockDevice(
            self._clock, self._report, self._spawn, self._camera.awaited_frame_due_utc_ns
        )
        parts = (self._mount, self._camera, self._weather, self._dome, self._timekeeper)
        self._handlers = {part.device.devicename: part.handle for part in parts}
        super().__init__(*(part.device for part in parts))
        self.auto_send_def = False

    async def rxevent(self, event: Any) -> None:
        """Pass a client's request to its device, or send the definitions that it asks for."""
        if isinstance(event, getProperties):
            if event.devicename == MOUNT_NAME and self._mount.faults.is_silent:
                return  # a driver that hangs does not describe itself either
            # Definitions, too, are stamped with simulated time, and are of that instant.
            self._mount.refresh()
            await event.vector.send_defVector(timestamp=indi_timestamp(self._clock.now_utc_ns))
        else:
            await self._handlers[event.devicename](event)

    def _present_utc_ns(self) -> int:
        return self._clock.now_utc_ns

    async def _report(self) -> None:
        await self._weather.pass_time()
        await self._dome.pass_time()
        await self._camera.pass_time()
        await self._mount.report()

    def _spawn(self, work: Coroutine[Any, Any, None]) -> None:
        task = asyncio.get_running_loop().create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)


class ObservatoryServer(IPyServer):  # type: ignore[misc]
    """IPyServer that closes a connection when the client hangs up.

    ``IPyServer`` itself goes on reading the closed connection for ever.
    """

    async def handle_data(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Serve one client with a connection object of its own.

        A reused object may still be sending to the previous client, and its failure would end the
        new connection too.
        """
        self.con_id += 1
        seat = type(self.connectionpool[0])(self.con_id, self.xml_data_que)
        self.connectionpool.append(seat)
        try:
            with contextlib.suppress(ConnectionError):
                await seat.handle_data(_HangUpReader(reader, writer), writer)
        finally:
            self.connectionpool.remove(seat)
            writer.close()
            with contextlib.suppress(ConnectionError):
                await writer.wait_closed()


class _HangUpReader:
    """A reader that says so when the client hung up, and lets no client wait for an answer."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._reader = reader
        self._socket = writer.get_extra_info("socket")

    async def read(self, size: int) -> bytes:
        # libindi sends one order in several pieces and waits for each to be acknowledged;
        # the kernel would delay that by 40 ms. The option wears off, so it is set every time.
        if _QUICK_ACK is not None:
            self._socket.setsockopt(socket.IPPROTO_TCP, _QUICK_ACK, 1)
        chunk = await self._reader.read(size)
        if not chunk:
            raise ConnectionResetError("the client hung up")
        return chunk


async def serve(settings: ObservatorySettings) -> None:
    """Serve INDI until stdin closes; the first line on stdout is ``{"port": N}``."""
    loop = asyncio.get_running_loop()
    driver = ObservatoryDriver(make_observatory_setup(settings), settings)
    server = ObservatoryServer(driver, host=HOST, port=0, maxconnections=1)
    running = loop.create_task(server.asyncrun())
    while server.server is None and not running.done():
        await asyncio.sleep(0.005)
    if server.server is not None:
        port = server.server.sockets[0].getsockname()[1]
        print(json.dumps({"port": port}), flush=True)
        threading.Thread(
            target=_watch_stdin, args=(loop, server), daemon=True, name="parent"
        ).start()
    await running


def _watch_stdin(loop: asyncio.AbstractEventLoop, server: ObservatoryServer) -> None:
    sys.stdin.buffer.read()
    loop.call_soon_threadsafe(server.shutdown)


def main() -> int:
    """Read the settings from stdin and serve.

    Exit status: 0, 1 after a failure, 2 without settings.
    """
    logging.basicConfig(stream=sys.stderr, level=logging.WARNING)
    line = sys.stdin.buffer.readline()
    if not line:
        return 2
    settings = ObservatorySettings(**json.loads(line))
    try:
        asyncio.run(serve(settings))
    except Exception as error:
        logging.exception("the simulated observatory ended")
        print(json.dumps({"error": str(error)}), flush=True)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
