"""Asks a silent mount's driver where it is, on a connection of its own.

The client libraries cannot ask again for what is defined already.
"""

import contextlib
import threading
import time

from rsoconsole.errors import InstrumentError
from rsoconsole.instruments.indi import POLLING, IndiWire, ReportedMotion
from rsoconsole.instruments.mount.mount_mirror import COORDINATES

_LOOK_S = 0.1
_HELD_UP_S = 0.6
_AGAIN_S = 2.0


class MountEar:
    """Asks where nothing has been told for a while, on a thread of its own."""

    def __init__(self, host: str, port: int, device: str, motion: ReportedMotion) -> None:
        """``motion`` hears the answers; what the driver tells by itself comes another way."""
        self._host, self._port, self._device, self._motion = host, port, device, motion
        self._thread = threading.Thread(target=self._run, daemon=True, name="ear")

    def start(self) -> None:
        """Begin to listen."""
        self._thread.start()

    def _run(self) -> None:
        while True:
            with contextlib.suppress(InstrumentError):
                wire = IndiWire(self._host, self._port)
                try:
                    self._listen(wire)
                finally:
                    wire.close()
            time.sleep(_AGAIN_S)

    def _listen(self, wire: IndiWire) -> None:
        """Until the server hangs up: then InstrumentError."""
        self._motion.begin()
        wire.ask(self._device, POLLING)
        looked_s = time.monotonic()
        while True:
            vector = wire.wait(lambda each: each.device == self._device, _LOOK_S)
            now_s = time.monotonic()
            if now_s - looked_s > _HELD_UP_S:
                self._motion.held_up()
            looked_s = now_s
            if vector is not None and vector.is_definition:
                self._motion.take(vector)
            if self._motion.wants_word():
                wire.ask(self._device, COORDINATES)
