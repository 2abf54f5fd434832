"""Two clocks: the machine's own, and the simulated observatory's."""

import threading
import time
from collections.abc import Callable

from rsoconsole.config import WaitsConfig
from rsoconsole.errors import InstrumentError
from rsoconsole.instruments.indi_wire import IndiVector, IndiWire
from rsoconsole.waits import LongWait

CLOCK_DEVICE = "Simulated Clock"
_NS = 1_000_000_000
_WAKE_EVERY_S = 0.05
_LOOK_S = 0.5
LEAST_STEP_S = 0.2


class SystemClock:
    """The machine's clock; a wait really waits."""

    is_simulated = False

    def __init__(self) -> None:
        self._wake = threading.Event()
        self._offset_ns = _offset_ns()

    def now_utc_ns(self) -> int:
        """The present instant."""
        return time.time_ns()

    def take_step_s(self) -> float:
        """By how much somebody has set the clock since this was last asked; 0 where nobody has.

        A clock that is only drawn in to the true time is not set: it moves by less than a
        thousandth of a second in a second.
        """
        before, self._offset_ns = self._offset_ns, _offset_ns()
        step_s = (self._offset_ns - before) / _NS
        return step_s if abs(step_s) > LEAST_STEP_S else 0.0

    def wait_until(self, t_utc_ns: int) -> bool:
        """Sleep until then; False when ``wake`` cut it short."""
        left_s = (t_utc_ns - time.time_ns()) / _NS
        was_woken = self._wake.wait(max(0.0, left_s))
        self._wake.clear()
        return not was_woken

    def wake(self) -> None:
        """End a wait that is in progress; without one, the next."""
        self._wake.set()

    def close(self) -> None:
        """Nothing to release."""


def _offset_ns() -> int:
    """Of the clock that may be set against the one that may not."""
    return time.time_ns() - time.monotonic_ns()


class SimulatedClock:
    """The simulated observatory's clock: time passes there only while somebody waits here.

    One thread waits, any thread may wake it, which a paced wait notices within 50 ms.
    """

    is_simulated = True

    def __init__(self, host: str, port: int, waits: WaitsConfig | None = None) -> None:
        """Connect. ``waits`` None: as by default.

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
        speed = float(first.values["SPEED"])
        self._wall_s_per_ns = 0.0 if speed == 0 else 1.0 / speed / _NS

    def now_utc_ns(self) -> int:
        """The instant the observatory stands at (while waiting: stood at)."""
        return self._now_utc_ns

    @staticmethod
    def take_step_s() -> float:
        """Nobody sets this one."""
        return 0.0

    def wait_until(self, t_utc_ns: int) -> bool:
        """Have the observatory live until then; False when ``wake`` cut it short."""
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
        """End a wait that is in progress; without one, the next."""
        self._wake.set()

    def close(self) -> None:
        """Hang up; the observatory's time stands still from now on."""
        self._wire.close()

    def _first_word(self, timeout_s: float) -> IndiVector | None:
        wait = LongWait("the simulated observatory's clock")
        while wait.waited_s < timeout_s:
            wait.look()
            left_s = min(_LOOK_S, timeout_s - wait.waited_s)
            first = self._wire.wait(lambda vector: vector.name == "SIM_CLOCK", left_s)
            if first is not None:
                return first
        return None

    def _answer(self, tag: str, timeout_s: float) -> IndiVector | None:
        deadline_s = time.monotonic() + timeout_s
        is_answer = _advance_answer(tag)
        while (left_s := deadline_s - time.monotonic()) > 0:
            answer = self._wire.wait(is_answer, min(left_s, _WAKE_EVERY_S))
            if answer is not None:
                return answer
            if self._wake.is_set():
                self._wire.new("Switch", CLOCK_DEVICE, "SIM_INTERRUPT", {"INTERRUPT": "On"})
        return None


def _advance_answer(tag: str) -> Callable[[IndiVector], bool]:
    def is_answer(vector: IndiVector) -> bool:
        if vector.name != "SIM_ADVANCE" or vector.is_definition:
            return False
        return vector.state == "Alert" or vector.values.get("TAG") == tag

    return is_answer
