"""INDI by pyindi-client: libindi's own client, in C++.

Runs only in a child process: PyIndi's callbacks come on a thread of its own, and an exception in a
callback aborts the process.
"""

import ctypes
import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import PyIndi

from rsoconsole.instruments.indi.indi_client import IndiClient, Vector
from rsoconsole.instruments.process_memory import discard_pages

_STATES = {
    PyIndi.IPS_IDLE: "Idle",
    PyIndi.IPS_OK: "Ok",
    PyIndi.IPS_BUSY: "Busy",
    PyIndi.IPS_ALERT: "Alert",
}


class PyIndiClient(PyIndi.BaseClient, IndiClient):  # type: ignore[misc]
    """Client by PyIndi: turns the library's callbacks into ``Vector`` values."""

    def __init__(
        self,
        device: str,
        on_vector: Callable[[Vector], None],
        on_message: Callable[[str], None] | None = None,
    ) -> None:
        """Create the client; arguments as for ``IndiClient``."""
        PyIndi.BaseClient.__init__(self)
        IndiClient.__init__(self, device, on_vector, on_message)

    # Callbacks of PyIndi, on its thread.

    def newDevice(self, device: Any) -> None:  # noqa: N802 - PyIndi's name and argument
        """Note that a device appeared."""

    def newProperty(self, prop: Any) -> None:  # noqa: N802 - PyIndi's name
        """Note that a property was defined."""
        self._run_safely(self._take, prop, True)

    def updateProperty(self, prop: Any) -> None:  # noqa: N802 - PyIndi's name
        """Note that a property changed."""
        self._run_safely(self._take, prop, False)

    def removeProperty(self, prop: Any) -> None:  # noqa: N802 - PyIndi's name
        """Note that a property was removed."""
        self._run_safely(lambda gone: self._forget(gone.getName()), prop)

    def newMessage(self, device: Any, number: int) -> None:  # noqa: N802 - PyIndi's name
        """Note a message of the driver."""
        self._run_safely(self._read_message, device, number)

    def serverDisconnected(self, code: int) -> None:  # noqa: N802, ARG002 - PyIndi's name
        """Note that the server died or hung up."""
        self._server_gone()

    # What is asked of every client.

    def _connect(self, host: str, port: int) -> bool:
        self.setServer(host, port)
        self.watchDevice(self.device)
        return bool(self.connectServer())

    def _connect_device(self) -> None:
        self.connectDevice(self.device)

    def enable_blobs(self, name: str) -> None:
        """Make the server send the contents of this BLOB vector, too."""
        self.setBLOBMode(PyIndi.B_ALSO, self.device, name)

    def _send_numbers(self, name: str, values: Mapping[str, float]) -> None:
        # A vector of our own: the client's copy may be overwritten by an update while it is sent.
        prop = PyIndi.PropertyNumber(len(values))
        for index, (member, value) in enumerate(values.items()):
            prop[index].setName(member)
            prop[index].setValue(float(value))
        self._send(name, prop)

    def _send_switch(self, name: str, member: str) -> None:
        prop = PyIndi.PropertySwitch(1)
        prop[0].setName(member)
        prop[0].setState(PyIndi.ISS_ON)
        self._send(name, prop)

    def _send(self, name: str, prop: Any) -> None:
        prop.setDeviceName(self.device)
        prop.setName(name)
        self.sendNewProperty(prop)

    def _take(self, prop: Any, is_definition: bool) -> None:
        # Before anything else: copying a frame's bytes takes its time.
        arrived_s = time.monotonic()
        if prop.getDeviceName() == self.device:
            self._store(self._vector(prop, arrived_s, is_definition))

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
        return Vector(
            name=prop.getName(),
            state=_STATES[prop.getState()],
            values=values,
            serial=self._next_serial(),
            is_definition=is_definition,
            arrived_monotonic_s=arrived_s,
            blobs=blobs,
        )

    def _read_message(self, device: Any, number: int) -> None:
        if device.getDeviceName() == self.device:
            self._note_message(str(device.messageQueue(number)))

    def _let_go(self, content: memoryview) -> None:
        """Return the pages of a BLOB that has been passed on to the system.

        libindi keeps the memory of each camera's last frame until the next one comes.
        """
        address = np.frombuffer(content, np.uint8).ctypes.data
        discard_pages(address, content.nbytes)


def _in_place(blob: Any) -> memoryview:
    """Bytes of a BLOB where libindi has decoded them; read only."""
    memory = (ctypes.c_ubyte * int(blob.getBlobLen())).from_address(int(blob.getBlob()))
    return memoryview(memory).cast("B").toreadonly()
