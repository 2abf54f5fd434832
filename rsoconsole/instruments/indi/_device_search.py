"""Finds out why a device is not there yet: a slow INDI server, or a wrong name.

Uses a plain connection of its own, and only when the device does not come at once.
"""

import time
from collections.abc import Callable, Mapping
from typing import Any

from rsoconsole.base import InstrumentError
from rsoconsole.instruments.indi.indi_wire import IndiWire

_POLL_S = 0.2
_READ_S = 2.0


class DeviceSearch:
    """Waits for one device of an INDI server, and notes which other devices it announces."""

    def __init__(
        self, device: str, order: Mapping[str, Any], now_s: Callable[[], float] = time.monotonic
    ) -> None:
        """``order``: host, port, setting (that names the device), device_s, quiet_s.

        device_s: longest wait for the device. quiet_s: silence after which no further device will
        come. ``now_s``: monotonic clock.
        """
        self._device, self._order, self._now_s = device, order, now_s
        self._began_s = now_s()
        self._news_s = self._began_s
        self._names: set[str] = set()
        self._wire: IndiWire | None = None

    @property
    def others(self) -> tuple[str, ...]:
        """Names of the other devices announced so far."""
        return tuple(sorted(self._names - {self._device}))

    def check_announced(self) -> None:
        """Read what the server has announced; call repeatedly until the device is there.

        Raises InstrumentError when the device will not come: when the whole wait is over, or when
        the server has announced other devices and then nothing for ``quiet_s``. All unread data is
        read first, so that a machine that was held up is not taken for a quiet server.
        """
        self._listen()
        now_s = self._now_s()
        waited_s, quiet_s = now_s - self._began_s, now_s - self._news_s
        is_announced = self._device in self._names
        if self.others and not is_announced and quiet_s >= self._order["quiet_s"]:
            raise InstrumentError(self._unknown_words(waited_s))
        if waited_s < self._order["device_s"]:
            return
        if is_announced:
            raise InstrumentError(self._held_up_words(waited_s))
        raise InstrumentError(
            self._unknown_words(waited_s) if self.others else self._silent_words(waited_s)
        )

    def close(self) -> None:
        """Close the connection."""
        if self._wire is not None:
            self._wire.close()

    def _listen(self) -> None:
        if self._wire is None:
            self._wire = IndiWire(self._order["host"], self._order["port"])
            self._wire.request_all_properties()
        ends_s = self._now_s() + _READ_S
        while (vector := self._wire.wait(lambda _: True, _POLL_S)) is not None:
            if vector.is_definition:
                self._news_s = self._now_s()
                self._names.add(vector.device)
            if self._now_s() > ends_s:
                return

    def _unknown_words(self, waited_s: float) -> str:
        return (
            f"{self._server} announced no device '{self._device}' within {waited_s:.0f} s "
            f"(it has: {', '.join(self.others)}): set {self._order['setting']} to one of these, or "
            "start the driver of that device; where drivers start late, raise waits.quiet_s"
        )

    def _silent_words(self, waited_s: float) -> str:
        return (
            f"{self._server} announced no device at all within {waited_s:.0f} s, nor "
            f"'{self._device}': its drivers have not started; look at its log, wait and try again, "
            "on a slow machine raise waits.device_s"
        )

    def _held_up_words(self, waited_s: float) -> str:
        return (
            f"{self._server} has a device '{self._device}', but its properties have not come in "
            f"{waited_s:.0f} s: on a slow machine raise waits.device_s"
        )

    @property
    def _server(self) -> str:
        return f"the INDI server at {self._order['host']}:{self._order['port']}"
