"""What lies between an INDI server's socket and an XML parser that is strict about its input."""

import asyncio
import codecs
import re
from collections.abc import Callable

_LONG = 4096
"""No tag is so long: a piece of that size without one lies within a member's content."""
_LATIN_1 = "rsoconsole-latin-1"
_CONTROLS = bytes(set(range(32)) - set(b"\t\r\n"))
_AMPERSAND = re.compile(rb"&(?!(?:amp|lt|gt|quot|apos|#[0-9]+|#x[0-9a-fA-F]+);)")
_CUT_ENTITY = re.compile(rb"&[#0-9a-zA-Z]{0,7}\Z")


def _as_latin_1(error: UnicodeError) -> tuple[str, int]:
    assert isinstance(error, UnicodeDecodeError)
    return error.object[error.start : error.end].decode("latin-1"), error.end


codecs.register_error(_LATIN_1, _as_latin_1)


class IndiStream(asyncio.Protocol):
    """Hands a connection's bytes on to another protocol.

    Line ends are taken out of BLOBs: drivers end a line every 72 bytes, and each would be a piece
    of its own to the parser, 1,200,000 for a frame of 33 MB. Whatever libindi lets pass and a
    strict parser ends at is mended: control characters, ampersands that stand for themselves, and
    what is no UTF-8, which is read as Latin-1.
    """

    def __init__(self, reader: asyncio.Protocol, on_end: Callable[[], None]) -> None:
        """``on_end`` is called when the server hangs up."""
        self._reader, self._on_end = reader, on_end
        self._decoder = codecs.getincrementaldecoder("utf-8")(_LATIN_1)
        self._cut = b""
        """The beginning of what may be an entity."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """The connection is there."""
        self._reader.connection_made(transport)

    def data_received(self, data: bytes) -> None:
        """So many bytes have come."""
        if cleaned := self.cleaned(bytes(data)):
            self._reader.data_received(cleaned)

    def cleaned(self, data: bytes) -> bytes:
        """The same content, as the parser takes it; what is cut off comes with the next piece."""
        if not data.isascii() or self._decoder.getstate()[0]:
            data = self._decoder.decode(data).encode()
        data, self._cut = self._cut + data, b""
        if len(data) >= _LONG and not any(mark in data for mark in (b"<", b">", b" ")):
            return data.translate(None, b"\r\n" + _CONTROLS)
        data = data.translate(None, _CONTROLS)
        if b"&" not in data:
            return data
        if cut := _CUT_ENTITY.search(data):
            data, self._cut = data[: cut.start()], cut.group()
        return _AMPERSAND.sub(b"&amp;", data)

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
