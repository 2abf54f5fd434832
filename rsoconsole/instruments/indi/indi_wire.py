"""INDI by plain TCP: for the second path of STOP, measured motion, simulated clock, weather, dome.

INDI is a stream of XML elements without a root. Nothing here needs a client library or another
process.
"""

import socket
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any
from xml.etree import ElementTree as ET
from xml.sax.saxutils import escape, quoteattr

from rsoconsole.base import InstrumentError, indi_port_option
from rsoconsole.instruments.indi._stream_mender import StreamMender

OF_DATE, OF_J2000 = "EQUATORIAL_EOD_COORD", "EQUATORIAL_COORD"
"""A mount's coordinates, of date or of the epoch J2000."""
_MEMBER = {"Number": "oneNumber", "Switch": "oneSwitch", "Text": "oneText"}
_READ_BYTES = 65536


@dataclass(frozen=True, slots=True, kw_only=True)
class IndiVector:
    """One property vector, as the server sent it."""

    device: str
    name: str
    kind: str
    """Type of the vector: Number, Switch, Text, Light or BLOB."""
    is_definition: bool
    state: str
    timestamp: str
    values: Mapping[str, str] = field(default_factory=dict)


class IndiWire:
    """One TCP connection to an INDI server; it receives no BLOBs. Not thread-safe."""

    def __init__(self, host: str, port: int, timeout_s: float = 5.0) -> None:
        """Connect. Raises InstrumentError when no server listens there."""
        try:
            self._socket = socket.create_connection((host, port), timeout_s)
        except OSError as error:
            raise InstrumentError(
                f"no INDI server answers at {host}:{port} ({error}): "
                f"start indiserver{indi_port_option(port)}"
            ) from error
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._address = f"{host}:{port}"
        # Typeshed gives the events one type for every kind of parser.
        self._parser: Any = ET.XMLPullParser(events=("start", "end"))
        self._parser.feed(b"<indi>")
        self._mender = StreamMender()
        self._root: ET.Element | None = None
        self._depth = 0
        self._waiting: list[IndiVector] = []
        self._asked: set[str] = set()
        """Mounts whose coordinates were asked for."""
        self._of_date: set[str] = set()
        """Mounts that have coordinates of date."""
        self._of_j2000: set[str] = set()
        """Mounts that have coordinates of J2000 alone."""
        self.last_message = ""
        self.deleted: list[tuple[str, str]] = []
        """Devices and properties that were removed, for a reader to empty; name "": all."""

    def close(self) -> None:
        """Close the connection."""
        self._socket.close()

    def ask(self, device: str, name: str | None = None) -> None:
        """Request the definition of a device's property ``name``; None: of all its properties.

        A mount that has coordinates of J2000 alone answers with those, named as those of date: only
        how they change is of use here.
        """
        if name == OF_DATE and device not in self._of_date:
            # In this order: a driver that has both answers with those of date first.
            self._asked.add(device)
            text = f'<getProperties version="1.7" device={quoteattr(device)}'
            self._send("".join(f'{text} name="{each}"/>' for each in (OF_DATE, OF_J2000)))
            return
        which = f" name={quoteattr(name)}" if name else ""
        self._send(f'<getProperties version="1.7" device={quoteattr(device)}{which}/>')

    def request_all_properties(self) -> None:
        """Request the definitions of all properties of all devices."""
        self._send('<getProperties version="1.7"/>')

    def new(self, kind: str, device: str, name: str, values: Mapping[str, str]) -> None:
        """Send new values of a property, by element name; ``kind``: Number, Switch or Text."""
        one = _MEMBER[kind]
        members = "".join(
            f"<{one} name={quoteattr(key)}>{escape(value)}</{one}>" for key, value in values.items()
        )
        vector = f"new{kind}Vector"
        self._send(
            f"<{vector} device={quoteattr(device)} name={quoteattr(name)}>{members}</{vector}>"
        )

    def wait(self, is_wanted: Callable[[IndiVector], bool], timeout_s: float) -> IndiVector | None:
        """Return the next vector that ``is_wanted`` accepts; None when none comes in time.

        All vectors before it are dropped. Raises InstrumentError when the server hangs up.
        """
        deadline_s = time.monotonic() + timeout_s
        while True:
            while self._waiting:
                vector = self._waiting.pop(0)
                if is_wanted(vector):
                    return vector
            left_s = deadline_s - time.monotonic()
            if left_s <= 0:
                return None
            self._receive(left_s)

    def _send(self, text: str) -> None:
        try:
            self._socket.settimeout(5.0)
            self._socket.sendall(text.encode())
        except OSError as error:
            raise self._hung_up(error) from error

    def _receive(self, timeout_s: float) -> None:
        self._socket.settimeout(max(timeout_s, 1e-3))
        try:
            chunk = self._socket.recv(_READ_BYTES)
        except TimeoutError:
            return
        except OSError as error:
            raise self._hung_up(error) from error
        if not chunk:
            raise self._hung_up("connection closed")
        try:
            self._parser.feed(self._mender.correct(chunk))
            events = list(self._parser.read_events())
        except ET.ParseError as error:
            raise self._hung_up(error) from error
        for event, element in events:
            if event == "start":
                self._root = element if self._root is None else self._root
                self._depth += 1
                continue
            self._depth -= 1
            if self._depth == 1:
                self._take(element)
                # The stream is one element that never ends: what is read must not stay in it.
                assert self._root is not None
                self._root.remove(element)

    def _take(self, element: ET.Element) -> None:
        self.last_message = element.get("message") or self.last_message
        if element.tag == "delProperty":
            self.deleted.append((element.get("device", ""), element.get("name", "")))
            return
        verb, kind = element.tag[:3], element.tag[3:].removesuffix("Vector")
        if verb not in ("def", "set") or not element.tag.endswith("Vector") or kind == "BLOB":
            return
        values = {member.get("name", ""): (member.text or "").strip() for member in element}
        device, name = element.get("device", ""), element.get("name", "")
        if name == OF_DATE:
            self._of_date.add(device)
        elif name == OF_J2000 and device not in self._of_date:
            # Those of date were asked for first: by now a driver that has them has said so.
            if verb == "def" and device in self._asked:
                self._of_j2000.add(device)
            name = OF_DATE if device in self._of_j2000 else name
        self._waiting.append(
            IndiVector(
                device=device,
                name=name,
                kind=kind,
                is_definition=verb == "def",
                state=element.get("state", ""),
                timestamp=element.get("timestamp", ""),
                values=values,
            )
        )

    def _hung_up(self, why: object) -> InstrumentError:
        return InstrumentError(
            f"the INDI server at {self._address} hung up ({why}): look at its log, start it again"
        )
