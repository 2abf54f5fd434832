"""What the mount's and the camera's processes have in common: a PyIndi client and a command loop.

Runs only in a child process. PyIndi's callbacks come on a thread of its own and an exception in
one would abort the process, so each is guarded and does no more than copy values out.
"""

import contextlib
import ctypes
import json
import os
import queue
import signal
import sys
import threading
import time
import traceback
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import PyIndi

from rsoconsole.errors import InstrumentError, RsoconsoleError
from rsoconsole.indi_port import indi_port_option
from rsoconsole.instruments import forget_contents
from rsoconsole.instruments.indi.indi_process import END, SERVER_LOST, WAITING

_STATES = {
    PyIndi.IPS_IDLE: "Idle",
    PyIndi.IPS_OK: "Ok",
    PyIndi.IPS_BUSY: "Busy",
    PyIndi.IPS_ALERT: "Alert",
}
_LOOK_S = 0.5
_UNREAD_LINES = 2000


@dataclass(frozen=True, slots=True, kw_only=True)
class Vector:
    """One property as last heard of; numbers as float, switches as bool, texts as str."""

    name: str
    state: str
    timestamp: str
    values: Mapping[str, Any]
    serial: int
    """Counts up with every update of any property."""
    is_definition: bool
    """The answer to what there is, however old the values are by then."""
    arrived_monotonic_s: float
    """When libindi handed it over; time.monotonic(), the same in all processes of a machine."""
    blobs: Mapping[str, memoryview] = field(default_factory=dict)
    """Contents of a BLOB vector, in libindi's own memory: there only while ``on_vector`` runs."""


class IndiClient(PyIndi.BaseClient):  # type: ignore[misc]
    """Mirrors one device's properties as plain values."""

    def __init__(
        self,
        device: str,
        on_vector: Callable[[Vector], None],
        on_message: Callable[[str], None] | None = None,
    ) -> None:
        """``on_vector`` and ``on_message`` are called on PyIndi's thread and must return soon.

        Nothing of a BLOB is kept beyond the call: ``on_vector`` takes what it wants of it.
        """
        super().__init__()
        self.device = device
        self._on_vector = on_vector
        self._on_message = on_message
        self._vectors: dict[str, Vector] = {}
        self._changed = threading.Condition()
        self._sending = threading.Lock()
        self._serial = 0
        self._told = 0
        self._ready = False
        self.last_message = ""
        self.has_connected_device = False
        """Whether this client switched the device's connection on: all it tells is new."""

    # Callbacks of PyIndi, on its thread.

    def newDevice(self, device: Any) -> None:  # noqa: N802 - PyIndi's name and argument
        """A device appeared."""

    def newProperty(self, prop: Any) -> None:  # noqa: N802 - PyIndi's name
        """A property was defined."""
        self._guard(self._store, prop, True)

    def updateProperty(self, prop: Any) -> None:  # noqa: N802 - PyIndi's name
        """A property changed."""
        self._guard(self._store, prop, False)

    def removeProperty(self, prop: Any) -> None:  # noqa: N802 - PyIndi's name
        """A property went away."""
        self._guard(lambda gone: self._vectors.pop(gone.getName(), None), prop)

    def newMessage(self, device: Any, number: int) -> None:  # noqa: N802 - PyIndi's name
        """The driver said something."""
        self._guard(self._hear, device, number)

    def serverDisconnected(self, code: int) -> None:  # noqa: N802, ARG002 - PyIndi's name
        """The server died or hung up: only a fresh process can connect again."""
        if self._ready:
            print("the INDI server went away", file=sys.stderr, flush=True)
            os._exit(SERVER_LOST)

    # For the child's own threads.

    def open(self, order: Mapping[str, Any], needed: tuple[str, ...], mouth: "Mouth") -> None:
        """Connect to the server and the device, and wait until ``needed`` are defined.

        ``order`` is the parent's: host, port, setting, and how long to wait.
        Raises InstrumentError.
        """
        host, port = order["host"], order["port"]
        self.setServer(host, port)
        self.watchDevice(self.device)
        mouth.say({"event": WAITING, "what": f"the INDI server at {host}:{port} to answer"})
        if not self.connectServer():
            raise InstrumentError(
                f"no INDI server answers at {host}:{port}: start indiserver{indi_port_option(port)}"
            )
        self._ready = True
        self._await_device(order, mouth)
        if not self._vectors["CONNECTION"].values.get("CONNECT"):
            self.has_connected_device = True
            self.connectDevice(self.device)
        device_s = float(order["device_s"])
        deadline_s = time.monotonic() + device_s
        for name in needed:
            mouth.say({"event": WAITING, "what": f"{self.device} to offer {name}"})
            left_s = max(0.1, deadline_s - time.monotonic())
            if self.wait(name, lambda _: True, left_s) is None:
                raise InstrumentError(
                    f"{self.device} is there but has not offered {name} in {device_s:.0f} s: "
                    f"is it connected and powered? {self.last_message}".rstrip()
                )

    def _await_device(self, order: Mapping[str, Any], mouth: "Mouth") -> None:
        """Wait until the server announces the device. Raises InstrumentError."""
        words = f"{order['setting'].partition('.')[2]} '{self.device}'"
        mouth.say({"event": WAITING, "what": words})
        if self.wait("CONNECTION", lambda _: True, _LOOK_S) is not None:
            return
        # Only now: a process that starts in no time needs none of it.
        from rsoconsole.instruments.indi.devices_there import DevicesThere

        told: tuple[str, ...] = ()
        with contextlib.closing(DevicesThere(self.device, order)) as there:
            while self.wait("CONNECTION", lambda _: True, _LOOK_S) is None:
                there.look()
                if there.others != told:
                    told = there.others
                    has = ", ".join(told)
                    what = f"{words}; the INDI server has announced {has} until now"
                    mouth.say({"event": WAITING, "what": what})

    def get(self, name: str) -> Vector | None:
        """A property as last heard of."""
        with self._changed:
            return self._vectors.get(name)

    def serial(self) -> int:
        """Number of the last update."""
        with self._changed:
            return self._serial

    def wait(
        self, name: str, is_wanted: Callable[[Vector], bool], timeout_s: float, after: int = -1
    ) -> Vector | None:
        """The first state of a property later than update ``after`` that is wanted, or None."""
        deadline_s = time.monotonic() + timeout_s
        with self._changed:
            while True:
                vector = self._vectors.get(name)
                is_told = vector is not None and after < vector.serial <= self._told
                if vector is not None and is_told and is_wanted(vector):
                    return vector
                left_s = deadline_s - time.monotonic()
                if left_s <= 0:
                    return None
                self._changed.wait(left_s)

    def send_numbers(self, name: str, values: Mapping[str, float]) -> int:
        """Ask for new numbers; returns the number of the last update before.

        A vector of our own: the client's copy may be overwritten by an update while it is sent.
        """
        prop = PyIndi.PropertyNumber(len(values))
        for index, (member, value) in enumerate(values.items()):
            prop[index].setName(member)
            prop[index].setValue(float(value))
        return self._send(name, prop)

    def send_switch(self, name: str, member: str) -> int:
        """Turn one switch on; returns the number of the last update before."""
        prop = PyIndi.PropertySwitch(1)
        prop[0].setName(member)
        prop[0].setState(PyIndi.ISS_ON)
        return self._send(name, prop)

    def _send(self, name: str, prop: Any) -> int:
        prop.setDeviceName(self.device)
        prop.setName(name)
        with self._sending:
            before = self.serial()
            self.sendNewProperty(prop)
        return before

    def _store(self, prop: Any, is_definition: bool) -> None:
        # Before anything else: copying a frame's bytes takes its time.
        arrived_s = time.monotonic()
        if prop.getDeviceName() != self.device:
            return
        vector = self._vector(prop, arrived_s, is_definition)
        with self._changed:
            self._vectors[vector.name] = replace(vector, blobs={})
        # The parent hears of a change before the order that brought it about is answered.
        try:
            self._on_vector(vector)
        finally:
            for content in vector.blobs.values():
                _let_go(content)
        with self._changed:
            self._told = vector.serial
            self._changed.notify_all()

    def _vector(self, prop: Any, arrived_s: float, is_definition: bool) -> Vector:
        kind = prop.getType()
        values: dict[str, Any] = {}
        blobs: dict[str, memoryview] = {}
        if kind == PyIndi.INDI_NUMBER:
            values = {each.getName(): each.getValue() for each in PyIndi.PropertyNumber(prop)}
        elif kind == PyIndi.INDI_SWITCH:
            values = {
                each.getName(): each.getState() == PyIndi.ISS_ON
                for each in PyIndi.PropertySwitch(prop)
            }
        elif kind == PyIndi.INDI_TEXT:
            values = {each.getName(): each.getText() for each in PyIndi.PropertyText(prop)}
        elif kind == PyIndi.INDI_BLOB:
            blobs = {
                each.getName(): _in_place(each)
                for each in PyIndi.PropertyBlob(prop)
                if each.getBlobLen() > 0
            }
        self._serial += 1
        return Vector(
            name=prop.getName(),
            state=_STATES[prop.getState()],
            timestamp=prop.getTimestamp() or "",
            values=values,
            serial=self._serial,
            is_definition=is_definition,
            arrived_monotonic_s=arrived_s,
            blobs=blobs,
        )

    def _hear(self, device: Any, number: int) -> None:
        if device.getDeviceName() == self.device:
            self.last_message = str(device.messageQueue(number)).strip()
            if self._on_message is not None:
                self._on_message(self.last_message)

    @staticmethod
    def _guard(work: Callable[..., Any], *arguments: Any) -> None:
        try:
            work(*arguments)
        except Exception:
            traceback.print_exc()


def _in_place(blob: Any) -> memoryview:
    """A BLOB's bytes where libindi has decoded them; read only."""
    memory = (ctypes.c_ubyte * int(blob.getBlobLen())).from_address(int(blob.getBlob()))
    return memoryview(memory).cast("B").toreadonly()


def _let_go(content: memoryview) -> None:
    """Give the system the pages of a BLOB that has been handed on.

    libindi keeps the memory of each camera's last frame until the next one comes.
    """
    address = np.frombuffer(content, np.uint8).ctypes.data
    forget_contents(address, content.nbytes)


class Mouth:
    """Writes JSON lines to the parent; keeps everybody else's prints off that pipe.

    A parent that hangs and reads nothing holds nobody up: the oldest lines are dropped.
    """

    def __init__(self) -> None:
        self._out = os.fdopen(os.dup(1), "wb")
        os.dup2(2, 1)
        self._unsaid: deque[bytes] = deque(maxlen=_UNREAD_LINES)
        self._has_more = threading.Semaphore(0)
        threading.Thread(target=self._write_all, daemon=True, name="mouth").start()

    def say(self, message: Mapping[str, Any]) -> None:
        """One line, at once; a parent that is gone ends this process by its closed stdin."""
        self._unsaid.append(json.dumps(message).encode() + b"\n")
        self._has_more.release()

    def _write_all(self) -> None:
        while True:
            self._has_more.acquire()
            if not self._unsaid:
                continue
            try:
                self._out.write(self._unsaid.popleft())
                self._out.flush()
            except OSError:
                return


Handler = Callable[[dict[str, Any]], dict[str, Any]]


def run_child(
    mouth: Mouth,
    slow: Mapping[str, Handler],
    urgent: Mapping[str, Handler],
    on_order: Callable[[], None] = lambda: None,
) -> bool:
    """Obey JSON lines from stdin; True when the parent took its leave, False when it just went.

    ``slow`` orders are carried out one after another, ``urgent`` ones at once beside them.
    ``on_order`` is called as each arrives. Signals meant for the parent are left to it: it may
    need this process to come to a safe end.
    """
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    waiting: queue.SimpleQueue[tuple[Handler, dict[str, Any]]] = queue.SimpleQueue()

    def obey(handler: Handler, order: dict[str, Any]) -> None:
        try:
            mouth.say({"id": order["id"], **handler(order)})
        except RsoconsoleError as error:
            mouth.say({"id": order["id"], "error": str(error)})
        except Exception as error:
            traceback.print_exc()
            mouth.say({"id": order["id"], "error": f"{type(error).__name__}: {error}"})

    def work() -> None:
        while True:
            obey(*waiting.get())

    threading.Thread(target=work, daemon=True, name="orders").start()
    for line in sys.stdin.buffer:
        try:
            order = json.loads(line)
        except ValueError:
            # A parent that is killed may leave half an order behind.
            continue
        on_order()
        if order["verb"] == END:
            return True
        if order["verb"] in urgent:
            handler = urgent[order["verb"]]
            threading.Thread(target=obey, args=(handler, order), daemon=True).start()
        elif order["verb"] in slow:
            waiting.put((slow[order["verb"]], order))
        else:
            mouth.say({"id": order["id"], "error": f"nobody here knows '{order['verb']}'"})
    return False
