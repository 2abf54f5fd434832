"""Reads files that others wrote, within limits: regular files only, of limited size and nesting.

Without limits, reading from a pipe may never end, and the readers of JSON and TOML recurse at every
bracket.
"""

import codecs
import json
import os
import re
import stat
import tomllib
from pathlib import Path
from typing import Any

MAX_BYTES = 8 << 20
"""Default size limit of a file, bytes: far above any configuration, keymap or card."""
MAX_DATA_BYTES = 256 << 20
"""Size limit of a data file, bytes: a catalogue of the whole sky, a season of measurements."""
TOO_DEEP = "its brackets are nested too deeply"


def read_foreign_text(path: Path, *, most_bytes: int = MAX_BYTES, encoding: str = "utf-8") -> str:
    """Return the text of a regular file of at most ``most_bytes``.

    Raises OSError, also where the file is not regular or is larger, and UnicodeDecodeError.
    """
    content = _read_regular_file(path, most_bytes)
    return content.decode(encoding).replace("\r\n", "\n").replace("\r", "\n")


def _read_regular_file(path: Path, most_bytes: int) -> bytes:
    # A pipe that nobody writes to would be waited for already when it is opened.
    descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)
    with os.fdopen(descriptor, "rb") as file:
        if not stat.S_ISREG(os.fstat(descriptor).st_mode):
            raise OSError("it is no plain file")
        content = file.read(most_bytes + 1)
    if len(content) > most_bytes:
        raise OSError(f"it is larger than {most_bytes >> 20} MB")
    return content


def read_private_lines(path: Path, fault: type[Exception], remedy: str) -> list[str]:
    """Return the non-empty lines, stripped, of a file that only its owner may read.

    Raises ``fault`` where others may read the file, and with ``remedy`` in the message where it
    cannot be read. The message holds nothing of the file's content.
    """
    try:
        if path.stat().st_mode & (stat.S_IRWXG | stat.S_IRWXO):
            raise fault(f"{path} can be read by others: 'chmod 600 {path}' first")
        lines = [line.strip() for line in read_foreign_text(path).splitlines()]
    except (OSError, UnicodeDecodeError) as error:
        raise fault(f"{path} cannot be read ({type(error).__name__}): {remedy}") from error
    return [line for line in lines if line]


def read_named_file(path: Path, fault: type[Exception], absent: str) -> str:
    """Return the text of a data file that the user named, as ``read_named_bytes`` reads it."""
    content = read_named_bytes(path, fault, absent)
    try:
        return content.decode().replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError as error:
        raise fault(f"{path} cannot be read: {error}") from error


def read_named_bytes(path: Path, fault: type[Exception], absent: str) -> bytes:
    """Return the content of a data file that the user named, of at most MAX_DATA_BYTES.

    Raises ``fault`` where it cannot be read; ``absent``: remedy in the message for a missing file.
    """
    try:
        return _read_regular_file(path, MAX_DATA_BYTES)
    except FileNotFoundError as error:
        raise fault(f"{path} does not exist: {absent}") from error
    except OSError as error:
        raise fault(f"{path} cannot be read: {error}") from error


def text_in_any_encoding(content: bytes) -> str:
    """Return a text of UTF-8, UTF-16 or an 8-bit encoding; line ends are newlines.

    Bytes that are no UTF-8 are read as Latin-1, each for itself: one name that is spelt wrong does
    not garble the others, and figures and ASCII words are as they are.
    """
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        text = content.decode("utf-16", "replace")
    elif content[1:4:2] == b"\0\0":
        text = content.decode("utf-16-le", "replace")
    elif content[:4:2] == b"\0\0":
        text = content.decode("utf-16-be", "replace")
    else:
        text = content.decode("utf-8", "surrogateescape")
        text = _NO_UTF_8.sub(lambda found: chr(ord(found[0]) - 0xDC00), text)
    return plain_lines(text)


def plain_lines(text: str) -> str:
    """Return a text with newlines at its line ends, and without byte order marks."""
    return text.replace("\ufeff", "").replace("\r\n", "\n").replace("\r", "\n")


_NO_UTF_8 = re.compile("[\udc80-\udcff]")


def parse_json(text: str | bytes) -> Any:
    """Parse JSON. Raises ValueError, also for JSON that is nested too deeply."""
    try:
        return json.loads(text)
    except RecursionError as error:
        raise ValueError(TOO_DEEP) from error


def parse_toml(text: str) -> dict[str, Any]:
    """Parse TOML. Raises ValueError, also for TOML that is nested too deeply."""
    try:
        return tomllib.loads(text)
    except RecursionError as error:
        raise ValueError(TOO_DEEP) from error
