"""Client of one INDI device, with the same interface for each of the client libraries.

Runs only in a child process. The library delivers updates on a thread of its own; the callbacks
here catch errors and only copy values.
"""

import contextlib
import os
import re
import sys
import threading
import time
import traceback
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from rsoconsole.base import InstrumentError, indi_port_option
from rsoconsole.instruments.indi.indi_child import ReplyWriter
from rsoconsole.instruments.indi.indi_process import DEVICE_LOST, SERVER_LOST, WAITING
from rsoconsole.instruments.indi.indi_wire import OF_DATE, OF_J2000

_LOOK_S = 0.5
_SAID = 100
_LATE_WORD_S = 0.2
_STAMP = re.compile(r"^\d{4}-\d\d-\d\dT[\d:.]+Z?: ")
_OF_EVERY_DRIVER = frozenset(
    (
        *("CONNECTION", "DRIVER_INFO", "DEBUG", "CONFIG_PROCESS", "POLLING_PERIOD", "SIMULATION"),
        *("CONNECTION_MODE", "DEVICE_PORT", "DEVICE_BAUD_RATE", "DEVICE_AUTO_SEARCH"),
        *("DEVICE_PORT_SCAN", "SYSTEM_PORTS", "DEVICE_ADDRESS", "ACTIVE_DEVICES"),
    )
)
_MAX_NAMED = 12
_GRAVEST = ("[ERROR]", "[WARNING]")


@dataclass(frozen=True, slots=True, kw_only=True)
class Vector:
    """Latest state and values of one property; numbers as float, switches as bool, texts as str."""

    name: str
    state: str
    values: Mapping[str, Any]
    serial: int
    """Number of the update, counted over all properties of the device."""
    is_definition: bool
    """True for the definition of the property: its values may be old already."""
    arrived_monotonic_s: float
    """Instant of the library's delivery, by ``time.monotonic()``: one clock for all processes."""
    blobs: Mapping[str, memoryview] = field(default_factory=dict)
    """Contents of a BLOB vector, in the library's memory: valid only while ``on_vector`` runs."""


class IndiClient(ABC):
    """Holds the latest values of all properties of one device, and sends it orders."""

    def __init__(
        self,
        device: str,
        on_vector: Callable[[Vector], None],
        on_message: Callable[[str], None] | None = None,
    ) -> None:
        """``on_vector`` and ``on_message`` are called on the library's thread, must return soon.

        Nothing of a BLOB is kept beyond the call: ``on_vector`` copies what it needs.
        """
        self.device = device
        self._on_vector = on_vector
        self._on_message = on_message
        self._vectors: dict[str, Vector] = {}
        self._changed = threading.Condition()
        self._sending = threading.Lock()
        self._serial = 0
        self._reported = 0
        self._ready = False
        self._is_open = False
        self._said: deque[tuple[int, str]] = deque(maxlen=_SAID)
        self._time_ns = time.time_ns
        self._has_date = self._has_j2000 = False
        """Whether a mount's coordinates are of date, or of the epoch J2000 alone."""
        self.has_connected_device = False
        """True where this client switched the device's connection on: all its values are new."""

    # What a library does.

    @abstractmethod
    def _connect(self, host: str, port: int) -> bool:
        """Connect to the server and request the device; False when the server does not answer."""

    @abstractmethod
    def _connect_device(self) -> None:
        """Switch the device's connection on."""

    @abstractmethod
    def _send_numbers(self, name: str, values: Mapping[str, float]) -> None:
        """Request new numbers."""

    @abstractmethod
    def _send_switch(self, name: str, member: str) -> None:
        """Request that one switch be on."""

    @abstractmethod
    def enable_blobs(self, name: str) -> None:
        """Make the server also send the contents of the BLOB vector ``name``."""

    @abstractmethod
    def _let_go(self, content: memoryview) -> None:
        """Release the memory of a BLOB that has been passed on."""

    # For the library's thread.

    def _store(self, vector: Vector) -> None:
        """Store a property that was defined or changed."""
        if vector.name in {OF_DATE, OF_J2000}:
            named = self._named_of_date(vector)
            if named is None:
                return
            vector = named
        with self._changed:
            self._vectors[vector.name] = replace(vector, blobs={})
        # The parent hears of a change before the order that brought it about is answered.
        try:
            self._on_vector(vector)
        finally:
            for content in vector.blobs.values():
                self._let_go(content)
        if vector.name == "CONNECTION" and not vector.values.get("CONNECT"):
            self._device_gone()
        with self._changed:
            self._reported = vector.serial
            self._changed.notify_all()

    def _named_of_date(self, vector: Vector) -> Vector | None:
        """Return a mount's coordinates as those of date; None: it has those itself as well."""
        if vector.name == OF_DATE:
            self._has_date, self._has_j2000 = True, False
            return vector
        if self._has_date:
            return None
        from rsoconsole.instruments.indi.j2000 import to_date

        self._has_j2000 = True
        return replace(vector, name=OF_DATE, values=to_date(vector.values, self._time_ns()))

    def _forget(self, name: str) -> None:
        """Remove a property."""
        self._vectors.pop(OF_DATE if name == OF_J2000 and self._has_j2000 else name, None)

    def _note_message(self, text: str) -> None:
        """Store a message of the driver."""
        words = text.strip()
        with self._changed:
            self._said.append((self._next_serial(), words))
            self._changed.notify_all()
        if self._on_message is not None:
            self._on_message(words)

    def _next_serial(self) -> int:
        self._serial += 1
        return self._serial

    def _server_gone(self) -> None:
        """Note that the server died or hung up: only a fresh process can connect again."""
        if self._ready:
            print("the INDI server went away", file=sys.stderr, flush=True)
            os._exit(SERVER_LOST)

    def _device_gone(self) -> None:
        """Note that nothing is connected behind the driver: a fresh process connects it again."""
        if self._is_open:
            words = f"{self.device} is not connected any more: its driver was started again, or"
            print(f"{words} another program disconnected it", file=sys.stderr, flush=True)
            os._exit(DEVICE_LOST)

    @staticmethod
    def _run_safely(work: Callable[..., Any], *arguments: Any) -> None:
        try:
            work(*arguments)
        except Exception:
            traceback.print_exc()

    # For the child's own threads.

    def open(self, order: Mapping[str, Any], needed: tuple[str, ...], writer: ReplyWriter) -> None:
        """Connect to the server and the device; wait until the properties ``needed`` are defined.

        ``order``: the parent's order with host, port, name of the setting, and times to wait.
        ``writer`` tells the parent what is waited for. Raises InstrumentError.
        """
        host, port = order["host"], order["port"]
        writer.send({"event": WAITING, "what": f"the INDI server at {host}:{port} to answer"})
        if not self._connect(host, port):
            raise InstrumentError(
                f"no INDI server answers at {host}:{port}: start indiserver{indi_port_option(port)}"
            )
        self._ready = True
        self._await_device(order, writer)
        if not self._vectors["CONNECTION"].values.get("CONNECT"):
            self.has_connected_device = True
            self._connect_device()
        device_s = float(order["device_s"])
        deadline_s = time.monotonic() + device_s
        for name in needed:
            writer.send({"event": WAITING, "what": f"{self.device} to offer {name}"})
            left_s = max(0.1, deadline_s - time.monotonic())
            if self.wait(name, lambda _: True, left_s) is None:
                said = self.driver_message_since(0)
                raise InstrumentError(
                    f"{self.device} is there but has not offered {name} in {device_s:.0f} s"
                    f"{f' ({said})' if said else ''}: {self._offered_words(order)}"
                )
        self._is_open = True
        connection = self.get("CONNECTION")  # it may have gone off just before
        if connection is not None and connection.values.get("CONNECT") is False:
            self._device_gone()

    def _offered_words(self, order: Mapping[str, Any]) -> str:
        """Return what to do about a device that lacks a property, by what it offers instead."""
        with self._changed:
            offered = sorted(set(self._vectors) - _OF_EVERY_DRIVER)
            is_connected = bool(self._vectors["CONNECTION"].values.get("CONNECT"))
        if not offered or not is_connected:
            return "is it connected and powered? A slow device needs a larger waits.device_s"
        more = f" and {len(offered) - _MAX_NAMED} more" if len(offered) > _MAX_NAMED else ""
        kind = str(order["setting"]).partition(".")[2]
        return (
            f"it offers {', '.join(offered[:_MAX_NAMED])}{more}. Is it the {kind} that"
            f" {order['setting']} should name? A slow device needs a larger waits.device_s"
        )

    def _await_device(self, order: Mapping[str, Any], writer: ReplyWriter) -> None:
        """Wait until the server announces the device. Raises InstrumentError."""
        words = f"{order['setting'].partition('.')[2]} '{self.device}'"
        writer.send({"event": WAITING, "what": words})
        if self.wait("CONNECTION", lambda _: True, _LOOK_S) is not None:
            return
        # Only now: a process that starts in no time needs none of it.
        from rsoconsole.instruments.indi._device_search import DeviceSearch

        reported: tuple[str, ...] = ()
        with contextlib.closing(DeviceSearch(self.device, order)) as there:
            while self.wait("CONNECTION", lambda _: True, _LOOK_S) is None:
                there.check_announced()
                if there.others != reported:
                    reported = there.others
                    has = ", ".join(reported)
                    what = f"{words}; the INDI server has announced {has} until now"
                    writer.send({"event": WAITING, "what": what})

    def get(self, name: str) -> Vector | None:
        """Return the latest state of a property; None where it is not defined."""
        with self._changed:
            return self._vectors.get(name)

    def last_update_number(self) -> int:
        """Return the number of the latest update: properties and messages are counted together."""
        with self._changed:
            return self._serial

    def wait(
        self, name: str, is_wanted: Callable[[Vector], bool], timeout_s: float, after: int = -1
    ) -> Vector | None:
        """Wait for an update of the property ``name`` that ``is_wanted`` accepts, and return it.

        ``after``: only updates with a higher number count. Returns None where none comes in
        time.
        """
        deadline_s = time.monotonic() + timeout_s
        with self._changed:
            while True:
                vector = self._vectors.get(name)
                is_reported = vector is not None and after < vector.serial <= self._reported
                if vector is not None and is_reported and is_wanted(vector):
                    return vector
                left_s = deadline_s - time.monotonic()
                if left_s <= 0:
                    return None
                self._changed.wait(left_s)

    def driver_message_since(self, after: int, wait_s: float = 0.0) -> str:
        """Return the driver's most important message after update ``after``; empty for none.

        Errors come before warnings, and warnings before other messages; of several equals the last
        is returned. Waits up to ``wait_s`` for a message.
        """
        deadline_s = time.monotonic() + wait_s
        with self._changed:
            while not (said := [words for serial, words in self._said if serial > after]):
                left_s = deadline_s - time.monotonic()
                if left_s <= 0:
                    return ""
                self._changed.wait(left_s)
        for mark in _GRAVEST:
            grave = [words for words in said if mark in words]
            if grave:
                return without_timestamp(grave[-1])
        return without_timestamp(said[-1])

    def failure_reason_since(self, after: int) -> str:
        """Return the driver's reason for not following an order, from its messages.

        ``after``: last update before the order. Returns "no reason given" without a message.
        """
        return self.driver_message_since(after, _LATE_WORD_S) or "no reason given"

    def send_numbers(self, name: str, values: Mapping[str, float]) -> int:
        """Order new numbers; return the number of the last update before the order."""
        if name == OF_DATE and self._has_j2000:
            from rsoconsole.instruments.indi.j2000 import from_date

            name, values = OF_J2000, from_date(values, self._time_ns())
        with self._sending:
            before = self.last_update_number()
            self._send_numbers(name, values)
        return before

    def send_switch(self, name: str, member: str) -> int:
        """Order one switch on; return the number of the last update before the order."""
        with self._sending:
            before = self.last_update_number()
            self._send_switch(name, member)
        return before


def without_timestamp(words: str) -> str:
    """Return a driver's message without the time stamp that the client library puts before it."""
    return _STAMP.sub("", words)
