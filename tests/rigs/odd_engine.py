"""An engine whose mount is an odd one behind INDI, in real time: what its operator is told, and
what reaches the mount. Its camera lives in the test."""

import contextlib
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rsoconsole.config import Config
from rsoconsole.control import LastStop, Outcome, Status
from rsoconsole.engine import Engine
from rsoconsole.engine.aim.instrument_controller import InstrumentController
from rsoconsole.engine.service._command_handler import CommandHandler
from rsoconsole.engine.tasks.command_queue import CommandQueue
from rsoconsole.instruments import Instruments
from rsoconsole.instruments.mount.mount import IndiMount
from rsoconsole.instruments.observatory.clock import SystemClock
from rsoconsole.pipeline import Reduction
from rsoconsole.records import Detections, Event, Frame, NotSolved
from rsoconsole.sky import altaz_to_icrs, icrs_to_jnow
from tests.rigs.engine_rig import Memory, PlainCamera, ScriptedReducer, told
from tests.rigs.odd_mount import ABORT, DEVICE, Oddities
from tests.rigs.odd_mount_server import OddMountServer

SITE = {"latitude_deg": 29.19, "longitude_deg": -81.05, "elevation_m": 10.0}
PATIENCE_S = 20.0


@dataclass
class OddEngine:
    """The engine and its mount."""

    server: OddMountServer
    engine: Engine
    mount: IndiMount
    handler: CommandHandler
    memory: Memory
    config: Config
    orders: list[tuple[str, Outcome]] = field(default_factory=list)

    def ask(self, verb: str, **arguments: Any) -> Outcome:
        """Give an order as a seat does; its answer."""
        outcome = told(self.handler, verb, arguments)
        self.orders.append((verb, outcome))
        return outcome

    def goto(self, alt_deg: float, az_deg: float) -> Outcome:
        """By hand, to a place over the horizon."""
        ra_deg, dec_deg = altaz_to_icrs(self.config.site.to_site(), alt_deg, az_deg, time.time_ns())
        return self.ask("goto", ra_icrs_deg=ra_deg, dec_icrs_deg=dec_deg)

    def foreign(self, alt_deg: float, az_deg: float) -> None:
        """Another client's go-to."""
        now_ns = time.time_ns()
        icrs = altaz_to_icrs(self.config.site.to_site(), alt_deg, az_deg, now_ns)
        self.server.foreign(*icrs_to_jnow(*icrs, now_ns))

    def until(self, is_true: Callable[[], Any], what: str, timeout_s: float = PATIENCE_S) -> Any:
        """Wait for it. Raises AssertionError with what was told so far."""
        ends_s = time.monotonic() + timeout_s
        while time.monotonic() < ends_s:
            if found := is_true():
                return found
            time.sleep(0.05)
        raise AssertionError(f"no {what} in {timeout_s:g} s; said {self.said}; {self.status()}")

    def status(self) -> Status:
        """What every seat is shown."""
        return self.handler.status()

    def stop(self, timeout_s: float = PATIENCE_S) -> LastStop:
        """STOP, and what it is known to have come to."""
        self.ask("stop")

        def measured() -> LastStop | None:
            last = self.status().last_stop
            return last if last is not None and last.motion is not None else None

        found = self.until(measured, "verdict", timeout_s)
        assert isinstance(found, LastStop)
        return found

    @property
    def said(self) -> list[str]:
        """Lines of the log."""
        return [each.text for each in self.memory.of(Event)]

    def mount_messages(self) -> list[str]:
        """What the mount's own process has said by itself."""
        return list(self.mount._messages)

    @property
    def alarms(self) -> list[str]:
        """Those that must not be missed."""
        return [each.text for each in self.memory.of(Event) if each.level == "alarm"]

    def received(self, name: str) -> list[tuple[float, Mapping[str, Any]]]:
        """What has reached the mount of one property: when, and its members."""
        with self.server.locked() as model:
            return [(at_s, values) for at_s, each, values in model.received if each == name]

    @property
    def aborts(self) -> int:
        """How often ABORT has reached the mount."""
        return len(self.received(ABORT))

    def moves(self) -> bool:
        """Whether the mount itself moves, whatever its driver says."""
        with self.server.locked() as model:
            return bool(model.is_moving_by_itself)

    def altitude_deg(self) -> float:
        """Where it truly looks."""
        with self.server.locked() as model:
            return float(model.altitude_deg)

    def wait_for_rest(self) -> None:
        """Until it is measured to be at rest, and the engine shows it."""
        self.until(
            lambda: self.status().mount_motion in ("stands", "tracks"), "rest that is measured"
        )


class Overcast(ScriptedReducer):
    """No star in any frame."""

    def reduce(self, frame: Frame) -> Reduction:
        return Reduction(
            detections=Detections(
                frame_id=frame.frame_id, width_px=64, height_px=64, detections=()
            ),
            solution=NotSolved(frame_id=frame.frame_id, reason="0 stars, 8 needed", ms=1.0),
            measurements=(),
            star_count=0,
            fwhm_px=2.5,
            absence="no detection",
        )


@contextlib.contextmanager
def odd_engine(oddities: Oddities, folder: Path, **settings: Any) -> Iterator[OddEngine]:
    """An idle engine, connected; it looks at its mount once a second."""
    with contextlib.ExitStack() as stack:
        server = stack.enter_context(OddMountServer(oddities))
        indi = {"port": server.port, "mount": DEVICE}
        # It is in real time: where the Sun stands may not decide which orders are obeyed.
        limits = {"sun_cone_deg": 0.0, "twilight_deg": 90.0, **settings.pop("limits", {})}
        config = Config.model_validate({"site": SITE, "indi": indi, "limits": limits, **settings})
        mount = IndiMount(config.indi, folder / "mount.log", config.mount, config.waits)
        stack.callback(mount.close)
        mount.start()
        clock = SystemClock()
        stack.callback(clock.close)
        instruments = Instruments(
            clock=clock,
            mount=mount,
            camera=PlainCamera(clock),  # type: ignore[arg-type]
            host="127.0.0.1",
            port=server.port,
            mount_name=DEVICE,
            camera_name="",
        )
        queue, memory = CommandQueue(), Memory()
        engine = Engine(
            config=config,
            instrument_controller=InstrumentController(
                instruments, config, lambda: queue.is_interrupt_wanted
            ),
            reducer=Overcast(set(), mount),  # type: ignore[arg-type]
            record=memory,
            queue=queue,
        )
        handler = CommandHandler(engine, queue, folder)
        loop = threading.Thread(target=engine.run, daemon=True, name="loop")
        loop.start()

        def end() -> None:
            queue.request_shutdown()
            engine.wake()
            loop.join(PATIENCE_S)

        stack.callback(end)
        yield OddEngine(server, engine, mount, handler, memory, config)
