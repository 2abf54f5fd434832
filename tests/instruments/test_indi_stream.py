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

from rsoconsole.instruments.indi._indipyclient_client import IndiStream
from rsoconsole.instruments.indi._stream_mender import StreamMender


def stream() -> StreamMender:
    return StreamMender()


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
    mended = b"".join(map(stream().correct, pieces("".join(VECTORS).encode(), cuts)))
    text, message = ET.fromstring(b"<all>" + mended + b"</all>")
    assert text.get("device") == "R&D & co"
    assert text[0].text == "x < \u00b0"
    assert message.get("message") == "caf\u00e9 & \u20ac \u00b0&unknown; "


@given(st.binary(max_size=400), st.lists(st.integers(0, 400), max_size=5))
def test_any_bytes_are_utf_8_without_control_characters_afterwards(data, cuts):
    mended = b"".join(map(stream().correct, pieces(data, cuts)))
    assert not set(mended.decode()) & set(map(chr, set(range(32)) - {9, 10, 13}))


def test_latin_1_is_read_as_what_it_means():
    assert stream().correct('label="\xb0"'.encode("latin-1")).decode() == 'label="\xb0"'


def blob_message(content: bytes, line: int = 72) -> bytes:
    text = base64.b64encode(content)
    lines = b"\n".join(text[i : i + line] for i in range(0, len(text), line))
    head = b'<setBLOBVector a="b">\n<oneBLOB name="x" size="9">\n'
    return head + lines + b"\n</oneBLOB>\n</setBLOBVector>\n"


def contents(own: StreamMender, mended: bytes) -> list[bytes]:
    """What the parser's owner finds."""
    found = ET.fromstring(b"<all>" + mended + b"</all>").iter("oneBLOB")
    return [bytes(own.pop_blob(base64.b64decode(one.text or ""))) for one in found]


@given(
    st.lists(st.binary(max_size=500), min_size=1, max_size=4),
    st.lists(st.integers(0, 10_000), max_size=12),
    st.sampled_from([3, 72, 10_000]),
)
def test_blobs_come_whole_wherever_they_are_cut(blobs, cuts, line):
    data = VECTORS[0].encode().join(blob_message(each, line) for each in blobs)
    own = stream()
    mended = b"".join(map(own.correct, pieces(data, cuts)))
    assert contents(own, mended) == blobs


@pytest.mark.parametrize("text", ["*!", "QUJD=QUJD", "QUJ", "QQ"])
def test_what_is_no_base64_is_no_content_and_the_next_one_is(text):
    own = stream()
    bad = f'<s><oneBLOB name="x">{text}</oneBLOB></s>'.encode()
    assert contents(own, own.correct(bad + blob_message(b"good"))) == [b"", b"good"]


def test_a_blob_is_handed_over_once_and_those_that_nobody_fetches_are_not_kept():
    own = stream()
    mended = own.correct(b"".join(blob_message(b"%d" % number) for number in range(9)))
    assert contents(own, mended) == [b""] * 5 + [b"5", b"6", b"7", b"8"]
    assert contents(own, mended) == [b""] * 9
    assert own.pop_blob(b"no ticket") == b""


def test_a_blob_without_content_is_none():
    own = stream()
    data = b'<s><oneBLOB name="x" size="0"></oneBLOB><oneBLOB name="y" size="0"/></s>'
    assert contents(own, own.correct(data))[0] == b""


def test_a_long_text_keeps_the_ends_of_its_lines():
    words = b"one word\n" * 1000
    assert stream().correct(words) == words


def test_a_whole_message_is_never_held_back():
    whole = b'<message message="R&D"/>'
    assert stream().correct(whole) == b'<message message="R&amp;D"/>'


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
