"""What was fetched as text: plain, gzip or a zip archive with one file of elements in it."""

import io
import zipfile
import zlib

from rsoconsole.element_sources.fetch import MOST_BYTES, gunzipped
from rsoconsole.errors import OrbitError

_GZIP, _ZIP = b"\x1f\x8b", b"PK\x03\x04"


def text_of(content: bytes) -> str:
    """The text. Raises OrbitError where it is none, or unpacked larger than ``MOST_BYTES``."""
    if content.startswith(_GZIP):
        content = _gunzipped(content)
    elif content.startswith(_ZIP):
        content = _of_archive(content)
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = content.decode("latin-1")
    if "\x00" in text:
        raise OrbitError("it is no text, not elements")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def expect_elements_not_a_page(text: str) -> None:
    """Raises OrbitError, with its first words, where a web page or a remark stands in for data."""
    start = text.lstrip()[:400]
    lower = start.lower()
    if lower.startswith(("<!doctype html", "<html")) or ("<html" in lower and "<ndm" not in lower):
        raise OrbitError("a web page came in place of elements")
    lines = start.splitlines()
    if not start:
        raise OrbitError("the answer is empty")
    if len(text) < 200 and not start.startswith(("[", "{", "<")) and len(lines) < 2:
        words = "".join(c if c.isprintable() else " " for c in lines[0])[:80]
        raise OrbitError(f"no elements, but: {words}")


def _gunzipped(content: bytes) -> bytes:
    try:
        plain = gunzipped(content)
    except (OSError, zlib.error) as error:
        raise OrbitError(f"its gzip is broken ({error})") from error
    except EOFError as error:
        raise OrbitError("its gzip ends before it is whole") from error
    if len(plain) > MOST_BYTES:
        raise OrbitError(f"unpacked it is larger than {MOST_BYTES >> 20} MB")
    return plain


def _of_archive(content: bytes) -> bytes:
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            files = [each for each in archive.infolist() if not each.is_dir()]
            if len(files) != 1:
                raise OrbitError(f"its archive holds {len(files)} files, one is needed")
            with archive.open(files[0]) as stream:
                plain = stream.read(MOST_BYTES + 1)
    except (zipfile.BadZipFile, zlib.error, EOFError, RuntimeError, NotImplementedError) as error:
        raise OrbitError(f"its archive is broken ({error})") from error
    if len(plain) > MOST_BYTES:
        raise OrbitError(f"unpacked it is larger than {MOST_BYTES >> 20} MB")
    return plain
