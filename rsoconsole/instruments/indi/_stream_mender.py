"""Corrects an INDI server's bytes for a strict XML parser."""

import binascii
import codecs
import re
import struct
from collections import OrderedDict

_LATIN_1 = "rsoconsole-latin-1"
_CONTROLS = bytes(set(range(32)) - set(b"\t\r\n"))
_SPACES = b" \t\r\n"
_AMPERSAND = re.compile(rb"&(?!(?:amp|lt|gt|quot|apos|#[0-9]+|#x[0-9a-fA-F]+);)")
_CUT_ENTITY = re.compile(rb"&[#0-9a-zA-Z]{0,7}\Z")
_BLOB = b"<oneBLOB"
_BLOB_START = re.compile(rb"<oneBLOB\b[^<>]*(?<!/)>")
_KEPT_BLOBS = 4
_TICKET = struct.Struct(">Q")


def _as_latin_1(error: UnicodeError) -> tuple[str, int]:
    assert isinstance(error, UnicodeDecodeError)
    return error.object[error.start : error.end].decode("latin-1"), error.end


codecs.register_error(_LATIN_1, _as_latin_1)


class StreamMender:
    """Corrects a server's bytes, piece by piece, before an XML parser reads them.

    The contents of BLOBs bypass the parser: their base64 is decoded as it comes, which is faster,
    and the parser gets a short ticket in their place, which ``pop_blob`` exchanges for the content.
    Corrected are errors that libindi accepts and a strict parser rejects: control characters, bare
    ampersands, and bytes that are not UTF-8, which are read as Latin-1.
    """

    def __init__(self) -> None:
        self._decoder = codecs.getincrementaldecoder("utf-8")(_LATIN_1)
        self._cut = b""
        """Beginning of an incomplete entity or BLOB tag."""
        self._blob: _Blob | None = None
        self._blobs: OrderedDict[int, bytearray] = OrderedDict()
        self._tickets = 0

    def pop_blob(self, ticket: bytes) -> bytearray:
        """Return the content of the BLOB with this ticket; only once.

        Empty where there is no such BLOB.
        """
        try:
            return self._blobs.pop(_TICKET.unpack(ticket)[0], bytearray())
        except struct.error:
            return bytearray()

    def correct(self, data: bytes) -> bytes:
        """Return the corrected bytes for the parser.

        An incomplete entity or tag at the end of ``data`` is returned with the next piece.
        """
        data, self._cut = self._cut + data, b""
        done = []
        while data:
            if self._blob is not None:
                text, tag, rest = data.partition(b"<")
                self._blob.add(text)
                if not tag:
                    break
                done.append(self._ticket(self._blob))
                self._blob, data = None, tag + rest
            elif start := _BLOB_START.search(data):
                done.append(self._mended(data[: start.end()]))
                self._blob, data = _Blob(), data[start.end() :]
            else:
                place = _cut_place(data)
                self._cut = data[place:]
                done.append(self._mended(data[:place]))
                break
        return b"".join(done)

    def _mended(self, data: bytes) -> bytes:
        if not data.isascii() or self._decoder.getstate()[0]:
            data = self._decoder.decode(data).encode()
        data = data.translate(None, _CONTROLS)
        return _AMPERSAND.sub(b"&amp;", data) if b"&" in data else data

    def _ticket(self, blob: "_Blob") -> bytes:
        self._tickets += 1
        self._blobs[self._tickets] = blob.content()
        while len(self._blobs) > _KEPT_BLOBS:
            self._blobs.popitem(last=False)
        return binascii.b2a_base64(_TICKET.pack(self._tickets), newline=False)


class _Blob:
    """Decoder of base64 that comes in pieces."""

    def __init__(self) -> None:
        self._content = bytearray()
        self._left = b""
        self._is_sound = True

    def add(self, text: bytes) -> None:
        """Add the next piece of base64, which may be cut anywhere."""
        text = self._left + text.translate(None, _SPACES)
        whole = len(text) // 4 * 4
        self._left = text[whole:]
        try:
            self._content += binascii.a2b_base64(text[:whole])
        except binascii.Error:
            self._is_sound = False

    def content(self) -> bytearray:
        """Return the decoded bytes; empty where the text was no valid base64."""
        return self._content if self._is_sound and not self._left else bytearray()


def _cut_place(data: bytes) -> int:
    """Place to cut, so that neither an entity nor a BLOB's tag comes in two pieces."""
    last = data.rfind(b"<")
    tail = data[last:] if last >= 0 else b""
    if tail and b">" not in tail and (_BLOB.startswith(tail) or tail.startswith(_BLOB)):
        return last
    cut = _CUT_ENTITY.search(data)
    return cut.start() if cut else len(data)
