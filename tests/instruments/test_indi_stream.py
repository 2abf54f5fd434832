"""What a strict XML parser is given of an INDI server's bytes."""

import asyncio
import base64
import itertools
from typing import Any
from xml.etree import ElementTree as ET

import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("indipyclient")

from rsoconsole.instruments.indi.indi_stream import IndiStream


def stream() -> IndiStream:
    return IndiStream(asyncio.Protocol(), lambda: None)


def pieces(data: bytes, cuts: list[int]) -> list[bytes]:
    places = sorted({0, len(data), *(cut % (len(data) + 1) for cut in cuts)})
    return [data[a:b] for a, b in itertools.pairwise(places)]


VECTORS = (
    '<setTextVector device="R&D &amp; co"><oneText name="a">x &lt; &#176;</oneText>'
    "</setTextVector>\n",
    '<message device="Dec (\u00b0)" message="caf\u00e9 & \u20ac &#xb0;&unknown; \x07\x00"/>\n',
)


@given(st.lists(st.integers(0, 10_000), max_size=12))
def test_wherever_it_is_cut_the_parser_reads_the_same(cuts):
    mended = b"".join(map(stream().cleaned, pieces("".join(VECTORS).encode(), cuts)))
    text, message = ET.fromstring(b"<all>" + mended + b"</all>")
    assert text.get("device") == "R&D & co"
    assert text[0].text == "x < \u00b0"
    assert message.get("message") == "caf\u00e9 & \u20ac \u00b0&unknown; "


@given(st.binary(max_size=400), st.lists(st.integers(0, 400), max_size=5))
def test_any_bytes_are_utf_8_without_control_characters_afterwards(data, cuts):
    mended = b"".join(map(stream().cleaned, pieces(data, cuts)))
    assert not set(mended.decode()) & set(map(chr, set(range(32)) - {9, 10, 13}))


def test_latin_1_is_read_as_what_it_means():
    assert stream().cleaned('label="\xb0"'.encode("latin-1")).decode() == 'label="\xb0"'


@pytest.mark.parametrize("size", [100, 5000, 70_000])
def test_a_blob_keeps_its_content_and_loses_the_ends_of_its_lines(size):
    content = bytes(range(256)) * 4000
    text = base64.b64encode(content)
    lines = b"\n".join(text[i : i + 72] for i in range(0, len(text), 72))
    data = (
        b'<setBLOBVector a="b">\n<oneBLOB name="x">\n' + lines + b"\n</oneBLOB>\n</setBLOBVector>"
    )
    own = stream()
    mended = b"".join(own.cleaned(data[i : i + size]) for i in range(0, len(data), size))
    (blob,) = ET.fromstring(mended)
    assert base64.b64decode(blob.text or "") == content
    # All but those of the pieces in which it begins and ends.
    assert size < 4096 or mended.count(b"\n") <= 2 * size / 72 + 4


def test_a_long_text_keeps_the_ends_of_its_lines():
    words = b"one word\n" * 1000
    assert stream().cleaned(words) == words


def test_a_whole_message_is_never_held_back():
    whole = b'<message message="R&D"/>'
    assert stream().cleaned(whole) == b'<message message="R&amp;D"/>'


def test_what_is_told_to_the_stream_reaches_the_reader_and_the_end_its_owner():
    told: list[Any] = []

    class Reader(asyncio.Protocol):
        def data_received(self, data: bytes) -> None:
            told.append(data)

        def connection_lost(self, exc: Exception | None) -> None:
            told.append("lost")

    own = IndiStream(Reader(), lambda: told.append("end"))
    own.data_received(b"<a/>")
    own.eof_received()
    own.connection_lost(None)
    assert told == [b"<a/>", "end", "end", "lost"]
