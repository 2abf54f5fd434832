"""An INDI server on this machine around one odd mount, in real time.

As indiserver it tells all clients that asked for the device what its driver says, keeps what they
send for a driver that is frozen, and starts again one that has died.
"""

import asyncio
import contextlib
import math
import socket
import threading
import time
from collections.abc import Iterator, Mapping
from typing import Any
from xml.etree import ElementTree as ET

from tests.rigs.odd_mount import DEVICE, Oddities, OddMount

_LONGEST_WAIT_S = 0.5


class ElementReader:
    """Whole INDI elements out of a stream that has no root."""

    def __init__(self) -> None:
        """At its beginning."""
        self._parser: Any = ET.XMLPullParser(events=("start", "end"))
        self._parser.feed("<indi>")
        self._depth, self._root = 0, ET.Element("")

    def feed(self, chunk: bytes) -> list[ET.Element]:
        """Those that end in this piece. Raises ET.ParseError."""
        self._parser.feed(chunk)
        done = []
        for event, element in self._parser.read_events():
            if event == "start":
                self._root = element if self._depth == 0 else self._root
            self._depth += 1 if event == "start" else -1
            if event == "end" and self._depth == 1:
                done.append(element)
                self._root.remove(element)
        return done


class OddMountServer:
    """Serves while its block runs. Everything may be called from every thread."""

    def __init__(self, oddities: Oddities | Mapping[str, Any] | None = None, port: int = 0) -> None:
        """``port`` 0: a free one, known in the block."""
        self.port = port
        self._lock = threading.RLock()
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._run, daemon=True, name="odd mount")
        self._listener: socket.socket | None = None
        self._clients: set[_Client] = set()
        self._tick: asyncio.TimerHandle | None = None
        self._kept: list[ET.Element] | None = None
        """What has come for a frozen driver."""
        self.model = OddMount(
            oddities or Oddities(),
            monotonic_s=time.monotonic,
            utc_ns=time.time_ns,
            emit=self._emit,
        )
        """To be touched within ``locked`` alone, but for what is a plain attribute."""

    def __enter__(self) -> "OddMountServer":
        """Listen. Raises OSError where somebody else does."""
        self._listener = socket.create_server(("127.0.0.1", self.port))
        self.port = self._listener.getsockname()[1]
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Hang up."""
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()

    @contextlib.contextmanager
    def locked(self) -> Iterator[OddMount]:
        """The model, brought to the present, and nobody else at it."""
        with self._lock:
            self.model.advance()
            yield self.model
            self._loop.call_soon_threadsafe(self._plan)

    def foreign(self, ra_deg: float, dec_deg: float) -> None:
        """Another client's go-to (epoch of date); it is not among what was ``received``."""
        with self.locked() as model:
            model.go_to(ra_deg, dec_deg)

    def kill_driver(self, restart_s: float = 1.0) -> None:
        """It dies; the server starts it again after so long, math.inf: never. The mount goes on."""
        with self.locked() as model:
            if model.is_driver_there:
                model.end_driver()
                if math.isfinite(restart_s):
                    self._loop.call_soon_threadsafe(
                        self._loop.call_later, restart_s, self._start_driver
                    )

    def freeze(self) -> None:
        """Stop the driver's process; what clients send waits for it. The mount goes on."""
        with self.locked() as model:
            self._kept, model.deaf = self._kept or [], True

    def thaw(self) -> None:
        """Let it run again: it takes what has waited."""
        with self.locked() as model:
            kept, self._kept, model.deaf = self._kept or [], None, False
            for element in kept:
                model.receive(element)

    def take(self, element: ET.Element) -> None:
        """What a client sent."""
        with self.locked() as model:
            if self._kept is not None:
                self._kept.append(element)
            else:
                model.receive(element)

    def _start_driver(self) -> None:
        with self.locked() as model:
            model.start_driver()

    def _emit(self, element: str) -> None:
        data = element.encode("utf-8", "surrogateescape") + b"\n"
        # In the order in which they come, whichever thread made the driver speak.
        self._loop.call_soon_threadsafe(self._send, data)

    def _send(self, data: bytes) -> None:
        for client in self._clients:
            if client.has_asked and not client.transport.is_closing():
                client.transport.write(data)

    def _plan(self) -> None:
        if self._tick is not None:
            self._tick.cancel()
        with self._lock:
            wait_s = min(_LONGEST_WAIT_S, self.model.next_event_s - time.monotonic())
        self._tick = self._loop.call_later(max(0.0, wait_s), self._look)

    def _look(self) -> None:
        with self.locked():
            pass

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        server = self._loop.run_until_complete(
            self._loop.create_server(lambda: _Client(self), sock=self._listener)
        )
        self._plan()
        self._loop.run_forever()
        server.close()
        for client in tuple(self._clients):
            client.transport.abort()
        # Once more round, in which the connections are closed.
        self._loop.run_until_complete(asyncio.sleep(0))
        self._loop.close()


class _Client(asyncio.Protocol):
    """One connection; asyncio's have TCP_NODELAY."""

    transport: asyncio.Transport

    def __init__(self, server: OddMountServer) -> None:
        self._server, self._reader = server, ElementReader()
        self.has_asked = False

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self.transport = transport
        self._server._clients.add(self)

    def data_received(self, data: bytes) -> None:
        try:
            elements = self._reader.feed(data)
        except ET.ParseError:
            self.transport.abort()
            return
        for element in elements:
            is_question = element.tag == "getProperties"
            self.has_asked |= is_question and element.get("device") in (None, DEVICE)
            self._server.take(element)

    def connection_lost(self, exc: Exception | None) -> None:
        self._server._clients.discard(self)
