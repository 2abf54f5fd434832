"""Clocks: the machine's own, and the simulated observatory's."""

import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from pathlib import Path

import platformdirs

from rsoconsole.base import InstrumentError, LongWait
from rsoconsole.config import APP, Config, WaitsConfig
from rsoconsole.instruments.clock_watch import ClockReadings, ClockWatch
from rsoconsole.instruments.indi.indi_wire import IndiVector, IndiWire
from rsoconsole.instruments.indi.safety_monitor import IndiSafetyMonitor
from rsoconsole.instruments.observatory.protocols import (
    ProtocolContext,
    create_camera,
    create_mount,
)
from rsoconsole.instruments.ports import Clock, ClockFault, Instruments

CLOCK_DEVICE = "Simulated Clock"
_NS = 1_000_000_000
_WAKE_EVERY_S = 0.05
_LOOK_S = 0.5
_LOOK_EVERY_S = 0.25
_READ_WITHIN_NS = 2_000_000
_READ_TRIES = 5


def read_clocks() -> ClockReadings:
    """Return the readings of the machine's clocks at one instant."""
    for _ in range(_READ_TRIES):
        before_ns = time.monotonic_ns()
        utc_ns, boottime_ns = time.time_ns(), _boottime_ns()
        now_ns = time.monotonic_ns()
        if now_ns - before_ns < _READ_WITHIN_NS:
            break  # else this thread was put off between them
    return ClockReadings(utc_ns=utc_ns, monotonic_ns=now_ns, boottime_ns=boottime_ns)


def _boottime_ns() -> int:
    """Return the time since boot.

    Where the system has no such clock, a machine that slept counts as a machine whose clock was
    set.
    """
    if not hasattr(time, "CLOCK_BOOTTIME"):
        return time.monotonic_ns()
    return time.clock_gettime_ns(time.CLOCK_BOOTTIME)


def utc_now_ns() -> int:
    """Return the machine's time, UTC ns, for code that needs no clock object."""
    return time.time_ns()


class SystemClock:
    """The machine's clock; ``wait_until`` sleeps.

    A thread compares it, a few times a second, with the clocks that cannot be set. So a step of UTC
    is found even where it is undone before the next call.
    """

    is_simulated = False
    speed = 1.0

    def __init__(self) -> None:
        self._wake = threading.Event()
        self._watch = ClockWatch(read_clocks())
        self._faults: list[ClockFault] = []
        self._looking = threading.Lock()
        self._is_over = threading.Event()
        threading.Thread(target=self._run, daemon=True, name="clock").start()

    def now_utc_ns(self) -> int:
        """Return the present instant, UTC ns."""
        return utc_now_ns()

    def take_faults(self) -> tuple[ClockFault, ...]:
        """Return the faults of the clock since the last call."""
        self._look()
        with self._looking:
            taken, self._faults = tuple(self._faults), []
        return taken

    @property
    def is_steady(self) -> bool:
        """False while this clock runs at another rate than the clocks that cannot be set."""
        return self._watch.is_steady

    def _run(self) -> None:
        while not self._is_over.wait(_LOOK_EVERY_S):
            if self._look():
                self._wake.set()

    def _look(self) -> bool:
        """Look once; return True where there is a fault."""
        with self._looking:
            found = self._watch.find_faults(read_clocks())
            self._faults += found
        return bool(found)

    def wait_until(self, t_utc_ns: int) -> bool:
        """Sleep until an instant; return True when it is reached.

        False when ``wake`` or a fault of the clock ended the wait early.
        """
        left_s = (t_utc_ns - time.time_ns()) / _NS
        was_woken = self._wake.wait(max(0.0, left_s))
        self._wake.clear()
        return not was_woken

    def wake(self) -> None:
        """End the wait in progress; where none is, the next wait ends at once."""
        self._wake.set()

    def close(self) -> None:
        """Stop comparing clocks."""
        self._is_over.set()


class SimulatedClock:
    """The simulated observatory's clock: time passes there only during ``wait_until``.

    One thread waits; ``wake`` may be called from any thread, and a paced wait notices it within 50
    ms.
    """

    is_simulated = True

    def __init__(self, host: str, port: int, waits: WaitsConfig | None = None) -> None:
        """Connect. ``waits`` None: the defaults.

        Raises InstrumentError when the server has no simulated clock.
        """
        waits = waits or WaitsConfig()
        self._silence_timeout_s = waits.device_s
        self._wire = IndiWire(host, port)
        self._wake = threading.Event()
        self._tag = 0
        self._wire.ask(CLOCK_DEVICE)
        first = self._first_word(waits.device_s)
        if first is None:
            self._wire.close()
            raise InstrumentError(
                f"the INDI server at {host}:{port} announced no simulated clock within "
                f"{waits.device_s:.0f} s: if it is a real one set indi.simulated = false"
            )
        self._now_utc_ns = int(first.values["UTC_NS"])
        self.speed = speed = float(first.values["SPEED"])
        self._wall_s_per_ns = 0.0 if speed == 0 else 1.0 / speed / _NS

    def now_utc_ns(self) -> int:
        """Return the observatory's instant; during a wait, the instant at its beginning."""
        return self._now_utc_ns

    is_steady = True

    @staticmethod
    def take_faults() -> tuple[ClockFault, ...]:
        """Return (): a simulated clock has no faults."""
        return ()

    def wait_until(self, t_utc_ns: int) -> bool:
        """Let the observatory's time pass until an instant; return True when it is reached.

        False when ``wake`` ended the wait early. Raises InstrumentError when the observatory does
        not answer or refuses.
        """
        if self._wake.is_set():
            self._wake.clear()
            return False
        if t_utc_ns <= self._now_utc_ns:
            return True
        self._tag += 1
        tag = str(self._tag)
        self._wire.new(
            "Text", CLOCK_DEVICE, "SIM_ADVANCE", {"TO_UTC_NS": str(t_utc_ns), "TAG": tag}
        )
        pacing_s = (t_utc_ns - self._now_utc_ns) * self._wall_s_per_ns
        answer = self._answer(tag, 2.0 * pacing_s + self._silence_timeout_s)
        if answer is None:
            raise InstrumentError(
                f"the simulated observatory let no time pass in {self._silence_timeout_s:.0f} s: "
                "start the demo again"
            )
        if answer.state == "Alert":
            raise InstrumentError(f"the simulated clock refused: {self._wire.last_message}")
        self._now_utc_ns = int(answer.values["TO_UTC_NS"])
        self._wake.clear()
        return self._now_utc_ns >= t_utc_ns

    def wake(self) -> None:
        """End the wait in progress; where none is, the next wait ends at once."""
        self._wake.set()

    def close(self) -> None:
        """Close the connection; the observatory's time stands still from then on."""
        self._wire.close()

    def _first_word(self, timeout_s: float) -> IndiVector | None:
        wait = LongWait("the simulated observatory's clock")
        while wait.waited_s < timeout_s:
            wait.log_if_due()
            left_s = min(_LOOK_S, timeout_s - wait.waited_s)
            first = self._wire.wait(lambda vector: vector.name == "SIM_CLOCK", left_s)
            if first is not None:
                return first
        return None

    def _answer(self, tag: str, timeout_s: float) -> IndiVector | None:
        deadline_s = time.monotonic() + timeout_s

        def is_answer(vector: IndiVector) -> bool:
            if vector.name != "SIM_ADVANCE" or vector.is_definition:
                return False
            return vector.state == "Alert" or vector.values.get("TAG") == tag

        while (left_s := deadline_s - time.monotonic()) > 0:
            answer = self._wire.wait(is_answer, min(left_s, _WAKE_EVERY_S))
            if answer is not None:
                return answer
            if self._wake.is_set():
                self._wire.new("Switch", CLOCK_DEVICE, "SIM_INTERRUPT", {"INTERRUPT": "On"})
        return None


@contextmanager
def connect_instruments(
    config: Config, *, clock: Clock | None = None, log_dir: Path | None = None
) -> Iterator[Instruments]:
    """Return a context with a clock and the configured mount and camera, connected.

    Mount and camera each have a process of their own. Where a weather station or a dome is
    configured, a safety monitor is included.

    ``clock`` None: the simulated observatory's where ``indi.simulated`` is set, else the machine's.
    ``log_dir``: folder for what libindi prints; None: the user's log folder. Raises InstrumentError
    when server, mount or camera cannot be reached, or use a protocol that is not installed.
    """
    folder = log_dir or platformdirs.user_log_path(APP)
    with ExitStack() as release:
        context = ProtocolContext(config=config, log_dir=folder)
        mount = create_mount(context)
        release.callback(mount.close)
        camera = create_camera(context)
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
        safety_monitor = None
        if config.indi.weather or config.indi.dome:
            safety_monitor = IndiSafetyMonitor(config.indi, first_word_s=config.waits.quiet_s)
            release.callback(safety_monitor.close)
            safety_monitor.start()
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
    """Name of a device in messages: its INDI name, else the protocol's."""
    return indi_name if protocol == "indi" else protocol
