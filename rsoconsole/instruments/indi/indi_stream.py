"""What lies between an INDI server's socket and the library that reads from it."""

import asyncio
from collections.abc import Callable

from rsoconsole.instruments.indi.stream_mender import StreamMender


class IndiStream(asyncio.Protocol):
    """Hands a connection's bytes, mended, on to another protocol."""

    def __init__(self, reader: asyncio.Protocol, on_end: Callable[[], None]) -> None:
        """``on_end`` is called when the server hangs up."""
        self._reader, self._on_end = reader, on_end
        self.mender = StreamMender()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """The connection is there."""
        self._reader.connection_made(transport)

    def data_received(self, data: bytes) -> None:
        """Count bytes that have come."""
        if cleaned := self.mender.cleaned(bytes(data)):
            self._reader.data_received(cleaned)

    def eof_received(self) -> bool | None:
        """The server sends no more."""
        self._on_end()
        return self._reader.eof_received()

    def connection_lost(self, exc: Exception | None) -> None:
        """The connection is gone."""
        self._on_end()
        self._reader.connection_lost(exc)

    def pause_writing(self) -> None:
        """The server reads too slowly."""
        self._reader.pause_writing()

    def resume_writing(self) -> None:
        """It reads again."""
        self._reader.resume_writing()
