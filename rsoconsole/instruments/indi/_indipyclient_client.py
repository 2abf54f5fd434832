"""INDI by indipyclient: pure Python, on an asyncio loop on a thread of its own.

The library's automatic actions are suppressed: here it connects once, requests one device once,
enables BLOBs on order only, and has no time-outs. When the server hangs up, which the library alone
does not notice, the loop ends this process, as PyIndi's client would.
"""

import asyncio
import concurrent.futures
import threading
import time
from collections.abc import Callable, Mapping
from typing import Any
from xml.etree import ElementTree as ET

import indipyclient

from rsoconsole.base import InstrumentError
from rsoconsole.instruments.indi._stream_mender import StreamMender
from rsoconsole.instruments.indi.indi_client import IndiClient, Vector


class IndiStream(asyncio.Protocol):
    """Passes the bytes of a connection, corrected for a strict XML parser, to another protocol."""

    def __init__(self, reader: asyncio.Protocol, on_end: Callable[[], None]) -> None:
        """``on_end`` is called when the server hangs up."""
        self._reader, self._on_end = reader, on_end
        self.mender = StreamMender()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Tell the other protocol that the connection is made."""
        self._reader.connection_made(transport)

    def data_received(self, data: bytes) -> None:
        """Correct the received bytes and pass them on."""
        if cleaned := self.mender.correct(bytes(data)):
            self._reader.data_received(cleaned)

    def eof_received(self) -> bool | None:
        """Tell the other protocol that the server sends no more."""
        self._on_end()
        return self._reader.eof_received()

    def connection_lost(self, exc: Exception | None) -> None:
        """Tell the other protocol that the connection is lost."""
        self._on_end()
        self._reader.connection_lost(exc)

    def pause_writing(self) -> None:
        """Tell the other protocol that the server reads too slowly."""
        self._reader.pause_writing()

    def resume_writing(self) -> None:
        """Tell the other protocol that the server reads again."""
        self._reader.resume_writing()


_CONNECT_S = 5.0
_SEND_S = 2.0
_DEFINITIONS = {"Define", "DefineBLOB"}
_CHANGES = {"Set", "SetBLOB"}


class IndipyClient(IndiClient):
    """Client by indipyclient: turns the library's events into ``Vector`` values."""

    def __init__(
        self,
        device: str,
        on_vector: Callable[[Vector], None],
        on_message: Callable[[str], None] | None = None,
    ) -> None:
        """Create the client; arguments as for ``IndiClient``."""
        super().__init__(device, on_vector, on_message)
        self._loop: _Loop | None = None
        self._library: _Library | None = None
        self._defined: set[str] = set()

    def _connect(self, host: str, port: int) -> bool:
        self._loop = _Loop(self._server_gone)
        self._library = _Library(host, port, self.device, self._take)
        threading.Thread(target=self._run, daemon=True, name="indipyclient").start()
        if not self._library.is_connected.wait(_CONNECT_S) or self._loop.has_failed:
            self._library.shutdown()
            return False
        return True

    def _run(self) -> None:
        loop, library = self._loop, self._library
        assert loop is not None
        assert library is not None
        loop.on_failure = library.is_connected.set
        asyncio.set_event_loop(loop)
        try:
            loop.run_until_complete(library.asyncrun())
        finally:
            # Nobody reads any more, whatever the reason.
            self._server_gone()

    def _connect_device(self) -> None:
        self._send_switch("CONNECTION", "CONNECT")

    def enable_blobs(self, name: str) -> None:
        """Make the server send the contents of this BLOB vector, too."""
        enable = ET.Element("enableBLOB", device=self.device, name=name)
        enable.text = "Also"
        self._send(enable)

    def _let_go(self, content: memoryview) -> None:
        """Do nothing: nobody else holds the memory."""

    def _send_numbers(self, name: str, values: Mapping[str, float]) -> None:
        self._send_new("Number", name, {each: repr(float(value)) for each, value in values.items()})

    def _send_switch(self, name: str, member: str) -> None:
        self._send_new("Switch", name, {member: "On"})

    def _send_new(self, kind: str, name: str, values: Mapping[str, str]) -> None:
        # Not by the library's vectors: they would send all members, wanted or not.
        vector = ET.Element(f"new{kind}Vector", device=self.device, name=name)
        for member, value in values.items():
            ET.SubElement(vector, f"one{kind}", name=member).text = value
        self._send(vector)

    def _send(self, element: ET.Element) -> None:
        """Pass an element to the system, in order. Raises InstrumentError when it accepts no
        more.
        """
        assert self._loop is not None
        assert self._library is not None
        sent = asyncio.run_coroutine_threadsafe(self._library.send(element), self._loop)
        try:
            sent.result(_SEND_S)
        except concurrent.futures.TimeoutError as error:
            raise InstrumentError(
                f"the INDI server has read nothing for {_SEND_S:.0f} s: look at its log"
            ) from error

    def _take(self, event: Any) -> None:
        self._run_safely(self._take_event, event)

    def _take_event(self, event: Any) -> None:
        arrived_s = time.monotonic()
        if event.devicename != self.device:
            return
        # libindi tells the words that come with a change before the change.
        if (words := getattr(event, "message", "")) and self._defined:
            stamp = event.root.get("timestamp") or time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime())
            self._note_message(f"{stamp}: {words}")
        if event.eventtype == "Delete":
            self._take_deletion(event)
        elif event.eventtype in _CHANGES or self._is_new_definition(event):
            self._store(self._vector(event, arrived_s))

    def _blob(self, ticket: bytes) -> memoryview:
        """Content in the place of a ticket; read only."""
        assert self._loop is not None
        assert self._loop.stream is not None
        return memoryview(self._loop.stream.mender.pop_blob(ticket)).toreadonly()

    def _take_deletion(self, event: Any) -> None:
        """Remove one property, or all: the driver ended, and may come back."""
        if event.vectorname:
            self._defined.discard(event.vectorname)
            self._forget(event.vectorname)
        else:
            self._defined.clear()

    def _is_new_definition(self, event: Any) -> bool:
        """True for the definition of a property that is not yet defined.

        As in libindi, a property that is defined already stays as it is.
        """
        is_new = event.eventtype in _DEFINITIONS and event.vectorname not in self._defined
        if is_new:
            self._defined.add(event.vectorname)
        return is_new

    def _vector(self, event: Any, arrived_s: float) -> Vector:
        vector, is_definition = event.vector, event.eventtype in _DEFINITIONS
        blobs: dict[str, memoryview] = {}
        values: dict[str, Any] = {}
        match vector.vectortype:
            case "NumberVector":
                values = {k: each.getfloatvalue() for k, each in vector.members().items()}
            case "SwitchVector":
                values = {k: each.membervalue == "On" for k, each in vector.members().items()}
            case "TextVector":
                values = {k: each.membervalue for k, each in vector.members().items()}
            case "BLOBVector" if event.eventtype == "SetBLOB":
                blobs = {
                    k: content for k, ticket in event.items() if (content := self._blob(ticket))
                }
        return Vector(
            name=vector.name,
            state=vector.state,
            values=values,
            serial=self._next_serial(),
            is_definition=is_definition,
            arrived_monotonic_s=arrived_s,
            blobs=blobs,
        )


class _Library(indipyclient.IPyClient):  # type: ignore[misc]
    """The library's client without its automatic actions."""

    def __init__(self, host: str, port: int, device: str, take: Callable[[Any], None]) -> None:
        super().__init__(indihost=host, indiport=port)
        self._own_device, self._hand_on = device, take
        self.is_connected = threading.Event()
        """Set when connected, or when it never will be: ``has_failed`` of the loop says which."""
        self.enable_reports = False
        self.resend_enableBLOB_on_def = False
        self.set_vector_timeouts(timeout_enable=False)

    async def rxevent(self, event: Any) -> None:
        """Handle an event of the library."""
        if event.eventtype == "ConnectionMade":
            await super().send_getProperties(self._own_device)
            self.is_connected.set()
        elif event.devicename is not None:
            self._hand_on(event)

    async def send_getProperties(  # noqa: N802 - the library's name
        self, devicename: str | None = None, vectorname: str | None = None
    ) -> None:
        """Do nothing: the library must not request properties by itself.

        A property requested twice is defined twice.
        """


class _Loop(asyncio.SelectorEventLoop):
    """Event loop that puts an ``IndiStream`` between each socket and the library."""

    def __init__(self, on_end: Callable[[], None]) -> None:
        super().__init__()
        self._on_end = on_end
        self.has_failed = False
        self.stream: IndiStream | None = None
        self.on_failure: Callable[[], None] = lambda: None

    async def create_connection(  # type: ignore[override]
        self, protocol_factory: Callable[[], asyncio.Protocol], *arguments: Any, **options: Any
    ) -> tuple[asyncio.Transport, asyncio.Protocol]:
        """Create a connection as every loop does, but through an ``IndiStream``."""
        stream = self.stream = IndiStream(protocol_factory(), self._on_end)
        try:
            return await super().create_connection(lambda: stream, *arguments, **options)
        except OSError:
            self.has_failed = True
            self.on_failure()
            raise
